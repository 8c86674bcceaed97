"""Sides of links that collide are held by vertices of the ground, on both plants."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from courses import WALL
from motions import PLANTS

from jansen_env import Terrain
from jansen_env.dynamics.pads import pad_sides
from jansen_env.robot import ROBOTS
from jansen_env.robot.links import RIGID

SPIKE = Terrain([[-9.0, -1.0], [-0.42, -1.0], [-0.2, -0.3], [0.02, -1.0], [9.0, -1.0]])


def least_gap(plant, vertex):
    """Return the least distance of a link's side from a vertex less its radius, m."""
    robot = plant.robot
    gaps = []
    for a, b in plant.batch.pad_centres(0)[pad_sides(robot)]:
        share = (vertex - a) @ (b - a) / ((b - a) @ (b - a))
        if 0.0 < share < 1.0:
            gaps.append(np.hypot(*(a + share * (b - a) - vertex)) - robot.pad_radius)
    return min(gaps, default=np.inf)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PLANTS))
@pytest.mark.parametrize(("feet", "most"), [(None, 4e-3), (RIGID, 2e-3)])
def test_a_step_stops_a_side(name, feet, most):
    """A leg that is driven against a step's edge stops there, as far as its feet give; without the
    argument it goes in.
    """
    robot = ROBOTS["climber"]()
    robot = robot if feet is None else replace(robot, pad_compliance=feet)
    least = {}
    for collide in (False, True):
        plant = PLANTS[name](robot, WALL, links_collide=collide)
        plant.reset()
        gaps = [1.0]
        while len(gaps) <= 40 and min(gaps) > -0.01:
            result = plant.step(3.0, 0.02)
            gaps.append(least_gap(plant, WALL.polyline[2]))
            assert not result.non_toe_contact
        least[collide] = min(gaps)
    assert least[False] < -0.01 and -most < least[True] < 1e-3


def test_energy_of_a_side_on_a_spike_converges():
    """For a robot dropped on a spike, work less losses is the change of energy, the closer the
    finer the step.
    """
    residuals = []
    for time_step in (1e-3, 2.5e-4):
        robot = ROBOTS["built"]()
        plant = PLANTS["projection"](robot, SPIKE, time_step, links_collide=True)
        plant.state = np.zeros(8)
        total = 0.0
        drops = []
        for _ in range(30):
            result = plant.step(0.0, 0.02)
            total += result.energy_residual
            drops.append(result.impact_loss + result.slip_loss)
        assert sum(drops) > 0.1  # it has landed
        residuals.append(abs(total))
    assert residuals[1] < 0.5 * residuals[0] or residuals[1] < 1e-3


SAW = Terrain([(0.1 * i - 4.0, 0.25 * (i % 2)) for i in range(80)], 0.8)


@pytest.mark.parametrize("time_step", [1e-3, 2.5e-4])
def test_springs_of_sides_hold_no_energy_from_nowhere(time_step):
    """All energy of robots on compliant feet, which are set down between teeth and driven, has a
    source.
    """
    most = 2e-3 if time_step == 1e-3 else 2e-4
    rng = np.random.default_rng(0)
    plant = PLANTS["projection"](ROBOTS["built"](), SAW, time_step, links_collide=True)
    pushed = 0.0
    for angle in np.linspace(0.0, 6.0, 6):
        plant.reset(0.0, angle)
        before = plant.energy()
        for k in range(60):
            result = plant.step(0.0 if k < 20 else rng.uniform(-12.0, 12.0), 0.02)
            assert abs(result.energy_residual) < most
            assert min(result.joint_loss, result.slip_loss, result.impact_loss) >= 0.0
            if k < 20:
                assert plant.energy() < before + 1e-3
            planes = plant.batch._threads._memory[0].planes
            planes = planes[: plant.batch.records.status["end_plane"][0]]
            pushed += (planes["far_pad"] >= 0).sum()
    assert pushed > 100


@pytest.mark.parametrize("feet", [None, RIGID])
def test_sides_begin_out_of_the_ground(feet):
    """A robot is placed so that no side is in a tooth, at any crank angle."""
    robot = ROBOTS["built"]()
    robot = robot if feet is None else replace(robot, pad_compliance=feet)
    plant = PLANTS["projection"](robot, SAW, links_collide=True)
    for angle in np.linspace(0.0, 6.0, 25):
        plant.reset(0.1 * angle, angle)
        near = [vertex for vertex in SAW.polyline[1::2] if abs(vertex[0] - plant.x) < 1.5]
        assert min(least_gap(plant, vertex) for vertex in near) > -1e-3


def test_valleys_carry_no_side():
    """No plane pushes links further down that are deep in the ground between teeth."""
    plant = PLANTS["projection"](ROBOTS["paper"](), SAW, links_collide=True)
    plant.reset()
    for sunk in np.linspace(0.0, 0.3, 31):
        state = plant.state
        plant.state = state - np.array([0.0, sunk, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        try:
            plant.step(0.0, plant.time_step)
        except FloatingPointError:
            continue  # too deep
        planes = plant.batch._threads._memory[0].planes
        planes = planes[: plant.batch.records.status["end_plane"][0]]
        assert planes["normal_y"].min() > -0.2
        plant.state = state


def test_colliding_links_change_the_walk_over_a_step():
    """Batches with and without the argument are compared with single robots elsewhere."""
    arguments = {"robot": "climber", "terrain": WALL, "speed_command": 0.4}
    ends = []
    for collide in (True, False):
        env = gym.make("JansenWalkerBuilt-v0", links_collide=collide, **arguments)
        env.reset(seed=1)
        for _ in range(150):
            seen, *_ = env.step(np.full(1, 0.4, np.float32))
        ends.append(seen)
        env.close()
    assert not np.array_equal(*ends)


def test_joint_forces_are_refused():
    """Joint forces do not include those on a link's side."""
    plant = PLANTS["projection"](ROBOTS["paper"](), WALL, links_collide=True)
    with pytest.raises(ValueError, match="links_collide must be False with joint forces"):
        plant.batch.joint_forces()
    with pytest.raises(ValueError, match="must be False with links_collide=True"):
        gym.make("JansenWalker-v0", links_collide=True, track_joint_forces=True)
