"""``JansenGoal-v0``: walk to a goal and stand there."""

from __future__ import annotations

from typing_extensions import Unpack

from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv, VectorArguments
from jansen_env.tasks.goal.goal_benchmark import GOAL
from jansen_env.tasks.goal.goal_task import GoalArguments, GoalTask


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
    | ``reward/arrival`` | ``arrival_weight`` within 2 cm of the goal, else 0 |
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
    ``energy_weight``, ``arrival_weight`` (1), and those of ``JansenWalker-v0`` that are not about commands,
    its reward and falls. ``curriculum`` must be None.

    ## Version History
    * v0: first release.
    """

    TASK = GoalTask
    PRESET = {"robot": "built"}
    BENCHMARK = GOAL

    def __init__(self, **arguments: Unpack[GoalArguments]) -> None:
        super().__init__(**arguments)


class GoalVectorArguments(VectorArguments, GoalArguments, total=False):
    """Arguments of :class:`JansenGoalVectorEnv`."""


class JansenGoalVectorEnv(TaskVectorEnv[GoalTask]):
    """:class:`JansenGoalEnv` for many robots at once: what ``gym.make_vec`` makes."""

    SINGLE = JansenGoalEnv

    def __init__(self, num_envs: int = 1, **arguments: Unpack[GoalVectorArguments]) -> None:
        super().__init__(num_envs, **arguments)
