"""The crank-speed profile as a controller: :mod:`jansen_env.crank_profile` has its formula.

Its numbers are found by ``python -m agents.tune profile`` (:mod:`agents.profile_search`).
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from agents.policy import Array, TorquePolicy
from agents.walker_observation import COMMAND, COS_CRANK, CRANK_SPEED, LAG, SIN_CRANK
from jansen_env.checks import positive
from jansen_env.crank_profile import NUMBERS, CrankProfile, crank_torque

DATA = Path(__file__).parent / "data" / "profile.json"


def columns(harmonics: int) -> tuple[str, ...]:
    """The names of a profile's numbers."""
    shape = [f"{letter}{k}" for letter in "ab" for k in range(1, harmonics + 1)]
    return (*NUMBERS, *shape)


def profile_torque(numbers: Array, observation: Array, lag: int = LAG) -> Array:
    """Torques (n,), N m, of profiles (n, 4 + 2 K) for observations (n, d), one each.

    ``lag``: where the lag is in an observation. See :func:`jansen_env.crank_profile.crank_torque`.
    """
    places = (COS_CRANK, SIN_CRANK, CRANK_SPEED, COMMAND, lag)
    return crank_torque(numbers, *(observation[:, place] for place in places))


class Profile(CrankProfile):
    """:class:`jansen_env.crank_profile.CrankProfile` for observations of a walker."""

    def torque(self, observation: Array, lag: int = LAG) -> Array:
        """Torques (n,), N m, for observations (n, d) of a walker; before any limit.

        ``lag``: where the lag is in an observation.
        """
        return profile_torque(self.at(observation[:, COMMAND]), observation, lag)

    def policy(self, torque_limit: float, lag: int = LAG) -> TorquePolicy:
        """Its stateless policy; ``torque_limit``: of the environment, N m; ``lag``: its place."""
        limit = positive("torque_limit", torque_limit)
        return TorquePolicy(lambda observation, *_: (self.torque(observation, lag), None), limit)


def load_profile(path: str | Path = DATA, robot: str = "paper") -> Profile:
    """The profile found for a design, in a file that the search wrote; by default the shipped one.

    Raises:
        OSError, ValueError, KeyError: there is none, or it is damaged.
    """
    found = json.loads(Path(path).read_text(encoding="utf-8"))[robot]
    return Profile(np.array(found["commands"]), np.array(found["numbers"]))
