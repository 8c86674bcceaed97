"""n robots whose chassis is held in the air: only their cranks turn."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import non_negative, whole_number
from jansen_env.engine import crank_tracking
from jansen_env.engine.jit import Kernel
from jansen_env.plants.fixed_base import FixedBaseBatch, FixedBasePlant, check_crank_state
from jansen_env.rendering import Frame
from jansen_env.robot import Robot
from jansen_env.robot.motor import IDEAL, Motor
from jansen_env.world.actuated import ActuatedRobots, Bools, Draw, Ints
from jansen_env.world.argument_checks import control_period, flag, option
from jansen_env.world.broadcasting import broadcast_numbers
from jansen_env.world.entries import Observed
from jansen_env.world.settings import per_robot, single_only

TORQUE_LIMIT = 5.0  # N m, of an ideal motor
START_ANGLE, FURTHEST = crank_tracking.START_ANGLE, crank_tracking.LOST


@dataclass(frozen=True)
class HeldMachine:
    """A robot that is held, how it is driven and simulated."""

    robot: Robot | str = "paper"
    motor: Motor | str | None = None
    torque_limit: float | None = None
    delay: float | tuple[float, float] | Any = per_robot(0.0)
    control_dt: float = 0.01
    time_step: float = 0.001
    reset_noise_scale: float | Any = per_robot(0.1)
    track_joint_forces: bool = single_only(False)


class HeldRobots(ActuatedRobots):
    """n equal robots with their chassis held, see :class:`ActuatedRobots`.

    ``machine``: see :class:`jansen_env.envs.crank_env.JansenCrankEnv`. ``threads`` and
    ``by_default`` are of no use here. Methods: see :class:`jansen_env.world.world.World`.
    """

    RECORDS = {"machine": HeldMachine}
    OPTIONS = ("crank_angle", "crank_speed", "delay")
    SETTABLE = ("delay",)

    def __init__(
        self,
        num_envs: int,
        threads: int | None,
        machine: HeldMachine,
        by_default: Collection[str] = (),
    ) -> None:
        robot = self.driven_robot(machine.robot, machine.motor, machine.torque_limit)
        periods = control_period(machine.control_dt, machine.time_step)
        self.reset_noise_scale = broadcast_numbers(
            num_envs, "reset_noise_scale", machine.reset_noise_scale, non_negative
        )
        self.track_joint_forces = flag("track_joint_forces", machine.track_joint_forces)
        if self.track_joint_forces and num_envs > 1:
            raise ValueError(
                "track_joint_forces is True, must be False for several robots at once; "
                "vectorization_mode='sync' has it"
            )
        super().__init__([robot] * num_envs, crank_tracking.HELD_ROW, periods, machine.delay)
        self.plant = FixedBaseBatch(robot, num_envs, self.time_step)
        self.entries = [
            Observed("cos_crank_angle", "1", -1.0, 1.0),
            Observed("sin_crank_angle", "1", -1.0, 1.0),
            Observed("crank_speed", "rad/s", -np.inf, np.inf),
        ]
        self._joint_force = np.zeros(1)
        if self.track_joint_forces:
            self.step_arrays = {"joint_force_max": self._joint_force}

    @classmethod
    def driven_robot(
        cls, robot: Robot | str, motor: Motor | str | None, torque_limit: float | None
    ) -> Robot:
        """Return the robot of :class:`ActuatedRobots`; an ideal motor has :data:`TORQUE_LIMIT`."""
        chosen = super().driven_robot(robot, motor, torque_limit)
        if motor is None and torque_limit is None and chosen.motor == IDEAL:
            chosen = replace(chosen, motor=replace(IDEAL, torque_limit=TORQUE_LIMIT))
        return chosen

    @property
    def plant_of_one(self) -> FixedBasePlant:
        """The plant of a robot that is alone."""
        return FixedBasePlant.of(self.plant)

    def connect(
        self,
        observed: Sequence[Observed],
        observation: NDArray[np.float32],
        progress: Callable[[int], tuple[float, float]],
    ) -> None:
        """Take nothing: the crank task reads the robots itself."""

    def reset(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]],
        draw: Draw,
    ) -> list[Any]:
        """Start episodes of some robots, see ``World``."""
        each = zip(rows.tolist(), generators, options, strict=True)
        drawn = [self._draw(row, rng, own, draw) for row, rng, own in each]
        self.plant.states[rows] = [start[:2] for start in drawn]
        self.begin_delay(rows, np.array([start[2] for start in drawn]))
        self._clear_episode(rows)
        self.truncated[rows] = False
        return [start[3] for start in drawn]

    def _draw(
        self, row: int, rng: np.random.Generator, options: dict[str, Any], draw: Draw
    ) -> tuple[float, float, float, Any]:
        """Draw a start: crank angle (rad) and speed (rad/s), delay (s), the task's numbers."""
        # Drawn in any case, so that fixing one leaves the others as they were.
        own = draw(row, rng, options)
        noise = self.reset_noise_scale[row]
        angle = START_ANGLE + noise * rng.uniform(-1.0, 1.0)
        speed = noise * rng.uniform(-1.0, 1.0)
        delay = self._draw_delay(row, rng, options)
        limits = START_ANGLE - FURTHEST, START_ANGLE + FURTHEST
        angle = option(options, "crank_angle", angle, *limits)
        return angle, option(options, "crank_speed", speed), delay, own

    def _clear_episode(self, rows: Ints, action: float = 0.0, steps: int = 0) -> None:
        """Begin robots' episodes: nothing is left of the one before."""
        self.rows[rows] = np.zeros((), crank_tracking.HELD_ROW)
        self.rows["action"][rows] = self.rows["action_before"][rows] = action
        self.rows["steps"][rows] = steps

    def step(
        self, actions: Any, active: Bools, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold torques for ``control_dt`` seconds, see ``World``."""
        plant = self.plant
        self._take_actions(actions, active)
        plant.step(self.torque, self.steps, self.earlier, self.switch)
        if meanwhile is not None:
            meanwhile()
        if plant.any_diverged or self._any_truncated:
            self._truncate(plant.diverged & active)
        if self.track_joint_forces:
            forces = plant.joint_forces(0, float(self.torque[0]))
            self._joint_force[0] = forces.largest()[0]

    def checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return a change of the delay, s, ready for :meth:`apply`."""
        return {name: self.checked_delay_range(value) for name, value in changes.items()}

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Put a change in force."""
        for value in checked.values():
            self.delay_range[row] = value

    def get_attr(self, name: str) -> list[Any] | None:
        """Return ``delay`` (s, of this episode), ``robot`` or ``state`` of each robot."""
        if name == "delay":
            return [self.delay_of(row) for row in range(self.num_envs)]
        if name == "robot":
            return list(self.robots)
        return list(self.plant.states.copy()) if name == "state" else None

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on, see ``World``."""
        return {
            "plant": self.plant.states[row].copy(),
            "steps": int(self.rows[row]["steps"]),
            **self.actuation_state(row),
        }

    def checked_state(self, row: int, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return a state ready for :meth:`restore`, see ``World``."""
        return {
            **self.checked_actuation(state),
            "plant": check_crank_state(state["plant"]),
            "steps": whole_number("state['steps']", state["steps"]),
        }

    def restore(self, row: int, state: dict[str, Any]) -> None:
        """Go on from a state of :meth:`checked_state`."""
        one = np.array([row])
        self.plant.states[row] = state["plant"]
        self.begin_delay(one, np.array([state["delay"]]), state["asked"])
        self._clear_episode(one, state["action"], state["steps"])

    def scene(self, row: int) -> dict[str, Any]:
        """Return the arguments of the renderer."""
        return {"robot": self.robots[row], "terrain_points": None, "speed_unit": "rad/s"}

    def frame(self, row: int) -> Frame:
        """Return the picture data of a robot as it stands, without a command."""
        angle, speed = self.plant.states[row].tolist()
        toes = len(self.robots[row].legs)
        return Frame(
            q=np.array([0.0, 0.0, 0.0, angle]),
            contact_point=np.zeros((toes, 2)),
            contact_tangent=np.zeros((toes, 2)),
            contact_force=np.zeros((toes, 2)),
            slipping=np.zeros(toes, bool),
            command=None,
            speed=speed,
            torque=float(self.torque[row]),
            torque_limit=float(self.full_torque[row]),
            time=float(self.rows[row]["steps"]) * self.control_dt,
        )

    def kernels(self) -> list[Kernel]:
        """Return what is compiled of it, but for the plant."""
        return [self._action_kernel()]
