"""Columns of an environment's observation, by name: an observation that is added moves none."""

from __future__ import annotations

from typing import Any


def columns(env: Any, *names: str) -> list[int]:
    """Return where names stand in the observation of an environment, single or batched.

    Raises:
        ValueError: the environment does not show one of them.
    """
    shown = [entry.name for entry in env.unwrapped.observed]
    for name in names:
        if name not in shown:
            raise ValueError(f"name is {name!r}, must be one of {shown}")
    return [shown.index(name) for name in names]
