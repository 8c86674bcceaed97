"""n robots in their surroundings: plant, terrain, parameters, delay, pushes, sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env import checks, parameters
from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.engine import readings
from jansen_env.engine.integrator import DIVERGED
from jansen_env.gravity import GRAVITY
from jansen_env.parameters import CHANGES, LONGEST_DELAY, PARAMETERS, SETTABLE, Uniform, check
from jansen_env.plants.base import (
    LARGEST,
    check_deflection,
    check_held,
    check_in_contact,
    check_state,
    static_deflection,
)
from jansen_env.plants.plant import BatchedPlant, make_batch, plant_time_step
from jansen_env.rendering import AIR, GRIP, SLIP, Frame
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.robot_file import robot_from_json, robot_to_json
from jansen_env.terrain import Terrain
from jansen_env.uniform import uniform
from jansen_env.world.episode_lengths import Build, EpisodeLengths
from jansen_env.world.episode_parameters import EpisodeParameters, Plan, Progress
from jansen_env.world.observations import NoisySensors, Observed, world_observations
from jansen_env.world.onboard import KEPT as KEPT_ONBOARD
from jansen_env.world.onboard import ONBOARD, OnboardSensors, toe_paths
from jansen_env.world.push import Pushes, check_schedule
from jansen_env.world.settings import (
    Arguments,
    Check,
    Values,
    WorldSettings,
    control_period,
    flag,
    load_compliance,
    load_motor,
    load_payload,
    load_robot,
    option,
)

Numbers = dict[str, float]
Draw = Callable[[int, np.random.Generator, Values], Numbers]
"""Draws a task's numbers of a robot's episode, with the options of its reset."""

MOST_DELAYED = 10_000  # control periods in a delay: torques that are kept
LARGEST_COUNT = 2**63 - 1  # of an episode; and the largest seed
SLIPPING = 0.01  # m/s of mean slip speed from which a toe is drawn as slipping
TOUCHING = 1e-6  # of the robot's weight: the normal force from which a toe is on the ground
START_ANGLE = math.pi  # rad, of a held crank's reference at time 0, as in the paper
LOST = math.pi  # rad, from the reference: where an episode of a held robot ends
NO_PUSHES = np.zeros((0, 3))
FROM_RESETS = ("delay", "terrain_level")  # changes that apply from the next reset on
PARTS = ("payload", "motor", "pad_compliance")  # of a robot, which changes replace
KEPT = ("friction", "restitution", *CHANGES)


class Start(NamedTuple):
    """An episode to come."""

    angle: float  # rad, of the crank
    speed: float  # rad/s
    plan: Plan
    seed: int  # of what it draws later
    pushes: Array  # (k, 3) its own
    random_pushes: bool
    numbers: Numbers  # of the task


class World:
    """n robots in their surroundings; it knows no commands, rewards or ends of episodes.

    It answers named questions on all robots, by arrays (n,) and (n, toes) to be read.

    Args:
        settings: arguments. threads: cores to use; None: chosen by batch size.

    Attributes:
        OPTIONS: names of reset options. SETTABLE: names that :meth:`change` takes.
        plant: moves the robots.
        episodes: their parameters and terrains. lengths: of their links.
        data: (n,) rows of the engine: last actions, ``info`` and ``energy``.
        information, energies, arrays, groups: information on robots, see
            :class:`jansen_env.tasks.information.InfoBuilder`.
        observations: what it can observe.
        x_position: m, of the crank axis. pitch: rad, of the chassis. pitch_rate: rad/s.
        crank_angle: rad, relative to the chassis, counter-clockwise, not wrapped.
        crank_speed: rad/s, counter-clockwise. weight: N, of robots and payloads.
        x_velocity: m/s, of the crank axis, crank_torque: N m, of the motor, both means over the
            last step. motor_work: J, in the last step. action: of the last step, clipped.
        slip: (n, toes) m, that each toe slid while loaded in the last step. toe_load: (n, toes)
            normal forces / weight.
        control_dt: s for which an action is held. elapsed: (n,) control steps since the reset.
        full_torque: (n,) N m, the torque of action 1, with its sign.
        torque: (n,) N m, that the last step ended with; ``earlier`` (n,) held in its first
            ``switch`` (n,) time steps. asked: (n, steps) N m, torques asked for, latest first.
        delay_range: (n, 2) s, of episodes to come. delay_steps: (n, 2) control and time steps.
        seeds: (n,) seed of draws made during the episode. sensors: None without noise.
        truncated: (n,) whether the simulation diverged.

    Raises:
        ValueError: an argument out of range; LinkageError: the robot cannot turn its crank.
    """

    def __init__(self, settings: WorldSettings, threads: int | None = None) -> None:
        self.held, n = settings.held, settings.count
        self.num_envs = n
        robots = settings.make_robots()
        for robot in robots:
            static_deflection(robot, GRAVITY)  # raises an error if its feet are too soft
        terrains, generators = settings.make_terrains()
        time_step = plant_time_step(settings.plant, settings.time_step)
        self.control_dt, self.time_step = control_period(settings.control_dt, time_step)
        self.steps = round(self.control_dt / self.time_step)
        self.reset_noise_scale = np.array(settings.reset_noise_scale)
        self.delay_range = np.array(settings.delay)
        self._allocate_torques(settings.randomize)
        self.data: Rows = np.zeros(n, readings.ROW)
        self._keep_actions = readings.take_actions.bound()
        self._torques = (
            self.elapsed, self.full_torque, self.data, self.asked, self.delay_steps, self.torque,
            self.earlier, self.switch,
        )  # fmt: skip
        self._every = np.arange(n)
        self.plant: BatchedPlant = make_batch(
            settings.plant, robots, terrains, self.time_step, threads, self.held,
            settings.links_collide,
        )  # fmt: skip
        self.track_joint_forces = settings.track_joint_forces
        if self.track_joint_forces and not self.plant.knows_joint_forces:
            other = "links_collide=True" if settings.links_collide else "plant='rigid_body'"
            raise ValueError(f"track_joint_forces is True, must be False with {other}")
        self.plant.tracing = self.track_joint_forces and not self.held
        self._joint_loads = np.zeros(2)
        self.scan, self._torque_rate = settings.height_scan, settings.torque_rate
        self._readings = self.observations = world_observations(self.plant.toes, len(self.scan))
        self.onboard: OnboardSensors | None = None
        if settings.observe == "onboard":
            self.onboard = OnboardSensors(n, self.plant.toes, self.control_dt)
            scanned = self._readings[len(self._readings) - len(self.scan) :]
            self.observations = [*ONBOARD, *scanned]
        if self.held:
            self.observations = self.observations[:3]  # of the crank
            self.OPTIONS: tuple[str, ...] = ("crank_angle", "crank_speed", "delay", "lengths")
            self.SETTABLE: tuple[str, ...] = ("delay",)
        else:
            self.OPTIONS = ("crank_angle", "pushes", "robot", "lengths", *PARAMETERS)
            self.SETTABLE = (*SETTABLE, "motor", "pad_compliance")
        self.advance_per_turn, self._links_mass = np.zeros(n), np.zeros(n)
        self._note_robots(self._every)
        self.toe_load = np.zeros((n, self.plant.toes))
        self.seeds = np.zeros(n, np.int64)
        self._noise = settings.noise
        self.sensors: NoisySensors | None = None
        self.pushes = Pushes(n, settings.push, self.steps, self.time_step)
        has = {"noise_level": self._noise is not None, "push_strength": settings.push is not None}
        self.episodes = EpisodeParameters(self.plant, settings, generators, has)
        self.lengths = EpisodeLengths(
            robots, settings.randomize, settings.observe_lengths, standing=not self.held
        )
        self._update_scales(self._every)
        self._share_arrays()

    def _allocate_torques(self, randomize: Sequence[Values]) -> None:
        """Make room for the longest delay of any episode; ValueError: too long for this period."""
        n, drawn = self.num_envs, [ranges["delay"] for ranges in randomize if "delay" in ranges]
        most = [d.high if isinstance(d, Uniform) else LONGEST_DELAY for d in drawn]
        longest = max([float(self.delay_range.max()), *most])
        if longest > MOST_DELAYED * self.control_dt:
            allowed = f"at most {MOST_DELAYED} times control_dt, {self.control_dt}"
            raise ValueError(f"delay is {longest} s, must be {allowed}")
        steps = math.ceil(longest / self.control_dt)
        self.asked, self.delay_steps = np.zeros((n, steps + 2)), np.zeros((n, 2), np.int64)
        self.torque, self.earlier, self.switch = np.zeros(n), np.zeros(n), np.zeros(n, np.int64)
        self._actions, self.elapsed = np.zeros((n, 1)), np.zeros(n, np.int64)
        self.full_torque, self._most_change = np.zeros(n), np.full(n, np.inf)
        self.truncated, self._any_truncated = np.zeros(n, bool), False

    def _note_robots(self, which: Ints) -> None:
        """Note numbers of robots that their lengths and masses give."""
        robots = [self.robots[i] for i in which.tolist()]
        self.advance_per_turn[which] = [*map(cache(advance_per_turn), robots)]
        self._links_mass[which] = [robot.links_mass for robot in robots]
        signs = np.copysign(1.0, self.advance_per_turn[which])
        self.data["direction"][which] = 1.0 if self.held else signs
        if self.onboard is not None:
            self.onboard.paths[which] = [*map(cache(toe_paths), robots)]

    def _share_arrays(self) -> None:
        """Let questions and information show the arrays of others."""
        states, info, energy = self.plant.states, self.data["info"], self.data["energy"]
        self.x_position, self.pitch, self.crank_angle = states[:, 0], states[:, 2], states[:, 3]
        self.pitch_rate, self.crank_speed = states[:, 6], states[:, 7]
        self.x_velocity, self.crank_torque = info["x_velocity"], info["crank_torque"]
        self.motor_work, self.action = energy["motor_work"], self.data["action"]
        self.weight, self.slip = self.data["weight"], self.plant.slip
        self.information, self.energies = info, energy
        if self.held:
            self.information = self.information[[*readings.HELD_INFORMATION]]
            self.energies = self.energies[[*readings.HELD_ENERGIES]]
        self.groups: dict[str, Rows] = {}
        self.arrays: dict[str, NDArray[np.generic]] = {}
        if self.episodes.varies:
            self.groups["parameters"] = self.episodes.values
        if self.lengths.values is not None:
            self.groups["lengths"] = self.lengths.values
        if not self.held:
            self.arrays = {"slip": self.plant.slip, "contact_force": self.plant.contact_force}
        if self.sensors is not None:
            self.arrays["true_observation"] = self.sensors.truth
        if self.track_joint_forces:
            names = ("joint_force_max", "joint_impulse_max")[: 1 if self.held else 2]
            self.arrays |= {k: self._joint_loads[i : i + 1] for i, k in enumerate(names)}

    def connect(self, observed: Sequence[Observed], observation: NDArray[np.float32]) -> None:
        """Take the array of observations (n, d) and its columns."""
        columns = {entry.name: place for place, entry in enumerate(observed)}
        self._places = np.array([columns.get(entry.name, -1) for entry in self._readings])
        self._observation = observation
        self.lengths.connect(columns, observation)
        if self.onboard is not None:
            self.onboard.connect(columns, observation)
        if self._noise is not None:
            self.sensors = NoisySensors(self.num_envs, self._noise, observed)
            self._share_arrays()

    @property
    def robots(self) -> list[Robot]:
        """The robots of these episodes, before parameters."""
        return self.plant.robots

    # Named questions. What the engine says of the last step is exact, whatever sensors measure.

    @property
    def motor_power(self) -> Array:
        """(n,) W, the mean over the last step."""
        return self.motor_work / self.control_dt

    @property
    def non_toe_contact(self) -> Bools:
        """(n,) whether a joint other than a toe was pressed on the ground in the last step."""
        return self.plant.rows["accumulators"]["non_toe_impulse"] > 0.0

    def joint_forces(self) -> JointForces:
        """Return a single robot's joint forces now; ValueError: the plant does not know them."""
        pushes = self.pushes.of_step(np.ones(1, bool), self.elapsed, self.seeds)
        push = None if pushes is None else pushes[0, 0]
        return self.plant.joint_forces(float(self.torque[0]), push)

    # Episodes.

    def reset(
        self,
        which: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[Values],
        draw: Draw,
        progress: Progress,
    ) -> list[Numbers]:
        """Start episodes of robots (k,); returns what ``draw`` gave for each.

        Raises:
            ValueError: an option out of range, FloatingPointError: the robot diverges where it is
                placed. Nothing has changed then but the generators.
        """
        robots = zip(which.tolist(), generators, options, strict=True)
        starts = [self._plan_start(*robot, draw, progress) for robot in robots]
        plant, angles = self.plant, [start.angle for start in starts]
        speeds = [start.speed for start in starts]
        plans = [start.plan for start in starts]
        self._begin(which, plans, lambda: plant.place(which, angles, speeds))
        if self.episodes.curriculum is not None:
            self.episodes.level[which] = self.episodes.values["terrain_level"][which]
        self.seeds[which] = [start.seed for start in starts]
        self.toe_load[which] = plant.contact_force[which, :, 1] / self.weight[which, None]
        self._begin_delay(which, self.episodes.values["delay"][which])
        self._clear_episode(which)
        for i, start in zip(which.tolist(), starts, strict=True):
            self.pushes.schedule(i, start.pushes, start.random_pushes)
        self.truncated[which] = False
        return [start.numbers for start in starts]

    def _plan_start(
        self, i: int, rng: np.random.Generator, options: Values, draw: Draw, progress: Progress
    ) -> Start:
        """Draw how a robot's next episode starts; nothing changes yet but the generator's state."""
        # Drawn in any case, so that fixing one leaves the others as they were.
        noise, limits = self.reset_noise_scale[i], (-LARGEST, LARGEST)
        if self.held:
            numbers = draw(i, rng, options)
            angle = START_ANGLE + noise * uniform(rng, -1.0, 1.0)
            limits = START_ANGLE - LOST, START_ANGLE + LOST
        else:
            angle = uniform(rng, 0.0, 2.0 * math.pi)
            numbers = draw(i, rng, options)
        speed = noise * uniform(rng, -1.0, 1.0)
        low, high = self.delay_range[i].tolist()
        delay = uniform(rng, low, high) if high > low else low
        delay = option(options, "delay", delay, 0.0, self._longest_delay)
        angle = option(options, "crank_angle", angle, *limits)
        speed = option(options, "crank_speed", speed, -DIVERGED, DIVERGED)
        seed = None  # a held robot without draws later in its episode needs none
        if not self.held or self.lengths.factors[i]:
            seed = int(rng.integers(2**63))
        robot = load_robot("options['robot']", options["robot"]) if "robot" in options else None
        if robot is not None:
            self.plant.check_robot(robot)  # with its own lengths, for later episodes
        build = self.lengths.plan(i, options.get("lengths", {}), seed, robot)
        plan = self.episodes.plan(i, rng, options, delay, progress, build)
        pushes, random = NO_PUSHES, options.get("pushes") is None
        if not random:
            pushes = check_schedule("options['pushes']", options["pushes"])
        return Start(angle, speed, plan, seed or 0, pushes, random, numbers)

    def _begin(self, which: Ints, plans: Sequence[Plan], place: Callable[[], None]) -> None:
        """Begin planned episodes of robots (k,), which ``place`` puts where they start.

        Raises:
            ValueError, FloatingPointError: the plant refuses that, or a draw would do nothing for
                a robot; nothing has changed then.
        """
        builds = {i: p.build for i, p in zip(which.tolist(), plans, strict=True) if p.build}
        others = {i: b.robot for i, b in builds.items() if b.robot != self.robots[i]}
        draws = {i: self.episodes.draws(i, build.robot) for i, build in builds.items()}
        undo = self.plant.keep(which)
        try:
            if others:
                self.plant.set_robots(np.array([*others]), [*others.values()])
            values = self.episodes.apply(which, plans)
            place()
        except Exception:
            undo()
            raise
        self.lengths.begin(builds)
        self.episodes.begin(which, values, draws)
        if others:
            self._note_robots(np.array([*others], np.int64))
        self._update_scales(which)

    def _update_scales(self, which: Ints) -> None:
        """Update weights, full torques, and strengths of pushes and noise."""
        values = self.episodes.values
        masses = values["mass_scale"][which] * self._links_mass[which] + values["payload"][which]
        self.data["weight"][which] = GRAVITY * masses * values["gravity_scale"][which]
        limits = np.array([self.robots[i].motor.torque_limit for i in which.tolist()])
        if self._torque_rate is not None:
            self._most_change[which] = self._torque_rate * self.control_dt / limits
        limits = self.data["direction"][which] * limits
        self.full_torque[which] = limits * values["motor_strength"][which]
        self.pushes.strength[which] = values["push_strength"][which]
        if self.sensors is not None:
            self.sensors.level[which] = values["noise_level"][which]

    def _clear_episode(self, which: Ints, action: float = 0.0, steps: int = 0) -> None:
        """Clear the data of robots' last episodes."""
        data, info = self.data, self.data["info"]
        for name in ("crank_torque", "links_in_ground", "diverged"):
            info[name][which] = 0
        data["action"][which] = data["action_before"][which] = action
        states = self.plant.states[which]
        data["x_before"][which], info["x_velocity"][which] = states[:, 0], states[:, 4]
        info["joint_gap"][which] = self.plant.joint_gap[which]
        self.elapsed[which] = steps
        self._joint_loads[:] = 0.0
        if self.onboard is not None:
            self.onboard.begin(which, self.plant.states)

    def _begin_delay(self, which: Ints, delays: Array, asked: Array | None = None) -> None:
        """Begin episodes with ``delays`` (k,) s, and earlier torques ``asked`` (k, steps) N m."""
        self.asked[which] = 0.0 if asked is None else asked
        whole, rest = np.divmod(np.rint(delays / self.time_step).astype(np.int64), self.steps)
        self.delay_steps[which] = np.stack([whole, rest], axis=-1)
        self.torque[which] = self.asked[which, whole]

    @property
    def _longest_delay(self) -> float:
        return (self.asked.shape[1] - 2) * self.control_dt

    def delay(self, i: int) -> float:
        """Return the time by which a robot's torques come late in this episode, s."""
        whole, rest = self.delay_steps[i].tolist()
        return float(whole * self.control_dt + rest * self.time_step)

    # Steps.

    def step(
        self,
        actions: ArrayLike,
        active: Bools,
        finish: Callable[[Ints], None],
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Hold actions (n, 1) of the ``active`` robots (n,) for ``control_dt`` seconds.

        ``finish`` is called with robots (k,) that have moved, on the threads that moved them;
        ``meanwhile`` while others move, to :meth:`reset` robots that are not active.

        Raises:
            ValueError: the actions are not one finite number for each active robot.
        """
        plant = self.plant
        pushes = self.pushes.of_step(active, self.elapsed, self.seeds)
        self._check_actions(actions, active)
        moved = active.nonzero()[0]
        self._moved = self._every if len(moved) == self.num_envs else moved
        plant.step(
            self.torque, self.steps, self.earlier, self.switch, self._moved, meanwhile, pushes,
            finish,
        )  # fmt: skip
        if plant.joints_open:
            self.data["info"]["joint_gap"] = plant.joint_gap
        if plant.any_diverged or self._any_truncated:
            self._truncate(plant.diverged & active)
        if self.track_joint_forces and active[0]:  # of the single robot
            self._joint_loads[:] = self._find_joint_loads()

    def _check_actions(self, actions: ArrayLike, active: Bools) -> None:
        count = self.num_envs
        values = checks.numbers_of(actions)
        if values.ndim == 0:
            allowed = f"must be numbers, shape ({count}, 1)"
            raise ValueError(f"actions are {checks.shown(actions)}, {allowed}")
        if values.shape != (count, 1):
            raise ValueError(f"actions have shape {values.shape}, must have ({count}, 1)")
        self._actions[:] = values
        if self._torque_rate is not None:
            last, most = self.data["action"][:, None], self._most_change[:, None]
            change = most * np.clip(np.clip(values, -1.0, 1.0) - last, -1.0, 1.0)
            self._actions[:] = np.where(np.isfinite(values), last + change, values)
        bad = self._keep_actions(self._actions, active, self._torques)
        if bad >= 0:
            raise ValueError(f"actions[{bad}] is {values[bad, 0]}, must be finite")

    def sense(self, which: Ints) -> None:
        """Draw the errors of robots' readings."""
        if self.sensors is not None:
            self.sensors.draw(which, self.elapsed, self.seeds)

    def _truncate(self, diverged: Bools) -> None:
        """End episodes whose simulation has just diverged, if any."""
        self.truncated[:] = self.data["info"]["diverged"] = diverged
        self._any_truncated = bool(diverged.any())
        if self._any_truncated:
            gym.logger.warn(
                f"the episodes of robots {np.flatnonzero(diverged).tolist()} end: their simulation "
                f"diverged under torques of {self.torque[diverged].tolist()} N m; "
                "try a smaller time_step"
            )

    def _find_joint_loads(self) -> tuple[float, float]:
        """Return the largest force on a joint, N, and the largest impulse, N s."""
        if self.held:
            return self.plant.joint_forces(float(self.torque[0])).largest()[0], 0.0
        if self.plant.any_diverged:
            return 0.0, 0.0
        return self.plant.peak_loads()

    def disturb(self, which: Ints | None = None) -> None:
        """Turn observations into what sensors tell, after a step, or of some robots between two."""
        moved, which = which is None, self._moved if which is None else which
        if self.onboard is not None:
            torque = self.data["direction"] * self.crank_torque
            self.onboard.read(which, moved, self.plant.states, self.episodes.values, torque)
        if self.sensors is not None:
            if not moved:
                self.sense(which)
            self.sensors.add(which, self._observation)
        if self.onboard is not None:
            self.onboard.filter(which, moved)

    def kernel_arguments(self) -> tuple[Arguments, Arguments]:
        """Return those of ``finish_step`` and ``describe`` of the engine's ``readings``."""
        plant = self.plant
        described = (
            plant.rows, self.data, self.toe_load, plant.surface, self.scan, self._places,
            self._observation,
        )  # fmt: skip
        step = self.control_dt, plant.states, plant.slip, plant.contact_force, *described
        return step, (plant.states, *described)

    # Single robots.

    def push(self, i: int, impulse: object) -> None:
        """Push a robot's chassis from now on, beside other pushes, for ``push.duration`` or 0.1 s.

        Raises:
            ValueError: an impulse of no two finite numbers, N s, too many pushes at once, or a
                robot that is held.
        """
        if self.held:
            raise ValueError("the robot is held, must be free to be pushed")
        now = float(self.elapsed[i]) * self.control_dt
        push = check_schedule("impulse", [(now, *checks.entries("impulse", impulse, "(Jx, Jy)"))])
        self.pushes.add(i, push[0])

    def checked(self, i: int, changes: Values) -> Values:
        """Return changes for :meth:`change`; ValueError: out of range."""
        named: dict[str, Check] = {
            "payload": load_payload,
            "motor": load_motor,
            "pad_compliance": load_compliance,
            "delay": partial(checks.number_range, least=0.0, most=self._longest_delay),
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
        """Apply changes that :meth:`checked` returned to a robot and its ground."""
        plant = self.plant
        if {*checked} - {*FROM_RESETS}:
            state, in_contact = plant.states[i].copy(), plant.in_contact
            deflection = None if "pad_compliance" in checked else plant.deflection[i].copy()
            parts = {name: checked[name] for name in PARTS if name in checked}
            numbers = _parameters_of(checked)
            plan = self.episodes.changed(i, numbers, self.lengths.equipped(i, parts))
            self._begin(np.array([i]), [plan], lambda: plant.set_state(i, state, deflection))
            plant.in_contact = in_contact
            self.episodes.set_nominal(i, numbers)
        self.episodes.replace_draws(i, {*checked} & {*FROM_RESETS})
        if "delay" in checked:
            self.delay_range[i] = checked["delay"]
        if "terrain_level" in checked:
            self.episodes.level[i] = self.episodes.levels[i] = checked["terrain_level"]

    def terrain(self, i: int) -> Terrain:
        """Return a robot's ground, with friction and restitution of this episode."""
        friction, bounce = self.episodes.values[["friction", "restitution"]][i].tolist()
        return replace(self.plant.terrains[i], friction=friction, restitution=bounce)

    def get_attr(self, name: str) -> list[object] | None:
        """Return an attribute of each robot; None for a name that is none of these.

        Names: ``robot``, ``state``, ``delay`` (s, of this episode), ``terrain``, ``terrain_level``,
        ``payload``, ``motor``, ``torque_limit``, ``pad_compliance``, ``weight``,
        ``reset_noise_scale`` and :data:`KEPT`.
        """
        numbers = self.episodes.values
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
        """Return all that a robot's future depends on but the task and random numbers."""
        changed, in_contact = self.lengths.changed[i], self.plant.in_contact
        state: Values = {
            "plant": self.plant.states[i].copy(),
            "delay": self.delay(i),
            "asked": self.asked[i].copy(),
            "action": float(self.data[i]["action"]),
            "in_contact": None if i > 0 or in_contact is None else in_contact.copy(),
            "deflection": self.plant.deflection[i].copy(),
            "steps": int(self.elapsed[i]),
            "command_seed": int(self.seeds[i]),
            "loads": self.toe_load[i].copy(),
            **self.episodes.state(i),
            "pushes": self.pushes.scheduled(i),
            "random_pushes": bool(self.pushes.random[i]),
        }
        if self.lengths.nominal[i] != self.lengths.constructed[i]:
            state["robot"] = robot_to_json(self.lengths.nominal[i])
        if changed:
            state["lengths"] = dict(changed)
        if self.onboard is not None:
            state["onboard"] = self.onboard.kept[i].copy()
        return state

    def checked_state(self, i: int, state: Values) -> Values:
        """Return a state of :meth:`get_state` for :meth:`restore`; ValueError: out of range."""
        sizes = {"asked": self.asked.shape[1], "loads": self.plant.toes}
        if self.onboard is not None:
            sizes["onboard"] = KEPT_ONBOARD
        checked: Values = {
            name: checks.finite_numbers(f"state[{name!r}]", state[name], size)
            for name, size in sizes.items()
        }
        checked["plant"] = check_state(state["plant"])
        if self.held:
            check_held(checked["plant"])
        pads = self.plant.deflection.shape[1]
        count = partial(checks.whole_number, most=LARGEST_COUNT)
        build = self._checked_build(i, state)
        robot = build.robot if build else self.robots[i]
        plan, checked["level"] = self.episodes.planned(i, state, robot)
        return {
            **checked,
            "delay": checks.within("state['delay']", state["delay"], 0.0, self._longest_delay),
            "action": checks.within("state['action']", state["action"], -1.0, 1.0),
            "in_contact": check_in_contact(state["in_contact"], pads),
            "deflection": check_deflection(state["deflection"], pads),
            "steps": count("state['steps']", state["steps"]),
            "seed": count("state['command_seed']", state["command_seed"]),
            "pushes": check_schedule("state['pushes']", state["pushes"]),
            "random_pushes": flag("state['random_pushes']", state["random_pushes"]),
            "plan": plan._replace(build=build),
        }

    def _checked_build(self, i: int, state: Values) -> Build | None:
        """Return a state's robot, if it is another than now or has other lengths."""
        robot: Robot = self.lengths.constructed[i]
        if "robot" in state:
            if self.held:
                raise ValueError("state has 'robot', must have none: this robot is not exchanged")
            with checks.named_errors("state['robot'] is no robot", RecursionError):
                robot = robot_from_json(state["robot"])
            load_robot("state['robot']", robot)
        other = robot if robot != self.lengths.nominal[i] else None
        if other is not None:
            self.plant.check_robot(other)
        return self.lengths.plan(i, state.get("lengths", {}), None, other)

    def restore(self, i: int, state: Values) -> None:
        """Let a robot go on from a state of :meth:`checked_state`."""
        plant, which = self.plant, np.array([i])
        where = state["plant"], state["deflection"]
        self._begin(which, [state["plan"]], lambda: plant.set_state(i, *where))
        self.episodes.level[i] = state["level"]
        if i == 0:
            plant.in_contact = state["in_contact"]
        self._begin_delay(which, np.array([state["delay"]]), state["asked"])
        plant.slip[i] = plant.contact_force[i] = 0.0
        self.toe_load[i] = state["loads"]
        self._clear_episode(which, state["action"], state["steps"])
        if self.onboard is not None:
            self.onboard.go_on(i, state["onboard"])
        self.truncated[i] = plant.diverged[i] = False
        plant.any_diverged = bool(plant.diverged.any())
        self.seeds[i] = state["seed"]
        self.pushes.schedule(i, state["pushes"], state["random_pushes"])

    def scene(self, i: int) -> Values:
        """Return the arguments of :class:`jansen_env.rendering.Renderer` to draw a robot."""
        if self.held:
            return {"robot": self.robots[i], "terrain_points": None, "speed_unit": "rad/s"}
        return {
            "robot": self.episodes.shown_robot(i, self.robots[i]),
            "terrain_points": self.plant.terrains[i].polyline,
        }

    def frame(self, i: int, command: float | None) -> Frame:
        """Return the picture data of a robot as it is now."""
        plant, state, weight = self.plant, self.plant.states[i], float(self.weight[i])
        points = force = np.zeros((plant.toes, 2))
        contact = np.full(plant.toes, AIR)
        if not self.held:
            points, tangents = plant.contact_frames(i)
            normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
            along, across = plant.contact_force[i].T[..., None]
            force = along * tangents + across * normals
            contact = np.where(across[:, 0] > TOUCHING * weight, GRIP, AIR)
            contact[plant.slip[i] > SLIPPING * self.control_dt] = SLIP
        return Frame(
            q=state[:4].copy(), contact=contact, contact_point=points, contact_force=force,
            weight=weight, command=command,
            speed=float(state[7] if self.held else state[4]), torque=float(self.torque[i]),
            torque_limit=abs(float(self.full_torque[i])),
            time=float(self.elapsed[i]) * self.control_dt,
        )  # fmt: skip

    def __setstate__(self, state: Values) -> None:
        self.__dict__.update(state)
        self._share_arrays()

    def close(self) -> None:
        """Let go of threads."""
        self.plant.close()


def _parameters_of(changes: Values) -> Numbers:
    """Return the parameters that checked changes set at once."""
    numbers = {name: changes[name] for name in PARAMETERS if name in {*changes} - {*FROM_RESETS}}
    if "payload" in numbers:
        parameters.set_payload(numbers, numbers["payload"])
    return numbers
