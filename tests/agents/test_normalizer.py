"""When the normalizer learns, from what, and what it makes of features that hardly vary."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from small_runs import small_run
from stable_baselines3.common.callbacks import BaseCallback, CallbackList

from agents.training import train_model as training
from agents.training.callbacks import NormalizerUpdate
from jansen_env import paper_robot
from jansen_env.robot.robot_file import write_robot
from jansen_env.sb3.run_config import make_config
from jansen_env.sb3.trained import CLIP, NormalizedObservation, half_turn_image
from jansen_env.scoring.rollout import make_envs


class Recorder(BaseCallback):
    """Check the normalizer's statistics where a rollout begins."""

    def __init__(self):
        super().__init__()
        self.seen = []
        self.rollouts = 0

    def _on_rollout_start(self):
        modules = self.model.policy.modules()
        (normalizer, *_) = (m for m in modules if isinstance(m, NormalizedObservation))
        assert normalizer.count.item() == sum(map(len, self.seen)) == self.rollouts * 32
        if self.seen:
            seen = np.concatenate(self.seen)
            assert normalizer.mean.numpy() == pytest.approx(seen.mean(0), rel=1e-4, abs=1e-6)
            assert normalizer.variance.numpy() == pytest.approx(seen.var(0), rel=1e-3, abs=1e-7)
        self.rollouts += 1

    def _on_step(self):
        self.seen.append(self.model._last_obs.copy())
        return True


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_normalizer_sees_whole_rollouts(algo):
    """At the start of each rollout it has seen all observations of earlier rollouts, and no
    others.
    """
    small = (
        {"n_steps": 8, "batch_size": 16, "n_epochs": 1}
        if algo == "ppo"
        else {"train_freq": 8, "batch_size": 16, "learning_starts": 0, "buffer_size": 48}
    )
    model = training.prepare(small_run(algo, hyperparameters=small, n_envs=4))
    recorder = Recorder()
    model.learn(4 * 32, callback=CallbackList([NormalizerUpdate(), recorder]))
    assert recorder.rollouts == 4


def test_features_that_do_not_vary_are_not_blown_up():
    """Features are unscaled before the first rollout; constant ones stay within the clip in
    float32.
    """
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
    """They stand beside the scaled observation, whatever its statistics, and repeat half a
    turn on.
    """
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


@pytest.mark.parametrize("kwargs", [{}, {"robot": "klann"}, {"observe": "onboard"}])
def test_half_a_turn_on_the_machine_is_the_same(kwargs):
    """Its observations are the mirror image, and its features are equal, whatever the
    statistics.
    """
    config = make_config({"env_kwargs": {**kwargs, "max_episode_steps": 1000}})
    image = half_turn_image(config)
    envs = make_envs(config.env, config.env_kwargs, 2)
    angles = np.array([0.3, 0.3 + np.pi])
    options = {"crank_angle": angles, "speed_command": np.full(2, 0.3)}
    seen = envs.reset(seed=[7, 7], options=options)[0]
    walked = []
    for action in np.random.default_rng(0).uniform(-0.2, 1.0, 40):
        np.testing.assert_allclose(seen[1], seen[0] @ image, atol=1e-4)
        walked.append(seen)
        seen = envs.step(np.full((2, 1), action, np.float32))[0]
    envs.close()
    assert np.ptp(walked, axis=0)[0].max() > 0.1
    box = gym.spaces.Box(-np.inf, np.inf, image.shape[:1])
    normalizer = NormalizedObservation(box, harmonics=2, image=image)
    first, second = torch.tensor(np.stack(walked, axis=1))
    normalizer.update(first[:20])
    assert torch.allclose(normalizer(first), normalizer(second), atol=1e-3)


def test_a_robot_that_is_another_after_half_a_turn_has_no_image(tmp_path):
    path = write_robot(tmp_path / "three_pins.json", paper_robot(3))
    image = half_turn_image(make_config({"env_kwargs": {"robot": str(path)}}))
    assert np.array_equal(image, np.eye(22))  # 6 toes
