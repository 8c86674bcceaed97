"""One seed's search in a process of its own."""

from __future__ import annotations

import os
from pathlib import Path

from agents.design.design_plan import Plan
from agents.design.search import run_search
from jansen_env.baselines.policy import Policy
from jansen_env.scoring.rollout import make_env


def execute_search(plan: Plan, seed: int, folder: Path) -> None:
    """Run a seed's search on one core."""
    os.environ["JANSEN_ENV_THREADS"] = "1"
    run_search(plan, seed, folder, load_policy(plan))


def load_policy(plan: Plan) -> Policy | None:
    """Return the policy that turns all cranks, None for profiles. Raises ValueError: no policy."""
    if plan.policy is None:
        return None
    from jansen_env.commands.named_policies import load_named

    return load_named(plan.policy, make_env(plan.env, {**plan.env_kwargs, "robot": plan.robot}))
