"""Messages of a page to a session: one JSON object each, an action and exactly its arguments.

``{"do": "set", "name": "friction", "value": 0.3}`` is an action of
:class:`jansen_env.play.session.Session` and its arguments, whose values the session checks.
"""

from __future__ import annotations

import json
from typing import Any

from jansen_env.checks import one_of, shown

ACTIONS = {
    "steer": {"value"},
    "hold": {"direction"},
    "set": {"name", "value"},
    "choose": {"name", "value"},
    "build": {"robot", "lengths"},
    "push": {"x", "y"},
    "pause": {"value"},
    "slow": {"value"},
    "reset": set[str](),
    "another": set[str](),
    "replay": set[str](),
}
"""Arguments of each action; nothing else of a session can be reached."""


def parse(message: str | bytes) -> tuple[str, dict[str, Any]]:
    """Return an action of a session, and its arguments, from a message.

    Raises:
        ValueError: it is no text, no JSON, no action or has other arguments.
    """
    if not isinstance(message, str):
        raise ValueError("message is binary, must be text")
    try:
        content = json.loads(message)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"message is {shown(message)}, must be JSON") from error
    if not isinstance(content, dict) or "do" not in content:
        raise ValueError(f"message is {shown(message)}, must be an object that says what to do")
    action = one_of("do", content.pop("do"), ACTIONS)
    if {*content} != ACTIONS[action]:
        raise ValueError(
            f"{action} has {shown(sorted(content))}, must have {sorted(ACTIONS[action])}"
        )
    return action, content
