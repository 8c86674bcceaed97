"""Errata of the paper in numbers; all of them are in ``docs/paper.md``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jansen_env.dynamics.projection import leg_motion, leg_sides, masses, system_coordinates
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.paper.fixed_model import crank_only
from jansen_env.paper.interpretations import mean_loss
from jansen_env.paper.toes import turn
from jansen_env.robot import JANSEN, paper_robot

ANGLES = 720  # crank angles in a turn


@dataclass(frozen=True)
class Erratum:
    """Effect of an erratum."""

    name: str
    effect: str


def errata() -> list[Erratum]:
    """Those that have a number."""
    return [inertia_of_links(), inertia_at_crank(), dropped_velocity_terms(), frame_pairs()]


def inertia_of_links() -> Erratum:
    """Table 1's inertias against m r^2, r the distance from the centre of mass to the farthest pin.

    No mass within the outline that the pins span is farther away than r: m r^2 bounds the inertia.
    """
    bodies = paper_robot().bodies
    gyration = max((body.inertia / body.mass) ** 0.5 for body in bodies)
    farthest = [max(abs(reach) for reach, _ in body.corners) for body in bodies]
    excess = [b.inertia / (b.mass * r**2) for b, r in zip(bodies, farthest, strict=True)]
    low, high, names = min(excess), max(excess), JANSEN.names
    return Erratum(
        "Table 1's inertia",
        f"a radius of gyration of {gyration:.0f} m; {low:.0f} ({names[excess.index(low)]}) to "
        f"{high:.0f} ({names[excess.index(high)]}) times m r^2, r from a link's centre of mass to "
        "its farthest pin",
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
    )


def dropped_velocity_terms() -> Erratum:
    """The crank's part of D^T M D_dot q_dot in (7)-(10), which (11) leaves out, at 1 rad/s.

    With a fixed base the system's own D of (12) is constant: no other velocity terms are left.
    """
    robot = paper_robot()
    x = system_coordinates(robot, crank_only(turn(ANGLES)))
    speeds = np.broadcast_to(crank_only(1.0), (*x.shape[:-1], 4))
    _, D, bias = leg_motion(robot, leg_sides(robot), x, speeds)
    most = float(np.abs((D[..., 3] * masses(robot) * bias).sum(axis=(-1, -2))).max())
    return Erratum(
        "D^T M D_dot q_dot of (7)-(10), not in (11)",
        f"up to {most:.3f} N m at 1 rad/s, {16.0 * most:.2f} at 4: as the speed squared",
    )


def frame_pairs() -> Erratum:
    """Mean torque at 1 rad/s with the frame's pairs at P added to the list of friction pairs.

    Bodies 1, 4 and 5 meet at P; the paper lists (4, 5) alone there.
    """
    added = ((), ((1, 4),), ((1, 5),), ((1, 4), (1, 5)))
    listed, four, five, both = (mean_loss(paper_robot(), *pairs) for pairs in added)
    return Erratum(
        "no pair of the frame at P in h_f",
        f"mean torque at 1 rad/s {listed:.3f} N m as listed, {four:.3f} with (1, 4), {five:.3f} "
        f"with (1, 5), {both:.3f} with both: {100.0 * (four / listed - 1.0):.1f} to "
        f"{100.0 * (both / listed - 1.0):.1f} % more",
    )
