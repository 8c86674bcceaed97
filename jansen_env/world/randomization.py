"""Distributions of parameters by name, drawn at each reset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np

from jansen_env.checks import entries, listed, shown, within
from jansen_env.parameters import PARAMETERS, SCALE, check
from jansen_env.uniform import uniform
from jansen_env.world.argument_checks import Values, number_range


@runtime_checkable
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
        return float(uniform(rng, self.low, self.high))


Randomization: TypeAlias = dict[str, Distribution]
"""Distributions of parameters by name, in the order of :data:`jansen_env.parameters.TABLE`."""

EVERY = "*"  # stands for all lengths
WIDEST = 0.9  # by which a length may be shorter


def load_randomization(name: str, value: object, parameters: Iterable[str] | None = None) -> Values:
    """Return the distributions of ``randomize``: a :data:`Randomization`, and "lengths".

    ``value``: by name a number, (low, high) for a uniform draw (of whole numbers where the
    parameter is one), or a :class:`Distribution`; None for none. "lengths" are factors by length,
    or of all; a number s stands for (1 - s, 1 + s). ``parameters``: allowed names; None for all.

    Raises:
        ValueError: an unknown name or invalid range.
    """
    given = {} if value is None else value
    if not isinstance(given, Mapping):
        raise ValueError(f"{name} is {shown(given)}, must map of {[*PARAMETERS]} to ranges")
    parameters = [*(PARAMETERS if parameters is None else parameters)]
    known = [*parameters, "lengths"]
    if unknown := sorted(map(str, {*given} - {*known})):
        raise ValueError(f"{name} has {unknown}, must be of {listed(known, unknown[0])}")
    drawn: Values = {k: _distribution(k, given[k]) for k in parameters if k in given}
    if "lengths" in given:
        given_factors = given["lengths"]
        factors = given_factors if isinstance(given_factors, Mapping) else {EVERY: given_factors}
        drawn["lengths"] = {str(name): _factor(str(name), f) for name, f in factors.items()}
    return drawn


def _factor(name: str, value: object) -> Distribution:
    if isinstance(value, Distribution):
        return value
    label = "randomize['lengths']" + ("" if name == EVERY else f"[{name!r}]")
    if isinstance(value, (tuple, list, np.ndarray)):
        return Uniform(*number_range(label, value, *SCALE))
    spread = within(label, value, 0.0, WIDEST)
    return Uniform(1.0 - spread, 1.0 + spread)


def _distribution(name: str, value: object) -> Distribution:
    if isinstance(value, Distribution):
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
    low, high = (check(label, name, number) for number in pair)
    if low > high:
        raise ValueError(f"{label} is {shown(value)}, must be (low, high) with low <= high")
    return Uniform(low, high, PARAMETERS[name].whole)
