"""On rough ground the return mostly ranks controllers as the success rate does."""

from itertools import combinations

import numpy as np
import pytest

from jansen_env.cli.named_policies import load_named
from jansen_env.policies import pretrained
from jansen_env.scoring.rollout import draw_episodes, make_env, run_episodes

ROUGH, HARDCORE, BUILT = (f"JansenWalker{name}-v0" for name in ("Rough", "Hardcore", "Built"))
CONTROLLERS = ("pid", "profile")
POLICIES = ((BUILT, "ppo"), (BUILT, "robust"), (ROUGH, "ppo"), (HARDCORE, "ppo"))
EPISODES = 150


@pytest.mark.slow
@pytest.mark.parametrize("env_id", [ROUGH, HARDCORE])
def test_the_return_ranks_as_success_does(env_id):
    """At least five in six of the pairs that differ in success by two standard errors agree."""
    env = make_env(env_id, {})
    policies = {name: load_named(name, env) for name in CONTROLLERS}
    policies |= {name: pretrained.load(*name).on(env) for name in POLICIES}
    commands, seeds = draw_episodes(env, EPISODES, seed=3)
    returns = {}
    success = {}
    for name, policy in policies.items():
        run = run_episodes(policy, env_id, {}, commands, seeds)
        returns[name] = run["returns"].mean()
        success[name] = run["success"].mean()
    differ = []
    alike = []
    for one, other in combinations(policies, 2):
        mean = (success[one] + success[other]) / 2.0
        error = np.sqrt(2.0 * mean * (1.0 - mean) / EPISODES)
        if abs(success[one] - success[other]) > 2.0 * error:
            differ.append((one, other))
            if (returns[one] > returns[other]) == (success[one] > success[other]):
                alike.append((one, other))
    print(f"{len(alike)} of {len(differ)} pairs are ordered alike", returns, success)
    assert len(differ) >= 6 and len(alike) >= 5 / 6 * len(differ), {*differ} - {*alike}
