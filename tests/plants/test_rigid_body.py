"""The rigid-body plant against closed forms, dense equations, and the projection plant."""

import math
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from motions import pull, runge_kutta, walked

from jansen_env import ROBOTS, Motor, Payload, Robot, Terrain, paper_robot
from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.dynamics.reduced import compile_robot, energy, mass_matrix
from jansen_env.plants.base import static_deflection
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.robot import JANSEN, Compliance
from jansen_env.robot.kinematics import coordinates, world_joints

FLYING = np.array([0.3, 5.0, 0.2, 1.1, 0.4, 1.0, -0.7, 2.0])
"""A state high above the ground, everything moving."""
LIGHT = ROBOTS["paper_slender"]()
ROTOR = Motor(gear_ratio=30.0, rotor_inertia=2e-5, friction=0.1, viscous_friction=0.05)
DRY = (0.01, 0.02, 0.03, 0.04, 0.05, 0.04, 0.03, 0.02, 0.01, 0.05)
GIVE = Compliance(2e4, 50.0, 1.5e4, 40.0)
LOCKED = replace(LIGHT, motor=Motor(friction=1e3), pad_compliance=GIVE)
"""Its crank never turns: a rigid body on springs."""
UPRIGHT = 0.5 * math.pi  # rad, the crank angle at which fore and back legs are mirror images


def plant_on(terrain=None, robot=None, **arguments):
    """The paper's machine on flat ground, or another."""
    return RigidBodyPlant(robot or paper_robot(), terrain or Terrain.flat(), **arguments)


@pytest.mark.slow
def test_bodies_have_the_robots_inertia(robot):
    """Kinetic energy of the bodies = q_dot M q_dot / 2 of the projected equations: 1e-8 of it."""
    heavy = Payload(1.3, 0.2, (0.1, 0.2))
    robot = Robot(**{**robot.__dict__, "payload": heavy})
    plants, tables = [plant_on(robot=robot, gravity=g) for g in (0.0, 9.81)], compile_robot(robot)
    for psi in np.linspace(0.0, 6.0, 7):
        state = FLYING.copy()
        state[3] = psi
        for plant in plants:
            plant.state = state
        q, v = state[:4], state[4:]
        assert plants[0].energy() == pytest.approx(0.5 * v @ mass_matrix(tables, q) @ v, rel=1e-8)
        assert plants[1].energy() == pytest.approx(energy(tables, q, v), rel=1e-8)


def test_pins_meet_where_the_joints_are(robot):
    """Both ends of every pin and every toe stand at the joint of the linkage: 1e-12 m."""
    plant = plant_on(robot=robot)
    plant.state = FLYING
    joints = world_joints(robot, FLYING[:4]).reshape(-1, 2)
    for pin in plant.batch._space.pins:
        a, b = pin.a.local_to_world(pin.anchor_a), pin.b.local_to_world(pin.anchor_b)
        assert (a - b).length < 1e-12
        assert np.hypot(*(joints - np.array(a)).T).min() < 1e-12
    tracked = ProjectionPlant(robot, Terrain.flat())
    tracked.state = FLYING
    np.testing.assert_allclose(plant.toe_positions(), tracked.toe_positions(), atol=1e-9)


DROP = "climber", "hiker"  # their crank gives way
STANDING = [(name, 2) for name in ROBOTS if name not in DROP]
STANDING += [(name, phases) for name in ("paper", "built", "klann") for phases in (1, 6)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "phases"), STANDING)
def test_it_stands_and_starts_like_the_projection_plant(name, phases):
    """2, 4 and 12 legs: toes carry the weight; 0.2 s under torque lead to the same place."""
    robot = ROBOTS[name](phases)
    ground = Terrain.flat(friction=0.3)  # with much friction sliding on two toes is unstable
    plants = plant_on(ground, robot), ProjectionPlant(robot, ground)
    for plant in plants:
        plant.reset(crank_angle=0.7)
    if phases > 1:  # two legs cannot stand
        weight = robot.mass * 9.81
        share = 0.02 if robot.pad_compliance.rigid else 0.1  # the crank is free to give way
        carried = [plant.lookahead().contact_force[:, 1].sum() for plant in plants]
        assert carried[0] == pytest.approx(weight, rel=share)
        if robot.pad_compliance.rigid:
            assert carried[0] == pytest.approx(carried[1], rel=0.005)
    torque = 3.0 if robot.pad_compliance.rigid else min(1.0, 0.2 * robot.mass)
    results = [plant.step(torque, 0.2) for plant in plants]
    rigid, other = (plant.state for plant in plants)
    np.testing.assert_allclose(rigid[:2], other[:2], atol=5e-4)
    np.testing.assert_allclose(rigid[2:4], other[2:4], atol=4e-3)
    assert results[0].joint_gap < 2e-4 and results[1].joint_gap == 0.0


WALKS = {  # robot, speed of the crank, rad/s, friction, N m s by which the crank is held
    "slow": (paper_robot(), 1.0, 0.5, 10.0),
    "fast": (paper_robot(), 3.5, 0.3, 10.0),
    "motor": (replace(LIGHT, motor=replace(
        ROTOR, stall_torque=15.0, no_load_speed=20.0, efficiency=0.8)), 3.0, 0.5, 0.8),
    "all": (replace(LIGHT, motor=ROTOR, bearing_friction=DRY, pad_compliance=GIVE), 3.0, 0.5, 0.8),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", WALKS)
def test_a_walk_keeps_joints_shut_and_accounts_closed(name):
    """Gaps below 0.2 mm; toes carry the weight; motor work = losses + energy change, 0.1 %."""
    robot, speed, friction, gain = WALKS[name]
    plant, results = plant_on(Terrain.flat(friction), robot), []
    plant.reset()
    for _ in range(70):
        results.append(plant.step(gain * (speed - plant.state[7]) + 1.2 * speed, 0.02))
    assert 0.0 < max(r.joint_gap for r in results) < 2e-4
    load = np.mean([r.contact_force[:, 1].sum() for r in results])
    assert load == pytest.approx(robot.mass * 9.81, rel=0.03)
    work = sum(r.motor_work for r in results)
    assert abs(sum(r.energy_residual for r in results)) < 0.001 * work
    assert sum(r.electrical_work for r in results) >= 0.999999 * work
    assert name != "fast" or sum(r.slip_loss for r in results) > 0.01 * work


@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_slip_and_friction_are_those_of_coulomb(friction):
    """Sliding down a slope of 0.4: t = -mu n, heat mu n times slip; slip as on the other, 2 %."""
    ground = Terrain.slope(0.4, friction=friction)
    plants = plant_on(ground), ProjectionPlant(paper_robot(), ground)
    slips = []
    for plant in plants:
        plant.reset(crank_angle=0.3)
        plant.step(0.0, 0.1)  # from here on it slides
        result = plant.step(0.0, 0.15)
        slips.append(result.slip)
        loaded = result.contact_force[:, 1] > 1.0
        assert plant.x < 0.0 and loaded.sum() == 2
        tangential, normal = result.contact_force[loaded].T
        assert tangential == pytest.approx(friction * normal, rel=1e-9)  # uphill, +x
        work = friction * 0.5 * normal.sum() * result.slip[loaded].sum()
        assert result.slip_loss == pytest.approx(work, rel=0.15)  # loads are not constant
    assert slips[0] == pytest.approx(slips[1], rel=0.02, abs=1e-4)


RUN = """
import numpy as np
from jansen_env import Terrain, paper_robot
from jansen_env.plants.plant import RigidBodyPlant
plant = RigidBodyPlant(paper_robot(), Terrain.rough(np.random.default_rng(0), start=0.1))
plant.reset()
rng = np.random.default_rng(1)
for _ in range(8):
    result = plant.step(rng.uniform(-10.0, 15.0), 0.02)
print(plant.state.tobytes().hex(), result.slip.tobytes().hex())
"""


def test_same_inputs_same_bits_in_another_process():
    """Pymunk's order of bodies is that of pointers; nothing of it reaches the result."""
    first, second = (subprocess.check_output([sys.executable, "-c", RUN]) for _ in range(2))
    assert first == second


def test_joints_that_touch_the_ground_are_no_toes():
    """Dropped on its back, at the same moment as on the projection plant."""
    touched = []
    for make in (ProjectionPlant, RigidBodyPlant):
        plant = make(Robot(), Terrain.flat())
        plant.state = np.array([0.0, 0.42, math.pi, 0.3, 0.0, 0.0, 0.0, 0.0])
        results = [plant.step(0.0, 0.02) for _ in range(11)]
        assert not any(result.contact_force.any() for result in results)
        touched.append([bool(result.non_toe_contact) for result in results])
    assert touched[0] == touched[1] == [False] * 10 + [True]


@pytest.mark.slow
def test_set_down_again_or_pickled_nothing_is_remembered():
    """After reset or setting a state the future is that of a new plant, bit for bit."""
    plant = plant_on()
    plant.reset()
    walked(plant, 2.0, 0.3)
    copy, fresh = pickle.loads(pickle.dumps(plant)), plant_on()
    fresh.state, fresh.batch.in_contact = plant.state, plant.batch.in_contact.copy()
    for _ in range(5):
        copy.step(1.0, 0.02), fresh.step(1.0, 0.02)
        assert (copy.state == fresh.state).all()
        assert (copy.batch.in_contact == fresh.batch.in_contact).all()
    before, in_contact = plant.state, plant.batch.in_contact.copy()
    assert in_contact.any()
    plant.lookahead(3.0)
    np.testing.assert_allclose(plant.state, before, atol=1e-9)
    assert (plant.batch.in_contact == in_contact).all()
    fresh = plant_on()
    for other in (plant, fresh):
        other.reset(crank_angle=0.4)
        other.step(2.0, 0.1)
    assert (plant.state == fresh.state).all()


def dense(robot, state, torque, duration, steps=100):
    """The paper's equations with these parts, by Runge-Kutta: the state after a flight."""

    def rate(state):
        q, v = np.split(state, 2)
        return np.concatenate([v, joint_forces(robot, q, v, torque).q_ddot])

    return runge_kutta(rate, state, duration / steps, steps)[-1]


FREE = replace(ROTOR, friction=0.0, viscous_friction=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("motor, friction", [(FREE, LIGHT.bearing_friction), (ROTOR, DRY)])
def test_flight_is_that_of_the_dense_equations(motor, friction):
    """0.1 s in the air under 1 N m: 1e-3 of the angles turned, half of it at half the time step."""
    robot, misses = replace(LIGHT, motor=motor, bearing_friction=friction), []
    exact = dense(robot, FLYING, 1.0, 0.1)
    for time_step in (2.5e-4, 1.25e-4):
        plant = plant_on(robot=robot, time_step=time_step)
        plant.state = FLYING
        plant.step(1.0, 0.1)
        misses.append(np.abs(plant.state - exact)[2:4].max())
    assert misses[0] < 1e-3 * np.abs(exact - FLYING)[2:4].max()
    assert misses[1] < 0.6 * misses[0]


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 1.0, 2.2])
def test_dry_friction_holds_at_a_standstill(angle):
    """Up to sum tau_i |a_j' - a_i'| + the gear's the crank does not turn; 2 % above it does."""
    robot = replace(LIGHT, bearing_friction=DRY, motor=Motor(friction=0.15))
    plant = RigidBodyPlant(robot, Terrain.flat(), gravity=0.0, fixed_chassis=True)
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
    np.testing.assert_allclose(plant.state[:3], rest[:3], atol=1e-12)  # it is held


@pytest.mark.parametrize("feet", [Compliance(), GIVE])
def test_a_fixed_chassis_hangs_in_the_air_wherever_the_ground_is(feet):
    """The pads do not touch the ground, as in the projection plant."""
    robot = replace(LIGHT, pad_compliance=feet)
    ends = []
    for height in (0.0, 5.0):
        plant = RigidBodyPlant(robot, Terrain.flat(), fixed_chassis=True)
        plant.state = np.array([0.0, height, 0.0, 1.0, 0.0, 0.0, 0.0, 3.0])
        assert (plant.step(2.0, 0.05).contact_force == 0.0).all()
        ends.append(plant.state[[3, 7]])
    np.testing.assert_allclose(*ends, rtol=1e-9)


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
    fast = RigidBodyPlant(replace(LIGHT, motor=motor), Terrain.flat(), fixed_chassis=True)
    fast.state = np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 7.0])
    result = fast.step(3.0, fast.time_step)
    speed = 0.5 * (7.0 + fast.state[7])
    assert result.motor_work == pytest.approx(0.5 * speed * fast.time_step, rel=1e-6)
    drawn = float(motor.electrical_power(0.5, speed)) * fast.time_step
    assert result.electrical_work == pytest.approx(drawn, rel=1e-6)


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


@pytest.mark.slow
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
    sunk = heights[during]
    wanted = np.interp(times[during], t, exact, left=0.0)
    close = times[during] > 1e-3
    assert np.abs(sunk - wanted)[close].max() < 0.01 * np.abs(exact).max()
    assert plant.step(0.0, 1e-3).joint_gap < 2e-4


def pulled(share, friction=0.5):
    """The plant of a standing, locked robot after 0.1 s of a pull of ``share`` of its weight."""
    plant = RigidBodyPlant(LOCKED, Terrain.flat(friction=friction))
    plant.reset(crank_angle=UPRIGHT, pitch=0.0)
    plant.step(0.0, 0.5)
    pull(plant, share * 9.81)
    plant.step(0.0, 0.1)
    return plant


@pytest.mark.slow
def test_bristles_slide_with_coulombs_friction():
    """Under a pull beyond friction's reach: (pull - mu sum n) / m, 0.1 %; heat for each metre."""
    plant = pulled(0.3, friction=0.2)

    def speed():
        space = plant.batch._space
        return space.inertias[:, 0] @ space.snapshot().motion[:, 3] / LOCKED.mass

    before = speed()
    result = plant.step(0.0, 0.1)
    normal = result.contact_force[:, 1].sum()
    expected = 0.3 * 9.81 - 0.2 * normal / LOCKED.mass
    assert (speed() - before) / 0.1 == pytest.approx(expected, rel=1e-3)
    heat = 0.2 * result.contact_force[:, 1] @ result.slip
    assert result.slip_loss == pytest.approx(heat, rel=0.02) and heat > 0.1


@pytest.mark.slow
def test_bristles_are_remembered():
    """By a lookahead, which changes nothing, and a copy; a state that is set has none."""
    plant = pulled(0.05)
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
    """It names the longest and the pads' data."""
    with pytest.raises(
        ValueError, match=r"time_step must be at most .* of 20000 N/m .* got 0\.003"
    ):
        RigidBodyPlant(LOCKED, Terrain.flat(), 3e-3)
