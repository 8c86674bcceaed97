"""Checks of the arguments of Gymnasium environments, collected in one place.

All functions raise ValueError for values that are not as described, unless stated otherwise.
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
from typing_extensions import override

from jansen_env import checks
from jansen_env.arrays import Array, Bools
from jansen_env.world.rendering import Renderer
from jansen_env.world.settings import Values, entries_of

MOST_ROBOTS = 1_000_000  # largest number of robots of a vector environment, which take gigabytes
MOST_EPISODE_STEPS = 2**53  # largest number up to which floats represent every integer
OF_BATCHES = ("num_envs", "max_episode_steps", "autoreset_mode", "threads", "info_keys")
"""Arguments that only vector environments have."""


def make_settings(env: object, single: Any, arguments: Values, num_envs: int | None = None) -> Any:
    """Return the checked settings of an environment's task.

    Values that the user does not specify come from the preset.

    Args:
        env: The environment.
        single: Class of the environment of one robot with the same task and preset.
        arguments: Arguments that the user specifies.
        num_envs: Number of robots of a vector environment. None for an environment of one robot.

    Raises:
        TypeError: If the settings do not have an argument of this name.
        ValueError: If the value of an argument is not allowed.
    """
    settings = single.TASK.SETTINGS
    known = {*settings.defaults(), *(OF_BATCHES if num_envs is not None else ())}
    if unknown := sorted(map(str, {*arguments} - known)):
        wrong = f"{type(env).__name__} got an unexpected keyword argument {unknown[0]!r}"
        raise TypeError(f"{wrong}; valid names are {checks.listed(sorted(known), unknown[0])}")
    values = {**single.PRESET, **arguments}
    given = frozenset(arguments)
    return settings(**values, num_envs=num_envs, preset=single.PRESET, given=given)


def time_limit(name: str, limit: object) -> float:
    """Return the number of steps after which an episode is truncated.

    Args:
        name: Name of the argument, for the error message.
        limit: Number of steps. None, and the -1 of ``gym.make``, stand for no limit.

    Returns:
        The number of steps, or inf for no limit.
    """
    if limit is None or (isinstance(limit, Integral) and limit == -1):
        return math.inf
    return checks.positive_integer(name, limit, MOST_EPISODE_STEPS)


def broadcast_seeds(count: int, seed: object) -> list[int | None]:
    """Return one seed per robot.

    Args:
        count: Number of robots.
        seed: From an integer, the seeds are seed, seed + 1, ... From a sequence, they are its
            entries. None stands for no seeds.

    Returns:
        A list of ``count`` seeds, or None where there is no seed.
    """
    if seed is None:
        return [None] * count
    allowed = f"a whole number, or {count} whole numbers"
    if isinstance(seed, Integral):
        first = checks.whole_number("seed", seed)
        return [*range(first, first + count)]
    seeds = checks.entries("seed", seed, allowed, count)
    return [None if entry is None else checks.whole_number("seed", entry) for entry in seeds]


def autoreset_mode(name: str, mode: object) -> AutoresetMode:
    """Return an :class:`AutoresetMode` of Gymnasium.

    Args:
        name: Name of the argument, for the error message.
        mode: The mode, or the value of the mode.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        allowed = [known.value for known in AutoresetMode]
        raise checks.invalid(name, mode, f"one of {allowed}") from None


def reset_mask(count: int, mask: object) -> Bools:
    """Return which robots to reset, shape (count,).

    Args:
        count: Number of robots.
        mask: Whether to reset each robot, shape (count,). None for all robots.

    Raises:
        TypeError: If ``mask`` is not an array of bools.
        ValueError: If ``mask`` has another shape or selects no robot.
    """
    if mask is None:
        return np.ones(count, bool)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        given = checks.shown(mask)
        raise TypeError(f"options['reset_mask'] must be an array of bools, got {given}")
    if mask.shape != (count,) or not mask.any():
        allowed = f"of shape ({count},) and select at least one robot"
        raise checks.invalid("options['reset_mask']", mask, allowed)
    return mask


def reset_options(options: object) -> Values:
    """Return a copy of the options of ``reset``, which is empty for None."""
    return {} if options is None else dict(checks.instance("options", options, dict))


def broadcast_options(count: int, options: Values) -> list[Values]:
    """Return the options of ``reset`` for each robot.

    Args:
        count: Number of robots.
        options: Options by name: one value for all robots, or an array or list with one entry per
            robot.
    """
    columns = {
        name: entries_of(f"options[{name!r}]", value, count) for name, value in options.items()
    }
    return [{name: values[i] for name, values in columns.items()} for i in range(count)]


def single_action(action: object) -> Array:
    """Return the action of one robot, shape (1,), as an array of shape (1, 1).

    The integer 0 stands for no torque.
    """
    if type(action) is int and action == 0:  # gymnasium.utils.play sends it if no key is pressed
        return np.zeros((1, 1))
    values = checks.numbers_of(action)
    if values.shape != (1,) or not math.isfinite(values.item()):
        raise checks.invalid("action", action, "one finite number, shape (1,)")
    return values[None]


def vector_actions(actions: object, active: Bools) -> Array:
    """Return the actions of n robots as an array of numbers, shape (n, 1).

    Args:
        actions: One action per robot, shape (n, 1).
        active: Whether the action of each robot must be finite, shape (n,).

    Raises:
        ValueError: If the actions are not one number per robot, or if the action of an active robot
            is not finite.
    """
    count = len(active)
    values = checks.numbers_of(actions)
    if values.ndim == 0:
        raise checks.invalid("actions", actions, f"numbers, shape ({count}, 1)")
    if values.shape != (count, 1):
        raise ValueError(f"actions must have the shape ({count}, 1), got {values.shape}")
    if not np.isfinite(values).all():
        bad = np.flatnonzero(active & ~np.isfinite(values[:, 0]))
        if len(bad) > 0:
            raise ValueError(f"actions[{bad[0]}] must be finite, got {values[bad[0], 0]}")
    return values


def info_keys(value: object, known: Sequence[str]) -> tuple[str, ...] | None:
    """Return the requested keys of the information, or None for all keys.

    Args:
        value: The requested keys. None for all keys.
        known: Keys that the environment provides.
    """
    if value is None:
        return None
    if not (isinstance(value, (list, tuple)) and all(isinstance(key, str) for key in value)):
        raise checks.invalid("info_keys", value, f"None or a list of {sorted(known)}")
    if unknown := sorted(set(value) - set(known)):
        allowed = f"one of {checks.listed(sorted(known), unknown[0])}"
        raise checks.invalid("an entry of info_keys", unknown[0], allowed)
    return tuple(value)


def complete_state(state: Values, example: Values) -> None:
    """Check that a saved state has all entries, so that a robot can be restored to it.

    Args:
        state: State to check. The entries "robot" and "lengths" may be missing.
        example: A complete state of the same environment.

    Raises:
        ValueError: If the state lacks an entry of ``example`` or has another one, or if its state
            of the random number generator is not valid.
    """
    if not isinstance(state, Mapping):
        raise checks.invalid("state", state, "a state that get_state() returned")
    optional = {"robot", "lengths"}  # without them, the robot is that of the arguments
    if missing := sorted({*example} - {*state} - optional):
        raise ValueError(f"state must come from get_state(), got one without {missing}")
    if unknown := sorted(map(str, {*state} - {*example} - optional)):
        allowed = f"one of {sorted({*example} | optional)}"
        raise checks.invalid("a key of state", unknown[0], allowed)
    try:
        np.random.PCG64(0).state = state["generator"]
    except Exception as error:  # NumPy raises errors of many types
        given = state["generator"]
        allowed = "the state of a generator from get_state()"
        raise checks.invalid("state['generator']", given, allowed) from error


class Renderers(dict[int, Renderer]):
    """Renderers of the robots of an environment, by index; created when they are first needed."""

    def draw(self, env: Any, i: int) -> NDArray[np.uint8] | None:
        """Draw a robot.

        Args:
            env: The environment.
            i: Index of the robot.

        Returns:
            The picture, uint8, shape (H, W, 3). None in a window or without a ``render_mode``.
        """
        if env.render_mode is None:
            modes = env.metadata["render_modes"]
            gym.logger.warn(f"render() was called without a render_mode; pass one of {modes}")
            return None
        with env.task.lock:
            scene = env.task.scene(i)
            frame = env.task.frame(i)
        if i not in self:
            fps = env.metadata["render_fps"]
            self[i] = Renderer(**scene, mode=env.render_mode, fps=fps)
        self[i].show(**scene)  # a reset may have changed the scene
        return self[i].draw(frame)

    def close(self) -> None:
        """Close all windows and forget the renderers."""
        for renderer in self.values():
            renderer.close()
        self.clear()

    @override
    def __reduce__(self) -> tuple[type[Renderers], tuple[()]]:
        return Renderers, ()  # a copy of an environment creates renderers of its own
