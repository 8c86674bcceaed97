"""The rigid-body plant against closed forms, dense equations, and the projection plant."""

import pickle
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from motions import pinned, walked

from jansen_env import ROBOTS, Payload, Robot, Terrain, paper_robot
from jansen_env.dynamics.reduced import compile_robot, energy, mass_matrix
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.plants.rigid.rigid_batch import TIME_STEP
from jansen_env.robot.kinematics import world_joints

FLYING = np.array([0.3, 5.0, 0.2, 1.1, 0.4, 1.0, -0.7, 2.0])
"""A state high above the ground, everything moving."""


def plant_on(terrain=None, robot=None, **arguments):
    """The paper's machine on flat ground, or another."""
    return RigidBodyPlant(robot or paper_robot(), terrain or Terrain.flat(), **arguments)


def test_bodies_have_the_robots_inertia(robot):
    """Kinetic energy of the bodies = q_dot M q_dot / 2 of the projected equations: 1e-8 of it."""
    heavy = Payload(1.3, 0.2, (0.1, 0.2))
    robot = Robot(**{**robot.__dict__, "payload": heavy})
    plant, tables = plant_on(robot=robot, gravity=0.0), compile_robot(robot)
    for psi in np.linspace(0.0, 6.0, 7):
        state = FLYING.copy()
        state[3] = psi
        plant.state = state
        q, v = state[:4], state[4:]
        assert plant.energy() == pytest.approx(0.5 * v @ mass_matrix(tables, q) @ v, rel=1e-8)
        plant.gravity = 9.81
        assert plant.energy() == pytest.approx(energy(tables, q, v), rel=1e-8)
        plant.gravity = 0.0


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


@pytest.mark.parametrize(
    "name", sorted({*ROBOTS} - {"climber"})
)  # which drops, its crank giving way
@pytest.mark.parametrize("phases", [1, 2, 6])
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
    torque = 3.0 if robot.pad_compliance.rigid else 1.0
    results = [plant.step(torque, 0.2) for plant in plants]
    one, other = (plant.state for plant in plants)
    np.testing.assert_allclose(one[:2], other[:2], atol=5e-4)
    np.testing.assert_allclose(one[2:4], other[2:4], atol=4e-3)
    assert results[0].joint_gap < 2e-4 and results[1].joint_gap == 0.0


@pytest.mark.parametrize("speed, friction", [(1.0, 0.5), (3.5, 0.3)])
def test_a_walk_keeps_joints_shut_and_accounts_closed(speed, friction):
    """Gaps below 0.2 mm; toes carry the weight; motor work = losses + energy change, 0.1 %."""
    plant = plant_on(Terrain.flat(friction))
    plant.reset()
    results = walked(plant, speed, 2.0)
    assert 0.0 < max(r.joint_gap for r in results) < 2e-4
    load = np.mean([r.contact_force[:, 1].sum() for r in results])
    assert load == pytest.approx(paper_robot().mass * 9.81, rel=0.02)
    work = sum(r.motor_work for r in results)
    assert abs(sum(r.energy_residual for r in results)) < 0.001 * work
    assert speed < 2.0 or sum(r.slip_loss for r in results) > 0.01 * work


def test_pinned_it_follows_the_pinned_plant():
    """Swinging free from 3 rad/s: within 2e-4 rad, half of that with half the time step."""
    apart = []
    for step in (TIME_STEP, 0.5 * TIME_STEP):
        plant = RigidBodyPlant(paper_robot(), Terrain.flat(), step, held=True)
        plant.state = np.array([0.0, 5.0, 0.0, 0.5, 0.0, 0.0, 0.0, 3.0])  # clear of the ground
        exact = pinned(paper_robot(), 0.5, 3.0)
        angles = []
        for _ in range(25):
            exact.step(0.0, 0.02)
            plant.step(0.0, 0.02)
            angles.append((plant.state[3], exact.state[3]))
        np.testing.assert_allclose(plant.state[:3], [0.0, 5.0, 0.0], atol=1e-12)
        assert np.ptp(angles) > 0.5
        apart.append(np.abs(np.diff(angles)).max())
    assert apart[0] < 2e-4 and apart[1] == pytest.approx(0.5 * apart[0], rel=0.05)


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
for _ in range(20):
    result = plant.step(rng.uniform(-10.0, 15.0), 0.02)
print(plant.state.tobytes().hex(), result.slip.tobytes().hex())
"""


def test_same_inputs_same_bits_in_another_process():
    """Pymunk's order of bodies is that of pointers; nothing of it reaches the result."""
    runs = [
        subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert runs[0].stdout == runs[1].stdout


def test_set_down_again_or_pickled_nothing_is_remembered():
    """After reset or setting a state the future is that of a new plant, bit for bit."""
    plant = plant_on()
    plant.reset()
    walked(plant, 2.0, 0.5)
    copy, fresh = pickle.loads(pickle.dumps(plant)), plant_on()
    fresh.state, fresh.in_contact = plant.state, plant.in_contact
    for _ in range(5):
        copy.step(1.0, 0.02), fresh.step(1.0, 0.02)
        assert (copy.state == fresh.state).all() and (copy.in_contact == fresh.in_contact).all()
    before, in_contact = plant.state, plant.in_contact
    assert in_contact.any()
    plant.lookahead(3.0)
    np.testing.assert_allclose(plant.state, before, atol=1e-9)
    assert (plant.in_contact == in_contact).all()
    fresh = plant_on()
    for other in (plant, fresh):
        other.reset(crank_angle=0.4)
        other.step(2.0, 0.1)
    assert (plant.state == fresh.state).all()


def test_the_task_is_the_same():
    """Spaces, keys of info and the start agree with the default plant's."""
    one, other = (gym.make("JansenWalker-v0", plant=name) for name in ("rigid_body", "projection"))
    (seen, info), (expected, known) = one.reset(seed=3), other.reset(seed=3)
    assert one.observation_space == other.observation_space
    assert info.keys() == known.keys() and info["energy"].keys() == known["energy"].keys()
    np.testing.assert_allclose(seen, expected, atol=0.03)
    for _ in range(5):
        action = np.array([0.2], np.float32)
        _, reward, *_, info = one.step(action)
        *_, known = other.step(action)
    assert info.keys() == known.keys() and known["joint_gap"] == 0.0 < info["joint_gap"] < 2e-4
    assert info["x_position"] == pytest.approx(known["x_position"], abs=3e-3)
    factors = [value for name, value in info.items() if name.startswith("reward/")]
    assert reward == pytest.approx(np.prod(factors), rel=1e-12)
    assert one.unwrapped.plant.time_step < other.unwrapped.plant.time_step
