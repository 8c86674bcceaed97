"""Setting a robot down: the chassis pose in which the ground carries it on both sides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.linkage import T, joint_positions
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

WIDEST_PITCH = 0.7  # rad, tried to either side
TRIES, LEVELS = 33, 4  # pitches tried at once, and how often around the best of them
RISE = 0.5  # m, height above the ground below the axis from which toes are lowered


def set_down(
    robot: Robot,
    centre: Array,
    terrain: Terrain,
    x: float,
    crank_angle: float,
    pitch: float | None,
) -> tuple[float, float]:
    """Height and pitch of the chassis when the robot is lowered onto the ground.

    Args:
        robot, terrain: the robot and the ground.
        centre: (2,) centre of mass in the chassis frame, m.
        x: crank axis, m. crank_angle: rad.
        pitch: rad, or None for the pitch at which the lowest toe ahead of the centre of mass and
            the lowest one behind it touch together; level if all toes are on one side.

    Returns:
        (y, theta): the lowest toe has no gap (toes taken as discs on their local slope).
    """
    toes = np.empty((len(robot.legs), 2))
    for side in sorted({leg.side for leg in robot.legs}):
        legs = [i for i, leg in enumerate(robot.legs) if leg.side == side]
        psi = crank_angle + np.array([robot.legs[i].phase for i in legs])
        toes[legs] = joint_positions(robot, side, psi)[:, T]
    if pitch is None:
        pitch = _level_pitch(toes, centre, terrain, x, robot.pad_radius)
    clearance, _ = _clearance(toes, centre, terrain, x, robot.pad_radius, np.array([pitch]))
    return float(-clearance.min()), float(pitch)


def _clearance(
    toes: Array, centre: Array, terrain: Terrain, x: float, radius: float, pitch: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Height by which each toe clears the ground with the axis at y = 0; and is it ahead of c?"""
    cos, sin = np.cos(pitch)[:, None], np.sin(pitch)[:, None]
    toe_x = x + cos * toes[:, 0] - sin * toes[:, 1]
    toe_y = sin * toes[:, 0] + cos * toes[:, 1]
    centre_x = x + cos * centre[0] - sin * centre[1]
    # A disc over a straight slope touches with its centre radius / cos(slope) above it.
    lift = toe_y - terrain.height(toe_x) - radius * np.sqrt(1.0 + terrain.gradient(toe_x) ** 2)
    return lift, toe_x > centre_x


def _level_pitch(toes: Array, centre: Array, terrain: Terrain, x: float, radius: float) -> float:
    low, high = -WIDEST_PITCH, WIDEST_PITCH
    pitch = 0.0
    for _ in range(LEVELS):
        tried = np.linspace(low, high, TRIES)
        lift, ahead = _clearance(toes, centre, terrain, x, radius, tried)
        front = np.where(ahead, lift, np.inf).min(axis=1)
        rear = np.where(ahead, np.inf, lift).min(axis=1)
        both = np.isfinite(front) & np.isfinite(rear)
        if not both.any():
            return 0.0
        tip = np.where(both, front - rear, np.where(np.isfinite(rear), np.inf, -np.inf))
        # Front toes rise with the pitch: of the places where they take off, the most level one.
        crossings = np.flatnonzero((tip[:-1] <= 0.0) & (tip[1:] > 0.0))
        if len(crossings) == 0:
            return pitch
        after = int(crossings[np.argmin(np.abs(tried[crossings] + tried[crossings + 1]))]) + 1
        low, high = tried[after - 1], tried[after]
        if both[after - 1] and both[after]:
            share = tip[after - 1] / (tip[after - 1] - tip[after])
            pitch = low + share * (high - low)
        else:
            pitch = 0.5 * (low + high)
    return float(pitch)
