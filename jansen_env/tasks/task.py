"""Base of tasks: observation, reward and end of episode of n robots in a world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from threading import RLock
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.checks import MOST_SINGLE, listed, number_range, robot_index, within
from jansen_env.plants.threads import forks
from jansen_env.rendering import Frame
from jansen_env.tasks.information import InfoBuilder
from jansen_env.uniform import uniform
from jansen_env.world.observations import Observed
from jansen_env.world.settings import Values, WorldSettings, flag, option
from jansen_env.world.world import Numbers, World

EVERY = slice(None)  # robot; as an index quicker than all their numbers


class Task(ABC):
    """A task of n robots. Environments of one robot and of many are made of it.

    A task is a page: the class attributes and four methods in plain NumPy over all n robots. They
    are called in this order: :meth:`draw` and :meth:`observe` at a reset; :meth:`reward`,
    :meth:`terminated` and :meth:`observe` after a step. They ask :attr:`world` by name, such as
    ``world.pitch``, and keep values in :attr:`info` with :meth:`keep`. :mod:`jansen_env.tasks.goal`
    is an example. :class:`jansen_env.tasks.compiled.CompiledTask` is the base of tasks that kernels
    reward.

    Args:
        settings: arguments. threads: cores to use; None: chosen by batch size.

    Attributes:
        SETTINGS: its arguments. OBSERVED: what it observes beside the world's observations.
        INFO: numbers and flags that it keeps of a robot, by name: shown in the information, saved
            in states, 0 at a reset but for what :meth:`draw` gives. TERMS: of the reward.
        OPTIONS: names of reset options. SETTABLE: of :meth:`set_parameters`, attributes (n, ...)
            of the task; both beside the world's.
        observed: each number of the observation, with its column in :attr:`columns`.
        observation_space, action_space: of one robot. observation: (n, d) the last ones.
        info: (n,) :attr:`INFO`. rewards: (n,) of the last step. ended: (n,) by termination.
        truncated: (n,) whether the simulation diverged. control_dt: s a step.
        lock: held while robots move or change.

    Raises:
        ValueError: an argument out of range or of no effect, or names that do not fit.
    """

    SETTINGS: ClassVar[type[WorldSettings]] = WorldSettings
    OBSERVED: ClassVar[tuple[Observed, ...]] = ()
    INFO: ClassVar[Mapping[str, type]] = {}
    TERMS: ClassVar[tuple[str, ...]] = ()
    OPTIONS: ClassVar[tuple[str, ...]] = ()
    SETTABLE: ClassVar[tuple[str, ...]] = ()
    # Record of a compiled task, in place of INFO and TERMS, and the observations that kernels fill.
    ROW: ClassVar[np.dtype[np.void] | None] = None
    COMPILED: ClassVar[tuple[str, ...]] = ()
    is_whole = False  # whether kernels do everything, so that no method is called after a step

    def __init__(self, settings: WorldSettings, threads: int | None = None) -> None:
        n = self.num_envs = settings.count
        self._check_declarations(settings)
        terms = [(name, float) for name in self.TERMS]
        row = np.dtype([("info", [*self.INFO.items()]), ("reward", terms)], align=True)
        self.world = World(settings, threads, row if self.ROW is None else self.ROW)
        self.control_dt, self.truncated = self.world.control_dt, self.world.truncated
        self.observed = self._order(self.world.observations) + tuple(self.world.lengths.entries)
        self.columns = {entry.name: place for place, entry in enumerate(self.observed)}
        if len(self.columns) < len(self.observed):
            raise ValueError(f"observations are {[*self.columns]}, must have different names")
        low, high = np.array([(entry.low, entry.high) for entry in self.observed], np.float32).T
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation = np.zeros((n, len(self.observed)), np.float32)
        self._which: Ints | slice = EVERY
        self.world.connect(self.observed, self.observation, self.COMPILED)
        self._make_lock()
        self._connect()
        with np.errstate(all="ignore"):
            self._observed()  # raises an error if a declared observation is not filled

    def _check_declarations(self, settings: WorldSettings) -> None:
        """Raise ValueError for settings or names that this class would ignore."""
        if settings.curriculum is not None and type(self).progress is Task.progress:
            raise ValueError("curriculum is given, must be None: this task defines no progress()")
        if both := sorted({*self.INFO} & {*self.TERMS}):
            raise ValueError(f"INFO and TERMS have {both}, must have different names")
        if self.ROW is not None:
            known = {*(self.ROW["info"].names or ()), *(self.ROW["reward"].names or ())}
            if unknown := sorted({*self.INFO, *self.TERMS} - known):
                allowed = f"must be in {sorted(known)}, those of the compiled task's ROW"
                raise ValueError(f"INFO and TERMS have {unknown}, {allowed}")

    def _connect(self) -> None:
        """Take the arrays of the records."""
        world, records = self.world, self.world.records
        robots: Any = records.robots
        self._records = records.data
        self.data: Rows = records.task
        self.info: Rows = self.data["info"]
        self.rewards: Array = robots["reward"]
        self.ended: Bools = robots["terminated"]
        self.information = InfoBuilder(
            records.data, world.information, world.energies, self.data, world.arrays, world.groups
        )
        self._terms: Rows = self.data["reward"]
        self._blank = np.zeros((), self.info.dtype), np.zeros((), self._terms.dtype)
        self._kept = frozenset(self.info.dtype.names or ())
        self._observes = {entry.name for entry in self.OBSERVED} - {*self.COMPILED}

    def _make_lock(self) -> None:
        """Make the lock that a call holds, as kernels write without Python's."""
        self.lock = RLock()  # a step resets other robots
        forks.watch(self)

    def _refresh(self) -> None:
        """Take the arrays of the records again if these have been made anew."""
        if self._records is not self.world.records.data:
            self._connect()

    # What a task is.

    def draw(self, i: int, rng: np.random.Generator, options: Values) -> Numbers:
        """Draw numbers of :attr:`INFO` of a robot's next episode; nothing may change yet."""
        return {}

    def observe(self) -> Mapping[str, Array]:
        """Return the numbers (n,) of :attr:`OBSERVED` by name, after a reset or a step."""
        return {}

    @abstractmethod
    def reward(self) -> Array:
        """Return the rewards (n,) of a step; the terms are kept with :meth:`keep`."""

    @abstractmethod
    def terminated(self) -> Bools:
        """Return whether episodes (n,) are over after a step."""

    def keep(self, **values: NDArray[np.generic]) -> None:
        """Keep numbers (n,) of :attr:`INFO` and :attr:`TERMS` of the robots of this step."""
        which = self._which
        for name, value in values.items():
            kept = "info" if name in self._kept else "reward"
            self.data[kept][name][which] = value[which]

    def progress(self, i: int) -> tuple[float, float]:
        """Return a robot's progress, m, and mean commanded speed, m/s, for a curriculum."""
        return 0.0, 0.0

    # What environments use.

    @property
    def command(self) -> Array | None:
        """(n,) commanded speeds, None for a task without."""
        return self.info["speed_command"] if "speed_command" in self._kept else None

    def reset(
        self,
        which: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[Values] | None = None,
    ) -> None:
        """Start episodes of robots (k,), each with its generator and the options of its reset.

        Raises:
            ValueError: an unknown option, or a value out of range. FloatingPointError: a robot
                diverges where it is placed. Nothing has changed then.
        """
        options = [{}] * len(which) if options is None else options
        for given in options:
            if given:
                self._check_options(given)
        with self.lock:
            before = [generator.bit_generator.state for generator in generators]
            try:
                drawn = self.world.reset(which, generators, options, self.draw, self.progress)
            except Exception:
                for generator, state in zip(generators, before, strict=True):
                    generator.bit_generator.state = state
                raise
            self._refresh()
            for i, numbers in zip(which.tolist(), drawn, strict=True):
                self._clear(i, numbers)
            self.world.begin_episodes(which)
            self._describe(which)

    def _check_options(self, given: Values) -> None:
        """Raise ValueError for an unknown option of a reset."""
        known = {*self.OPTIONS, *self.world.OPTIONS}
        if unknown := sorted({*given} - known):
            allowed = listed(sorted(known), unknown[0])
            raise ValueError(f"reset options {unknown} are unknown, must be in {allowed}")

    def _clear(self, i: int, numbers: Values) -> None:
        """Replace the values of :attr:`INFO` of a robot's last episode."""
        self.info[i], self._terms[i] = self._blank
        for name, value in numbers.items():
            self.info[name][i] = value

    def step(
        self, actions: Array, which: Ints | None, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold actions (n, 1) of robots (k,), None for all, see ``World.step``."""
        with self.lock:
            self.world.step(actions, which, meanwhile)
            if not self.is_whole:
                self._judge(which)

    def _judge(self, which: Ints | None) -> None:
        """Reward the step of robots (k,), end their episodes, and observe them."""
        part = self._which = EVERY if which is None else which
        self.rewards[part] = self.reward()[part]
        self.ended[part] = self.terminated()[part]
        self._fill(part)
        self.world.observe(which, True)

    def _observed(self) -> Mapping[str, Array]:
        """Return what :meth:`observe` does; ValueError: not what :attr:`OBSERVED` declares."""
        observed = self.observe()
        if observed.keys() != self._observes:
            needed = sorted(self._observes)
            kind = type(self).__name__
            raise ValueError(f"observe() of {kind} must return {needed}, got {[*observed]}")
        return observed

    def _fill(self, which: Ints | slice) -> None:
        """Fill the task's own observations of robots (k,)."""
        self._which = which
        for name, values in self._observed().items():
            self.observation[which, self.columns[name]] = values[which]

    def _describe(self, which: Ints) -> None:
        """Fill observations and information of robots (k,) as they are now."""
        if not self.is_whole:
            self._fill(which)
        self.world.observe(which, False)

    def push(self, i: int, impulse: object) -> None:
        """Push a robot from now on, see ``World.push``."""
        i = robot_index(i, self.num_envs)
        with self.lock:
            self.world.push(i, impulse)
            self._refresh()

    def set_parameters(self, i: int, **changes: object) -> None:
        """Change a robot from now on, see :meth:`checked`."""
        with self.lock:
            self.checked(i, **changes)()

    def checked(self, i: int, **changes: object) -> Callable[[], None]:
        """Check changes of :attr:`SETTABLE` and the world's; return a function that applies them.

        Energies in ``info`` do not have what the change itself adds to the robot's energy.

        Raises:
            ValueError: no such robot, or a value out of range. TypeError: another name.
        """
        i = robot_index(i, self.num_envs)
        known = {*self.SETTABLE, *self.world.SETTABLE}
        if unknown := sorted({*changes} - known):
            allowed = listed(sorted(known), unknown[0])
            raise TypeError(f"{unknown} cannot be changed, must be in {allowed}")
        of_task = {name: changes.pop(name) for name in self.SETTABLE if name in changes}
        with self.lock:
            checked, apply = self.world.checked(i, changes), self._change(i, of_task)

        def change() -> None:
            with self.lock:
                self.world.change(i, checked)
                apply()

        return change

    def frame(self, i: int) -> Frame:
        """Return the picture data of a robot as it is now."""
        return self.world.frame(i, None if self.command is None else self.command[i])

    def scene(self, i: int) -> Values:
        """Return the arguments of :class:`jansen_env.rendering.Renderer` to draw a robot."""
        return self.world.scene(i)

    def get_state(self, i: int) -> Values:
        """Return all that a robot's future depends on but its random numbers."""
        i = robot_index(i, self.num_envs)
        with self.lock:
            numbers = {name: self.info[name][i].item() for name in self._kept}
            return {**self.world.get_state(i), **numbers}

    def set_state(self, i: int, state: Values) -> None:
        """Go on from a complete state of :meth:`get_state`; ValueError: an entry out of range."""
        i = robot_index(i, self.num_envs)
        with self.lock:
            checked = self.world.checked_state(i, state)
            numbers = {name: self._checked("state", name, state[name]) for name in self._kept}
            self.world.restore(i, checked)
            self._refresh()
            self._clear(i, numbers)
            self._describe(np.array([i]))

    def _checked(self, label: str, name: str, value: object) -> float:
        """Return a flag, or a number within its limits if observed; ValueError: it is neither."""
        if name in self._kept and self.info[name].dtype == np.bool_:
            return flag(f"{label}[{name!r}]", value)
        limits = {entry.name: (entry.low, entry.high) for entry in self.observed}
        low, high = limits.get(name, (-MOST_SINGLE, MOST_SINGLE))  # as it will be observed
        return within(f"{label}[{name!r}]", value, max(low, -MOST_SINGLE), min(high, MOST_SINGLE))

    # What tasks with settable attributes, or in kernels, add to.

    def _order(self, world: Sequence[Observed]) -> tuple[Observed, ...]:
        """Return all observations in their order: by default those of the world come first."""
        return (*world, *self.OBSERVED)

    def _change(self, i: int, changes: Values) -> Callable[[], None]:
        """Check changes of :attr:`SETTABLE`; return a function that applies them.

        A derived task hands on the changes that it does not know.
        """
        if changes:
            raise NotImplementedError(f"{type(self).__name__}._change() must apply {[*changes]}")
        return lambda: None

    def __getstate__(self) -> Values:
        views = (
            "information",
            "info",
            "data",
            "rewards",
            "ended",
            "_records",
            "_terms",
            "lock",
            "truncated",
        )
        return {name: value for name, value in self.__dict__.items() if name not in views}

    def __setstate__(self, state: Values) -> None:
        self.__dict__.update(state)
        self.truncated = self.world.truncated
        self._make_lock()
        self.world.connect(self.observed, self.observation, self.COMPILED)
        self._connect()


class CommandedTask(Task):
    """A task with a commanded speed, ``info["speed_command"]``.

    Attributes:
        FASTEST: the largest command. speed_command: (n, 2) range of the next ones.
    """

    FASTEST: ClassVar[float]
    INFO = {"speed_command": float}
    OPTIONS = ("speed_command",)
    SETTABLE: ClassVar[tuple[str, ...]] = ("speed_command",)

    def __init__(self, settings: Any, threads: int | None = None) -> None:
        self.speed_command = np.array(settings.speed_command, float)
        super().__init__(settings, threads)

    def draw(self, i: int, rng: np.random.Generator, options: Values) -> Numbers:
        """Draw a robot's command."""
        low, high = self.speed_command[i].tolist()
        command = uniform(rng, low, high)
        command = option(options, "speed_command", command, -self.FASTEST, self.FASTEST)
        return {"speed_command": command}

    def _change(self, i: int, changes: Values) -> Callable[[], None]:
        """Check another range of commands, which are drawn from it from now on."""
        others = {name: value for name, value in changes.items() if name != "speed_command"}
        apply_others = super()._change(i, others)
        if "speed_command" not in changes:
            return apply_others
        limits = -self.FASTEST, self.FASTEST
        value = number_range("speed_command", changes["speed_command"], *limits)
        return partial(self.speed_command.__setitem__, i, value)
