"""Every interpretation of the paper's torque we found: does any of them give its -0.9 N m?

At a constant crank speed the mechanism is back where it was after a turn, so the motor's work is
what the joints took: mean torque x speed = mean viscous loss, whatever masses and weight are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.paper.fixed_model import (
    Run,
    crank_only,
    fixed_base_projection,
    simulate_pid,
    tables_advance,
)
from jansen_env.paper.toes import turn
from jansen_env.robot import JANSEN, Bar, Leg, Robot, Triangle, holy_numbers_robot, paper_robot
from jansen_env.robot.kinematics import turning

Array = NDArray[np.float64]

PRINTED_LEVEL = -0.9  # N m, "almost constant at around"
NEAR = 0.1  # N m, from it: what counts as near
ANGLES = 360  # crank angles in a turn


@dataclass(frozen=True)
class Level:
    """The torque of one interpretation, N m, over a turn at a constant 1 rad/s (or -1)."""

    name: str
    low: float
    mean: float
    high: float
    loss: float  # W, the joints' mean loss of power, from their rates alone


@dataclass(frozen=True)
class PIDLevel:
    """The torque of one interpretation under the PID (13), after 3 s, N m."""

    name: str
    low: float
    mean: float
    high: float
    near: float  # share of the time within NEAR of the printed level's size


def torque_levels() -> list[Level]:
    """The interpretations, ours first."""
    paper = paper_robot()
    # L4, L10, L5 as printed, where the centroid data gives a triangle 1.0101 times as large.
    small = paper.with_bodies(upper_triangle=Triangle.from_sides(0.23529, 0.32338, 0.25134))
    printed_angle = replace(paper, frame_angle=math.atan2(0.32436, 0.04632))
    return [
        _level("as read here", paper),
        _level("reference turning the other way, r = pi - t", paper, direction=-1.0),
        _level("torque counted positive on the frame", paper, motors=-1),
        _level("tau in the h of one leg a side: two motors", paper, motors=2),
        _level("two motors, positive on the frame", paper, motors=-2),
        _level("tau in the h of every leg: four motors", paper, motors=4),
        _level("four motors, positive on the frame", paper, motors=-4),
        _level("fore legs alone", fore_legs()),
        _level("one leg alone", replace(paper, legs=(Leg("fore"),))),
        *(_level(name, robot) for name, robot in other_lengths().items()),
        _level("triangle 4 from L4, L10, L5", small),
        _level("frame angle as printed, atan(l0/h0)", printed_angle),
        _without_reaction(paper),
        _level("no joint friction", replace(paper, damping=(0.0,) * 10)),
        _level("slender rods and plates", paper.with_slender_inertias()),
        _level("Theo Jansen's own numbers", holy_numbers_robot()),
    ]


def other_lengths() -> dict[str, Robot]:
    """The paper's machine with the lengths that its print leaves open taken the other way."""
    paper = paper_robot()
    return {
        "L6 and L11 swapped": paper.with_bodies(
            rocker=paper.body("coupler"), coupler=paper.body("rocker")
        ),
        "frame of hypot(l0, h0) = 0.32765 m": paper.with_bodies(frame=Bar(0.32765)),
    }


def fore_legs() -> Robot:
    """The two fore legs on a shaft of their own."""
    return replace(paper_robot(), legs=(Leg("fore"), Leg("fore", math.pi)))


def _level(name: str, robot: Robot, direction: float = 1.0, motors: int = 1) -> Level:
    q, q_dot = crank_only(turn(ANGLES)), crank_only(np.full(ANGLES, direction))
    # The dense equations at a constant crank speed.
    forces = joint_forces(robot, q, q_dot, fixed_base=True, q_ddot=np.zeros(q.shape))
    return Level(name, *_range(forces.torque / motors), _mean_loss(robot))


def _range(torque: Array) -> tuple[float, float, float]:
    """Lowest, mean and highest."""
    return float(torque.min()), float(torque.mean()), float(torque.max())


def _mean_loss(robot: Robot) -> float:
    """Mean over a turn at 1 rad/s of the sum of C_ij (theta_i' - theta_j')^2, W."""
    rate = turning(robot, turn(ANGLES), JANSEN.damped)
    return float((rate**2 @ robot.damping).sum(axis=-1).mean())


def _without_reaction(robot: Robot) -> Level:
    """h_f with its last moment row as printed: no C58 (theta_8' - theta_5') on body 8."""
    angle = turn(ANGLES)[::3]
    p = fixed_base_projection(robot, angle, np.ones(len(angle)), 0.0)
    D = p.D[..., 0]
    x_dot, h = (v.reshape(len(angle), -1, 8, 3).copy() for v in (D, p.h))  # by leg and body
    h[..., 7, 0] += robot.damping[6] * (x_dot[..., 7, 0] - x_dot[..., 4, 0])
    torque = p.velocity_terms[:, 0] - (D * h.reshape(D.shape)).sum(axis=-1)
    name = "no C58 term in h_f's last row, as printed"
    return Level(name, *_range(torque), _mean_loss(robot))


def pid_run(robot: Robot, motors: int = 1, direction: float = 1.0) -> Run:
    """The PID's 10 s, with its torque on the shaft ``motors`` times; its torque is one motor's."""
    advance = tables_advance(robot)
    return simulate_pid(lambda angle, speed, tau: advance(angle, speed, motors * tau), direction)


def pid_levels() -> list[PIDLevel]:
    """Ours, those with the means nearest to the printed level's size, and ours backwards."""
    paper = paper_robot()
    return [
        _pid_level("as read here", pid_run(paper)),
        _pid_level("two motors, one a side", pid_run(paper, motors=2)),
        _pid_level("fore legs alone", pid_run(fore_legs())),
        _pid_level("turning the other way", pid_run(paper, direction=-1.0)),
    ]


def _pid_level(name: str, run: Run) -> PIDLevel:
    torque = run.torque[run.settled]
    near = float((np.abs(torque - abs(PRINTED_LEVEL)) <= NEAR).mean())
    return PIDLevel(name, *_range(torque), near)
