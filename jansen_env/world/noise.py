"""Noise of a robot's sensors: in each step, and a bias that stays for the episode."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from string import digits
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import one_or_two, shown

Array = NDArray[np.float64]
Deviation: TypeAlias = float | tuple[float, float]
"""Standard deviation of each step's noise, or that and the one of the episode's bias."""

COLUMNS = {
    "encoder": ("cos_crank_angle",),  # the first of the two in which the angle is
    "crank_speed": ("crank_speed",),
    "pitch": ("sin_pitch",),
    "gyro": ("pitch_rate",),
    "velocity": ("crank_axis_x_velocity", "crank_axis_y_velocity"),
    "height": ("crank_axis_height",),
    "loads": ("toe_load_",),
    "height_scan": ("height_scan_",),
}
"""Observations of each sensor: names, without their numbers."""

_EVEN = math.sqrt(1.0 / 3.0)  # standard deviation of what is drawn evenly from -1 to 1


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of a walking robot's sensors.

    Of each sensor a number, the standard deviation of the noise that is drawn anew in every control
    step, or a pair: that, and the standard deviation of a bias that is drawn at each reset and
    stays for the episode. Every observation of a sensor has noise and bias of its own. Angles are
    wrong by an angle, in sine and cosine alike. What is measured stays within the observation
    space: a load is never below 0, as of a scale that only presses count on.

    Lag and means are observed as a machine's own computer would know them, by odometry. Lag and
    mean speed are of the measured velocity; mean power is of the torque times the measured crank
    speed. RMS torque is exact, because a motor's current tells its torque. Mean slip is 0, because
    no sensor measures it. Both speeds are means over a step: they err by what the sensor's reading
    errs, and by a second error of the same standard deviation. So lag and means tell no more of a
    steady speed than the readings do. Command and last action are exact.

    Reward, end of episode and ``info`` go by the true lag and means, which ``true_observation`` in
    ``info`` has, too.

    Most defaults are those of published environments, whose even noise of +-a has the standard
    deviation a / 3^0.5: legged_gym (Rudin et al. 2022, ``noise_scales``) and Isaac Lab's velocity
    task have 0.01 rad of joint angles, 0.05 of gravity's direction, 0.2 rad/s of angular and
    0.1 m/s of linear velocity; MuJoCo Playground's Go1 the same but 0.03 rad. All three have
    1.5 rad/s of joint speeds, more than this machine's crank turns at in a slow walk: the default
    is that of Isaac Lab's Spot, 0.5. The first two have 0.1 m of heights, with steps up to 0.23 m;
    this machine's feet lift 0.09 m, and the default is 1 % of the 0.6 m at which its axis is
    carried. None has noise of contact forces; here it is some 5 % of what a loaded toe bears.
    Biases: of the encoder +-0.015 rad as in mjlab's velocity task; of the gyro 1 degree/s, of the
    pitch 0.5 degrees, of heights half their noise, of speeds and loads none.

    Args:
        encoder: crank angle, rad. crank_speed: rad/s. pitch: rad. gyro: pitch rate, rad/s.
        velocity: of the crank axis in x and in y, m/s. height: of the crank axis, m.
        loads: of each toe, shares of the weight. height_scan: each of its heights, m.

    Raises:
        ValueError: neither a number nor two, or one below 0.
    """

    encoder: Deviation = (0.01 * _EVEN, 0.015 * _EVEN)
    crank_speed: Deviation = 0.5 * _EVEN
    pitch: Deviation = (0.05 * _EVEN, math.radians(0.5))
    gyro: Deviation = (0.2 * _EVEN, math.radians(1.0))
    velocity: Deviation = 0.1 * _EVEN
    height: Deviation = (0.006, 0.003)
    loads: Deviation = 0.02
    height_scan: Deviation = (0.006, 0.003)

    def __post_init__(self) -> None:
        for field in fields(self):
            checked = one_or_two(f"Noise.{field.name}", getattr(self, field.name))
            object.__setattr__(self, field.name, checked)

    @classmethod
    def only(cls, **sensors: Deviation) -> Noise:
        """Noise of some sensors, the others exact.

        Raises:
            ValueError: as the class does, or there is no sensor of a name.
        """
        _check_names(sensors)
        return cls(**{name: sensors.get(name, 0.0) for name in COLUMNS})

    def deviations(self, observed: Sequence[str]) -> Array:
        """Standard deviations (d, 2), of noise and bias, of the observations of these names (d,).

        Of an angle they stand at the first of its sine and cosine.
        """
        found = np.zeros((len(observed), 2))
        for i, name in enumerate(observed):
            for sensor, columns in COLUMNS.items():
                if name.rstrip(digits) in columns:
                    found[i] = getattr(self, sensor)
        return found


def make_noise(noise: Any) -> Noise | None:
    """Noise from a :class:`Noise`, or from a dictionary of its arguments; None: none.

    Raises:
        ValueError: anything else, or an argument out of range.
    """
    if noise is None or isinstance(noise, Noise):
        return noise
    if not isinstance(noise, Mapping):
        raise ValueError(
            f"noise is {shown(noise)}, must be None, a Noise or a dictionary with some of "
            f"{sorted(COLUMNS)}"
        )
    _check_names(noise)
    return Noise(**noise)


def _check_names(sensors: Mapping[Any, Any]) -> None:
    """Raises ValueError for sensors that there are not."""
    if unknown := [name for name in sensors if name not in COLUMNS]:
        raise ValueError(f"noise has {shown(unknown)}, must be of {sorted(COLUMNS)}")
