"""Distributions of parameters by name, drawn at each reset."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import entries, shown
from jansen_env.parameters import LONGEST_DELAY, PARAMETERS, check


class Distribution(Protocol):
    """Protocol of what draws a number."""

    def sample(self, rng: np.random.Generator) -> float:
        """Draw a number with ``rng`` alone."""
        ...


class Uniform(NamedTuple):
    """A uniform distribution from ``low`` to ``high``, ``whole``: of whole numbers, with both."""

    low: float
    high: float
    whole: bool = False

    def sample(self, rng: np.random.Generator) -> float:
        """Draw a number."""
        if self.whole:
            return float(rng.integers(int(self.low), int(self.high), endpoint=True))
        return float(rng.uniform(self.low, self.high))


class Randomization:
    """Distributions from which parameters are drawn at each reset.

    Args:
        given: by name a number, (low, high) for a uniform draw (of whole numbers where the
            parameter is one), or a :class:`Distribution`; None for none.

    Attributes:
        distributions: by name, in the order of :data:`jansen_env.parameters.TABLE`.
        longest_delay: s, that may be drawn.

    Raises:
        ValueError: a name or a range that there is not.
    """

    def __init__(self, given: Any) -> None:
        given = {} if given is None else given
        if not isinstance(given, Mapping):
            raise ValueError(f"randomize is {shown(given)}, must map of {[*PARAMETERS]} to ranges")
        if unknown := sorted(map(str, {*given} - {*PARAMETERS})):
            raise ValueError(f"randomize has {unknown}, must be of {[*PARAMETERS]}")
        self.distributions = {
            name: _distribution(name, given[name]) for name in PARAMETERS if name in given
        }
        delay = self.distributions.get("delay", Uniform(0.0, 0.0))
        self.longest_delay = delay.high if isinstance(delay, Uniform) else LONGEST_DELAY

    def only(self, names: Collection[str]) -> Randomization:
        """Return the same for some parameters alone."""
        return Randomization({k: one for k, one in self.distributions.items() if k in names})

    def draw(self, rng: np.random.Generator, values: NDArray[Any]) -> None:
        """Draw into ``values``, a row of :data:`jansen_env.parameters.EPISODE`.

        Raises:
            ValueError: a distribution gave a number that its parameter cannot be.
        """
        for name, distribution in self.distributions.items():
            number = distribution.sample(rng)
            values[name] = check(f"a sample of randomize[{name!r}]", name, number)


def _distribution(name: str, value: Any) -> Distribution:
    if callable(getattr(value, "sample", None)):
        return value
    label = f"randomize[{name!r}]"
    pair: tuple[Any, ...] = (value, value)
    if isinstance(value, (tuple, list, np.ndarray)):
        pair = entries(label, value, "")
    elif isinstance(value, (str, bytes, Mapping)) or value is None:
        pair = ()
    if len(pair) != 2:
        raise ValueError(
            f"{label} is {shown(value)}, must be a number, (low, high) or have sample(rng)"
        )
    low, high = (check(label, name, one) for one in pair)
    if low > high:
        raise ValueError(f"{label} is {shown(value)}, must be (low, high) with low <= high")
    return Uniform(low, high, PARAMETERS[name].whole)
