"""The walking task of n robots, whole: arguments, reset, physics, observation, reward, information.

The numbers of a step are worked out in :mod:`jansen_env.engine.task`. What they mean is documented
in :class:`jansen_env.envs.walker.JansenWalkerEnv`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import non_negative, positive
from jansen_env.curriculum import Curriculum
from jansen_env.engine import task
from jansen_env.engine.jit import Kernel, prepare
from jansen_env.envs import arguments
from jansen_env.envs.core import Bools, Information, Ints, Observed
from jansen_env.envs.disturbances import NoisySensors, Pushes
from jansen_env.envs.walker_robots import FASTEST_COMMAND, WalkerRobots, schedule_of
from jansen_env.gravity import GRAVITY
from jansen_env.kinematics import advance_per_turn
from jansen_env.motor import Motor
from jansen_env.noise import Noise, make_noise
from jansen_env.plants.base import BatchedPlant, Plant
from jansen_env.plants.initial_pose import static_deflection
from jansen_env.plants.make import make_batch, plant_of, plant_time_step
from jansen_env.push import Push, make_push
from jansen_env.robot import Compliance, Payload, Robot
from jansen_env.terrain import Terrain
from jansen_env.world.episode_parameters import Draws, EpisodeParameters, Plan
from jansen_env.world.parameters import CHANGES, PARAMETERS

Array = NDArray[np.float64]

SPEED_COMMAND = (0.05, 0.8)  # m/s, the default range of commanded speeds
STEPS_PER_TURN = 4  # of the feet, with two crank pins: means are taken over a quarter turn


class WalkerTask(WalkerRobots):
    """Walk at a commanded speed by the torque on one crank.

    Args:
        num_envs: robots. threads: cores to use; None for as many as pay.
        robot ... push: see :class:`jansen_env.envs.walker.JansenWalkerEnv`. Those
            in :attr:`OF_EACH` may be one for all robots or one for each: a sequence of terrains
            (or their names), arrays (n,), a sequence of payloads; ``speed_command`` an array (n,)
            of numbers or (n, 2) of ranges; anything in :class:`jansen_env.envs.arguments.Each`.

    Attributes:
        robots: as they are without what is drawn.
        weight: (n,) N. plant: the plant of a robot that is alone, else None.
        batch: what moves the robots.

    Raises:
        ValueError: an argument out of range, or not one for each robot; LinkageError: the robot
            cannot turn its crank.
    """

    OF_EACH = (
        "terrain", "friction", "restitution", "payload", "motor", "torque_limit",
        "pad_compliance", "delay", "speed_command", "command_interval", "reset_noise_scale",
        "terrain_level", "randomize",
    )  # fmt: skip
    ONE_ALONE = {"plant": "projection", "track_joint_forces": False}
    by_default: frozenset[str] = frozenset()  # arguments that a derived task has chosen
    SETTABLE = (
        "friction", "restitution", "payload", "motor", "pad_compliance", "delay", "speed_command",
        "command", "terrain_level", *CHANGES,
    )  # fmt: skip

    def __init__(
        self,
        num_envs: int = 1,
        threads: int | None = None,
        *,
        robot: Robot | str = "paper",
        terrain: Terrain | str | Any = "flat",
        friction: float | Any = None,
        restitution: float | Any = None,
        speed_command: float | tuple[float, float] | Any = SPEED_COMMAND,
        command_interval: float | Any = None,
        payload: Payload | float | Any = None,
        motor: Motor | str | Any = None,
        torque_limit: float | Any = None,
        pad_compliance: Compliance | Any = None,
        delay: float | tuple[float, float] | Any = 0.0,
        control_dt: float = 0.02,
        time_step: float | None = None,
        plant: str = "projection",
        slip_weight: float = 1.0,
        energy_weight: float = 1.0,
        effort_weight: float = 1.0,
        smoothness_weight: float = 1.0,
        posture_weight: float = 1.0,
        reset_noise_scale: float | Any = 0.1,
        fall_pitch: float = task.FALLEN_PITCH,
        fall_contact: bool = True,
        terminate_when_fallen: bool = True,
        track_joint_forces: bool = False,
        terrain_level: int | tuple[int, int] | Any = 0,
        curriculum: Curriculum | bool | None = None,
        randomize: Mapping[str, Any] | Any = None,
        height_scan: tuple[float, float, int] | None = None,
        noise: Noise | Mapping[str, Any] | None = None,
        push: Push | Mapping[str, Any] | None = None,
    ) -> None:
        self.num_envs = n = num_envs
        grounds = arguments.terrain_of_each(n, terrain, friction, restitution)
        randomizations = arguments.randomization_of_each(n, randomize)
        self.robots = arguments.robot_of_each(
            n, robot, payload, motor, pad_compliance, torque_limit
        )
        self.speed_command = arguments.ranges_of_each(
            n, "speed_command", speed_command, -FASTEST_COMMAND, FASTEST_COMMAND
        )
        self.control_dt, step = arguments.control_period(
            control_dt, plant_time_step(plant, time_step)
        )
        self.reset_noise_scale = arguments.numbers_of_each(
            n, "reset_noise_scale", reset_noise_scale, non_negative
        )
        intervals = arguments.numbers_of_each(
            n, "command_interval", command_interval, arguments.interval
        )
        self._command_steps = np.maximum(1.0, np.rint(intervals / self.control_dt))
        self._commands_change = bool(np.isfinite(intervals).any())
        self.terminate_when_fallen = arguments.flag("terminate_when_fallen", terminate_when_fallen)
        self.track_joint_forces = arguments.flag("track_joint_forces", track_joint_forces)
        self._settings = np.zeros(1, task.SETTINGS)
        self._settings[0] = (
            self.control_dt,
            non_negative("slip_weight", slip_weight),
            non_negative("energy_weight", energy_weight),
            non_negative("effort_weight", effort_weight),
            non_negative("smoothness_weight", smoothness_weight),
            non_negative("posture_weight", posture_weight),
            positive("fall_pitch", fall_pitch),
            arguments.flag("fall_contact", fall_contact),
        )
        for robot_of_one in self.robots:
            static_deflection(robot_of_one, GRAVITY)  # or its feet are too soft
        self.batch = self._make_batch(plant, grounds.terrains, step, threads)
        self._steps = round(self.control_dt / step)
        self._scan = arguments.scanned_places(height_scan)
        longest = max(one.longest_delay for one in randomizations)
        observed = _observed(self.batch.toes, len(self._scan))
        self._allocate(task.ROW, observed, delay, step, longest)
        self._pushes = Pushes(n, make_push(push), self._steps, step)
        kind = make_noise(noise)
        self._sensors = None if kind is None else NoisySensors(n, kind, self.observed)
        self._odometry = np.zeros((0, 2)), np.zeros(0, task.ACCOUNTS)
        if self._sensors is not None:
            self._odometry = self._sensors.mean_error, self._sensors.measured
        advance = advance_per_turn(self.robots[0])  # what robots may differ in does not change it
        self.rows["direction"] = math.copysign(1.0, advance)
        self.rows["mean_path"] = abs(advance) / STEPS_PER_TURN
        self.full_torque *= self.rows["direction"]
        self.rows["weight"] = [robot.mass * GRAVITY for robot in self.robots]
        self._links_mass = np.array([robot.links_mass for robot in self.robots])
        self.loads = np.zeros((n, self.batch.toes))
        self.elapsed = np.zeros(n, np.int64)
        self.covered = np.zeros((n, 2))
        self._seed = np.zeros(n, np.int64)  # of what episodes draw after their start
        if self.track_joint_forces:
            self.traceable.tracing = True
        self._joint_loads = np.zeros(2)
        draws = Draws(
            arguments.levels_of_each(n, terrain_level), randomizations,
            arguments.load_curriculum(curriculum), self.by_default,
        )  # fmt: skip
        has = {"noise_level": self._sensors is not None, "push_strength": self._pushes.at_random}
        self.episodes = EpisodeParameters(self.batch, self.robots, grounds, draws, has)
        self.information = self._inform()
        prepare(
            *self._kernels(),
            Kernel("observation", task.describe, (np.arange(1), *self._arguments_of_description())),
            Kernel("reward", task.finish_step, (np.ones(n, bool), *self._arguments_of_step())),
        )

    def _inform(self) -> Information:
        arrays: dict[str, NDArray[Any]] = {
            "slip": self.batch.slip,
            "contact_force": self.batch.contact_force,
        }
        if self._sensors is not None:
            arrays["true_observation"] = self._sensors.truth
        loads = {
            "joint_force_max": self._joint_loads[:1],
            "joint_impulse_max": self._joint_loads[1:],
        }
        return Information(
            self.rows, arrays, loads if self.track_joint_forces else {},
            self.episodes.values if self.episodes.varies else None,
        )  # fmt: skip

    def _make_batch(
        self, name: str, terrains: list[Terrain], time_step: float, threads: int | None
    ) -> BatchedPlant:
        """Make what moves the robots."""
        if self.num_envs > 1 and (name != "projection" or self.track_joint_forces):
            raise ValueError(
                f"plant is {name!r} and track_joint_forces {self.track_joint_forces}, must be "
                "'projection' and False for several robots at once; "
                "vectorization_mode='sync' has the others"
            )
        return make_batch(name, self.robots, terrains, time_step, threads)

    @property
    def plant(self) -> Plant | None:
        """The plant of a robot that is alone, else None."""
        return plant_of(self.batch) if self.num_envs == 1 else None

    @property
    def traceable(self) -> BatchedPlant:
        """The plant, if it knows the forces in its joints; ValueError if not."""
        if self.num_envs == 1 and self.batch.knows_joint_forces:
            return self.batch
        raise ValueError(
            "joint forces are known of one robot with plant='projection' only: track_joint_forces "
            "must be False"
        )

    @property
    def parameters(self) -> Array:
        """(n, 17) the numbers of all robots' episodes, see :mod:`jansen_env.envs.parameters`."""
        return self.episodes.numbers

    @property
    def true_observation(self) -> NDArray[np.float32]:
        """(n, d) the observations without noise; where there is none, the observations themselves."""
        return self.observation if self._sensors is None else self._sensors.truth

    def _start(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]],
    ) -> None:
        """Start episodes of some robots, see :class:`jansen_env.envs.core.Task`."""
        each = list(zip(rows.tolist(), generators, options, strict=True))
        drawn = [self._draw(row, rng, own) for row, rng, own in each]
        seeds = [rng.integers(2**63) for rng in generators]  # of commands to come, pushes and noise
        commands, crank_angles, crank_speeds, delays = np.array(drawn).T
        plans = [
            self.episodes.plan(row, rng, own, delay, *self._walked(row))
            for (row, rng, own), delay in zip(each, delays.tolist(), strict=True)
        ]
        schedules = [schedule_of(own) for own in options]
        self._seed[rows] = seeds
        self._put_in_force(rows, plans)
        batch = self.batch
        batch.place(rows, crank_angles)
        self.loads[rows] = batch.contact_force[rows, :, 1] / self.weight[rows, None]
        states = batch.states[rows]
        states[:, 7] = crank_speeds
        for row, state in zip(rows.tolist(), states, strict=True):
            batch.set_state(row, state)
        self._begin_delay(rows, self.episodes.values["delay"][rows])
        self._begin(rows, commands)
        for row, pushes in zip(rows.tolist(), schedules, strict=True):
            self._pushes.schedule(row, *pushes)

    def _walked(self, row: int) -> tuple[float, float]:
        """How far a robot got in its last episode, m, and the mean size of its commands, m/s.

        0 before the first.
        """
        walked, commanded = self.covered[row].tolist()
        return walked, commanded / (max(1, int(self.elapsed[row])) * self.control_dt)

    def _cover(self, active: Bools) -> None:
        """Add the step of the ``active`` robots (n,) to :attr:`covered`."""
        commands = np.where(active, self.rows["info"]["speed_command"], 0.0)
        path = self.batch.states[:, 0] - self.rows["x_before"]
        self.covered[:, 0] += np.sign(commands) * path
        self.covered[:, 1] += np.abs(commands) * self.control_dt

    def _put_in_force(self, rows: Ints, plans: Sequence[Plan]) -> None:
        """Let robots be what is planned for their episodes."""
        self.episodes.begin(rows, plans)
        self._rate(rows)

    def _rate(self, rows: Ints) -> None:
        """Know the weights of robots as they are, and the torque of an action of 1."""
        values = self.episodes.values[rows]
        self.rows["weight"][rows] = GRAVITY * (
            values["mass_scale"] * self._links_mass[rows] + values["payload"]
        )
        limits = np.array([self.robots[row].motor.torque_limit for row in rows.tolist()])
        self.full_torque[rows] = self.rows["direction"][rows] * limits * values["motor_strength"]
        self._pushes.strength[rows] = values["push_strength"]
        if self._sensors is not None:
            self._sensors.level[rows] = values["noise_level"]

    def _begin(self, rows: Ints, commands: Array, actions: float | Array = 0.0) -> None:
        """Begin robots' episodes: nothing but what a robot is remains of the one before."""
        kept, info = self.rows, self.rows["info"]
        for name in ("info", "energy", "reward"):
            kept[name][rows] = np.zeros((), task.ROW[name])
        kept["action"][rows] = kept["action_before"][rows] = actions
        info["speed_command"][rows] = kept["next_command"][rows] = commands
        states = self.batch.states[rows]
        kept["x_before"][rows], info["x_velocity"][rows] = states[:, 0], states[:, 4]
        info["joint_gap"][rows] = self.batch.joint_gap[rows]
        self.reward[rows], self.elapsed[rows], self.covered[rows] = 0.0, 0, 0.0
        if self._sensors is not None:
            self._sensors.measured[rows] = np.zeros((), task.ACCOUNTS)

    def _draw(
        self, row: int, rng: np.random.Generator, options: dict[str, Any]
    ) -> tuple[float, float, float, float]:
        """How an episode starts: command (m/s), crank angle (rad) and speed (rad/s), delay (s)."""
        # Drawn in any case, so that fixing one leaves the others as they were.
        crank_angle = rng.uniform(0.0, 2.0 * math.pi)
        command = rng.uniform(*self.speed_command[row])
        crank_speed = self.reset_noise_scale[row] * rng.uniform(-1.0, 1.0)
        arguments.known_options(options, ("speed_command", "crank_angle", "pushes", *PARAMETERS))
        delay = self._draw_delay(row, rng, options)
        command = arguments.option(
            options, "speed_command", command, -FASTEST_COMMAND, FASTEST_COMMAND
        )
        crank_angle = arguments.option(options, "crank_angle", crank_angle)
        return command, crank_angle, crank_speed, delay

    def step(
        self, actions: Any, active: Bools, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold torques for ``control_dt`` seconds, see :class:`jansen_env.envs.core.Task`."""
        batch = self.batch
        self._take_actions(actions, active)
        pushes = self.pushes_to_come(active)
        self.elapsed += active
        self._draw_commands()
        asked = self.torque, self._steps, self.earlier, self.switch
        rows = None if active.all() else np.flatnonzero(active)
        batch.step(*asked, rows, meanwhile, pushes)
        if self.episodes.curriculum is not None:
            self._cover(active)
        moved = np.flatnonzero(active)
        if self._sensors is not None:
            self._sensors.draw(moved, self.elapsed, self._seed)
        task.finish_step(active, *self._arguments_of_step())
        if self._sensors is not None:
            self._sensors.add(moved, self.observation)
        if self.terminate_when_fallen:
            self.terminated[:] = self.rows["info"]["fallen"]
        if batch.joints_open:
            self.rows["info"]["joint_gap"] = batch.joint_gap
        if batch.any_diverged or self._any_truncated:
            self._truncate(batch.diverged & active)
        if self.track_joint_forces:
            diverged = batch.any_diverged
            self._joint_loads[:] = (0.0, 0.0) if diverged else self.traceable.peak_loads()

    def pushes_to_come(self, active: Bools) -> Array | None:
        """(n, steps, 2) N s on the ``active`` robots in the next step, see ``Batch.step``."""
        return self._pushes.of_step(active, self.elapsed, self._seed)

    def _draw_commands(self) -> None:
        """Draw the commands of the steps to come, where it is time for others."""
        if not self._commands_change:
            return
        for row in np.flatnonzero(self.elapsed % self._command_steps == 0).tolist():
            # By the time, so that a state to go on from needs no more than the seed.
            rng = np.random.default_rng((self._seed[row], self.elapsed[row]))
            self.rows[row]["next_command"] = rng.uniform(*self.speed_command[row])

    def _describe(self, rows: Ints) -> None:
        """Fill observations and information of some robots with what is the case now."""
        task.describe(rows, *self._arguments_of_description())
        if self._sensors is not None:
            self._sensors.draw(rows, self.elapsed, self._seed)
            self._sensors.add(rows, self.observation)

    def _arguments_of_step(self) -> tuple[Any, ...]:
        batch = self.batch
        return (
            batch.states, batch.slip, batch.contact_force, batch.rows, self._settings, self.rows,
            self.loads, self.reward, *self._odometry, self.batch.surface, self._scan,
            self.observation,
        )  # fmt: skip

    def _arguments_of_description(self) -> tuple[Any, ...]:
        return (
            self.batch.states, self.batch.rows, self.rows, self.loads, self.batch.surface,
            self._scan, self.observation,
        )  # fmt: skip

    def close(self) -> None:
        """Let go of threads."""
        self.batch.close()


def _observed(toes: int, scanned: int) -> list[Observed]:
    """By a robot with so many toes that looks at so many places, see ``JansenWalkerEnv``."""
    any_number, unit, positive_number = (-np.inf, np.inf), (-1.0, 1.0), (0.0, np.inf)
    return [
        Observed("cos_crank_angle", "1", *unit),
        Observed("sin_crank_angle", "1", *unit),
        Observed("crank_speed", "rad/s", *any_number),
        Observed("sin_pitch", "1", *unit),
        Observed("cos_pitch", "1", *unit),
        Observed("pitch_rate", "rad/s", *any_number),
        Observed("crank_axis_x_velocity", "m/s", *any_number),
        Observed("crank_axis_y_velocity", "m/s", *any_number),
        Observed("crank_axis_height", "m", *any_number),
        Observed("speed_command", "m/s", -FASTEST_COMMAND, FASTEST_COMMAND),
        *(Observed(f"toe_load_{toe}", "1", *positive_number) for toe in range(toes)),
        Observed("last_action", "1", *unit),
        Observed("lag", "m", -task.FURTHEST_TARGET, task.FURTHEST_TARGET),
        Observed("mean_speed", "m/s", *any_number),
        Observed("mean_slip", "m/s", *positive_number),
        Observed("mean_power", "W", *positive_number),
        Observed("rms_torque", "N m", *positive_number),
        *(Observed(f"height_scan_{place}", "m", *any_number) for place in range(scanned)),
    ]
