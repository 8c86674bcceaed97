"""The walking task: follow a commanded speed; numbers: :mod:`jansen_env.engine.walk_reward`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, TypedDict

import numpy as np

from jansen_env.checks import finite, non_negative, positive, shown
from jansen_env.engine import walk_reward
from jansen_env.tasks.task import CompiledTask
from jansen_env.uniform import uniform
from jansen_env.world.argument_checks import (
    Bools,
    Ints,
    PerRobot,
    Range,
    flag,
    per_robot,
    range_per_robot,
    single,
)
from jansen_env.world.entries import EXACT, Observed

SPEED_COMMAND = (0.05, 0.8)  # m/s, the default range of commanded speeds
FASTEST_COMMAND = 2.0  # m/s, beyond it no command makes sense for this machine
STEPS_PER_TURN = 4  # of the feet, with two crank pins: means are taken over a quarter turn
ACCOUNTS: tuple[str, ...] = walk_reward.ACCOUNTS.names or ()  # lag and means
COMMANDED = ("speed_command", *ACCOUNTS)  # in the order of :func:`walk_reward.observe`


def _interval(name: str, value: Any) -> float:
    return math.inf if value is None else positive(name, value)


class Commands(TypedDict, total=False):
    """Speeds that are asked for, m/s, and after how many seconds another one is drawn."""

    speed_command: Annotated[
        PerRobot[Range], range_per_robot(SPEED_COMMAND, -FASTEST_COMMAND, FASTEST_COMMAND)
    ]
    command_interval: Annotated[PerRobot[float | None], per_robot(None, _interval)]


class RewardWeights(TypedDict, total=False):
    """Exponents of the reward's factors."""

    slip_weight: Annotated[float, single(1.0, non_negative)]
    energy_weight: Annotated[float, single(1.0, non_negative)]
    effort_weight: Annotated[float, single(1.0, non_negative)]
    smoothness_weight: Annotated[float, single(1.0, non_negative)]
    posture_weight: Annotated[float, single(1.0, non_negative)]


class Termination(TypedDict, total=False):
    """Criteria of a fall, and whether it ends the episode; the pitch in rad."""

    fall_pitch: Annotated[float, single(walk_reward.FALLEN_PITCH, positive)]
    fall_contact: Annotated[bool, single(True, flag)]
    terminate_when_fallen: Annotated[bool, single(True, flag)]


class WalkerTask(CompiledTask):
    """Walk at a commanded speed, m/s; see :class:`jansen_env.envs.walker.JansenWalkerEnv`.

    Attributes:
        covered: (n, 2) m walked towards the commands and commanded; with a curriculum.
    """

    RECORDS = {"commands": Commands, "weights": RewardWeights, "termination": Termination}
    ROW = walk_reward.ROW
    STATE = ("info.fallen", *(f"info.{name}" for name in ACCOUNTS))
    SETTABLE = ("speed_command", "command")
    ENGINE: ClassVar[Any] = walk_reward
    FASTEST = FASTEST_COMMAND

    def take(self, records: dict[str, Any]) -> None:
        """Keep commands, weights and termination."""
        commands, weights, end = (records[name] for name in WalkerTask.RECORDS)
        self.speed_command = commands.speed_command
        intervals = np.array(commands.command_interval)
        self._command_steps = np.maximum(1.0, np.rint(intervals / self.control_dt))
        self._commands_change = bool(np.isfinite(intervals).any())
        self._settings = np.zeros(1, walk_reward.SETTINGS)
        self._settings[0] = (*vars(weights).values(), *vars(end).values())
        self.covered = np.zeros((self.num_envs, 2))
        self._measured = np.zeros(0, walk_reward.ACCOUNTS)

    @property
    def own_entries(self) -> Sequence[Observed]:
        """The command, the lag and the means; :meth:`connect` lets sensors measure these."""
        furthest = walk_reward.FURTHEST_TARGET
        return [
            Observed("speed_command", "m/s", -FASTEST_COMMAND, FASTEST_COMMAND, EXACT),
            Observed("lag", "m", -furthest, furthest, EXACT),
            Observed("mean_speed", "m/s", -np.inf, np.inf, EXACT),
            Observed("mean_slip", "m/s", 0.0, np.inf, EXACT),
            Observed("mean_power", "W", 0.0, np.inf, EXACT),
            Observed("rms_torque", "N m", 0.0, np.inf, EXACT),
        ]

    @property
    def entries(self) -> Sequence[Observed]:
        """All that is observed, as documented; what a derived task adds comes last."""
        known = {one.name: one for one in self.world.entries}
        own = {one.name: one for one in self.own_entries}
        heights = [known.pop(name) for name in [*known] if name.startswith("height_scan_")]
        last, command = known.pop("last_action"), own.pop("speed_command")
        loads = [known.pop(name) for name in [*known] if name.startswith("toe_load_")]
        accounts = [own.pop(name) for name in ACCOUNTS]
        return [*known.values(), command, *loads, last, *accounts, *heights, *own.values()]

    def connect(self) -> None:
        """Let noisy sensors measure lag and means."""
        self._places = np.array([self.columns[name] for name in COMMANDED])
        self.rows["mean_path"] = abs(self.world.advance_per_turn) / STEPS_PER_TURN
        self._error = np.zeros((0, 2))
        sensors = self.world.sensors
        if sensors is not None:
            if len(self._measured) == 0:
                self._measured = np.zeros(self.num_envs, walk_reward.ACCOUNTS)
            numbers = self._measured.view(float).reshape(self.num_envs, -1)
            sensors.measure(numbers, [self.columns[name] for name in ACCOUNTS])
            self._error = sensors.mean_error

    def begin(self, rows: Ints, drawn: Sequence[Any]) -> None:
        """Start with commands, m/s; lag and means are 0."""
        self.rows["mean_path"][rows] = abs(self.world.advance_per_turn[rows]) / STEPS_PER_TURN
        super().begin(rows, drawn)
        self.rows["next_command"][rows] = drawn
        self.covered[rows] = 0.0
        if len(self._measured) > 0:
            self._measured[rows] = np.zeros((), walk_reward.ACCOUNTS)

    def step(
        self, actions: Any, active: Bools, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold actions (n, 1) of the ``active`` robots (n,), see ``World.step``."""
        if self._commands_change:
            self._draw_commands(active)
        super().step(actions, active, meanwhile)

    def finish_step(self, rows: Ints) -> None:
        """Account for the step of robots (k,) in one kernel, on the thread that moved them."""
        if self.world.episodes.curriculum is not None:
            self._cover(rows)
        super().finish_step(rows)

    def step_arguments(self) -> tuple[Any, ...]:
        return (
            self._settings, self.rows, self.reward, self.terminated, self._error, self._measured,
            self._places, *self.world.step_arguments(),
        )  # fmt: skip

    def describe_arguments(self) -> tuple[Any, ...]:
        return self.rows, self._places, *self.world.describe_arguments()

    def _draw_commands(self, active: Bools) -> None:
        """Draw the commands that hold after this step, where it is time for others."""
        elapsed = self.world.elapsed + 1
        for row in np.flatnonzero(active & (elapsed % self._command_steps == 0)).tolist():
            # By the time, so that a state to go on from needs no more than the seed.
            rng = np.random.default_rng((self.world.seeds[row], elapsed[row]))
            self.rows[row]["next_command"] = uniform(rng, *self.speed_command[row])

    def _cover(self, rows: Ints) -> None:
        """Add the step of robots (k,) to :attr:`covered`."""
        commands = self.rows["info"]["speed_command"][rows]
        path = self.world.plant.states[rows, 0] - self.world.rows["x_before"][rows]
        self.covered[rows, 0] += np.sign(commands) * path
        self.covered[rows, 1] += np.abs(commands) * self.control_dt

    def progress(self, row: int) -> tuple[float, float]:
        """Return how far a robot got towards its commands, m, and their mean size, m/s."""
        walked, commanded = self.covered[row].tolist()
        return walked, commanded / (max(1, int(self.world.elapsed[row])) * self.control_dt)

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Draw commands from another range from now on; give another one from the next step on."""
        super().apply(row, checked)
        if "command" in checked:
            kept = self.rows[row]
            kept["info"]["speed_command"] = kept["next_command"] = checked["command"]
            self.describe(np.array([row]))

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on but its random numbers."""
        state = {**super().get_state(row), "covered": self.covered[row].copy()}
        if len(self._measured) > 0:
            state["measured"] = dict(zip(ACCOUNTS, self._measured[row].item(), strict=True))
        return state

    def checked_state(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the task's entries of a state. Raises ValueError: one is out of range."""
        checked = super().checked_state(state)
        checked["covered"] = [finite("state['covered']", one) for one in state["covered"]]
        if len(self._measured) > 0:
            given, label = state["measured"], "state['measured']"
            if not isinstance(given, Mapping) or not {*ACCOUNTS} <= {*given}:
                raise ValueError(f"{label} is {shown(given)}, must have {[*ACCOUNTS]}")
            checked["measured"] = tuple(self.in_range(label, k, given[k]) for k in ACCOUNTS)
        return checked

    def resume(self, row: int, state: dict[str, Any]) -> None:
        """Fill a robot's row with the entries of a checked state."""
        super().resume(row, state)
        self.covered[row] = state["covered"]
        if "measured" in state:
            self._measured[row] = state["measured"]
