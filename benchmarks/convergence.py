"""Why the time step is 1 ms and the ground is looked for every 10 ms.

    python -m benchmarks.convergence [--out docs/performance] [--jobs 2] [--quick]

Walks from many starts with larger and smaller values, against the same walks with a far smaller
one: where the robot is after a second; what the whole walk comes to in the mean; what the energy
audit leaves over; how deep toes are in the ground. Beside it what a control step costs. With much
friction a walk is chaotic: after some seconds only its means can converge. Writes
``convergence.json``, ``convergence.md``, ``time_step.png`` and ``detection_interval.png``.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.rounds import FEWEST_ROUNDS, machine, missing, table, take_turns
from benchmarks.speed_kernel import FALLEN_PITCH, Replay, walking_torque
from benchmarks.speed_single import rough_ground
from jansen_env import Terrain, paper_robot
from jansen_env.files import write_json, write_text
from jansen_env.plants.batch import DETECTION_INTERVAL, TIME_STEP
from jansen_env.plants.projected import ProjectionPlant

Array = NDArray[np.float64]

MS = 1e-3  # s
TIME_STEPS = (0.125 * MS, 0.25 * MS, 0.5 * MS, 1.0 * MS, 2.0 * MS, 4.0 * MS)
FINEST_STEP = MS / 32.0
FRICTIONS = (0.3, 0.8)
INTERVALS = (1.0 * MS, 2.0 * MS, 5.0 * MS, 10.0 * MS, 20.0 * MS, 40.0 * MS)
SPACINGS = (0.2, 0.05)  # m between the vertices of rough ground
ROUGH_FRICTION = 0.3
SPAN = 12.0  # m of it
STARTS, QUICK_STARTS = 24, 2  # crank angles over half a turn, each on a ground of its own
CONTROL_DT = 0.02  # s for which a torque is held on level ground
HELD = 0.04  # s for which it is on rough ground: every step() looks for the ground
WINDOW = 1.0  # s after which positions are compared
DURATION, QUICK_DURATION = 4.0, 1.0  # s of a walk
COST_TIME = 1.0  # s of the walk whose control steps are timed
MEANS = ("distance", "slip", "work")


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
        """A plant on its ground; rough ground differs by seed."""
        terrain = Terrain.flat(self.friction)
        if self.spacing:
            count = round(SPAN / self.spacing)
            terrain = rough_ground(count, self.spacing, seed, friction=self.friction)
        return ProjectionPlant(
            paper_robot(), terrain, self.time_step, detection_interval=self.detection_interval
        )


class Walk(NamedTuple):
    """What came out of a walk.

    Attributes:
        early: position after :data:`WINDOW`, m. distance: m. slip: of all toes, m.
        work: of the motor, J.
        audit: energy that the audit leaves over, as a share of the motor's work.
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


def walk(setting: Setting, number: int, starts: int, duration: float) -> Walk:
    """Walk from start ``number`` of so many for a while (s)."""
    plant = setting.plant(number)
    plant.reset(0.0, np.pi * number / starts)
    slip = work = left = deepest = early = 0.0
    fell = False
    for k in range(1, round(duration / setting.control_dt) + 1):
        torque = walking_torque(plant.robot, float(plant.state[7]))
        result = plant.step(torque, setting.control_dt)
        slip += float(result.slip.sum())
        work += result.motor_work
        left += abs(result.energy_residual)
        deepest = max(deepest, penetration(plant))
        fell = fell or result.bumped or abs(float(plant.state[2])) > FALLEN_PITCH
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


def walks(pool: Executor, setting: Setting, quick: bool) -> Array:
    """(starts, columns of :class:`Walk`) from all starts."""
    starts, duration = (QUICK_STARTS, QUICK_DURATION) if quick else (STARTS, DURATION)
    jobs = [pool.submit(walk, setting, number, starts, duration) for number in range(starts)]
    return np.array([job.result() for job in jobs])


def sweep(
    pool: Executor, setting: Setting, what: str, values: Sequence[float], finest: float, quick: bool
) -> list[dict[str, Any]]:
    """A setting's walks with each value (s) of ``what``, compared with those of the finest."""
    reference = walks(pool, replace(setting, **{what: finest}), quick)
    rows = []
    for value in values:
        same = value == finest
        found = reference if same else walks(pool, replace(setting, **{what: value}), quick)
        rows.append(compare(value, found, reference))
    return rows


def compare(value: float, found: Array, reference: Array) -> dict[str, Any]:
    """Walks with a value against those of the finest, start by start; ready for JSON."""
    ours, exact = Walk(*found.T), Walk(*reference.T)
    changes = {}
    for name in MEANS:
        change = (getattr(ours, name) - getattr(exact, name)) / getattr(exact, name).mean()
        changes[name] = {
            "mean": float(change.mean()),
            "standard_error": float(change.std(ddof=1) / math.sqrt(len(change))),
        }
    return {
        "value": value,
        "error": quantiles(np.abs(ours.early - exact.early)),
        "walked": float(np.mean(exact.early)),
        "changes": changes,
        "audit": quantiles(ours.audit),
        "penetration": quantiles(ours.penetration),
        "falls": float(np.mean(ours.fell)),
    }


def quantiles(values: Any) -> dict[str, float]:
    """One start in ten is below ``low``, one above ``high``."""
    low, middle, high = np.quantile(values, (0.1, 0.5, 0.9)).tolist()
    return {"low": low, "median": middle, "high": high, "worst": float(np.max(values))}


def costs(setting: Setting, what: str, values: Sequence[float], rounds: int) -> dict[str, Any]:
    """Seconds that 20 ms of a walk take with each value, in interleaved rounds."""
    share = CONTROL_DT / setting.control_dt
    replays = {
        str(value): Replay(
            replace(setting, **{what: value}).plant(), setting.control_dt, COST_TIME
        ).play
        for value in values
    }
    found = take_turns(replays, rounds)
    return {name: share * median(seconds) for name, seconds in found.items()}


def run(quick: bool, jobs: int) -> dict[str, Any]:
    """All of it; ready for JSON."""
    level = {f"level, friction {mu:g}": Setting(mu) for mu in FRICTIONS}
    rough = {
        f"rough, {100 * spacing:g} cm": Setting(ROUGH_FRICTION, spacing, control_dt=HELD)
        for spacing in SPACINGS
    }
    studies: list[dict[str, Any]] = []
    with ProcessPoolExecutor(jobs) as pool:
        for what, values, finest, settings in (
            ("time_step", TIME_STEPS, FINEST_STEP, level),
            ("detection_interval", INTERVALS, INTERVALS[0], rough),
        ):
            grounds = {}
            for name, setting in settings.items():
                print(f"{what.replace('_', ' ')}, {name} ...", file=sys.stderr, flush=True)
                grounds[name] = sweep(pool, setting, what, values, finest, quick)
            default = getattr(Setting(0.0), what)
            studies.append({"what": what, "default": default, "finest": finest, "grounds": grounds})
        print("time step on rough ground ...", file=sys.stderr, flush=True)
        studies[1]["time_step_error"] = {
            name: sweep(
                pool, replace(setting, detection_interval=INTERVALS[0]), "time_step",
                (TIME_STEP,), FINEST_STEP, quick,
            )[0]["error"]["median"]
            for name, setting in rough.items()
        }  # fmt: skip
    print("costs ...", file=sys.stderr, flush=True)
    rounds = 1 if quick else FEWEST_ROUNDS
    studies[0]["cost"] = costs(Setting(FRICTIONS[0]), "time_step", TIME_STEPS, rounds)
    coarse = next(iter(rough.values()))
    studies[1]["cost"] = costs(coarse, "detection_interval", INTERVALS, rounds)
    return {
        "machine": machine(),
        "quick": quick,
        "starts": QUICK_STARTS if quick else STARTS,
        "duration": QUICK_DURATION if quick else DURATION,
        "studies": studies,
    }


def report(result: dict[str, Any]) -> str:
    """The result as Markdown."""
    parts = [
        "# Time step and detection interval",
        f"{result['starts']} starts, walks of {result['duration']:g} s at about 2.7 rad/s; changes "
        f"with their standard errors; costs on {result['machine']['cpu']}.",
    ]
    head = (
        "ms", "error after 1 s, mm", "9 of 10 below", "distance, %", "slip, %",
        "motor work, %", "audit", "deepest, mm", "falls", "us per 20 ms",
    )  # fmt: skip
    for found in result["studies"]:
        default = 1e3 * found["default"]
        parts.append(f"## {found['what'].replace('_', ' ').capitalize()}: {default:g} ms")
        for name, rows in found["grounds"].items():
            parts.append(f"{name}, {rows[0]['walked']:.2f} m walked in the first second:")
            cells = [_cells(row, found["cost"][str(row["value"])]) for row in rows]
            parts.append(table(head, cells))
            if "time_step_error" in found:
                error = 1e3 * found["time_step_error"][name]
                parts.append(f"The time step's own error there: {error:.2g} mm.")
    return "\n\n".join(parts) + "\n"


def _cells(row: dict[str, Any], cost: float) -> tuple[str, ...]:
    changes = (
        f"{100 * change['mean']:+.2f} ± {100 * change['standard_error']:.2f}"
        for change in row["changes"].values()
    )
    error, audit = row["error"], row["audit"]["median"]
    return (
        f"{1e3 * row['value']:g}", f"{1e3 * error['median']:.2g}", f"{1e3 * error['high']:.2g}",
        *changes, f"{audit:.1e}", f"{1e3 * row['penetration']['worst']:.2f}",
        f"{row['falls']:.2f}", f"{1e6 * cost:.0f}",
    )  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("docs/performance"), metavar="DIR",
                        help="where it all goes (docs/performance)")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side (2)")
    parser.add_argument("--quick", action="store_true", help="a few short walks, to try it")
    chosen = parser.parse_args(arguments)
    if chosen.jobs < 1:
        parser.error(f"--jobs is {chosen.jobs}, must be at least 1")
    if chosen.out.exists() and not chosen.out.is_dir():
        parser.error(f"--out is {chosen.out}, which is no folder")
    lacking = missing(["matplotlib"])
    if lacking:
        parser.exit(2, lacking)
    from benchmarks import convergence_figures

    result = run(chosen.quick, chosen.jobs)
    write_json(chosen.out / "convergence.json", result)
    text = report(result)
    write_text(chosen.out / "convergence.md", text)
    convergence_figures.draw(result, chosen.out)
    print(text)


if __name__ == "__main__":
    main()
