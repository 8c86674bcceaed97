"""How do the time step and compliant feet affect the accuracy of walks?

Run the experiment as follows. It takes about one minute on one core.

    python experiments/convergence.py [--starts 48] [--quick]

Robots walk from many starts with seven time steps. Each walk is compared with the walk with the
finest time step: the position after one second, and the means of the whole walk, because individual
walks are chaotic later. The script writes ``docs/performance/convergence.json`` and the table of
docs/performance/convergence.md.
"""

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pages import options, publish, table

from jansen_env import ROBOTS, Robot, Terrain
from jansen_env.plants.plant import ProjectionPlant

DATA, PAGE = "performance/convergence.json", "performance/convergence.md"
TIME_STEPS = (1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3)  # s
FINEST = 1e-3 / 32.0  # s
DEFAULT = 1e-3  # time step of the environments, in s
GROUNDS: dict[str, tuple[Callable[[], Robot], float]] = {
    "`paper`, rigid feet, friction 0.3": (ROBOTS["paper"], 0.3),
    "`paper`, rigid feet, friction 0.8": (ROBOTS["paper"], 0.8),
    "`built`, compliant feet, friction 0.8": (ROBOTS["built"], 0.8),
}
"""Robots and friction coefficients."""
CRANK_SPEED = 2.7  # rad/s
GAIN, BIAS = 10.0, 4.0  # gains for the paper's robot, in N m s/rad and N m
CONTROL_DT = 0.02  # time for which a torque is held, in s
DURATION, EARLY = 4.0, 1.0  # duration of a walk, and time after which positions are compared, in s
MEANS = ("distance", "slip", "work")


def walk(robot: Robot, friction: float, time_step: float, angle: float) -> dict[str, float]:
    """Let a robot walk at about :data:`CRANK_SPEED`.

    Args:
        robot: The robot.
        friction: Friction coefficient of the level ground.
        time_step: Time step, in s.
        angle: Initial crank angle, in rad.

    Returns:
        Position after :data:`EARLY` ("early", in m), distance (m), slip (m), work (J), deepest
        penetration of a toe into the ground (m).
    """
    plant = ProjectionPlant(robot, Terrain.flat(friction=friction), time_step)
    plant.reset(crank_angle=angle)
    strength = min(1.0, robot.motor.torque_limit / ROBOTS["paper"]().motor.torque_limit)
    found = {"early": math.nan, "slip": 0.0, "work": 0.0, "depth": -math.inf}
    for k in range(1, round(DURATION / CONTROL_DT) + 1):
        torque = strength * (BIAS + GAIN * (CRANK_SPEED - float(plant.state[7])))
        result = plant.step(torque, CONTROL_DT)
        found["slip"] += float(result.slip.sum())
        found["work"] += result.motor_work
        lowest = float(plant.toe_positions()[:, 1].min())
        found["depth"] = max(found["depth"], robot.pad_radius - lowest)
        if k == round(EARLY / CONTROL_DT):
            found["early"] = plant.x
    return {**found, "distance": plant.x}


def measure(names: Sequence[str], steps: Sequence[float], starts: int) -> dict[str, Any]:
    """Return the values of all walks, by robot, time step in s, and name of the value."""
    results: dict[str, Any] = {}
    for name in names:
        make, friction = GROUNDS[name]
        robot = make()
        results[name] = {}
        for step in (FINEST, *steps):
            angles = np.pi * np.arange(starts) / starts
            walks = [walk(robot, friction, step, angle) for angle in angles]
            results[name][f"{step:g}"] = {key: [w[key] for w in walks] for key in walks[0]}
            print(name, step, file=sys.stderr, flush=True)
    return results


def changes(values: dict[str, Any], exact: dict[str, Any]) -> list[str]:
    """Return the change of each mean against the finest time step, with its standard error."""
    cells = []
    for name in MEANS:
        change = 100.0 * np.subtract(values[name], exact[name]) / np.mean(exact[name])
        error = change.std(ddof=1) / math.sqrt(len(change))
        cells.append(f"{change.mean():+.1f} ± {error:.1f}")
    return cells


def two_digits(value: float) -> str:
    """Return a number with two significant digits, written without an exponent."""
    return np.format_float_positional(value, 2, unique=False, fractional=False, trim="-")


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page."""
    head = [
        "robot",
        "time step (ms)",
        "error after 1 s (mm)",
        "90th percentile (mm)",
        "distance (%)",
        "slip (%)",
        "work (%)",
        "penetration (mm)",
    ]
    rows = []
    for name, by_step in results.items():
        exact = by_step[f"{FINEST:g}"]
        for step, values in by_step.items():
            if step == f"{FINEST:g}":
                continue
            error = 1e3 * np.abs(np.subtract(values["early"], exact["early"]))
            row = [name, f"{1e3 * float(step):g}"]
            row += [two_digits(np.median(error)), two_digits(np.quantile(error, 0.9))]
            row += changes(values, exact)
            row.append(f"{1e3 * max(values['depth']):.2f}")
            rows.append(row)
    return {PAGE: [table(head, rows)]}


def main() -> None:
    """Measure, and write the data and the table."""
    args = options(__doc__, starts=48)
    if args.quick:
        results = measure([*GROUNDS][-1:], (DEFAULT,), 2)
    else:
        results = measure([*GROUNDS], TIME_STEPS, args.starts)
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
