"""A robot cannot tell a slope from level ground on which gravity is turned."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jansen_env import Terrain
from jansen_env.gravity import GRAVITY
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot import holy_numbers_robot, paper_robot

WALKS = {  # robot, crank angle, friction, torque
    "paper": (paper_robot(), 0.3, 0.8, 6.0),
    "holy slipping": (holy_numbers_robot(), 2.0, 0.2, 6.0),
    "six legs": (paper_robot(3), 1.0, 0.8, -8.0),
}


@pytest.mark.parametrize("name", WALKS)
@pytest.mark.parametrize("angle", [0.1, -0.2])
def test_a_slope_is_gravity_turned(name, angle, measured):
    """2 s of walking on a slope = on level ground with g turned by -angle, in the turned frame."""
    robot, psi, mu, torque = WALKS[name]
    slope = ProjectionPlant(robot, Terrain.slope(angle, friction=mu))
    level = ProjectionPlant(
        robot,
        Terrain.flat(friction=mu),
        gravity=(-GRAVITY * math.sin(angle), -GRAVITY * math.cos(angle)),
    )
    slope.reset(0.0, psi)
    start, turn = slope.state, np.exp(1j * angle)

    def turned(state):
        """A state on the level as seen on the slope."""
        q = state.copy()
        for i in (0, 4):
            place = turn * complex(*q[i : i + 2])
            q[i : i + 2] = place.real, place.imag
        q[2] += angle
        return q

    place = complex(*start[:2]) / turn
    level.state = [place.real, place.imag, start[2] - angle, *start[3:]]
    apart, work, slip = 0.0, 0.0, 0.0
    for k in range(100):
        push = torque * (1.0 + math.sin(0.3 * k))
        results = [plant.step(push, 0.02) for plant in (slope, level)]
        apart = max(apart, np.abs(slope.state - turned(level.state)).max())
        work += abs(results[0].contact_force - results[1].contact_force).max() * 0.02
        slip += results[0].slip.sum()
    assert abs(slope.state[3] - psi) > 1.0 and slip > 1e-4  # it stepped, it slid
    measured("state apart after 2 s", apart, 1e-12)
    measured("impulses apart", work, 1e-11, "N s")
