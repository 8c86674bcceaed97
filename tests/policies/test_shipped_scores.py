"""Scores of the policies that come with the package, again."""

import math

import numpy as np
import pytest

from agents import pack
from jansen_env.policies import pretrained
from jansen_env.scoring.benchmarks import BENCHMARKS
from jansen_env.scoring.metrics import point_estimates
from jansen_env.scoring.rollout import make_env

SHIPPED = [(env_id, name) for env_id in BENCHMARKS for name in pretrained.names(env_id)]
CRANK = "JansenCrank-v0"
COMPARED = sum(len(BENCHMARKS[env_id].metrics) for env_id, _ in SHIPPED)
"""How many numbers :func:`test_scores_are_those_shipped` compares."""
LIMIT = math.sqrt(2.0 * math.log(2.0 * COMPARED / 1e-6))
"""Of :func:`surprises`: one false alarm in 1e6 runs of all these tests.

Contacts are chaotic, so that another processor's rounding makes another episode of the same start.
It might as well have been the one that was shipped: the difference d of the two is as likely +d as
-d. Then P(|sum d| > z sqrt(sum d^2)) <= 2 exp(-z^2 / 2), whatever the distribution (Hoeffding
1963), and the sum of that over COMPARED numbers is 1e-6. A ratio of sums is compared by the
numerator less the common ratio times the denominator, which no exchange within a pair changes.
"""


def surprises(env_id, run, other):
    """Of each metric |sum d| / sqrt(sum d^2), d the difference of an episode in two runs."""
    env, found = make_env(env_id, {}), {}
    for name, metric in BENCHMARKS[env_id].metrics.items():
        one, two = (metric.function(each, env) for each in (run, other))
        if metric.normaliser is not None:
            lengths = [metric.normaliser(each, env) for each in (run, other)]
            ratio = np.sum([one, two]) / np.sum(lengths)
            one, two = (v - ratio * length for v, length in zip((one, two), lengths, strict=True))
        size = math.sqrt(((one - two) ** 2).sum())
        found[name] = abs((one - two).sum()) / size if size > 0.0 else 0.0
    return found


def by_episode(scores):
    return {name: np.array(values) for name, values in scores["by_episode"].items()}


@pytest.mark.parametrize(("env_id", "name"), SHIPPED)
def test_scores_are_those_shipped(env_id, name):
    policy = pretrained.load(env_id, name)
    shipped = policy.description["scores"]
    again = pack.scores_of(policy, shipped["episodes_per_command"], shipped["seed"])
    metrics = BENCHMARKS[env_id].metrics
    assert set(again["overall"]) == set(shipped["overall"]) == set(metrics)
    run, env = by_episode(shipped), make_env(env_id, {})
    for metric, value in point_estimates(metrics, run, env).items():
        assert value == pytest.approx(shipped["overall"][metric][0], rel=1e-4), metric
    for metric, surprise in surprises(env_id, run, by_episode(again)).items():
        one, two = (scores["overall"][metric][0] for scores in (shipped, again))
        chance = surprise <= LIMIT and env_id != CRANK
        assert chance or two == pytest.approx(one, rel=1e-4), (metric, surprise)


@pytest.mark.parametrize("env_id", [CRANK, "JansenWalker-v0"])
def test_scores_of_another_policy_differ(env_id):
    policy = pretrained.load(env_id)
    shipped = policy.description["scores"]
    tensors = {name: tensor.copy() for name, tensor in policy.tensors.items()}
    tensors[policy.description["network"]["layers"][-1]["weight"]] *= 0.9
    changed = pretrained.PretrainedPolicy(policy.description, tensors)
    other = pack.scores_of(changed, shipped["episodes_per_command"], shipped["seed"])
    if env_id == CRANK:
        for metric in ("return", "rms_error"):
            one, two = (scores["overall"][metric][0] for scores in (shipped, other))
            assert abs(one / two - 1.0) > 1e-4
    else:
        found = surprises(env_id, by_episode(shipped), by_episode(other))
        assert max(found.values()) > LIMIT, found
