"""Simulation of n robots with terrain, episode parameters, delays, pushes, and sensor noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jansen_env import checks
from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.pads import pad_layout
from jansen_env.engine import episode, readings, walk_reward
from jansen_env.engine.episode import Episodes, Observing
from jansen_env.engine.integrator import DIVERGED
from jansen_env.plants import parameters
from jansen_env.plants.base import (
    LARGEST,
    static_deflection,
)
from jansen_env.plants.batched_plant import BatchedPlant
from jansen_env.plants.parameters import (
    CHANGES,
    LONGEST_DELAY,
    PARAMETERS,
    SETTABLE,
    Randomization,
    Uniform,
    check,
)
from jansen_env.plants.plant import make_batch, plant_time_step
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.plants.shape_planes import check_scan
from jansen_env.robot import Robot
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.terrain import Ground
from jansen_env.uniform import draw_seed, uniform
from jansen_env.world.episode_lengths import EpisodeLengths
from jansen_env.world.episode_parameters import EpisodeParameters, Plan, Progress
from jansen_env.world.observations import Observed, sensor_errors, world_observations
from jansen_env.world.onboard import ONBOARD, onboard_columns, toe_paths
from jansen_env.world.push import NO_PUSHES, Pushes, check_schedule
from jansen_env.world.saved_states import APPLIED, VERSION, SavedRecords
from jansen_env.world.settings import (
    Check,
    Values,
    WorldSettings,
    control_period,
    load_compliance,
    load_motor,
    load_payload,
    load_robot,
    option,
)
from jansen_env.world.state_checks import Restored

Numbers = dict[str, float]
Draw = Callable[[int, np.random.Generator, Values], Numbers]
"""Function that samples a task's values for one episode of a robot, such as the commanded speed.

Its arguments are the index of the robot, the random number generator, and the reset options.
"""

MOST_DELAYED = 10_000  # longest delay in control steps, which is the number of torques to keep
START_ANGLE = math.pi  # crank reference at time 0 with a fixed chassis, in rad, as in the paper
LOST = math.pi  # deviation from the reference, in rad, that ends an episode with a fixed chassis
FROM_RESETS = ("delay", "terrain_level")  # changes that take effect at the next reset
PARTS = ("payload", "motor", "pad_compliance")  # parts of a robot that changes can replace
KEPT = ("friction", "restitution", *CHANGES)


class Start(NamedTuple):
    """Initial conditions of an episode that has not begun yet.

    Attributes:
        angle: Crank angle, in rad.
        speed: Crank speed, in rad/s.
        plan: Parameters, terrain and robot of the episode.
        seed: Seed of everything that is sampled during the episode.
        pushes: Scheduled pushes: start in s, and impulse in x and y in N s, shape (k, 3).
        random_pushes: Whether random pushes act in addition.
        numbers: Values that the task sampled for the episode.
    """

    angle: float
    speed: float
    plan: Plan
    seed: int
    pushes: Array
    random_pushes: bool
    numbers: Numbers


class World:
    """Simulation of n robots together with everything that acts on them.

    A world combines the simulation backend with the terrain, the parameters of each episode, the
    actuation delay, pushes, and sensor noise. Commands, rewards, and termination are not part of
    it; they belong to the task (:class:`jansen_env.tasks.task.Task`).

    The world exposes the state of the robots as arrays with one entry per robot, shape (n,), or one
    entry per robot and toe, shape (n, toes). Treat these arrays as read-only.

    Args:
        settings: Checked arguments of the environment.
        threads: Number of CPU cores to use. If None, it is chosen from the batch size.
        task: Data type of the task's part of a robot's record. None for no such part.
        omitted: Fields of the task's part that saved states do not contain.

    Attributes:
        OPTIONS: Names of the options that :meth:`reset` accepts.
        SETTABLE: Names of the values that :meth:`change` accepts.
        records: Records of the robots, see :mod:`jansen_env.engine.records`.
        plant: Simulation backend that moves the robots.
        pushes: Scheduled and random pushes.
        saved: Saver and loader of the records.
        reward_settings: Weights and limits of the walker's reward, a record of
            :data:`jansen_env.engine.walk_reward.SETTINGS`, shape (1,). Other tasks do not use it.
        episodes: Parameters and terrain of each robot's current episode.
        lengths: Link lengths of each robot's current episode.
        information: Records of the values that become entries of ``info``, shape (n,); see
            :class:`jansen_env.tasks.information.InfoBuilder`.
        energies: Records of the values that become ``info["energy"]``, shape (n,).
        arrays: Further entries of ``info`` by name, each with shape (n,) or (n, ...).
        groups: Further records by name, each with shape (n,), that become dictionaries in ``info``.
        observations: Descriptions of all values that the world can put into an observation.
        x_position: Horizontal position of the crank axis, in m, shape (n,).
        pitch: Pitch of the chassis, in rad, shape (n,).
        pitch_rate: Rate of change of ``pitch``, in rad/s, shape (n,).
        crank_angle: Crank angle relative to the chassis, in rad, positive counter-clockwise, not
            wrapped to one turn, shape (n,).
        crank_speed: Rate of change of ``crank_angle``, in rad/s, shape (n,).
        x_velocity: Horizontal velocity of the crank axis, averaged over the last control step, in
            m/s, shape (n,).
        crank_torque: Motor torque, averaged over the last control step, in N m, shape (n,).
        motor_work: Work of the motor in the last control step, in J, shape (n,).
        action: Action of the last control step after clipping and rate limiting, shape (n,).
        weight: Weight of robot and payload, in N, shape (n,).
        direction: Direction in which the crank turns to walk towards +x, 1 or -1, shape (n,).
        full_torque: Signed torque that action 1 commands, in N m, shape (n,).
        slip: Distance that each toe slid under load in the last control step, in m, shape
            (n, toes).
        toe_load: Normal force on each toe divided by the weight, shape (n, toes).
        control_dt: Duration of a control step, for which an action is held, in s.
        elapsed: Number of control steps since the last reset, shape (n,).
        seeds: Seeds of everything that is sampled during the episodes, shape (n,).
        delay_range: Lowest and highest delay of future episodes, in s, shape (n, 2).
        truncated: Whether the simulation of each robot has diverged, shape (n,).

    Raises:
        ValueError: If an argument is out of range.
        LinkageError: If a robot cannot turn its crank through a full revolution.
    """

    def __init__(
        self,
        settings: WorldSettings,
        threads: int | None = None,
        task: np.dtype[np.void] | None = None,
        omitted: Collection[str] = (),
    ) -> None:
        self.fixed_chassis = settings.fixed_chassis
        n = settings.count
        self.num_envs = n
        robots = settings.make_robots()
        for robot in robots:
            static_deflection(robot, GRAVITY)  # raises an error if its feet are too soft
        terrains, generators = settings.make_terrains()
        time_step = plant_time_step(settings.plant, settings.time_step, settings.joint_play)
        self.control_dt, self.time_step = control_period(settings.control_dt, time_step)
        self.steps = round(self.control_dt / self.time_step)
        self.reset_noise_scale = np.array(settings.reset_noise_scale)
        self.delay_range = np.array(settings.delay)
        pads = len(pad_layout(robots[0]).joint)
        delayed = self._longest_queue(settings.randomize)
        self.records = RobotRecords(n, len(robots[0].toes), pads, delayed, 0, task)
        self.saved = SavedRecords(self.records, omitted)
        self._every = np.arange(n)
        self.plant = self._make_plant(settings, robots, terrains, threads)
        self.track_joint_forces = settings.track_joint_forces
        self._joint_loads = np.zeros(2)
        self.scan = settings.height_scan
        self._noise = settings.noise
        if len(self.scan) > 0:
            check_scan(self.plant.terrains)
        self._readings = self.observations = world_observations(self.plant.toes, len(self.scan))
        self.is_onboard = settings.observe == "onboard"
        if self.is_onboard:
            scanned = self._readings[len(self._readings) - len(self.scan) :]
            self.observations = [*ONBOARD, *scanned]
        if self.fixed_chassis:
            self.observations = self.observations[:3]  # only the crank is observed
            self.OPTIONS: tuple[str, ...] = ("crank_angle", "crank_speed", "delay", "lengths")
            self.SETTABLE: tuple[str, ...] = ("delay",)
        else:
            self.OPTIONS = ("crank_angle", "pushes", "robot", "lengths", *PARAMETERS)
            self.SETTABLE = (*SETTABLE, "motor", "pad_compliance")
        self._paths = np.zeros((0, 0, 0, 0), np.float32)
        self._note_paths(self._every)
        self.pushes = Pushes(self.records, settings.push, self.time_step, self.steps)
        self.reward_settings = np.zeros(1, walk_reward.SETTINGS)
        self.truncated = np.zeros(n, bool)
        self._any_truncated = False
        self._actions = np.zeros((n, 1))
        has = {"noise_level": self._noise is not None, "push_strength": settings.push is not None}
        self.episodes = EpisodeParameters(self.plant, settings, generators, has)
        self.lengths = EpisodeLengths(
            robots, settings.randomize, settings.observe_lengths, standing=not self.fixed_chassis
        )
        self._bind_kernels()
        self._share_arrays()

    def _make_plant(
        self,
        settings: WorldSettings,
        robots: Sequence[Robot],
        terrains: Sequence[Ground],
        threads: int | None,
    ) -> BatchedPlant:
        """Return the simulation backend.

        Args:
            settings: Checked arguments of the environment.
            robots: The robots.
            terrains: Terrain of each robot.
            threads: Number of CPU cores to use. If None, it is chosen from the batch size.

        Raises:
            ValueError: If joint forces are to be tracked, but the backend does not compute them.
        """
        plant = make_batch(
            settings.plant,
            robots,
            terrains,
            self.time_step,
            threads,
            self.fixed_chassis,
            settings.links_collide,
            settings.joint_play,
            settings.backlash,
            self.records,
        )
        plant.set_control(
            self.steps,
            self.control_dt,
            math.inf if settings.torque_rate is None else settings.torque_rate,
            is_walk=self.records.task.dtype == walk_reward.ROW,
            noisy=settings.noise is not None,
            onboard=settings.observe == "onboard",
        )
        if settings.track_joint_forces and not plant.knows_joint_forces:
            other = "links_collide=True" if settings.links_collide else "plant='rigid_body'"
            raise ValueError(f"track_joint_forces must be False with {other}, got True")
        plant.tracing = settings.track_joint_forces and not self.fixed_chassis
        return plant

    def _bind_kernels(self) -> None:
        """Create kernels with argument buffers that belong to this world."""
        self._begin_episode = episode.begin_episode.bound()
        self._observe = episode.observe.bound()

    def _longest_queue(self, randomize: Sequence[Values]) -> int:
        """Return the number of torques that must be kept for the longest delay of any episode.

        Args:
            randomize: Randomised parameters of each robot.

        Raises:
            ValueError: If the delay is too long for this control period.
        """
        drawn = [ranges["delay"] for ranges in randomize if "delay" in ranges]
        most = [d.high if isinstance(d, Uniform) else LONGEST_DELAY for d in drawn]
        longest = max([float(self.delay_range.max()), *most])
        if longest > MOST_DELAYED * self.control_dt:
            allowed = f"at most {MOST_DELAYED} times control_dt, {self.control_dt}"
            raise ValueError(f"delay must be {allowed}, got {longest} s")
        return math.ceil(longest / self.control_dt) + 2

    def _note_paths(self, which: Ints) -> None:
        """Store the paths of the toes, from which onboard sensors estimate the velocity.

        Args:
            which: Indices of the robots, shape (k,).
        """
        if not self.is_onboard:
            return
        paths = np.array([toe_paths(self.robots[i]) for i in which.tolist()], np.float32, order="C")
        if len(self._paths) == 0:
            self._paths = paths
        else:
            self._paths[which] = paths

    def _share_arrays(self) -> None:
        """Make the attributes, the information and the kernels' arguments views of the records."""
        records = self.records
        robots: Rows = records.robots
        states = records.states
        info = robots["info"]
        energy = robots["energy"]
        self.x_position = states[:, 0]
        self.pitch = states[:, 2]
        self.crank_angle = states[:, 3]
        self.pitch_rate = states[:, 6]
        self.crank_speed = states[:, 7]
        self.x_velocity = info["x_velocity"]
        self.crank_torque = info["crank_torque"]
        self.motor_work = energy["motor_work"]
        self.action = robots["action"]
        self.weight = robots["weight"]
        self.direction = robots["direction"]
        self.full_torque = robots["full_torque"]
        self.elapsed = robots["elapsed"]
        self.seeds = robots["seed"]
        self.slip = records.slip
        self.toe_load = records.loads
        self.information = info
        self.energies = energy
        if self.fixed_chassis:
            self.information = self.information[[*readings.FIXED_CHASSIS_INFORMATION]]
            self.energies = self.energies[[*readings.FIXED_CHASSIS_ENERGIES]]
        self.groups: dict[str, Rows] = {}
        self.arrays: dict[str, NDArray[np.generic]] = {}
        if self.episodes.varies:
            self.groups["parameters"] = records.parameters
        if self.lengths.values is not None:
            self.groups["lengths"] = self.lengths.values
        if not self.fixed_chassis:
            self.arrays = {"slip": records.slip, "contact_force": records.contact_force}
        if self._noise is not None and hasattr(self, "_observing"):
            self.arrays["true_observation"] = self._observing.truth
        if self.track_joint_forces:
            names = ("joint_force_max", "joint_impulse_max")[: 1 if self.fixed_chassis else 2]
            self.arrays |= {k: self._joint_loads[i : i + 1] for i, k in enumerate(names)}
        is_walk = records.task.dtype == walk_reward.ROW
        walks = records.task if is_walk else np.zeros(0, walk_reward.ROW)
        self._kernel_episodes = Episodes(
            walks,
            records.loads,
            records.torques,
            records.schedule,
            self.pushes.settings,
            self.reward_settings,
        )

    def connect(
        self,
        observed: Sequence[Observed],
        observation: NDArray[np.float32],
        task_names: Sequence[str],
    ) -> None:
        """Store the array into which the world writes the observations.

        Args:
            observed: Description of each column of the array.
            observation: Array of the observations, shape (n, d).
            task_names: Names of the columns that the compiled task fills, in its order.
        """
        columns = {entry.name: place for place, entry in enumerate(observed)}

        def places(names: Iterable[str]) -> Ints:
            return np.array([columns.get(name, -1) for name in names], np.int64)

        self.lengths.connect(columns, observation)
        self._observing = Observing(
            observation,
            self.scan,
            places(entry.name for entry in self._readings),
            places(task_names),
            onboard_columns(columns),
            self._paths,
            *sensor_errors(self._noise, observed, self.num_envs),
        )
        self._share_arrays()

    @property
    def robots(self) -> list[Robot]:
        """Robots of the current episodes, without the parameters of these episodes."""
        return self.plant.robots

    @property
    def torque(self) -> Array:
        """Commanded torque at the end of the last step, after the delay, in N m, shape (n,)."""
        return self.records.torques[self._every, self.records.robots["delay"][:, 0]]

    # Values of the last step. They are exact, even if the sensors are noisy.

    @property
    def motor_power(self) -> Array:
        """Mean power of the motor over the last step, in W, shape (n,)."""
        return self.motor_work / self.control_dt

    @property
    def non_toe_contact(self) -> Bools:
        """Whether a joint other than a toe pressed on the ground in the last step, shape (n,)."""
        return self.records.accumulators["non_toe_impulse"] > 0.0

    def joint_forces(self) -> JointForces:
        """Return the present joint forces of the first robot.

        Raises:
            ValueError: If the simulation backend does not compute joint forces.
        """
        return self.plant.joint_forces(float(self.torque[0]), self.pushes.next_impulse())

    # Episodes.

    def reset(
        self,
        which: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[Values],
        draw: Draw,
        progress: Progress,
    ) -> list[Numbers]:
        """Place some of the robots for their next episodes.

        The task puts the returned values into its records, and then calls :meth:`begin_episodes`.
        After an error, the generators have advanced; nothing else has changed.

        Args:
            which: Indices of the robots, shape (k,).
            generators: Random number generator of each of these robots.
            options: Reset options of each of these robots; see :attr:`OPTIONS`.
            draw: Function that samples the task's values for one robot.
            progress: Function that returns how far a robot got in its last episode, in m, and its
                mean commanded speed, in m/s. The curriculum uses both.

        Returns:
            The values that ``draw`` returned, one dictionary per robot.

        Raises:
            ValueError: If an option is out of range.
            FloatingPointError: If a robot of the rigid-body backend diverges at its initial
                position.
        """
        robots = zip(which.tolist(), generators, options, strict=True)
        starts = [self._plan_start(*robot, draw, progress) for robot in robots]
        plant = self.plant
        angles = [start.angle for start in starts]
        speeds = [start.speed for start in starts]
        plans = [start.plan for start in starts]
        self._begin(which, plans, lambda: plant.place(which, angles, speeds))
        if self.episodes.curriculum is not None:
            self.episodes.level[which] = self.records.parameters["terrain_level"][which]
        for i, start in zip(which.tolist(), starts, strict=True):
            self._set_pushes(i, start.pushes, start.random_pushes)
            self.seeds[i] = start.seed
        self.truncated[which] = False
        return [start.numbers for start in starts]

    def begin_episodes(self, which: Ints) -> None:
        """Begin the episodes of robots that have been placed.

        Args:
            which: Indices of the robots, shape (k,).
        """
        records = self.records
        plant = self.plant
        self._joint_loads[:] = 0.0
        if plant.joints_open:
            records.robots["info"]["joint_gap"][which] = plant.joint_gap[which]
        self._begin_episode(
            which, plant.engine_settings, plant.machines, records.motions, self._kernel_episodes
        )

    def observe(self, which: Ints | None, moved: bool) -> None:
        """Fill the observations and the information of some robots.

        Args:
            which: Indices of the robots, shape (k,). None for all robots.
            moved: Whether these robots have just taken a control step. If False, they are observed
                in their present state, for example after a reset.
        """
        plant = self.plant
        which = self._every if which is None else which
        plant.look_down(which, self.scan)
        self._observe(
            which,
            moved,
            plant.engine_settings,
            plant.surface,
            self.records.motions,
            self._kernel_episodes,
            self._observing,
        )

    def _set_pushes(self, i: int, pushes: Array, random: bool) -> None:
        """Set the pushes of a robot's episode.

        Args:
            i: Index of the robot.
            pushes: Scheduled pushes: start in s, and impulse in x and y in N s, shape (k, 3).
            random: Whether random pushes act in addition.
        """
        if self.records.make_room(len(pushes)):
            self.plant.reconnect()
            self._share_arrays()
        self.pushes.schedule(i, pushes, random)

    def _plan_start(
        self, i: int, rng: np.random.Generator, options: Values, draw: Draw, progress: Progress
    ) -> Start:
        """Sample the initial conditions of a robot's next episode.

        Only the state of the generator changes. The arguments are those of :meth:`reset`, for a
        single robot. ``docs/life_of_a_step.md`` documents the order of the samples, and
        ``test_the_order_of_draws_is_the_documented_one`` checks it.
        """
        # All values are sampled even if an option replaces some of them, so that an option does not
        # change the other values.
        noise = float(self.reset_noise_scale[i])
        if self.fixed_chassis:
            numbers = draw(i, rng, options)
            angle = START_ANGLE + noise * uniform(rng, -1.0, 1.0)
        else:
            angle = uniform(rng, 0.0, 2.0 * math.pi)
            numbers = draw(i, rng, options)
        speed = noise * uniform(rng, -1.0, 1.0)
        low, high = self.delay_range[i].tolist()
        delay = uniform(rng, low, high) if high > low else low
        robot = None
        pushes = NO_PUSHES
        random = True
        if options:
            limits = (
                (START_ANGLE - LOST, START_ANGLE + LOST)
                if self.fixed_chassis
                else (-LARGEST, LARGEST)
            )
            delay = option(options, "delay", delay, 0.0, self.longest_delay)
            angle = option(options, "crank_angle", angle, *limits)
            speed = option(options, "crank_speed", speed, -DIVERGED, DIVERGED)
        seed = None  # a robot with a fixed chassis needs no seed unless its lengths are sampled
        if not self.fixed_chassis or self.lengths.factors[i]:
            seed = draw_seed(rng)
        if "robot" in options:
            robot = load_robot("options['robot']", options["robot"])
            self.plant.check_robot(robot)  # with its nominal lengths, which later episodes may use
        build = self.lengths.plan(i, options.get("lengths", {}), seed, robot)
        plan = self.episodes.plan(i, rng, options, delay, progress, build)
        if options.get("pushes") is not None:
            pushes = check_schedule("options['pushes']", options["pushes"])
            random = False
        return Start(angle, speed, plan, seed or 0, pushes, random, numbers)

    def _begin(self, which: Ints, plans: Sequence[Plan], place: Callable[[], None]) -> None:
        """Apply planned episodes and place the robots. After an error, nothing has changed.

        Args:
            which: Indices of the robots, shape (k,).
            plans: Plan of each of these robots.
            place: Function that places the robots.

        Raises:
            ValueError: If the simulation backend rejects a plan, or the user randomises a parameter
                that has no effect on a new robot.
            FloatingPointError: If the simulation diverges at the initial position of a robot.
        """
        builds = {i: p.build for i, p in zip(which.tolist(), plans, strict=True) if p.build}
        others: dict[int, Robot] = {}
        draws: dict[int, Randomization] = {}
        for i, build in builds.items():
            draws[i] = self.episodes.draws(i, build.robot)
            if build.robot != self.robots[i]:
                others[i] = build.robot
        undo = self.plant.keep(which)
        try:
            if others:
                self.plant.set_robots(np.array([*others]), [*others.values()])
            self.episodes.apply(which, plans)
            place()
        except Exception:
            undo()
            raise
        if builds:
            self.lengths.begin(builds)
            self.episodes.begin(draws)
        if others:
            self._note_paths(np.array([*others], np.int64))

    @property
    def longest_delay(self) -> float:
        """Longest delay for which the records have room, in s."""
        return (self.records.torques.shape[1] - 2) * self.control_dt

    def delay(self, i: int) -> float:
        """Return the time by which a robot's torques are delayed in this episode, in s."""
        whole, rest = self.records.robots["delay"][i].tolist()
        return float(whole * self.control_dt + rest * self.time_step)

    # Steps.

    def step(
        self, actions: Array, which: Ints | None, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Apply an action to each active robot and simulate ``control_dt`` seconds.

        Args:
            actions: Crank torques as fractions of the torque limit, shape (n, 1). The actions of
                active robots must be finite; values beyond [-1, 1] are clipped. The actions of
                other robots are ignored.
            which: Indices of the active robots, shape (k,). None for all robots.
            meanwhile: Function that is called while the robots move. It may :meth:`reset` robots
                that are not active.
        """
        plant = self.plant
        which = self._every if which is None else which
        self._actions[:] = actions
        plant.control_step(which, self._actions, self._kernel_episodes, self._observing, meanwhile)
        if plant.joints_open:
            self.records.robots["info"]["joint_gap"] = plant.joint_gap
        if plant.any_diverged or self._any_truncated:
            self._truncate(which)
        if self.track_joint_forces and len(which) > 0:  # this option allows only one robot
            self._joint_loads[:] = self._find_joint_loads()

    def _truncate(self, which: Ints) -> None:
        """End the episodes of robots whose simulation has just diverged.

        Args:
            which: Indices of the robots that have just moved, shape (k,).
        """
        self.truncated[:] = False
        self.truncated[which] = self.plant.diverged[which]
        diverged = self.truncated
        self._any_truncated = bool(diverged.any())
        if self._any_truncated:
            gym.logger.warn(
                f"the episodes of robots {np.flatnonzero(diverged).tolist()} end: their simulation "
                f"diverged under torques of {self.torque[diverged].tolist()} N m; "
                "try a smaller time_step"
            )

    def _find_joint_loads(self) -> tuple[float, float]:
        """Return the largest force on a joint, in N, and the largest impulse, in N s."""
        if self.fixed_chassis:
            return self.plant.joint_forces(float(self.torque[0])).largest()[0], 0.0
        if self.plant.any_diverged:
            return 0.0, 0.0
        return self.plant.peak_loads()

    # Single robots.

    def push(self, i: int, impulse: object) -> None:
        """Push the chassis of a robot from now on, in addition to all other pushes.

        The push lasts for ``push.duration``, or for 0.1 s if the environment has no ``push``.

        Args:
            i: Index of the robot.
            impulse: Impulse in x and y, in N s.

        Raises:
            ValueError: If ``impulse`` is not two finite numbers, there are too many pushes at once,
                or the chassis of the robot is fixed.
        """
        if self.fixed_chassis:
            raise ValueError("a robot whose chassis is fixed cannot be pushed")
        now = float(self.elapsed[i]) * self.control_dt
        pushes = self.pushes.with_push(i, now, impulse)
        self._set_pushes(i, pushes, self.pushes.has_random(i))

    def checked(self, i: int, changes: Values) -> Values:
        """Check new values of a robot for :meth:`change`.

        Args:
            i: Index of the robot.
            changes: New values, by name; see :attr:`SETTABLE`.

        Returns:
            The checked values, by name.

        Raises:
            ValueError: If a value is out of range.
        """
        named: dict[str, Check] = {
            "payload": load_payload,
            "motor": load_motor,
            "pad_compliance": load_compliance,
            "delay": partial(checks.number_range, least=0.0, most=self.longest_delay),
        }
        checked = {k: named.get(k, partial(check, k))(k, value) for k, value in changes.items()}
        for name in FROM_RESETS:
            if name in checked:
                self.episodes.check_not_drawn(i, name, checked[name])
        without_argument = [name for name in checked if name in (*CHANGES, "terrain_level")]
        self.episodes.check_names(i, without_argument, "changes")
        if {*checked} - {*FROM_RESETS}:
            pads = checked.get("pad_compliance", self.robots[i].pad_compliance)
            self.episodes.check_change(i, pads, _parameters_of(checked))
        return checked

    def change(self, i: int, checked: Values) -> None:
        """Apply new values to a robot and its terrain.

        Args:
            i: Index of the robot.
            checked: Values that :meth:`checked` returned.
        """
        plant = self.plant
        if {*checked} - {*FROM_RESETS}:
            state = plant.states[i].copy()
            in_contact = plant.in_contact
            deflection = None if "pad_compliance" in checked else plant.deflection[i].copy()
            parts = {name: checked[name] for name in PARTS if name in checked}
            numbers = _parameters_of(checked)
            plan = self.episodes.changed(i, numbers, self.lengths.equipped(i, parts))
            self._begin(
                np.array([i]), [plan], lambda: plant.set_mechanical_state(i, state, deflection)
            )
            plant.in_contact = in_contact
            self.episodes.set_nominal(i, numbers)
        self.episodes.replace_draws(i, {*checked} & {*FROM_RESETS})
        if "delay" in checked:
            self.delay_range[i] = checked["delay"]
        if "terrain_level" in checked:
            self.episodes.level[i] = self.episodes.levels[i] = checked["terrain_level"]

    def terrain(self, i: int) -> Ground:
        """Return the terrain of a robot, with the friction and restitution of this episode."""
        friction, bounce = self.records.parameters[["friction", "restitution"]][i].tolist()
        return replace(self.plant.terrains[i], friction=friction, restitution=bounce)

    def parameters(self, i: int) -> Numbers:
        """Return the parameters of a robot's current episode, by name."""
        return dict(zip(PARAMETERS, self.records.parameters[i].item(), strict=True))

    def get_attr(self, name: str) -> list[object] | None:
        """Return an attribute of each robot.

        Args:
            name: ``robot``, ``state`` (the mechanical state), ``delay`` (in s, of this episode),
                ``terrain``,
                ``terrain_level``, ``payload``, ``motor``, ``torque_limit``, ``pad_compliance``,
                ``weight``, ``reset_noise_scale``, or a name in :data:`KEPT`.

        Returns:
            The values, one per robot, or None if ``name`` is a different name.
        """
        numbers = self.records.parameters
        if name in PARTS:
            return [getattr(robot, name) for robot in self.robots]
        if name in KEPT:
            return numbers[name].tolist()
        values: dict[str, Iterable[object]] = {
            "robot": self.robots,
            "state": self.plant.states.copy(),
            "delay": map(self.delay, range(self.num_envs)),
            "terrain": map(self.terrain, range(self.num_envs)),
            "terrain_level": map(int, numbers["terrain_level"]),
            "torque_limit": (robot.motor.torque_limit for robot in self.robots),
            "weight": self.weight.tolist(),
            "reset_noise_scale": self.reset_noise_scale.tolist(),
        }
        return list(values[name]) if name in values else None

    def get_state(self, i: int) -> Values:
        """Return the state of a robot, from which :meth:`restore` continues its episode.

        The state contains neither the arguments of the environment nor the robot's random
        generator.

        Args:
            i: Index of the robot.

        Returns:
            The saved state. The following list contains its entries.

            - ``version``: Version of the format.
            - ``record``: Copy of the robot's record, see :mod:`jansen_env.world.saved_states`.
            - ``in_contact``: Whether each pad was on the ground, or None if that is not known. It
              is used only to detect touchdowns.
            - ``level``: Level of the robot in the curriculum.
            - ``terrain``: Points, friction and restitution of a generated terrain.
            - ``robot``: The robot, if it is not the robot of the environment's arguments.
            - ``lengths``: Link lengths of this episode, by name, that differ from the robot's.
        """
        changed = self.lengths.changed[i]
        in_contact = self.plant.in_contact
        state: Values = {
            "version": VERSION,
            "record": self.saved.read(i),
            "in_contact": None if i > 0 or in_contact is None else in_contact.copy(),
            **self.episodes.state(i),
        }
        if self.lengths.nominal[i] != self.lengths.constructed[i]:
            state["robot"] = robot_to_json(self.lengths.nominal[i])
        if changed:
            state["lengths"] = dict(changed)
        return state

    def restore(self, i: int, state: Restored) -> None:
        """Restore a robot to a saved state.

        Args:
            i: Index of the robot.
            state: State that :func:`jansen_env.world.state_checks.check_saved_state` returned.
        """
        plant = self.plant
        record = state.record
        which = np.array([i])
        deflection = record.get("statistics", {}).get("deflection")
        self._begin(
            which, [state.plan], lambda: plant.set_mechanical_state(i, record["state"], deflection)
        )
        self.episodes.level[i] = state.level
        if i == 0:
            plant.in_contact = state.in_contact
        self.saved.clear(i, APPLIED)
        self.begin_episodes(which)
        self.saved.write(i, record, APPLIED)
        self.truncated[i] = False
        plant.any_diverged = bool(plant.diverged.any())
        self._set_pushes(i, record.get("schedule", NO_PUSHES), self.pushes.has_random(i))

    def __getstate__(self) -> Values:
        views = "_begin_episode", "_observe", "_kernel_episodes"
        return {name: value for name, value in self.__dict__.items() if name not in views}

    def __setstate__(self, state: Values) -> None:
        self.__dict__.update(state)
        self._bind_kernels()
        self._share_arrays()

    def close(self) -> None:
        """Release the threads of the simulation backend."""
        self.plant.close()


def _parameters_of(changes: Values) -> Numbers:
    """Return the parameters that checked changes set immediately, not only at the next reset."""
    numbers = {name: changes[name] for name in PARAMETERS if name in {*changes} - {*FROM_RESETS}}
    if "payload" in numbers:
        parameters.set_payload(numbers, numbers["payload"])
    return numbers
