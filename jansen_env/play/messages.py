"""Messages of a page to a session: one JSON object each, held to a strict schema.

``{"do": "set", "name": "friction", "value": 0.3}`` is an action of
:class:`jansen_env.play.session.Session` and its arguments. Nothing else passes: no other action, no
missing, other or repeated field, no value of another type, no number that is not finite.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import Any

from jansen_env.checks import finite, instance, one_of, shown

LONGEST_TEXT = 40  # characters of a text in a message
MOST_LENGTHS = 32  # in a message


def _text(name: str, value: Any) -> None:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ValueError(f"{name} is {shown(value)}, must be a short text")


def _key(name: str, value: Any) -> None:
    if type(value) is not int or value not in (-1, 0, 1):
        raise ValueError(f"{name} is {shown(value)}, must be -1, 0 or 1")


def _choice(name: str, value: Any) -> None:
    if type(value) is not int:
        _text(name, value)


def _lengths(name: str, value: Any) -> None:
    if not isinstance(value, dict) or len(value) > MOST_LENGTHS:
        raise ValueError(f"{name} is {shown(value)}, must have at most {MOST_LENGTHS} lengths")
    for key, length in value.items():
        _text("a name", key)
        finite(key, length)


FIELDS: dict[str, dict[str, Callable[[str, Any], Any]]] = {
    "steer": {"value": finite},
    "hold": {"direction": _key},
    "set": {"name": _text, "value": finite},
    "choose": {"name": _text, "value": _choice},
    "build": {"robot": _text, "lengths": _lengths},
    "push": {"x": finite, "y": finite},
    "pause": {"value": partial(instance, kind=bool)},
    "slow": {"value": finite},
    "reset": {},
    "another": {},
    "replay": {},
}
"""Arguments of each action, and their checks."""


def parse(message: str | bytes) -> tuple[str, dict[str, Any]]:
    """Return an action of a session, and its arguments, from a message.

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
    if {*found} != {*FIELDS[one_of("do", action, FIELDS)]}:
        raise ValueError(f"{action} has {shown(sorted(found))}, must have {sorted(FIELDS[action])}")
    for name, check in FIELDS[action].items():
        check(name, found[name])
    return action, found


def _refuse(constant: str) -> Any:
    raise ValueError(f"{constant} is no JSON")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(found := dict(pairs)) < len(pairs):
        raise ValueError("a field is there twice")
    return found
