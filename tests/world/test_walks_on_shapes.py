"""Environments on pymunk's shapes: threads, energies, heights, pictures and divergence."""

import gymnasium as gym
import numpy as np
import pymunk
import pytest
from courses import COURSE, FLOOR, box
from side_by_side import walk

from jansen_env import Compliance, Terrain
from jansen_env.terrain import Shapes

ACTION = np.array([0.5], np.float32)


@pytest.mark.slow
def test_threads_do_not_change_a_bit():
    """In this batch, every third robot is on shapes."""
    grounds = [(COURSE, "stairs", "flat")[k % 3] for k in range(48)]
    runs = []
    for threads in (1, 2):
        envs = gym.make_vec("JansenWalker-v0", 48, terrain=grounds, threads=threads)
        envs.reset(seed=0)
        runs.append(walk(envs, 30))
        envs.close()
    assert np.array_equal(*runs)


def test_energies_balance_as_on_height_lines():
    """The energy residual of a walk over the course is below 0.1 % of the motor's work."""
    for feet in (None, Compliance(2e4, 50.0)):
        env = gym.make(
            "JansenWalker-v0", terrain=COURSE, pad_compliance=feet, terminate_when_fallen=False
        )
        env.reset(seed=0)
        residual = work = 0.0
        for _ in range(150):
            energy = env.step(np.array([0.6], np.float32))[4]["energy"]
            residual += energy["residual"]
            work += abs(energy["motor_work"])
        assert abs(residual) < 1e-3 * work


def test_heights_are_those_below_the_crank_axis():
    """The robot observes the height of the floor under a roof, and of a step.

    A height scan over shapes without overhangs equals one over the height line.
    """
    roofed = Shapes((FLOOR, box(0.9, 1.3, 1.4, 1.5), box(2.0, -0.5, 3.0, 0.2)))
    env = gym.make("JansenWalker-v0", terrain=roofed, reset_noise_scale=0.0)
    env.reset(seed=0)
    names = [entry.name for entry in env.unwrapped.observed]
    plant = env.unwrapped.task.world.plant
    place = names.index("crank_axis_height")
    for x, ground in ((0.0, 0.0), (1.1, 0.0), (2.5, 0.2)):
        state = env.unwrapped.get_state()
        state["record"]["state"][:3] = x, 1.0 + ground, 0.0
        state["record"]["state"][4:] = 0.0
        env.unwrapped.set_state(state)
        observation = env.step(np.zeros(1, np.float32))[0]
        assert observation[place] == pytest.approx(plant.states[0, 1] - ground, abs=1e-6)
    scan = {"height_scan": (0.5, 0.5, 11), "reset_noise_scale": 0.0}
    line = Terrain(((-1.0, 0.0), (0.25, 0.0), (0.27, 0.1), (1.0, 0.1)))
    seen = []
    for ground in (line, Shapes.under(line)):
        env = gym.make("JansenWalker-v0", terrain=ground, **scan)
        seen.append(env.reset(seed=0)[0])
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-6)


def test_links_in_ground_counts_sides_that_shapes_cross():
    env = gym.make("JansenWalker-v0", terrain=[pymunk_floor()])
    env.reset(seed=0)
    assert env.step(ACTION)[4]["links_in_ground"] == 0
    post = Shapes((FLOOR, box(0.3, -0.5, 0.301, 0.9)))
    env = gym.make("JansenWalker-v0", terrain=post, terminate_when_fallen=False)
    env.reset(seed=0)
    state = env.unwrapped.get_state()
    state["record"]["state"][1] = 0.8
    env.unwrapped.set_state(state)
    assert env.step(np.zeros(1, np.float32))[4]["links_in_ground"] > 0


def pymunk_floor():
    body = pymunk.Body(body_type=pymunk.Body.STATIC)
    return pymunk.Poly(body, FLOOR.points)


def test_a_robot_on_shapes_is_drawn():
    env = gym.make("JansenWalker-v0", terrain=COURSE, render_mode="rgb_array")
    env.reset(seed=0)
    pictures = [env.render()]
    env.step(ACTION)
    pictures.append(env.render())
    assert pictures[0].std() > 10.0 and not np.array_equal(*pictures)


def test_a_robot_that_diverges_while_another_is_placed_is_truncated():
    envs = gym.make_vec("JansenWalker-v0", 2, terrain=COURSE, max_episode_steps=1).unwrapped
    envs.reset(seed=0)
    envs.step(np.zeros((2, 1)))  # both episodes are over
    state = envs.get_state(0)
    state["record"]["state"][4] = 2e4  # m/s, beyond what counts as diverged
    envs.set_state(0, state)
    with pytest.warns(UserWarning, match="robots \\[0\\] end: their simulation diverged"):
        envs.step(np.zeros((2, 1)))  # robot 1 is placed meanwhile
    assert envs.task.truncated.tolist() == [True, False]
