"""Measures of a design that need no walk: closure, size, mass, the toes' paths, gaps of links."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from jansen_env.baselines.policy import Array
from jansen_env.drawings.outlines import gap
from jansen_env.drawings.shaft_order import layers
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.gravity import GRAVITY
from jansen_env.plants.base import static_deflection
from jansen_env.robot import Robot
from jansen_env.robot import buildable as built
from jansen_env.robot.kinematics import (
    advance_per_turn,
    joint_positions,
    nearest_dead_point,
    toe_positions,
)
from jansen_env.robot.lengths import lengths

OF_PATHS = "height", "width", "lift", "opening", "heave", "stance", "advance"
PLANE = np.array([1.0, 1.0j])  # a point as a complex number
SAMPLES = 180  # crank angles of a turn
NEAR = 0.01  # of the standing height: a toe so far above the lowest one counts as on the ground


def geometry_measures(robot: Robot) -> dict[str, float]:
    """Return the geometry's measures by name, see :data:`agents.design.measures.MEASURES`.

    NaN for most, and a closure of -1, where it cannot turn or stand.
    """
    known = {"mass": robot.mass, "longest": _longest(robot)}
    try:
        closure = nearest_dead_point(robot, SAMPLES)[0]
        compile_robot(robot)
        static_deflection(robot, GRAVITY)
    except ValueError:  # it does not close, all but does not, or is too heavy for its feet
        return known | {"closure": -1.0, **dict.fromkeys(OF_PATHS, math.nan)}
    angles = np.linspace(0.0, 2.0 * math.pi, SAMPLES, endpoint=False)
    place = joint_positions(robot, "fore", angles)
    toes = toe_positions(robot, angles)
    heights = toes[..., 1]
    lowest = heights.min(axis=1)  # on which it stands, level
    above, height = heights - lowest[:, None], -float(lowest.mean())
    paths = (
        height, 2.0 * np.abs(place[..., 0]).max(), above.max(),
        min(map(_opening, toes.swapaxes(0, 1))), np.ptp(lowest),
        (above <= NEAR * height).mean(), abs(advance_per_turn(robot, SAMPLES)),
    )  # fmt: skip
    return known | {"closure": closure, **dict(zip(OF_PATHS, map(float, paths), strict=True))}


def _opening(path: Array) -> float:
    """Return the gap (m) between a toe's way out and back (n, 2), in the middle of its stride."""
    x = path[:, 0] - 0.5 * (path[:, 0].min() + path[:, 0].max())
    after = np.roll(path[:, 1], -1), np.roll(x, -1)
    crossing = x * after[1] <= 0.0
    share = (x / np.where(crossing, x - after[1], 1.0))[crossing]
    return float(np.ptp((1.0 - share) * path[:, 1][crossing] + share * after[0][crossing]))


def _longest(robot: Robot) -> float:
    return max(abs(value) for name, value in lengths(robot).items() if name != "frame_angle")


Part = tuple[int, int]
"""A leg and a body, as indices."""


def shared_planes(robot: Robot) -> list[tuple[Part, Part]]:
    """Return the links that lie in one layer of a unit of legs, as the workshop drawings have it.

    Raises:
        ValueError: its links collide in any order.
    """
    first = [placed for placed in layers(robot) if placed.unit == 0]
    return [
        ((a.leg, a.body - 1), (b.leg, b.body - 1))
        for a, b in itertools.combinations(first, 2) if a.layer == b.layer
    ]  # fmt: skip


def clearance(robot: Robot, planes: Sequence[tuple[Part, Part]]) -> float:
    """Least gap between links that lie in one plane, over a turn, m; below 0: they meet."""
    turn = np.linspace(0.0, 2.0 * math.pi, SAMPLES // 2, endpoint=False)
    place = {
        k: joint_positions(robot, robot.legs[k].side, turn + robot.legs[k].phase) @ PLANE
        for k in {leg for pair in planes for leg, _ in pair}
    }
    members = robot.linkage.members
    gaps = [
        gap(place[i][:, members[a]], place[k][:, members[b]]).min() for (i, a), (k, b) in planes
    ]
    return float(min(gaps, default=math.inf)) - built.WIDTH
