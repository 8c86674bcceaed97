"""Actions that mean something else than torques: by every door, and in a trained policy."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from small_runs import go_on, small_run

from agents import callbacks, config, vec_env
from agents.action_maps import (
    ACTION_MAPS,
    GAIN,
    SHARE,
    MappedAction,
    MappedPolicy,
    MappedVectorAction,
    make_map,
)
from agents.evaluate import load_named
from agents.policy import TorquePolicy
from agents.walker_baselines import BASELINES

ENV = "JansenWalker-v0"


class Wave:
    """A policy that depends on all it sees, beyond the limits at times."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return 1.5 * np.sin(3.0 * np.sum(observation, axis=-1, keepdims=True)), state


def test_target_crank_speed():
    """At 0.3 m/s, 0.66 m a turn, 2.9 rad/s; mirrored for a negative command."""
    env = gym.make(ENV).unwrapped
    apply = make_map("crank_speed", env)
    seen = np.zeros((5, 20), np.float32)
    seen[:, 2], seen[:, 9] = (3.0, 3.0, 3.0, 3.0, -3.0), (0.3, 0.3, 0.3, 0.0, -0.3)
    torque = 20.0 * apply(seen, np.array([[0.0], [0.5], [9.0], [1.0], [0.5]]))[:, 0]
    nominal = 2.0 * np.pi * 0.3 / 0.66
    expected = [GAIN * (nominal - 3.0), GAIN * (2.0 * nominal - 3.0), 20.0, GAIN * -3.0]
    assert torque[:4] == pytest.approx(expected, abs=0.2)
    assert torque[4] == -torque[1]


def test_residual_is_added_to_the_profile():
    """A share of the torque limit, and never beyond the limits."""
    env = gym.make(ENV).unwrapped
    seen = env.reset(seed=1, options={"speed_command": 0.3})[0][None]
    profile = BASELINES["profile"](env).predict(seen)[0]
    apply = make_map("residual", env)
    assert apply(seen, np.zeros((1, 1))) == profile
    assert apply(seen, np.ones((1, 1))) == pytest.approx(np.clip(profile + SHARE, -1, 1))
    assert apply(seen, np.full((1, 1), -9.0)) == pytest.approx(np.clip(profile - SHARE, -1, 1))


@pytest.mark.parametrize("name", ACTION_MAPS)
def test_every_door_has_the_same_actions(name):
    """One robot, many, Stable-Baselines3's many, and the policy itself mapped: bit for bit."""
    n, steps, policy = 3, 40, Wave()
    seeds, options = [5, 6, 7], {"speed_command": 0.25}
    raw = gym.make_vec(ENV, n, autoreset_mode=AutoresetMode.DISABLED)
    mapped = MappedPolicy(policy, make_map(name, raw))
    many = MappedVectorAction(gym.make_vec(ENV, n, autoreset_mode=AutoresetMode.DISABLED), name)
    ones = [MappedAction(gym.make(ENV), name) for _ in seeds]
    venv = vec_env.make_vec_env(ENV, n, {"speed_command": 0.25})
    venv = vec_env.with_actions(venv, name, ENV, {})
    venv.seed(5)
    seen = [
        raw.reset(seed=seeds, options=options)[0],
        many.reset(seed=seeds, options=options)[0],
        np.stack([e.reset(seed=s, options=options)[0] for e, s in zip(ones, seeds, strict=True)]),
    ]
    venv.reset()
    for _ in range(steps):
        assert np.array_equal(seen[0], seen[1]) and np.array_equal(seen[0], seen[2])
        actions = [policy.predict(each)[0] for each in seen]
        assert mapped.predict(seen[0][0])[0] == mapped.predict(seen[0])[0][0]
        seen = [
            raw.step(mapped.predict(seen[0])[0])[0],
            many.step(actions[1])[0],
            np.stack([env.step(a)[0] for env, a in zip(ones, actions[2], strict=True)]),
        ]
    last = venv.reset()
    torques = mapped.predict(last)[0]
    after = venv.step(policy.predict(last)[0])[0]
    assert after[:, -6] == pytest.approx(torques[:, 0])  # the action last taken
    assert vec_env.with_actions(venv, "torque", ENV, {}) is venv


def test_a_trained_policy_acts_on_the_environment_itself(tmp_path, monkeypatch):
    """Evaluated while it trains and loaded afterwards: the same walk."""
    monkeypatch.setattr(callbacks, "EPISODES", 1)
    scored, run = [], callbacks.run_episodes

    def noted(policy, *given):
        scored.append(policy)
        return run(policy, *given)

    monkeypatch.setattr(callbacks, "run_episodes", noted)
    settings = small_run(action="crank_speed", timesteps=96)
    go_on(settings, tmp_path)
    env = gym.make(ENV)
    policy = load_named(str(tmp_path / "final_model.zip"), env)
    seen = env.reset(seed=1, options={"speed_command": 0.3})[0]
    own = policy.policy.predict(seen, deterministic=True)[0]
    expected = make_map("crank_speed", env)(seen[None], own[None])[0]
    assert policy.predict(seen, deterministic=True)[0] == expected != own
    trained = [policy for policy in scored if not isinstance(policy, TorquePolicy)]  # no baseline
    assert trained and all(isinstance(policy, MappedPolicy) for policy in trained)


def test_what_cannot_be_is_refused():
    """A name that is none, and another environment."""
    with pytest.raises(ValueError, match=r"action is 'speed', must be one of \['crank_speed'"):
        make_map("speed", gym.make(ENV))
    settings = config.new_config(env_id="JansenCrank-v0")
    with pytest.raises(ValueError, match="action is 'residual', must be 'torque' for JansenCrank"):
        config.check_config({**settings, "action": "residual"})
