"""The controller (13) against the formula written out."""

import numpy as np

from jansen_env.policies.pid import PID


def test_integral_waits_at_the_torque_limit_robot_by_robot():
    """There is no wind-up where the torque is at its limit, for each of n robots as if it were
    alone.
    """
    error = np.array([0.1, 0.5, -0.5])
    rate = np.zeros(3)
    integral = np.array([0.2, 0.2, -0.2])
    torque, after = PID().torque(error, rate, integral, 0.01, torque_limit=2.0)
    assert after.tolist() == [0.2 + 0.1 * 0.01, 0.2, -0.2]
    assert abs(torque[1]) > 2.0  # not clipped
    for k in range(3):
        alone = PID().torque(error[k], rate[k], integral[k], 0.01, torque_limit=2.0)
        assert (float(alone[0]), float(alone[1])) == (torque[k], after[k])
