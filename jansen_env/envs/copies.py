"""Thread safety of environments: exclusive calls, and copies made between two calls."""

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
    """Mixin for environments that are copied and pickled only between two calls.

    Attributes:
        lock: Lock of the task. A call holds it from its beginning to its end.
    """

    task: Any

    @property
    def lock(self) -> Any:
        """Lock of the task."""
        return self.task.lock

    def __getstate__(self) -> Values:
        """Return a copy of the attributes, which other threads can no longer change."""
        with self.lock:
            # Attributes that refer to this environment still refer to it in the copy.
            return deepcopy(self.__dict__, {id(self): self})

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        kind = type(self)
        copied = memo[id(self)] = kind.__new__(kind)
        with self.lock:
            # The __getstate__ of this class would copy the attributes once more; skip it.
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
    """Decorate a method so that no other thread can use the environment during a call.

    Args:
        method: Method of an environment. Each call of it holds the lock of the environment.
    """

    @wraps(method)
    def call(self: AnEnv, /, *args: P.args, **kwargs: P.kwargs) -> T:
        with self.lock:
            return method(self, *args, **kwargs)

    return call
