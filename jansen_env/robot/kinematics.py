"""Positions of the joints from the crank angle: the linkage closed by intersecting circles.

Everything is in the chassis frame: crank axis O at the origin, +x the walking direction. A back
leg is the mirror image of a fore leg: x -> -x and crank angle psi -> pi - psi.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.robot import BODIES_PER_LEG, Robot, Side

Array = NDArray[np.float64]

JOINTS = ("P", "O", "A", "B", "C", "D", "E", "T")
"""Order of the joints returned by :func:`joint_positions`; T is the toe's centre."""
P, O, A, B, C, D, E, T = range(8)  # noqa: E741 - the joints' names

SKELETON = (
    (P, O), (O, A), (A, B), (P, B), (B, D), (D, P), (C, P), (C, A), (D, E), (C, E), (E, T), (T, C),
)  # fmt: skip
"""Pairs of joints joined by a straight edge of some body, for drawing."""


class LinkageError(ValueError):
    """A design that cannot turn a full revolution."""


def direction(angle: Array) -> Array:
    """Unit vectors (..., 2) at the given angles (...), rad."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _third_corner(
    name: str, psi: Array, p: Array, q: Array, from_p: float, from_q: float, turn: float
) -> Array:
    """Corner at ``from_p`` from p and ``from_q`` from q, left (turn=1) or right (-1) of p -> q."""
    span = q - p
    distance = np.hypot(span[..., 0], span[..., 1])
    along = (distance**2 + from_p**2 - from_q**2) / (2.0 * distance)
    across2 = from_p**2 - along**2
    if np.any(across2 <= 0.0):
        worst = np.unravel_index(np.argmin(across2), across2.shape)
        raise LinkageError(
            f"joint {name} does not close at crank angle {float(psi[worst]):.4f} rad: its two "
            f"links of {from_p:.5f} m and {from_q:.5f} m cannot span {float(distance[worst]):.5f} m"
        )
    unit = span / distance[..., None]
    left = np.stack([-unit[..., 1], unit[..., 0]], axis=-1)
    return p + along[..., None] * unit + turn * np.sqrt(across2)[..., None] * left


def joint_positions(robot: Robot, side: Side, psi: ArrayLike) -> Array:
    """Joint positions of a leg whose own crank stands at ``psi``.

    Args:
        robot: its link lengths are used, its legs are not.
        psi: crank angle relative to the chassis, rad, any shape (...).

    Returns:
        (..., 8, 2): joints in the order of :data:`JOINTS`, m, chassis frame.

    Raises:
        LinkageError: the linkage does not close; names the joint and the crank angle.
    """
    angle = np.asarray(psi, dtype=float)
    if side == "back":
        mirrored = joint_positions(robot, "fore", math.pi - angle)
        return mirrored * np.array([-1.0, 1.0])
    frame, foot, upper = robot.frame, robot.foot, robot.upper_triangle
    axis = np.zeros((*angle.shape, 2))
    pivot = axis - frame.length * direction(np.full(angle.shape, robot.frame_angle))
    pin = robot.crank.length * direction(angle)
    pb, _bd, _dp = upper.sides
    ce, _et, _tc = foot.sides
    top = _third_corner("B", angle, pin, pivot, robot.upper_rod.length, pb, -1.0)
    # Triangle 4 from the directions of its corners: P at th4 + pi, B at th4 + alpha4 + pi.
    edge = np.arctan2(top[..., 1] - pivot[..., 1], top[..., 0] - pivot[..., 0])
    th4 = edge + _corner_angle(upper.d, upper.l, upper.alpha)
    centroid4 = pivot + upper.d * direction(th4)
    left = centroid4 - upper.h * direction(th4 - upper.gamma)
    knee = _third_corner("C", angle, pin, pivot, robot.lower_rod.length, robot.rocker.length, 1.0)
    ankle = _third_corner("E", angle, left, knee, robot.coupler.length, ce, -1.0)
    edge = np.arctan2(ankle[..., 1] - knee[..., 1], ankle[..., 0] - knee[..., 0])
    th8 = edge + math.pi + _corner_angle(foot.d, foot.l, foot.alpha)
    toe = knee - foot.d * direction(th8) + foot.h * direction(th8 - foot.gamma)
    return np.stack([pivot, axis, pin, top, knee, left, ankle, toe], axis=-2)


def _corner_angle(d: float, l: float, alpha: float) -> float:  # noqa: E741
    """Turn from the edge first -> second corner to the line first corner -> centroid, rad."""
    edge = d * np.array([1.0, 0.0]) - l * np.array([math.cos(alpha), math.sin(alpha)])
    return -math.atan2(edge[1], edge[0])


def coordinates(robot: Robot, side: Side, psi: ArrayLike, joints: Array | None = None) -> Array:
    """Generalised coordinates (1) of a leg with the chassis at rest in its own frame.

    Args and errors as for :func:`joint_positions`; joints: what that gives, where it is known.

    Returns:
        (..., 24): theta_1, x_1, y_1, ..., theta_8, x_8, y_8 in rad and m. theta_2 is ``psi``,
        not wrapped; the other angles lie in (-pi, pi].
    """
    j = joint_positions(robot, side, psi) if joints is None else joints

    def heading(start: int, end: int) -> Array:
        step = j[..., end, :] - j[..., start, :]
        return np.arctan2(step[..., 1], step[..., 0])

    def centre(*corners: int) -> Array:
        return j[..., list(corners), :].mean(axis=-2)

    mirror = 1.0 if side == "fore" else -1.0
    upper, foot = robot.upper_triangle, robot.foot
    th4 = heading(P, B) + mirror * _corner_angle(upper.d, upper.l, upper.alpha)
    th8 = heading(C, E) + math.pi + mirror * _corner_angle(foot.d, foot.l, foot.alpha)
    angles = [heading(P, O), heading(O, A), heading(A, B), th4,
              heading(C, P), heading(C, A), heading(D, E), th8]  # fmt: skip
    centres = [centre(P, O), centre(O, A), centre(A, B), j[..., P, :] + upper.d * direction(th4),
               centre(C, P), centre(C, A), centre(D, E),
               j[..., C, :] - foot.d * direction(th8)]  # fmt: skip
    x = np.empty((*j.shape[:-2], BODIES_PER_LEG, 3))
    x[..., 0] = np.angle(np.exp(1j * np.stack(angles, axis=-1)))
    x[..., 1, 0] = psi
    x[..., 1:] = np.stack(centres, axis=-2)
    return x.reshape(*j.shape[:-2], 3 * BODIES_PER_LEG)


def check_closure(robot: Robot, samples: int = 720) -> None:
    """Raise LinkageError for a design that cannot turn a full revolution: says where."""
    joint_positions(robot, "fore", np.linspace(-math.pi, math.pi, samples, endpoint=False))


def advance_per_turn(robot: Robot, samples: int = 720) -> float:
    """Advance in one counter-clockwise turn of the crank, m; negative: towards -x.

    As if it stood level on its lowest toe: good for the sign and the order of magnitude.
    Raises LinkageError: the linkage does not close.
    """
    psi = np.linspace(0.0, 2.0 * math.pi, samples + 1)[:, None]
    phase = np.array([leg.phase for leg in robot.legs])
    back = np.array([leg.side == "back" for leg in robot.legs])
    angle = psi + phase  # of a back leg as its mirror image's
    toes = joint_positions(robot, "fore", np.where(back, math.pi - angle, angle))[..., T, :]
    toes = np.where(back[:, None], toes * (-1.0, 1.0), toes)
    lowest = np.argmin(toes[1:, :, 1] + toes[:-1, :, 1], axis=1)
    steps = np.diff(toes[..., 0], axis=0)
    return float(-steps[np.arange(samples), lowest].sum())


def world_joints(robot: Robot, q: ArrayLike) -> Array:
    """Joint positions of all legs (..., legs, 8, 2), m, in the order of :data:`JOINTS`.

    Args:
        q: (..., 4) crank axis x, y (m), chassis pitch theta and crank angle psi (rad).
    """
    pose = np.asarray(q, dtype=float)
    joints = np.stack(
        [joint_positions(robot, leg.side, pose[..., 3] + leg.phase) for leg in robot.legs], axis=-3
    )
    cos, sin = np.cos(pose[..., 2, None, None]), np.sin(pose[..., 2, None, None])
    x, y = joints[..., 0], joints[..., 1]
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    return turned + pose[..., None, None, :2]
