"""Effects of compliant feet: pin forces at touchdown, and slip, of the paper's robot.

    python -m benchmarks.compliant_feet [--starts 10] [--out docs/validation] [--quick]

Writes ``compliant_feet.md``.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchmarks import measure, walks
from benchmarks.measure import table
from jansen_env import Robot, Terrain
from jansen_env.dynamics.reduced import compile_robot, mass_matrix
from jansen_env.gravity import GRAVITY
from jansen_env.plants.base import StepResult
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.trace import trace_forces
from jansen_env.robot import Compliance
from jansen_env.robot.kinematics import T, world_joints

STIFFNESS: tuple[float, ...] = (math.inf, 1e5, 5e4, 2e4, 1e4)  # N/m
SPEEDS: tuple[float, ...] = (1.0, 3.5, 4.0)  # of the crank, rad/s
DAMPING_RATIO = 0.2
TURNS, SETTLE = 4, 1
STARTS = 10
TIME_STEP = 2.5e-4  # s
LOADED = 8  # time steps of a control step whose forces are computed: those with most contact force


class Walk(NamedTuple):
    """A walk under the PID."""

    distance: float  # m a turn of the crank
    slip: float  # m a turn
    force: float  # N, the largest on any link's joint; on rigid feet without touchdowns
    fell: bool


def toe_mass(robot: Robot) -> float:
    """Effective mass of the lowest toe at a touchdown, kg: 1 / W_nn, the mean over a level turn."""
    tables, masses, d = compile_robot(robot), [], 1e-6
    for psi in np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False):
        before, toes, after = (
            world_joints(robot, np.array([0.0, 0.0, 0.0, psi + e]))[:, T] for e in (-d, 0.0, d)
        )
        low = int(toes[:, 1].argmin())
        J = np.array([0.0, 1.0, toes[low, 0], (after - before)[low, 1] / (2.0 * d)])
        M = mass_matrix(tables, np.array([0.0, 0.0, 0.0, psi]))
        masses.append(1.0 / (J @ np.linalg.solve(M, J)))
    return float(np.mean(masses))


def pads(robot: Robot, stiffness: float, ratio: float = DAMPING_RATIO) -> Compliance:
    """Pads of a stiffness (N/m) and a damping ratio against :func:`toe_mass`; inf: rigid ones."""
    if stiffness == math.inf:
        return Compliance()
    return Compliance(stiffness, 2.0 * ratio * math.sqrt(stiffness * toe_mass(robot)))


def walk(
    robot: Robot, speed: float, turns: int, time_step: float = TIME_STEP, angle: float = 0.0
) -> Walk:
    """Turns at a crank speed (rad/s) from a crank angle (rad), after one that does not count."""
    plant = ProjectionPlant(robot, Terrain.flat(), time_step)
    plant.tracing = True
    force, turn = 0.0, 2.0 * math.pi / speed

    def watch(_: StepResult) -> None:
        nonlocal force
        rows = plant.trace[~(plant.touchdowns & robot.pad_compliance.rigid)]
        pressed = np.abs(rows["impulses"]).sum(axis=(1, 2))
        rows = rows[np.argsort(pressed)[-LOADED:]]
        if len(rows):
            sizes = trace_forces(plant.tables, rows, time_step).bearing
            force = max(force, float(sizes.max()))

    limit = robot.motor.torque_limit
    found = walks.walk(plant, speed, turns * turn, SETTLE * turn, angle, limit, limit, watch)
    return Walk(found.distance / turns, found.slip * abs(found.distance) / turns, force, found.fell)


def cells(found: list[Walk], weight: float) -> tuple[str, ...]:
    """Return the table's columns after the feet: falls, and ranges of the walks without one."""
    up = [one for one in found if not one.fell]

    def span(values: list[float], form: str) -> str:
        ends = [format(end, form) for end in (min(values), max(values))]
        return " to ".join(dict.fromkeys(ends))  # once, where both are alike

    ranges = (
        span([one.distance for one in up], ".2f"),
        span([one.slip for one in up], ".3f"),
        span([one.slip / one.distance for one in up], ".3f"),
        span([one.force for one in up], ".0f"),
        span([one.force / weight for one in up], ".1f"),
    ) if up else ("",) * 5  # fmt: skip
    return f"{len(found) - len(up)} of {len(found)}", *ranges


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    found = measure.chosen(measure.options(__doc__, "docs/validation", starts=STARTS), arguments)
    speeds, stiffness, turns, starts = SPEEDS, STIFFNESS, TURNS, found.starts
    if found.quick:
        speeds, stiffness, turns, starts = SPEEDS[-1:], STIFFNESS[:2], 1, 2
    angles = np.linspace(0.0, 2.0 * math.pi, starts, endpoint=False).tolist()
    robot, rows = Robot(), []
    weight = robot.mass * GRAVITY
    for speed in speeds:
        for k in stiffness:
            feet = replace(robot, pad_compliance=pads(robot, k))
            found_at = [walk(feet, speed, turns, angle=angle) for angle in angles]
            name = "rigid" if k == math.inf else f"{k / 1e3:g} kN/m"
            rows.append((f"{speed:g}", name, *cells(found_at, weight)))
    head = ("crank (rad/s)", "feet", "falls", "distance (m/turn)", "slip (m/turn)", "slip (m/m)",
            "largest pin force (N)", "of the weight")  # fmt: skip
    measure.report(
        found.out / "compliant_feet.md",
        "# Compliant feet",
        f"`python -m benchmarks.compliant_feet --starts {starts}`. The paper's robot, {turns} "
        f"turns under its PID on level ground of friction 0.8, time step {1e3 * TIME_STEP:g} ms. "
        f"Ranges are those of {starts} starts at crank angles spread evenly over a turn. Damping "
        f"ratio {DAMPING_RATIO:g} against the {toe_mass(robot):.2f} kg that a toe feels like; the "
        "same along the ground. On rigid feet the force leaves touchdowns out: these have none.",
        table(head, rows),
    )


if __name__ == "__main__":
    main()
