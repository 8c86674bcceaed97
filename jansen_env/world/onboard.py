"""Onboard sensors: what a machine's own computer reads of crank, chassis and motor.

``agents/export/firmware.c.in`` does the same in C: change both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array, Ints, Rows
from jansen_env.engine.mathematics import angles_of, directions
from jansen_env.gravity import GRAVITY
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn, toe_positions
from jansen_env.world.observations import EXACT, Observed

CORRECTION_TIME = 2.0  # s, over which the accelerometer corrects the pitch that the gyro gives
LEGS_TIME = 0.1  # s, over which the legs correct the velocity that the accelerometer gives
SUPPORTED = 5.0  # m/s^2, acceleration upwards from which a leg stands on the ground
SAMPLES = 128  # of a turn: crank angles at which the legs' paths are known
ONBOARD = (
    Observed("cos_crank_angle", "1", -1.0, 1.0, "encoder"),
    Observed("sin_crank_angle", "1", -1.0, 1.0, "encoder"),
    Observed("crank_speed", "rad/s", -np.inf, np.inf, EXACT),  # of angles with errors
    Observed("sin_pitch", "1", -1.0, 1.0, EXACT),  # of a gyro and accelerations with errors
    Observed("cos_pitch", "1", -1.0, 1.0, EXACT),
    Observed("pitch_rate", "rad/s", -np.inf, np.inf, "gyro"),
    Observed("crank_axis_x_velocity", "m/s", -np.inf, np.inf, EXACT),  # as estimated
    Observed("acceleration_x", "m/s^2", -np.inf, np.inf, "accelerometer"),
    Observed("acceleration_y", "m/s^2", -np.inf, np.inf, "accelerometer"),
    Observed("crank_torque", "N m", -np.inf, np.inf, "torque"),
    Observed("last_action", "1", -1.0, 1.0, EXACT),
)
PITCH, ANGLE, SPEED, VELOCITY, IMU = [0, 1], 2, 3, 4, [5, 6, 7]  # of what is kept
KEPT = 8
BEFORE = [2, 4, 5]  # of a state: pitch, and velocity of the crank axis
OF_IMU = ("pitch_rate", "acceleration_x", "acceleration_y")


def toe_paths(robot: Robot) -> NDArray[np.float32]:
    """Return places of toes (SAMPLES + 1, toes, 2), m, over a turn that walks towards +x."""
    angles = np.copysign(np.linspace(0.0, 2.0 * math.pi, SAMPLES + 1), advance_per_turn(robot))
    return toe_positions(robot, angles).astype(np.float32)


class OnboardSensors:
    """Encoder, IMU and current sensor of n robots.

    Crank speed is the change of the encoder's angle over the last step. The IMU is at the crank
    axis; its pitch rate and accelerations are means over the last step, these forwards and upwards
    along the chassis: at rest on level ground 0 and 9.81 m/s^2. The pitch is that to the vertical,
    also where gravity is tilted: the gyro turns it, the accelerometer's direction corrects it. The
    velocity is the accelerometer's, corrected by the lowest toe, which is taken to stand still
    while the machine is supported.

    Args:
        num_envs: n. toes: of each. period: s, of a control step.

    Attributes:
        paths: (n, SAMPLES + 1, toes, 2) see :func:`toe_paths`.
        kept: (n, 8) cosine and sine of the pitch, crank angle (rad) and speed (rad/s), velocity
            (m/s), as measured; pitch rate (rad/s) and accelerations (m/s^2) without errors.
    """

    def __init__(self, num_envs: int, toes: int, period: float) -> None:
        self.kept, self._period = np.zeros((num_envs, KEPT)), period
        self._first = np.ones(num_envs, bool)
        self._before = np.zeros((num_envs, 3))
        self.paths = np.zeros((num_envs, SAMPLES + 1, toes, 2), np.float32)

    def connect(self, columns: Mapping[str, int], observation: NDArray[np.float32]) -> None:
        """Take the array of observations (n, d), and its columns by name."""
        self._observation, self._columns = observation, columns

    def _seen(self, which: Ints, *names: str) -> Array:
        """Return observations (k, len(names)) of robots (k,)."""
        columns = [self._columns[name] for name in names]
        return self._observation[which[:, None], columns].astype(float, order="C")

    def _show(self, which: Ints, *names: str, values: Array) -> None:
        """Show values (k, len(names)) as observations of robots (k,)."""
        self._observation[which[:, None], [self._columns[name] for name in names]] = values

    def begin(self, which: Ints, states: Array) -> None:
        """Begin with robots ``which`` (k,) of these states (n, 8)."""
        self._first[which], self._before[which] = True, states[which][:, BEFORE]

    def go_on(self, i: int, kept: Array) -> None:
        """Go on with a robot of which this was kept."""
        self._first[i], self.kept[i] = False, kept

    def read(
        self, which: Ints, moved: bool, states: Array, parameters: Rows, torque: Array
    ) -> None:
        """Observe what IMU and current tell of robots (k,), without errors.

        moved: whether it is after a step. states: (n, 8). parameters: (n,) of the episodes.
        torque: (n,) of motors in the last step, N m.
        """
        new = which if moved else which[self._first[which]]
        now = states[new][:, BEFORE]
        rate, x, y = (now - self._before[new]).T / self._period
        self._before[new] = now
        weight = GRAVITY * parameters["gravity_scale"][new]
        cos, sin = directions(parameters["tilt"][new]).T
        x, y = x + weight * sin, y + weight * cos
        cos, sin = directions(now[:, 0]).T
        imu = np.stack([rate, cos * x + sin * y, cos * y - sin * x], -1)
        self.kept[new[:, None], IMU] = imu
        self._show(which, *OF_IMU, values=self.kept[which[:, None], IMU])
        self._show(which, "crank_torque", values=torque[which, None])

    def _toes(self, which: Ints, angle: Array, cos: Array, sin: Array) -> tuple[Array, Array]:
        """Return how far ahead of and above the crank axis toes are, (toes, k) m."""
        place = angle * (SAMPLES / (2.0 * math.pi))
        place -= SAMPLES * np.floor(place / SAMPLES)
        low = np.minimum(place.astype(np.int64), SAMPLES - 1)
        share = (place - low)[:, None, None]
        path = self.paths[which, low] * (1.0 - share) + self.paths[which, low + 1] * share
        x, y = path.T
        return cos * x - sin * y, sin * x + cos * y

    def filter(self, which: Ints, moved: bool) -> None:
        """Observe crank speed, pitch and velocity of robots (k,), by readings that have errors."""
        new, period = which if moved else which[self._first[which]], self._period
        first, kept = self._first[new], self.kept[new]
        cos, sin = kept[:, PITCH].T
        x_before, y_before = self._toes(new, kept[:, ANGLE], cos, sin)
        angle = angles_of(self._seen(new, "cos_crank_angle", "sin_crank_angle"))
        turn = angle - kept[:, ANGLE]
        turn -= 2.0 * math.pi * np.rint(turn / (2.0 * math.pi))
        rate, along, across = self._seen(new, *OF_IMU).T
        gain, pitched = np.where(first, 1.0, period / CORRECTION_TIME), rate * period
        cos, sin = cos - pitched * sin, sin + pitched * cos
        cos += gain * (across / GRAVITY - cos)
        sin += gain * (along / GRAVITY - sin)
        length = np.maximum(np.sqrt(cos * cos + sin * sin), 1e-9)
        cos, sin = cos / length, sin / length
        x, y = self._toes(new, angle, cos, sin)
        lowest = np.argmin(y + y_before, axis=0), np.arange(len(new))
        by_legs = (x_before[lowest] - x[lowest]) / period
        velocity = kept[:, VELOCITY] + period * (cos * along - sin * across)
        supported = sin * along + cos * across > SUPPORTED
        velocity += np.where(supported, period / LEGS_TIME, 0.0) * (by_legs - velocity)
        speeds = np.where(first, 0.0, [turn / period, velocity])
        kept[:, : IMU[0]] = np.stack([cos, sin, angle, *speeds], -1)
        self.kept[new], self._first[new] = kept, False
        shown = self.kept[which[:, None], [*PITCH, SPEED, VELOCITY]]
        names = "cos_pitch", "sin_pitch", "crank_speed", "crank_axis_x_velocity"
        self._show(which, *names, values=shown)
