"""Keyword arguments as a few frozen records: machine, control, ground, randomness, sensing."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from jansen_env.robot import Compliance, Payload, Robot
from jansen_env.robot.motor import Motor
from jansen_env.terrain import Terrain
from jansen_env.terrain.curriculum import Curriculum
from jansen_env.world.noise import Noise
from jansen_env.world.push import Push


def per_robot(default: Any) -> Any:
    """Return a field of a record that may be one for all robots or one for each."""
    return field(default=default, metadata={"per_robot": True})


def single_only(default: Any) -> Any:
    """Return a field of a record that must have its default where there are several robots."""
    return field(default=default, metadata={"single_only": True})


@dataclass(frozen=True)
class Machine:
    """The robot. A torque limit of None is the motor's, other Nones are the robot's own."""

    robot: Robot | str = "paper"
    payload: Payload | float | Any = per_robot(None)
    motor: Motor | str | Any = per_robot(None)
    torque_limit: float | Any = per_robot(None)
    pad_compliance: Compliance | Any = per_robot(None)


@dataclass(frozen=True)
class Control:
    """Actuation and simulation; times in s."""

    delay: float | tuple[float, float] | Any = per_robot(0.0)
    control_dt: float = 0.02
    time_step: float | None = None
    plant: str = single_only("projection")
    track_joint_forces: bool = single_only(False)


@dataclass(frozen=True)
class Ground:
    """The terrain, or how it is drawn."""

    terrain: Terrain | str | Any = per_robot("flat")
    friction: float | Any = per_robot(None)
    restitution: float | Any = per_robot(None)
    terrain_level: int | tuple[int, int] | Any = per_robot(0)
    curriculum: Curriculum | bool | None = None


@dataclass(frozen=True)
class Randomness:
    """Randomisation between episodes; the starting crank speed in rad/s."""

    randomize: Mapping[str, Any] | Any = per_robot(None)
    reset_noise_scale: float | Any = per_robot(0.1)


@dataclass(frozen=True)
class Sensing:
    """Sensors, their noise, and pushes."""

    height_scan: tuple[float, float, int] | None = None
    noise: Noise | Mapping[str, Any] | None = None
    push: Push | Mapping[str, Any] | None = None


Records = Mapping[str, type]
"""Types of records by the names under which they are passed."""


def signature_of(records: Records, before: Callable[..., Any]) -> inspect.Signature:
    """Return a signature with the fields of all records as keywords, after those of ``before``."""
    shown = [p for p in inspect.signature(before).parameters.values() if p.kind != p.VAR_KEYWORD]
    keywords = [
        inspect.Parameter(
            one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=one.type
        )
        for kind in records.values()
        for one in fields(kind)
    ]
    return inspect.Signature(shown + keywords)


def marked(records: Records, mark: str) -> dict[str, Any]:
    """Return the defaults of the records' fields with a mark, such as "per_robot", by name."""
    return {
        one.name: one.default
        for kind in records.values()
        for one in fields(kind)
        if one.metadata.get(mark)
    }


def fill(records: Records, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return the records with keywords put into them.

    Raises:
        TypeError: no record has a field of a keyword's name.
    """
    names = {name: {one.name for one in fields(kind)} for name, kind in records.items()}
    if unknown := sorted({*keywords} - set().union(*names.values())):
        allowed = sorted(set().union(*names.values()))
        raise TypeError(f"unexpected keyword argument {unknown[0]!r}, must be in {allowed}")
    return {
        name: kind(**{key: keywords[key] for key in names[name] if key in keywords})
        for name, kind in records.items()
    }
