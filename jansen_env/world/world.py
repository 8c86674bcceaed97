"""n walking robots in their surroundings: plant, terrain, parameters, delay, pushes, sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import entries
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.engine import readings
from jansen_env.gravity import GRAVITY
from jansen_env.parameters import CHANGED_BY, LONGEST_DELAY, PARAMETERS
from jansen_env.plants.base import LARGEST
from jansen_env.plants.initial_pose import static_deflection
from jansen_env.plants.plant import BatchedPlant, make_batch, plant_time_step
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.uniform import uniform
from jansen_env.world import settings, single_robots
from jansen_env.world.actuated import ActuatedRobots, Draw
from jansen_env.world.argument_checks import Array, Bools, Filled, Ints, option
from jansen_env.world.disturbances import NoisySensors, Pushes
from jansen_env.world.entries import Observed, list_entries
from jansen_env.world.episode_lengths import Build, EpisodeLengths
from jansen_env.world.episode_parameters import EpisodeParameters, Plan
from jansen_env.world.push import check_schedule
from jansen_env.world.randomization import Uniform

NO_PUSHES = np.zeros((0, 3))


class World(ActuatedRobots):
    """n robots in their surroundings.

    Args:
        num_envs: robots. threads: cores to use; None for as many as pay.
        machine, control, ground, randomness, sensing: filled records.
        by_default: see :class:`jansen_env.world.episode_parameters.EpisodeParameters`.

    Attributes:
        plant: moves the robots. episodes: their parameters and terrains.
        loads: (n, toes) normal forces / weight.
        seeds: (n,) of what episodes draw after their start. sensors: None without noise.

    Raises:
        ValueError: an argument out of range; LinkageError: the robot cannot turn its crank.
    """

    RECORDS = settings.RECORDS
    TAKE_ACTIONS = readings.take_actions
    OPTIONS = ("crank_angle", "pushes", "robot", "lengths", *PARAMETERS)
    SETTABLE = (*CHANGED_BY, "motor", "pad_compliance")

    def __init__(
        self,
        num_envs: int,
        threads: int | None,
        machine: Filled,
        control: Filled,
        ground: Filled,
        randomness: Filled,
        sensing: Filled,
        by_default: Collection[str] = (),
    ) -> None:
        n, robots = num_envs, settings.make_robots(machine)
        for robot in robots:
            static_deflection(robot, GRAVITY)  # or its feet are too soft
        terrains, generators = settings.make_terrains(ground)
        time_step = plant_time_step(control.plant, control.time_step)
        delays = [one["delay"] for one in randomness.randomize if "delay" in one]
        most = [one.high if isinstance(one, Uniform) else LONGEST_DELAY for one in delays]
        super().__init__(
            robots,
            readings.ROW,
            control.control_dt,
            time_step,
            control.delay,
            max(most, default=0.0),
        )
        self._every = np.arange(n)
        self.reset_noise_scale = np.array(randomness.reset_noise_scale)
        self.plant: BatchedPlant = make_batch(
            control.plant, self.robots, terrains, self.time_step, threads
        )
        self._scan = sensing.height_scan
        self.entries = list_entries(self.plant.toes, len(self._scan))
        self._noise, push = sensing.noise, sensing.push
        self.pushes = Pushes(n, push, self.steps, self.time_step)
        self.sensors: NoisySensors | None = None
        self.advance_per_turn, self._links_mass = np.zeros(n), np.zeros(n)
        self._know_robots(np.arange(n))
        self.full_torque *= self.rows["direction"]
        self.rows["weight"] = [robot.mass * GRAVITY for robot in self.robots]
        self.loads = np.zeros((n, self.plant.toes))
        self.seeds = np.zeros(n, np.int64)
        self.track_joint_forces = control.track_joint_forces
        if self.track_joint_forces and not self.plant.knows_joint_forces:
            raise ValueError("track_joint_forces is True, must be False with plant='rigid_body'")
        self.plant.tracing = self.track_joint_forces
        self._joint_loads = np.zeros(2)
        has = {"noise_level": self._noise is not None, "push_strength": push is not None}
        drawn = [{k: v for k, v in one.items() if k != "lengths"} for one in randomness.randomize]
        self.episodes = EpisodeParameters(
            self.plant, self.robots, ground, generators, drawn, has, by_default
        )
        self.lengths = EpisodeLengths(self.robots, randomness.randomize, sensing.observe_lengths)
        self._share_arrays()

    def _know_robots(self, rows: Ints) -> None:
        """Note numbers of robots that their lengths and masses give."""
        own = {id(robot): robot for robot in map(self.robots.__getitem__, rows.tolist())}
        advance = {key: advance_per_turn(robot) for key, robot in own.items()}
        self.advance_per_turn[rows] = [advance[id(self.robots[row])] for row in rows.tolist()]
        self._links_mass[rows] = [self.robots[row].links_mass for row in rows.tolist()]
        self.rows["direction"][rows] = np.copysign(1.0, self.advance_per_turn[rows])

    def _share_arrays(self) -> None:
        """Let information show the arrays of others."""
        self.groups = {"parameters": self.episodes.values} if self.episodes.varies else {}
        if self.lengths.values is not None:
            self.groups["lengths"] = self.lengths.values
        self.arrays = {"slip": self.plant.slip, "contact_force": self.plant.contact_force}
        if self.sensors is not None:
            self.arrays["true_observation"] = self.sensors.truth
        if self.track_joint_forces:
            names = "joint_force_max", "joint_impulse_max"
            self.arrays |= {k: self._joint_loads[i : i + 1] for i, k in enumerate(names)}

    def connect(
        self,
        observed: Sequence[Observed],
        observation: NDArray[np.float32],
        progress: Callable[[int], tuple[float, float]],
    ) -> None:
        """Take the array of observations (n, d), its columns, and the task's ``progress``."""
        names = [entry.name for entry in observed]
        own = [entry.name for entry in self.entries]
        self._places = np.array([names.index(name) if name in names else -1 for name in own])
        self._observation, self._progress = observation, progress
        self.lengths.connect(observed, observation)
        if self._noise is not None:
            self.sensors = NoisySensors(self.num_envs, self._noise, observed)
            self._share_arrays()

    @property
    def weight(self) -> Array:
        """(n,) N."""
        return self.rows["weight"]

    def joint_forces(self) -> JointForces:
        """Return a single robot's joint forces now; ValueError: the plant does not know them."""
        pushes = self.pushes.of_step(np.ones(1, bool), self.elapsed, self.seeds)
        push = None if pushes is None else pushes[0, 0]
        return self.plant.joint_forces(float(self.torque[0]), push)

    def reset(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]],
        draw: Draw,
    ) -> list[Any]:
        """Start episodes of some robots; returns what ``draw`` gave for each.

        Raises:
            ValueError: an option out of range, FloatingPointError: the robot diverges where it is
                placed. Nothing has changed then but the generators.
        """
        each = list(zip(rows.tolist(), generators, options, strict=True))
        drawn = [self._draw(*one, draw) for one in each]
        seeds = [int(rng.integers(2**63)) for rng in generators]
        builds = self._plan_robots(each, seeds)
        plans = [
            self.episodes.plan(*one, start[2], *self._progress(one[0]), builds.get(one[0]))
            for one, start in zip(each, drawn, strict=True)
        ]
        given = [own.get("pushes") for own in options]
        schedules = [
            NO_PUSHES if one is None else check_schedule("options['pushes']", one) for one in given
        ]
        plant = self.plant
        with self.all_or_nothing(rows, builds, plans):
            self.exchange(builds)
            self.apply_parameters(rows, plans)
            plant.place(rows, np.array([start[0] for start in drawn]))
        self.seeds[rows] = seeds
        self.loads[rows] = plant.contact_force[rows, :, 1] / self.weight[rows, None]
        states = plant.states[rows]
        states[:, 7] = [start[1] for start in drawn]
        for row, state in zip(rows.tolist(), states, strict=True):
            plant.set_state(row, state)
        self.begin_delay(rows, self.episodes.values["delay"][rows])
        self.clear_episode(rows)
        for row, pushes, one in zip(rows.tolist(), schedules, given, strict=True):
            self.pushes.schedule(row, pushes, random=one is None)
        self.truncated[rows] = False
        return [start[3] for start in drawn]

    @contextmanager
    def all_or_nothing(
        self, rows: Ints, builds: Mapping[int, Build], plans: Sequence[Plan]
    ) -> Iterator[None]:
        """Put robots (k,), which get builds and plans, back as they are now if an error comes."""
        episodes, lengths, plant = self.episodes, self.lengths, self.plant
        undo = plant.keep(rows)
        robots = {
            row: Build(lengths.nominal[row], lengths.changed[row], self.robots[row])
            for row in builds
        }
        before = [
            Plan(episodes.values[[row]], plan.terrain and plant.terrains[row])
            for row, plan in zip(rows.tolist(), plans, strict=True)
        ]
        levels = episodes.level[rows]
        try:
            yield
        except Exception:
            self.exchange(robots)
            self.apply_parameters(rows, before)
            episodes.level[rows] = levels
            undo()
            raise

    def exchange(self, builds: Mapping[int, Build]) -> Ints:
        """Put robots in the place of others, by their rows."""
        rows = super().exchange(builds)
        for row in rows.tolist():
            self.episodes.take_robot(row, self.robots[row])
        if len(rows) > 0:
            self._know_robots(rows)
        return rows

    def _draw(
        self, row: int, rng: np.random.Generator, options: dict[str, Any], draw: Draw
    ) -> tuple[float, float, float, Any]:
        """Draw crank angle (rad) and speed (rad/s), delay (s), and the task's numbers."""
        # Drawn in any case, so that fixing one leaves the others as they were.
        crank_angle = uniform(rng, 0.0, 2.0 * math.pi)
        own = draw(row, rng, options)
        crank_speed = self.reset_noise_scale[row] * uniform(rng, -1.0, 1.0)
        delay = self._draw_delay(row, rng, options)
        crank_angle = option(options, "crank_angle", crank_angle, -LARGEST, LARGEST)
        return crank_angle, crank_speed, delay, own

    def apply_parameters(self, rows: Ints, plans: Sequence[Plan]) -> None:
        """Apply planned parameters and terrains."""
        self.episodes.begin(rows, plans)
        self.update_scales(rows)

    def update_scales(self, rows: Ints) -> None:
        """Update weights, full torques, and strengths of pushes and noise."""
        values = self.episodes.values
        masses = values["mass_scale"][rows] * self._links_mass[rows] + values["payload"][rows]
        self.rows["weight"][rows] = GRAVITY * masses
        limits = np.array([self.robots[row].motor.torque_limit for row in rows.tolist()])
        limits = self.rows["direction"][rows] * limits
        self.full_torque[rows] = limits * values["motor_strength"][rows]
        self.pushes.strength[rows] = values["push_strength"][rows]
        if self.sensors is not None:
            self.sensors.level[rows] = values["noise_level"][rows]

    def clear_episode(self, rows: Ints, action: float = 0.0) -> None:
        """Clear the data of robots' last episodes."""
        kept, info = self.rows, self.rows["info"]
        for name in ("info", "energy"):
            kept[name][rows] = np.zeros((), readings.ROW[name])
        kept["action"][rows] = kept["action_before"][rows] = action
        states = self.plant.states[rows]
        kept["x_before"][rows], info["x_velocity"][rows] = states[:, 0], states[:, 4]
        info["joint_gap"][rows] = self.plant.joint_gap[rows]
        self.elapsed[rows] = 0
        self._joint_loads[:] = 0.0

    def step(
        self,
        actions: Any,
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
        self._take_actions(actions, active)
        every = np.count_nonzero(active) == self.num_envs
        self._moved = self._every if every else active.nonzero()[0]
        if self.sensors is not None:
            finish = partial(self._sense, finish)
        plant.step(
            self.torque, self.steps, self.earlier, self.switch, self._moved, meanwhile, pushes,
            finish,
        )  # fmt: skip
        if plant.joints_open:
            self.rows["info"]["joint_gap"] = plant.joint_gap
        if plant.any_diverged or self._any_truncated:
            self._truncate(plant.diverged & active)
        if self.track_joint_forces and active[0]:  # the one robot
            self._joint_loads[:] = (0.0, 0.0) if plant.any_diverged else plant.peak_loads()

    def _sense(self, finish: Callable[[Ints], None], rows: Ints) -> None:
        """Draw the errors of robots' readings, which ``finish`` takes."""
        assert self.sensors is not None
        self.sensors.draw(rows, self.elapsed, self.seeds)
        finish(rows)

    def step_arguments(self) -> tuple[Any, ...]:
        """Return the arguments of :func:`jansen_env.engine.readings.finish_step` but the first."""
        plant = self.plant
        return (
            self.control_dt, plant.states, plant.slip, plant.contact_force, plant.rows, self.rows,
            self.loads, plant.surface, self._scan, self._places, self._observation,
        )  # fmt: skip

    def describe_arguments(self) -> tuple[Any, ...]:
        """Return the arguments of :func:`jansen_env.engine.readings.describe` but the first."""
        return self.plant.states, *self.step_arguments()[4:]

    def disturb(self, rows: Ints | None = None) -> None:
        """Add noise to observations after a step, or of some robots between two steps."""
        if self.sensors is None:
            return
        if rows is not None:
            self.sensors.draw(rows, self.elapsed, self.seeds)
        self.sensors.add(self._moved if rows is None else rows, self._observation)

    @property
    def non_toe_contact(self) -> Bools:
        """(n,) whether a joint other than a toe was pressed on the ground in the last step."""
        return self.plant.rows["accumulators"]["non_toe_impulse"] > 0.0

    get_attr = single_robots.get_attr
    checked, apply = single_robots.checked, single_robots.apply
    get_state, checked_state = single_robots.get_state, single_robots.checked_state
    restore, frame = single_robots.restore, single_robots.frame

    def push(self, row: int, impulse: Any) -> None:
        """Push a robot's chassis from now on, beside other pushes, for ``push.duration`` or 0.1 s.

        Raises:
            ValueError: an impulse of no two finite numbers, N s, or too many pushes at once.
        """
        now = float(self.elapsed[row]) * self.control_dt
        own = check_schedule("impulse", [(now, *entries("impulse", impulse, "(Jx, Jy)"))])
        self.pushes.add(row, own[0])

    def scene(self, row: int) -> dict[str, Any]:
        """Return the arguments of the renderer."""
        return {
            "robot": self.episodes.shown_robot(row, self.robots[row]),
            "terrain_points": self.plant.terrains[row].polyline,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._share_arrays()

    def close(self) -> None:
        """Let go of threads."""
        self.plant.close()
