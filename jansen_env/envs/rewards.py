"""What walking well is worth: the weights of the reward and its tracking term."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from jansen_env.compiling import compiled
from jansen_env.validation import non_negative

TRACKING_WIDTH = 0.75  # of the command: speed error at which tracking has fallen to 1/e ...
WIDEST_TRACKING = 0.25  # m/s ... but no wider than this
NARROWEST_TRACKING = 0.002  # m/s ... nor narrower, so that a command of 0 can be tracked


@dataclass(frozen=True)
class RewardWeights:
    """What each term of the reward counts.

    Attributes:
        tracking: at the commanded speed exactly, per step.
        slip: per m/s of slip speed, summed over the toes.
        energy: per unit of motor power / (weight * 1 m/s).
        posture: per rad^2 of pitch.
        fall: once, when the robot falls.
    """

    tracking: float = 1.0
    slip: float = 4.0
    energy: float = 0.1
    posture: float = 0.5
    fall: float = 200.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            object.__setattr__(self, name, non_negative(f"{name}_weight", value))


@compiled
def tracking_score(speed, command):
    """Share of the tracking reward earned at ``speed`` for ``command`` (m/s), 0 to 1.

    A bell of width min(0.75 |command|, 0.25 m/s): standing still earns exp(-1 / 0.75^2) = 0.17 of
    it at slow commands and less at fast ones.
    """
    width = min(max(TRACKING_WIDTH * abs(command), NARROWEST_TRACKING), WIDEST_TRACKING)
    return math.exp(-(((speed - command) / width) ** 2))
