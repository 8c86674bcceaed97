"""The crank-speed profile: how fast the crank is to turn at each of its angles, as a controller.

    n_ref(psi) = n0 exp(g lag + sum over k = 1 .. K of a_k cos 2 k psi + b_k sin 2 k psi)
    torque     = kp (n_ref - crank speed) + tau0

Even harmonics, as both pairs of legs are on crank pins half a turn apart: all repeats twice a turn.
The lag is the target's distance ahead of the robot: with it the mean speed is held. How the
numbers were found: ``docs/profile.md``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from jansen_env.arrays import Array
from jansen_env.baselines.policy import Controlled, TorquePolicy, columns
from jansen_env.checks import named_errors
from jansen_env.files import read_bounded

DATA = Path(__file__).parent / "data" / "profile.json"

MAX_BYTES = 2**20  # of a file
NUMBERS = ("n0", "kp", "tau0", "g")
"""The first numbers of a profile, in rad/s, N m s/rad, N m, 1/m; then a_1 .. a_K, b_1 .. b_K."""
READ = ("cos_crank_angle", "sin_crank_angle", "crank_speed", "speed_command", "lag")
"""The observations that a profile reads."""


def profile_torque(numbers: Array, observation: Array, read: Sequence[int]) -> Array:
    """Torques (n,), N m, of profiles (n, 4 + 2 K) for observations (n, d), columns ``read``.

    A negative command walks the mirror image: crank angle pi - psi, speed, torque and lag reversed.
    """
    cos, sin, rate, command, lag = (observation[:, column] for column in read)
    sign = np.where(command < 0.0, -1.0, 1.0)
    speed, gain, bias, feedback = numbers[:, :4].T
    a, b = np.split(numbers[:, 4:], 2, axis=1)
    turn = (sign * cos + 1j * sin) ** 2
    harmonics = np.cumprod(np.repeat(turn[:, None], a.shape[1], axis=1), axis=1)  # exp(2 i k psi)
    shape = (a * harmonics.real + b * harmonics.imag).sum(axis=1)
    wanted = speed * np.exp(shape + feedback * sign * lag)
    return sign * (gain * (wanted - sign * rate) + bias)


@dataclass(frozen=True)
class Profile:
    """Profiles at a grid of commands, interpolated linearly in between.

    Below the slowest, n0 and tau0 fall in proportion to the command; beyond the fastest, n0 rises.

    Args:
        commands: (m,) m/s, above 0, increasing.
        numbers: (m, 4 + 2 K), in the order of :data:`NUMBERS` and the harmonics.

    Raises:
        ValueError: the shapes do not fit, or the commands do not increase from above 0.
    """

    commands: Array
    numbers: Array

    def __post_init__(self) -> None:
        commands, numbers = np.asarray(self.commands, float), np.asarray(self.numbers, float)
        object.__setattr__(self, "commands", commands)
        object.__setattr__(self, "numbers", numbers)
        increases = commands.ndim == 1 and (np.diff(commands, prepend=0.0) > 0.0).all()
        if not increases or len(commands) == 0:
            raise ValueError(f"commands is {commands.tolist()}, must increase from above 0")
        shape = numbers.shape
        if len(shape) != 2 or shape[0] != len(commands) or shape[1] < 4 or shape[1] % 2:
            raise ValueError(f"numbers has the shape {shape}, must be {len(commands), '4 + 2 K'}")
        if not np.isfinite(numbers).all():
            raise ValueError("numbers has entries that are not finite")

    @cached_property
    def nodes(self) -> tuple[Array, Array]:
        """Commands (m + 1,) and numbers (m + 1, 4 + 2 K), with those at 0."""
        at_rest = self.numbers[0].copy()
        at_rest[[0, 2]] = 0.0
        return np.append(0.0, self.commands), np.vstack([at_rest, self.numbers])

    def at(self, command: Array) -> Array:
        """The numbers (n, 4 + 2 K) for commands (n,), m/s, of either sign."""
        commands, numbers = self.nodes
        size = np.abs(command)
        inside = np.minimum(size, commands[-1])
        right = np.clip(np.searchsorted(commands, inside), 1, len(commands) - 1)
        left = right - 1
        share = ((inside - commands[left]) / (commands[right] - commands[left]))[:, None]
        between: Array = (1.0 - share) * numbers[left] + share * numbers[right]
        between[:, 0] *= np.maximum(size / commands[-1], 1.0)
        return between

    def torque(self, observation: Array, read: Sequence[int]) -> Array:
        """Torques (n,), N m, for observations (n, d) of a walker; before any limit."""
        command = observation[:, read[READ.index("speed_command")]]
        return profile_torque(self.at(command), observation, read)

    def policy(self, env: Controlled) -> TorquePolicy:
        """Return its stateless policy for an unwrapped walker."""
        read = columns(env, *READ)
        return TorquePolicy(lambda seen, *_: (self.torque(seen, read), None), env.torque_limit)


def load_profile(path: str | Path = DATA, robot: str = "paper") -> Profile:
    """The profile found for a design, in a file of a search; default: the shipped one.

    Raises:
        ValueError: the file cannot be read, or has no such profile.
    """
    with named_errors(f"no profile of {robot!r}", TypeError, KeyError, RecursionError):
        entry = json.loads(read_bounded(path, MAX_BYTES))[robot]
        return Profile(np.array(entry["commands"]), np.array(entry["numbers"]))
