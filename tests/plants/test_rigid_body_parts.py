"""The rigid-body plant's motor, rotor, dry bearings and compliant pads against closed forms."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from motions import runge_kutta

from jansen_env import ROBOTS, Motor, Terrain
from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.plants.base import static_deflection
from jansen_env.plants.plant import RigidBodyPlant
from jansen_env.robot import JANSEN, Compliance
from jansen_env.robot.kinematics import coordinates

FLYING = np.array([0.3, 5.0, 0.2, 1.1, 0.4, 1.0, -0.7, 2.0])
"""A state high above the ground, everything moving."""
LIGHT = ROBOTS["paper_slender"]()
ROTOR = Motor(gear_ratio=30.0, rotor_inertia=2e-5, friction=0.1, viscous_friction=0.05)
DRY = (0.01, 0.02, 0.03, 0.04, 0.05, 0.04, 0.03, 0.02, 0.01, 0.05)
GIVE = Compliance(2e4, 50.0, 1.5e4, 40.0)
LOCKED = replace(LIGHT, motor=Motor(friction=1e3), pad_compliance=GIVE)
"""Its crank never turns: a rigid body on springs."""
UPRIGHT = 0.5 * math.pi  # rad, the crank angle at which fore and back legs are mirror images


def walk(plant, speed, duration, dt=0.02):
    """Hold the crank near ``speed`` rad/s; the results of all steps."""

    def torque():
        return 0.8 * (speed - plant.state[7]) + 1.2 * speed

    return [plant.step(torque(), dt) for _ in range(round(duration / dt))]


def spun(plant, state, torque, duration):
    """Where a plant comes to without touching the ground."""
    plant.state = state
    plant.step(torque, duration)
    return plant.state


def dense(robot, state, torque, duration, steps=100):
    """The paper's equations with these parts, by Runge-Kutta: the state after a flight."""

    def rate(state):
        q, v = np.split(state, 2)
        return np.concatenate([v, joint_forces(robot, q, v, torque).q_ddot])

    return runge_kutta(rate, state, duration / steps, steps)[-1]


@pytest.mark.parametrize(
    "robot",
    [
        replace(LIGHT, motor=replace(ROTOR, friction=0.0, viscous_friction=0.0)),
        replace(LIGHT, motor=ROTOR, bearing_friction=DRY),
    ],
    ids=["rotor", "all"],
)
def test_flight_is_that_of_the_dense_equations(robot):
    """0.1 s in the air under 1 N m: 1e-3 of the angles turned, half of it at half the time step."""
    exact = dense(robot, FLYING, 1.0, 0.1)
    misses = [
        np.abs(spun(RigidBodyPlant(robot, Terrain.flat(), h), FLYING, 1.0, 0.1) - exact)[2:4]
        for h in (2.5e-4, 1.25e-4)
    ]
    turned = np.abs(exact - FLYING)[2:4]
    assert (misses[0] < 1e-3 * max(turned)).all()
    assert misses[1].max() < 0.6 * misses[0].max()


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.2])
def test_dry_friction_holds_at_a_standstill(angle):
    """Up to sum tau_i |a_j' - a_i'| + the gear's the crank does not turn; 2 % above it does."""
    robot = replace(LIGHT, bearing_friction=DRY, motor=Motor(friction=0.15))
    plant = RigidBodyPlant(robot, Terrain.flat(), gravity=0.0, held=True)
    holds, step = robot.motor.friction, 1e-6
    for leg in robot.legs:
        psi = angle + leg.phase
        slope = np.diff([coordinates(robot, leg.side, psi + s) for s in (-step, step)], axis=0)[0]
        slope = slope.reshape(len(JANSEN.bodies), 3)[:, 0] / (2.0 * step)
        holds += sum(
            tau * abs(slope[j - 1] - slope[i - 1])
            for (i, j), tau in zip(JANSEN.bearings, robot.bearing_friction, strict=True)
        )
    rest = np.array([0.0, 5.0, 0.0, angle, 0.0, 0.0, 0.0, 0.0])
    plant.state = rest
    result = plant.step(0.98 * holds, 0.2)
    assert abs(plant.state[3] - angle) < 1e-6 and abs(plant.state[7]) < 1e-5
    assert abs(result.motor_work) < 1e-5
    plant.state = rest
    plant.step(1.02 * holds, 0.2)
    assert plant.state[3] - angle > 1e-3


@pytest.mark.parametrize(
    "change",
    [
        {"motor": replace(ROTOR, stall_torque=15.0, no_load_speed=20.0, efficiency=0.8)},
        {"bearing_friction": DRY, "motor": ROTOR, "pad_compliance": GIVE},
    ],
    ids=["motor", "all"],
)
def test_energy_accounts_close(change):
    """Motor work = losses + energy change: 0.1 % of the work in a walk; the weight is carried."""
    robot = replace(LIGHT, **change)
    plant = RigidBodyPlant(robot, Terrain.flat(friction=0.5))
    plant.reset()
    results = walk(plant, 3.0, 1.5)
    work = sum(r.motor_work for r in results)
    assert work > 3.0 and abs(sum(r.energy_residual for r in results)) < 0.001 * work
    assert sum(r.electrical_work for r in results) >= 0.999999 * work
    load = np.mean([r.contact_force[:, 1].sum() for r in results])
    assert load == pytest.approx(robot.mass * 9.81, rel=0.03)


def test_the_motor_gives_what_it_can():
    """Beyond its torque-speed line a torque is the same as at it; energy by its own formula."""
    motor = Motor(stall_torque=4.0, no_load_speed=8.0, torque_limit=3.0, efficiency=0.7)
    plant, ends, results = RigidBodyPlant(replace(LIGHT, motor=motor), Terrain.flat()), [], []
    for torque in (100.0, 3.0):
        plant.state = np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        results.append(plant.step(torque, 0.05))
        ends.append(plant.state)
    assert (ends[0] == ends[1]).all()
    assert results[0].electrical_work == results[1].electrical_work > results[0].motor_work > 0.0
    fast = RigidBodyPlant(replace(LIGHT, motor=motor), Terrain.flat(), held=True)
    fast.state = np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 7.0])
    one = fast.step(3.0, fast.time_step)
    speed = 0.5 * (7.0 + fast.state[7])
    assert one.motor_work == pytest.approx(0.5 * speed * fast.time_step, rel=1e-6)
    drawn = float(motor.electrical_power(0.5, speed)) * fast.time_step
    assert one.electrical_work == pytest.approx(drawn, rel=1e-6)


@pytest.mark.parametrize("switch", [0, 7, 80])
def test_an_earlier_torque_comes_first(switch):
    """A torque that changes within a step: the motion of two steps, bit for bit, sums added up."""
    plants = [RigidBodyPlant(LIGHT, Terrain.flat()) for _ in range(2)]
    h = plants[0].time_step
    for plant in plants:
        plant.reset()
    whole = plants[0].step(2.0, 80 * h, -1.0, switch)
    parts = [
        plants[1].step(torque, steps * h)
        for torque, steps in ((-1.0, switch), (2.0, 80 - switch))
        if steps
    ]
    assert (plants[0].state == plants[1].state).all()
    assert whole.motor_work == pytest.approx(sum(p.motor_work for p in parts), rel=1e-12)
    batch = RigidBodyPlant(LIGHT, Terrain.flat()).batch
    batch.place(np.array([0]), np.array([0.0]))
    batch.place_at(np.array([0]), np.array([0.0]))
    batch.step(np.array([2.0]), 80, np.array([-1.0]), np.array([switch]))
    assert (batch.states[0] == plants[0].state).all()
    assert batch.accumulators["motor_work"][0] == whole.motor_work


def landing(duration, fall, time_step):
    """Heights of a locked robot that falls on two of its toes, and the plant."""
    plant = RigidBodyPlant(LOCKED, Terrain.flat(), time_step)
    plant.reset(crank_angle=UPRIGHT, pitch=0.0)
    sunk = static_deflection(LOCKED, 9.81)  # by which it is placed in the ground
    ground = plant.state[1] + sunk
    plant.state = plant.state + np.array([0.0, fall + sunk, *np.zeros(6)])
    heights = []
    for _ in range(round(duration / 1e-3)):
        plant.step(0.0, 1e-3)
        heights.append(plant.state[1] - ground)
    return np.array(heights), plant


def test_a_landing_is_that_of_a_mass_on_a_spring():
    """Two toes, 2 k and 2 d: depth and rebound of the closed form, 1 % of the depth."""
    fall, g, m = 5e-3, 9.81, LOCKED.mass
    k, d = 2.0 * GIVE.stiffness, 2.0 * GIVE.damping
    start, delta = math.sqrt(2.0 * fall / g), d / (2.0 * m)
    omega = math.sqrt(k / m - delta**2)
    t = np.arange(0.0, 0.5 * math.pi / omega * 1.6, 1e-3) + 1e-3
    rest, speed = m * g / k, math.sqrt(2.0 * g * fall)
    # z'' + 2 delta z' + (k/m) (z + rest) = 0 from z = 0 at -speed.
    a, b = rest, (-speed + delta * rest) / omega
    exact = np.exp(-delta * t) * (a * np.cos(omega * t) + b * np.sin(omega * t)) - rest
    heights, plant = landing(start + t[-1], fall, 2e-5)
    times = 1e-3 * np.arange(1, len(heights) + 1) - start
    during = (times > 0.0) & (times < t[-1])
    found = heights[during]
    wanted = np.interp(times[during], t, exact, left=0.0)
    close = times[during] > 1e-3
    assert np.abs(found - wanted)[close].max() < 0.01 * np.abs(exact).max()
    assert plant.step(0.0, 1e-3).joint_gap < 2e-4


def pulled(share, duration=0.4, friction=0.5):
    """A standing, locked robot under a pull of ``share`` of its weight: way, result, plant."""
    plant = RigidBodyPlant(LOCKED, Terrain.flat(friction=friction))
    plant.reset(crank_angle=UPRIGHT, pitch=0.0)
    plant.step(0.0, 0.5)
    x = plant.x
    plant.gravity = (share * 9.81, -9.81)
    result = plant.step(0.0, duration)
    return plant.x - x, result, plant


@pytest.mark.slow
def test_bristles_hold_and_give():
    """Below friction's reach nothing slides, and letting go brings the robot back."""
    way, result, plant = pulled(0.05)
    bent = 0.05 * LOCKED.mass * 9.81 / (2.0 * float(GIVE.tangential_stiffness))
    assert way > 0.5 * bent and result.slip.sum() < 1e-7
    for _ in range(5):  # back and forth
        for side in (0.05, -0.05):
            plant.gravity = (side * 9.81, -9.81)
            assert plant.step(0.0, 0.02).slip.sum() < 1e-7
    plant.gravity = 9.81
    plant.step(0.0, 1.0)
    assert abs(plant.x - (pulled(0.0)[2].x)) < 0.15 * way


def test_bristles_slide_with_coulombs_friction():
    """Under a pull beyond friction's reach: (pull - mu sum n) / m, 0.1 %; heat for each metre."""
    _, _, plant = pulled(0.3, 0.1, friction=0.2)

    def speed():
        return (
            plant.batch._space.inertias[:, 0]
            @ plant.batch._space.snapshot().motion[:, 3]
            / LOCKED.mass
        )

    before = speed()
    result = plant.step(0.0, 0.1)
    normal = result.contact_force[:, 1].sum()
    expected = 0.3 * 9.81 - 0.2 * normal / LOCKED.mass
    assert (speed() - before) / 0.1 == pytest.approx(expected, rel=1e-3)
    heat = 0.2 * result.contact_force[:, 1] @ result.slip
    assert result.slip_loss == pytest.approx(heat, rel=0.02) and heat > 0.1


def test_bristles_are_remembered():
    """By a lookahead, which changes nothing, and a copy; a state that is set has none."""
    _, _, plant = pulled(0.05)
    bent = plant.batch._springs.bristle.copy()
    before = plant.state
    plant.lookahead(1.0)
    assert (plant.batch._springs.bristle != 0.0).sum() == 2
    np.testing.assert_allclose(plant.batch._springs.bristle, bent, atol=1e-6)
    np.testing.assert_allclose(plant.state, before, atol=1e-9)
    copy = pickle.loads(pickle.dumps(plant))
    assert (copy.batch._springs.bristle == plant.batch._springs.bristle).all()
    plant.state = before
    assert np.abs(plant.batch._springs.bristle).max() < 1e-5 < np.abs(bent).max()


def test_a_time_step_too_long_for_the_pads_is_refused():
    """ValueError names it, the longest and the pads' data; at the longest a landing is tame."""
    with pytest.raises(ValueError, match=r"time_step is 0\.003, must be at most .* of 20000 N/m"):
        RigidBodyPlant(LOCKED, Terrain.flat(), 3e-3)
    stiff = replace(LIGHT, pad_compliance=Compliance(1e7, 0.0))
    with pytest.raises(ValueError, match="must be at most") as refused:
        RigidBodyPlant(stiff, Terrain.flat())
    longest = float(str(refused.value).split("at most ")[1].split(" s")[0])
    plant = RigidBodyPlant(stiff, Terrain.flat(), 0.99 * longest)
    plant.reset()
    plant.state = plant.state + np.array([0.0, 5e-3, *np.zeros(6)])
    before = plant.energy()
    plant.step(0.0, 0.05)
    assert plant.energy() < before + 1e-3
