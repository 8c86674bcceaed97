"""Kernels that pages and Python share, beside their formulas in NumPy, bit for bit."""

import numpy as np
import pytest

from jansen_env.engine.contact_frames import AIR, GRIP, SLIP, put_contacts
from jansen_env.engine.crank_control import put_nearest_settings, put_reference_errors
from jansen_env.engine.layers import put_commands, put_normalized
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.policies.pid import PID

COUNT = 500


def test_the_reference_turns_and_angles_do_not_wrap(rng):
    angles = rng.uniform(-np.pi, np.pi, COUNT)
    rates, speeds = rng.normal(size=(2, COUNT))
    memory = rng.uniform(-200.0, 200.0, (COUNT, 2))
    last, target = memory.T.copy()
    errors, error_rates = np.empty((2, COUNT))
    put_reference_errors(angles, rates, speeds, 0.02, memory, errors, error_rates)
    unwrapped = last + ((angles - last + np.pi) % (2.0 * np.pi) - np.pi)
    np.testing.assert_array_equal(errors, target - unwrapped)
    np.testing.assert_array_equal(error_rates, speeds - rates)
    np.testing.assert_array_equal(memory.T, [unwrapped, target + speeds * 0.02])
    assert (np.abs(unwrapped - last) <= np.pi).all()


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_the_pid_controller_takes_any_shape(shape, rng):
    """The integral keeps its value where the torque is at its limit."""
    error, rate, integral = rng.normal(size=(3, *shape))
    before = np.array(integral)
    pid = PID(3.0, 2.0, 0.5)
    torque, after = pid.torque(error, rate, integral, 0.1, 2.0)
    summed = before + error * 0.1
    expected = 3.0 * error + 2.0 * summed + 0.5 * rate
    np.testing.assert_array_equal(torque, expected)
    np.testing.assert_array_equal(after, np.where(np.abs(expected) < 2.0, summed, before))
    np.testing.assert_array_equal(integral, before)
    assert np.shape(torque) == np.shape(after) == shape


def test_the_nearest_setting_is_that_of_the_mean_error(rng):
    settings, speeds = rng.normal(size=7), np.abs(rng.normal(size=(7, 20)))
    commands = np.append(rng.normal(size=COUNT), 0.0)
    out = np.empty(len(commands))
    put_nearest_settings(settings, speeds, commands, np.empty(20), out)
    error = np.abs(speeds - np.abs(commands)[:, None, None]).mean(axis=2)
    expected = np.sign(commands) * settings[np.argmin(error, axis=1)]
    np.testing.assert_array_equal(out, expected)


def test_normalised_observations_are_clipped_and_nan_stays(rng):
    values, mean = rng.normal(size=(5, 3)), rng.normal(size=3)
    values[2, 1] = np.nan
    deviation = rng.uniform(0.1, 1.0, 3)
    out = np.empty((5, 3))
    put_normalized(values, mean, deviation, 0.7, out)
    np.testing.assert_array_equal(out, np.clip((values - mean) / deviation, -0.7, 0.7))
    assert np.isnan(out[2, 1]) and np.isfinite(out).sum() == 14


def test_outputs_become_actions_that_are_clipped():
    outputs = np.array([-30.0, -6.0, 0.0, 1.0, 12.0, np.inf, np.nan])
    commands = np.empty(7, np.float32)
    put_commands(outputs, 12.0, commands)
    expected = np.clip(outputs / 12.0, -1.0, 1.0).astype(np.float32)
    np.testing.assert_array_equal(commands, expected)


def test_contacts_are_lifted_stick_or_slide():
    """Forces are turned into the world's axes; a toe slips where it slid far enough under load."""
    records = RobotRecords(2, 3, 3)
    records.robots["weight"][1] = 100.0
    records.contact_force[1] = [[0.0, 0.0], [3.0, 50.0], [2.0, 60.0]]
    records.slip[1] = [0.0, 1e-4, 1e-2]
    tangents = np.array([[1.0, 0.0], [0.6, 0.8], [0.6, 0.8]])
    contacts, forces = np.empty(3, np.int64), np.empty((3, 2))
    put_contacts(1, 0.02, records.motions, tangents, contacts, forces)
    assert contacts.tolist() == [AIR, GRIP, SLIP]
    normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
    along, across = records.contact_force[1].T[..., None]
    np.testing.assert_allclose(forces, along * tangents + across * normals, rtol=1e-15)
