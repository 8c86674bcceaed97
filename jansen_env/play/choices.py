"""What a session may be made of: robots, terrains, controls, and numbers that sliders change."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym

from jansen_env.baselines.policy import Policy
from jansen_env.baselines.walker_baselines import walking_pid
from jansen_env.checks import one_of, whole_number
from jansen_env.policies import pretrained
from jansen_env.robot import ROBOTS as DESIGNS
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import with_lengths
from jansen_env.terrain.generators import GENERATORS, HIGHEST
from jansen_env.viewer.recorder import Recorder


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
"""Sliders by their names in ``env.unwrapped.set_parameters``."""

ENVIRONMENTS = (
    "JansenWalkerBuilt-v0", "JansenWalkerRough-v0", "JansenWalkerHardcore-v0", "JansenWalker-v0",
)  # fmt: skip
FLAT = "flat"
TERRAINS = (FLAT, *GENERATORS)
ROBOTS = tuple(sorted(DESIGNS))
BY_HAND = "torque"  # in place of a policy's name
STEADY = "constant speed"  # of the crank, by the PID (13)
SHORTEST_TURN = 0.05  # m, by which the crank's speed is found for a command


def controls_of(env_id: str) -> tuple[str, ...]:
    """What may turn the crank in an environment: names of controls and policies."""
    return (BY_HAND, STEADY, *pretrained.names(env_id))


def make_env(env_id: str, choices: Mapping[str, Any]) -> Any:
    """Return the environment of some choices, which records what is walked in it.

    Raises ValueError: a choice is none of those allowed, or the robot's lengths do not close.
    """
    one_of("robot", choices["robot"], ROBOTS)
    one_of("terrain", choices["terrain"], TERRAINS)
    level, name = whole_number("level", choices["level"], HIGHEST), choices["robot"]
    lengths = choices["lengths"]
    env = gym.make(
        env_id, max_episode_steps=-1, disable_env_checker=True,
        robot=with_lengths(DESIGNS[name](), lengths) if lengths else name,
        terrain=choices["terrain"], terrain_level=0 if choices["terrain"] == FLAT else level,
        randomize=None, terminate_when_fallen=False,
    )  # fmt: skip
    return Recorder(env, name)


def policy_of(env_id: str, control: Any, env: Any) -> Policy | None:
    """Return what turns the crank of an environment; None for the torque by hand.

    Raises ValueError: ``control`` is none of :func:`controls_of`.
    """
    one_of("control", control, controls_of(env_id))
    if control == STEADY:
        way = max(abs(advance_per_turn(env.unwrapped.robot)), SHORTEST_TURN)
        return walking_pid(lambda speed: 2.0 * math.pi / way * speed, env.unwrapped)
    return None if control == BY_HAND else pretrained.load(env_id, control).on(env)
