"""Base of tasks: observations, reward and end of episode of n robots in a world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jansen_env.checks import MOST_SINGLE, listed, within
from jansen_env.engine import readings
from jansen_env.rendering import Frame
from jansen_env.tasks.information import InfoBuilder
from jansen_env.uniform import uniform
from jansen_env.world import argument_checks as arguments
from jansen_env.world.argument_checks import Array, Bools, Ints
from jansen_env.world.entries import Observed
from jansen_env.world.world import World


class Task(ABC):
    """A task of ``num_envs`` robots. Environments of one robot and of many are made of it.

    A task has the class attributes below, :attr:`own_entries`, :meth:`begin` and :meth:`score`;
    :mod:`jansen_env.tasks.goal` is an example in plain NumPy.

    Args:
        num_envs: robots. threads: cores to use; None for as many as pay.
        keywords: fields of the records of the world and of the task. Those of :attr:`PER_ROBOT` may
            be one for all robots or one for each: a sequence of terrains (or their names), arrays
            (n,), or anything in :class:`jansen_env.world.argument_checks.Each`.

    Attributes:
        WORLD: of the robots. ENGINE: module of the kernels ``finish_step`` and ``describe``.
        RECORDS: the task's own keyword arguments with their checks, TypedDicts or dataclasses (see
            :mod:`jansen_env.world.argument_checks`), by the names under which :meth:`take` gets
            them. DEFAULTS: other defaults of arguments.
        ROW: structured type of a robot's data: ``info`` is added to the information, ``reward``
            has the reward's terms. STATE: what of it a state must have, such as "info.fallen".
        OPTIONS: of a reset, and SETTABLE: of :meth:`set_parameters`, beside the world's.
        PER_ROBOT, SINGLE_ONLY: keyword arguments that may be one for each robot; defaults of those
            that several robots cannot have otherwise.
        observation_space, action_space: of one robot. observed: each number of the observation.
        observation: (n, d) the last ones, with ``columns`` by name. reward: (n,) of the last step.
        terminated, truncated: (n,) whether the episode is over, or the simulation diverged.
        information: of the last step. control_dt: s for which an action is held.

    Raises:
        ValueError: an argument out of range. TypeError: no such argument.
    """

    WORLD: ClassVar[Any] = World
    ENGINE: ClassVar[Any] = readings
    RECORDS: ClassVar[dict[str, type]] = {}
    DEFAULTS: ClassVar[dict[str, Any]] = {}
    ROW: ClassVar[Any]
    STATE: ClassVar[tuple[str, ...]] = ()
    OPTIONS: ClassVar[tuple[str, ...]] = ()
    SETTABLE: ClassVar[tuple[str, ...]] = ()
    PER_ROBOT: ClassVar[tuple[str, ...]]
    SINGLE_ONLY: ClassVar[dict[str, Any]]
    world: Any

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        records = {**cls.WORLD.RECORDS, **cls.RECORDS}
        cls.__signature__ = arguments.signature_of(records, cls.DEFAULTS)  # type: ignore[attr-defined]
        cls.PER_ROBOT = tuple(arguments.marked(records, "per_robot"))
        cls.SINGLE_ONLY = arguments.marked(records, "single_only")

    def __init__(self, num_envs: int = 1, threads: int | None = None, **keywords: Any) -> None:
        kinds = {**self.WORLD.RECORDS, **self.RECORDS}
        records = arguments.fill(kinds, {**self.DEFAULTS, **keywords}, num_envs)
        of_world = {name: records.pop(name) for name in self.WORLD.RECORDS}
        by_default = frozenset(self.DEFAULTS) - {*keywords}
        self.num_envs = num_envs
        self.world = self.WORLD(num_envs, threads, **of_world, by_default=by_default)
        self.control_dt: float = self.world.control_dt
        self.truncated: Bools = self.world.truncated
        self.rows = np.zeros(num_envs, self.ROW)
        self.reward, self.terminated = np.zeros(num_envs), np.zeros(num_envs, bool)
        self.take(records)
        self.observed = (*self.entries, *self.world.lengths.entries)
        self.columns = {entry.name: place for place, entry in enumerate(self.observed)}
        low, high = np.array([(one.low, one.high) for one in self.observed], np.float32).T
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation = np.zeros((num_envs, len(self.observed)), np.float32)
        self.world.connect(self.observed, self.observation, self.progress)
        self.connect()
        self.information = self._make_info()
        self._describe, self._finish = self.ENGINE.describe.bound(), self.ENGINE.finish_step.bound()

    def _make_info(self) -> InfoBuilder:
        world = self.world
        return InfoBuilder(world.rows, self.rows, world.arrays, world.groups)

    # Defined by each task.

    def take(self, records: dict[str, Any]) -> None:
        """Keep the task's own records, by the names of :attr:`RECORDS`."""

    @property
    def own_entries(self) -> Sequence[Observed]:
        """Numbers observed beside the world's."""
        return ()

    @property
    def entries(self) -> Sequence[Observed]:
        """All that is observed, in its order: the world's entries and :attr:`own_entries`."""
        return [*self.world.entries, *self.own_entries]

    def connect(self) -> None:
        """Finish the construction, with the columns of the observation known."""

    def draw(self, row: int, rng: np.random.Generator, options: dict[str, Any]) -> Any:
        """Draw a robot's own numbers of an episode, for :meth:`begin`."""
        return None

    @abstractmethod
    def begin(self, rows: Ints, drawn: Sequence[Any]) -> None:
        """Fill :attr:`rows`, which are 0, at the start of episodes of robots (k,)."""

    @abstractmethod
    def score(self, rows: Ints) -> None:
        """Fill :attr:`rows`, :attr:`reward` and :attr:`terminated` of robots (k,) after a step."""

    def observe(self, rows: Ints) -> None:
        """Fill the columns of :attr:`own_entries` for robots (k,)."""

    def progress(self, row: int) -> tuple[float, float]:
        """Return a robot's progress, m, and mean speed asked for, m/s, for a curriculum."""
        return 0.0, 0.0

    def step_arguments(self) -> tuple[Any, ...]:
        """Return the arguments of the engine's ``finish_step`` but the first."""
        return self.world.step_arguments()

    def describe_arguments(self) -> tuple[Any, ...]:
        """Return the arguments of the engine's ``describe`` but the first."""
        return self.world.describe_arguments()

    # Asked by environments.

    def reset(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]] | None = None,
    ) -> None:
        """Start episodes of robots (k,), each with its generator and the options of its reset.

        Raises:
            ValueError: an unknown option, or a value out of range. FloatingPointError: a robot
                diverges where it is placed. Nothing has changed then.
        """
        options = [{}] * len(rows) if options is None else options
        known = {*self.OPTIONS, *self.world.OPTIONS}
        for own in options:
            if unknown := sorted({*own} - known):
                allowed = listed(sorted(known), unknown[0])
                raise ValueError(f"reset options {unknown} are unknown, must be in {allowed}")
        before = [generator.bit_generator.state for generator in generators]
        try:
            drawn = self.world.reset(rows, generators, options, self.draw)
        except Exception:
            for generator, state in zip(generators, before, strict=True):
                generator.bit_generator.state = state
            raise
        self._clear(rows)
        self.begin(rows, drawn)
        self.describe(rows)

    def _clear(self, rows: Ints) -> None:
        self.rows[rows] = np.zeros((), self.ROW)
        self.reward[rows], self.terminated[rows] = 0.0, False

    def step(
        self, actions: Any, active: Bools, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold actions (n, 1) of the ``active`` robots (n,), see ``World.step``."""
        self.world.step(actions, active, self.finish_step, meanwhile)
        self.complete_step(active)
        self.world.disturb()

    def finish_step(self, rows: Ints) -> None:
        """Account for the step of robots (k,) in one kernel, on the thread that moved them."""
        self._finish(rows, self._step_arguments)

    def complete_step(self, active: Bools) -> None:
        """Score the step of the ``active`` robots (n,), and observe them."""
        rows = np.flatnonzero(active)
        self.score(rows)
        self.observe(rows)

    def describe(self, rows: Ints) -> None:
        """Fill observations and information of some robots as they are now."""
        self._step_arguments = self.step_arguments()  # a longer terrain has another array
        self._describe(rows, *self.describe_arguments())
        self.observe(rows)
        self.world.disturb(rows)

    def set_parameters(self, row: int, **changes: Any) -> None:
        """Change a robot from now on: :attr:`SETTABLE`, and the world's.

        Energies in ``info`` do not have what the change itself adds to the robot's energy.

        Raises:
            ValueError: a value out of range, or fixed by the plant. TypeError: another name.
        """
        known = {*self.SETTABLE, *self.world.SETTABLE}
        if unknown := sorted({*changes} - known):
            allowed = listed(sorted(known), unknown[0])
            raise TypeError(f"{unknown} cannot be changed, must be in {allowed}")
        own = {name: changes.pop(name) for name in self.SETTABLE if name in changes}
        checked, checked_own = self.world.checked(row, changes), self.checked(row, own)
        self.world.apply(row, checked)  # all or nothing
        self.apply(row, checked_own)

    def checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return changes of :attr:`SETTABLE`, ready for :meth:`apply`; ValueError: out of range."""
        return dict(changes)

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Apply changes."""

    def get_attr(self, name: str) -> list[Any] | None:
        """Return an attribute of each robot; None for a name that is no robot's."""
        return self.world.get_attr(name)

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on but its random numbers."""
        own = {name.split(".")[-1]: self._kept(name)[row].item() for name in self.STATE}
        return {**self.world.get_state(row), **own}

    def _kept(self, name: str) -> NDArray[Any]:
        """Return a number of :attr:`rows` by a name of :attr:`STATE`, (n,)."""
        return reduce(lambda found, part: found[part], name.split("."), self.rows)

    def checked_state(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the entries of :attr:`STATE`. Raises ValueError: a number is out of range."""
        checked = {}
        for name in self.STATE:
            key = name.split(".")[-1]
            flag = self._kept(name).dtype == np.bool_
            checked[name] = bool(state[key]) if flag else self.in_range("state", key, state[key])
        return checked

    def in_range(self, label: str, name: str, value: Any) -> float:
        """Return a number within the limits of its name, if observed. Raises ValueError."""
        limits = {one.name: (one.low, one.high) for one in self.observed}
        low, high = limits.get(name, (-MOST_SINGLE, MOST_SINGLE))  # as it will be observed
        return within(f"{label}[{name!r}]", value, max(low, -MOST_SINGLE), min(high, MOST_SINGLE))

    def set_state(self, row: int, state: Mapping[str, Any]) -> None:
        """Go on from a complete state of :meth:`get_state`; ValueError: an entry out of range."""
        checked, own = self.world.checked_state(row, state), self.checked_state(state)
        one = np.array([row])
        self.world.restore(row, checked)
        self._clear(one)
        self.resume(row, own)
        self.describe(one)

    def resume(self, row: int, state: dict[str, Any]) -> None:
        """Fill a robot's row, which is 0, with what :meth:`checked_state` gave."""
        for name in self.STATE:
            self._kept(name)[row] = state[name]

    def scene(self, row: int) -> dict[str, Any]:
        """Return the arguments of :class:`jansen_env.rendering.Renderer` to draw a robot."""
        return self.world.scene(row)

    def command(self, row: int) -> float | None:
        """Return the command that is drawn with a robot, None for none."""
        return None

    def frame(self, row: int) -> Frame:
        """Return the picture data of a robot as it stands."""
        return self.world.frame(row, self.command(row))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "information": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.connect()  # with this copy's arrays
        self._step_arguments = self.step_arguments()
        self.information = self._make_info()


class CommandedTask(Task):
    """A task with a commanded speed, ``rows["info"]["speed_command"]``.

    Attributes:
        FASTEST: the largest command. speed_command: (n, 2) range of the next ones.
    """

    FASTEST: ClassVar[float]
    OPTIONS = ("speed_command",)
    SETTABLE: ClassVar[tuple[str, ...]] = ("speed_command",)
    speed_command: Array

    def draw(self, row: int, rng: np.random.Generator, options: dict[str, Any]) -> float:
        """Draw a robot's command."""
        command = uniform(rng, *self.speed_command[row])
        return arguments.option(options, "speed_command", command, -self.FASTEST, self.FASTEST)

    def begin(self, rows: Ints, drawn: Sequence[Any]) -> None:
        """Start with commands."""
        self.rows["info"]["speed_command"][rows] = drawn

    def checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return changes of ``speed_command``, a number or a range, and ``command``."""
        limits = -self.FASTEST, self.FASTEST
        checks: dict[str, Any] = {"speed_command": arguments.number_range, "command": within}
        return {name: checks[name](name, value, *limits) for name, value in changes.items()}

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Draw commands from another range from now on."""
        if "speed_command" in checked:
            self.speed_command[row] = checked["speed_command"]

    def get_attr(self, name: str) -> list[Any] | None:
        """Return an attribute of each robot: those of :attr:`SETTABLE` and the world's."""
        if name not in self.SETTABLE:
            return super().get_attr(name)
        if name == "command":
            return list(self.rows["info"]["speed_command"].tolist())
        return [(low, high) for low, high in self.speed_command.tolist()]

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on but its random numbers."""
        return {**super().get_state(row), "command": self.command(row)}

    def checked_state(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the task's entries of a state. Raises ValueError: one is out of range."""
        command = within("state['command']", state["command"], -self.FASTEST, self.FASTEST)
        return {**super().checked_state(state), "command": command}

    def resume(self, row: int, state: dict[str, Any]) -> None:
        """Go on with a command and the other entries of a state."""
        self.begin(np.array([row]), [state["command"]])
        super().resume(row, state)

    def command(self, row: int) -> float:
        """Return a robot's command."""
        return float(self.rows["info"]["speed_command"][row])


class CompiledTask(CommandedTask):
    """A commanded task whose kernel ``ENGINE.finish_step`` scores and observes.

    A derived task may define :meth:`score` and :meth:`observe`: they are called after the kernel.
    """

    _extended: ClassVar[bool]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        own = CompiledTask.score, CompiledTask.observe
        cls._extended = (cls.score, cls.observe) != own

    def score(self, rows: Ints) -> None:
        """Leave the kernel's reward as it is."""

    def complete_step(self, active: Bools) -> None:
        """Call what a derived task defines."""
        if self._extended:
            super().complete_step(active)
