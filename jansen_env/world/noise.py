"""Noise of a robot's sensors: in each step, and a bias that stays for the episode."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from string import digits
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import one_or_two
from jansen_env.engine.jit import Kernel, prepare
from jansen_env.engine.sensors import add_noise, draw_errors
from jansen_env.world.argument_checks import Array, Ints, load_record
from jansen_env.world.entries import Observed

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

ANGLES = (
    ("cos_crank_angle", "cos_crank_angle", "sin_crank_angle"),
    ("sin_pitch", "cos_pitch", "sin_pitch"),
)
"""Entries at which the error of an angle stands, with those of its cosine and sine."""
SPEEDS = ("crank_axis_x_velocity", "crank_speed")
"""Entries whose sensors odometry goes by."""

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
        return load_record(cls, "noise", {**dict.fromkeys(COLUMNS, 0.0), **sensors})

    def deviations(self, observed: Sequence[str]) -> Array:
        """Return standard deviations (d, 2), of noise and bias, of the observations named."""
        found = np.zeros((len(observed), 2))
        for i, name in enumerate(observed):
            for sensor, columns in COLUMNS.items():
                if name.rstrip(digits) in columns:
                    found[i] = getattr(self, sensor)
        return found


class NoisySensors:
    """Noise in the observations of n robots.

    Args:
        num_envs: n. noise: of the sensors. observed: the columns, whose names tell the sensor.

    Attributes:
        level: (n,) factor of the noise. truth: (n, d) observations without noise.
        mean_error: (n, 2), see :func:`jansen_env.engine.sensors.draw_errors`.
    """

    def __init__(self, num_envs: int, noise: Noise, observed: Sequence[Observed]) -> None:
        self.level = np.ones(num_envs)
        self.truth = np.zeros((num_envs, len(observed)), np.float32)
        names = [entry.name for entry in observed]
        self._deviation = noise.deviations(names)
        limits = np.array([(entry.low, entry.high) for entry in observed], np.float32)
        self._low, self._high = limits.T.copy()
        self._known = np.full(num_envs, -1)
        self._bias, self._error = np.zeros((2, *self.truth.shape))
        self.mean_error = np.zeros((num_envs, 2))
        self._angles = np.full((len(names), 2), -1)
        for first, *pair in ANGLES:
            if {first, *pair} <= {*names}:
                self._angles[names.index(first)] = [names.index(name) for name in pair]
        self._speeds = np.array([names.index(one) if one in names else -1 for one in SPEEDS])
        self.measure(np.zeros((num_envs, 0)), ())
        one, counts = np.arange(1), np.zeros(num_envs, np.int64)
        prepare(
            Kernel("errors", draw_errors, self._arguments_of_errors(one, counts, counts)),
            Kernel("noise", add_noise, self._arguments_of_noise(one, self.truth)),
        )

    def measure(self, measured: Array, columns: Sequence[int]) -> None:
        """Observe ``columns`` (m,) as in ``measured`` (n, m), which may change."""
        self._measured, self._columns = measured, np.array(columns, np.int64)

    def _arguments_of_errors(self, rows: Ints, elapsed: Ints, seeds: Ints) -> tuple[Any, ...]:
        return (
            rows, elapsed, seeds, self.level, self._deviation, self._speeds, self._known,
            self._bias, self._error, self.mean_error,
        )  # fmt: skip

    def _arguments_of_noise(self, rows: Ints, out: Any) -> tuple[Any, ...]:
        return (
            rows, self._error, self._angles, self._measured, self._columns, self._low, self._high,
            self.truth, out,
        )  # fmt: skip

    def draw(self, rows: Ints, elapsed: Ints, seeds: Ints) -> None:
        """Draw the errors of robots' (k,) readings and mean speeds, see :class:`Pushes`."""
        draw_errors(*self._arguments_of_errors(rows, elapsed, seeds))

    def add(self, rows: Ints, out: NDArray[np.float32]) -> None:
        """Add the errors drawn last to observations ``out`` (n, d) of robots (k,)."""
        add_noise(*self._arguments_of_noise(rows, out))
