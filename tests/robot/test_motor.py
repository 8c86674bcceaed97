"""What a motor is: its limits, its electrical power, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jansen_env import Motor

REAL = Motor(
    stall_torque=8.0, no_load_speed=10.0, torque_limit=6.0, gear_ratio=50.0, efficiency=0.7
)


def test_an_ideal_motor_gives_what_is_asked_for():
    asked = np.linspace(-30.0, 30.0, 61)
    np.testing.assert_array_equal(Motor().torque(asked, 1e6), asked)


@pytest.mark.parametrize(
    ("speed", "low", "high"),
    [
        (0.0, -6.0, 6.0),  # the limit of gear and driver
        (5.0, -6.0, 4.0),  # half way to the no-load speed
        (10.0, -6.0, 0.0),
        (12.0, -6.0, -1.6),  # overrun, the motor brakes whatever is asked for
        (-5.0, -4.0, 6.0),
        (-12.0, 1.6, 6.0),
        (30.0, -6.0, -6.0),  # but no more than driver and gear allow
    ],
)
def test_torque_lies_below_the_torque_speed_line(speed, low, high):
    assert float(REAL.torque(-100.0, speed)) == pytest.approx(low)
    assert float(REAL.torque(100.0, speed)) == pytest.approx(high)
    inside = 0.5 * (low + high)
    assert float(REAL.torque(inside, speed)) == inside


def test_electrical_power_is_the_armatures_voltage_times_current():
    # V = K n0, R = V / I_s, stall torque = eta K I_s; of any K the power is the same.
    K = 0.9
    voltage, stall_current = K * 10.0, 8.0 / (0.7 * K)
    resistance = voltage / stall_current
    for torque, speed in ((3.0, 4.0), (5.0, 0.0), (2.0, -1.0), (-4.0, 8.0), (-6.0, 0.2)):
        inner = torque / 0.7 if torque * speed >= 0.0 else torque * 0.7
        current = inner / K
        power = (K * speed + resistance * current) * current
        assert float(REAL.electrical_power(torque, speed)) == pytest.approx(max(power, 0.0))


def test_the_ideal_motors_electrical_power_is_mechanical():
    np.testing.assert_array_equal(
        Motor().electrical_power([2.0, -2.0, 0.0], [3.0, 3.0, 1.0]), [6.0, 0.0, 0.0]
    )


def test_at_stall_all_power_is_winding_loss():
    assert float(REAL.electrical_power(8.0, 0.0)) == pytest.approx(8.0 * 10.0 / 0.7)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"stall_torque": 0.0}, "stall_torque"),
        ({"stall_torque": math.nan}, "stall_torque"),
        ({"no_load_speed": 5.0}, "stall_torque is inf"),
        ({"torque_limit": -1.0}, "torque_limit"),
        ({"torque_limit": math.inf}, "torque_limit"),
        ({"gear_ratio": 0.0}, "gear_ratio"),
        ({"rotor_inertia": -1e-6}, "rotor_inertia"),
        ({"friction": -0.1}, "friction"),
        ({"viscous_friction": "much"}, "viscous_friction"),
        ({"efficiency": 0.0}, "efficiency"),
        ({"viscous_friction": 1e7}, "viscous_friction"),
        ({"gear_ratio": 1e9, "rotor_inertia": 1.0}, "gear_ratio"),
        ({"efficiency": 1.1}, "efficiency"),
    ],
)
def test_what_no_motor_can_be_is_refused(arguments, named):
    with pytest.raises(ValueError, match=named):
        Motor(**arguments)
