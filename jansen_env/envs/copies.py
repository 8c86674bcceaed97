"""Environments that several threads may use: whole calls, and whole copies."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

from jansen_env.world.settings import Values

P = ParamSpec("P")
T = TypeVar("T")
AnEnv = TypeVar("AnEnv", bound="WholeCopies")


class WholeCopies:
    """Mixin of environments whose copies and pickles are taken between two calls.

    Attributes:
        lock: Lock of the task, which a call holds from its beginning to its end.
    """

    task: Any

    @property
    def lock(self) -> Any:
        return self.task.lock

    def __getstate__(self) -> Values:
        """Return a copy of the attributes, which no other thread changes any more."""
        with self.lock:
            # Attributes that refer to this environment go on doing so.
            return deepcopy(self.__dict__, {id(self): self})

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        kind = type(self)
        copied = memo[id(self)] = kind.__new__(kind)
        with self.lock:
            # The attributes themselves need no copy before they are copied.
            own = kind.__getstate__ is not WholeCopies.__getstate__
            state = deepcopy(self.__getstate__() if own else self.__dict__, memo)
        if hasattr(copied, "__setstate__"):
            copied.__setstate__(state)
        else:
            copied.__dict__.update(state)
        return copied


def exclusive(
    method: Callable[Concatenate[AnEnv, P], T],
) -> Callable[Concatenate[AnEnv, P], T]:
    """Decorator: let no other thread use the environment during a call."""

    @wraps(method)
    def call(self: AnEnv, /, *args: P.args, **kwargs: P.kwargs) -> T:
        with self.lock:
            return method(self, *args, **kwargs)

    return call
