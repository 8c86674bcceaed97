"""A robot walked by hand: its environment, input, settings, score and pace."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from jansen_env.baselines.policy import Policy
from jansen_env.checks import finite, instance, one_of, shown, whole_number, within
from jansen_env.envs.single import SingleEnv
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import arguments_of
from jansen_env.rendering import Frame
from jansen_env.robot import ROBOTS as DESIGNS
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import with_lengths
from jansen_env.tasks.task import Task
from jansen_env.tasks.walking.walker_benchmark import walking_pid
from jansen_env.terrain.generators import GENERATORS, HIGHEST
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import Recording
from jansen_env.world.settings import Values

MIN_DISTANCE = 1e-3  # m, below which a ratio per metre is not formed
PACES = (1.0, 0.5, 0.25, 0.1)  # of the robot's time in the user's
LARGEST_PUSH = 10.0  # N s
LONGEST_REPLAY = 60.0  # s
LONGEST_GAP = 0.25  # s: after a longer pause of the program the robot's time has stood still
MESSAGE_TIME = 6.0  # s for which a message is shown
TORQUE_RATE, RELEASE_RATE = 3.0, 8.0  # 1/s, of the torque while a key is held, and after it
FIRST_COMMAND, STEADY_COMMAND = 0.25, 0.5  # of the top speed, when a policy or the PID takes over
COMMAND_RATE = 0.5  # 1/s, of a policy's command while a key is held
ENVIRONMENTS = (
    "JansenWalkerBuilt-v0", "JansenWalkerRough-v0", "JansenWalkerHardcore-v0", "JansenWalker-v0",
)  # fmt: skip
FLAT = "flat"
TERRAINS = (FLAT, *GENERATORS)
ROBOTS = tuple(sorted(DESIGNS))
BY_HAND = "hand"  # in place of a policy's name
STEADY = "constant speed"  # of the crank, by the PID (13)
SHORTEST_TURN = 0.05  # m, by which the crank's speed is found for a command


class Slider(NamedTuple):
    """A number that may be changed while the robot walks, and its limits."""

    label: str
    unit: str
    low: float
    high: float


SLIDERS = {
    "friction": Slider("friction", "", 0.0, 1.2),
    "payload": Slider("payload", "kg", 0.0, 6.0),
    "restitution": Slider("restitution", "", 0.0, 0.9),
    "tilt": Slider("slope", "rad", -0.25, 0.25),
    "motor_strength": Slider("motor strength", "", 0.1, 1.5),
}
"""Sliders by their names in ``env.inner.set_parameters``."""


@dataclass(frozen=True)
class Choices:
    """The robot, terrain, level and control of a walk. Raises ValueError: one is not allowed."""

    robot: str
    terrain: str
    level: int
    control: str

    def __post_init__(self) -> None:
        one_of("robot", self.robot, ROBOTS)
        one_of("terrain", self.terrain, TERRAINS)
        whole_number("level", self.level, HIGHEST)

    def changed(self, name: str, value: Any) -> Choices:
        """These with another choice. Raises ValueError, too, for a level of flat ground."""
        if name == "level" and self.terrain == FLAT and value != 0:
            raise ValueError(f"level is {shown(value)}, must be 0 on flat ground")
        return replace(self, **{name: value})


@dataclass
class Score:
    """Score of a walk so far.

    Attributes:
        time: s. distance: m, walked in the directions commanded, and without a command in the
            direction walked. slip_per_metre: m slid by all toes while loaded / distance.
        cost_of_transport: sum of \\|motor work\\| of each step / (weight * distance). Both ratios
            are None where there is no distance. speed: m/s, mean of the last strides, in +x.
    """

    time: float = 0.0
    distance: float = 0.0
    slip_per_metre: float | None = None
    cost_of_transport: float | None = None
    speed: float = 0.0

    def __post_init__(self) -> None:
        self._x = self._free = self._commanded = self._slip = self._lift = 0.0  # m

    def add(self, info: Values, frame: Frame, command: float | None) -> None:
        """Add a step by its ``info``, the frame at its end and the command, m/s, in it."""
        way, self._x = float(info["x_position"]) - self._x, float(info["x_position"])
        if command:
            self._commanded += way if command > 0.0 else -way
        else:
            self._free += way
        self._slip += float(np.sum(info["slip"]))
        self._lift += abs(float(info["energy"]["motor_work"])) / frame.weight
        self.time, self.speed = frame.time, float(info["mean_speed"])
        self.distance = max(self._commanded, 0.0) + abs(self._free)
        if self.distance > MIN_DISTANCE:
            self.slip_per_metre = self._slip / self.distance
            self.cost_of_transport = self._lift / self.distance
        else:
            self.slip_per_metre = self.cost_of_transport = None


class Session:
    """A robot that is walked by hand, or by a policy whose speed command is given by hand.

    Args:
        env_id: one of :data:`ENVIRONMENTS`. robot: one of :data:`ROBOTS`, None for the
            environment's own. terrain: one of :data:`TERRAINS`, None for the environment's own.
        level: of terrains that have levels, 0 to 9. control: :data:`BY_HAND`, :data:`STEADY`, or
            the name of a policy that the package has for the environment. seed: of start and
            ground.

    Attributes:
        choices: present ones, and options: allowed values of each. lengths: m, that are not the
            design's. env: the environment, unwrapped.
        input: -1 to 1: the action, or the policy's command as a share of :attr:`top_speed`, m/s.
        settings: the sliders that have been moved. paused: time stands still. pace: of time, one
            of :data:`PACES`. fallen: since the last start. stuck: the simulation has diverged.
        version: changes with anything but the robot's state and the input.

    Raises:
        ValueError: an argument is none of those allowed, or they do not go together.
    """

    def __init__(
        self,
        env_id: str = ENVIRONMENTS[0],
        robot: str | None = None,
        terrain: str | None = None,
        level: int = 0,
        control: str = BY_HAND,
        seed: int = 0,
    ) -> None:
        self.env_id = one_of("env", env_id, ENVIRONMENTS)
        self.seed = whole_number("seed", seed)
        self.options: dict[str, tuple[object, ...]] = {
            "robot": ROBOTS,
            "terrain": TERRAINS,
            "level": tuple(range(HIGHEST + 1)),
            "control": (BY_HAND, STEADY, *pretrained.names(env_id)),
        }
        self.settings: dict[str, float] = {}
        self.input, self.paused, self.pace = 0.0, False, PACES[0]
        self.top_speed, self.version = 1.0, 0
        self._held, self._returns = 0, False  # the keys; whether the torque goes back to 0
        self._message, self._message_left = "", 0.0
        defaults = arguments_of(env_id)
        start = Choices(robot or defaults["robot"], terrain or defaults["terrain"], 0, control)
        self.choices = replace(start, control="")
        self._env: Recorder
        self._rebuild(start.changed("level", level), {})

    @property
    def env(self) -> SingleEnv[Task]:
        """The environment, unwrapped."""
        return self._env.inner

    @property
    def command(self) -> float | None:
        """m/s, of the policy; None where the input is the torque by hand."""
        return None if self._policy is None else self.input * self.top_speed

    @property
    def message(self) -> str:
        """Line for the user; empty if there is none."""
        if self._message:
            return self._message
        if self.stuck:
            return "The simulation has diverged. Start again."
        if self.fallen:
            return "It has fallen. Start again (R), or go on."
        return ""

    def values(self) -> dict[str, float]:
        """Values of the sliders by the names of :data:`SLIDERS`."""
        present = self.env.get_state()["parameters"]
        return {name: float(present[name]) for name in SLIDERS}

    def score(self) -> Score:
        """Score of the walk since the last start; after a fall, of the walk until then."""
        return replace(self._score)

    # Actions of the user. Each raises ValueError where it is refused, and then changes nothing.

    def say(self, message: str) -> None:
        """Show a message for a while."""
        self._message, self._message_left = message, MESSAGE_TIME

    def steer(self, value: float) -> None:
        """Let the input be a number from -1 to 1."""
        self.input = within("input", value, -1.0, 1.0)
        self._held, self._returns = 0, False

    def hold(self, direction: int) -> None:
        """Hold the key to the right (1), to the left (-1), or none (0).

        The torque by hand goes back to 0 after it; a policy's command stays.
        """
        if isinstance(direction, bool) or direction not in (-1, 0, 1):
            raise ValueError(f"direction is {shown(direction)}, must be -1, 0 or 1")
        if direction or self._held:
            self._held, self._returns = int(direction), self._policy is None

    def set(self, name: str, value: float) -> None:
        """Move a slider."""
        one_of("slider", name, SLIDERS)
        slider = SLIDERS[name]
        number = within(slider.label, value, slider.low, slider.high)
        self.env.set_parameters(**{name: number})
        self.settings[name] = number
        self.version += 1

    def choose(self, name: str, value: object) -> None:
        """Choose a robot, a terrain, a level or a control; all but a control start again."""
        choices = self.choices.changed(one_of("choice", name, self.options), value)
        if name == "control":
            self._take_control(self._policy_of(choices.control, self._env), choices)
        else:
            self._rebuild(choices, {} if name == "robot" else self.lengths)

    def build(self, robot: str, lengths: Mapping[str, float]) -> None:
        """Let a robot with other lengths walk, its crank at a constant speed.

        ``lengths``: see :func:`jansen_env.robot.lengths.with_lengths`.
        """
        choices = replace(self.choices, robot=robot, control=STEADY)
        self._rebuild(choices, instance("lengths", lengths, dict))
        self.pause(False)

    def push(self, x: float, y: float) -> None:
        """Push the chassis by an impulse, N s in x and y, no larger than :data:`LARGEST_PUSH`."""
        impulse = finite("x", x), finite("y", y)
        if math.hypot(*impulse) > LARGEST_PUSH * (1.0 + 1e-9):
            raise ValueError(f"push is {impulse} N s, must be no larger than {LARGEST_PUSH:g}")
        self.env.push(impulse)

    def pause(self, value: bool) -> None:
        """Let time stand still, or go on."""
        instance("pause", value, bool)
        self.paused = value
        self.version += 1

    def slow(self, value: float) -> None:
        """Let time pass at one of :data:`PACES`."""
        if value not in PACES or isinstance(value, bool):
            raise ValueError(f"pace is {shown(value)}, must be one of {list(PACES)}")
        self.pace = float(value)
        self.version += 1

    def reset(self) -> None:
        """Start again at rest: from the same place on the same ground."""
        self._start()

    def another(self) -> None:
        """Start with another crank angle, and on another ground where it is drawn."""
        self.seed += 1
        self._start()

    def advance(self, seconds: float) -> int:
        """Let the user's time pass; return how many steps the robot has taken."""
        seconds = min(max(seconds, 0.0), LONGEST_GAP)
        self._message_left -= seconds
        if self._message_left <= 0.0:
            self._message = ""
        self._move_input(seconds)
        if self.paused or self.stuck:
            return 0
        self._due += seconds * self.pace / self._dt
        steps = int(self._due)
        self._due -= steps
        for _ in range(steps):
            self._step()
        return steps

    def frame(self) -> Frame:
        """Interpolate between the last two steps; forces are the next one's."""
        before, now = self._frames
        moved = {
            name: (1.0 - self._due) * getattr(before, name) + self._due * getattr(now, name)
            for name in ("q", "contact_point", "time")
        }
        return replace(now, **moved)

    def recording(self) -> Recording:
        """The walk since the last start, at most :data:`LONGEST_REPLAY` s of it.

        Raises ValueError: it has not begun.
        """
        try:
            return self._env.recording
        except gym.error.ResetNeeded as error:
            raise ValueError("there is no walk yet: go on, and ask again") from error

    def close(self) -> None:
        """Let go of the environment."""
        self._env.close()

    def _rebuild(self, choices: Choices, lengths: dict[str, float]) -> None:
        """Start with another environment. Raises ValueError, and then changes nothing."""
        design, flat = choices.robot, choices.terrain == FLAT
        made = gym.make(
            self.env_id, max_episode_steps=-1, disable_env_checker=True,
            robot=with_lengths(DESIGNS[design](), lengths) if lengths else design,
            terrain=choices.terrain, terrain_level=0 if flat else choices.level,
            randomize=None, terminate_when_fallen=False,
        )  # fmt: skip
        env = Recorder(made, design)
        try:
            env.inner.set_parameters(**self.settings)
            policy = self._policy_of(choices.control, env)
        except ValueError:
            env.close()
            raise
        if self.choices.control:  # not the first one
            self._env.close()
        self._env, self.lengths = env, lengths
        self._take_control(policy, choices)
        self._start()

    def _policy_of(self, control: str, env: Recorder) -> Policy | None:
        """Return what turns the crank of an environment; None for the torque by hand."""
        one_of("control", control, self.options["control"])
        if control == STEADY:
            way = max(abs(advance_per_turn(env.inner.robot)), SHORTEST_TURN)
            return walking_pid(lambda speed: 2.0 * math.pi / way * speed, env.inner)
        return None if control == BY_HAND else pretrained.load(self.env_id, control).on(env)

    def _take_control(self, policy: Policy | None, choices: Choices) -> None:
        """Let a policy walk, or None: the hand."""
        if self.choices.control != choices.control:
            command = STEADY_COMMAND if choices.control == STEADY else FIRST_COMMAND
            self.input = 0.0 if policy is None else command
            self._held, self._returns = 0, False
        self._policy, self._memory, self._fresh = policy, None, True
        self.choices = choices
        if policy is not None:  # the fastest command that it was trained for
            arguments = {**arguments_of(self.env_id), **getattr(policy, "env_kwargs", {})}
            self.top_speed = float(np.max(np.abs(arguments["speed_command"])))
        self.version += 1

    def _start(self) -> None:
        """Begin a walk."""
        self._dt = self.env.control_dt
        self._observation, _ = self._env.reset(
            seed=self.seed, options={"speed_command": self.command or 0.0}
        )
        self._memory, self._fresh = None, True
        if self._policy is None:
            self.input, self._held = 0.0, 0
        self._score = Score()
        self.fallen, self.stuck, self._due = False, False, 0.0
        self._frames = (self.env.frame(),) * 2
        self._message = ""
        self.version += 1

    def _move_input(self, seconds: float) -> None:
        """Let held keys move the input."""
        if self._held and self._policy is not None:
            moved = self.input + self._held * COMMAND_RATE * seconds
            self.input = min(max(moved, -1.0), 1.0)
        elif self._held or self._returns:
            step = seconds * (TORQUE_RATE if self._held else RELEASE_RATE)
            # A key against the torque there is begins at 0.
            start = self.input if self.input * self._held >= 0.0 else 0.0
            self.input = start + min(max(self._held - start, -step), step)
            self._returns = bool(self._held) or self.input != 0.0

    def _step(self) -> None:
        """Take one step."""
        if self.stuck:
            return
        action = np.array([self.input], np.float32)
        if self._policy is not None:
            self.env.set_parameters(command=self.command)
            action, self._memory = self._policy.predict(
                self._observation, self._memory, self._fresh
            )
            self._fresh = False
        # Of a longer walk the rest is not recorded.
        env = self._env if self._frames[1].time < LONGEST_REPLAY else self._env.env
        self._observation, _, _, self.stuck, info = env.step(action)
        self._frames = self._frames[1], self.env.frame()
        if not self.fallen:
            self._score.add(info, self._frames[1], self.command)
            self.fallen = bool(info["fallen"])
