"""The motor's line, its rotor, its electrical work and a delayed action, on both bases."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import FLIGHT, HOLD, PADS, pads, pinned, placed

from jansen_env import Motor, Payload, Robot, Terrain
from jansen_env.dynamics import reduced as rd
from jansen_env.plants.plant import ProjectionPlant

LINE = Motor(stall_torque=12.0, no_load_speed=6.0, torque_limit=9.0)


def momenta(robot, state):
    """Momentum (2,) and spin about the origin from the robot without rotor and from that alone."""
    bare = rd.compile_robot(replace(robot, motor=Motor()))
    q, v = np.split(np.asarray(state), 2)
    p = rd.mass_matrix(bare, q) @ v
    spin = p[2] + q[0] * p[1] - q[1] * p[0]  # p[2] is about the crank axis
    rotor = robot.motor.rotor_inertia * (v[2] + robot.motor.gear_ratio * v[3])
    return p[:2], spin + rotor


@pytest.mark.parametrize("ratio", [0.1, 1.0, 30.0, 1000.0])
def test_the_rotor_is_a_body_of_its_own(ratio, rng, measured):
    """M and the energy are the robot's without rotor, plus J (theta' + G psi')^2 / 2."""
    motor = Motor(gear_ratio=ratio, rotor_inertia=3e-4)
    robot = Robot(motor=motor, payload=Payload(3.0, 0.1, (0.1, 0.2)))
    tables, bare = rd.compile_robot(robot), rd.compile_robot(replace(robot, motor=Motor()))
    plant = ProjectionPlant(robot, Terrain.flat())
    other = ProjectionPlant(bare.robot, Terrain.flat())
    spin = np.array([0.0, 0.0, 1.0, ratio])
    worst = energy = 0.0
    for _ in range(20):
        q, v = rng.uniform(-3.0, 3.0, 4), rng.normal(0.0, 2.0, 4)
        expected = rd.mass_matrix(bare, q) + motor.rotor_inertia * np.outer(spin, spin)
        M = rd.mass_matrix(tables, q)
        worst = max(worst, np.abs(M - expected).max() / np.abs(expected).max())
        plant.state = other.state = np.concatenate([q, v])
        rotor = 0.5 * motor.rotor_inertia * (spin @ v) ** 2
        energy = max(energy, abs(plant.energy() - other.energy() - rotor) / (1.0 + plant.energy()))
    measured("rotor: mass matrix, relative", worst, 1e-14)
    measured("rotor: energy", energy, 1e-12)


@pytest.mark.parametrize("ratio, inertia", [(30.0, 2e-4), (1000.0, 1e-5), (3.0, 0.5)])
def test_momentum_in_flight_with_a_rotor(ratio, inertia, measured):
    """Motor torque is internal: momentum is exact, and spin with J (theta' + G psi') holds to
    second order.
    """
    robot = Robot(motor=Motor(gear_ratio=ratio, rotor_inertia=inertia))
    drift = []
    for step in (2e-3, 1e-3, 5e-4):
        plant = placed(robot, state=FLIGHT, time_step=step, gravity=0.0)
        p, spin = momenta(robot, plant.state)
        worst = 0.0
        for k in range(25):
            plant.step(6.0 * math.sin(0.7 * k), HOLD)
            now, turning = momenta(robot, plant.state)
            worst = max(worst, abs(turning - spin) / abs(spin))
            measured("rotor in flight: momentum", np.abs(now - p).max(), 1e-12, "N s")
        drift.append(worst)
    measured("rotor in flight: spin's relative drift at 1 ms", drift[1], 5e-7)
    order = math.log(drift[0] / drift[2], 4.0)
    measured("rotor in flight: spin's drift, order lost of 2", 2.0 - order, 0.05)


def test_no_load_speed(measured):
    """Under full torque without friction and weight, the crank gets to the no-load speed."""
    motor = replace(LINE, rotor_inertia=0.05, gear_ratio=20.0)
    robot = Robot(motor=motor, damping=(0.0,) * 10)
    fixed = pinned(robot, 0.3, gravity=0.0)
    fixed.step(9.0, 300.0)
    measured("no-load speed, fixed base, relative", abs(fixed.state[7] / 6.0 - 1.0), 5e-3)
    with_losses = pinned(replace(robot, damping=(0.1,) * 10), 0.3, gravity=0.0)
    with_losses.step(9.0, 100.0)
    before = with_losses.state[3]
    result = with_losses.step(9.0, 20.0)
    mean = (with_losses.state[3] - before) / 20.0
    torque = result.torque
    assert 3.0 < mean < 5.9
    off = abs(LINE.torque(9.0, mean) - torque)
    measured("mean torque off the line at the mean speed", off, 1e-9, "N m")
    unspent = abs(1 - result.joint_loss / result.motor_work)
    measured("motor work less joint loss, of it", unspent, 2e-2)


@pads
def test_torque_keeps_to_the_line(name, measured):
    """It does in every time step, at the mean crank speed of two passes; contacts are those of the
    last one.
    """
    robot = Robot(motor=LINE, pad_compliance=PADS[name])
    plant = placed(robot, tracing=True)
    worst = []
    limited = 0
    for k in range(200):
        asked = 9.0 * math.copysign(1.0, math.sin(0.05 * k))
        plant.step(asked, HOLD)
        rows = plant.batch.trace
        mean = 0.5 * (rows["velocity_before"][:, 3] + rows["velocity_after"][:, 3])
        worst.append(np.abs(rows["torque"] - LINE.torque(asked, mean)))
        limited += np.count_nonzero(np.abs(rows["torque"]) < 8.9)
        assert np.abs(rows["torque"]).max() <= 9.0
    worst = np.concatenate(worst)
    assert limited > 500
    measured(f"torque off the motor's line, median, {name}", np.median(worst), 1e-6, "N m")
    most = np.quantile(worst, 0.99)
    measured(f"torque off the motor's line, 99 % of steps, {name}", most, 1e-5, "N m")
    measured(f"torque off the motor's line, worst impact, {name}", worst.max(), 0.1, "N m")


@pads
@pytest.mark.parametrize("stall", [1e3, 1e6, 1e9])
def test_an_absurdly_steep_line_is_a_brake(name, stall, measured):
    """With stall torque / no-load speed up to 1e12 N m s, the crank keeps to n0 and nothing
    diverges.
    """
    motor = Motor(stall_torque=stall, no_load_speed=1e-3, torque_limit=stall)
    plant = placed(Robot(motor=motor, pad_compliance=PADS[name]))
    rng = np.random.default_rng(5)
    fastest = 0.0
    for k in range(100):
        result = plant.step(float(rng.uniform(-1.0, 1.0)) * stall, HOLD)
        fastest = max(fastest, abs(plant.state[7])) if k > 10 else 0.0
        assert np.isfinite(plant.state).all() and np.abs(plant.state[4:]).max() < 10.0
    missed = abs(result.energy_residual)
    measured("steep motor line: crank speed beyond the no-load speed", fastest, 2e-2, "rad/s")
    measured("steep motor line: energy unaccounted for in 20 ms", missed, 1e-10, "J")


@pytest.mark.parametrize("efficiency", [1.0, 0.6])
def test_electrical_work_is_its_integral(efficiency, measured):
    """The sum of the backend agrees with the trace, refined at half steps, by the data
    sheet's law.
    """
    motor = replace(LINE, efficiency=efficiency)
    plant = placed(Robot(motor=motor), tracing=True)
    drawn = expected = regained = 0.0
    for k in range(150):
        result = plant.step(8.0 * math.sin(0.11 * k), HOLD)
        rows = plant.batch.trace
        speed = 0.5 * (rows["velocity_before"][:, 3] + rows["velocity_after"][:, 3])
        torque = rows["torque"]
        driving = np.where(torque * speed >= 0.0, 1.0 / efficiency, efficiency)
        armature = torque * driving
        current = armature * 6.0 * efficiency / 12.0  # rad/s lost: the winding's voltage
        power = armature * speed + current * armature
        expected += np.maximum(power, 0.0).sum() * 1e-3
        regained += np.minimum(power, 0.0).sum() * 1e-3
        drawn += result.electrical_work
        assert result.electrical_work >= max(result.motor_work, 0.0) - 1e-9
    assert regained < 0.0
    measured("electrical work against the trace, relative", abs(drawn / expected - 1.0), 1e-12)
