"""The crank task of n robots, whole: arguments, reset, physics, observation, reward, information.

The numbers of a step are worked out in :mod:`jansen_env.engine.crank_tracking`. What they mean is
documented in :class:`jansen_env.envs.crank.JansenCrankEnv`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import non_negative, whole_number, within
from jansen_env.engine import crank_tracking as task
from jansen_env.engine.jit import Kernel, prepare
from jansen_env.envs import arguments
from jansen_env.envs.core import Bools, Information, Ints, Observed, Task
from jansen_env.motor import IDEAL, Motor
from jansen_env.plants.fixed_base import FixedBaseBatch, FixedBasePlant, check_crank_state
from jansen_env.rendering import Frame
from jansen_env.robot import Robot

Array = NDArray[np.float64]

SPEED_COMMAND = 1.0  # rad/s, the paper's
FASTEST_COMMAND = 10.0  # rad/s
TORQUE_LIMIT = 5.0  # N m, of an ideal motor
START_ANGLE, LOST = task.START_ANGLE, task.LOST
OBSERVED = (
    Observed("cos_crank_angle", "1", -1.0, 1.0),
    Observed("sin_crank_angle", "1", -1.0, 1.0),
    Observed("crank_speed", "rad/s", -np.inf, np.inf),
    Observed("tracking_error", "rad", -np.inf, np.inf),
    Observed("speed_command", "rad/s", -FASTEST_COMMAND, FASTEST_COMMAND),
)


class CrankTask(Task):
    """Turn the crank of a Jansen linkage along a reference; the chassis is held in the air.

    Args:
        num_envs: robots. threads: taken as the walker's, of no use here.
        robot ... track_joint_forces: see :class:`jansen_env.envs.crank.JansenCrankEnv`;
            ``speed_command``, ``delay`` and ``reset_noise_scale`` may be one for all robots or one
            for each.

    Attributes:
        speed_command: (n, 2) rad/s, range of the next commands.
        plant: the plant of a robot that is alone, else None. batch: what moves the robots.

    Raises:
        ValueError: an argument out of range, or not one for each robot; LinkageError: the robot
            cannot turn its crank.
    """

    OF_EACH = ("speed_command", "delay", "reset_noise_scale")
    ONE_ALONE = {"track_joint_forces": False}
    SETTABLE = ("speed_command", "delay")

    def __init__(
        self,
        num_envs: int = 1,
        threads: int | None = None,
        *,
        robot: Robot | str = "paper",
        speed_command: float | tuple[float, float] | Any = SPEED_COMMAND,
        motor: Motor | str | None = None,
        torque_limit: float | None = None,
        delay: float | tuple[float, float] | Any = 0.0,
        control_dt: float = 0.01,
        time_step: float = 0.001,
        tracking_weight: float = 1.0,
        torque_weight: float = 1.0,
        reset_noise_scale: float | Any = 0.1,
        track_joint_forces: bool = False,
    ) -> None:
        self.num_envs = n = num_envs
        self.robots = [self.driven_robot(robot, motor, torque_limit)] * n
        self.speed_command = arguments.ranges_of_each(
            n, "speed_command", speed_command, -FASTEST_COMMAND, FASTEST_COMMAND
        )
        self.control_dt, step = arguments.control_period(control_dt, time_step)
        self._weights = np.zeros(1, task.REWARD)
        self._weights[0] = (
            non_negative("tracking_weight", tracking_weight),
            non_negative("torque_weight", torque_weight),
        )
        self.reset_noise_scale = arguments.numbers_of_each(
            n, "reset_noise_scale", reset_noise_scale, non_negative
        )
        self.track_joint_forces = arguments.flag("track_joint_forces", track_joint_forces)
        if self.track_joint_forces and n > 1:
            raise ValueError(
                "track_joint_forces is True, must be False for several robots at once; "
                "vectorization_mode='sync' has it"
            )
        self.plant = FixedBasePlant(self.robots[0], step) if n == 1 else None
        self.batch = (
            FixedBaseBatch(self.robots[0], n, step) if self.plant is None else self.plant.batch
        )
        self._steps = round(self.control_dt / step)
        self._allocate(task.ROW, OBSERVED, delay, step)
        self._joint_force = np.zeros(1)
        self.information = self._inform()
        prepare(
            *self._kernels(),
            Kernel("observation", task.describe, (np.arange(1), *self._arguments_of_description())),
            Kernel("reward", task.finish_step, (np.ones(n, bool), *self._arguments_of_step())),
        )

    @classmethod
    def driven_robot(
        cls, robot: Robot | str, motor: Motor | str | None, torque_limit: float | None
    ) -> Robot:
        """Return the robot as of :class:`Task`; an ideal motor has :data:`TORQUE_LIMIT`."""
        chosen = super().driven_robot(robot, motor, torque_limit)
        if motor is None and torque_limit is None and chosen.motor == IDEAL:
            chosen = replace(chosen, motor=replace(IDEAL, torque_limit=TORQUE_LIMIT))
        return chosen

    def _inform(self) -> Information:
        loads = {"joint_force_max": self._joint_force} if self.track_joint_forces else {}
        return Information(self.rows, {}, loads)

    def _start(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]],
    ) -> None:
        """Start episodes of some robots, see :class:`Task`."""
        each = zip(rows.tolist(), generators, options, strict=True)
        drawn = np.array([self._draw(row, rng, own) for row, rng, own in each])
        commands, angles, speeds, delays = drawn.T
        self.batch.states[rows] = np.stack([angles, speeds], axis=1)
        self._begin_delay(rows, delays)
        self._begin(rows, commands)

    def _begin(
        self, rows: Ints, commands: Array, actions: float | Array = 0.0, steps: int = 0
    ) -> None:
        """Begin robots' episodes: nothing is left of the one before."""
        kept = self.rows
        kept[rows] = np.zeros((), task.ROW)
        kept["action"][rows], kept["steps"][rows] = actions, steps
        kept["info"]["speed_command"][rows] = commands
        self.reward[rows] = 0.0

    def _draw(
        self, row: int, rng: np.random.Generator, options: dict[str, Any]
    ) -> tuple[float, float, float, float]:
        """How an episode starts: command (rad/s), crank angle (rad) and speed (rad/s), delay (s)."""
        # Drawn in any case, so that fixing one leaves the others as they were.
        command = rng.uniform(*self.speed_command[row])
        noise = self.reset_noise_scale[row]
        angle = START_ANGLE + noise * rng.uniform(-1.0, 1.0)
        speed = noise * rng.uniform(-1.0, 1.0)
        arguments.known_options(options, ("speed_command", "crank_angle", "crank_speed", "delay"))
        delay = self._draw_delay(row, rng, options)
        command = arguments.option(
            options, "speed_command", command, -FASTEST_COMMAND, FASTEST_COMMAND
        )
        angle = arguments.option(
            options, "crank_angle", angle, START_ANGLE - LOST, START_ANGLE + LOST
        )
        speed = arguments.option(options, "crank_speed", speed)
        return command, angle, speed, delay

    def step(
        self, actions: Any, active: Bools, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold torques for ``control_dt`` seconds, see :class:`Task`."""
        batch = self.batch
        self._take_actions(actions, active)
        batch.step(self.torque, self._steps, self.earlier, self.switch)
        if meanwhile is not None:
            meanwhile()
        task.finish_step(active, *self._arguments_of_step())
        if batch.any_diverged or self._any_truncated:
            self._truncate(batch.diverged & active)
        if self.track_joint_forces:
            forces = batch.joint_forces(0, float(self.torque[0]))
            self._joint_force[0] = forces.largest()[0]

    def reference(self, row: int) -> float:
        """r(t) = w t + pi, rad: where a robot's crank should be now."""
        kept = self.rows[row]
        return float(kept["info"]["speed_command"] * kept["steps"] * self.control_dt + START_ANGLE)

    def _describe(self, rows: Ints) -> None:
        """Fill observations and information of some robots with what is the case now."""
        task.describe(rows, *self._arguments_of_description())

    def _arguments_of_step(self) -> tuple[Any, ...]:
        batch = self.batch
        return (
            batch.rows, batch.sums, self.control_dt, self._weights, self.rows, self.reward,
            self.terminated, self.observation,
        )  # fmt: skip

    def _arguments_of_description(self) -> tuple[Any, ...]:
        return self.batch.rows, self.control_dt, self.rows, self.observation

    def set_parameters(self, row: int, **changes: Any) -> None:
        """Change a robot's ``speed_command``, rad/s, and ``delay``, s, of its next episodes.

        Both are numbers or ranges.

        Raises:
            ValueError: a value out of range. TypeError: another name.
        """
        arguments.known_parameters(changes, self.SETTABLE)
        checks: dict[str, Callable[[Any], tuple[float, float]]] = {
            "speed_command": lambda value: arguments.number_range(
                "speed_command", value, -FASTEST_COMMAND, FASTEST_COMMAND
            ),
            "delay": self._checked_delay_range,
        }
        checked = {name: checks[name](value) for name, value in changes.items()}  # or nothing
        for name, limits in checked.items():
            (self.speed_command if name == "speed_command" else self.delay_range)[row] = limits

    def of_each(self, name: str) -> list[Any] | None:
        """``speed_command``, ``delay`` (s, of this episode), ``robot`` and ``state`` of each robot.

        None for another name.
        """
        if name == "delay":
            return [self._delay_state(row)["delay"] for row in range(self.num_envs)]
        if name == "speed_command":
            return [(low, high) for low, high in self.speed_command.tolist()]
        if name == "robot":
            return list(self.robots)
        return list(self.batch.states.copy()) if name == "state" else None

    def get_state(self, row: int) -> dict[str, Any]:
        """All that a robot's future depends on but its random numbers, see :class:`Task`."""
        kept = self.rows[row]
        return {
            "plant": self.batch.states[row].copy(),
            "command": float(kept["info"]["speed_command"]),
            "action": float(kept["action"]),
            "steps": int(kept["steps"]),
            **self._delay_state(row),
        }

    def set_state(self, row: int, state: Mapping[str, Any]) -> None:
        """Go on from a state of :meth:`get_state`, see :class:`Task`."""
        arguments.complete_state(state, self.get_state(row))
        plant = check_crank_state(state["plant"])
        command = within("state['command']", state["command"], -FASTEST_COMMAND, FASTEST_COMMAND)
        action = within("state['action']", state["action"], -1.0, 1.0)
        steps = whole_number("state['steps']", state["steps"])
        delay, asked = self._checked_delay(state)
        self.batch.states[row] = plant
        one = np.array([row])
        self._begin_delay(one, np.array([delay]), asked)
        self._begin(one, np.array([command]), action, steps)
        self._describe(one)

    def scene(self, row: int) -> dict[str, Any]:
        """Arguments of the renderer."""
        return {
            "robot": self.robots[row],
            "terrain_points": None,
            "speed_range": 2.0 * max(1e-3, *map(abs, self.speed_command[row].tolist())),
            "speed_unit": "rad/s",
        }

    def frame(self, row: int) -> Frame:
        """What is to be drawn of a robot as it stands."""
        angle, speed = self.batch.states[row].tolist()
        toes = len(self.robots[row].legs)
        return Frame(
            q=np.array([0.0, 0.0, 0.0, angle]),
            contact_point=np.zeros((toes, 2)),
            contact_tangent=np.zeros((toes, 2)),
            contact_force=np.zeros((toes, 2)),
            slipping=np.zeros(toes, bool),
            command=float(self.rows[row]["info"]["speed_command"]),
            speed=speed,
            torque=float(self.torque[row]),
            torque_limit=float(self.full_torque[row]),
            time=float(self.rows[row]["steps"]) * self.control_dt,
        )

    def close(self) -> None:
        """Nothing is held."""
