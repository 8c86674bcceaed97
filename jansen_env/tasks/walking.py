"""The walking task: follow a commanded speed, with little slip, energy and effort.

The numbers of a step are worked out in :mod:`jansen_env.engine.walk_reward`. What they mean is
documented in :class:`jansen_env.envs.walker.JansenWalkerEnv`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, non_negative, positive, shown, within
from jansen_env.engine import walk_reward
from jansen_env.engine.jit import Kernel
from jansen_env.tasks.task import Task
from jansen_env.world.actuated import Array, Bools, Ints
from jansen_env.world.argument_checks import flag, interval, option
from jansen_env.world.broadcasting import broadcast_numbers, broadcast_ranges, number_range
from jansen_env.world.entries import Observed
from jansen_env.world.settings import per_robot

SPEED_COMMAND = (0.05, 0.8)  # m/s, the default range of commanded speeds
FASTEST_COMMAND = 2.0  # m/s, beyond it no command makes sense for this machine
STEPS_PER_TURN = 4  # of the feet, with two crank pins: means are taken over a quarter turn
ACCOUNTS: tuple[str, ...] = walk_reward.ACCOUNTS.names or ()  # lag and means
COMMANDED = ("speed_command", *ACCOUNTS)  # in the order of :func:`walk_reward.observe`


@dataclass(frozen=True)
class Commands:
    """Speeds that are asked for, m/s, and after how many seconds another one is drawn."""

    speed_command: float | tuple[float, float] | Any = per_robot(SPEED_COMMAND)
    command_interval: float | Any = per_robot(None)


@dataclass(frozen=True)
class RewardWeights:
    """Exponents of the reward's factors."""

    slip_weight: float = 1.0
    energy_weight: float = 1.0
    effort_weight: float = 1.0
    smoothness_weight: float = 1.0
    posture_weight: float = 1.0


@dataclass(frozen=True)
class Termination:
    """Criteria of a fall, and whether it ends the episode; the pitch in rad."""

    fall_pitch: float = walk_reward.FALLEN_PITCH
    fall_contact: bool = True
    terminate_when_fallen: bool = True


class WalkerTask(Task):
    """Walk at a commanded speed by the torque on one crank.

    Attributes:
        speed_command: (n, 2) m/s, range of the next commands.
        covered: (n, 2) m since the reset, walked towards the commands and commanded; with a
            curriculum.
    """

    RECORDS = {"commands": Commands, "weights": RewardWeights, "termination": Termination}
    ROW = walk_reward.ROW
    OPTIONS = ("speed_command",)
    SETTABLE = ("speed_command", "command")

    def take(self, records: dict[str, Any]) -> None:
        """Check and keep commands, weights and termination."""
        commands, weights, end = (records[name] for name in WalkerTask.RECORDS)
        n, fastest = self.num_envs, FASTEST_COMMAND
        self.speed_command = broadcast_ranges(
            n, "speed_command", commands.speed_command, -fastest, fastest
        )
        intervals = broadcast_numbers(n, "command_interval", commands.command_interval, interval)
        self._command_steps = np.maximum(1.0, np.rint(intervals / self.control_dt))
        self._commands_change = bool(np.isfinite(intervals).any())
        self.terminate_when_fallen = flag("terminate_when_fallen", end.terminate_when_fallen)
        self._settings = np.zeros(1, walk_reward.SETTINGS)
        exponents = zip(vars(weights), astuple(weights), strict=True)
        self._settings[0] = (
            *(non_negative(name, value) for name, value in exponents),
            positive("fall_pitch", end.fall_pitch),
            flag("fall_contact", end.fall_contact),
        )
        self.covered = np.zeros((n, 2))
        self._measured = np.zeros(0, walk_reward.ACCOUNTS)

    @property
    def own_entries(self) -> Sequence[Observed]:
        """The command, the lag and the means."""
        any_number, positive_number = (-np.inf, np.inf), (0.0, np.inf)
        furthest = walk_reward.FURTHEST_TARGET
        return [
            Observed("speed_command", "m/s", -FASTEST_COMMAND, FASTEST_COMMAND),
            Observed("lag", "m", -furthest, furthest),
            Observed("mean_speed", "m/s", *any_number),
            Observed("mean_slip", "m/s", *positive_number),
            Observed("mean_power", "W", *positive_number),
            Observed("rms_torque", "N m", *positive_number),
        ]

    @property
    def entries(self) -> Sequence[Observed]:
        """All that is observed: the command before the feet, lag and means before the heights.

        What a task that derives from this one adds comes last.
        """
        known = {one.name: one for one in self.world.entries}
        own = {one.name: one for one in self.own_entries}
        heights = [known.pop(name) for name in [*known] if name.startswith("height_scan_")]
        last, command = known.pop("last_action"), own.pop("speed_command")
        loads = [known.pop(name) for name in [*known] if name.startswith("toe_load_")]
        accounts = [own.pop(name) for name in ACCOUNTS]
        return [*known.values(), command, *loads, last, *accounts, *heights, *own.values()]

    def connect(self) -> None:
        """Let noisy sensors measure lag and means by odometry."""
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

    def draw(self, row: int, rng: np.random.Generator, options: dict[str, Any]) -> float:
        """Draw a robot's command, m/s."""
        command = rng.uniform(*self.speed_command[row])
        return option(options, "speed_command", command, -FASTEST_COMMAND, FASTEST_COMMAND)

    def begin(self, rows: Ints, drawn: Sequence[Any]) -> None:
        """Start with commands, m/s; lag and means are 0."""
        self.rows["mean_path"][rows] = abs(self.world.advance_per_turn) / STEPS_PER_TURN
        self.rows["next_command"][rows] = self.rows["info"]["speed_command"][rows] = drawn
        self.covered[rows] = 0.0
        if len(self._measured) > 0:
            self._measured[rows] = np.zeros((), walk_reward.ACCOUNTS)

    def score(self, rows: Ints) -> None:
        """Do nothing: :meth:`finish_step` scores."""

    def finish_step(self, active: Bools) -> None:
        """Score the step of the ``active`` robots (n,), and observe them, in one kernel."""
        if self._commands_change:
            self._draw_commands(active)
        if self.world.episodes.curriculum is not None:
            self._cover(active)
        walk_reward.finish_step(active, *self._step_arguments())
        if self.OBSERVES:  # a task that derives from this one
            self.observe(np.flatnonzero(active))
        if self.terminate_when_fallen:
            self.terminated[:] = self.rows["info"]["fallen"]

    def describe(self, rows: Ints) -> None:
        """Fill observations and information of some robots as they are now."""
        walk_reward.describe(rows, *self._describe_arguments())
        self.observe(rows)
        self.world.disturb(rows)

    def _step_arguments(self) -> tuple[Any, ...]:
        return (
            self._settings, self.rows, self.reward, self._error, self._measured, self._places,
            *self.world.step_arguments(),
        )  # fmt: skip

    def _describe_arguments(self) -> tuple[Any, ...]:
        return self.rows, self._places, *self.world.describe_arguments()

    def kernels(self) -> list[Kernel]:
        """Return what is compiled of it."""
        one, every = np.arange(1), np.ones(self.num_envs, bool)
        return [
            Kernel("observation", walk_reward.describe, (one, *self._describe_arguments())),
            Kernel("reward", walk_reward.finish_step, (every, *self._step_arguments())),
        ]

    def _draw_commands(self, active: Bools) -> None:
        """Draw the commands of the steps to come, where it is time for others."""
        elapsed = self.world.elapsed
        for row in np.flatnonzero(active & (elapsed % self._command_steps == 0)).tolist():
            # By the time, so that a state to go on from needs no more than the seed.
            rng = np.random.default_rng((self.world.seeds[row], elapsed[row]))
            self.rows[row]["next_command"] = rng.uniform(*self.speed_command[row])

    def _cover(self, active: Bools) -> None:
        """Add the step of the ``active`` robots (n,) to :attr:`covered`."""
        commands = np.where(active, self.rows["info"]["speed_command"], 0.0)
        path = self.world.plant.states[:, 0] - self.world.rows["x_before"]
        self.covered[:, 0] += np.sign(commands) * path
        self.covered[:, 1] += np.abs(commands) * self.control_dt

    def progress(self, row: int) -> tuple[float, float]:
        """Return how far a robot got towards its commands, m, and their mean size, m/s."""
        walked, commanded = self.covered[row].tolist()
        return walked, commanded / (max(1, int(self.world.elapsed[row])) * self.control_dt)

    def checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return changes of ``speed_command``, a number or a range, and ``command``, m/s."""
        limits = -FASTEST_COMMAND, FASTEST_COMMAND
        checks: dict[str, Callable[..., Any]] = {"speed_command": number_range, "command": within}
        return {name: checks[name](name, value, *limits) for name, value in changes.items()}

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Draw commands from another range from now on; give another one from the next step on."""
        if "speed_command" in checked:
            self.speed_command[row] = checked["speed_command"]
        if "command" in checked:
            kept = self.rows[row]
            kept["info"]["speed_command"] = kept["next_command"] = checked["command"]
            self.describe(np.array([row]))

    def get_attr(self, name: str) -> list[Any] | None:
        """Return what each robot has of its own: the world's, ``speed_command``, ``command``."""
        if name == "speed_command":
            return [(low, high) for low, high in self.speed_command.tolist()]
        if name == "command":
            return list(self.rows["info"]["speed_command"].tolist())
        return super().get_attr(name)

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on but its random numbers."""
        info = self.rows[row]["info"]
        state = {
            **self.world.get_state(row),
            "command": float(info["speed_command"]),
            "fallen": bool(info["fallen"]),
            **{name: float(info[name]) for name in ACCOUNTS},
            "covered": self.covered[row].copy(),
        }
        if len(self._measured) > 0:
            state["measured"] = dict(zip(ACCOUNTS, self._measured[row].item(), strict=True))
        return state

    def checked_state(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the task's entries of a state. Raises ValueError: one is out of range."""
        limits = -FASTEST_COMMAND, FASTEST_COMMAND
        measured = None
        if len(self._measured) > 0:
            measured = _checked_accounts("state['measured']", state["measured"])
        return {
            "command": within("state['command']", state["command"], *limits),
            "fallen": bool(state["fallen"]),
            "accounts": _checked_accounts("state", state),
            "covered": [finite("state['covered']", one) for one in state["covered"]],
            "measured": measured,
        }

    def resume(self, row: int, state: dict[str, Any]) -> None:
        """Fill a robot's row with what :meth:`checked_state` gave."""
        self.begin(np.array([row]), [state["command"]])
        info = self.rows[row]["info"]
        info["fallen"] = state["fallen"]
        for name, value in zip(ACCOUNTS, state["accounts"], strict=True):
            info[name] = value
        self.covered[row] = state["covered"]
        if state["measured"] is not None:
            self._measured[row] = state["measured"]

    def command(self, row: int) -> float:
        """Return a robot's command, m/s."""
        return float(self.rows[row]["info"]["speed_command"])

    @property
    def parameters(self) -> NDArray[np.float64]:
        """(n, 17) the numbers of all robots' episodes, see :mod:`jansen_env.parameters`."""
        numbers: Array = self.world.episodes.numbers
        return numbers


def _checked_accounts(label: str, given: Any) -> tuple[float, ...]:
    """Return lag and means in the order of ``walk_reward.ACCOUNTS``.

    Raises:
        ValueError: one is missing or out of range.
    """
    if not isinstance(given, Mapping) or not {*ACCOUNTS} <= {*given}:
        raise ValueError(f"{label} is {shown(given)}, must have {[*ACCOUNTS]}")
    furthest = walk_reward.FURTHEST_TARGET
    checks: dict[str, Callable[[str, Any], float]] = {
        "lag": partial(within, low=-furthest, high=furthest), "mean_speed": finite,
    }  # fmt: skip
    return tuple(
        checks.get(name, non_negative)(f"{label}[{name!r}]", given[name]) for name in ACCOUNTS
    )
