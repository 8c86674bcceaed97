"""Logs of a machine's walk: read, checked, and compared with what was predicted of the machine.

``measurements/README.md`` has the format of a log.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tabulate import tabulate

from jansen_env.arrays import Array
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import PAPER_PID
from jansen_env.checks import finite, finite_numbers, invalid, listed, named_errors, one_of, within
from jansen_env.commands import predict
from jansen_env.commands.flags import Parser
from jansen_env.commands.predict import FASTEST, SLOWEST, measured_time
from jansen_env.files import read_bounded
from jansen_env.plain_yaml import parse_yaml
from jansen_env.scoring.metrics import SETTLING

COLUMNS = {
    "time_s": 1.0, "crank_rad": 1.0, "crank_deg": math.pi / 180.0, "torque_Nm": 1.0,
    "current_A": 1.0, "pitch_rad": 1.0, "pitch_deg": math.pi / 180.0, "x_m": 1.0,
}  # fmt: skip
"""Columns, each a quantity and its unit, and that unit in SI."""
CONTROL_DT = 0.02  # s, of predicted walks
NEEDED = "time", "crank", "torque", "pitch"
LONGEST_GAP, LONGEST_PERIOD = 0.1, 0.05  # s, without samples, and between most of them
DRIFT, SMALL = 0.03, 0.01  # of the crank's speed: that a clock may be off, and that is left
STEEPEST = 0.8  # rad, of pitch
MAX_BYTES = 50_000_000
PREDICTIONS = Path(__file__).parents[1] / "docs" / "predictions"


class Walk(NamedTuple):
    """A walk (..., steps) every 20 ms after the first 2 s, or several."""

    crank: Array  # rad, not wrapped
    torque: Array  # at the crank, N m, mean of 20 ms
    pitch: Array  # rad
    x: Array  # m, of the crank's axis; NaN where it is not known


class Log(NamedTuple):
    """A machine's walk at a constant crank speed; ``about``: its comments by name."""

    about: dict[str, Any]
    speed: float  # commanded, rad/s
    gains: PID
    walk: Walk
    notes: list[str]  # what was mended


def read_log(path: str | Path) -> Log:
    """Read a log.

    Raises ValueError: it cannot be read, or a column, a unit, a gap, a clock or numbers cannot be
    right; names them.
    """
    with named_errors(path):
        text = read_bounded(path, MAX_BYTES).decode("utf-8-sig")
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        comments = "\n".join(line.lstrip("# ") for line in lines if line.startswith("#"))
        if not isinstance(given := parse_yaml(comments, "comments") or {}, dict):
            raise invalid("comments", given, "names and values")
        about = {"gains": astuple(PAPER_PID), **given}
        speed = finite("crank_speed", about.get("crank_speed"))
        within("crank_speed", abs(speed), SLOWEST, FASTEST)
        gains = PID(*finite_numbers("gains", about["gains"], 3).tolist())
        columns = _columns([line for line in lines if not line.startswith("#")])
        if "current" in columns:
            constant = finite("torque_constant", about.get("torque_constant"))
            columns.setdefault("torque", constant * columns["current"])
        if missing := [name for name in NEEDED if name not in columns]:
            raise ValueError(f"has no column of {missing[0]}, must have {', '.join(NEEDED)}")
        notes = _mend(columns, speed)
        return Log(about, speed, gains, _walk(columns, speed), notes)


def _columns(lines: list[str]) -> dict[str, Array]:
    """Columns by quantity, in SI."""
    heads = [head.strip() for head in lines[0].split(",")] if lines else []
    for head in heads:
        if head not in COLUMNS:
            raise ValueError(f"column is {head!r}, must be of {listed(COLUMNS, head)}")
    quantities = [head.split("_")[0] for head in heads]
    if twice := [name for name in quantities if quantities.count(name) > 1]:
        raise ValueError(f"has several columns of {twice[0]}, must have one")
    try:
        table = np.array([line.split(",") for line in lines[1:]], float)
    except ValueError as error:
        raise ValueError(f"each row must be {len(heads)} numbers: {error}") from None
    if table.shape[1:] != (len(heads),) or len(table) < 3 or not np.isfinite(table).all():
        raise ValueError(f"must have 3 rows or more of {len(heads)} finite numbers")
    values = (COLUMNS[head] * column for head, column in zip(heads, table.T, strict=True))
    return dict(zip(quantities, values, strict=True))


def _mend(columns: dict[str, Array], speed: float) -> list[str]:
    """Unwrap the crank, set the clock right; what was mended. Raises ValueError: it cannot be."""
    time, notes = columns["time"] - columns["time"][0], []
    periods = np.diff(time)
    usual, longest, where = float(np.median(periods)), periods.max(), time[periods.argmax()]
    if periods.min() <= 0.0:
        raise ValueError(f"time does not rise after {time[periods.argmin()]:.4g} s, must rise")
    within("median time (s) between samples", usual, 0.0, LONGEST_PERIOD)
    within(f"gap (s) after {where:.4g} s", float(longest), 0.0, LONGEST_GAP)
    if longest > 1.5 * usual:
        notes.append(f"{(periods > 1.5 * usual).sum()} short gaps are filled by straight lines")
    crank, walking = np.unwrap(columns["crank"]), time >= SETTLING
    waves = [wave(order * crank) for order in (1, 2, 4) for wave in (np.cos, np.sin)]  # of steps
    drawn = np.stack([time, np.ones(len(time)), *waves], axis=1)[walking]
    turned = float(np.linalg.lstsq(drawn, crank[walking])[0][0]) if walking.any() else 0.0
    drift = turned / speed - 1.0
    if abs(drift) > DRIFT:
        raise ValueError(
            f"crank turns at {turned:.3g} rad/s after {SETTLING:g} s, must at crank_speed, "
            f"{speed:g}, within {100.0 * DRIFT:g} %: a unit, a sign or the clock is wrong"
        )
    if abs(drift) > SMALL:
        time = time * (1.0 + drift)
        notes.append(f"the clock is {100.0 * drift:+.2g} % off by the crank's speed: set right")
    within("largest pitch (rad)", float(np.abs(columns["pitch"]).max()), 0.0, STEEPEST)
    columns.update(time=time, crank=crank)
    return notes


def _walk(columns: dict[str, Array], speed: float) -> Walk:
    """Resample columns as walks are predicted."""
    time, torque = columns["time"], columns["torque"]
    grid = SETTLING + CONTROL_DT * np.arange(round(measured_time(speed) / CONTROL_DT) + 1)
    if time[-1] < grid[-1]:
        raise ValueError(f"is {time[-1]:.3g} s long, must be {grid[-1]:.3g} s or longer")
    work = np.append(0.0, np.cumsum(torque[1:] * np.diff(time)))
    mean = np.diff(np.interp(grid, time, work)) / CONTROL_DT
    if mean.mean() * speed <= 0.0:
        raise ValueError(f"mean torque is {mean.mean():.3g} N m, must drive the crank: its sign")
    columns.setdefault("x", np.full(len(time), math.nan))
    crank, pitch, x = (np.interp(grid[1:], time, columns[name]) for name in ("crank", "pitch", "x"))
    return Walk(crank, mean, pitch, x)


def quantities(walk: Walk) -> dict[str, Array]:
    """Return the predicted quantities, measured on walks (n, steps), by name: (n,), in SI."""
    torque, seconds = np.abs(walk.torque), CONTROL_DT * (walk.x.shape[-1] - 1)
    measured = {
        "mean_torque": torque.mean(axis=-1), "peak_torque": np.percentile(torque, 99, axis=-1),
        "pitch_range": np.ptp(walk.pitch, axis=-1),
        "speed": (walk.x[..., -1] - walk.x[..., 0]) / seconds,
    }  # fmt: skip
    return {name: np.asarray(v) for name, v in measured.items() if not np.isnan(v).any()}


def compared(name: str, log: Log, bands: Mapping[str, Sequence[float]]) -> list[list[str]]:
    """Rows of :func:`table`: what a log measured, beside bands (low, high) by quantity."""
    rows = []
    for quantity, value in quantities(log.walk).items():
        low, high = bands[quantity]
        verdict = "within" if low <= value <= high else "below" if value < low else "above"
        label = f"{quantity.replace('_', ' ')} ({predict.UNITS[quantity]})"
        rows.append([name, label, f"{value:.3g}", f"{low:.3g}", f"{high:.3g}", verdict])
    return rows


def table(rows: list[list[str]]) -> str:
    """Rows of :func:`compared` as Markdown."""
    heads = ("walk", "quantity", "measured", "5 %", "95 %", "verdict")
    return tabulate(rows, heads, "github", disable_numparse=True)


def published(path: Path) -> list[list[str]]:
    """Rows of :func:`table`: a log beside the predictions of its robot at its crank speed. Raises
    ValueError: there are none; says of which robots and speeds there are."""
    log, names = read_log(path), sorted(file.stem for file in PREDICTIONS.glob("*.json"))
    with named_errors(path):
        robot = one_of("robot", log.about.get("robot"), names)
        text = (PREDICTIONS / f"{robot}.json").read_text(encoding="utf-8")
        speeds = json.loads(text)["crank_speed"]
        known = speeds[one_of("crank_speed", f"{log.speed:g}", speeds)]
    bands = {name: (row["low"], row["high"]) for name, row in known.items()}
    return compared(path.name, log, bands)


def main(arguments: list[str] | None = None) -> None:
    """Compare logs with the published predictions of their machines."""
    parser = Parser("python -m agents.measurements", __doc__,
                    "python -m agents.measurements measurements/*.csv")  # fmt: skip
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG.csv")
    args = parser.parse_args(arguments)
    with parser.refusing():
        print(table([row for path in args.logs for row in published(path)]))


if __name__ == "__main__":
    main()
