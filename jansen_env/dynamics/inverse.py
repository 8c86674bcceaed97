"""Inverse dynamics: the crank torque for a prescribed crank motion with a fixed chassis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.robot import Robot


@dataclass(frozen=True)
class CrankTorque:
    """Contributions to a crank torque, in N m, of any shape (...).

    The symbols c, k, f and V are those of :mod:`jansen_env.dynamics.reduced`.

    Attributes:
        gravity: Contribution of gravity, g c_y'.
        inertia: Contribution of inertia, k psi'' + k' psi'^2 / 2.
        friction: Contribution of viscous friction, f psi'.
        springs: Contribution of springs, V'.
    """

    gravity: Array
    inertia: Array
    friction: Array
    springs: Array

    @property
    def total(self) -> Array:
        """Sum of all contributions, in N m."""
        return self.gravity + self.inertia + self.friction + self.springs


def crank_torque(
    robot: Robot,
    angle: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    gravity: float = GRAVITY,
) -> CrankTorque:
    """Return the crank torque for a prescribed crank motion with a fixed chassis.

    The function solves equation (12) of the paper for tau. The arrays of angles, speeds and
    accelerations are broadcast against each other.

    Args:
        robot: The robot.
        angle: Crank angle, in rad.
        speed: Crank speed, in rad/s.
        acceleration: Crank acceleration, in rad/s^2.
        gravity: Acceleration of gravity, downwards, in m/s^2.
    """
    given = (np.asarray(value, float) for value in (angle, speed, acceleration))
    psi, n, n_dot = np.broadcast_arrays(*given)
    sums = body_sums(compile_robot(robot), psi)
    inertia = sums.k * n_dot + 0.5 * sums.dk * n**2
    return CrankTorque(gravity * sums.dc[..., 1], inertia, sums.f * n, sums.dV)
