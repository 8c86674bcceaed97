"""Types of command-line arguments shared by the scripts."""

from __future__ import annotations

import argparse
from typing import Any

import yaml


def mapping(text: str) -> dict[str, Any]:
    """A YAML mapping such as ``{friction: 0.5}``, read without running code."""
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no YAML: {error}") from error
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError(f"{text!r} is no YAML mapping such as '{{friction: 0.5}}'")
    return value


def count(text: str) -> int:
    """A whole number above 0."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is below 1")
    return value


def steps(text: str) -> int:
    """A whole number, 0 or above."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is below 0")
    return value
