"""Episodes side by side are what they are in new environments."""

import numpy as np
import pytest

import jansen_env
from jansen_env.policies.policy import TorquePolicy
from jansen_env.scoring.benchmarks import can_be_batched
from jansen_env.scoring.rollout import make_envs, run_episodes

ENV = "JansenWalkerBuilt-v0"
COMMANDS = np.array([0.2, 0.4])
SEEDS = np.array([3, 4])


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_used_environments_give_the_episodes_of_new_ones(plant):
    kwargs = {"plant": plant, "max_episode_steps": 5}
    policy = TorquePolicy(lambda seen, *_: (np.full(len(seen), 1.0), None), 2.0)
    options = {"crank_angle": np.array([0.3, 1.9])}
    once = run_episodes(policy, ENV, kwargs, COMMANDS, SEEDS, 2, options)
    envs = make_envs(ENV, kwargs, 2)
    for _ in range(2):
        again = run_episodes(policy, ENV, kwargs, COMMANDS, SEEDS, 2, options, envs)
        assert all((again[name] == once[name]).all() for name in once)
    assert once["distance"].all()


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"commands": []}, "commands"),
        ({"commands": 0.3}, "commands"),
        ({"options": [1]}, "options"),
        ({"drawn": True, "commands": [1.0]}, "drawn"),
        ({"env_kwargs": [1]}, "env_kwargs"),
    ],
)
def test_wrong_arguments_are_refused(given, named):
    with pytest.raises(ValueError, match=named):
        jansen_env.evaluate({}, "JansenCrank-v0", episodes=1, **given)


def test_robots_in_a_tuple_are_as_in_a_list():
    for robots in (["built", "economy"], ("built", "economy")):
        assert can_be_batched("JansenWalkerBuilt-v0", {"robot": robots})
