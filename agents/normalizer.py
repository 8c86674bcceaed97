"""Observations scaled to zero mean and unit variance inside the policy: one file holds all."""

from __future__ import annotations

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

CLIP = 10.0  # standard deviations
MIN_DEVIATION = 1e-3  # or what hardly varies would be blown up: to the clip, and by rounding


class NormalizedObservation(BaseFeaturesExtractor):
    """(observation - mean) / standard deviation, clipped; statistics are part of the state dict.

    They change only in :meth:`update`, so that within a rollout and the update on it the policy
    is one function of the observation. Before the first they leave observations as they are.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor

    def __init__(self, observation_space: gym.spaces.Box) -> None:
        size = gym.spaces.utils.flatdim(observation_space)
        super().__init__(observation_space, size)
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.tensor(0.0))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """(n, d) observations to (n, d) features."""
        deviation = torch.sqrt(self.variance).clamp(min=MIN_DEVIATION)
        scaled = (observation.flatten(1) - self.mean) / deviation
        return torch.clamp(scaled, -CLIP, CLIP)

    @torch.no_grad()
    def update(self, observations: torch.Tensor) -> None:
        """Take (n, d) more observations into account."""
        n = float(len(observations))
        self.merge(n, observations.mean(0), observations.var(0, unbiased=False))

    @torch.no_grad()
    def merge(self, n: float, mean: torch.Tensor, variance: torch.Tensor) -> None:
        """Take n more observations with (d,) mean and variance into account (Chan's formula)."""
        total = self.count + n
        shift = mean - self.mean
        spread = self.variance * self.count + variance * n
        spread += shift**2 * self.count * n / total
        self.mean += shift * n / total
        self.variance.copy_(spread / total)
        self.count.copy_(total)
