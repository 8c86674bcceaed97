"""n robots whose chassis is held in the air: only their cranks turn."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import whole_number
from jansen_env.engine import crank_tracking
from jansen_env.engine.integrator import DIVERGED
from jansen_env.parameters import LONGEST_DELAY
from jansen_env.plants.base import check_held, check_state
from jansen_env.plants.batch import Batch
from jansen_env.rendering import Frame
from jansen_env.robot import Robot
from jansen_env.robot.motor import IDEAL, Motor
from jansen_env.terrain import Terrain
from jansen_env.uniform import uniform
from jansen_env.world import argument_checks as arguments
from jansen_env.world.actuated import ActuatedRobots, Draw
from jansen_env.world.argument_checks import Bools, Filled, Ints, PerRobot, Range, option, single
from jansen_env.world.entries import Observed
from jansen_env.world.episode_lengths import EpisodeLengths
from jansen_env.world.randomization import load_randomization
from jansen_env.world.single_robots import MOST_STEPS

TORQUE_LIMIT = 5.0  # N m, of an ideal motor
START_ANGLE, FURTHEST = crank_tracking.START_ANGLE, crank_tracking.LOST


class HeldMachine(TypedDict, total=False):
    """A robot that is held, how it is driven and simulated."""

    robot: Annotated[Robot | str | Path, field(default="paper")]
    motor: Annotated[Motor | str | None, field(default=None)]
    torque_limit: Annotated[float | None, field(default=None)]
    delay: Annotated[PerRobot[Range], arguments.range_per_robot(0.0, 0.0, LONGEST_DELAY)]
    control_dt: Annotated[float, field(default=0.01)]
    time_step: Annotated[float, field(default=0.001)]
    reset_noise_scale: Annotated[PerRobot[float], arguments.per_robot(0.1, arguments.start_noise)]
    track_joint_forces: Annotated[bool, single(False, arguments.flag, only=True)]
    randomize: Annotated[
        PerRobot[Mapping[str, Any] | None],
        arguments.per_robot(None, partial(load_randomization, parameters=())),
    ]
    observe_lengths: Annotated[bool, single(False, arguments.flag)]


class HeldRobots(ActuatedRobots):
    """n robots, equal but for lengths, chassis held: see :class:`jansen_env.world.world.World`."""

    RECORDS = {"machine": HeldMachine}
    TAKE_ACTIONS = crank_tracking.take_actions
    OPTIONS = ("crank_angle", "crank_speed", "delay", "lengths")
    SETTABLE = ("delay",)

    def __init__(
        self,
        num_envs: int,
        threads: int | None,
        machine: Filled,
        by_default: Collection[str] = (),
    ) -> None:
        robot = self.driven_robot(machine.robot, machine.motor, machine.torque_limit)
        super().__init__(
            [robot] * num_envs, crank_tracking.HELD_ROW, machine.control_dt, machine.time_step,
            machine.delay,
        )  # fmt: skip
        self.reset_noise_scale = machine.reset_noise_scale
        ground = [Terrain.flat()] * num_envs
        self.plant = Batch(self.robots, ground, self.time_step, threads=threads, held=True)
        self.lengths = EpisodeLengths(self.robots, machine.randomize, machine.observe_lengths)
        if self.lengths.values is not None:
            self.groups["lengths"] = self.lengths.values
        self.entries = [
            Observed("cos_crank_angle", "1", -1.0, 1.0),
            Observed("sin_crank_angle", "1", -1.0, 1.0),
            Observed("crank_speed", "rad/s", -np.inf, np.inf),
        ]
        if machine.track_joint_forces:
            self.arrays = {"joint_force_max": np.zeros(1)}

    @classmethod
    def driven_robot(
        cls, robot: Robot | str, motor: Motor | str | None, torque_limit: float | None
    ) -> Robot:
        """Return the robot of :class:`ActuatedRobots`; an ideal motor has :data:`TORQUE_LIMIT`."""
        chosen = super().driven_robot(robot, motor, torque_limit)
        if motor is None and torque_limit is None and chosen.motor == IDEAL:
            chosen = replace(chosen, motor=replace(IDEAL, torque_limit=TORQUE_LIMIT))
        return chosen

    def connect(
        self, observed: Sequence[Observed], observation: NDArray[np.float32], *_: Any
    ) -> None:
        """Take the array of observations (n, d), and its columns."""
        self.lengths.connect(observed, observation)

    def reset(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]],
        draw: Draw,
    ) -> list[Any]:
        """Start episodes of some robots, see ``World``."""
        each = list(zip(rows.tolist(), generators, options, strict=True))
        drawn = [self._draw(*one, draw) for one in each]
        factors = self.lengths.factors
        seeds = [int(rng.integers(2**63)) if factors[row] else None for row, rng, _ in each]
        self.exchange(self._plan_robots(each, seeds))
        self.plant.place(rows, np.array([start[0] for start in drawn]))
        self.plant.states[rows, 7] = [start[1] for start in drawn]
        self.begin_delay(rows, np.array([start[2] for start in drawn]))
        self._clear_episode(rows)
        self.truncated[rows] = False
        return [start[3] for start in drawn]

    def _draw(
        self, row: int, rng: np.random.Generator, options: dict[str, Any], draw: Draw
    ) -> tuple[float, float, float, Any]:
        """Draw crank angle (rad) and speed (rad/s), delay (s), and the task's numbers."""
        # Drawn in any case, so that fixing one leaves the others as they were.
        own = draw(row, rng, options)
        noise = self.reset_noise_scale[row]
        angle = START_ANGLE + noise * uniform(rng, -1.0, 1.0)
        speed = noise * uniform(rng, -1.0, 1.0)
        delay = self._draw_delay(row, rng, options)
        limits = START_ANGLE - FURTHEST, START_ANGLE + FURTHEST
        angle = option(options, "crank_angle", angle, *limits)
        return angle, option(options, "crank_speed", speed, -DIVERGED, DIVERGED), delay, own

    def _clear_episode(self, rows: Ints, action: float = 0.0, steps: int = 0) -> None:
        self.rows[rows] = np.zeros((), crank_tracking.HELD_ROW)
        self.rows["action"][rows] = self.rows["action_before"][rows] = action
        self.rows["steps"][rows] = self.elapsed[rows] = steps
        for largest in self.arrays.values():
            largest[:] = 0.0

    def step(
        self,
        actions: Any,
        active: Bools,
        finish: Callable[[Ints], None],
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Hold torques for ``control_dt`` seconds, see ``World``."""
        plant = self.plant
        self._take_actions(actions, active)
        moved = active.nonzero()[0]
        plant.step(
            self.torque, self.steps, self.earlier, self.switch, moved, meanwhile, finish=finish
        )
        if plant.any_diverged or self._any_truncated:
            self._truncate(plant.diverged & active)
        if self.arrays and active[0]:  # the one robot
            loads = plant.joint_forces(float(self.torque[0]))
            self.arrays["joint_force_max"][0] = loads.largest()[0]

    def checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return a change of the delay, s, ready for :meth:`apply`."""
        return {name: self.checked_delay_range(name, value) for name, value in changes.items()}

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Apply a change."""
        for value in checked.values():
            self.delay_range[row] = value

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on, see ``World``."""
        return {**super().get_state(row), "steps": int(self.rows[row]["steps"])}

    def checked_state(self, row: int, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return a state ready for ``restore``, see ``World``."""
        plant = check_state(state["plant"])
        check_held(plant)
        return {
            **super().checked_state(row, state),
            "plant": plant,
            "steps": whole_number("state['steps']", state["steps"], MOST_STEPS),
        }

    def restore(self, row: int, state: dict[str, Any]) -> None:
        """Go on from a state of :meth:`checked_state`."""
        one = np.array([row])
        self.exchange(state["builds"])
        self.plant.set_state(row, state["plant"])
        self.begin_delay(one, np.array([state["delay"]]), state["asked"])
        self._clear_episode(one, state["action"], state["steps"])

    def scene(self, row: int) -> dict[str, Any]:
        """Return the arguments of the renderer."""
        return {"robot": self.robots[row], "terrain_points": None, "speed_unit": "rad/s"}

    def frame(self, row: int, command: float | None) -> Frame:
        """Return the picture data of a robot as it stands."""
        state = self.plant.states[row]
        none = np.zeros((len(self.robots[row].toes), 2))
        return Frame(
            q=state[:4].copy(), contact_point=none, contact_tangent=none,
            contact_force=none, slipping=none[:, 0] > 0.0, command=command, speed=float(state[7]),
            torque=float(self.torque[row]), torque_limit=float(self.full_torque[row]),
            time=float(self.rows[row]["steps"]) * self.control_dt,
        )  # fmt: skip
