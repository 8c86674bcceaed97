"""Do the two plants agree?

    python -m benchmarks.plants [--machines | --linkages] [--out logs/plants] [--jobs 2] [--quick]

Both plants side by side, with the time step halved on both: walks at many crank speeds and
frictions, on slopes, with loads (``plants.md``); with ``--machines`` walks with compliant feet, dry
bearings, a rotor, a motor's line, and of the built robot (``machines.md``); with ``--linkages``
walks of the other linkages (``linkages.md``).
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from benchmarks import measure
from benchmarks.measure import table
from benchmarks.walks import Walked, walk
from jansen_env import ROBOTS, Compliance, Motor, Terrain, paper_robot
from jansen_env.plants.plant import PLANTS, Plant, make_plant
from jansen_env.robot import JANSEN, Payload
from jansen_env.robot.zoo import ZOO

SPEEDS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)  # of the crank, rad/s
FRICTIONS = (0.1, 0.3, 0.6, 1.0)
SLOPES, PAYLOADS, HARDER = (-0.15, -0.05, 0.05, 0.15), (1.0, 5.0), 4.0  # rad; kg; at so many rad/s
STARTS = (0.0, 2.5e-4, 5e-4, 7.5e-4, 1e-3)  # rad, crank angles of an ensemble
SLENDER = paper_robot().with_slender_inertias()
FEET = Compliance(5e4, 60.0, 3e4, 40.0)
ROTOR = Motor(gear_ratio=70.0, rotor_inertia=1.4e-5)  # 0.07 kg m^2 at the crank
LINE = Motor(stall_torque=20.0, no_load_speed=8.0, torque_limit=12.0, friction=0.3)
MACHINES = {
    "paper": paper_robot(),
    "built": ROBOTS["built"](),
    "motor's line": replace(SLENDER, motor=LINE, pad_compliance=FEET),
    "rotor": replace(SLENDER, motor=ROTOR),
    "dry bearings": replace(paper_robot(), bearing_friction=(0.03,) * len(JANSEN.bearings)),
    "feet that give": replace(paper_robot(), pad_compliance=FEET),
}
LINKAGE_SPEEDS, LINKAGE_FRICTIONS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0), (0.2, 0.5, 0.8)
MACHINE_SPEEDS = (1.0, 4.0)  # of the crank, rad/s
SHORT = 3.0  # s, walks of other machines and linkages
OTHER_STARTS = tuple(math.pi * k / 12.0 for k in range(12))  # rad; half a turn on, all is the same
ALLOWED = 0.05  # difference in distance and cost of transport up to which the plants agree
HOW_COMPARED = (
    "Projection plant: the median of six runs, which start within 1 mrad of one another or have "
    "half the time step; spread: of their distances. Rigid-body plant: at half its time step. "
    f"Agree: distance and cost of transport within {100 * ALLOWED:.0f} %."
)


@dataclass(frozen=True)
class Walk:
    """The crank held at a speed (rad/s) by the paper's PID; slope in rad, payload in kg."""

    speed: float
    friction: float = 0.8
    slope: float = 0.0
    payload: float = 0.0
    machine: str = "paper"
    duration: float = 6.0

    @property
    def label(self) -> str:
        words = [f"{self.speed:g} rad/s, friction {self.friction:g}"]
        words += [f"slope {self.slope:+g}"] if self.slope else []
        words += [f"{self.payload:g} kg"] if self.payload else []
        words = [self.machine, *words] if self.machine != "paper" else words
        return ", ".join(words)

    def plant(self, name: str, halvings: int = 0) -> Plant:
        """Return a plant by name, its own time step halved so many times."""
        robot = ZOO[self.machine]() if self.machine in ZOO else MACHINES[self.machine]
        robot = replace(robot, payload=Payload(self.payload))
        terrain = Terrain.slope(self.slope, friction=self.friction)
        return make_plant(name, robot, terrain, PLANTS[name] / 2**halvings)

    def run(self, plant: Plant, start: float = 0.0) -> Walked:
        return walk(plant, self.speed, self.duration, start=start)


class Comparison(NamedTuple):
    """One walk on both plants.

    Attributes:
        ensemble: on the projection plant, from :data:`STARTS`, then with the time step halved.
        others: from :data:`OTHER_STARTS`. rigid: on the other plant, with its time step and half.
    """

    walk: Walk
    ensemble: list[Walked]
    others: list[Walked]
    rigid: list[Walked]

    def projection(self, name: str) -> float:
        """Median over the ensemble."""
        return float(np.median([getattr(run, name) for run in self.ensemble]))

    @property
    def spread(self) -> float:
        """Ensemble's spread of distances: (largest - smallest) / median; infinite after a fall."""
        if any(run.fell for run in self.ensemble):
            return math.inf
        median = max(abs(self.projection("distance")), 1e-9)
        return float(np.ptp([run.distance for run in self.ensemble])) / median

    @property
    def verdict(self) -> str:
        """Return the verdict: "agree" within :data:`ALLOWED`.

        "chaotic": starts 1 mrad apart come apart by more on the projection plant alone. "other
        gait": a walk like the rigid-body plant's is found there from another crank angle.
        """
        fell = [[run.fell for run in runs] for runs in (self.ensemble, self.rigid)]
        if all(map(all, fell)):
            return "falls on both"
        if any(map(any, fell)):
            return "falls at times"
        if self.spread > ALLOWED:
            return "chaotic"

        def like(distance: float, cost: float) -> bool:
            last = self.rigid[-1]
            off = abs(last.distance / distance - 1.0), abs(last.cost_of_transport / cost - 1.0)
            return max(off) <= ALLOWED

        if like(self.projection("distance"), self.projection("cost_of_transport")):
            return "agree"
        gaits = [run for run in (*self.ensemble, *self.others) if not run.fell]
        elsewhere = any(like(run.distance, run.cost_of_transport) for run in gaits)
        return "other gait" if elsewhere else "differ"


def compare(walk: Walk) -> Comparison:
    """Run one walk on both plants."""
    ensemble = [walk.run(walk.plant("projection"), start) for start in STARTS]
    ensemble.append(walk.run(walk.plant("projection", 1)))
    others = [walk.run(walk.plant("projection"), start) for start in OTHER_STARTS]
    rigid = [walk.run(walk.plant("rigid_body", halvings)) for halvings in (0, 1)]
    return Comparison(walk, ensemble, others, rigid)


def walk_table(compared: list[Comparison]) -> str:
    """A row a walk: distance and cost on both plants, of the rigid-body plant at half its step."""
    rows = []
    for c in compared:
        pairs = [(c.projection(name), getattr(c.rigid[-1], name))
                 for name in ("distance", "cost_of_transport")]  # fmt: skip
        rows.append((
            c.walk.label, *(f"{value:.3g}" for pair in pairs for value in pair),
            "falls" if math.isinf(c.spread) else f"{100 * c.spread:.1f}", c.verdict,
        ))  # fmt: skip
    head = ("walk", "distance (m)", "rigid bodies", "cost of transport", "rigid bodies",
            "spread (%)", "verdict")  # fmt: skip
    return table(head, rows)


def verdict_table(compared: list[Comparison]) -> str:
    """Count the verdicts of each machine, as Markdown."""
    verdicts = sorted({c.verdict for c in compared})
    rows = []
    for machine in dict.fromkeys(c.walk.machine for c in compared):
        count = Counter(c.verdict for c in compared if c.walk.machine == machine)
        rows.append((machine, count.total(), *(count[verdict] for verdict in verdicts)))
    return table(("machine", "walks", *verdicts), rows)


def walks_of(name: str) -> list[Walk]:
    """All walks of a table."""
    if name == "machines":
        chosen = [(machine, 0.0) for machine in [*MACHINES][1:]]
        chosen += [(machine, PAYLOADS[0]) for machine in ("feet that give", "built")]
        return [
            Walk(speed, payload=payload, machine=machine, duration=SHORT)
            for machine, payload in chosen
            for speed in MACHINE_SPEEDS
        ]
    if name == "linkages":
        cases = product(ZOO, LINKAGE_FRICTIONS, LINKAGE_SPEEDS)
        return [Walk(speed, mu, machine=leg, duration=SHORT) for leg, mu, speed in cases]
    walks = [Walk(speed, friction) for friction in FRICTIONS for speed in SPEEDS]
    walks += [Walk(HARDER, slope=slope) for slope in SLOPES]
    return walks + [Walk(HARDER, payload=payload) for payload in PAYLOADS]


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "logs/plants", jobs=2)
    others = parser.add_mutually_exclusive_group()
    for name in ("machines", "linkages"):
        others.add_argument(f"--{name}", dest="chosen", action="store_const", const=name,
                            default="plants", help=f"other {name} instead")  # fmt: skip
    args = measure.parse(parser, arguments)
    head, walks, compared = measure.machine(), walks_of(args.chosen), []
    if args.quick:
        walks = [replace(walk, duration=1.0) for walk in walks if walk.speed == 1.0][1:2]
    with ProcessPoolExecutor(args.jobs) as pool:
        for number, comparison in enumerate(pool.map(compare, walks), 1):
            compared.append(comparison)
            print(f"{number}/{len(walks)} {comparison.walk.label}", file=sys.stderr)
    # Of several machines, the walks that do not agree.
    shown = [c for c in compared if c.verdict != "agree" or args.chosen == "plants"]
    flag = "" if args.chosen == "plants" else f" --{args.chosen}"
    measure.report(
        args.out / f"{args.chosen}.md", "# Two plants, walk by walk",
        f"`python -m benchmarks.plants{flag}`. {head}",
        HOW_COMPARED, verdict_table(compared), walk_table(shown),
    )  # fmt: skip


if __name__ == "__main__":
    main()
