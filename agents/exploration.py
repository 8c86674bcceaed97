"""Exploration that suits the commanded speed: a policy's noise grows with it.

A slow walk takes torques of 2 N m, a fast one of 10: noise that lets the fast ones improve would
throw the slow ones off.
"""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.type_aliases import PyTorchObs

from agents.observing import AsymmetricPolicy
from agents.walker_observation import COMMAND

SLOWEST, FASTEST = 0.03, 0.2  # m/s, between which the noise grows


class CommandNoisePolicy(AsymmetricPolicy):
    """PPO's Gaussian policy with the standard deviation std (|command| / 0.2 m/s)^p.

    Commands count from 0.03 to 0.2 m/s, slower and faster ones as these. std is learned, as it
    always is. What the policy does without noise is not touched.

    Args:
        noise_exponent: p, 0 for none of this. arguments, more: the policy's own.
    """

    def __init__(self, *arguments: Any, noise_exponent: float = 0.0, **more: Any) -> None:
        self.noise_exponent = noise_exponent
        super().__init__(*arguments, **more)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        """What a file of the policy alone keeps beside its weights."""
        return {**super()._get_constructor_parameters(), "noise_exponent": self.noise_exponent}

    def forward(
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Actions, values and log probabilities of the actions, for observations (n, d)."""
        distribution = self.get_distribution(obs)
        actions = distribution.get_actions(deterministic=deterministic)
        values = self.predict_values(obs)
        return actions.reshape((-1, 1)), values, distribution.log_prob(actions)

    def evaluate_actions(
        self, obs: PyTorchObs, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Values, log probabilities and entropies, of observations (n, d) and actions (n, 1)."""
        distribution = self.get_distribution(obs)
        return self.predict_values(obs), distribution.log_prob(actions), distribution.entropy()

    def get_distribution(self, obs: PyTorchObs) -> Distribution:
        """Of actions, for observations (n, d)."""
        assert isinstance(obs, torch.Tensor)
        distribution: Any = super().get_distribution(obs)
        mean, deviation = distribution.distribution.mean, distribution.distribution.stddev
        speed = obs[:, [COMMAND]].abs().clamp(SLOWEST, FASTEST) / FASTEST
        return distribution.proba_distribution(mean, (deviation * speed**self.noise_exponent).log())
