"""Loads of pins and bars in a walk: wear by Archard (1953), the largest force, buckling.

Wear is force times sliding at the bush's radius, summed over all pins, per metre walked; times
Archard's coefficient it is the volume worn.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import compile_robot
from jansen_env.plants.trace import trace_forces
from jansen_env.robot import Bar, Robot
from jansen_env.robot import buildable as built
from jansen_env.robot.kinematics import turning
from jansen_env.robot.linkage import CRANK

TRACED = 8  # time steps from one to the next in which pin forces are worked out
PEAKS = 64  # time steps in which the ground pushes most, for the largest forces


def loads_of_walk(
    robot: Robot, trace: NDArray[np.void], time_step: float, least: float
) -> dict[str, float]:
    """Return wear (J/m), the largest pin force (N) and the least safety of a bar against buckling.

    Args:
        trace: (steps,) of a walk, see :mod:`jansen_env.plants.trace`. time_step: s. least: m, to be
            walked, or the wear is NaN.
    """
    pushed = np.abs(trace["impulses"]).sum(axis=(1, 2))
    every, hardest = trace[::TRACED], trace[np.argsort(pushed)[-PEAKS:]]
    tables = compile_robot(robot)
    force = trace_forces(tables, every, time_step).magnitude
    pairs = [(pin.other, pin.body) for pin in robot.linkage.pins]
    rate = turning(robot, every["pose"][:, 3], pairs)  # rad of each pin per rad of the crank
    rate *= np.abs(every["velocity_after"][:, 3, None, None])
    work = float((force * rate).sum()) * built.PIN_RADIUS * time_step * TRACED
    walked = float(trace["pose"][-1, 0] - trace["pose"][0, 0])
    peak = trace_forces(tables, hardest, time_step)
    axial, safety = peak.link_loads()[..., 0], math.inf
    for body, (name, link) in enumerate(zip(robot.linkage.names, robot.bodies, strict=True), 1):
        if isinstance(link, Bar) and body > CRANK:
            ends = [k for k, (b, _) in enumerate(robot.linkage.corners) if b == body]
            push = max(1e-9, -float(axial[..., ends].mean(axis=-1).min()))
            most = built.buckling_load(link.length, thickness=built.bar_thickness(name))
            safety = min(safety, most / push)
    return {
        "wear": work / walked if walked > least else math.nan,
        "pin_force": float(peak.magnitude.max()),
        "rod_safety": safety,
    }
