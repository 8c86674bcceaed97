"""Measures of one leg whose frame is held while its crank turns at constant speed.

They are those of J. Wang (2026), arXiv 2606.22129, whose text gives no formulas; these give the
numbers of its Table 4 (``docs/design/held_leg.md``).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.robot import Leg, Robot
from jansen_env.robot.kinematics import LinkageError, coordinates, toe_positions

Array = NDArray[np.float64]

STANCE = 0.15  # of the height of the toe's path: what lies below is its stance
NAMES = "step", "clearance", "duty", "flatness", "ripple", "wear", "wear_of_mean", "pin_load"


def held_leg_measures(
    robot: Robot,
    crank_speed: float = 2.0 * math.pi,
    load: float = 20.0,
    pin_radius: float = 4e-3,
    samples: int = 360,
) -> dict[str, float]:
    """Return the measures of a robot's leg by name; all NaN where its linkage does not close.

    leg_step, leg_clearance (m), leg_duty, leg_flatness, leg_ripple: of :func:`path_measures`.
    leg_wear: load times sliding distance of all pins in a turn, N m; times Archard's coefficient
    it is the volume worn. leg_wear_of_mean: the same with each pin's mean load. leg_pin_load: the
    largest, N.

    Args:
        robot: its linkage, links and friction are used; its legs, motor and payload are not.
        crank_speed: rad/s. load: N, upwards on the leg's first toe in its stance. pin_radius: m.
        samples: crank angles of a turn.
    """
    leg = replace(robot, legs=(Leg("fore"),))
    psi = 2.0 * math.pi * np.arange(samples) / samples
    try:
        toe = toe_positions(leg, psi)[:, 0]
        angle = coordinates(leg, "fore", psi)[:, ::3]
    except LinkageError:
        return {f"leg_{name}": math.nan for name in NAMES}
    force = pin_loads(leg, psi, crank_speed, np.where(in_stance(toe[:, 1]), load, 0.0))
    body, other = np.array([pin[1:] for pin in leg.linkage.pins]).T - 1
    wear, of_mean = wear_of_pins(force, angle[:, body] - angle[:, other], pin_radius)
    values = *path_measures(toe), wear.sum(), of_mean.sum(), force.max()
    return {f"leg_{name}": float(value) for name, value in zip(NAMES, values, strict=True)}


def in_stance(height: Array) -> NDArray[np.bool_]:
    """(n,) whether the toe, at heights (n,) of a turn, is on the ground."""
    low, high = height.min(), height.max()
    return np.asarray(height <= low + STANCE * (high - low))


def path_measures(path: Array) -> tuple[float, float, float, float, float]:
    """Return step, clearance (m), duty, flatness and ripple of a toe's path (n, 2), m, of a turn.

    Step is the length of the stance, clearance the highest point over its mean height, duty its
    share of the turn, flatness the standard deviation of its height over the step, ripple that of
    the toe's speed along the ground over its mean.
    """
    down = in_stance(path[:, 1])
    x, y = path[down].T
    speed = (np.roll(path[:, 0], -1) - np.roll(path[:, 0], 1))[down]
    step, clearance = float(np.ptp(x)), float(path[:, 1].max() - y.mean())
    ripple = float(speed.std() / abs(speed.mean()))
    return step, clearance, float(down.mean()), float(y.std()) / step, ripple


def pin_loads(leg: Robot, psi: Array, crank_speed: float, load: Array) -> Array:
    """(n, pins) force in each of the linkage's pins at crank angles (n,), N.

    Args:
        leg: a robot of one leg. psi: rad. crank_speed: rad/s, constant. load: (n,) N, on the toe.
    """
    q, speed, contact = np.zeros((psi.size, 4)), np.zeros((psi.size, 4)), np.zeros((psi.size, 1, 3))
    q[:, 3], speed[:, 3], contact[:, 0, 1] = psi, crank_speed, load
    forces = joint_forces(leg, q, speed, contact=contact, fixed_base=True, q_ddot=np.zeros(q.shape))
    return forces.magnitude[:, 0]


def wear_of_pins(force: Array, angle: Array, radius: float) -> tuple[Array, Array]:
    """Load times sliding distance of pins in a turn (pins,), N m, and that of their mean loads.

    Args:
        force: (n, pins) N, at crank angles evenly over a turn. angle: (n, pins) rad, between the
            two links, up to whole turns. radius: m, of the pins.
    """
    turn = np.roll(angle, -1, axis=0) - angle
    slid = radius * np.abs((turn + math.pi) % (2.0 * math.pi) - math.pi)
    between = 0.5 * (force + np.roll(force, -1, axis=0))
    return (between * slid).sum(axis=0), force.mean(axis=0) * slid.sum(axis=0)
