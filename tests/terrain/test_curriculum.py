"""Levels of drawn terrains: given one by one, and by how far a robot has walked."""

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.terrain.generators import HIGHEST, Curriculum


@pytest.mark.parametrize(
    "level, walked, commanded, then",
    [
        (3, 2.51, 5.0, 4),
        (3, 2.5, 5.0, 3),  # more than half is more than half
        (3, 1.25, 5.0, 3),
        (3, 1.24, 5.0, 2),
        (0, 0.0, 5.0, 0),
        (8, 5.0, 5.0, 9),
        (9, 2.0, 5.0, 9),
        (4, 0.0, 0.0, 4),  # nothing was asked for
    ],
)
def test_the_rule(level, walked, commanded, then, rng):
    before = rng.bit_generator.state
    assert Curriculum().next_level(level, walked, commanded, rng) == then
    assert rng.bit_generator.state == before  # nothing is drawn


def test_past_the_top_any_level(rng):
    curriculum = Curriculum(highest=4)
    levels = [curriculum.next_level(4, 5.0, 5.0, rng) for _ in range(500)]
    counts = np.bincount(levels, minlength=5)
    assert len(counts) == 5 and counts.min() > 60
    assert {curriculum.next_level(9, 0.0, 5.0, rng) for _ in range(100)} == {0, 1, 2, 3, 4}


def test_levels_of_a_batch():
    """There is one for each robot, by argument, by option, and from the next episode on."""
    envs = gym.make_vec("JansenWalker-v0", 3, terrain="stairs", terrain_level=np.array([0, 4, 9]))
    info = envs.reset(seed=0)[1]
    assert info["parameters"]["terrain_level"].tolist() == [0, 4, 9]
    heights = [abs(t.height(9.0)) for t in envs.get_attr("terrain")]
    assert 0.0 < heights[0] < heights[1] < heights[2]
    envs.reset(options={"terrain_level": np.array([1, 2, 3])})
    assert envs.get_attr("terrain_level") == (1, 2, 3)
    envs.set_attr("terrain_level", 5)
    assert envs.get_attr("terrain_level") == (1, 2, 3)
    envs.reset()
    assert envs.get_attr("terrain_level") == (5, 5, 5)
    envs.close()
    with pytest.raises(ValueError, match=r"terrain_level must be 0 for terrain .* got 3"):
        gym.make("JansenWalker-v0", terrain_level=3)


def test_a_curriculum_leads_on():
    """It goes up after a walk, down after standing, and past the top to any level, through every
    API alike.
    """
    slope = {"terrain": "slope", "terrain_level": 4, "curriculum": Curriculum(horizon=1.0)}
    env = gym.make("JansenWalker-v0", speed_command=0.1, **slope)

    def level_after(torque, steps=50):
        for _ in range(steps):
            env.step(np.full(1, torque, np.float32))
        return env.reset()[1]["parameters"]["terrain_level"]

    assert env.reset(seed=0)[1]["parameters"]["terrain_level"] == 4
    assert level_after(0.6) == 5
    assert level_after(0.6) == 6
    assert level_after(0.0) == 5
    assert level_after(0.6, steps=5) == 4  # ended early: not far enough
    env.unwrapped.set_parameters(terrain_level=HIGHEST)
    env.reset()
    assert {level_after(0.6) for _ in range(12)} - {HIGHEST}


def test_a_curriculum_goes_by_all_commands():
    """Walking there and back as commanded is a success, wherever it ends; also by a state."""
    rule = Curriculum(horizon=4.0)
    level = "slope:angle=0"
    env = gym.make("JansenWalker-v0", terrain=level, curriculum=rule).unwrapped
    env.reset(seed=0, options={"speed_command": 0.2})
    ends = []
    for command in (0.2, -0.2):
        env.set_parameters(command=command)
        for _ in range(100):
            info = env.step(np.array([3.0 * command], np.float32))[4]
        ends.append(info["x_position"])
    path = ends[0] + (ends[0] - ends[1])
    assert path > 0.8 > abs(ends[1])
    np.testing.assert_allclose(env.task.data["covered"][0], (path, 0.8))
    other = gym.make("JansenWalker-v0", terrain=level, curriculum=True).unwrapped
    other.set_state(env.get_state())
    np.testing.assert_array_equal(other.task.data["covered"], env.task.data["covered"])
    assert env.reset()[1]["parameters"]["terrain_level"] == 1
