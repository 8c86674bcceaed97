"""Errata of the paper in numbers; all of them are in ``docs/paper.md``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.projection import DOF, leg_motion, leg_sides, masses, system_coordinates
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.paper.fixed_model import crank_only
from jansen_env.paper.toes import turn
from jansen_env.robot import JANSEN, Link, paper_robot

Array = NDArray[np.float64]

ANGLES = 720  # crank angles in a turn
VISCOUS = 0.1  # N m s/rad, Table 1's, for pairs that are not listed, too
FRAME_PAIRS = ((1, 4), (1, 5))
"""The frame's pairs at P, where bodies 1, 4 and 5 meet; the paper lists (4, 5) alone there."""


@dataclass(frozen=True)
class Erratum:
    """Effect of an erratum."""

    name: str
    found: str
    numbers: dict[str, float]  # behind `found`, SI units


def errata() -> list[Erratum]:
    """Those that have a number."""
    return [inertia_of_links(), inertia_at_crank(), dropped_velocity_terms(), frame_pairs()]


def farthest_pin(body: Link) -> float:
    """From a link's centre of mass to its farthest pin (the foot's: the toe), m."""
    return max(abs(reach) for reach, _ in body.corners)


def inertia_of_links() -> Erratum:
    """Table 1's inertias against m r^2, r the distance from the centre of mass to the farthest pin.

    No mass within the outline that the pins span is farther away than r: m r^2 bounds the inertia.
    """
    bodies = paper_robot().bodies
    gyration = max((body.inertia / body.mass) ** 0.5 for body in bodies)
    excess = [body.inertia / (body.mass * farthest_pin(body) ** 2) for body in bodies]
    low, high, names = min(excess), max(excess), JANSEN.names
    return Erratum(
        "Table 1's inertia",
        f"a radius of gyration of {gyration:.0f} m; {low:.0f} ({names[excess.index(low)]}) to "
        f"{high:.0f} ({names[excess.index(high)]}) times m r^2, r from a link's centre of mass to "
        "its farthest pin",
        {"gyration": gyration, "low": low, "high": high},
    )


def inertia_at_crank() -> Erratum:
    """The inertia k of the whole machine at its crank, with Table 1's and with slender links."""
    paper = paper_robot()
    heavy, slender = (
        body_sums(compile_robot(robot), turn(ANGLES)).k
        for robot in (paper, paper.with_slender_inertias())
    )
    return Erratum(
        "inertia k at the crank",
        f"{heavy.min():.2f} to {heavy.max():.2f} kg m^2 with Table 1's, {slender.min():.3f} to "
        f"{slender.max():.3f} with slender links'",
        {"low": float(heavy.min()), "high": float(heavy.max()),
         "slender_low": float(slender.min()), "slender_high": float(slender.max())},
    )  # fmt: skip


def dropped_velocity_terms() -> Erratum:
    """The crank's part of D^T M D_dot q_dot in (7)-(10), which (11) leaves out, at 1 rad/s.

    With a fixed base the system's own D of (12) is constant: no other velocity terms are left.
    """
    _, D, bias = _turning()
    most = float(np.abs((D[..., 3] * masses(paper_robot()) * bias).sum(axis=(-1, -2))).max())
    return Erratum(
        "D^T M D_dot q_dot of (7)-(10), not in (11)",
        f"up to {most:.3f} N m at 1 rad/s, {16.0 * most:.2f} at 4: as the speed squared",
        {"most": most},
    )


def frame_pairs() -> Erratum:
    """Mean torque at 1 rad/s with the frame's pairs at P added to the list of friction pairs."""
    rate = _turning()[0][..., 0::3]

    def loss(*pairs: tuple[int, int]) -> float:
        first, second = np.array([*JANSEN.damped, *pairs]).T - 1
        power = VISCOUS * (rate[..., first] - rate[..., second]) ** 2
        return float(power.sum(axis=(-1, -2)).mean())

    listed, four, five, both = loss(), *(loss(pair) for pair in FRAME_PAIRS), loss(*FRAME_PAIRS)
    return Erratum(
        "no pair of the frame at P in h_f",
        f"mean torque at 1 rad/s {listed:.3f} N m as listed, {four:.3f} with (1, 4), {five:.3f} "
        f"with (1, 5), {both:.3f} with both: {100.0 * (four / listed - 1.0):.1f} to "
        f"{100.0 * (both / listed - 1.0):.1f} % more",
        {"listed": listed, "four": four, "five": five, "both": both},
    )


def _turning() -> tuple[Array, Array, Array]:
    """x_dot, D and D_dot q_dot of all legs over a turn at 1 rad/s on a fixed base."""
    robot = paper_robot()
    x = system_coordinates(robot, crank_only(turn(ANGLES)))
    speeds = np.zeros((*x.shape[:-1], DOF))
    speeds[..., 3] = 1.0
    return leg_motion(robot, leg_sides(robot), x, speeds)
