"""Parts of a policy's network as callable data; exports to other languages read them.

Features map observations (n, d) to (n, size).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CRANK_ANGLE = ("cos_crank_angle", "sin_crank_angle")

ACTIVATIONS: dict[str | None, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    None: lambda x: x,
}
SQUASH: dict[str, Callable[[Array], Array]] = {"clip": lambda x: x, "tanh": np.tanh}


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
        powers = (seen[:, :1] + 1j * seen[:, 1:2]) ** np.array(self.multiples, int)  # de Moivre
        return np.stack([powers.real, powers.imag], axis=-1).reshape(len(seen), -1)


Features: TypeAlias = Plain | Normalized | Harmonics


@dataclass(frozen=True, eq=False)
class Layer:
    """activation(weight x + bias)."""

    weight: Array  # (units, inputs)
    bias: Array  # (units,)
    activation: str | None  # in ACTIVATIONS

    def __call__(self, values: Array) -> Array:
        return ACTIVATIONS[self.activation](values @ self.weight.T + self.bias)
