"""Types of command-line arguments shared by the scripts."""

from __future__ import annotations

import argparse
from typing import Any

from agents.plain_yaml import parse_yaml

MOST = 10**10  # environment steps of one run: months of training


def mapping(text: str) -> dict[str, Any]:
    """A YAML mapping such as ``{friction: 0.5}``, read as :func:`agents.plain_yaml.parse_yaml`."""
    try:
        value = parse_yaml(text, repr(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError(f"{text!r} is no YAML mapping such as '{{friction: 0.5}}'")
    return value


def count(text: str) -> int:
    """A whole number above 0."""
    return _whole(text, 1)


def steps(text: str) -> int:
    """A whole number, 0 or above."""
    return _whole(text, 0)


def _whole(text: str, low: int) -> int:
    """Text as a whole number from ``low`` to :data:`MOST`."""
    try:
        value = int(text)
    except ValueError:
        value = low - 1
    if not low <= value <= MOST:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not allowed, must be a whole number from {low} to {MOST}"
        )
    return value
