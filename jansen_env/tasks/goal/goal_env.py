"""``JansenGoal-v0``: walk to a goal and stand there; plain NumPy over n robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import Unpack

from jansen_env.arrays import Array, Bools
from jansen_env.checks import MOST_SINGLE, non_negative, positive, within
from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv, VectorArguments
from jansen_env.rendering import Frame
from jansen_env.tasks.task import Task
from jansen_env.uniform import uniform
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import Values, WorldArguments, WorldSettings, option, shared
from jansen_env.world.world import Numbers

FARTHEST = 3.0  # m, a goal on either side
NEAR, HOLD = 0.02, 1.0  # m from the goal, where arrival is a half, and s there, that are a success
HALF_DISTANCE = 0.3  # m, at which closeness has fallen to a half
HALF_POWER = 0.5  # m/s: motor power / weight at which energy has fallen to a half
FALLEN_PITCH = 1.2  # rad
UP_TO = 1e-9  # of HOLD: periods do not add up to it exactly


class GoalArguments(WorldArguments, total=False):
    """Arguments of ``JansenGoal-v0``; :class:`GoalSettings` has their defaults and checks."""

    energy_weight: float
    arrival_weight: float


@dataclass(frozen=True, kw_only=True)
class GoalSettings(WorldSettings):
    """Arguments of ``JansenGoal-v0``: those of the world, and the reward's weights."""

    energy_weight: float = shared(1.0, non_negative)  # exponent of the energy's factor
    arrival_weight: float = shared(6.0, positive)  # with 1, closeness alone pays nearly as well


def closeness(distance: Array) -> Array:
    """1 at the goal, a half at :data:`HALF_DISTANCE`; distance: (n,) m, without its sign."""
    return 1.0 / (1.0 + distance / HALF_DISTANCE)


def arrived(distance: Array, worth: float) -> Array:
    """``worth`` at the goal, half of it at :data:`NEAR`; distance: (n,) m, without its sign."""
    return worth / (1.0 + (distance / NEAR) ** 2)


def energy(power: Array, weight: Array, exponent: float) -> Array:
    """1 without power; power: (n,) W, weight: (n,) N."""
    return (1.0 + power / weight / HALF_POWER) ** -exponent


class GoalTask(Task):
    """Walk to a goal and stand there; see :class:`jansen_env.tasks.goal.goal_env.JansenGoalEnv`."""

    SETTINGS = GoalSettings
    OBSERVED = (Observed("goal_distance", "m", -np.inf, np.inf, EXACT),)
    INFO = {"goal": float, "distance": float, "held": float, "fallen": bool, "is_success": bool}
    TERMS = ("closeness", "arrival", "energy")
    OPTIONS = ("goal",)

    def __init__(self, settings: GoalSettings, threads: int | None = None) -> None:
        self._arrival, self._exponent = settings.arrival_weight, settings.energy_weight
        super().__init__(settings, threads)

    def draw(self, i: int, rng: np.random.Generator, options: Values) -> Numbers:
        """Draw a goal, m."""
        goal = uniform(rng, -FARTHEST, FARTHEST)
        return {"goal": option(options, "goal", goal, -FARTHEST, FARTHEST)}

    def set_state(self, i: int, state: Values) -> None:
        """Go on from a complete state of ``get_state``; ValueError: an entry out of range."""
        within("state['goal']", state["goal"], -FARTHEST, FARTHEST)
        within("state['held']", state["held"], 0.0, MOST_SINGLE)
        super().set_state(i, state)

    def frame(self, i: int) -> Frame:
        """Return the picture data of a robot as it is now, with its goal."""
        return replace(super().frame(i), goal=float(self.info["goal"][i]))

    @property
    def distance(self) -> Array:
        """(n,) m, how far ahead the goals are."""
        return self.info["goal"] - self.world.x_position

    def observe(self) -> Mapping[str, Array]:
        """Show how far ahead the goal is."""
        distance = self.distance
        self.keep(distance=distance)
        return {"goal_distance": distance}

    def reward(self) -> Array:
        """Pay for being near, and for standing at the goal, at little power."""
        distance, world = np.abs(self.distance), self.world
        near = distance <= NEAR
        held = np.where(near, self.info["held"] + self.control_dt, 0.0)
        self.keep(held=held, is_success=held >= HOLD - UP_TO)
        close, arrival = closeness(distance), arrived(distance, self._arrival)
        saving = energy(np.abs(world.motor_power), world.weight, self._exponent)
        self.keep(closeness=close, arrival=arrival, energy=saving)
        return (close + arrival) * saving

    def terminated(self) -> Bools:
        """A fall ends the episode."""
        tipped = np.abs(self.world.pitch) > FALLEN_PITCH
        fallen = self.info["fallen"] | tipped | self.world.non_toe_contact
        self.keep(fallen=fallen)
        return fallen


class JansenGoalEnv(SingleEnv[GoalTask]):
    """Walk to a goal by the torque on one crank, and stand there.

    ## Description
    The machine and the world of ``JansenWalkerBuilt-v0``. A goal lies up to 3 m away on either side;
    the robot is to walk there and to stand within 2 cm of it. Legs carry it unevenly: to stand, the
    motor must hold the crank at an angle at which it does not want to be.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a share of ``torque_limit`` (12 N m); positive walks towards +x | -1 | 1 | 1 |

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 .. 8 | crank, pitch, velocity and height of the crank axis as of ``JansenWalker-v0`` | | | |
    | 9 | last action | -1 | 1 | 1 |
    | 10 .. 13 | normal load of each toe / weight | 0 | Inf | 1 |
    | 14 .. | with ``height_scan``: as of ``JansenWalker-v0`` | -Inf | Inf | m |
    | then | how far ahead the goal is, without error even with ``noise`` | -Inf | Inf | m |
    | last | with ``observe_lengths``: as of ``JansenWalker-v0`` | -Inf | Inf | 1 |

    By name: ``env.unwrapped.observed``.

    ## Rewards
    (closeness + arrival) * energy, each in ``info``:

    | Term | Value |
    |------|-------|
    | ``reward/closeness`` | 1 / (1 + \\|distance\\| / 0.3 m) |
    | ``reward/arrival`` | ``arrival_weight`` / (1 + (distance / 2 cm)^2) |
    | ``reward/energy`` | (1 + \\|motor power\\| / (weight * 0.5 m/s)) to the power -``energy_weight`` |

    ## Starting State
    As of ``JansenWalkerBuilt-v0``; the goal is uniform in +-3 m, or ``reset(options={"goal": 1.5})``.

    ## Episode End
    Terminated by a fall: \\|pitch\\| > 1.2 rad, or a joint other than a toe on the ground. Truncated
    after 750 steps (15 s) when made with ``gym.make``.

    ## Information
    ``goal`` and ``distance`` m, ``held`` s near the goal without a break, ``is_success``: for the last
    second, ``fallen``; positions, torque, ``slip``, ``contact_force``, ``energy``, ``parameters`` ... as
    of ``JansenWalker-v0``. At a reset the terms of the reward are 0.

    ## Arguments
    ``energy_weight`` (1), ``arrival_weight`` (6), and those of ``JansenWalker-v0`` that are not about commands,
    its reward and falls. ``curriculum`` must be None.

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
    """:class:`JansenGoalEnv` for many robots at once: what ``gym.make_vec`` makes."""

    SINGLE = JansenGoalEnv

    def __init__(self, num_envs: int = 1, **arguments: Unpack[GoalVectorArguments]) -> None:
        super().__init__(num_envs, **arguments)
