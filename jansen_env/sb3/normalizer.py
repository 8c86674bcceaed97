"""Features made of observations inside the policy, so that one file holds all: scaled to zero mean
and unit variance, and harmonics of the crank angle beside them."""

from __future__ import annotations

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

CLIP = 10.0  # standard deviations
MIN_DEVIATION = 1e-3  # or what hardly varies would be blown up: to the clip, and by rounding


class NormalizedObservation(BaseFeaturesExtractor):
    """(observation - mean) / standard deviation, clipped; statistics are part of the state dict,
    and change only in :meth:`update`.

    Of observations that begin with cos and sin of the crank angle psi, ``harmonics`` many cos 2 k
    psi, sin 2 k psi are appended: the torque that is due repeats after half a turn of the crank.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor

    def __init__(self, observation_space: gym.spaces.Box, harmonics: int = 0) -> None:
        size = gym.spaces.utils.flatdim(observation_space)
        super().__init__(observation_space, size + 2 * harmonics)
        self.harmonics = harmonics
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.tensor(0.0))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return features (n, d + 2 m) of observations (n, d)."""
        observation = observation.flatten(1)
        deviation = torch.sqrt(self.variance).clamp(min=MIN_DEVIATION)
        scaled = torch.clamp((observation - self.mean) / deviation, -CLIP, CLIP)
        return torch.cat([scaled, *self._crank_harmonics(observation)], dim=1)

    def _crank_harmonics(self, observation: torch.Tensor) -> list[torch.Tensor]:
        """Return cos 2 psi, sin 2 psi, cos 4 psi, ... (n, 1) each, by adding angles."""
        cos, sin = observation[:, 0:1], observation[:, 1:2]
        cos_2, sin_2 = cos**2 - sin**2, 2.0 * sin * cos
        harmonics: list[torch.Tensor] = []
        cos, sin = torch.ones_like(cos), torch.zeros_like(sin)
        for _ in range(self.harmonics):
            cos, sin = cos * cos_2 - sin * sin_2, sin * cos_2 + cos * sin_2
            harmonics += [cos, sin]
        return harmonics

    @torch.no_grad()
    def update(self, observations: torch.Tensor) -> None:
        """Take (n, d) more observations into account (Chan's parallel variance)."""
        n = float(len(observations))
        total = self.count + n
        shift = observations.mean(0) - self.mean
        spread = self.variance * self.count + observations.var(0, unbiased=False) * n
        spread += shift**2 * self.count * n / total
        self.mean += shift * n / total
        self.variance.copy_(spread / total)
        self.count.copy_(total)
