"""One seed's search in a process of its own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from agents.design.design_plan import Plan
from agents.design.search import run_search
from jansen_env.baselines.policy import Policy
from jansen_env.scoring.rollout import make_env

if TYPE_CHECKING:
    from agents.studies.run import RunResult  # torch comes with it, which takes seconds to import


class SearchRequest(NamedTuple):
    """One seed's search in a process of its own."""

    name: str
    plan: Plan
    seed: int
    folder: Path
    cores: int


def execute_search(request: SearchRequest) -> RunResult:
    """Run a seed's search; errors are the result."""
    from agents.studies.run import RunResult

    os.environ["JANSEN_ENV_THREADS"] = str(request.cores)
    try:
        run_search(request.plan, request.seed, request.folder, load_policy(request.plan))
    except (OSError, ValueError) as error:
        return RunResult("failed", str(error))
    return RunResult("finished")


def load_policy(plan: Plan) -> Policy | None:
    """Return the policy that turns all cranks, None for profiles. Raises ValueError: no policy."""
    if plan.policy is None:
        return None
    from jansen_env.commands.named_policies import load_named

    return load_named(plan.policy, make_env(plan.env, {**plan.env_kwargs, "robot": plan.robot}))
