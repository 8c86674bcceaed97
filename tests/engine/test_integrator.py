"""The compiled time step in flight: it solves the reduced equations, and keeps what must stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Payload, Robot, Terrain, paper_robot
from jansen_env.dynamics import reduced as rd
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot.kinematics import T, joint_positions

HIGH = 50.0  # m above the ground: nothing touches within a second
FLIGHT = np.array([0.3, HIGH, 0.4, 2.0, 0.5, 1.0, 1.0, 5.0])
LADEN = replace(ROBOTS["holy_slender"](3), payload=Payload(1.7, 0.3, (0.2, 0.4)))


@pytest.fixture(params=[paper_robot(), LADEN], ids=["paper", "laden"])
def robot(request):
    """The paper's machine; and light links on six legs under a load off the crank axis."""
    return request.param


def flying(robot: Robot, state=FLIGHT, time_step=1e-3, damping=0.0) -> ProjectionPlant:
    """A plant in flight; the same viscous coefficient in all joints."""
    plant = ProjectionPlant(replace(robot, damping=(damping,) * 10), Terrain.flat(), time_step)
    plant.state = state
    return plant


def momenta(plant: ProjectionPlant):
    """Linear momentum, angular momentum about the centre of mass, and that centre, from M(q)."""
    q, v = np.split(plant.state, 2)
    p = rd.mass_matrix(plant.tables, q) @ v
    c = complex(*rd.body_sums(plant.tables, q[3]).c) / plant.robot.mass * np.exp(1j * q[2])
    spin = p[2] - (c.real * p[1] - c.imag * p[0])
    return p[:2], spin, np.array([q[0] + c.real, q[1] + c.imag])


def test_a_tiny_step_has_the_reduced_acceleration(robot, random_state):
    """(v(h) - v(0)) / h extrapolated to h = 0 is M^-1 (h - velocity terms).

    What is left is of order h^2: 1e-6 of the largest acceleration for h = 1e-5 s.
    """
    torque, h = 3.0, 1e-5
    for _ in range(20):
        state = random_state()
        state[1] += HIGH
        mean = []
        for step in (2.0 * h, h):
            plant = flying(robot, state, step, damping=0.1)
            plant.step(torque, step)
            mean.append((plant.state[4:] - state[4:]) / step)
        q, v = np.split(state, 2)
        tables = plant.tables
        force = rd.generalised_forces(tables, q, v, torque) - rd.velocity_terms(tables, q, v)
        expected = np.linalg.solve(rd.mass_matrix(tables, q), force)
        error = np.abs(2.0 * mean[1] - mean[0] - expected)
        assert error.max() <= 1e-6 * max(1.0, np.abs(expected).max())


def test_energy_and_toes_are_the_reduced_models(robot, random_state):
    """The kernels' energy and toe positions against reduced.energy and the linkage; rounding."""
    plant = flying(robot)
    for _ in range(5):
        plant.state = state = random_state()
        assert plant.energy() == pytest.approx(
            rd.energy(plant.tables, state[:4], state[4:]), rel=1e-12, abs=1e-12
        )
        x, y, theta, psi = state[:4]
        toes = [joint_positions(robot, leg.side, psi + leg.phase)[T] for leg in robot.legs]
        world = x + 1j * y + np.exp(1j * theta) * (np.array(toes) @ [1.0, 1.0j])
        assert np.abs(plant.toe_positions() @ [1.0, 1.0j] - world).max() <= 1e-12


def test_a_locked_crank_makes_the_robot_one_rigid_body(robot):
    """No crank speed, no torque; energy and spin kept to rounding, since inertia is constant."""
    state = FLIGHT.copy()
    state[7] = 0.0
    plant = flying(robot, state, damping=0.1)
    plant.prescribed_crank_speed = True
    energy, (_, spin, _) = plant.energy(), momenta(plant)
    result = plant.step(5.0, 1.0)
    assert plant.state[3] == state[3] and plant.state[7] == 0.0 and result.motor_work == 0.0
    assert plant.energy() == pytest.approx(energy, rel=1e-12)
    assert momenta(plant)[1] == pytest.approx(spin, rel=1e-12)
    assert plant.state[2] == pytest.approx(state[2] + state[6], abs=1e-12)


def test_a_driven_crank_keeps_its_speed(robot):
    """To the bit, in flight, whatever torque is asked for: that is not read, and changes no bit.

    The energy balance has the torque's work in it: 1e-4 of the loss, as for any time step.
    """
    ends = []
    for torque in (0.0, 1e3):
        plant = flying(robot, damping=0.1)
        plant.prescribed_crank_speed = True
        energy = plant.energy()
        result = plant.step(torque, 1.0)
        ends.append(plant.state.tobytes() + result.motor_work.hex().encode())
        assert plant.state[7] == FLIGHT[7]
        assert plant.state[3] == pytest.approx(FLIGHT[3] + FLIGHT[7], abs=1e-12)
        assert abs(result.energy_residual) <= 1e-4 * result.joint_loss
        assert plant.energy() - energy == pytest.approx(result.energy_change, abs=1e-10)
    assert ends[0] == ends[1]


def test_a_driven_cranks_torque_is_the_reduced_models(robot, random_state):
    """The torque of a tiny step, extrapolated to 0, is what M a + velocity terms - h leaves over.

    In flight, with a[3] = 0 given and x, y, theta free; of order h^2: 1e-6 of the largest term.
    """
    h = 1e-5
    for _ in range(10):
        state = random_state()
        state[1] += HIGH
        mean = []
        for step in (2.0 * h, h):
            plant = flying(robot, state, step, damping=0.1)
            plant.prescribed_crank_speed = plant.tracing = True
            plant.step(0.0, step)
            mean.append(plant.trace[0]["torque"])
        q, v = np.split(state, 2)
        M = rd.mass_matrix(plant.tables, q)
        terms = rd.velocity_terms(plant.tables, q, v)
        missing = terms - rd.generalised_forces(plant.tables, q, v, 0.0)
        a = np.append(np.linalg.solve(M[:3, :3], -missing[:3]), 0.0)
        expected = M[3] @ a + missing[3]
        size = max(1.0, np.abs(missing).max())
        assert 2.0 * mean[1] - mean[0] == pytest.approx(expected, abs=1e-6 * size)


def test_a_crank_set_free_goes_on(robot):
    """Driven for a while and let go: from then on, bit for bit, as if it had never been driven."""
    let_go = flying(robot, damping=0.1)
    let_go.prescribed_crank_speed = True
    let_go.step(0.0, 0.1)
    let_go.prescribed_crank_speed = False
    free = flying(robot, let_go.state, damping=0.1)
    for plant in (free, let_go):
        plant.step(2.0, 0.1)
    assert (free.state == let_go.state).all()
    assert abs(free.state[7] - FLIGHT[7]) > 0.01


def test_no_gravity():
    """With gravity 0 a robot at rest stays where it is, to the bit."""
    plant = ProjectionPlant(Robot(), Terrain.flat(), gravity=0.0)
    plant.state = state = np.array([0.0, 5.0, 0.2, 1.0, 0.0, 0.0, 0.0, 0.0])
    plant.step(0.0, 0.5)
    assert plant.state == pytest.approx(state, abs=1e-13)
