"""Descriptions of the observed values (name, unit, limits, and noise), and sensor noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array
from jansen_env.checks import invalid, listed, load_record, one_or_two, set_checked, shown

Deviation: TypeAlias = float | tuple[float, float]
"""Standard deviation of the noise in each step, or a pair of standard deviations.

The second number of a pair is the standard deviation of the bias of an episode.
"""

_EVEN = math.sqrt(1.0 / 3.0)  # standard deviation of a uniform distribution from -1 to 1
EXACT = "exact"
"""Value of ``Observed.noise`` for an observation without errors of its own.

No sensor measures it, or it already contains the errors of other observations.
"""


@dataclass(frozen=True)
class Observed:
    """Description of one value of the observation.

    Args:
        name: Name of the value. It is the same as in ``info``, if ``info`` contains the value.
        unit: Unit of the value, "1" for a dimensionless value.
        low: Lower limit, which may be infinite.
        high: Upper limit, which may be infinite.
        noise: Errors of the value in environments with noise: the name of a field of
            :class:`Noise`, a standard deviation or a pair of them (see :data:`Deviation`), or
            :data:`EXACT`.

    Raises:
        ValueError: If an argument is missing or invalid.
    """

    name: str
    unit: str
    low: float
    high: float
    noise: str | Deviation

    def __post_init__(self) -> None:
        for part in ("name", "unit"):
            text = getattr(self, part)
            if not isinstance(text, str) or not text:
                raise invalid(f"{part} of an observation", text, "a text")
        if not self.low < self.high:
            limits = f"{shown(self.low)} to {shown(self.high)}"
            raise ValueError(f"limits of the observation {self.name!r} must increase, got {limits}")
        allowed = [*SENSORS, EXACT]
        label = f"noise of the observation {self.name!r}"
        if not isinstance(self.noise, str):
            one_or_two(label, self.noise)
        elif self.noise not in allowed:
            known = f"a standard deviation or in {listed(allowed, self.noise)}"
            raise invalid(label, self.noise, known)


def world_observations(toes: int, scanned: int) -> list[Observed]:
    """Return descriptions of the values that the world can observe of a robot.

    They have the order of :func:`jansen_env.engine.readings.read`.

    Args:
        toes: Number of toes.
        scanned: Number of points of the height scan.
    """
    inf = np.inf
    return [
        Observed("cos_crank_angle", "1", -1.0, 1.0, "encoder"),
        Observed("sin_crank_angle", "1", -1.0, 1.0, "encoder"),
        Observed("crank_speed", "rad/s", -inf, inf, "crank_speed"),
        Observed("sin_pitch", "1", -1.0, 1.0, "pitch"),
        Observed("cos_pitch", "1", -1.0, 1.0, "pitch"),
        Observed("pitch_rate", "rad/s", -inf, inf, "gyro"),
        Observed("crank_axis_x_velocity", "m/s", -inf, inf, "velocity"),
        Observed("crank_axis_y_velocity", "m/s", -inf, inf, "velocity"),
        Observed("crank_axis_height", "m", -inf, inf, "height"),
        Observed("last_action", "1", -1.0, 1.0, EXACT),
        *(Observed(f"toe_load_{toe}", "1", 0.0, inf, "loads") for toe in range(toes)),
        *(Observed(f"height_scan_{k}", "m", -inf, inf, "height_scan") for k in range(scanned)),
    ]


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of a walking robot's sensors.

    Each argument is the standard deviation of the noise in every control step, or a pair. The
    second number of a pair is the standard deviation of a bias that is sampled at each reset. Every
    observation of a sensor has its own noise and its own bias. The sine and the cosine of an angle
    contain the same error of the angle. Observations stay within the observation space; for
    example, a load is never below 0.

    The lag and the means are observed by odometry. The lag and the mean speed are computed from the
    measured velocity, and the mean power is computed from the torque and the measured crank speed.
    Both speeds are means over a step. They contain the error of the reading and a second error of
    the same standard deviation, so that the lag and the means reveal no more about a steady speed
    than the readings do. The mean slip is observed as 0, because no sensor measures it. The RMS
    torque, which follows from the current of the motor, the command, and the last action are exact.
    The reward, the end of the episode, and ``info``, including ``true_observation``, use the true
    lag and means.

    Most defaults are those of published environments, whose uniform noise of +-a has the standard
    deviation a / 3^0.5. In legged_gym (Rudin et al. 2022, ``noise_scales``) and in the velocity
    task of Isaac Lab, the noise is 0.01 rad for joint angles, 0.05 for the direction of gravity,
    0.2 rad/s for angular velocities, and 0.1 m/s for linear velocities. The noise of the crank
    speed is that of Isaac Lab's Spot, 0.5 rad/s, because the 1.5 rad/s of the other environments is
    faster than this crank turns in a slow walk. The noise of heights is 1 % of the 0.6 m at which
    the crank axis is carried, and the noise of loads is about 5 % of the load of a loaded toe. The
    bias of the encoder is +-0.015 rad, as in mjlab's velocity task. The biases of the gyro and of
    the pitch are 1 degree/s and 0.5 degrees, and those of heights are half of their noise. Speeds
    and loads have no bias.

    Args:
        encoder: Noise of the crank angle, in rad.
        crank_speed: Noise of the crank speed, in rad/s.
        pitch: Noise of the pitch, in rad.
        gyro: Noise of the pitch rate, in rad/s.
        velocity: Noise of the velocity of the crank axis in x and in y, in m/s.
        height: Noise of the height of the crank axis, in m.
        loads: Noise of the load of each toe, as a fraction of the weight.
        height_scan: Noise of each height of the height scan, in m.
        accelerometer: Noise of each of the two accelerations, in m/s^2. Used only with
            ``observe="onboard"``.
        torque: Noise of the motor torque, measured by the current of the motor, in N m. Used only
            with ``observe="onboard"``.

    Raises:
        ValueError: If an argument is neither a number nor a pair of numbers, or a number is below
            0.
    """

    encoder: Deviation = (0.01 * _EVEN, 0.015 * _EVEN)
    crank_speed: Deviation = 0.5 * _EVEN
    pitch: Deviation = (0.05 * _EVEN, math.radians(0.5))
    gyro: Deviation = (0.2 * _EVEN, math.radians(1.0))
    velocity: Deviation = 0.1 * _EVEN
    height: Deviation = (0.006, 0.003)
    loads: Deviation = 0.02
    height_scan: Deviation = (0.006, 0.003)
    accelerometer: Deviation = (0.2, 0.2)
    torque: Deviation = (0.05, 0.05)

    def __post_init__(self) -> None:
        set_checked(self, one_or_two, *SENSORS)

    @classmethod
    def only(cls, **sensors: Deviation) -> Noise:
        """Return noise of some sensors; all other sensors are exact.

        Args:
            **sensors: Noise of each noisy sensor, by the names of the arguments of this class.

        Raises:
            ValueError: If there is no sensor with such a name, or a value is invalid.
        """
        return load_record(cls, "noise", {**dict.fromkeys(SENSORS, 0.0), **sensors})

    def deviations(self, observed: Sequence[Observed]) -> Array:
        """Return the standard deviations of the noise and of the bias.

        Args:
            observed: Descriptions of the d observed values.

        Returns:
            Standard deviations of the noise in each step and of the bias, shape (d, 2).
        """
        known = {EXACT: 0.0, **vars(self)}
        each = [known[o.noise] if isinstance(o.noise, str) else o.noise for o in observed]
        return np.array([one_or_two("noise", deviation) for deviation in each])


SENSORS = tuple(field.name for field in fields(Noise))
"""Names of all sensors."""

ANGLES = (
    ("cos_crank_angle", "cos_crank_angle", "sin_crank_angle"),
    ("sin_pitch", "cos_pitch", "sin_pitch"),
)
"""Observations of each angle.

The first one contains the error of the angle. The others are its cosine and its sine.
"""
SPEEDS = ("crank_axis_x_velocity", "crank_speed")
"""Observations whose sensors are used for odometry."""


def sensor_errors(
    noise: Noise | None, observed: Sequence[Observed], count: int
) -> tuple[NDArray[Any], ...]:
    """Return the arrays with which the engine adds errors to the observations.

    They are the last fields of :class:`jansen_env.engine.episode.Observing`, from ``deviation`` on.

    Args:
        noise: Noise of the sensors. None for no noise.
        observed: Descriptions of the columns of the observation.
        count: Number of robots.
    """
    if noise is None:
        observed = ()
        count = 0
    names = [entry.name for entry in observed]
    size = len(names)
    limits = np.array([(entry.low, entry.high) for entry in observed], np.float32).reshape(size, 2)
    deviation = np.zeros((0, 2)) if noise is None else noise.deviations(observed)
    angles = np.full((size, 2), -1)
    for first, *pair in ANGLES:
        if {first, *pair} <= {*names}:
            cos, sin = [names.index(name) for name in pair]
            angles[names.index(first)] = (cos, sin)
            deviation[cos + sin - names.index(first)] = 0.0
    speeds = np.array([names.index(speed) if speed in names else -1 for speed in SPEEDS])
    low, high = limits.T.copy()
    return (
        deviation,
        speeds,
        angles,
        low,
        high,
        np.full(count, -1),
        np.zeros((count, size)),
        np.zeros((count, size)),
        np.zeros((count, 2)),
        np.zeros((count, size), np.float32),
    )
