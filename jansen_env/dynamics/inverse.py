"""Inverse dynamics: the crank torque that a prescribed crank motion takes on a fixed base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.gravity import GRAVITY
from jansen_env.robot import Robot


@dataclass(frozen=True)
class CrankTorque:
    """A crank torque by cause, each (...), N m."""

    gravity: Array  #: g c_y'
    inertia: Array  #: k psi'' + k' psi'^2 / 2
    friction: Array  #: f psi'

    @property
    def total(self) -> Array:
        """Their sum (...), N m."""
        return self.gravity + self.inertia + self.friction


def crank_torque(
    robot: Robot,
    angle: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    gravity: float = GRAVITY,
) -> CrankTorque:
    """The torque for a prescribed crank motion on a fixed base: (12) solved for tau.

    ``angle`` (rad), ``speed`` and ``acceleration`` broadcast against one another.
    """
    given = (np.asarray(value, float) for value in (angle, speed, acceleration))
    psi, n, n_dot = np.broadcast_arrays(*given)
    sums = body_sums(compile_robot(robot), psi)
    inertia = sums.k * n_dot + 0.5 * sums.dk * n**2
    return CrankTorque(gravity * sums.dc[..., 1], inertia, sums.f * n)
