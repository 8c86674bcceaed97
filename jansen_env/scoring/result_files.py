"""Result files of the benchmark: plain JSON, which is checked when it is read.

``docs/benchmark.md`` describes the format.
"""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

import jansen_env
from jansen_env.checks import instance, invalid, named_errors, one_of
from jansen_env.files import read_bounded, write_text
from jansen_env.scoring.protocol import (
    COLUMNS,
    PROTOCOL,
    TRACKS,
    Columns,
    Track,
    plant_hashes,
)

FORMAT = "jansen_env result 1"
ENTRIES = ("format", "protocol", "name", "package", "processor", "plants", "tracks")
TRACK_ENTRIES = ("policy", "sha256", "seeds", "episodes")
MAX_BYTES = 2**20  # largest size of a file; the files of this repository are smaller than 300 kB
DIGITS = 4  # number of significant digits of raw scores
LARGEST = 1e9  # largest magnitude of a raw score
WHOLE = ("success", "falls")  # columns whose values are 0 or 1
NOT_NEGATIVE = ("speed_error", "distance", "slip", "work", "unsupported", "load")
# Texts of a file appear in Markdown tables, so they must not contain any markup.
TEXT = re.compile(r"[\w .,:;+/@()=-]{1,120}", re.ASCII)
SHA256 = re.compile(r"[0-9a-f]{64}")
PLANT_HASH = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class TrackResult:
    """Result of one policy on one track.

    Attributes:
        policy: Name of the policy.
        sha256: SHA-256 of the policy's files. None for a policy without files.
        columns: Raw scores of the episodes, rounded to :data:`DIGITS` significant digits.
    """

    policy: str
    sha256: str | None
    columns: Columns


@dataclass(frozen=True)
class Result:
    """Content of a result file: one training run of an algorithm, on one or several tracks.

    Attributes:
        name: Name of the algorithm. Files with the same name are training runs with other seeds.
        package: Versions of this package, Python and NumPy, by name.
        processor: Name of the processor.
        plants: Hash of a short walk on each simulation backend, by name of the backend.
        tracks: Results by name of the track.
    """

    name: str
    package: Mapping[str, str]
    processor: str
    plants: Mapping[str, str]
    tracks: Mapping[str, TrackResult]


def rounded(columns: Columns) -> Columns:
    """Return raw scores with the number of significant digits that a file contains.

    Args:
        columns: The raw scores.

    Raises:
        ValueError: If a score is not a finite number.
    """
    for name, values in columns.items():
        for episode, value in enumerate(values):
            if not np.isfinite(value):
                raise ValueError(f"{name} of episode {episode} must be finite, got {value}")
    return {
        name: np.array([float(f"{value:.{DIGITS}g}") for value in values])
        for name, values in columns.items()
    }


def new_result(name: str, tracks: Mapping[str, TrackResult]) -> Result:
    """Return the result of policies on this machine.

    Args:
        name: Name of the algorithm.
        tracks: Results by name of the track.
    """
    package = {
        "jansen_env": jansen_env.__version__,
        "python": platform.python_version(),
        "numpy": version("numpy"),
    }
    return Result(name, package, processor_name(), plant_hashes(), tracks)


def processor_name() -> str:
    """Return the name of this machine's processor, without characters other than :data:`TEXT`."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text("utf-8", "replace").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    text = f"{next(iter(names), platform.processor())} ({platform.machine()})"
    return "".join(c if TEXT.fullmatch(c) else " " for c in text).strip()[:120]


def write_result(path: str | Path, result: Result) -> Path:
    """Write a result file and return its path.

    Args:
        path: Path of the file.
        result: The result.
    """
    tracks = {
        name: {
            "policy": track.policy,
            "sha256": track.sha256,
            "seeds": TRACKS[name].seeds_sha256,
            "episodes": {column: _compact(track.columns[column]) for column in COLUMNS},
        }
        for name, track in result.tracks.items()
    }
    content = {
        "format": FORMAT,
        "protocol": PROTOCOL,
        "name": result.name,
        "package": dict(result.package),
        "processor": result.processor,
        "plants": dict(result.plants),
        "tracks": tracks,
    }
    text = json.dumps(content, indent=1, allow_nan=False)
    # One line per list of numbers.
    text = re.sub(r"\[[^][]*\]", lambda match: re.sub(r"\s+", "", match[0]), text)
    return write_text(path, text + "\n")


def _compact(values: Any) -> list[float]:
    """Return numbers for JSON, with whole numbers as int because they are shorter."""
    return [int(value) if value == int(value) else float(value) for value in values]


def read_result(path: str | Path) -> Result:
    """Read a result file, which may come from anyone.

    Args:
        path: Path of the file.

    Raises:
        ValueError: If the file is too large or is not a result of this protocol. The message names
            the file and the entry.
    """
    data = read_bounded(path, MAX_BYTES)
    with named_errors(f"{path} is not a result file", RecursionError):
        return _checked(json.loads(data, parse_constant=_no_constant))


def _no_constant(name: str) -> NoReturn:
    """Reject NaN and infinity, which JSON does not have."""
    raise ValueError(f"numbers must be finite, got {name}")


def _checked(content: object) -> Result:
    """Return the result in a JSON value.

    Raises:
        ValueError: If an entry is missing, unknown or not allowed.
    """
    entries = _record("the file", content, ENTRIES)
    one_of("format", entries["format"], [FORMAT])
    if type(entries["protocol"]) is not int or entries["protocol"] != PROTOCOL:
        raise invalid("protocol", entries["protocol"], PROTOCOL)
    package = _record("package", entries["package"], ("jansen_env", "python", "numpy"))
    plants = _record("plants", entries["plants"], ("projection", "rigid_body"))
    tracks = instance("tracks", entries["tracks"], dict)
    if not tracks or not {*tracks} <= {*TRACKS}:
        raise invalid("tracks", [*tracks], f"some of {[*TRACKS]}")
    return Result(
        check_text("name", entries["name"]),
        {name: check_text(f"package.{name}", value) for name, value in package.items()},
        check_text("processor", entries["processor"]),
        {name: _matching(f"plants.{name}", v, PLANT_HASH) for name, v in plants.items()},
        {
            name: _checked_track(track, tracks[name])
            for name, track in TRACKS.items()
            if name in tracks
        },
    )


def _checked_track(track: Track, content: object) -> TrackResult:
    """Return the result on a track in a JSON value.

    Raises:
        ValueError: If an entry is missing, unknown or not allowed.
    """
    entries = _record(track.name, content, TRACK_ENTRIES)
    if entries["seeds"] != track.seeds_sha256:
        raise invalid(f"{track.name}.seeds", entries["seeds"], track.seeds_sha256)
    digest = entries["sha256"]
    lists = _record(f"{track.name}.episodes", entries["episodes"], COLUMNS)
    count = len(track.episodes.seed)
    return TrackResult(
        check_text(f"{track.name}.policy", entries["policy"]),
        None if digest is None else _matching(f"{track.name}.sha256", digest, SHA256),
        {
            name: _numbers(
                f"{track.name}.episodes.{name}",
                lists[name],
                count,
                least=0.0 if name in (*WHOLE, *NOT_NEGATIVE) else -LARGEST,
                whole=name in WHOLE,
            )
            for name in COLUMNS
        },
    )


def _record(name: str, value: object, keys: tuple[str, ...]) -> dict[str, Any]:
    """Return a JSON object after checking that it has exactly these keys."""
    record: dict[str, Any] = instance(name, value, dict)
    if {*record} != {*keys}:
        raise invalid(f"entries of {name}", sorted(record), f"exactly {sorted(keys)}")
    return record


def check_text(name: str, value: object) -> str:
    """Return a text after checking that it is short and contains no markup.

    Args:
        name: Name of the text, for error messages.
        value: The text.

    Raises:
        ValueError: If it is not a text, is too long, or contains characters other than
            :data:`TEXT`.
    """
    return _matching(name, value, TEXT)


def _matching(name: str, value: object, pattern: re.Pattern[str]) -> str:
    """Return a text after checking that it matches a pattern."""
    if not isinstance(value, str) or not pattern.fullmatch(value):
        raise invalid(name, value, f"text that matches {pattern.pattern}")
    return value


def _numbers(
    name: str, value: object, count: int, least: float = -LARGEST, whole: bool = False
) -> Any:
    """Return a list of numbers as an array after checking their count and their range.

    Args:
        name: Name of the list, for error messages.
        value: The list.
        count: Required number of entries.
        least: Smallest allowed number.
        whole: Whether 0 and 1 are the only allowed numbers.
    """
    numbers = instance(name, value, list)
    if len(numbers) != count:
        raise ValueError(f"{name} must have {count} numbers, got {len(numbers)}")
    for number in numbers:
        plain = type(number) in (int, float)
        if not plain or not least <= number <= LARGEST or (whole and number not in (0, 1)):
            allowed = "0 or 1" if whole else f"numbers from {least:g} to {LARGEST:g}"
            raise invalid(f"each of {name}", number, allowed)
    return np.array(numbers, float)
