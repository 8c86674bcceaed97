"""The crank-speed profile: a controller that sets the crank speed as a function of the crank angle.

    n_ref(psi) = n0 exp(g lag + sum over k = 1 .. K of a_k cos 2 k psi + b_k sin 2 k psi)
    torque     = kp (n_ref - crank speed) + tau0

The profile contains only even harmonics: the two pairs of legs are on crank pins half a turn apart,
so all motions repeat twice per turn. The lag is the distance by which the target is ahead of the
robot. With the lag, the controller holds the mean speed. ``docs/profile.md`` describes how the
parameters were found.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import named_errors
from jansen_env.files import read_bounded
from jansen_env.policies.policy import Controlled, TorquePolicy, columns

DATA = Path(__file__).parent / "data" / "profile.json"

MAX_BYTES = 2**20  # largest size of a file
NUMBERS = ("n0", "kp", "tau0", "g")
"""The first parameters of a profile, in rad/s, N m s/rad, N m and 1/m.

The parameters a_1 .. a_K and b_1 .. b_K follow them.
"""
READ = ("cos_crank_angle", "sin_crank_angle", "crank_speed", "speed_command", "lag")
"""The observations that a profile reads."""


def profile_torque(numbers: Array, observation: Array, read: Sequence[int]) -> Array:
    """Return the torques of profiles for observations, in N m, shape (n,).

    For a negative command, the robot walks as the mirror image: the crank angle is pi - psi, and
    the crank speed, the torque and the lag are reversed.

    Args:
        numbers: Parameters of the profile of each robot, shape (n, 4 + 2 K).
        observation: Observations, shape (n, d).
        read: Indices of the observations in :data:`READ`.
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
    """Crank-speed profiles for a grid of commands, with linear interpolation between them.

    Below the slowest command, n0 and tau0 decrease in proportion to the command. Above the fastest
    command, n0 increases in proportion to it.

    Args:
        commands: Commands of the grid, in m/s, above 0 and increasing, shape (m,).
        numbers: Parameters of each command in the order of :data:`NUMBERS` and the harmonics, shape
            (m, 4 + 2 K).

    Raises:
        ValueError: If the shapes do not fit, if the commands are not above 0 and increasing, or if
            a parameter is not finite.
    """

    commands: Array
    numbers: Array

    def __post_init__(self) -> None:
        commands = np.asarray(self.commands, float)
        numbers = np.asarray(self.numbers, float)
        object.__setattr__(self, "commands", commands)
        object.__setattr__(self, "numbers", numbers)
        increases = commands.ndim == 1 and (np.diff(commands, prepend=0.0) > 0.0).all()
        if not increases or len(commands) == 0:
            raise ValueError(f"commands must be above 0 and increase, got {commands.tolist()}")
        shape = numbers.shape
        if len(shape) != 2 or shape[0] != len(commands) or shape[1] < 4 or shape[1] % 2:
            raise ValueError(f"numbers must have the shape ({len(commands)}, 4 + 2 K), got {shape}")
        if (wrong := numbers[~np.isfinite(numbers)]).size:
            raise ValueError(f"numbers must be finite, got {wrong[0]}")

    @cached_property
    def nodes(self) -> tuple[Array, Array]:
        """Commands and parameters of the grid, including those of the command 0.

        The commands have shape (m + 1,), the parameters have shape (m + 1, 4 + 2 K).
        """
        at_rest = self.numbers[0].copy()
        at_rest[[0, 2]] = 0.0
        return np.append(0.0, self.commands), np.vstack([at_rest, self.numbers])

    def at(self, command: Array) -> Array:
        """Return the interpolated parameters for commands, shape (n, 4 + 2 K).

        Args:
            command: Commands of either sign, in m/s, shape (n,).
        """
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
        """Return the torques for observations of walkers, in N m, shape (n,), before any limit.

        Args:
            observation: Observations, shape (n, d).
            read: Indices of the observations in :data:`READ`.
        """
        command = observation[:, read[READ.index("speed_command")]]
        return profile_torque(self.at(command), observation, read)

    def policy(self, env: Controlled) -> TorquePolicy:
        """Return the profile as a policy for an unwrapped walker. The policy has no state.

        Args:
            env: The walker.
        """
        read = columns(env, *READ)
        return TorquePolicy(lambda seen, *_: (self.torque(seen, read), None), env.torque_limit)


def load_profile(path: str | Path = DATA, robot: str = "paper") -> Profile:
    """Load the profile that a search has found for a design.

    Args:
        path: File with the results of a search. The default is the file of this package.
        robot: Name of the design.

    Raises:
        ValueError: If the file cannot be read, or does not contain such a profile.
    """
    with named_errors(f"no profile of {robot!r}", TypeError, KeyError, RecursionError):
        entry = json.loads(read_bounded(path, MAX_BYTES))[robot]
        return Profile(np.array(entry["commands"]), np.array(entry["numbers"]))
