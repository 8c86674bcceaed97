"""The walking task: follow a commanded speed; numbers: :mod:`jansen_env.engine.walk_reward`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.checks import non_negative, positive, shown, within
from jansen_env.engine import walk_reward
from jansen_env.tasks.task import CompiledTask
from jansen_env.uniform import uniform
from jansen_env.world.argument_checks import (
    Arguments,
    Bools,
    Ints,
    PerRobot,
    Range,
    Values,
    finite_numbers,
    flag,
)
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import WorldArguments, WorldSettings, each, range_each, shared

SPEED_COMMAND = (0.05, 0.8)  # m/s, the default range of commanded speeds
FASTEST_COMMAND = 2.0  # m/s, beyond it no command makes sense for this machine
STEPS_PER_TURN = 4  # of the feet, with two crank pins: means are taken over a quarter turn
ACCOUNTS: tuple[str, ...] = walk_reward.ACCOUNTS.names or ()  # lag and means
COMMANDED = ("speed_command", *ACCOUNTS)  # in the order of ``walk_reward.observe``
FURTHEST = walk_reward.FURTHEST_TARGET


def _interval(name: str, value: object) -> float:
    return math.inf if value is None else positive(name, value)


class WalkerArguments(WorldArguments, total=False):
    """Arguments of the walkers; :class:`WalkerSettings` has their defaults and checks."""

    speed_command: PerRobot[Range]
    command_interval: PerRobot[float | None]
    slip_weight: float
    energy_weight: float
    effort_weight: float
    smoothness_weight: float
    posture_weight: float
    fall_pitch: float
    fall_contact: bool
    terminate_when_fallen: bool


@dataclass(frozen=True, kw_only=True)
class WalkerSettings(WorldSettings):
    """Arguments of ``JansenWalker-v0`` and its presets: those of the world, and of its task.

    Commands in m/s, their interval in s, pitch in rad; weights are exponents of the reward.
    """

    speed_command: PerRobot[Range] = range_each(SPEED_COMMAND, -FASTEST_COMMAND, FASTEST_COMMAND)
    command_interval: PerRobot[float | None] = each(None, _interval)
    slip_weight: float = shared(1.0, non_negative)
    energy_weight: float = shared(1.0, non_negative)
    effort_weight: float = shared(1.0, non_negative)
    smoothness_weight: float = shared(1.0, non_negative)
    posture_weight: float = shared(1.0, non_negative)
    fall_pitch: float = shared(walk_reward.FALLEN_PITCH, positive)
    fall_contact: bool = shared(True, flag)
    terminate_when_fallen: bool = shared(True, flag)


class WalkerTask(CompiledTask):
    """Walk at a commanded speed, m/s.

    See :class:`jansen_env.tasks.walking.walker_env.JansenWalkerEnv`.
    One kernel rewards, ends and observes a step; a derived task may do more in NumPy.

    Attributes:
        covered: (n, 2) m walked towards the commands and commanded; with a curriculum.
    """

    SETTINGS = WalkerSettings
    OBSERVED = (
        Observed("speed_command", "m/s", -FASTEST_COMMAND, FASTEST_COMMAND, EXACT),
        # Noisy sensors measure these, see _connect:
        Observed("lag", "m", -FURTHEST, FURTHEST, EXACT),
        Observed("mean_speed", "m/s", -np.inf, np.inf, EXACT),
        Observed("mean_slip", "m/s", 0.0, np.inf, EXACT),
        Observed("mean_power", "W", 0.0, np.inf, EXACT),
        Observed("rms_torque", "N m", 0.0, np.inf, EXACT),
    )
    COMPILED = COMMANDED
    ENGINE: ClassVar[ModuleType] = walk_reward
    ROW = walk_reward.ROW
    SETTABLE = ("speed_command", "command")
    FASTEST = FASTEST_COMMAND

    def __init__(self, settings: WalkerSettings, threads: int | None = None) -> None:
        n = settings.count
        self._intervals = np.array(settings.each("command_interval"))
        self._commands_change = bool(np.isfinite(self._intervals).any())
        self._settings = np.zeros(1, walk_reward.SETTINGS)
        self._settings[0] = (
            settings.slip_weight, settings.energy_weight, settings.effort_weight,
            settings.smoothness_weight, settings.posture_weight, settings.fall_pitch,
            settings.fall_contact, settings.terminate_when_fallen,
        )  # fmt: skip
        self.covered = np.zeros((n, 2))
        self._measured = np.zeros(0 if settings.noise is None else n, walk_reward.ACCOUNTS)
        super().__init__(settings, threads)
        self._command_steps = np.maximum(1.0, np.rint(self._intervals / self.control_dt))

    def _connect(self) -> None:
        super()._connect()
        self._places = np.array([self.columns[name] for name in COMMANDED])
        self._error = np.zeros((0, 2))
        if self.world.sensors is not None:
            numbers = self._measured.view(float).reshape(self.num_envs, -1)
            self.world.sensors.measure(numbers, [self.columns[name] for name in ACCOUNTS])
            self._error = self.world.sensors.mean_error

    def _order(self, world: Sequence[Observed]) -> tuple[Observed, ...]:
        """Return all observations in the documented order; a derived task's come last."""
        known = {entry.name: entry for entry in (*world, *self.OBSERVED)}
        heights = [name for name in known if name.startswith("height_scan_")]
        loads = [name for name in known if name.startswith("toe_load_")]
        later = [*COMMANDED, *loads, *heights, "last_action"]
        added = [entry.name for entry in self.OBSERVED if entry.name not in COMMANDED]
        first = [entry.name for entry in world if entry.name not in later]
        last = ("last_action", *ACCOUNTS, *heights, *added)
        return tuple(known[name] for name in (*first, "speed_command", *loads, *last))

    def _begin(self, which: Ints) -> None:
        """Begin episodes of robots (k,), whose lag and means are 0."""
        self.data["mean_path"][which] = abs(self.world.advance_per_turn[which]) / STEPS_PER_TURN
        self.data["next_command"][which] = self.info["speed_command"][which]
        self.covered[which] = 0.0
        if len(self._measured) > 0:
            self._measured[which] = np.zeros((), walk_reward.ACCOUNTS)

    def step(
        self, actions: ArrayLike, active: Bools, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold actions (n, 1) of the ``active`` robots (n,), see ``World.step``."""
        if self._commands_change:
            self._draw_commands(active)
        super().step(actions, active, meanwhile)

    def _finish_step(self, which: Ints) -> None:
        """Account for the step of robots (k,) in one kernel, on the thread that moved them."""
        if self.world.episodes.curriculum is not None:
            self._cover(which)
        super()._finish_step(which)

    def _kernel_arguments(self) -> tuple[Arguments, Arguments]:
        """Return those of ``finish_step`` and ``describe`` of the engine's ``walk_reward``."""
        step, describe = super()._kernel_arguments()
        first = (
            self._settings, self.data, self.rewards, self.ended, self._error, self._measured,
            self._places,
        )  # fmt: skip
        return (*first, *step), (self.data, self._places, *describe)

    def _draw_commands(self, active: Bools) -> None:
        """Draw the commands that hold after this step, where it is time for others."""
        elapsed = self.world.elapsed + 1
        for i in np.flatnonzero(active & (elapsed % self._command_steps == 0)).tolist():
            # By the time, so that a state to go on from needs no more than the seed.
            rng = np.random.default_rng((self.world.seeds[i], elapsed[i]))
            self.data[i]["next_command"] = uniform(rng, *self.speed_command[i])

    def _cover(self, which: Ints) -> None:
        """Add the step of robots (k,) to :attr:`covered`."""
        commands = self.info["speed_command"][which]
        path = self.world.x_position[which] - self.world.data["x_before"][which]
        self.covered[which, 0] += np.sign(commands) * path
        self.covered[which, 1] += np.abs(commands) * self.control_dt

    def progress(self, i: int) -> tuple[float, float]:
        """Return how far a robot got towards its commands, m, and their mean size, m/s."""
        walked, commanded = self.covered[i].tolist()
        return walked, commanded / (max(1, int(self.world.elapsed[i])) * self.control_dt)

    def _change(self, i: int, changes: Values) -> Callable[[], None]:
        """Check another range of commands, and a command that holds from the next step on."""
        others = {name: value for name, value in changes.items() if name != "command"}
        apply_range = super()._change(i, others)
        if "command" not in changes:
            return apply_range
        command = within("command", changes["command"], -self.FASTEST, self.FASTEST)

        def apply() -> None:
            apply_range()
            self.info["speed_command"][i] = self.data["next_command"][i] = command
            self._describe(np.array([i]))

        return apply

    def get_state(self, i: int) -> Values:
        """Return all that a robot's future depends on but its random numbers."""
        state = {**super().get_state(i), "covered": self.covered[i].copy()}
        if len(self._measured) > 0:
            state["measured"] = dict(zip(ACCOUNTS, self._measured[i].item(), strict=True))
        return state

    def set_state(self, i: int, state: Values) -> None:
        """Go on from a complete state of :meth:`get_state`; ValueError: an entry out of range."""
        covered = finite_numbers("state['covered']", state["covered"], 2)
        measured: tuple[float, ...] = ()
        if len(self._measured) > 0:
            given, label = state["measured"], "state['measured']"
            if not isinstance(given, Mapping) or not {*ACCOUNTS} <= {*given}:
                raise ValueError(f"{label} is {shown(given)}, must have {[*ACCOUNTS]}")
            measured = tuple(self._in_range(label, name, given[name]) for name in ACCOUNTS)
        super().set_state(i, state)
        self.covered[i] = covered
        if measured:
            self._measured[i] = measured
            self._describe(np.array([i]))
