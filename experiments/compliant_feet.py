"""What do compliant feet change about a walk and about the forces in the joints?

Run the experiment as follows. It takes about six minutes on one core.

    python experiments/compliant_feet.py [--starts 6] [--quick]

The robot of the paper walks on rigid and on compliant feet under its PID. The script writes
``docs/validation/compliant_feet.json`` and the table of docs/validation/compliant_feet.md.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pages import options, publish, table
from walks import walk

from jansen_env import Compliance, Robot, Terrain, paper_robot
from jansen_env.dynamics.reduced import compile_robot, mass_matrix
from jansen_env.plants.base import StepResult
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.plants.trace import trace_forces
from jansen_env.robot.kinematics import toe_positions

DATA, PAGE = "validation/compliant_feet.json", "validation/compliant_feet.md"
STIFFNESS = (math.inf, 1e5, 5e4, 2e4, 1e4)  # N/m
CRANK_SPEEDS = (1.0, 3.5, 4.0)  # rad/s
DAMPING_RATIO = 0.2
TURNS = 4  # measured turns of the crank, after one turn that is not measured
TIME_STEP = 2.5e-4  # s
LOADED = 8  # time steps of a control step whose joint forces are computed: the most loaded ones


def toe_mass(robot: Robot) -> float:
    """Return the mean effective mass of the lowest toe over a turn of the crank, in kg."""
    tables = compile_robot(robot)
    masses = []
    d = 1e-6
    for psi in np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False):
        before, toes, after = toe_positions(robot, np.array([psi - d, psi, psi + d]))
        low = int(toes[:, 1].argmin())
        rise = (after - before)[low, 1] / (2.0 * d)
        jacobian = np.array([0.0, 1.0, toes[low, 0], rise])
        matrix = mass_matrix(tables, np.array([0.0, 0.0, 0.0, psi]))
        masses.append(1.0 / (jacobian @ np.linalg.solve(matrix, jacobian)))
    return float(np.mean(masses))


def feet(stiffness: float, mass: float) -> Compliance:
    """Return feet of a stiffness in N/m, with :data:`DAMPING_RATIO` for a mass in kg."""
    if math.isinf(stiffness):
        return Compliance()
    return Compliance(stiffness, 2.0 * DAMPING_RATIO * math.sqrt(stiffness * mass))


def slip_and_force(robot: Robot, speed: float, angle: float, turns: int) -> tuple[float, float]:
    """Let a robot walk, and return its slip per distance and the largest force on any pin.

    The force, in N, leaves out the time steps in which a rigid foot lands.

    Args:
        robot: The robot.
        speed: Crank speed, in rad/s.
        angle: Initial crank angle, in rad.
        turns: Number of measured turns of the crank.
    """
    plant = ProjectionPlant(robot, Terrain.flat(), TIME_STEP)
    plant.batch.tracing = True
    largest = 0.0

    def watch(_: StepResult) -> None:
        nonlocal largest
        trace = plant.batch.trace
        trace = trace[~(plant.batch.touchdowns & robot.pad_compliance.rigid)]
        pressed = np.abs(trace["impulses"]).sum(axis=(1, 2))
        loaded = trace[np.argsort(pressed)[-LOADED:]]
        if len(loaded):
            forces = trace_forces(plant.tables, loaded, TIME_STEP).bearing
            largest = max(largest, float(forces.max()))

    turn = 2.0 * math.pi / speed
    found = walk(plant, speed, turns * turn, angle, watch, settle=turn)
    if found.fell:
        raise RuntimeError(f"a robot fell at {speed} rad/s from a crank angle of {angle} rad")
    return found.slip, largest


def measure(
    speeds: Sequence[float], stiffnesses: Sequence[float], starts: int, turns: int
) -> list[dict[str, Any]]:
    """Return the slips and the largest pin forces of all walks, for each speed and stiffness."""
    robot = paper_robot()
    mass = toe_mass(robot)
    rows = []
    for speed in speeds:
        for stiffness in stiffnesses:
            soft = replace(robot, pad_compliance=feet(stiffness, mass))
            angles = np.linspace(0.0, 2.0 * math.pi, starts, endpoint=False).tolist()
            slips, forces = zip(
                *(slip_and_force(soft, speed, angle, turns) for angle in angles), strict=True
            )
            name = "rigid" if math.isinf(stiffness) else f"{stiffness / 1e3:g} kN/m"
            rows.append({"speed": speed, "feet": name, "slip": slips, "force": forces})
    return rows


def tables(rows: list[dict[str, Any]]) -> dict[str, list[str]]:
    """Return the table of the page."""
    head = [
        "feet",
        "crank (rad/s)",
        "least slip (m/m)",
        "most slip (m/m)",
        "least pin force (N)",
        "most pin force (N)",
    ]
    cells = [
        [
            row["feet"],
            f"{row['speed']:g}",
            *(f"{end(row['slip']):.3f}" for end in (min, max)),
            *(f"{end(row['force']):.0f}" for end in (min, max)),
        ]
        for row in rows
    ]
    return {PAGE: [table(head, cells)]}


def main() -> None:
    """Measure, and write the data and the table."""
    args = options(__doc__, starts=6)
    if args.quick:
        rows = measure(CRANK_SPEEDS[-1:], STIFFNESS[:2], starts=2, turns=1)
    else:
        rows = measure(CRANK_SPEEDS, STIFFNESS, args.starts, TURNS)
    publish(args.out, DATA, rows, tables(rows))


if __name__ == "__main__":
    main()
