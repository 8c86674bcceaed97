"""Observations: each with its name, unit, limits and noise; and the sensors that err."""

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
"""Standard deviation of each step's noise, or that and the one of the episode's bias."""

_EVEN = math.sqrt(1.0 / 3.0)  # standard deviation of what is drawn evenly from -1 to 1
EXACT = "exact"  # for Observed.noise: no sensor measures it, or others' errors are in it already


@dataclass(frozen=True)
class Observed:
    """A number of the observation.

    Args:
        name: as in ``info`` if it is there too. unit: of it, "1" for none.
        low, high: limits, which may be infinite.
        noise: the field of :class:`Noise` whose errors it has in environments with noise, its own
            standard deviation (or pair, see there), or :data:`EXACT`.

    Raises:
        ValueError: an argument is missing or wrong.
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
            raise ValueError(f"limits of the observation {self.name!r} are {limits}, must increase")
        allowed, label = [*SENSORS, EXACT], f"noise of the observation {self.name!r}"
        if not isinstance(self.noise, str):
            one_or_two(label, self.noise)
        elif self.noise not in allowed:
            known = f"a standard deviation or in {listed(allowed, self.noise)}"
            raise invalid(label, self.noise, known)


def world_observations(toes: int, scanned: int) -> list[Observed]:
    """Return the numbers of a robot in the order of :func:`jansen_env.engine.readings.read`."""
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
        accelerometer: each of its two, m/s^2. torque: of the motor, by its current, N m; both with
            ``observe="onboard"``.

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
    accelerometer: Deviation = (0.2, 0.2)
    torque: Deviation = (0.05, 0.05)

    def __post_init__(self) -> None:
        set_checked(self, one_or_two, *SENSORS)

    @classmethod
    def only(cls, **sensors: Deviation) -> Noise:
        """Return noise of some sensors, the others exact; ValueError: no such sensor."""
        return load_record(cls, "noise", {**dict.fromkeys(SENSORS, 0.0), **sensors})

    def deviations(self, observed: Sequence[Observed]) -> Array:
        """Return the standard deviations (d, 2) of noise and bias."""
        known = {EXACT: 0.0, **vars(self)}
        each = [known[o.noise] if isinstance(o.noise, str) else o.noise for o in observed]
        return np.array([one_or_two("noise", deviation) for deviation in each])


SENSORS = tuple(field.name for field in fields(Noise))

ANGLES = (
    ("cos_crank_angle", "cos_crank_angle", "sin_crank_angle"),
    ("sin_pitch", "cos_pitch", "sin_pitch"),
)
"""Entries at which the error of an angle stands, with those of its cosine and sine."""
SPEEDS = ("crank_axis_x_velocity", "crank_speed")
"""Entries whose sensors odometry goes by."""


def sensor_errors(
    noise: Noise | None, observed: Sequence[Observed], count: int
) -> tuple[NDArray[Any], ...]:
    """Return what the engine needs to disturb observations: the last entries of ``Observing``.

    Args:
        noise: Noise of the sensors; None for none.
        observed: Columns of the observation.
        count: Number of robots.
    """
    if noise is None:
        observed, count = (), 0
    names = [entry.name for entry in observed]
    size = len(names)
    limits = np.array([(entry.low, entry.high) for entry in observed], np.float32).reshape(size, 2)
    deviation = np.zeros((0, 2)) if noise is None else noise.deviations(observed)
    angles = np.full((size, 2), -1)
    for first, *pair in ANGLES:
        if {first, *pair} <= {*names}:
            cos, sin = angles[names.index(first)] = [names.index(name) for name in pair]
            deviation[cos + sin - names.index(first)] = 0.0
    speeds = np.array([names.index(speed) if speed in names else -1 for speed in SPEEDS])
    low, high = limits.T.copy()
    return (
        deviation, speeds, angles, low, high, np.full(count, -1), np.zeros((count, size)),
        np.zeros((count, size)), np.zeros((count, 2)), np.zeros((count, size), np.float32),
    )  # fmt: skip
