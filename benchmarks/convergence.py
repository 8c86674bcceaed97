"""Why the time step is 1 ms and the terrain is queried every 10 ms.

    python -m benchmarks.convergence [--out logs/convergence] [--jobs 2] [--quick]

Walks from many starts, against the same walks with a far smaller value: position after a second,
means of the whole walk, energy audit, penetration, and what a control step costs. With much
friction a walk is chaotic: after some seconds only its means can converge. Writes
``convergence.md``.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Any, NamedTuple

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
SWEEPS = {"time_step": (TIME_STEPS, FINEST_STEP), "detection_interval": (INTERVALS, INTERVALS[0])}
WINDOW = 1.0  # s after which positions are compared
MEANS = ("distance", "slip", "work")
ROUNDS, COST_TIME = 5, 4.0  # of the costs; s of the walk whose control steps are timed


@dataclass(frozen=True)
class Setting:
    """Settings of a walk; times in s."""

    friction: float
    spacing: float = 0.0  # m, of rough ground; 0 is level ground
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
    """Results of a walk, or arrays (starts,) of those from many starts."""

    early: Any  # position after WINDOW, m
    distance: Any  # m
    slip: Any  # of all toes, m
    work: Any  # of the motor, J
    audit: Any  # energy left unaccounted for, as a share of the motor's work
    penetration: Any  # deepest of a toe at the end of a control step, m
    fell: Any  # 1 if it fell, else 0


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
    """Depth of the deepest toe in the ground, m; negative if all are above it."""
    centre, line = plant.toe_positions(), plant.terrain.polyline
    along, seen = np.diff(line, axis=0), centre[:, None] - line[:-1]
    share = (seen * along).sum(axis=-1) / (along**2).sum(axis=-1)
    off = seen - np.clip(share, 0.0, 1.0)[..., None] * along
    distance = np.sqrt((off**2).sum(axis=-1)).min(axis=1)
    above = np.where(centre[:, 1] >= plant.terrain.height(centre[:, 0]), distance, -distance)
    return float((plant.robot.pad_radius - above).max())


def compare(found: Walk, exact: Walk) -> tuple[Array, dict[str, tuple[float, float]]]:
    """Compare walks (arrays, an entry for each start) with those of the finest value.

    Returns:
        Errors (starts,) of the early position, m; mean and standard error of the relative change of
        each of :data:`MEANS`.
    """
    changes = {}
    for name in MEANS:
        change = (getattr(found, name) - getattr(exact, name)) / np.mean(getattr(exact, name))
        deviation = float(np.std(change, ddof=1))
        changes[name] = float(np.mean(change)), deviation / math.sqrt(len(change))
    return np.abs(np.subtract(found.early, exact.early)), changes


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


def error_table(found: dict[float, Walk], exact: Walk, cost: dict[float, float]) -> str:
    """Compare the walks with each value (s) with those of the finest, as Markdown."""
    head = (
        "ms", "error after 1 s, mm", "9 of 10 below", "distance, %", "slip, %",
        "motor work, %", "audit", "deepest, mm", "falls", "us per 20 ms",
    )  # fmt: skip
    rows = []
    for value, own in found.items():
        error, changes = compare(own, exact)
        rows.append((
            f"{1e3 * value:g}", f"{1e3 * np.median(error):.2g}",
            f"{1e3 * np.quantile(error, 0.9):.2g}",
            *(f"{100 * mean:+.2f} ± {100 * error:.2f}" for mean, error in changes.values()),
            f"{np.median(own.audit):.1e}", f"{1e3 * np.max(own.penetration):.2f}",
            f"{np.mean(own.fell):.2f}", f"{1e6 * cost[value]:.0f}",
        ))  # fmt: skip
    return measure.table(head, rows)


def sweep(
    what: str, walk_all: Callable[[Setting], Walk], settings: dict[str, Setting], rounds: int
) -> list[str]:
    """Walk with each value of a setting; Markdown paragraphs."""
    values, finest = SWEEPS[what]
    parts = [f"## {what.replace('_', ' ').capitalize()}: {1e3 * getattr(Setting(0.0), what):g} ms"]
    cost = costs(next(iter(settings.values())), what, values, rounds)
    for name, setting in settings.items():
        print(f"{what.replace('_', ' ')}, {name} ...", file=sys.stderr, flush=True)
        found = {v: walk_all(replace(setting, **{what: v})) for v in {*values, finest}}
        exact = found[finest]
        parts.append(f"{name}, {np.mean(exact.early):.2f} m walked in the first second:")
        parts.append(error_table({v: found[v] for v in values}, exact, cost))
        if what == "detection_interval":
            often = replace(setting, detection_interval=INTERVALS[0])
            coarse, fine = (walk_all(replace(often, time_step=s)) for s in (TIME_STEP, FINEST_STEP))
            own = 1e3 * float(np.median(compare(coarse, fine)[0]))
            parts.append(f"The time step's own error there: {own:.2g} mm.")
    return parts


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

        def walk_all(setting: Setting) -> Walk:
            one = partial(walk, setting, starts=starts, duration=duration)
            return Walk(*np.array(list(pool.map(one, range(starts)))).T)

        parts += sweep("time_step", walk_all, level, rounds)
        parts += sweep("detection_interval", walk_all, rough, rounds)
    measure.report(found.out / "convergence.md", *parts)


if __name__ == "__main__":
    main()
