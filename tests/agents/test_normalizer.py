"""When the normalizer learns, from what, and what it makes of features that hardly vary."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from small_runs import small_run
from stable_baselines3.common.callbacks import BaseCallback, CallbackList

from agents.training import train_model as training
from agents.training.callbacks import NormalizerUpdate
from jansen_env.sb3.trained import CLIP, NormalizedObservation

N_ENVS, N_STEPS = 4, 8


class Recorder(BaseCallback):
    """Observations of each rollout, and the normalizer's statistics at its start and its end."""

    def __init__(self):
        super().__init__()
        self.seen, self.starts, self.ends = [], [], []

    def _statistics(self):
        normalizer = next(
            m for m in self.model.policy.modules() if isinstance(m, NormalizedObservation)
        )
        return {name: value.clone().numpy() for name, value in normalizer.state_dict().items()}

    def _on_rollout_start(self):
        self.starts.append(self._statistics())
        self.seen.append([])

    def _on_step(self):
        self.seen[-1].append(self.model._last_obs.copy())
        return True

    def _on_rollout_end(self):
        self.ends.append(self._statistics())


@pytest.fixture(params=["ppo", "sac"])
def recorded(request):
    """Four rollouts with the walker's configuration, made small."""
    small = (
        {"n_steps": N_STEPS, "batch_size": 16, "n_epochs": 1}
        if request.param == "ppo"
        else {"train_freq": N_STEPS, "batch_size": 16, "learning_starts": 0, "buffer_size": 48}
    )
    model = training.prepare(small_run(request.param, hyperparameters=small, n_envs=N_ENVS))
    recorder = Recorder()
    model.learn(4 * N_ENVS * N_STEPS, callback=CallbackList([NormalizerUpdate(), recorder]))
    assert len(recorder.seen) == 4
    return recorder


def test_normalizer_sees_whole_rollouts(recorded):
    """At each rollout's start it has seen all observations of those before, and no others."""
    for i, start in enumerate(recorded.starts):
        if i == 0:
            assert start["count"] == 0.0
            continue
        seen = np.concatenate([np.concatenate(rollout) for rollout in recorded.seen[:i]])
        assert start["count"] == len(seen) == i * N_ENVS * N_STEPS
        assert start["mean"] == pytest.approx(seen.mean(0), rel=1e-4, abs=1e-6)
        assert start["variance"] == pytest.approx(seen.var(0), rel=1e-3, abs=1e-7)


def test_features_that_do_not_vary_are_not_blown_up():
    """Unscaled before the first rollout; what is constant stays within the clip in float32."""
    normalizer = NormalizedObservation(gym.spaces.Box(-np.inf, np.inf, (2,)))
    first = torch.tensor([[0.3, 1.0], [0.3, -1.0]])
    assert torch.equal(normalizer(first), first)
    normalizer.update(first.repeat(500, 1))
    for _ in range(100):
        normalizer.update(first.repeat(7, 1))
    assert normalizer(first)[:, 0].abs().max() < 0.01  # no rounding becomes a signal
    off = torch.tensor([[0.301, 0.0]])
    assert normalizer(off)[0, 0] == pytest.approx(1.0, abs=0.01)
    assert normalizer(off + 1.0)[0, 0] == CLIP


def test_harmonics_are_of_the_crank_angle():
    """Beside the scaled observation, whatever its statistics; the same half a turn on."""
    normalizer = NormalizedObservation(gym.spaces.Box(-np.inf, np.inf, (3,)), harmonics=4)
    angle = np.linspace(-4.0, 4.0, 50)
    seen = torch.tensor(np.stack([np.cos(angle), np.sin(angle), angle], axis=1)).float()
    normalizer.update(5.0 + 2.0 * seen)
    features = normalizer(seen).numpy()
    assert features.shape == (50, normalizer.features_dim) == (50, 11)
    plain = NormalizedObservation(gym.spaces.Box(-np.inf, np.inf, (3,)))
    plain.load_state_dict(normalizer.state_dict())
    assert np.array_equal(features[:, :3], plain(seen).numpy())
    harmonics = [f(k * angle) for k in (2, 4, 6, 8) for f in (np.cos, np.sin)]
    np.testing.assert_allclose(features[:, 3:].T, harmonics, atol=1e-5)
    seen[:, :2] *= -1.0
    assert np.array_equal(normalizer(seen).numpy()[:, 3:], features[:, 3:])
