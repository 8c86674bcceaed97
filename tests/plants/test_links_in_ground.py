"""Links whose sides pass below a vertex of the ground are counted on both plants and in batches."""

import gymnasium as gym
import numpy as np
import pytest
from motions import PLANTS

from jansen_env import Terrain
from jansen_env.dynamics.pads import pad_sides
from jansen_env.robot import ROBOTS
from jansen_env.tasks.walking.profile import Profile
from jansen_env.terrain.ground import one_step

ROBOT = ROBOTS["paper"]()


def spike(x, y):
    """Flat ground 1 m below the axis with a spike as steep as may be, its top at (x, y), m."""
    foot = (y + 1.0) / 5.6
    return Terrain([[-9.0, -1.0], [x - foot, -1.0], [x, y], [x + foot, -1.0], [9.0, -1.0]])


def expected_count(centres, points):
    """Count the sides that pass below a vertex of the ground, by another formula."""
    count = 0
    for a, b in centres[pad_sides(ROBOT)]:
        share = (points[:, 0] - a[0]) / (b[0] - a[0])
        between = (share > 0.0) & (share < 1.0)
        count += (between & (points[:, 1] > (1.0 - share) * a[1] + share * b[1])).any()
    return count


def test_sides_of_a_leg():
    """A leg has three of the upper triangle and three of the foot, the rocker and the coupler; rods
    have none.
    """
    assert len(pad_sides(ROBOT)) == 8 * len(ROBOT.legs)


@pytest.mark.parametrize("name", sorted(PLANTS))
def test_links_over_a_spike(name):
    """The count is that of the other formula, for spikes from below the toes to above the frame."""
    counts = []
    for x, y in [(0.3, -0.7), (0.25, -0.3), (-0.2, -0.2), (0.35, 0.1), (0.0, 0.3), (-0.3, -0.45)]:
        plant = PLANTS[name](ROBOT, spike(x, y))
        plant.state = np.zeros(8)
        plant.batch.step(np.zeros(1), 1)
        if plant.batch.any_diverged:  # a pad is deep in the spike
            continue
        centres = plant.batch.pad_centres(0)
        counts.append(int(plant.batch.accumulators["links_in_ground"][0]))
        assert counts[-1] == expected_count(centres, plant.terrain.polyline), (x, y)
    assert min(counts) == 0 < max(counts) and len({*counts}) > 2


def test_a_walk_over_a_step_alone_and_in_a_batch():
    """With a crank speed of 4 rad/s, links enter the edge of a step, as often alone as in a batch;
    on flat ground they never do.
    """
    steady = Profile([0.4], [[4.0, 20.0, 0.0, 0.0]])
    step = one_step(0.5, 0.24)
    for terrain, enters in (("flat", False), (step, True)):
        arguments = {"robot": "climber", "terrain": terrain, "speed_command": 0.4}
        alone = gym.make("JansenWalkerBuilt-v0", **arguments)
        batch = gym.make_vec("JansenWalkerBuilt-v0", 2, **arguments)
        policy = steady.policy(alone.unwrapped)
        seen, info = alone.reset(seed=3)
        _ = batch.reset(seed=3)
        counts = [info["links_in_ground"]]
        for _ in range(185):
            action = policy.predict(seen[None])[0]
            seen, _, fallen, _, info = alone.step(action[0])
            *_, infos = batch.step(np.tile(action, (2, 1)))
            assert not fallen and info["links_in_ground"] == infos["links_in_ground"][0]
            counts.append(info["links_in_ground"])
        assert counts[0] == 0 and (max(counts) > 0) == enters
        alone.close(), batch.close()
