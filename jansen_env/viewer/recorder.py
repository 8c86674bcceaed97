"""Recorder: a wrapper that records episodes of any policy without changing the environment."""

import json
from collections.abc import Mapping
from typing import Any, SupportsFloat, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.spaces.utils import flatten
from gymnasium.utils import RecordConstructorArgs
from typing_extensions import override

from jansen_env.checks import shown
from jansen_env.envs.single import SingleEnv
from jansen_env.robot import Robot
from jansen_env.tasks.task import Task
from jansen_env.terrain import Shapes
from jansen_env.viewer.recording import MAX_TEXT, MAX_UNPACKED, MOST_RECORDED, Recording
from jansen_env.world.rendering import Frame
from jansen_env.world.settings import Values

Observation: TypeAlias = Any  # wrappers may change observations and actions
Action: TypeAlias = Any


class Recorder(gym.Wrapper[Observation, Action, Observation, Action], RecordConstructorArgs):
    """Wrapper that records the current episode of an environment.

    Make the environment with ``env = Recorder(gym.make("JansenWalker-v0"))``. At any time after a
    step, ``env.recording`` is the recording. The environment behaves exactly as without the
    wrapper, bit for bit.

    The wrapper keeps one episode. A reset begins a new recording. So does a step after which the
    time has gone back or the robot has been exchanged, as happens with an ``Autoreset`` wrapper
    below this one and after ``set_state``. Observations and actions are recorded as they pass
    through this wrapper. The robot and its terrain are recorded at the reset.

    Only the first ``MOST_RECORDED`` steps of an episode are kept, with a warning. Fewer steps are
    kept if the file would otherwise have more than ``MAX_UNPACKED`` bytes, as with a hundred legs.

    Args:
        env: Environment of one robot, for any task of this package, with any wrappers.
        label: Label of the recordings, such as the name of the policy.

    Attributes:
        inner: Environment below all wrappers.
        label: Label of the recordings. It may be changed.

    Raises:
        ValueError: If ``env`` is not an environment of this package for one robot, if its
            observations or actions are not arrays, or if its terrain consists of pymunk shapes.
    """

    def __init__(self, env: gym.Env[Observation, Action], label: str = "") -> None:
        RecordConstructorArgs.__init__(self, label=label)
        super().__init__(env)
        if not isinstance(inner := env.unwrapped, SingleEnv):
            raise ValueError(f"env must be an environment of one Jansen robot, got {shown(env)}")
        for name in ("observation_space", "action_space"):
            if not getattr(env, name).is_np_flattenable:
                raise ValueError(f"env.{name} must contain arrays, got {getattr(env, name)}")
        self.inner: SingleEnv[Task] = inner
        if not inner.task.world.fixed_chassis and isinstance(inner.task.world.terrain(0), Shapes):
            raise ValueError(
                "env must walk on a height line to be recorded, got a ground of pymunk shapes, "
                "which the viewer cannot draw"
            )
        self.label = label
        self._frames: dict[str, list[Any]] = {}
        self._episode: Values = {}  # values that do not change during the episode
        self._shape: tuple[object, ...] = ()
        self._time = 0.0  # time at the end of the last step, even if it is not recorded, in s
        self._most: int | None = None  # number of steps to record, known after the first step

    @property
    def recording(self) -> Recording:
        """Recording of the current episode up to now, or of the last episode once it is over.

        Raises:
            gymnasium.error.ResetNeeded: If the episode has no step yet.
            ValueError: If a wrapper has made a value that is not finite.
        """
        if not self._frames.get("reward"):
            raise gym.error.ResetNeeded("reset() and then step() must be called first")
        return Recording(**{**self._frames, **self._episode, "label": self.label})

    @override
    def reset(
        self, *, seed: int | None = None, options: Values | None = None
    ) -> tuple[Observation, Values]:
        """Reset the environment and begin a new recording.

        Args:
            seed: Seed of the environment, as for ``env.reset``.
            options: Reset options, as for ``env.reset``.
        """
        self._frames = {}  # emptied even if the reset fails
        observation, info = self.env.reset(seed=seed, options=options)
        self._begin(observation, info, seed, options)
        return observation, info

    @override
    def step(self, action: Action) -> tuple[Observation, SupportsFloat, bool, bool, Values]:
        """Step the environment and record the step.

        Args:
            action: Action for the environment.
        """
        if self._frames:  # set_parameters may have changed the command
            self._frames["command"][-1] = self.inner.task.frame(0).command or 0.0
        results = self.env.step(action)
        observation, reward, terminated, truncated, info = results
        frame = self.inner.task.frame(0)
        goes_on = self._frames and 0.0 < frame.time - self._time < 1.5 * self.inner.control_dt
        self._time = frame.time
        if not goes_on or _shape_of(self.inner.robot) != self._shape:
            self._begin(observation, info, None, None)
        elif (steps := len(self._frames["reward"])) == (most := self._most_steps()):
            gym.logger.warn(f"only the first {most} steps of the episode are recorded")
        elif steps < most:
            self._add_frame(frame, observation, info)
            flat = flatten(self.action_space, np.asarray(action))
            self._add(
                action=np.array(flat, np.float32),
                reward=float(reward),
                slip=np.array(info.get("slip", np.zeros(len(frame.contact)))),
                energy=[info["energy"][name] for name in self._episode["energies"]],
            )
            self._episode.update(terminated=bool(terminated), truncated=bool(truncated))
        return results

    def _most_steps(self) -> int:
        """Return the largest number of steps of this episode that are recorded."""
        if not self._frames["reward"]:
            return MOST_RECORDED
        if self._most is None:
            each = sum(np.asarray(values[-1]).nbytes for values in self._frames.values())
            room = MAX_UNPACKED - MAX_TEXT - self._episode["terrain"].nbytes
            self._most = min(MOST_RECORDED, max(room // each - 1, 1))
        return self._most

    def _begin(
        self, observation: Observation, info: Values, seed: int | None, options: Values | None
    ) -> None:
        """Begin a recording with the current state of the environment as its first frame."""
        scene = self.inner.task.scene(0)
        spec = self.env.spec
        world = self.inner.task.world
        ground = scene["terrain_points"]
        observed = self.inner.observed
        named = len(observed) == spaces.flatdim(self.observation_space)
        self._shape = _shape_of(self.inner.robot)
        self._episode = {
            "robot": scene["robot"],
            "terrain": np.zeros((0, 2)) if ground is None else np.array(ground),
            "speed_unit": scene.get("speed_unit", "m/s"),
            "energies": tuple(info.get("energy", {})),
            "observed": tuple((entry.name, entry.unit) for entry in observed) if named else (),
            "parameters": {} if world.fixed_chassis else world.parameters(0),
            "env_id": str(type(self.inner).__name__ if spec is None else spec.id),
            "env_kwargs": as_json({} if spec is None else spec.kwargs),
            "options": as_json(options or {}),
            "seed": None if seed is None else int(seed),
            "terminated": False,
            "truncated": False,
        }
        self._frames = {name: [] for name in ("action", "reward", "slip", "energy")}
        self._most = None
        self._time = self.inner.task.frame(0).time
        self._add_frame(self.inner.task.frame(0), observation, info)

    def _add_frame(self, frame: Frame, observation: Observation, info: Values) -> None:
        """Append the values of one frame."""
        flat = flatten(self.observation_space, observation)
        self._add(
            time=frame.time,
            state=self.inner.task.world.plant.states[0].copy(),
            pose=frame.q,
            command=frame.command or 0.0,
            speed=frame.speed,
            torque=info.get("crank_torque", frame.torque),  # mean over the step
            weight=frame.weight,
            contact=frame.contact,
            contact_point=frame.contact_point,
            contact_force=frame.contact_force,
            observation=np.array(flat, np.float32),
        )

    def _add(self, **values: object) -> None:
        """Append values to the recorded arrays."""
        for name, value in values.items():
            self._frames.setdefault(name, []).append(value)


def _shape_of(robot: Robot) -> tuple[object, ...]:
    """Return the properties of a robot that cannot change within an episode."""
    return robot.bodies, robot.legs, robot.frame_angle


def as_json(values: Mapping[str, object]) -> dict[str, object]:
    """Return values as types that JSON supports: numbers, texts, lists and dictionaries.

    Any other value is replaced by its shortened ``repr``.

    Args:
        values: Values by name.
    """

    def known(value: object) -> object:
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        try:
            return json.loads(json.dumps(value, allow_nan=False))
        except (TypeError, ValueError, RecursionError):
            return shown(value)

    return {str(name): known(value) for name, value in values.items()}
