"""Do three simulators agree on how much a spring lowers the torque of the crank?

Run the experiment as follows. It takes about three minutes on one core.

    python experiments/spring_witness.py [--quick]

The robot ``stroller`` walks with and without the spring of docs/springs/stroller_rms.json, under
the PID of the benchmark, in both simulation backends of this package and in MuJoCo. In the fast
projection backend, it also walks from more initial crank angles. The script writes
``docs/springs/witness.json`` and two tables of docs/springs.md.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from mujoco_backend import MujocoPlant
from pages import DOCS, options, publish, table
from springs import STARTS as MANY_STARTS
from walks import walk

from jansen_env import ROBOTS, Robot, Terrain
from jansen_env.plants.plant import Plant, ProjectionPlant, RigidBodyPlant
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.robot_file import read_robot
from jansen_env.tasks.walking.tuned import gains_of

DATA, PAGE = "springs/witness.json", "springs.md"
SPEED = 0.3  # m/s
FRICTION = 0.8  # friction coefficient of the ground
STARTS = (0.0, 1.0)  # initial crank angles, in rad
MANY = f"projection, {len(MANY_STARTS)} walks"  # name of the walks from more initial crank angles
METRICS = {"speed": 3, "slip": 3, "rms_torque": 2, "peak_torque": 2, "cost_of_transport": 3}
"""Metrics, and the number of decimals in the table."""
CHANGED = ("rms_torque", "peak_torque", "cost_of_transport")
"""Metrics of which the table lists the change due to the spring."""
BARE, SPRUNG = "no spring", "RMS torque"
SIMULATIONS: dict[str, Callable[[Robot, Terrain], Plant]] = {
    "projection": ProjectionPlant,
    "rigid bodies": RigidBodyPlant,
    "MuJoCo": MujocoPlant,
    MANY: ProjectionPlant,
}


def measure(plant: Plant, starts: tuple[float, ...], duration: float) -> list[dict[str, float]]:
    """Return the metrics of a walk from each initial crank angle.

    Args:
        plant: Robot on level ground.
        starts: Initial crank angles, in rad.
        duration: Duration that is measured, in s.
    """
    robot = plant.robot
    crank_speed = 2.0 * math.pi * SPEED / advance_per_turn(robot)
    walks = [walk(plant, crank_speed, duration, start, pid=gains_of(robot)) for start in starts]
    return [{name: round(float(getattr(found, name)), 5) for name in METRICS} for found in walks]


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: the walks, and the changes due to the spring."""
    walks = results["walks"]
    rows = [
        [simulation, spring, *(spread(by[spring], name) for name in METRICS)]
        for simulation, by in walks.items()
        for spring in (BARE, SPRUNG)
    ]
    changes = [[name, *(changed(by, metric) for metric in CHANGED)] for name, by in walks.items()]
    heads = ["speed (m/s)", "slip (m/m)", "RMS torque (N m)", "peak torque (N m)"]
    reductions = ["RMS torque lower by (%)", "peak torque (%)", "cost of transport (%)"]
    return {
        PAGE: [
            table(["simulation", "spring for", *heads, "cost of transport"], rows, texts=2),
            table(["simulation", *reductions], changes),
        ]
    }


def spread(walks: list[dict[str, float]], metric: str) -> str:
    """Return the mean of a metric over the walks, and its smallest and largest value, as text."""
    values = [found[metric] for found in walks]
    mean, least, most = (
        f"{value:.{METRICS[metric]}f}" for value in (np.mean(values), min(values), max(values))
    )
    return f"{mean} ({least} to {most})"


def changed(by_spring: dict[str, list[dict[str, float]]], metric: str) -> str:
    """Return by how many per cent the spring lowers the mean of a metric, as text."""
    bare, sprung = (
        np.mean([found[metric] for found in by_spring[spring]]) for spring in (BARE, SPRUNG)
    )
    return f"{100.0 * (1.0 - sprung / bare):.1f}"


def main() -> None:
    """Measure, and write the data and the tables."""
    args = options(__doc__)
    starts: dict[str, tuple[float, ...]] = dict.fromkeys(SIMULATIONS, STARTS) | {MANY: MANY_STARTS}
    duration = 4.0
    if args.quick:
        starts, duration = dict.fromkeys(SIMULATIONS, STARTS[:1]), 0.5
    robots = {
        BARE: ROBOTS["stroller"](),
        SPRUNG: read_robot(DOCS / "springs" / "stroller_rms.json"),
    }
    walks: dict[str, dict[str, list[dict[str, float]]]] = {}
    for simulation, make in SIMULATIONS.items():
        walks[simulation] = {}
        for spring, robot in robots.items():
            plant = make(robot, Terrain.flat(friction=FRICTION))
            walks[simulation][spring] = measure(plant, starts[simulation], duration)
            print(simulation, spring, walks[simulation][spring], flush=True)
    results = {"starts": starts, "duration": duration, "walks": walks}
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
