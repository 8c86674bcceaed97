"""Parts of a policy's network as callable data; exports to other languages read them.

Features map observations (n, d) to (n, size).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.layers import ELU, LINEAR, RELU, TANH, put_actions, put_harmonics

Array = NDArray[np.float64]

CRANK_ANGLE = ("cos_crank_angle", "sin_crank_angle")

ACTIVATIONS: dict[str | None, int] = {"tanh": TANH, "relu": RELU, "elu": ELU, None: LINEAR}
SQUASH = {"clip": LINEAR, "tanh": TANH}


@dataclass(frozen=True, eq=False)
class Plain:
    """Observations as they are; ``size``: how many numbers."""

    size: int

    def __call__(self, seen: Array) -> Array:
        return seen


@dataclass(frozen=True, eq=False)
class Normalized:
    """clip((observation - mean) / deviation, -clip, clip) with mean, deviation (size,)."""

    mean: Array
    deviation: Array
    clip: float

    @property
    def size(self) -> int:
        return len(self.mean)

    def __call__(self, seen: Array) -> Array:
        return np.clip((seen - self.mean) / self.deviation, -self.clip, self.clip)


@dataclass(frozen=True, eq=False)
class Harmonics:
    """cos k psi, sin k psi of each k of ``multiples``; psi is the crank angle, whose cosine and
    sine are the first two observations."""

    multiples: tuple[int, ...]

    @property
    def size(self) -> int:
        return 2 * len(self.multiples)

    def __call__(self, seen: Array) -> Array:
        out = np.empty((len(seen), self.size))
        put_harmonics(np.ascontiguousarray(seen[:, :2]), np.array(self.multiples, np.int64), out)
        return out


Features: TypeAlias = Plain | Normalized | Harmonics


@dataclass(frozen=True, eq=False)
class Layer:
    """activation(weight x + bias)."""

    weight: Array  # (units, inputs)
    bias: Array  # (units,)
    activation: str | None  # in ACTIVATIONS


class Network:
    """Layers as one function of inputs (n, width), the same alone and among others.

    Args:
        layers: at least one. limit: the most that the last may give. squash: one of :data:`SQUASH`.
    """

    def __init__(self, layers: Sequence[Layer], limit: float, squash: str) -> None:
        sizes = [(*layer.weight.T.shape, ACTIVATIONS[layer.activation]) for layer in layers]
        parts = [part for layer in layers for part in (layer.weight.T.ravel(), layer.bias)]
        self._layers, self._weights = np.array(sizes, np.int64), np.concatenate(parts)
        self._limit, self._squash, self._widest = limit, SQUASH[squash], self._layers[:, :2].max()

    def __call__(self, inputs: Array) -> Array:
        out, work = np.empty((len(inputs), self._layers[-1, 1])), np.empty((2, self._widest))
        put_actions(inputs, self._layers, self._weights, self._limit, self._squash, work, out)
        return out
