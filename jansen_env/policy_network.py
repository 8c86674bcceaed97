"""The parts of a policy's network as data that can be called: :mod:`jansen_env.pretrained` puts
them together, and whatever writes a policy in another language reads them.

Observations come as (n, d), with a history as (n, length d), the present one first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import entries, positive_single, shown, single
from jansen_env.crank_profile import CrankProfile, crank_torque

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
        """(n, size) features."""
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
        """How many numbers."""
        return len(self.mean)

    def __call__(self, seen: Array) -> Array:
        """(n, size) features."""
        return np.clip((seen - self.mean) / self.deviation, -self.clip, self.clip)


@dataclass(frozen=True, eq=False)
class Harmonics:
    """cos k psi, sin k psi of each k of ``multiples``; psi is the crank angle, whose cosine and
    sine are the first two observations."""

    multiples: tuple[int, ...]

    @property
    def size(self) -> int:
        """How many numbers."""
        return 2 * len(self.multiples)

    def __call__(self, seen: Array) -> Array:
        """(n, size) features."""
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
        """(n, inputs) to (n, units)."""
        return ACTIVATIONS[self.activation](values @ self.weight.T + self.bias)


@dataclass(frozen=True)
class CrankSpeedAction:
    """Actions as target crank speeds: n_target = n_command span^action, torque = gain (n_target -
    n), n_command = ``per_metre`` times the commanded speed.

    Args:
        command, crank_speed: where they are in an observation. per_metre: rad/m. span: by how much
            an action of 1 hurries the crank; -1 slows it down as much. gain: N m s/rad.
        torque_limit: N m.
    """

    command: int
    crank_speed: int
    per_metre: float
    span: float
    gain: float
    torque_limit: float

    def describe(self) -> dict[str, Any]:
        """As in a policy's file."""
        names = ("per_metre", "span", "gain")
        return {"kind": "crank_speed", **{name: getattr(self, name) for name in names}}

    def __call__(self, observation: Any, action: Any) -> NDArray[np.float32]:
        """Shares of the torque limit (n, 1) for observations (n, d) and a policy's actions (n, 1),
        computed in float64."""
        seen, own = np.asarray(observation, float), np.clip(np.asarray(action, float), -1.0, 1.0)
        target = seen[:, [self.command]] * self.per_metre * self.span**own
        torque = self.gain * (target - seen[:, [self.crank_speed]])
        return np.clip(torque / self.torque_limit, -1.0, 1.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class ResidualAction:
    """Actions as what is added to the torque of a crank-speed profile.

    Args:
        places: of the crank angle's cosine and sine, the crank speed, the commanded speed and the
            lag in an observation. profile: see :class:`jansen_env.crank_profile.CrankProfile`.
        share: of the torque limit, what an action of 1 adds. torque_limit: N m.
    """

    places: tuple[int, int, int, int, int]
    profile: CrankProfile
    share: float
    torque_limit: float

    def describe(self) -> dict[str, Any]:
        """As in a policy's file."""
        commands, numbers = self.profile.commands.tolist(), self.profile.numbers.tolist()
        return {"kind": "residual", "share": self.share, "commands": commands, "numbers": numbers}

    def __call__(self, observation: Any, action: Any) -> NDArray[np.float32]:
        """Shares of the torque limit (n, 1) for observations (n, d) and a policy's actions (n, 1),
        computed in float64."""
        seen, own = np.asarray(observation, float), np.clip(np.asarray(action, float), -1.0, 1.0)
        cos, sin, speed, command, lag = (seen[:, place] for place in self.places)
        torque = crank_torque(self.profile.at(command), cos, sin, speed, command, lag)
        base = np.clip(torque / self.torque_limit, -1.0, 1.0)[:, None]
        return np.clip(base + self.share * own, -1.0, 1.0).astype(np.float32)


TorqueMap: TypeAlias = CrankSpeedAction | ResidualAction

SEEN_BY = {
    "crank_speed": ("speed_command", "crank_speed"),
    "residual": (*CRANK_ANGLE, "crank_speed", "speed_command", "lag"),
}
"""What each meaning of actions goes by, of what is observed."""


def read_action(
    entry: Mapping[str, Any], observed: Sequence[str], torque_limit: float
) -> TorqueMap:
    """What actions mean, from what ``describe`` gives.

    Args:
        observed: names of what is observed, in order. torque_limit: N m.

    Raises:
        ValueError: an entry is missing or not allowed, a number is beyond float32, or something is
            not observed.
    """
    kind = entry.get("kind")
    if not isinstance(kind, str) or kind not in SEEN_BY:
        raise ValueError(f"kind of map is {shown(kind)}, must be one of {sorted(SEEN_BY)}")
    if missing := [name for name in SEEN_BY[kind] if name not in observed]:
        raise ValueError(f"map {kind!r} takes {missing}, which are not observed")
    places: Any = tuple(observed.index(name) for name in SEEN_BY[kind])
    if kind == "crank_speed":
        per_metre, gain = (single(name, entry.get(name)) for name in ("per_metre", "gain"))
        span = positive_single("span", entry.get("span"))
        return CrankSpeedAction(places[0], places[1], per_metre, span, gain, torque_limit)
    numbers = [
        [single("a number of the profile", number) for number in entries("numbers", row, "lists")]
        for row in entries("numbers", entry.get("numbers"), "lists")
    ]
    if len({len(row) for row in numbers}) > 1:
        raise ValueError("rows of numbers have different lengths, must have one")
    commands = entries("commands", entry.get("commands"), "a list")
    profile = CrankProfile(
        np.array([single("a command", command) for command in commands]), np.array(numbers)
    )
    if not (np.diff(profile.commands.astype(np.float32)) > 0.0).all():
        raise ValueError(f"commands is {shown(commands)}, must increase as float32, too")
    return ResidualAction(places, profile, single("share", entry.get("share")), torque_limit)
