"""Robot files, which contain all fields of a :class:`jansen_env.Robot` as JSON.

Robot files are checked completely when they are read. Instead of all fields, a robot file may
contain a built-in design with other link lengths, as the bench (``docs/bench.md``) writes it:
``"design": "paper", "lengths": {"rocker": 0.24}`` in addition to the format. See
:func:`jansen_env.robot.lengths.with_lengths`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from jansen_env.checks import (
    AsManyAs,
    AtLeast,
    FiniteWith,
    Limits,
    Rule,
    invalid,
    listed,
    named_errors,
    one_of,
    shown,
)
from jansen_env.files import read_bounded, write_json
from jansen_env.robot.buildable import BUILDS
from jansen_env.robot.designs import ROBOTS
from jansen_env.robot.lengths import with_lengths
from jansen_env.robot.linkage import LARGEST_NUMBER, Linkage
from jansen_env.robot.links import Bar, Compliance, Leg, Payload, Plate, Triangle
from jansen_env.robot.motor import Motor
from jansen_env.robot.robot import Robot
from jansen_env.robot.spring import Spring, TorsionSpring

FORMAT = "jansen_env robot 1"
MAX_BYTES = 2**20  # largest size of a file
OF_DESIGN = {"design", "lengths"}  # entries of a file that contains a design with other lengths
PARTS: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        Robot,
        Linkage,
        Bar,
        Triangle,
        Plate,
        Leg,
        Payload,
        Motor,
        Compliance,
        Spring,
        TorsionSpring,
    )
}
"""Classes of the parts that a file may contain, by the name in the entry ``"is"`` of a part."""


def robot_to_json(robot: Robot) -> dict[str, object]:
    """Return a robot as a mapping that can be written as JSON.

    Each part of the robot is a mapping of its fields. The entry "is" names the kind of the part. A
    field that is infinite is left out, and so are the springs of a robot without springs.
    """
    return {"format": FORMAT, **_part_to_json(robot)}


def robot_from_json(content: object) -> Robot:
    """Return the robot in the content of a robot file.

    This function does not check whether the robot can turn its crank and stand. That is checked
    when the robot is loaded; see :mod:`jansen_env.robot.soundness`.

    Args:
        content: Result of :func:`robot_to_json`, or a design with other lengths.

    Raises:
        ValueError: If the content is not a valid robot. The message is one line.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, Mapping) else None
        raise invalid("the format of a robot file", found, repr(FORMAT))
    given = {name: value for name, value in content.items() if name != "format"}
    if "design" in given:
        if {*given} != OF_DESIGN:
            wrong = "without" if len(given) < len(OF_DESIGN) else "with"
            names = shown(sorted(OF_DESIGN ^ {*given}))
            raise ValueError(
                f"a robot file of a design must have 'format', 'design' and 'lengths', got one "
                f"{wrong} {names}"
            )
        return with_lengths(ROBOTS[one_of("design", given["design"], ROBOTS)](), given["lengths"])
    robot = _from_json(given)
    if not isinstance(robot, Robot):
        raise ValueError(f"a robot file must contain a Robot, got {shown(content.get('is'))}")
    return robot


def write_robot(path: str | Path, robot: Robot) -> Path:
    """Write a robot file atomically.

    Args:
        path: Path of the file, which must end in .json.
        robot: The robot.

    Returns:
        The path of the file.

    Raises:
        ValueError: If the path does not end in .json.
        OSError: If the file cannot be written.
    """
    if Path(path).suffix != ".json":
        raise ValueError(f"path must end in .json, got {path}")
    return write_json(path, robot_to_json(robot))


def read_robot(path: str | Path) -> Robot:
    """Read a robot file.

    Args:
        path: Path of the file.

    Raises:
        ValueError: If the file cannot be read, or does not contain a valid robot. The message names
            the file.
    """
    with named_errors(f"{path} is not a robot file", RecursionError):
        return robot_from_json(json.loads(read_bounded(path, MAX_BYTES)))


def _part_to_json(part: object) -> dict[str, object]:
    """Return a part of a robot as a mapping that can be written as JSON."""
    values = {field.name: getattr(part, field.name) for field in fields(part)}  # type: ignore[arg-type]
    if isinstance(part, Robot) and not part.springs:
        del values["springs"]  # this entry is optional
    kept = {name: _to_json(value) for name, value in values.items() if value != math.inf}
    return {"is": type(part).__name__, **kept}


def _to_json(value: object) -> object:
    """Return the value of a field in the form in which it is written as JSON."""
    if is_dataclass(value):
        return _part_to_json(value)
    return [_to_json(entry) for entry in value] if isinstance(value, tuple) else value


def _from_json(value: object) -> object:
    """Return the value of a field, or a part, from its form in JSON.

    Raises:
        ValueError: If a part is not valid.
    """
    if isinstance(value, list):
        return tuple(_from_json(entry) for entry in value)
    if not isinstance(value, Mapping):
        return value
    kind = value.get("is")
    if not isinstance(kind, str) or kind not in PARTS:
        raise ValueError(f"a part must be one of {[*PARTS]}, got {shown(kind)}")
    known = [field.name for field in fields(PARTS[kind])]
    given = {name: _from_json(part) for name, part in value.items() if name != "is"}
    if unknown := [name for name in given if name not in known]:
        allowed = listed(known, unknown[0])
        raise invalid(f"a key of a {kind}", unknown[0], f"one of {allowed}")
    required = [field.name for field in fields(PARTS[kind]) if _is_required(field)]
    if missing := [name for name in required if name not in given]:
        raise ValueError(f"a {kind} must have the key {missing[0]!r}, got one without it")
    with named_errors(f"a {kind} is wrong", TypeError):
        return PARTS[kind](**given)


def _is_required(field: Field[Any]) -> bool:
    """Return whether a field of a part has no default."""
    return field.default is MISSING and field.default_factory is MISSING


def file_schema() -> dict[str, dict[str, Any]]:
    """Return a description of robot files as JSON, for other programs that check such files.

    Returns:
        For each part, by the name in its entry ``"is"``, the ``"fields"`` and the ``"rules"`` of
        the part.

        A field has a ``"kind"`` (see :func:`_kind_of`) and a ``"default"``, the value that the
        field has if it is missing from a file. The default None stands for infinity, and
        ``{"as": other}`` stands for the value of another field. A field without a default is
        required. The fields of a linkage that Python derives from other fields if they are missing
        are required, too.

        A rule is one of the following:

        - ``{"sum": fields, "number": limits}`` or ``{"product": fields, "number": limits}``,
        - ``{"with": field, "finite": other}``, which means that ``other`` must be finite if
          ``field`` is neither 0 nor infinite,
        - ``{"field": field, "least": count}`` for a list with at least ``count`` entries,
        - ``{"field": field, "other": path}`` for a list with as many entries as another list.
    """
    return {
        name: {
            "fields": _fields_of(kind),
            "rules": [_rule_to_json(rule) for rule in getattr(kind, "RULES", ())],
        }
        for name, kind in PARTS.items()
    }


def _rule_to_json(rule: Rule) -> dict[str, Any]:
    """Return a rule in the form of :func:`file_schema`."""
    if isinstance(rule, FiniteWith):
        return {"with": rule.field, "finite": rule.other}
    if isinstance(rule, AtLeast | AsManyAs):
        return rule._asdict()
    return {rule.operation: rule.fields, "number": _limits_to_json(rule.limits)}


def _fields_of(part: type) -> dict[str, dict[str, Any]]:
    """Return the fields of a part in the form of :func:`file_schema`."""
    hints = get_type_hints(part, include_extras=True)
    schema: dict[str, dict[str, Any]] = {
        field.name: {"kind": _kind_of(hints[field.name]), **_default_of(part, field)}
        for field in fields(part)
    }
    if part is Robot:
        schema["material"]["kind"] = {"one": [*BUILDS]}
    return schema


def _default_of(part: type, field: Field[Any]) -> dict[str, object]:
    """Return a mapping with the ``"default"`` of a field of a part, or an empty mapping.

    The mapping is empty if there is no default, or if Python derives it from other fields.
    """
    value = dict(field.metadata) or field.default
    if field.default_factory is not MISSING:
        value = field.default_factory()
    if value is MISSING or (part is Linkage and value in ("", ())):
        return {}
    return {"default": None if value == math.inf else _to_json(value)}


def _kind_of(hint: Any) -> dict[str, Any]:
    """Return the values that a type allows, as JSON.

    Returns:
        One of ``{"number": limits}``, ``{"whole": most}`` for a whole number from ``-most`` to
        ``most``, ``{"type": "boolean"}`` (or "string"), ``{"one": values}``, ``{"parts": names}``,
        ``{"each": kind}`` for the entries of a list, and ``{"row": kinds}`` for a list with a fixed
        number of entries. See :func:`_limits_to_json` for the limits.
    """
    origin = get_origin(hint)
    arguments = get_args(hint)
    if origin is Annotated:
        limits = next(part for part in arguments if isinstance(part, Limits))
        return {"number": _limits_to_json(limits)}
    if origin is Literal:
        return {"one": [*arguments]}
    if origin is tuple and arguments[-1] is Ellipsis:
        return {"each": _kind_of(arguments[0])}
    if origin is tuple:
        return {"row": [_kind_of(each) for each in arguments]}
    if origin in (Union, UnionType):
        return {"parts": [each.__name__ for each in arguments if each is not NoneType]}
    if hint in PARTS.values():
        return {"parts": [hint.__name__]}
    if issubclass(hint, tuple):  # a NamedTuple
        return {"row": [_kind_of(each) for each in get_type_hints(hint).values()]}
    if hint is int:
        return {"whole": LARGEST_NUMBER}
    return {"type": {bool: "boolean", str: "string"}[hint]}


def _limits_to_json(limits: Limits) -> dict[str, Any]:
    """Return limits as JSON: ``least``, ``most``, ``above``, and the text ``allowed``.

    None stands for infinity, that is, for no limit.
    """
    least = None if math.isinf(limits.least) else limits.least
    most = None if math.isinf(limits.most) else limits.most
    return {"least": least, "most": most, "above": limits.above, "allowed": limits.allowed}
