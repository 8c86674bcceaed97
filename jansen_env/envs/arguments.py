"""Arguments of Gymnasium's environments, checked in one place.

All functions raise ValueError for anything else than they describe.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from jansen_env import checks
from jansen_env.arrays import Array, Bools
from jansen_env.rendering import Renderer
from jansen_env.world.settings import Values, entries_of

MOST_ROBOTS = 1_000_000  # of a vector environment: gigabytes
MOST_EPISODE_STEPS = 2**53  # the largest number up to which floats count one by one
OF_BATCHES = ("num_envs", "max_episode_steps", "autoreset_mode", "threads", "info_keys")
"""Arguments of vector environments alone."""


def make_settings(env: object, single: Any, arguments: Values, num_envs: int | None = None) -> Any:
    """Return the settings of ``env``'s task, with what is not given from the preset.

    ``single``: the environment of one robot with that task and preset.

    Raises:
        TypeError: an argument that the settings do not have; ValueError: a wrong one.
    """
    settings = single.TASK.SETTINGS
    known = {*settings.defaults(), *(OF_BATCHES if num_envs is not None else ())}
    if unknown := sorted(map(str, {*arguments} - known)):
        wrong = f"{type(env).__name__} got an unexpected keyword argument {unknown[0]!r}"
        raise TypeError(f"{wrong}, must be in {checks.listed(sorted(known), unknown[0])}")
    values = {**single.PRESET, **arguments}
    given = frozenset(arguments)
    return settings(**values, num_envs=num_envs, preset=single.PRESET, given=given)


def time_limit(name: str, limit: object) -> float:
    """Steps after which an episode is truncated; inf for None and ``gym.make``'s -1."""
    if limit is None or (isinstance(limit, Integral) and limit == -1):
        return math.inf
    return checks.positive_integer(name, limit, MOST_EPISODE_STEPS)


def broadcast_seeds(count: int, seed: object) -> list[int | None]:
    """``count`` seeds: seed, seed + 1, ..., those of a sequence, or None."""
    if seed is None:
        return [None] * count
    allowed = f"a whole number, or {count} of them"
    if isinstance(seed, Integral):
        first = checks.whole_number("seed", seed)
        return [*range(first, first + count)]
    seeds = checks.entries("seed", seed, allowed, count)
    return [None if entry is None else checks.whole_number("seed", entry) for entry in seeds]


def autoreset_mode(name: str, mode: object) -> AutoresetMode:
    """Gymnasium's :class:`AutoresetMode`, also by its value."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        allowed = [known.value for known in AutoresetMode]
        raise checks.invalid(name, mode, f"one of {allowed}") from None


def reset_mask(count: int, mask: object) -> Bools:
    """Which robots to reset (count,), all for None; TypeError for no array of bools."""
    if mask is None:
        return np.ones(count, bool)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        given = checks.shown(mask)
        raise TypeError(f"options['reset_mask'] must be an array of bools, got {given}")
    if mask.shape != (count,) or not mask.any():
        allowed = f"must have shape ({count},) and name one robot at least"
        raise ValueError(f"options['reset_mask'] is {checks.shown(mask)}, {allowed}")
    return mask


def reset_options(options: object) -> Values:
    """The options of ``reset``, a copy; none for None. Raises ValueError for anything else."""
    return {} if options is None else dict(checks.instance("options", options, dict))


def broadcast_options(count: int, options: Values) -> list[Values]:
    """The options of ``reset`` for each robot: arrays and lists have one entry for each."""
    columns = {
        name: entries_of(f"options[{name!r}]", value, count) for name, value in options.items()
    }
    return [{name: values[i] for name, values in columns.items()} for i in range(count)]


def single_action(action: object) -> Array:
    """The action (1,) of one robot as (1, 1); the number 0 stands for no torque."""
    if type(action) is int and action == 0:  # what gymnasium.utils.play does without a key
        return np.zeros((1, 1))
    values = checks.numbers_of(action)
    if values.shape != (1,) or not math.isfinite(values.item()):
        raise checks.invalid("action", action, "one finite number, shape (1,)")
    return values[None]


def vector_actions(actions: object, active: Bools) -> Array:
    """Return actions (n, 1) as numbers.

    Args:
        actions: One for each robot.
        active: Shape (n,), whether the robot's action must be finite.

    Raises:
        ValueError: If they are not one finite number for each active robot.
    """
    count = len(active)
    values = checks.numbers_of(actions)
    if values.ndim == 0:
        allowed = f"must be numbers, shape ({count}, 1)"
        raise ValueError(f"actions are {checks.shown(actions)}, {allowed}")
    if values.shape != (count, 1):
        raise ValueError(f"actions have shape {values.shape}, must have ({count}, 1)")
    if not np.isfinite(values).all():
        bad = np.flatnonzero(active & ~np.isfinite(values[:, 0]))
        if len(bad) > 0:
            raise ValueError(f"actions[{bad[0]}] must be finite, got {values[bad[0], 0]}")
    return values


def info_keys(value: object, known: Sequence[str]) -> tuple[str, ...] | None:
    """Keys of the information that is wanted; None: all."""
    if value is None:
        return None
    if not (isinstance(value, (list, tuple)) and all(isinstance(key, str) for key in value)):
        raise checks.invalid("info_keys", value, f"None or a list of {sorted(known)}")
    if unknown := sorted(set(value) - set(known)):
        allowed = checks.listed(sorted(known), unknown[0])
        raise ValueError(f"info_keys has {unknown}, must be of {allowed}")
    return tuple(value)


def complete_state(state: Values, example: Values) -> None:
    """Raises ValueError unless a state to go on from has all that ``example`` has, and random
    numbers."""
    if not isinstance(state, Mapping):
        raise ValueError(f"state is {checks.shown(state)}, must come from get_state()")
    if missing := sorted({*example} - {*state, "robot", "lengths"}):  # without: a robot's own
        raise ValueError(f"state lacks {missing}, must come from get_state()")
    try:
        np.random.PCG64(0).state = state["generator"]
    except Exception as error:  # of many types
        given = checks.shown(state["generator"])
        raise ValueError(f"state['generator'] is {given}, must come from get_state()") from error


class Renderers(dict[int, Renderer]):
    """Renderers of the robots of an environment, by number; made when first needed."""

    def draw(self, env: Any, i: int) -> NDArray[np.uint8] | None:
        """Draw a robot; (H, W, 3) uint8, None in a window or without a ``render_mode``."""
        if env.render_mode is None:
            modes = env.metadata["render_modes"]
            gym.logger.warn(f"render() was called without a render_mode; pass one of {modes}")
            return None
        with env.task.lock:
            scene, frame = env.task.scene(i), env.task.frame(i)
        if i not in self:
            fps = env.metadata["render_fps"]
            self[i] = Renderer(**scene, mode=env.render_mode, fps=fps)
        self[i].show(**scene)  # which a reset may change
        return self[i].draw(frame)

    def close(self) -> None:
        """Close windows."""
        for renderer in self.values():
            renderer.close()
        self.clear()

    def __reduce__(self) -> tuple[type[Renderers], tuple[()]]:
        return Renderers, ()  # a copy draws with its own
