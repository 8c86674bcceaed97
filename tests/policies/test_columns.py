"""An observation that is added, anywhere, moves none that a baseline or policy reads."""

import numpy as np
import pytest

from jansen_env.cli.named_policies import load_named
from jansen_env.policies import pretrained
from jansen_env.registration import IDS
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import make_env
from jansen_env.world.observations import Observed

ADDED = Observed("crank_torque", "N m", -np.inf, np.inf, "exact")


@pytest.fixture(params=IDS)
def world(request, monkeypatch):
    """An environment, what it observes in 30 steps, and how to show a number more at a column."""
    env = make_env(request.param, {})
    plain = env.unwrapped
    rng = np.random.default_rng(0)
    seen = [env.reset(seed=0)[0]]
    for _ in range(30):
        seen.append(env.step(rng.uniform(-1.0, 1.0, 1).astype(np.float32))[0])
    shown = list(plain.observed)

    def add(column):
        monkeypatch.setattr(plain, "observed", (*shown[:column], ADDED, *shown[column:]))
        return np.insert(np.array(seen), column, 99.0, axis=1)

    return env, np.array(seen), add


def acts(policy, seen):
    """Its actions on one observation after the other."""
    state = None
    actions = []
    for i, observation in enumerate(seen):
        action, state = policy.predict(observation[None], state, np.array([i == 0]), True)
        actions.append(action[0, 0])
    return actions


def _observed(env_id, name):
    """What a policy observes."""
    return pretrained.load(env_id, name).observed


def test_baselines_and_policies_find_their_columns(world):
    env, seen, add = world
    env_id = env.spec.id
    shown = {observed.name for observed in env.unwrapped.observed}
    fitting = [n for n in pretrained.names(env_id) if shown.issuperset(_observed(env_id, n))]
    assert pretrained.DEFAULT in fitting or not pretrained.names(env_id)
    names = [*find_benchmark(env_id).baselines, *(f"pretrained:{n}" for n in fitting)]
    expected = {name: acts(load_named(name, env), seen) for name in names}
    for column in (0, 9 % len(seen[0]), len(seen[0])):
        more = add(column)
        for name in names:
            assert acts(load_named(name, env), more) == expected[name], (name, column)
