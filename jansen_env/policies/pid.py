"""The PID controller of the crank from the paper, equation (13), for one robot or many."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array
from jansen_env.engine.crank_control import put_pid_torques


@dataclass(frozen=True)
class PID:
    """PID controller of the crank angle, equation (13).

    The torque is tau = kp e + ki int e dt + kd de/dt, with e = reference - crank angle.

    The controller keeps no state. The caller passes the integral in and gets the new integral back,
    so one controller serves n robots.

    Attributes:
        kp: Proportional gain, in N m/rad. The default is the gain of the paper.
        ki: Integral gain, in N m/(rad s). The default is the gain of the paper.
        kd: Derivative gain, in N m s/rad. The default is the gain of the paper.
    """

    kp: float = 10.0
    ki: float = 1.0
    kd: float = 1.0

    def torque(
        self,
        error: ArrayLike,
        error_rate: ArrayLike,
        integral: ArrayLike,
        control_dt: float,
        torque_limit: float = math.inf,
    ) -> tuple[Array, Array]:
        """Return the torque of the controller and the integral for the next control step.

        The torque is not clipped. The arrays all have the same shape (...).

        Args:
            error: Angle error e, in rad, shape (...).
            error_rate: Rate of the error de/dt, in rad/s, shape (...).
            integral: Sum of e dt before this control step, in rad s, shape (...). It is 0 at the
                start.
            control_dt: Control period, in s.
            torque_limit: Torque limit, in N m. Where the torque reaches this limit, the integral
                keeps its value (conditional integration, which prevents wind-up).

        Returns:
            The torque, in N m, and the integral to pass at the next control step, in rad s. Both
                have shape (...).
        """
        errors, rates, before = np.broadcast_arrays(error, error_rate, integral)
        torques = np.empty(errors.size)
        integrals = before.astype(float).ravel()
        put_pid_torques(
            np.array([self.kp, self.ki, self.kd], float),
            errors.astype(float).ravel(),
            rates.astype(float).ravel(),
            control_dt,
            torque_limit,
            integrals,
            torques,
        )
        return torques.reshape(errors.shape), integrals.reshape(errors.shape)
