"""The compiled time step in flight: it solves the reduced equations, and keeps what must stay."""

from dataclasses import replace

import numpy as np
import pytest
from motions import FLIGHT, placed, shift

from jansen_env import ROBOTS, Payload, paper_robot
from jansen_env.dynamics import reduced as rd
from jansen_env.robot.kinematics import T, joint_positions

HIGH = shift(y=50.0)  # above the ground: nothing touches within a second
LADEN = replace(ROBOTS["holy_slender"](3), payload=Payload(1.7, 0.3, (0.2, 0.4)))


@pytest.fixture(params=[paper_robot(), LADEN], ids=["paper", "laden"])
def robot(request):
    """The paper's machine; and light links on six legs under a load off the crank axis."""
    return request.param


def flying(robot, state=FLIGHT, damping=0.0, **arguments):
    """A plant in flight; the same viscous coefficient in all joints."""
    return placed(replace(robot, damping=(damping,) * 10), state=state, **arguments)


def test_a_tiny_step_has_the_reduced_acceleration(robot, random_state):
    """(v(h) - v(0)) / h, extrapolated to h = 0, is M^-1 (h - velocity terms) to 1e-6; errors are of
    order h^2.
    """
    torque = 3.0
    h = 1e-5
    for _ in range(20):
        state = random_state() + HIGH
        mean = []
        for step in (2.0 * h, h):
            plant = flying(robot, state, 0.1, time_step=step)
            plant.step(torque, step)
            mean.append((plant.state[4:] - state[4:]) / step)
        q, v = np.split(state, 2)
        tables = plant.tables
        force = rd.generalised_forces(tables, q, v, torque) - rd.velocity_terms(tables, q, v)
        expected = np.linalg.solve(rd.mass_matrix(tables, q), force)
        error = np.abs(2.0 * mean[1] - mean[0] - expected)
        assert error.max() <= 1e-6 * max(1.0, np.abs(expected).max())


def test_energy_and_toes_are_the_reduced_models(robot, random_state):
    """The kernels' energy and toe positions are those of reduced.energy and of the linkage, to
    rounding.
    """
    plant = flying(robot)
    for _ in range(5):
        plant.state = state = random_state()
        energy = rd.energy(plant.tables, state[:4], state[4:])
        assert plant.energy() == pytest.approx(energy, rel=1e-12, abs=1e-12)
        x, y, theta, psi = state[:4]
        toes = [joint_positions(robot, leg.side, psi + leg.phase)[T] for leg in robot.legs]
        world = x + 1j * y + np.exp(1j * theta) * (np.array(toes) @ [1.0, 1.0j])
        assert np.abs(plant.toe_positions() @ [1.0, 1.0j] - world).max() <= 1e-12


def test_a_driven_cranks_torque_is_the_reduced_models(robot, random_state):
    """The torque of a tiny step, extrapolated, is what M a + velocity terms - h leaves over, to
    1e-6.
    """
    h = 1e-5
    for _ in range(10):
        state = random_state() + HIGH
        mean = []
        for step in (2.0 * h, h):
            plant = flying(robot, state, 0.1, time_step=step, locked=True, tracing=True)
            plant.step(0.0, step)
            mean.append(plant.batch.trace[0]["torque"])
        q, v = np.split(state, 2)
        M = rd.mass_matrix(plant.tables, q)
        terms = rd.velocity_terms(plant.tables, q, v)
        missing = terms - rd.generalised_forces(plant.tables, q, v, 0.0)
        a = np.append(np.linalg.solve(M[:3, :3], -missing[:3]), 0.0)
        expected = M[3] @ a + missing[3]
        size = max(1.0, np.abs(missing).max())
        assert 2.0 * mean[1] - mean[0] == pytest.approx(expected, abs=1e-6 * size)
