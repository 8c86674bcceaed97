"""``JansenWalker-v0`` for many robots at once: what ``gym.make_vec`` makes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from jansen_env.checks import positive, positive_integer, shown
from jansen_env.engine import integrator
from jansen_env.envs import arguments
from jansen_env.envs.rewards import RewardWeights
from jansen_env.envs.walker_member import Member
from jansen_env.envs.walking import (
    FASTEST_COMMAND,
    REWARD_KEYS,
    SPEED_COMMAND,
    WalkingTask,
    draw_start,
    observation_space,
)
from jansen_env.gravity import GRAVITY
from jansen_env.plants.batch import TIME_STEP, Batch
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot import Payload, Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Moved(NamedTuple):
    """What a step did, an entry for each robot: m/s, and the torque in N m, with the flags."""

    rewards: Array
    terminated: Flags
    truncated: Flags
    speed: Array
    torque: Array


class JansenWalkerVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """``num_envs`` robots that do the task of :class:`jansen_env.envs.walker.JansenWalkerEnv`.

    Spaces, rewards, information and arguments are those of the single environment, and so are the
    trajectories, bit for bit: robot i of ``reset(seed=s)`` does what the single environment does
    after ``reset(seed=s + i)``. All robots share one pymunk space and are moved by all cores. A
    robot whose simulation diverges ends its own episode, no other's.

    Args:
        num_envs: robots.
        autoreset_mode: ``NEXT_STEP`` (Gymnasium's default: the step after an episode's last one
            resets and ignores the action), ``SAME_STEP`` (that very step returns the next
            episode's first observation; ``infos["final_obs"]`` has the last one) or ``DISABLED``.
        threads: cores to use; None for as many as pay.
        terrain, friction, restitution, payload, speed_command, reset_noise_scale,
        max_episode_steps: as for one robot, or one for each: a sequence of terrains (or their
            names), arrays (num_envs,), a sequence of payloads; ``speed_command`` as an array
            (num_envs,) of numbers or (num_envs, 2) of ranges.
        robot, torque_limit, control_dt, time_step, tracking_weight ... fall_weight,
        terminate_when_fallen: as for one robot.
        render_mode: None or ``"rgb_array"``.

    Attributes:
        members: the robots one by one, for what is asked of or told to one of them.

    Raises:
        ValueError: an argument out of range, or not one for each robot.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}
    members: Sequence[Member] = ()  # until they are made: Gymnasium closes what was refused, too

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | Sequence[int | None] | None = 500,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        robot: Robot | str = "paper",
        terrain: Terrain | str | Any = "flat",
        friction: float | Array | None = None,
        restitution: float | Array | None = None,
        speed_command: float | tuple[float, float] | Array = SPEED_COMMAND,
        torque_limit: float = 20.0,
        payload: Payload | float | Sequence[Payload | float] | Array | None = None,
        control_dt: float = 0.02,
        time_step: float | None = None,
        plant: str = "projection",
        tracking_weight: float = RewardWeights.tracking,
        slip_weight: float = RewardWeights.slip,
        energy_weight: float = RewardWeights.energy,
        posture_weight: float = RewardWeights.posture,
        fall_weight: float = RewardWeights.fall,
        reset_noise_scale: float | Array = 0.1,
        terminate_when_fallen: bool = True,
        track_joint_forces: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs = n = positive_integer("num_envs", num_envs, arguments.MOST_ROBOTS)
        tracks = arguments.flag("track_joint_forces", track_joint_forces)
        if not isinstance(plant, str) or plant != "projection" or tracks:
            raise ValueError(
                f"plant is {shown(plant)} and track_joint_forces {tracks}, must be "
                "'projection' and False for robots that move together; "
                "vectorization_mode='sync' has the others"
            )
        self.render_mode = arguments.render_mode(render_mode, self.metadata["render_modes"])
        self.autoreset_mode = arguments.autoreset_mode(autoreset_mode)
        self.max_episode_steps = arguments.limit_of_each(n, max_episode_steps)
        self.terrains = arguments.terrain_of_each(n, terrain, friction, restitution)
        self.robots = arguments.robot_of_each(n, robot, payload)
        self.commands = arguments.command_of_each(n, speed_command, FASTEST_COMMAND)
        self.torque_limit = positive("torque_limit", torque_limit)
        self.reset_noise_scale = arguments.noise_of_each(n, reset_noise_scale)
        self.terminate_when_fallen = arguments.flag("terminate_when_fallen", terminate_when_fallen)
        step = TIME_STEP if time_step is None else time_step
        self.control_dt, step = arguments.control_period(control_dt, step)
        self.batch = Batch(self.robots, self.terrains, step, threads=threads)
        self._steps = round(self.control_dt / step)
        self.metadata = {
            **self.metadata,
            "render_fps": max(1, round(1.0 / self.control_dt)),
            "autoreset_mode": self.autoreset_mode,
        }
        self.weights = RewardWeights(
            tracking_weight, slip_weight, energy_weight, posture_weight, fall_weight
        )
        self.weight = np.array([robot.mass * GRAVITY for robot in self.robots])
        toes = self.batch.toes
        self.task = WalkingTask(self.terrains, toes, self.weight, self.control_dt, self.weights)
        self.single_observation_space = observation_space(toes)
        self.single_action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, n)
        self.action_space = batch_space(self.single_action_space, n)
        self.members = [Member(self, i) for i in range(n)]
        self.elapsed = np.zeros(n, np.int64)  # steps of each episode
        self._done = np.ones(n, bool)  # must be reset before it goes on
        self._begun = np.zeros(n, bool)
        self._generators: list[np.random.Generator | None] = [None] * n
        self._seeds = [-1] * n
        self._alone: dict[Any, ProjectionPlant] = {}  # by the shape of its ground

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes: of all robots, or of those in ``options["reset_mask"]`` (num_envs,).

        Args:
            seed: robot i gets seed + i, or entry i.
            options: ``speed_command`` (m/s) and ``crank_angle`` (rad), for all or one for each.

        Raises:
            ValueError: not one seed or option for each robot, an unknown option, or a value out of
                range. TypeError: ``reset_mask`` is no array of flags.
        """
        options = arguments.reset_options(options)
        mask = self._reset_mask(options.pop("reset_mask", None))
        seeds = arguments.seed_of_each(self.num_envs, seed)
        return self.reset_each(seeds, arguments.options_of_each(self.num_envs, options), mask)

    def reset_each(
        self,
        seeds: Sequence[int | None],
        options: Sequence[dict[str, Any]],
        mask: Flags | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """:meth:`reset` with a seed and options for each robot; ``mask`` (num_envs,) names some."""
        mask = np.ones(self.num_envs, bool) if mask is None else mask
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None:
                self._generators[i], self._seeds[i] = seeding.np_random(seeds[i])
        self._begin(np.flatnonzero(mask), options)
        self._begun |= mask
        velocity = self.batch.states[:, 4].copy()
        infos = self.infos(velocity, np.zeros(self.num_envs), known=mask)
        return self.task.observe(self.batch.states).copy(), infos

    def _reset_mask(self, mask: Any) -> Flags:
        if mask is None:
            return np.ones(self.num_envs, bool)
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError(f"options['reset_mask'] is {mask!r}, must be an array of flags")
        if mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] is {mask!r}, must have shape ({self.num_envs},) and name "
                "one robot at least"
            )
        return mask

    def _begin(self, rows: Ints, options: Sequence[dict[str, Any]] | None = None) -> None:
        """Start the next episodes of some robots."""
        for i in rows.tolist():
            command, crank_angle, crank_speed = draw_start(
                self.generator(i),
                (self.commands[i, 0], self.commands[i, 1]),
                self.reset_noise_scale[i],
                None if options is None else options[i],
            )
            plant = self.alone(i)
            plant.reset(0.0, crank_angle)
            peek = plant.peek()
            self.batch.states[i] = plant.state
            self.batch.states[i, 7] = crank_speed
            self.batch.totals[i], self.batch.record[i] = plant.sums()
            self.batch.diverged[i] = False
            loads = peek.contact_force[:, 1] / self.weight[i]
            self.task.begin(slice(i, i + 1), np.array([command]), loads)
        self.elapsed[rows] = 0
        self._done[rows] = False

    def alone(self, index: int) -> ProjectionPlant:
        """A plant on a robot's ground that is that robot, to try things without the others."""
        terrain = self.terrains[index]
        plant = self._alone.get(terrain.points)
        if plant is None:
            plant = ProjectionPlant(self.robots[index], terrain, self.batch.time_step)
            self._alone[terrain.points] = plant
        plant.become(self.robots[index], self.batch.parameters[index])
        return plant

    def carry(self, index: int, robot: Robot) -> None:
        """Make a robot another one of the same design, with another payload."""
        self.robots[index] = robot
        self.batch.exchange(index, robot)
        self.weight[index] = self.task.weight[index] = robot.mass * GRAVITY

    def last_contacts(self, index: int) -> tuple[Array, Array]:
        """Slip (toes,) in m and mean forces (toes, 2) in N of a robot's last step."""
        record = self.batch.record[index, : self.batch.toes]
        steps = self._steps if self.elapsed[index] else 1
        return record[:, integrator.SLIP], record[:, integrator.IMPULSE_T :] / (
            steps * self.batch.time_step
        )

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Array, Flags, Flags, dict[str, Any]]:
        """Hold each robot's torque for ``control_dt`` seconds.

        Raises:
            ValueError: the actions are not one finite number for each robot.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`, and with
                ``AutoresetMode.DISABLED`` while an episode is over.
        """
        over = self._done.copy()
        if over.any() and self.autoreset_mode == AutoresetMode.DISABLED:
            raise gym.error.ResetNeeded(
                f"robots {np.flatnonzero(over).tolist()} must be reset before the next step()"
            )
        moved = self.move(actions)
        if over.any():  # NEXT_STEP: they only start anew
            self.restart(np.flatnonzero(over))
            moved.rewards[over] = moved.torque[over] = 0.0
            moved.terminated[over] = moved.truncated[over] = False
            moved.speed[over] = self.batch.states[over, 4]
        infos = self.infos(moved.speed, moved.torque, stepped=~over)
        self._done[:] = done = moved.terminated | moved.truncated
        if self.autoreset_mode == AutoresetMode.SAME_STEP and done.any():
            infos = self._restarted(done, infos, moved)
        observations = self.task.observation.copy()
        return observations, moved.rewards, moved.terminated, moved.truncated, infos

    def move(self, actions: NDArray[np.float32]) -> Moved:
        """:meth:`step` without starting episodes and without information.

        Raises:
            ValueError: as :meth:`step`.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`.
        """
        batch, task = self.batch, self.task
        if not self._begun.all():
            raise gym.error.ResetNeeded(
                f"robots {np.flatnonzero(~self._begun).tolist()} must be reset before they move"
            )
        task.share[:] = arguments.torque_shares(actions, ~self._done)
        torque = task.share * self.torque_limit
        x_before = batch.states[:, 0].copy()
        batch.step(torque, self._steps)
        batch.diverged &= ~self._done  # the others start anew
        if batch.diverged.any():
            diverged = np.flatnonzero(batch.diverged).tolist()
            gym.logger.warn(
                f"the episodes of robots {diverged} end: their simulation diverged under torques of "
                f"{torque[diverged].tolist()} N m; try a smaller time_step"
            )
        slip = batch.record[:, : batch.toes, integrator.SLIP].copy()
        force = batch.record[:, : batch.toes, integrator.IMPULSE_T :] / (
            self._steps * batch.time_step
        )
        work, bumped = (
            batch.totals[:, integrator.MOTOR_WORK].copy(),
            batch.totals[:, integrator.BUMPS],
        )
        task.judge(batch.states, x_before, slip, force, work, bumped > 0.0)
        self.elapsed += 1
        return Moved(
            rewards=task.reward.copy(),
            terminated=task.fallen & self.terminate_when_fallen,
            truncated=(self.elapsed >= self.max_episode_steps) | batch.diverged,
            speed=task.speed.copy(),
            torque=torque,
        )

    def restart(self, rows: Ints) -> None:
        """Start the next episodes of some robots; ``task.observation`` then has their first ones."""
        self._begin(rows)
        self.task.observe(self.batch.states)

    def _restarted(self, done: Flags, last: dict[str, Any], moved: Moved) -> dict[str, Any]:
        """Start the next episodes where ``done``; what was last seen goes into the information."""
        final = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(done).tolist():
            final[i] = self.task.observation[i].copy()
        self.restart(np.flatnonzero(done))
        speed = np.where(done, self.batch.states[:, 4], moved.speed)
        infos = self.infos(speed, np.where(done, 0.0, moved.torque), stepped=~done)
        infos["final_obs"], infos["_final_obs"] = final, done
        infos["final_info"], infos["_final_info"] = _only(last, done), done
        return infos

    def infos(
        self,
        speed: Array,
        torque: Array,
        known: Flags | None = None,
        stepped: Flags | None = None,
    ) -> dict[str, Any]:
        """What the single environment's ``info`` has, in arrays, each with a mask.

        Args:
            speed: (n,) m/s and torque: (n,) N m of the last step, as they are not kept.
            known: (n,) robots it is about; None for all.
            stepped: (n,) robots for which it has the reward's terms; None for none.
        """
        known = np.ones(self.num_envs, bool) if known is None else known
        batch, task = self.batch, self.task
        states, totals = batch.states.copy(), batch.totals.copy()
        work, joints, slip, impact, _, _, _, change, _ = totals.T
        elapsed = np.where(self.elapsed == 0, 1, self._steps)[:, None, None] * batch.time_step
        record = batch.record[:, : batch.toes]
        values: dict[str, Any] = {
            "x_position": states[:, 0],
            "x_velocity": speed,
            "pitch": states[:, 2],
            "crank_angle": states[:, 3],
            "crank_speed": states[:, 7],
            "crank_torque": torque,
            "speed_command": task.command.copy(),
            "slip": record[:, :, integrator.SLIP].copy(),
            "contact_force": record[:, :, integrator.IMPULSE_T :] / elapsed,
            "fallen": task.fallen.copy(),
            "energy": {
                "motor_work": work,
                "joint_loss": joints,
                "slip_loss": slip,
                "impact_loss": impact,
                "mechanical_energy_change": change,
                "residual": work - (joints + slip + impact) - change,
            },
            "joint_gap": np.zeros(self.num_envs),
            "diverged": batch.diverged.copy(),
        }
        infos = _masked(values, known)
        if stepped is not None and stepped.any():
            terms = np.where(stepped[:, None], task.terms, 0.0)
            infos.update(_masked(dict(zip(REWARD_KEYS, terms.T, strict=True)), stepped))
        return infos if known.all() else _only(infos, known)

    def generator(self, index: int) -> np.random.Generator:
        """A robot's random numbers; seeded by the system where :meth:`reset` has got no seed."""
        found = self._generators[index]
        if found is None:
            found, self._seeds[index] = seeding.np_random()
            self._generators[index] = found
        return found

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Every robot's random numbers."""
        return tuple(self.generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Every robot's seed; -1 where it has none yet."""
        return tuple(self._seeds)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What each of :attr:`members` answers to a method, or its attribute of that name."""
        found = [getattr(member, name) for member in self.members]
        return tuple(f(*args, **kwargs) if callable(f) else f for f in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of each of :attr:`members`."""
        return tuple(getattr(member, name) for member in self.members)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of all :attr:`members`: to one value, or to the entries of a list."""
        values = values if isinstance(values, (list, tuple)) else [values] * self.num_envs
        if len(values) != self.num_envs:
            raise ValueError(f"values has {len(values)} entries, must have {self.num_envs}")
        for member, value in zip(self.members, values, strict=True):
            setattr(member, name, value)

    def render(self) -> tuple[Any, ...] | None:
        """A picture (H, W, 3) of each robot; None without a ``render_mode``."""
        if self.render_mode is None:
            gym.logger.warn("render() was called without a render_mode; pass 'rgb_array'")
            return None
        return tuple(member.render() for member in self.members)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_alone": {}}

    def close_extras(self, **kwargs: Any) -> None:
        """Let go of pictures and threads."""
        for member in self.members:
            member.close()
        if self.members:
            self.batch.close()


def _masked(values: dict[str, Any], known: Flags) -> dict[str, Any]:
    """Gymnasium's vector information: each key with a mask of where it is known."""
    infos: dict[str, Any] = {}
    for key, value in values.items():
        infos[key] = _masked(value, known) if isinstance(value, dict) else value
        infos[f"_{key}"] = known.copy()
    return infos


def _only(infos: dict[str, Any], rows: Flags) -> dict[str, Any]:
    """A copy that knows of ``rows`` alone, with 0 elsewhere."""
    part: dict[str, Any] = {}
    for key, value in infos.items():
        if isinstance(value, dict):
            part[key] = _only(value, rows)
        else:
            keep = rows.reshape((-1,) + (1,) * (value.ndim - 1))
            part[key] = np.where(keep, value, np.zeros((), value.dtype))
    return part
