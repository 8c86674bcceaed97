"""Arguments of environments, for type checkers: the records of a task together, and whose they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypedDict

from gymnasium.vector import AutoresetMode
from typing_extensions import Unpack

from jansen_env.envs.vector import TaskVectorEnv
from jansen_env.tasks.crank import Tracking
from jansen_env.tasks.goal import GoalReward
from jansen_env.tasks.walking import Commands, RewardWeights, Termination
from jansen_env.world.held import HeldMachine
from jansen_env.world.settings import Control, Ground, Machine, Randomness, Sensing


class Shown(TypedDict, total=False):
    """Arguments of every single environment."""

    render_mode: str | None


class CrankArguments(Shown, HeldMachine, Tracking, total=False):
    """Arguments of ``JansenCrank-v0``."""


class FreeArguments(Shown, Machine, Control, Ground, Randomness, Sensing, total=False):
    """Arguments of all environments with robots on the ground."""


class GoalArguments(FreeArguments, GoalReward, total=False):
    """Arguments of ``JansenGoal-v0``."""


class WalkerArguments(FreeArguments, Commands, RewardWeights, Termination, total=False):
    """Arguments of ``JansenWalker-v0`` and its presets."""


class ManyArguments(WalkerArguments, GoalReward, Tracking, total=False):
    """Arguments of vector environments of any task; a task refuses those that it lacks."""

    max_episode_steps: int | Sequence[int | None] | None


if TYPE_CHECKING:

    class JansenVectorEnv(TaskVectorEnv[Any]):
        """Many robots, of any environment above."""

        def __init__(
            self,
            num_envs: int = 1,
            *,
            autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
            threads: int | None = None,
            info_keys: Sequence[str] | None = None,
            **own: Unpack[ManyArguments],
        ) -> None: ...
else:
    JansenVectorEnv = TaskVectorEnv
