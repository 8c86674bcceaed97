"""Base classes of tasks: observations, rewards and termination for n robots in a world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from threading import RLock
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from typing_extensions import override

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.checks import MOST_SINGLE, invalid, listed, number_range, robot_index, within
from jansen_env.plants.threads import forks
from jansen_env.tasks.information import InfoBuilder
from jansen_env.uniform import uniform
from jansen_env.world.observations import Observed
from jansen_env.world.rendering import Frame
from jansen_env.world.scenes import frame_of, scene_of
from jansen_env.world.settings import Check, Values, WorldSettings, flag, option
from jansen_env.world.state_checks import check_saved_state
from jansen_env.world.world import Numbers, World

EVERY = slice(None)  # index of all robots, which is faster than an array of all their indices


class Task(ABC):
    """Task of n robots, from which environments of one robot and of many robots are made.

    To write a task, set the class attributes and define four methods in plain NumPy that work on
    all n robots at once. They are called in this order: :meth:`draw` and :meth:`observe` at a
    reset; :meth:`reward`, :meth:`terminated` and :meth:`observe` after a step. The methods read
    values of :attr:`world` by name, such as ``world.pitch``, and store values in :attr:`info` with
    :meth:`keep`. :mod:`jansen_env.tasks.goal` is an example.
    :class:`jansen_env.tasks.compiled.CompiledTask` is the base class of tasks whose rewards are
    computed by kernels.

    Args:
        settings: Validated arguments of the environment.
        threads: Number of CPU cores to use. If None, it is chosen from the batch size.

    Attributes:
        SETTINGS: Class of the arguments.
        OBSERVED: Observations of the task, in addition to those of the world.
        INFO: Names and types of the numbers and flags that the task keeps for each robot. They
            appear in ``info`` and in saved states. At a reset they are 0, except for the values
            that :meth:`draw` returns.
        TERMS: Names of the terms of the reward.
        OPTIONS: Names of the reset options of the task, in addition to those of the world.
        SETTABLE: Names that :meth:`set_parameters` accepts, in addition to those of the world. Each
            of them is an attribute of the task, shape (n, ...).
        world: Simulation of the n robots.
        observed: Description of each number of the observation, in order.
        columns: Index of each number of the observation, by name.
        observation_space: Space of the observation of one robot.
        action_space: Space of the action of one robot.
        observation: Last observation of each robot, shape (n, d).
        info: Present values of :attr:`INFO`, shape (n,).
        rewards: Reward of the last step, shape (n,).
        ended: Whether the episode of each robot is terminated, shape (n,).
        truncated: Whether the simulation of each robot has diverged, shape (n,).
        control_dt: Duration of a control step, in s.
        lock: Lock that is held while robots move or change.

    Raises:
        ValueError: If an argument is out of range or has no effect, or if declared names are in
            conflict.
    """

    SETTINGS: ClassVar[type[WorldSettings]] = WorldSettings
    OBSERVED: ClassVar[tuple[Observed, ...]] = ()
    INFO: ClassVar[Mapping[str, type]] = {}
    TERMS: ClassVar[tuple[str, ...]] = ()
    OPTIONS: ClassVar[tuple[str, ...]] = ()
    SETTABLE: ClassVar[tuple[str, ...]] = ()
    # ROW is the record of a compiled task, which replaces INFO and TERMS. COMPILED contains the
    # names of the observations that kernels fill.
    ROW: ClassVar[np.dtype[np.void] | None] = None
    COMPILED: ClassVar[tuple[str, ...]] = ()
    OMITTED: ClassVar[tuple[str, ...]] = ()  # fields of ROW that saved states do not contain
    fully_compiled = False  # whether kernels do everything, so that a step calls no method

    def __init__(self, settings: WorldSettings, threads: int | None = None) -> None:
        n = self.num_envs = settings.count
        self._check_declarations(settings)
        terms = [(name, float) for name in self.TERMS]
        row = np.dtype([("info", [*self.INFO.items()]), ("reward", terms)], align=True)
        row = row if self.ROW is None else self.ROW
        self.world = World(settings, threads, row, self.OMITTED)
        self.control_dt = self.world.control_dt
        self.truncated = self.world.truncated
        self.observed = self._order(self.world.observations) + tuple(self.world.lengths.entries)
        self.columns = {entry.name: place for place, entry in enumerate(self.observed)}
        if len(self.columns) < len(self.observed):
            names = [entry.name for entry in self.observed]
            raise ValueError(f"observations must have different names, got {names}")
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
        """Check that no setting and no declared name is ignored.

        Raises:
            ValueError: If a setting or a name is ignored, or if INFO and TERMS share a name.
        """
        if settings.curriculum is not None and type(self).progress is Task.progress:
            allowed = "None for a task that defines no progress()"
            raise invalid("curriculum", settings.curriculum, allowed)
        if both := sorted({*self.INFO} & {*self.TERMS}):
            raise ValueError(f"INFO and TERMS must have different names, got {both} in both")
        if self.ROW is not None:
            known = {*(self.ROW["info"].names or ()), *(self.ROW["reward"].names or ())}
            if unknown := sorted({*self.INFO, *self.TERMS} - known):
                allowed = f"one of {sorted(known)}, those of the compiled task's ROW"
                raise invalid("a name in INFO and TERMS", unknown[0], allowed)

    def _connect(self) -> None:
        """Get views of the arrays in the records."""
        world = self.world
        records = self.world.records
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
        """Make the lock that a call holds, because kernels write without Python's global lock."""
        self.lock = RLock()  # reentrant, because a step may reset other robots
        forks.watch(self)

    def _refresh(self) -> None:
        """Get new views if the records have been replaced by new arrays."""
        if self._records is not self.world.records.data:
            self._connect()

    # Methods that define a task.

    def draw(self, i: int, rng: np.random.Generator, options: Values) -> Numbers:
        """Sample values of :attr:`INFO` for the next episode of a robot.

        The method must not change the task, because the reset may still fail.

        Args:
            i: Index of the robot.
            rng: Random number generator of the robot.
            options: Options of the reset, by name.

        Returns:
            The sampled values, by name.
        """
        return {}

    def observe(self) -> Mapping[str, Array]:
        """Return the values of :attr:`OBSERVED` after a reset or a step.

        Returns:
            The values of all robots, by name, each with shape (n,).
        """
        return {}

    @abstractmethod
    def reward(self) -> Array:
        """Return the rewards of a step, shape (n,), and store their terms with :meth:`keep`."""

    @abstractmethod
    def terminated(self) -> Bools:
        """Return whether each episode is terminated after a step, shape (n,)."""

    def keep(self, **values: NDArray[np.generic]) -> None:
        """Store values of :attr:`INFO` and :attr:`TERMS` for the robots of this step.

        Args:
            values: Values of all robots, by name, each with shape (n,). Only those of the robots
                that took part in the step are stored.
        """
        which = self._which
        for name, value in values.items():
            kept = "info" if name in self._kept else "reward"
            self.data[kept][name][which] = value[which]

    def progress(self, i: int) -> tuple[float, float]:
        """Return how far a robot walked in its last episode, for a curriculum.

        Args:
            i: Index of the robot.

        Returns:
            The progress, in m, and the mean commanded speed, in m/s.
        """
        return 0.0, 0.0

    # Methods that environments call.

    @property
    def command(self) -> Array | None:
        """Commanded speed of each robot, shape (n,), or None for a task without commands."""
        return self.info["speed_command"] if "speed_command" in self._kept else None

    def reset(
        self,
        which: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[Values] | None = None,
    ) -> None:
        """Start a new episode for some of the robots. After an error, nothing has changed.

        Args:
            which: Indices of the robots, shape (k,).
            generators: Random number generator of each of these robots.
            options: Reset options of each of these robots. None for no options.

        Raises:
            ValueError: If an option is unknown, or a value is out of range.
            FloatingPointError: If the simulation diverges at the initial position of a robot.
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
        """Check the names of reset options.

        Args:
            given: Options of a robot, by name.

        Raises:
            ValueError: If a name is unknown.
        """
        known = {*self.OPTIONS, *self.world.OPTIONS}
        if unknown := sorted({*given} - known):
            raise invalid(
                "a reset option", unknown[0], f"one of {listed(sorted(known), unknown[0])}"
            )

    def _clear(self, i: int, numbers: Values) -> None:
        """Clear the values of :attr:`INFO` and the reward terms, and set those in ``numbers``."""
        self.info[i], self._terms[i] = self._blank
        for name, value in numbers.items():
            self.info[name][i] = value

    def step(
        self, actions: Array, which: Ints | None, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Simulate one control step, then compute rewards, termination and observations.

        Args:
            actions: Actions of all robots, as fractions of the torque limit, shape (n, 1).
            which: Indices of the robots that take the step, shape (k,). None for all robots.
            meanwhile: Function that is called while these robots move; see ``World.step``.
        """
        with self.lock:
            self.world.step(actions, which, meanwhile)
            if not self.fully_compiled:
                self._judge(which)

    def _judge(self, which: Ints | None) -> None:
        """Compute rewards, termination and observations of robots after a step.

        Args:
            which: Indices of the robots, shape (k,). None for all robots.
        """
        part = self._which = EVERY if which is None else which
        self.rewards[part] = self.reward()[part]
        self.ended[part] = self.terminated()[part]
        self._fill(part)
        self.world.observe(which, True)

    def _observed(self) -> Mapping[str, Array]:
        """Return the result of :meth:`observe`, after checking its names.

        Raises:
            ValueError: If the names differ from those that :attr:`OBSERVED` declares.
        """
        observed = self.observe()
        if observed.keys() != self._observes:
            needed = sorted(self._observes)
            kind = type(self).__name__
            raise ValueError(f"observe() of {kind} must return {needed}, got {[*observed]}")
        return observed

    def _fill(self, which: Ints | slice) -> None:
        """Fill the columns of the task's own observations.

        Args:
            which: Indices of the robots, shape (k,), or a slice.
        """
        self._which = which
        for name, values in self._observed().items():
            self.observation[which, self.columns[name]] = values[which]

    def _describe(self, which: Ints) -> None:
        """Fill the observations and the information of robots without a step.

        Args:
            which: Indices of the robots, shape (k,).
        """
        if not self.fully_compiled:
            self._fill(which)
        self.world.observe(which, False)

    def push(self, i: int, impulse: object) -> None:
        """Push the chassis of a robot from now on; see ``World.push``.

        Args:
            i: Index of the robot.
            impulse: Impulse in x and y, in N s.
        """
        i = robot_index(i, self.num_envs)
        with self.lock:
            self.world.push(i, impulse)
            self._refresh()

    def set_parameters(self, i: int, **changes: object) -> None:
        """Change parameters of a robot from now on; see :meth:`checked`.

        Args:
            i: Index of the robot.
            changes: New values, by name.
        """
        with self.lock:
            self.checked(i, **changes)()

    def checked(self, i: int, **changes: object) -> Callable[[], None]:
        """Check changes of parameters without applying them.

        Energy that a change adds to the robot (for example a larger payload) does not appear in
        ``info["energy"]``.

        Args:
            i: Index of the robot.
            changes: New values, by name. The names are those of :attr:`SETTABLE` and those that the
                world accepts.

        Returns:
            A function that applies the changes.

        Raises:
            ValueError: If there is no such robot, or a value is out of range.
            TypeError: If a name cannot be changed.
        """
        i = robot_index(i, self.num_envs)
        known = {*self.SETTABLE, *self.world.SETTABLE}
        if unknown := sorted({*changes} - known):
            allowed = f"one of {listed(sorted(known), unknown[0])}"
            raise TypeError(str(invalid("a parameter to change", unknown[0], allowed)))
        of_task = {name: changes.pop(name) for name in self.SETTABLE if name in changes}
        with self.lock:
            checked = self.world.checked(i, changes)
            apply = self._change(i, of_task)

        def change() -> None:
            with self.lock:
                self.world.change(i, checked)
                apply()

        return change

    def frame(self, i: int) -> Frame:
        """Return the picture data of a robot in its present state.

        Args:
            i: Index of the robot.
        """
        return frame_of(self.world, i, None if self.command is None else self.command[i])

    def scene(self, i: int) -> Values:
        """Return the arguments of :class:`jansen_env.world.rendering.Renderer` to draw a robot.

        Args:
            i: Index of the robot.
        """
        return scene_of(self.world, i)

    def get_state(self, i: int) -> Values:
        """Return the state of a robot, from which :meth:`set_state` continues its episode.

        The state contains neither the arguments of the environment nor the robot's random
        generator.

        Args:
            i: Index of the robot.
        """
        i = robot_index(i, self.num_envs)
        with self.lock:
            return self.world.get_state(i)

    def set_state(self, i: int, state: Values) -> None:
        """Restore a robot to a state saved by :meth:`get_state`.

        Args:
            i: Index of the robot.
            state: The complete state.

        Raises:
            ValueError: If an entry is out of range.
        """
        i = robot_index(i, self.num_envs)
        with self.lock:
            checked = check_saved_state(self.world, i, state, self._checks_of_state())
            self.world.restore(i, checked)
            self._refresh()
            self._describe(np.array([i]))

    def _checks_of_state(self) -> dict[str, Check]:
        """Return checks of fields in the task's part of a saved record, by path.

        By default, each value of :attr:`INFO` is checked.
        """
        return {f"task.info.{name}": partial(self._checked, name) for name in self._kept}

    def _checked(self, name: str, label: str, value: object) -> float:
        """Return a checked value of :attr:`INFO`: a flag, or a number.

        If the value is also observed, it must be within the limits of the observation.

        Args:
            name: Name in :attr:`INFO`.
            label: Name of the value, for the error message.
            value: The value.

        Raises:
            ValueError: If the value has the wrong type or is outside its limits.
        """
        if name in self._kept and self.info[name].dtype == np.bool_:
            return flag(label, value)
        limits = {entry.name: (entry.low, entry.high) for entry in self.observed}
        low, high = limits.get(name, (-MOST_SINGLE, MOST_SINGLE))  # limits of the observation
        return within(label, value, max(low, -MOST_SINGLE), min(high, MOST_SINGLE))

    # Methods that tasks with settable attributes, and compiled tasks, override.

    def _order(self, world: Sequence[Observed]) -> tuple[Observed, ...]:
        """Return all observations in their order. By default, those of the world come first."""
        return (*world, *self.OBSERVED)

    def _change(self, i: int, changes: Values) -> Callable[[], None]:
        """Check changes of :attr:`SETTABLE`, and return a function that applies them.

        A derived task passes the changes that it does not know to its base class.

        Args:
            i: Index of the robot.
            changes: New values, by name.
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
    """Task with a commanded speed, ``info["speed_command"]``.

    Args:
        settings: Validated arguments of the environment, with ``speed_command``.
        threads: Number of CPU cores to use. If None, it is chosen from the batch size.

    Attributes:
        FASTEST: Largest command, in the unit of the commands.
        speed_command: Lowest and highest of the next commands of each robot, shape (n, 2).
    """

    FASTEST: ClassVar[float]
    INFO = {"speed_command": float}
    OPTIONS = ("speed_command",)
    SETTABLE: ClassVar[tuple[str, ...]] = ("speed_command",)

    def __init__(self, settings: Any, threads: int | None = None) -> None:
        self.speed_command = np.array(settings.speed_command, float)
        super().__init__(settings, threads)

    @override
    def draw(self, i: int, rng: np.random.Generator, options: Values) -> Numbers:
        """Sample the command of a robot, unless an option of the reset sets it."""
        low, high = self.speed_command[i].tolist()
        command = uniform(rng, low, high)
        command = option(options, "speed_command", command, -self.FASTEST, self.FASTEST)
        return {"speed_command": command}

    @override
    def _change(self, i: int, changes: Values) -> Callable[[], None]:
        """Check a new range of commands, and return a function that applies it.

        Afterwards, commands are sampled from the new range.
        """
        others = {name: value for name, value in changes.items() if name != "speed_command"}
        apply_others = super()._change(i, others)
        if "speed_command" not in changes:
            return apply_others
        limits = -self.FASTEST, self.FASTEST
        value = number_range("speed_command", changes["speed_command"], *limits)
        return partial(self.speed_command.__setitem__, i, value)
