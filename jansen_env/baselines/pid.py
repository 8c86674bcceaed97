"""The paper's controller of the crank, equation (13), for one robot or many."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array


@dataclass(frozen=True)
class PID:
    """Equation (13): tau = kp e + ki int e dt + kd de/dt, with e = reference - crank angle.

    It keeps no state: the integral goes in and comes out, so one controller serves n robots.

    Attributes:
        kp: N m / rad. ki: N m / (rad s). kd: N m s / rad. Default: the paper's gains.
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
        """The torque (...), N m, not clipped, and the integral (...), rad s, to pass next.

        Args:
            error: (...) e, rad. error_rate: (...) de/dt, rad/s.
            integral: (...) sum of e dt before this control step, rad s; 0 at the start.
            control_dt: control period, s.
            torque_limit: N m; where the torque reaches it the integral stays as it was
                (conditional integration, against wind-up).
        """
        before = np.asarray(integral, dtype=float)
        summed = before + np.asarray(error, dtype=float) * control_dt
        torque = self.kp * np.asarray(error) + self.ki * summed + self.kd * np.asarray(error_rate)
        return torque, np.where(np.abs(torque) < torque_limit, summed, before)
