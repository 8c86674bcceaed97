"""Logs of a machine's walks: read them, check them, and compare them with predicted ranges.

``workshop/measurements/README.md`` describes the format of a log.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tabulate import tabulate

from jansen_env.arrays import Array
from jansen_env.checks import finite, finite_numbers, named_errors, positive, within
from jansen_env.files import read_bounded
from jansen_env.files.plain_yaml import parse_yaml
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import PAPER_PID
from jansen_env.robot import ROBOTS
from jansen_env.scoring.metrics import SETTLING
from jansen_env.tasks.walking.tuned import gains_of
from jansen_workshop.log_table import LogTable, at_line, read_table
from jansen_workshop.walking_copies import FASTEST, SLOWEST, UNITS, measured_time

COMMENTS = "crank_speed", "robot", "gains", "torque_constant", "mass"
"""Names of the comments that are evaluated; all other comments are remarks."""
CONTROL_DT = 0.02  # control step of the predicted walks, in s
LONGEST_GAP = 0.1  # largest gap between two samples, in s
LONGEST_PERIOD = 0.05  # largest median sampling interval, in s
DRIFT = 0.03  # largest error of the clock, as a fraction of the crank speed
SMALL = 0.01  # largest error of the clock that is left uncorrected
FILMED = 1.0  # longest time between two known positions of the crank axis, in s
MAX_BYTES = 50_000_000


class MeasuredWalk(NamedTuple):
    """One walk or several walks, sampled every 20 ms after the first 2 s, shape (..., steps).

    Attributes:
        crank: Crank angle, in rad, not wrapped to one turn.
        torque: Torque at the crank, averaged over 20 ms, in N m.
        pitch: Pitch of the chassis, in rad.
        x: Position of the crank axis, in m; NaN if it is not known.
    """

    crank: Array
    torque: Array
    pitch: Array
    x: Array


class Log(NamedTuple):
    """A machine's walk at a constant crank speed.

    Attributes:
        about: Comments of the log by name.
        speed: Commanded crank speed, in rad/s.
        gains: Gains of the PID that held the crank speed.
        walk: The walk.
        notes: Notes on what was corrected in the log.
    """

    about: dict[str, Any]
    speed: float
    gains: PID
    walk: MeasuredWalk
    notes: list[str]


def read_log(path: str | Path) -> Log:
    """Read and check a log.

    Args:
        path: CSV file.

    Raises:
        ValueError: If the log cannot be read, or if a column, a unit, a gap, the clock or a value
            is implausible. The message names the file and the line.
    """
    with named_errors(path):
        table = read_table(read_bounded(path, MAX_BYTES), COMMENTS)
        comments = _comments(table)
        about = {"gains": astuple(default_gains(comments.get("robot"))), **comments}
        if "crank_speed" not in about:
            example = "for example '# crank_speed: 1' for 1 rad/s"
            raise at_line(table.head, f"a comment above must give crank_speed, {example}, got none")
        speed = about["crank_speed"]
        gains = PID(*about["gains"])
        columns = table.columns
        if "torque" not in columns:
            if "torque_constant" not in about:
                raise at_line(
                    table.head,
                    "a comment must give torque_constant, in N m per A, for the column current_A, "
                    "got none",
                )
            columns["torque"] = about["torque_constant"] * columns["current"]
        notes = _mend(columns, speed, table.lines.tolist(), table.head)
        return Log(about, speed, gains, _walk(columns, speed, table.lines.tolist()), notes)


def _comments(table: LogTable) -> dict[str, Any]:
    """Return the comments of a log by name: values of evaluated comments, and texts of remarks."""
    about: dict[str, Any] = {}
    for name, (line, text) in table.comments.items():
        about[name] = text
        if name not in COMMENTS:
            continue
        with named_errors(f"line {line}"):
            if re.fullmatch(r"[-+]?\d+,\d+", text):
                text = text.replace(",", ".")
            value = parse_yaml(text, name)
            if name == "crank_speed":
                value = finite(name, value)
                within(name, abs(value), SLOWEST, FASTEST)
            elif name == "gains":
                value = tuple(finite_numbers(name, value, 3).tolist())
                PID(*value)
            elif name != "robot":
                value = (positive if name == "mass" else finite)(name, value)
            about[name] = value
    return about


def default_gains(robot: object) -> PID:
    """Return the PID gains of a log whose comments contain none.

    If the log names a design of this package, the gains are those of the design. Otherwise nothing
    is known about the robot, and the gains are those of the paper.

    Args:
        robot: Robot that the log names.
    """
    if isinstance(robot, str) and robot in ROBOTS:
        return gains_of(ROBOTS[robot](), "steady")
    return PAPER_PID


def _mend(columns: dict[str, Array], speed: float, lines: list[int], head: int) -> list[str]:
    """Unwrap the crank angle, correct the clock and fill blanks; return notes on the corrections.

    Raises:
        ValueError: If the clock, a gap or the crank speed is implausible.
    """
    if len(lines) < 3:
        raise at_line(
            lines[-1] if lines else head,
            f"the log must have at least 3 rows below the header row, got {len(lines)}",
        )
    time = columns["time"] - columns["time"][0]
    notes = []
    _check_clock(columns["time"], lines)
    _check_length(time, speed, lines)
    periods = np.diff(time)
    gaps = periods > 1.5 * np.median(periods)
    if gaps.any():
        notes.append(f"{gaps.sum()} short gaps are filled by straight lines")
    crank = np.unwrap(columns["crank"])
    drift = _clock_error(time, crank, speed, f"lines {lines[0]} to {lines[-1]}")
    if abs(drift) > SMALL:
        time = time * (1.0 + drift)
        notes.append(f"the clock is {100.0 * drift:+.2g} % off by the crank's speed: set right")
    columns.update(time=time, crank=crank)
    if "x" in columns:
        columns["x"], note = _filled(time, columns["x"], SETTLING + measured_time(speed))
        notes += note
    return notes


def _check_clock(clock: Array, lines: list[int]) -> None:
    """Raise ValueError if the times of the samples do not rise, or are too far apart.

    Args:
        clock: Times of the log, in s, shape (n,).
        lines: Line number of each row.
    """
    time = clock - clock[0]
    periods = np.diff(time)
    if periods.min() <= 0.0:
        after = int((periods <= 0.0).argmax())
        times = f"{clock[after + 1]:.10g} after {clock[after]:.10g}"
        raise at_line(lines[after + 1], f"time_s must rise, got {times}")
    with named_errors(f"lines {lines[0]} to {lines[-1]}"):
        usual = float(np.median(periods))
        within("median time (s) between samples", usual, 0.0, LONGEST_PERIOD)
    widest = int(periods.argmax())
    with named_errors(f"line {lines[widest + 1]}"):
        within(f"gap (s) after {time[widest]:.4g} s", float(periods.max()), 0.0, LONGEST_GAP)


def _clock_error(time: Array, crank: Array, speed: float, rows: str) -> float:
    """Return the error of the clock as a fraction, by the mean speed of the crank.

    Args:
        time: Times from the first sample on, in s, shape (n,).
        crank: Crank angles, not wrapped to one turn, in rad, shape (n,).
        speed: Commanded crank speed, in rad/s.
        rows: Lines of the log, as named in error messages.

    Raises:
        ValueError: If the crank does not turn at the commanded speed.
    """
    walking = time >= SETTLING
    # The steps of the walk make the crank angle oscillate about its mean rise.
    waves = [wave(order * crank) for order in (1, 2, 4) for wave in (np.cos, np.sin)]
    terms = np.stack([time, np.ones(len(time)), *waves], axis=1)[walking]
    turned = float(np.linalg.lstsq(terms, crank[walking])[0][0])
    drift = turned / speed - 1.0
    if abs(drift) > DRIFT:
        raise ValueError(
            f"{rows}: the crank must turn at crank_speed, {speed:g} rad/s, within "
            f"{100.0 * DRIFT:g} %, got {turned:.3g} rad/s after {SETTLING:g} s; "
            "a unit, a sign or the clock is wrong"
        )
    return drift


def _check_length(time: Array, speed: float, lines: list[int]) -> None:
    """Raise ValueError if a log ends before the measured part of the walk ends."""
    needed = SETTLING + CONTROL_DT * round(measured_time(speed) / CONTROL_DT)
    if time[-1] < needed:
        raise at_line(
            lines[-1], f"the log must be at least {needed:.3g} s long, got {time[-1]:.3g} s"
        )


def _filled(time: Array, x: Array, end: float) -> tuple[Array, list[str]]:
    """Fill blank positions by linear interpolation.

    If too few positions are known, return NaN for all of them and a note.
    """
    known = np.isfinite(x)
    seen = np.concatenate([[SETTLING - FILMED], time[known], [end + FILMED]])
    seen = seen[(seen >= SETTLING - FILMED) & (seen <= end + FILMED)]
    if np.diff(seen).max() > FILMED + LONGEST_GAP:
        needed = f"every {FILMED:g} s or more often from {SETTLING:g} to {end:.3g} s"
        note = f"x_m is left out: it must be known {needed}"
        return np.full(len(x), math.nan), [note] if known.any() else []
    return np.interp(time, time[known], x[known]), []


def _walk(columns: dict[str, Array], speed: float, lines: list[int]) -> MeasuredWalk:
    """Resample the columns of a log at the control steps of the predicted walks."""
    time = columns["time"]
    torque = columns["torque"]
    _check_length(time, speed, lines)  # again, because the clock may have been corrected
    grid = SETTLING + CONTROL_DT * np.arange(round(measured_time(speed) / CONTROL_DT) + 1)
    work = np.append(0.0, np.cumsum(torque[1:] * np.diff(time)))
    mean = np.diff(np.interp(grid, time, work)) / CONTROL_DT
    if mean.mean() * speed <= 0.0:
        raise ValueError(
            f"lines {lines[0]} to {lines[-1]}: mean torque must have the sign of crank_speed, got "
            f"{mean.mean():.3g} N m; is the sign of torque or current reversed?"
        )
    columns.setdefault("x", np.full(len(time), math.nan))
    crank, pitch, x = (np.interp(grid[1:], time, columns[name]) for name in ("crank", "pitch", "x"))
    return MeasuredWalk(crank, mean, pitch, x)


def quantities(walk: MeasuredWalk) -> dict[str, Array]:
    """Measure the predicted quantities on walks.

    Args:
        walk: Walks, shape (n, steps), or one walk, shape (steps,).

    Returns:
        The quantities by name, in SI units, shape (n,) each. A quantity that is not known is
        missing.
    """
    torque = np.abs(walk.torque)
    seconds = CONTROL_DT * (walk.x.shape[-1] - 1)
    measured = {
        "mean_torque": torque.mean(axis=-1),
        "peak_torque": np.percentile(torque, 99, axis=-1),
        "pitch_range": np.ptp(walk.pitch, axis=-1),
        "speed": (walk.x[..., -1] - walk.x[..., 0]) / seconds,
    }
    return {name: np.asarray(v) for name, v in measured.items() if not np.isnan(v).any()}


def compared(name: str, log: Log, bands: Mapping[str, Sequence[float]]) -> list[list[str]]:
    """Return rows of :func:`table` that compare the quantities of a log with predicted ranges.

    Args:
        name: Name of the walk.
        log: The log.
        bands: Predicted range (low, high) by quantity.
    """
    rows = []
    for quantity, value in quantities(log.walk).items():
        low, high = bands[quantity]
        verdict = "within" if low <= value <= high else "below" if value < low else "above"
        label = f"{quantity.replace('_', ' ')} ({UNITS[quantity]})"
        rows.append([name, label, f"{value:.3g}", f"{low:.3g}", f"{high:.3g}", verdict])
    return rows


def table(rows: list[list[str]]) -> str:
    """Return rows of :func:`compared` as a Markdown table.

    Args:
        rows: The rows.
    """
    heads = ("walk", "quantity", "measured", "5 %", "95 %", "verdict")
    return tabulate(rows, heads, "github", disable_numparse=True)
