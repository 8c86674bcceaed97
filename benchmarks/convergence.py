"""Why the time step is 1 ms and the terrain is queried every 10 ms.

    python -m benchmarks.convergence [--out logs/convergence] [--jobs 2] [--quick]

Walks from many starts with larger and smaller values, against the same walks with a far smaller
one: where the robot is after a second; what the whole walk comes to in the mean; what the energy
audit leaves over; how deep toes are in the ground. Beside it what a control step costs. With much
friction a walk is chaotic: after some seconds only its means can converge. Writes
``convergence.md``.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import measure, walks
from jansen_env import Terrain, paper_robot
from jansen_env.plants.batch import DETECTION_INTERVAL, TIME_STEP
from jansen_env.plants.projected import ProjectionPlant

Array = NDArray[np.float64]

MS = 1e-3  # s
TIME_STEPS = (0.125 * MS, 0.25 * MS, 0.5 * MS, 1.0 * MS, 2.0 * MS, 4.0 * MS)
FINEST_STEP = MS / 32.0
INTERVALS = (1.0 * MS, 2.0 * MS, 5.0 * MS, 10.0 * MS, 20.0 * MS, 40.0 * MS)
FRICTIONS = (0.3, 0.8)  # of level ground
SPACINGS, ROUGH_FRICTION = (0.2, 0.05), 0.3  # m between the vertices of rough ground
SPAN = 12.0  # m of it
CONTROL_DT = 0.02  # s for which a torque is held on level ground
HELD = 0.04  # s for which it is on rough ground: every step() queries the terrain
WINDOW = 1.0  # s after which positions are compared
MEANS = ("distance", "slip", "work")
ROUNDS, COST_TIME = 5, 4.0  # of the costs; s of the walk whose control steps are timed


@dataclass(frozen=True)
class Setting:
    """How a walk is computed.

    Attributes:
        friction: Coulomb coefficient. spacing: of rough ground, m; 0 is level ground.
        time_step, detection_interval: s. control_dt: for which a torque is held, s.
    """

    friction: float
    spacing: float = 0.0
    time_step: float = TIME_STEP
    detection_interval: float = DETECTION_INTERVAL
    control_dt: float = CONTROL_DT

    def plant(self, seed: int = 0) -> ProjectionPlant:
        """A plant on its terrain; rough ground differs by seed."""
        terrain = Terrain.flat(self.friction)
        if self.spacing:
            segments = round(SPAN / self.spacing)
            terrain = walks.rough_ground(segments, self.spacing, seed, friction=self.friction)
        return ProjectionPlant(
            paper_robot(), terrain, self.time_step, detection_interval=self.detection_interval
        )


class Walk(NamedTuple):
    """What came out of a walk.

    Attributes:
        early: position after :data:`WINDOW`, m. distance: m. slip: of all toes, m.
        work: of the motor, J. audit: energy left unaccounted for, as a share of the motor's work.
        penetration: deepest of a toe in the ground at the end of a control step, m.
        fell: 1 if it fell, else 0.
    """

    early: float
    distance: float
    slip: float
    work: float
    audit: float
    penetration: float
    fell: float


class Error(NamedTuple):
    """Walks with one value against those of the finest, start by start.

    Attributes:
        value: s. error: (starts,) of the early position, m.
        changes: mean and standard error of the relative change of each of :data:`MEANS`.
        walks: with the value. walked: by the finest in the mean at the early position, m.
    """

    value: float
    error: Array
    changes: dict[str, tuple[float, float]]
    walks: Walk
    walked: float


def torque(plant: ProjectionPlant) -> float:
    """N m that hold the crank at about 2.7 rad/s: every leg adds its own weight and friction."""
    return len(plant.robot.legs) * (1.0 + 2.5 * (2.7 - float(plant.state[7])))


def walk(setting: Setting, number: int, starts: int, duration: float) -> Walk:
    """Walk from start ``number`` of so many, over half a turn, for a while (s)."""
    plant = setting.plant(number)
    plant.reset(0.0, np.pi * number / starts)
    slip = work = left = deepest = early = 0.0
    fell = False
    for k in range(1, round(duration / setting.control_dt) + 1):
        result = plant.step(torque(plant), setting.control_dt)
        slip += float(result.slip.sum())
        work += result.motor_work
        left += abs(result.energy_residual)
        deepest = max(deepest, penetration(plant))
        fell = fell or walks.fallen(plant, result)
        if k == round(WINDOW / setting.control_dt):
            early = plant.x
    return Walk(early, plant.x, slip, work, left / work, deepest, float(fell))


def penetration(plant: ProjectionPlant) -> float:
    """How deep the deepest toe is in the ground, m; negative if all are above it."""
    centre, line = plant.toe_positions(), plant.terrain.polyline
    along, seen = np.diff(line, axis=0), centre[:, None] - line[:-1]
    share = (seen * along).sum(axis=-1) / (along**2).sum(axis=-1)
    off = seen - np.clip(share, 0.0, 1.0)[..., None] * along
    distance = np.sqrt((off**2).sum(axis=-1)).min(axis=1)
    above = np.where(centre[:, 1] >= plant.terrain.height(centre[:, 0]), distance, -distance)
    return float((plant.robot.pad_radius - above).max())


def compare(value: float, found: Walk, exact: Walk) -> Error:
    """Walks (arrays, an entry for each start) with a value against those of the finest."""
    changes = {}
    for name in MEANS:
        change = (getattr(found, name) - getattr(exact, name)) / np.mean(getattr(exact, name))
        deviation = float(np.std(change, ddof=1))
        changes[name] = float(np.mean(change)), deviation / math.sqrt(len(change))
    error = np.abs(np.subtract(found.early, exact.early))
    return Error(value, error, changes, found, float(np.mean(exact.early)))


@dataclass(frozen=True)
class Study:
    """Walks with several values of one setting.

    Attributes:
        pool: in which they run. starts: crank angles. duration: s.
    """

    pool: Executor
    starts: int
    duration: float

    def walks(self, setting: Setting) -> Walk:
        """Arrays (starts,) from all starts."""
        jobs = [self.pool.submit(walk, setting, number, self.starts, self.duration)
                for number in range(self.starts)]  # fmt: skip
        return Walk(*np.array([job.result() for job in jobs]).T)

    def sweep(
        self, setting: Setting, what: str, values: Sequence[float], finest: float
    ) -> list[Error]:
        """A setting's walks with each value (s) of ``what``, compared with those of the finest."""
        exact = self.walks(replace(setting, **{what: finest}))
        return [
            compare(v, exact if v == finest else self.walks(replace(setting, **{what: v})), exact)
            for v in values
        ]


def costs(setting: Setting, what: str, values: Sequence[float], rounds: int) -> dict[float, float]:
    """Seconds that 20 ms of a walk take with each value, in turns."""

    def play(plant: ProjectionPlant) -> float:
        plant.reset()
        spent = 0.0
        for _ in range(round(COST_TIME / setting.control_dt)):
            wanted, start = torque(plant), time.perf_counter()
            plant.step(wanted, setting.control_dt)
            spent += time.perf_counter() - start
        return spent * CONTROL_DT / COST_TIME

    plays = {v: partial(play, replace(setting, **{what: v}).plant()) for v in values}
    found = measure.take_turns(plays, rounds)
    return {v: median(found[v]) for v in values}


def error_table(rows: list[Error], cost: dict[float, float]) -> str:
    """A row for each value."""
    head = (
        "ms", "error after 1 s, mm", "9 of 10 below", "distance, %", "slip, %",
        "motor work, %", "audit", "deepest, mm", "falls", "us per 20 ms",
    )  # fmt: skip
    cells = [
        (
            f"{1e3 * row.value:g}", f"{1e3 * np.median(row.error):.2g}",
            f"{1e3 * np.quantile(row.error, 0.9):.2g}",
            *(f"{100 * mean:+.2f} ± {100 * error:.2f}" for mean, error in row.changes.values()),
            f"{np.median(row.walks.audit):.1e}", f"{1e3 * np.max(row.walks.penetration):.2f}",
            f"{np.mean(row.walks.fell):.2f}", f"{1e6 * cost[row.value]:.0f}",
        )
        for row in rows
    ]  # fmt: skip
    return measure.table(head, cells)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    found = measure.chosen(measure.options(__doc__, "logs/convergence", jobs=2), arguments)
    starts, duration, rounds = (2, 1.0, 1) if found.quick else (24, 4.0, ROUNDS)
    parts = [
        "# Time step and detection interval",
        f"{starts} starts, walks of {duration:g} s at about 2.7 rad/s; changes with their standard "
        f"errors. {measure.machine()}",
    ]
    level = {f"level, friction {mu:g}": Setting(mu) for mu in FRICTIONS}
    rough = {
        f"rough, {100 * spacing:g} cm": Setting(ROUGH_FRICTION, spacing, control_dt=HELD)
        for spacing in SPACINGS
    }
    with ProcessPoolExecutor(found.jobs) as pool:
        study = Study(pool, starts, duration)
        for what, values, finest, settings in (
            ("time_step", TIME_STEPS, FINEST_STEP, level),
            ("detection_interval", INTERVALS, INTERVALS[0], rough),
        ):
            default: float = getattr(Setting(0.0), what)
            parts.append(f"## {what.replace('_', ' ').capitalize()}: {1e3 * default:g} ms")
            cost = costs(next(iter(settings.values())), what, values, rounds)
            for name, setting in settings.items():
                print(f"{what.replace('_', ' ')}, {name} ...", file=sys.stderr, flush=True)
                rows = study.sweep(setting, what, values, finest)
                parts.append(f"{name}, {rows[0].walked:.2f} m walked in the first second:")
                parts.append(error_table(rows, cost))
                if what == "detection_interval":
                    often = replace(setting, detection_interval=INTERVALS[0])
                    (row,) = study.sweep(often, "time_step", (TIME_STEP,), FINEST_STEP)
                    own = 1e3 * float(np.median(row.error))
                    parts.append(f"The time step's own error there: {own:.2g} mm.")
    measure.report(found.out / "convergence.md", *parts)


if __name__ == "__main__":
    main()
