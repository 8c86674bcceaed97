"""What a page may ask of a session: messages of one JSON object, held to a strict schema.

``{"do": "set", "name": "friction", "value": 0.3}`` is an action of
:class:`jansen_env.play.session.Session` and its arguments. Nothing else passes: no other action, no
missing, other or repeated field, no value of another type, no number that is not finite.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from jansen_env.checks import shown

LONGEST_TEXT = 40  # characters of a text in a message


def _number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond a float's range
        return False


def _text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST_TEXT


def _flag(value: Any) -> bool:
    return isinstance(value, bool)


def _key(value: Any) -> bool:
    return type(value) is int and value in (-1, 0, 1)


def _choice(value: Any) -> bool:
    return _text(value) or type(value) is int


FIELDS: dict[str, dict[str, tuple[Callable[[Any], bool], str]]] = {
    "steer": {"value": (_number, "a finite number")},
    "hold": {"direction": (_key, "-1, 0 or 1")},
    "set": {"name": (_text, "a short text"), "value": (_number, "a finite number")},
    "choose": {"name": (_text, "a short text"), "value": (_choice, "a short text or whole number")},
    "push": {"x": (_number, "a finite number"), "y": (_number, "a finite number")},
    "pause": {"value": (_flag, "true or false")},
    "slow": {"value": (_number, "a finite number")},
    "reset": {},
    "another": {},
}
"""Of each action its arguments: what checks them, and what that allows."""


def parse(message: str | bytes) -> tuple[str, dict[str, Any]]:
    """An action of a session, and its arguments, from a message.

    Raises:
        ValueError: it is no text, no JSON, or does not fit :data:`FIELDS`.
    """
    if not isinstance(message, str):
        raise ValueError("message is binary, must be text")
    try:
        found = json.loads(message, parse_constant=_refuse, object_pairs_hook=_once)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"message is {shown(message)}, must be JSON") from error
    if not isinstance(found, dict) or not isinstance(action := found.pop("do", None), str):
        raise ValueError(f"message is {shown(message)}, must be an object that says what to do")
    if action not in FIELDS:
        raise ValueError(f"do is {shown(action)}, must be one of {list(FIELDS)}")
    fields = FIELDS[action]
    if {*found} != {*fields}:
        raise ValueError(f"{action} has {shown(sorted(found))}, must have {sorted(fields)}")
    for name, (fits, allowed) in fields.items():
        if not fits(found[name]):
            raise ValueError(f"{name} is {shown(found[name])}, must be {allowed}")
    return action, found


def _refuse(constant: str) -> Any:
    raise ValueError(f"{constant} is no JSON")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose fields are there once each."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a field is there twice")
    return found
