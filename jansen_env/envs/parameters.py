"""What may differ from episode to episode: names, limits, distributions, and how it is drawn."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import entries, shown, within
from jansen_env.plants.variation import RANGES
from jansen_env.terrain_generators import HIGHEST

Array = NDArray[np.float64]

LONGEST_DELAY = 1.0  # s, of an action


class Parameter(NamedTuple):
    """A number of an episode: the least and the most it may be, its unit, what it is."""

    least: float
    most: float
    unit: str
    meaning: str


MEANING = {
    "friction": ("1", "Coulomb coefficient between toes and ground"),
    "restitution": ("1", "Newton's coefficient between toes and ground"),
    "payload": ("kg", "mass of the payload"),
    "payload_x": ("m", "its place ahead of the crank axis"),
    "payload_y": ("m", "and above it"),
    "mass_scale": ("1", "times the links' masses and inertias"),
    "inertia_scale": ("1", "times the links' inertias about their own centres, on top"),
    "damping_scale": ("1", "times the joints' viscous damping"),
    "foot_stiffness_scale": ("1", "times the stiffness of feet that give"),
    "foot_damping_scale": ("1", "times their damping"),
    "motor_strength": ("1", "times the torque of an action, and what limits the motor's"),
    "rotor_inertia_scale": ("1", "times the inertia of the motor's rotor"),
    "tilt": ("rad", "by which the floor, in truth gravity, rises towards +x"),
    "delay": ("s", "by which torques come late"),
    "noise_level": ("1", "times the sensors' noise"),
    "push_strength": ("1", "times the impulses of random pushes"),
    "terrain_level": ("1", "of the ground, a whole number"),
}
LIMITS = {
    **RANGES,
    "delay": (0.0, LONGEST_DELAY),
    "noise_level": (0.0, 1e3),
    "push_strength": (0.0, 1e3),
    "terrain_level": (0.0, HIGHEST),
}
PARAMETERS = {name: Parameter(*LIMITS[name], *MEANING[name]) for name in MEANING}
"""By name; the order is that in which they are drawn."""

EPISODE = np.dtype([(name, "f8") for name in PARAMETERS])
"""The numbers of one episode."""


class Distribution(Protocol):
    """Anything that draws a number."""

    def sample(self, rng: np.random.Generator) -> float:
        """A number, drawn with ``rng`` alone."""
        ...


class Uniform(NamedTuple):
    """A uniform distribution from ``low`` to ``high``."""

    low: float
    high: float

    def sample(self, rng: np.random.Generator) -> float:
        """A number."""
        return float(rng.uniform(self.low, self.high))


class UniformLevels(NamedTuple):
    """The whole numbers from ``low`` to ``high``, each as likely."""

    low: float
    high: float

    def sample(self, rng: np.random.Generator) -> float:
        """One of them."""
        return float(rng.integers(int(self.low), int(self.high), endpoint=True))


def check(label: str, name: str, value: Any) -> float:
    """A value of a parameter. Raises ValueError: out of its limits; the message calls it ``label``."""
    limits = PARAMETERS[name]
    number = within(label, value, limits.least, limits.most)
    if name == "terrain_level" and number != round(number):
        raise ValueError(f"{label} is {shown(value)}, must be a whole number up to {HIGHEST}")
    return number


class Randomization:
    """What is drawn anew for each episode.

    Args:
        given: by name a number, (low, high) for a uniform draw (of whole numbers, both ends
            included, where it is ``terrain_level``), or a :class:`Distribution`.

    Attributes:
        distributions: by name, in the order of :data:`PARAMETERS`.

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
        """The same for some parameters alone."""
        kept = Randomization(None)
        kept.longest_delay = self.longest_delay
        kept.distributions = {
            name: one for name, one in self.distributions.items() if name in names
        }
        return kept

    def draw(self, rng: np.random.Generator, values: NDArray[Any]) -> None:
        """Draw into ``values``, a row of :data:`EPISODE`.

        Raises:
            ValueError: a distribution gave what its parameter cannot be.
        """
        for name, distribution in self.distributions.items():
            number = distribution.sample(rng)
            values[name] = check(f"a sample of randomize[{name!r}]", name, number)


def _distribution(name: str, value: Any) -> Distribution:
    """What draws a parameter."""
    if callable(getattr(value, "sample", None)):
        found: Distribution = value
        return found
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
    if math.isinf(high):
        raise ValueError(f"{label} is {shown(value)}, must be finite")
    return UniformLevels(low, high) if name == "terrain_level" else Uniform(low, high)
