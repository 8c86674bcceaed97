"""``JansenGoal-v0``: walk to a goal and stand there. The task is plain NumPy over n robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from typing_extensions import Unpack, override

from jansen_env.arrays import Array, Bools
from jansen_env.checks import MOST_SINGLE, non_negative, positive, within
from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv, VectorArguments
from jansen_env.tasks.task import Task
from jansen_env.uniform import uniform
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.rendering import Frame
from jansen_env.world.settings import (
    Check,
    Values,
    WorldArguments,
    WorldSettings,
    option,
    shared,
)
from jansen_env.world.world import Numbers

FARTHEST = 3.0  # largest distance of a goal on either side, in m
NEAR = 0.02  # distance from the goal at which the arrival reward is halved, in m
HOLD = 1.0  # time for which a robot must stay within NEAR of the goal to succeed, in s
HALF_DISTANCE = 0.3  # distance at which closeness is 0.5, in m
HALF_POWER = 0.5  # motor power / weight at which the energy factor is 0.5, in m/s
FALLEN_PITCH = 1.2  # pitch beyond which the robot has fallen, in rad
UP_TO = 1e-9  # tolerance of HOLD in s, because control periods do not add up to it exactly


class GoalArguments(WorldArguments, total=False):
    """Arguments of ``JansenGoal-v0``; :class:`GoalSettings` has their defaults and checks."""

    energy_weight: float
    arrival_weight: float


@dataclass(frozen=True, kw_only=True)
class GoalSettings(WorldSettings):
    """Arguments of ``JansenGoal-v0``: those of the world, and the weights of the reward."""

    energy_weight: float = shared(1.0, non_negative)  # exponent of the energy factor
    # With a weight of 1, closeness alone would give nearly the same reward.
    arrival_weight: float = shared(6.0, positive)


def closeness(distance: Array) -> Array:
    """Return 1 at the goal, and 0.5 at :data:`HALF_DISTANCE`.

    Args:
        distance: Absolute distances to the goals, in m, shape (n,).
    """
    return 1.0 / (1.0 + distance / HALF_DISTANCE)


def arrived(distance: Array, worth: float) -> Array:
    """Return ``worth`` at the goal, and half of it at :data:`NEAR`.

    Args:
        distance: Absolute distances to the goals, in m, shape (n,).
        worth: Value at the goal.
    """
    return worth / (1.0 + (distance / NEAR) ** 2)


def energy(power: Array, weight: Array, exponent: float) -> Array:
    """Return the energy factor of the reward, which is 1 without motor power.

    Args:
        power: Absolute motor powers, in W, shape (n,).
        weight: Weights of the robots, in N, shape (n,).
        exponent: Exponent of the factor; 0 makes it 1.
    """
    return (1.0 + power / weight / HALF_POWER) ** -exponent


class GoalTask(Task):
    """Task of walking to a goal and standing there.

    See :class:`jansen_env.tasks.goal.goal_env.JansenGoalEnv`.
    """

    SETTINGS = GoalSettings
    OBSERVED = (Observed("goal_distance", "m", -np.inf, np.inf, EXACT),)
    INFO = {"goal": float, "distance": float, "held": float, "fallen": bool, "is_success": bool}
    TERMS = ("closeness", "arrival", "energy")
    OPTIONS = ("goal",)

    def __init__(self, settings: GoalSettings, threads: int | None = None) -> None:
        self.arrival_weight = settings.arrival_weight
        self._exponent = settings.energy_weight
        super().__init__(settings, threads)

    @override
    def draw(self, i: int, rng: np.random.Generator, options: Values) -> Numbers:
        """Sample the position of the goal, in m, unless an option of the reset sets it."""
        goal = uniform(rng, -FARTHEST, FARTHEST)
        return {"goal": option(options, "goal", goal, -FARTHEST, FARTHEST)}

    @override
    def _checks_of_state(self) -> dict[str, Check]:
        """Return checks of the values of :attr:`INFO` in a saved state."""
        return {
            **super()._checks_of_state(),
            "task.info.goal": partial(within, low=-FARTHEST, high=FARTHEST),
            "task.info.held": partial(within, low=0.0, high=MOST_SINGLE),
        }

    @override
    def frame(self, i: int) -> Frame:
        """Return the picture data of a robot as it is now, with its goal."""
        return replace(super().frame(i), goal=float(self.info["goal"][i]))

    @property
    def distance(self) -> Array:
        """Signed distance from each robot to its goal, in m, shape (n,); positive towards +x."""
        return self.info["goal"] - self.world.x_position

    @override
    def observe(self) -> Mapping[str, Array]:
        """Return the signed distance from each robot to its goal."""
        distance = self.distance
        self.keep(distance=distance)
        return {"goal_distance": distance}

    @override
    def reward(self) -> Array:
        """Return the reward for being near and standing at the goal, with little motor power."""
        distance = np.abs(self.distance)
        world = self.world
        near = distance <= NEAR
        held = np.where(near, self.info["held"] + self.control_dt, 0.0)
        self.keep(held=held, is_success=held >= HOLD - UP_TO)
        close = closeness(distance)
        arrival = arrived(distance, self.arrival_weight)
        saving = energy(np.abs(world.motor_power), world.weight, self._exponent)
        self.keep(closeness=close, arrival=arrival, energy=saving)
        return (close + arrival) * saving

    @override
    def terminated(self) -> Bools:
        """Return whether each robot has fallen, which ends the episode."""
        tipped = np.abs(self.world.pitch) > FALLEN_PITCH
        fallen = self.info["fallen"] | tipped | self.world.non_toe_contact
        self.keep(fallen=fallen)
        return fallen


class JansenGoalEnv(SingleEnv[GoalTask]):
    r"""Walk to a goal by the torque on one crank, and stand there.

    ## Description
    The robot and its surroundings are those of ``JansenWalkerBuilt-v0``. A goal lies up to 3 m away
    on either side. The robot must walk to the goal and stand within 2 cm of it. Legs carry the
    chassis unevenly: to stand at the goal, the motor must hold the crank at an angle from which the
    crank would turn away by itself.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a fraction of ``torque_limit`` (12 N m); a positive torque walks towards +x | -1 | 1 | 1 |

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 8 | crank, pitch, velocity and height of the crank axis, as in ``JansenWalker-v0`` | | | |
    | 9 | last action | -1 | 1 | 1 |
    | 10 .. 13 | normal load of each toe / weight | 0 | Inf | 1 |
    | 14 .. | with ``height_scan``: as in ``JansenWalker-v0`` | -Inf | Inf | m |
    | then | signed distance to the goal, positive towards +x; exact even with ``noise`` | -Inf | Inf | m |
    | last | with ``observe_lengths``: as in ``JansenWalker-v0`` | -Inf | Inf | 1 |

    ``env.unwrapped.observed`` contains the names of the numbers.

    ## Rewards
    The reward is (closeness + arrival) * energy. ``info`` contains each term:

    | Term | Value |
    |------|-------|
    | ``reward/closeness`` | 1 / (1 + \|distance\| / 0.3 m) |
    | ``reward/arrival`` | ``arrival_weight`` / (1 + (distance / 2 cm)^2) |
    | ``reward/energy`` | (1 + \|motor power\| / (weight * 0.5 m/s)) to the power -``energy_weight`` |

    ## Starting State
    The robot starts as in ``JansenWalkerBuilt-v0``. The position of the goal is uniform in +-3 m,
    unless you set it by ``reset(options={"goal": 1.5})``.

    ## Episode End
    An episode is terminated when the robot falls: \|pitch\| exceeds 1.2 rad, or a joint other than
    a toe touches the ground. It is truncated after 750 steps (15 s) if the environment was made
    with ``gym.make``.

    ## Information
    ``info`` contains ``goal`` and ``distance`` in m, ``held`` (the time in s for which the robot
    has been near the goal without interruption), ``is_success`` (whether this time is at least one
    second) and ``fallen``. Positions, torque, ``slip``, ``contact_force``, ``energy``,
    ``parameters`` and so on are those of ``JansenWalker-v0``. At a reset, the terms of the reward
    are 0.

    ## Arguments
    The arguments are ``energy_weight`` (1), ``arrival_weight`` (6), and those arguments of
    ``JansenWalker-v0`` that do not concern commands, its reward or falls. ``curriculum`` must be
    None.

    ## Version History
    * v0: first release.
    """

    TASK = GoalTask
    PRESET = {"robot": "built"}
    BENCHMARK = "jansen_env.tasks.goal.goal_benchmark:GOAL"

    def __init__(self, **arguments: Unpack[GoalArguments]) -> None:
        super().__init__(**arguments)


class GoalVectorArguments(VectorArguments, GoalArguments, total=False):
    """Arguments of :class:`JansenGoalVectorEnv`."""


class JansenGoalVectorEnv(TaskVectorEnv[GoalTask]):
    """Vector environment of many :class:`JansenGoalEnv` robots, made by ``gym.make_vec``."""

    SINGLE = JansenGoalEnv

    def __init__(self, num_envs: int = 1, **arguments: Unpack[GoalVectorArguments]) -> None:
        super().__init__(num_envs, **arguments)
