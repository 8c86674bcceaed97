"""Types of command-line arguments shared by the scripts."""

from __future__ import annotations

import argparse
import math
from functools import partial
from typing import Any

from agents.plain_yaml import parse_yaml

MAX_STEPS = 10**10  # environment steps of one run: months of training


def mapping(text: str) -> dict[str, Any]:
    """A YAML mapping such as ``{friction: 0.5}``, read by
    :func:`agents.plain_yaml.parse_yaml`."""
    try:
        value = parse_yaml(text, repr(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError(f"{text!r} is no YAML mapping such as '{{friction: 0.5}}'")
    return value


def positive_int(text: str, low: int = 1) -> int:
    """A whole number from ``low`` to :data:`MAX_STEPS`, also written ``1e5``."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (low <= value <= MAX_STEPS and value.is_integer()):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not allowed, must be a whole number from {low} to {MAX_STEPS}"
        )
    return int(value)


non_negative_int = partial(positive_int, low=0)
