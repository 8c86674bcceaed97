"""Noise of a robot's sensors: in each step, and a bias that stays for the episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import listed, load_record, one_or_two, shown
from jansen_env.world.entries import EXACT, Observed

Array = NDArray[np.float64]
Deviation: TypeAlias = float | tuple[float, float]
"""Standard deviation of each step's noise, or that and the one of the episode's bias."""

_EVEN = math.sqrt(1.0 / 3.0)  # standard deviation of what is drawn evenly from -1 to 1


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of a walking robot's sensors.

    For each sensor the standard deviation of the noise of every control step, or a pair: that, and
    the standard deviation of a bias that is drawn at each reset. Every observation of a sensor has
    noise and bias of its own. An angle's error is the same in its sine and cosine. Observations
    stay within the observation space: a load is never below 0.

    Lag and means are observed by odometry. Lag and mean speed are of the measured velocity; mean
    power is of the torque times the measured crank speed. Both speeds are means over a step: they
    have the error of the reading and a second one of the same standard deviation, so lag and means
    tell no more of a steady speed than the readings do. Mean slip is 0, because no sensor measures
    it. RMS torque (a motor's current tells it), command and last action are exact. Reward, end of
    episode and ``info``, with ``true_observation``, have the true lag and means.

    Most defaults are those of published environments, whose uniform noise of +-a has the standard
    deviation a / 3^0.5: legged_gym (Rudin et al. 2022, ``noise_scales``) and Isaac Lab's velocity
    task have 0.01 rad of joint angles, 0.05 of gravity's direction, 0.2 rad/s of angular and
    0.1 m/s of linear velocity. Crank speed is that of Isaac Lab's Spot, 0.5 rad/s, because the
    others' 1.5 rad/s is more than this crank turns in a slow walk. Heights are 1 % of the 0.6 m at
    which the axis is carried; loads some 5 % of a loaded toe's. Biases: of the encoder
    +-0.015 rad as in mjlab's velocity task; of the gyro 1 degree/s, of the pitch 0.5 degrees, of
    heights half their noise, of speeds and loads none.

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
        """Return noise of some sensors, the others exact; ValueError: no such sensor."""
        return load_record(cls, "noise", {**dict.fromkeys(SENSORS, 0.0), **sensors})

    def deviations(self, observed: Sequence[Observed]) -> Array:
        """Return standard deviations (d, 2), of noise and bias; ValueError: one has no sensor."""
        found = np.zeros((len(observed), 2))
        for i, entry in enumerate(observed):
            if entry.sensor not in (*SENSORS, EXACT):
                raise ValueError(
                    f"noise is given, must be None: sensor of the observation {entry.name!r} is "
                    f"{shown(entry.sensor)}, must be in {listed([*SENSORS, EXACT], entry.sensor)}"
                )
            if entry.sensor != EXACT:
                found[i] = getattr(self, entry.sensor)
        return found


SENSORS = tuple(field.name for field in fields(Noise))
