"""Environments on pymunk's shapes: interfaces agree, states are restored exactly, and heights."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pymunk
import pytest
from side_by_side import compare, side_by_side, together, walk

from jansen_env import Compliance, Terrain
from jansen_env.sb3 import make_vec_env
from jansen_env.terrain import Piece, Shapes

ACTION = np.array([0.5], np.float32)


def box(left, bottom, right, top):
    return Piece(((left, bottom), (right, bottom), (right, top), (left, top)))


FLOOR = box(-30.0, -1.0, 30.0, 0.0)
COURSE = Shapes(
    (
        FLOOR,
        box(0.25, -0.2, 0.45, 0.02),
        Piece(((0.7, -0.08),), 0.1),
        box(-0.8, -0.5, -0.6, 2.0),
        box(1.2, 0.6, 1.5, 0.7),
    )
)
"""A course with a step, a ball in the floor, a wall behind the robot, and a roof ahead of it."""
ARGUMENTS = {
    "rigid feet": {},
    "compliant feet": {"pad_compliance": Compliance(2e4, 50.0)},
    "senses": {
        "noise": {},
        "push": {"impulse": (1.0, 0.5)},
        "observe": "onboard",
        "delay": (0, 0.03),
    },
    "beside others": {"terrain": [COURSE, "slope:0.1", Terrain.flat()]},
}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_a_batch_does_what_each_does_alone(name):
    """Robots agree bit for bit through falls, time limits and resets.

    One case has shapes and height lines in the same batch.
    """
    arguments = {"terrain": COURSE, **ARGUMENTS[name]}
    grounds = arguments.pop("terrain")
    each = [
        {"terrain": ground} for ground in (grounds if isinstance(grounds, list) else [grounds] * 3)
    ]
    batch = together(3, limit=25, terrain=grounds, **arguments)
    assert compare(batch, side_by_side(3, limit=25, each=each, **arguments), 60) >= 6


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


def test_stable_baselines_sees_the_same():
    arguments = {"terrain": COURSE, "terminate_when_fallen": False}
    venv = make_vec_env("JansenWalker-v0", 2, env_kwargs=arguments)
    venv.seed(5)
    envs = [gym.make("JansenWalker-v0", **arguments) for _ in range(2)]
    ours = venv.reset()
    theirs = [env.reset(seed=5 + i)[0] for i, env in enumerate(envs)]
    assert np.array_equal(ours, theirs)
    for _ in range(20):
        ours = venv.step(np.full((2, 1), 0.5, np.float32))[0]
        assert np.array_equal(ours, [env.step(ACTION)[0] for env in envs])


@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
@pytest.mark.parametrize("name", ["rigid feet", "compliant feet"])
def test_copies_pickles_and_states_continue_bit_for_bit(plant, name):
    """Copies and pickles continue as their original does.

    A copy of rigid bodies continues as from a restored state, as restoring closes gaps in the
    joints.
    """
    env = gym.make("JansenWalker-v0", terrain=COURSE, plant=plant, **ARGUMENTS[name])
    env.reset(seed=2)
    steps = 20 if plant == "projection" else 3
    for _ in range(steps):
        env.step(ACTION)
    state = env.unwrapped.get_state()
    others = [pickle.loads(pickle.dumps(env.unwrapped)), copy.deepcopy(env.unwrapped)]
    if plant == "rigid_body":
        env.unwrapped.set_state(state)
    expected = [env.step(ACTION)[0] for _ in range(steps)]
    env.unwrapped.set_state(state)
    for other in (env, *others):
        assert np.array_equal([other.step(ACTION)[0] for _ in range(steps)], expected)


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


def test_a_pickled_environment_goes_on_tracking_joint_forces():
    env = gym.make("JansenWalker-v0", terrain=COURSE, track_joint_forces=True)
    env.reset(seed=0)
    other = pickle.loads(pickle.dumps(env.unwrapped))
    infos = [each.step(ACTION)[4] for each in (env, other)]
    assert infos[0]["joint_force_max"] == infos[1]["joint_force_max"] > 0.0


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
