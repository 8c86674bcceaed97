"""The parts of a policy's network as data that can be called: :mod:`jansen_env.policies.pretrained`
puts them together, and whatever writes a policy in another language reads them.

Observations come as (n, d).
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
        """Return features (n, size)."""
        return seen


@dataclass(frozen=True, eq=False)
class Normalized:
    """clip((observation - mean) / deviation, -clip, clip).

    Args:
        mean, deviation: (size,). clip: in deviations.
    """

    mean: Array
    deviation: Array
    clip: float

    @property
    def size(self) -> int:
        """Number of features."""
        return len(self.mean)

    def __call__(self, seen: Array) -> Array:
        """Return features (n, size)."""
        return np.clip((seen - self.mean) / self.deviation, -self.clip, self.clip)


@dataclass(frozen=True, eq=False)
class Harmonics:
    """cos k psi, sin k psi of each k of ``multiples``; psi is the crank angle, whose cosine and
    sine are the first two observations."""

    multiples: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of features."""
        return 2 * len(self.multiples)

    def __call__(self, seen: Array) -> Array:
        """Return features (n, size)."""
        powers = (seen[:, :1] + 1j * seen[:, 1:2]) ** np.array(self.multiples, int)  # de Moivre
        return np.stack([powers.real, powers.imag], axis=-1).reshape(len(seen), -1)


Features: TypeAlias = Plain | Normalized | Harmonics


@dataclass(frozen=True, eq=False)
class Layer:
    """activation(weight x + bias).

    Args:
        weight: (units, inputs). bias: (units,). activation: in :data:`ACTIVATIONS`.
    """

    weight: Array
    bias: Array
    activation: str | None

    def __call__(self, values: Array) -> Array:
        """Return outputs (n, units) for inputs (n, inputs)."""
        return ACTIVATIONS[self.activation](values @ self.weight.T + self.bias)
