"""Do the two simulation backends agree on how robots walk?

Run the experiment as follows. A walk takes about 15 s on one core, nearly all of it in the
rigid-body backend, so all walks take ten minutes. Walks that the data file contains are not
repeated; delete the file to begin again.

    python experiments/plants.py [--count WALKS] [--quick]

Robots walk under the paper's PID in both backends: the paper's robot at many crank speeds, on
slopes and with payloads; robots with other feet, bearings and motors; and the other linkages. The
script writes ``docs/validation/plants.json`` and the tables of docs/validation/plants.md.
"""

import json
import math
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product, zip_longest
from typing import Any

import numpy as np
from pages import options, publish, table
from walks import Walked, walk

from jansen_env import ROBOTS, Compliance, Motor, Payload, Robot, Terrain, paper_robot
from jansen_env.files import write_json
from jansen_env.plants.plant import PLANTS, Plant, ProjectionPlant, RigidBodyPlant
from jansen_env.robot import JANSEN
from jansen_env.robot.zoo import ZOO

DATA, PAGE = "validation/plants.json", "validation/plants.md"
SETTLE, DURATION = 1.0, 2.0  # time of a walk before the measurement, and measured time, in s
ALLOWED = 0.05  # relative difference of distance and cost of transport up to which walks agree
SAME_STARTS = (0.0, 2.5e-4, 5e-4, 7.5e-4, 1e-3)  # crank angles of nearly the same start, in rad
OTHER_STARTS = tuple(
    math.pi * k / 12.0 for k in range(12)
)  # in rad; after half a turn, everything repeats
VERDICTS = "agree", "other gait", "differ", "chaotic", "falls at times", "falls in both"
PADS = Compliance(5e4, 60.0, 3e4, 40.0)
SLENDER = paper_robot().with_slender_inertias()
ROTOR = Motor(gear_ratio=70.0, rotor_inertia=1.4e-5)  # 0.07 kg m^2 at the crank
TORQUE_LINE = Motor(stall_torque=20.0, no_load_speed=8.0, torque_limit=12.0, friction=0.3)
MACHINES: dict[str, Callable[[], Robot]] = {
    "compliant feet": lambda: replace(paper_robot(), pad_compliance=PADS),
    "dry bearings": lambda: replace(paper_robot(), bearing_friction=(0.03,) * len(JANSEN.bearings)),
    "rotor": lambda: replace(SLENDER, motor=ROTOR),
    "torque-speed line": lambda: replace(SLENDER, motor=TORQUE_LINE, pad_compliance=PADS),
    "built": ROBOTS["built"],
    "economy": ROBOTS["economy"],
    "stroller": ROBOTS["stroller"],
}


@dataclass(frozen=True)
class Walk:
    """A walk at a crank speed.

    Attributes:
        robot: Name of the robot, a key of :data:`MACHINES` or ``ROBOTS``.
        speed: Crank speed, in rad/s.
        friction: Friction coefficient of the ground.
        slope: Slope of the ground, in rad.
        payload: Mass of the payload, in kg.
    """

    robot: str
    speed: float
    friction: float = 0.8
    slope: float = 0.0
    payload: float = 0.0

    @property
    def label(self) -> str:
        """Name of the walk in tables."""
        words = [self.robot, f"{self.speed:g} rad/s", f"friction {self.friction:g}"]
        words += [f"slope {self.slope:+g}"] if self.slope else []
        words += [f"{self.payload:g} kg"] if self.payload else []
        return ", ".join(words)

    def run(self, backend: str, start: float = 0.0, halved: bool = False) -> Walked:
        """Let the robot walk.

        Args:
            backend: Name of the simulation backend.
            start: Initial crank angle, in rad.
            halved: Whether to halve the default time step of the backend.
        """
        make = {"projection": ProjectionPlant, "rigid_body": RigidBodyPlant}[backend]
        robot = {**ROBOTS, **MACHINES}[self.robot]()
        if self.payload:
            robot = replace(robot, payload=Payload(self.payload))
        ground = Terrain.slope(self.slope, friction=self.friction)
        plant: Plant = make(robot, ground, PLANTS[backend] / (2.0 if halved else 1.0))
        return walk(plant, self.speed, DURATION, start, settle=SETTLE)


PAPER = [
    *(Walk("paper", v, mu) for mu, v in product((0.1, 0.3, 0.8), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))),
    *(Walk("paper", v, 0.6) for v in (0.5, 8.0)),
    *(Walk("paper", 4.0, slope=slope) for slope in (-0.05, 0.05)),
    *(Walk("paper", 4.0, payload=payload) for payload in (1.0, 5.0)),
]
MACHINE_WALKS = [Walk(name, speed) for speed, name in product((2.0, 4.0), MACHINES)]
LINKAGE_WALKS = [
    *(Walk("klann", v, mu) for mu, v in product((0.2, 0.5, 0.8), (2.0, 4.0, 5.0))),
    *(Walk(name, v, mu) for name, mu, v in product([*ZOO][1:], (0.2, 0.8), (2.0, 4.0))),
]
WALKS = [
    case
    for together in zip_longest(PAPER, MACHINE_WALKS, LINKAGE_WALKS)
    for case in together
    if case is not None
]
"""All walks, in an order in which the first ones are of all kinds."""


def compare(case: Walk) -> dict[str, Any]:
    """Run a walk in both backends.

    Returns:
        Distance, cost of transport and fall of the walks from nearly the same start in the
        projection backend ("same", the last one with half the time step), from other crank angles
        there ("other"), and in the rigid-body backend ("rigid").
    """
    same = [case.run("projection", start) for start in SAME_STARTS]
    same.append(case.run("projection", halved=True))
    other = [case.run("projection", start) for start in OTHER_STARTS]
    rigid = case.run("rigid_body")
    return {
        "walk": case.label,
        "robot": case.robot,
        "same": [numbers(found) for found in same],
        "other": [numbers(found) for found in other],
        "rigid": numbers(rigid),
    }


def numbers(found: Walked) -> list[float]:
    """Return distance, cost of transport, and whether the robot fell (1 or 0)."""
    return [round(found.distance, 5), round(found.cost_of_transport, 5), float(found.fell)]


def spread(case: dict[str, Any]) -> float:
    """Return the spread of the distances from nearly the same start, relative to their median."""
    distances = np.array(case["same"])[:, 0]
    return float(np.ptp(distances) / max(abs(np.median(distances)), 1e-9))


def verdict(case: dict[str, Any]) -> str:
    """Return how the backends compare on a walk; docs/validation/plants.md defines the words."""
    same = np.array(case["same"])
    rigid = np.array(case["rigid"])
    falls = [*same[:, 2], rigid[2]]
    if all(falls):
        return "falls in both"
    if any(falls):
        return "falls at times"
    if spread(case) > ALLOWED:
        return "chaotic"
    if is_like(rigid, np.median(same, axis=0)):
        return "agree"
    upright = [found for found in (*case["same"], *case["other"]) if not found[2]]
    return "other gait" if any(is_like(rigid, np.array(found)) for found in upright) else "differ"


def is_like(one: Any, other: Any) -> bool:
    """Return whether distance and cost of two walks are within :data:`ALLOWED`."""
    return bool(np.abs(one[:2] / other[:2] - 1.0).max() <= ALLOWED)


def walk_row(case: dict[str, Any]) -> list[str]:
    """Return the cells of a walk in the table of all walks."""
    distance, cost, _ = np.median(case["same"], axis=0)
    fell = any(found[2] for found in case["same"])
    return [
        case["walk"],
        f"{distance:.3g}",
        f"{case['rigid'][0]:.3g}",
        f"{cost:.3g}",
        f"{case['rigid'][1]:.3g}",
        "falls" if fell else f"{100 * spread(case):.1f}",
        verdict(case),
    ]


def tables(results: list[dict[str, Any]]) -> dict[str, list[str]]:
    """Return the tables of the page: verdicts by robot, then all walks."""
    found = {case["walk"]: case for case in results}
    cases = [
        found[case.label]
        for case in (*PAPER, *MACHINE_WALKS, *LINKAGE_WALKS)
        if case.label in found
    ]
    counts = []
    for robot in dict.fromkeys(case["robot"] for case in cases):
        count = Counter(verdict(case) for case in cases if case["robot"] == robot)
        counts.append([robot, str(count.total()), *(str(count[word]) for word in VERDICTS)])
    head = [
        "walk",
        "distance (m)",
        "rigid bodies",
        "cost of transport",
        "rigid bodies",
        "spread (%)",
        "verdict",
    ]
    return {
        PAGE: [
            table(["robot", "walks", *VERDICTS], counts),
            table(head, map(walk_row, cases)),
        ]
    }


def main() -> None:
    """Compare the walks that are missing in the data, and write the data and the tables."""
    args = options(__doc__, count=len(WALKS))
    path = args.out / DATA
    path.parent.mkdir(parents=True, exist_ok=True)
    results = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    done = {case["walk"] for case in results}
    missing = [case for case in WALKS if case.label not in done]
    for case in missing[: 1 if args.quick else args.count]:
        results.append(compare(case))
        print(case.label, verdict(results[-1]), file=sys.stderr, flush=True)
        write_json(path, results)
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
