"""What walking well is worth: the weights of the reward and its tracking term."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from jansen_env.checks import non_negative


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
