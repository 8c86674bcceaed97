"""Play in the pins and backlash in the gear of the rigid-body plant."""

import math
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from motions import FLIGHT

from jansen_env import ROBOTS, Motor, Terrain
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.plants.rigid.bodies import SPIN, VX, VY
from jansen_env.plants.rigid.rigid_batch import PLAY_TIME_STEP
from jansen_env.scoring.benchmarks import can_be_batched

ENV = "JansenWalkerBuilt-v0"
BUILT = ROBOTS["built"]()
LIGHT = ROBOTS["paper_slender"]()
ROTOR = Motor(gear_ratio=30.0, rotor_inertia=2e-5)
GEARED = replace(LIGHT, motor=ROTOR)
BEYOND = 2e-5  # m, by which a pin may exceed its play; 9e-6 was measured at 0.1 mm
BACKLASH = math.radians(1.0)


def loose(robot=BUILT, play=3e-4, **arguments):
    """A plant on flat ground whose pins have play."""
    arguments = {"time_step": PLAY_TIME_STEP, "joint_play": play, **arguments}
    return RigidBodyPlant(robot, Terrain.flat(0.5), **arguments)


def momentum(plant):
    """Linear and angular momentum about the origin, the rotor included, shape (3,)."""
    space = plant.batch._space
    mass, inertia = space.inertias.T
    motion = space.snapshot().motion
    x, y, vx, vy = motion[:, 0], motion[:, 1], motion[:, VX], motion[:, VY]
    angular = mass @ (x * vy - y * vx) + inertia @ motion[:, SPIN]
    rotor = plant.batch._rotor
    if rotor is not None:
        angular += rotor.inertia * rotor.speed
    return np.array([mass @ vx, mass @ vy, angular])


def pin_gaps(plant):
    """Distance of the two ends of each pin, in m."""
    ends = plant.batch._space.snapshot().pins
    return np.hypot(*(ends[1] - ends[0]).T)


@pytest.mark.slow
@pytest.mark.parametrize("play", [1e-4, 5e-4])
def test_a_walk_keeps_pins_within_their_play(play):
    """Pins take up their play and exceed it by at most 0.02 mm; the account of energy is closed."""
    plant = loose(play=play)
    plant.reset(crank_angle=1.0)
    results = [plant.step(2.0 * (3.0 - plant.state[7]) + 0.6, 0.02) for _ in range(50)]
    gaps = np.array([result.joint_gap for result in results])
    assert 0.9 * play < gaps[1:].min() and gaps.max() < play + BEYOND
    assert plant.x > 0.1
    work = sum(result.motor_work for result in results)
    assert abs(sum(result.energy_residual for result in results)) < 2e-3 * work
    assert sum(result.joint_loss for result in results) > 0.0


def test_only_named_joints_have_play():
    """The pins of other joints and of the crank axis stay closed."""
    plant = loose(play={"A": 3e-4})
    plant.reset(crank_angle=1.0)
    plant.step(1.0, 0.02)
    pins = [None, *BUILT.linkage.moving_pins * len(BUILT.legs)]
    named = np.array([pin is not None and pin.joint == "A" for pin in pins])
    gaps = pin_gaps(plant)
    assert named.sum() == 2 * len(BUILT.legs)
    assert gaps[named].max() > 2e-4 > 5e-5 > gaps[~named].max()


def test_without_play_the_walk_is_the_same():
    """Zero play, by a number or by joint, and zero backlash: the same bits as by default."""
    ends = []
    for arguments in ({}, {"joint_play": 0.0, "backlash": 0.0}, {"joint_play": {"A": 0.0}}):
        plant = RigidBodyPlant(BUILT, Terrain.flat(), **arguments)
        plant.reset(crank_angle=1.0)
        plant.step(1.0, 0.02)
        ends.append(plant.state.tobytes())
    assert ends[0] == ends[1] == ends[2]


@pytest.mark.slow
def test_forces_at_rest_are_those_of_the_dense_equations():
    """Links hang from a fixed chassis: with a play of 10 um, forces of pins agree to 0.5 %."""
    locked = replace(LIGHT, motor=Motor(friction=1e3))  # the crank never turns
    state = np.array([0.0, 5.0, 0.0, 0.7, 0.0, 0.0, 0.0, 0.0])
    plant = loose(locked, 1e-5, fixed_chassis=True)
    plant.state = state
    plant.step(0.0, 0.2)
    plant.batch.tracing = True
    plant.step(0.0, plant.time_step)
    forces = plant.batch.pin_impulses[1:].reshape(len(locked.legs), -1) / plant.time_step
    exact = ProjectionPlant(LIGHT, Terrain.flat(), fixed_chassis=True)
    exact.state = state
    free, driven = (exact.batch.joint_forces(torque).q_ddot[3] for torque in (0.0, 1.0))
    still = exact.batch.joint_forces(free / (free - driven))
    assert abs(still.q_ddot[3]) < 1e-9
    pins = LIGHT.linkage.pins
    moving = [pins.index(pin) for pin in LIGHT.linkage.moving_pins]
    expected = np.hypot(*np.moveaxis(still.pin, -1, 0))[:, moving]
    assert expected.min() > 0.1
    np.testing.assert_allclose(forces, expected, rtol=5e-3)


@pytest.mark.parametrize("arguments", [{"play": 3e-4}, {"play": 0.0, "backlash": BACKLASH}])
def test_flight_keeps_momentum_and_gains_no_energy(arguments):
    """Without gravity and torque, impacts within the joints conserve momentum: 1e-9 of it."""
    plant = loose(GEARED, gravity=0.0, **arguments)
    plant.state = FLIGHT
    before = momentum(plant)
    energies = [plant.energy()]
    for _ in range(10):
        plant.step(0.0, 0.01)
        energies.append(plant.energy())
    np.testing.assert_allclose(momentum(plant), before, atol=1e-9 * np.abs(before).max())
    assert np.diff(energies).max() < 1e-4 * energies[0]
    assert energies[-1] < energies[0]


@pytest.mark.slow
def test_a_dropped_robot_gains_no_energy():
    """Without torque, a robot with play and backlash falls by 3 mm, lands and collapses.

    pymunk's integration of the free fall alone adds m g^2 h / 2 times the duration.
    """
    plant = loose(backlash=BACKLASH)
    plant.reset(crank_angle=1.0)
    plant.state = plant.state + np.array([0.0, 0.003, *np.zeros(6)])
    energies = [plant.energy()]
    for _ in range(30):
        plant.step(0.0, 0.005)
        energies.append(plant.energy())
    falling = 0.5 * BUILT.mass * 9.81**2 * plant.time_step * 0.005
    assert np.diff(energies).max() < 1.1 * falling
    assert energies[-1] < energies[0] - 0.05


def test_the_rotor_crosses_the_band_alone():
    """From rest the rotor needs sqrt(G^2 J b / tau) to reach the crank, which stands still."""
    plant = loose(GEARED, 0.0, gravity=0.0, fixed_chassis=True, backlash=BACKLASH, time_step=1e-4)
    plant.state = np.array([0.0, 5.0, 0.0, 0.7, 0.0, 0.0, 0.0, 0.0])
    torque = 0.2
    crossing = math.sqrt(ROTOR.gear_ratio**2 * ROTOR.rotor_inertia * BACKLASH / torque)
    plant.step(torque, 0.98 * crossing)
    rotor = plant.batch._rotor
    assert plant.state[3] == pytest.approx(0.7, abs=1e-12)
    turned = 0.5 * torque / ROTOR.gear_ratio / ROTOR.rotor_inertia * (0.98 * crossing) ** 2
    assert rotor.angle - ROTOR.gear_ratio * 0.7 == pytest.approx(turned, rel=0.02)
    plant.step(torque, 0.04 * crossing)
    assert plant.state[7] > 1e-3


@pytest.mark.slow
def test_the_crank_turns_freely_within_the_band():
    """Friction of the motor does not brake the crank in the band, but holds it at the ends."""
    robot = replace(LIGHT, motor=replace(ROTOR, friction=50.0))
    plant = loose(robot, 0.0, gravity=0.0, fixed_chassis=True, backlash=BACKLASH)
    speed = 0.5
    plant.state = np.array([0.0, 5.0, 0.0, 0.7, 0.0, 0.0, 0.0, speed])
    plant.batch._rotor.speed = 0.0
    plant.step(0.0, 0.4 * BACKLASH / speed)
    free = replace(LIGHT, motor=replace(ROTOR, rotor_inertia=0.0))
    alone = RigidBodyPlant(free, Terrain.flat(0.5), PLAY_TIME_STEP, 0.0, fixed_chassis=True)
    alone.state = np.array([0.0, 5.0, 0.0, 0.7, 0.0, 0.0, 0.0, speed])
    alone.step(0.0, 0.4 * BACKLASH / speed)
    assert plant.state[3] == pytest.approx(alone.state[3], abs=1e-9)
    for _ in range(20):
        plant.step(0.0, 0.02)
    assert abs(plant.state[3] - 0.7) < 0.5 * BACKLASH + 1e-3
    assert abs(plant.batch._rotor.speed) < 1e-6


@pytest.mark.slow
def test_backlash_transmits_the_mean_torque():
    """Under a steady torque a robot with backlash turns its crank as one without: 2 %."""
    ends = []
    for backlash in (0.0, BACKLASH):
        plant = loose(GEARED, 0.0, fixed_chassis=True, gravity=0.0, backlash=backlash)
        plant.state = np.array([0.0, 5.0, 0.0, 0.7, 0.0, 0.0, 0.0, 0.0])
        results = [plant.step(2.0, 0.02) for _ in range(25)]
        work = sum(result.motor_work for result in results)
        assert abs(sum(result.energy_residual for result in results)) < 0.01 * work
        ends.append(plant.state[3])
    assert ends[1] - 0.7 == pytest.approx(ends[0] - 0.7, rel=0.02)


def test_same_inputs_same_bits_and_copies():
    """Two plants walk alike, and a copy goes on as a plant that was set to the same state."""
    plants = [loose(backlash=BACKLASH) for _ in range(2)]
    for plant in plants:
        plant.reset(crank_angle=1.0)
        plant.step(2.0, 0.02)
    assert (plants[0].state == plants[1].state).all()
    copy = pickle.loads(pickle.dumps(plants[0]))
    assert copy.batch.joint_play == 3e-4 and copy.batch.backlash == BACKLASH
    plants[1].batch._memory = plants[0].batch._memory
    for plant in (copy, plants[1]):
        plant.step(2.0, 0.02)
    assert (copy.state == plants[1].state).all()


@pytest.mark.slow
def test_environments_alone_and_in_turns_are_the_same():
    """gym.make and gym.make_vec in sync mode, after the same seed."""
    arguments = {"plant": "rigid_body", "joint_play": 3e-4, "backlash": BACKLASH}
    assert not can_be_batched(ENV, arguments)
    alone = gym.make(ENV, **arguments)
    several = gym.make_vec(ENV, 2, vectorization_mode="sync", **arguments)
    seen, _ = alone.reset(seed=4)
    many, _ = several.reset(seed=4)
    assert alone.unwrapped.task.world.time_step == PLAY_TIME_STEP
    for _ in range(2):
        seen, _, _, _, info = alone.step(np.full(1, 0.3, np.float32))
        many, *_ = several.step(np.full((2, 1), 0.3, np.float32))
        np.testing.assert_array_equal(seen, many[0])
    assert info["joint_gap"] > 2e-4
    alone.close(), several.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"joint_play": 3e-4}, "joint_play must be 0 without plant='rigid_body', got 0.0003"),
        ({"backlash": 0.01}, "backlash must be 0 without plant='rigid_body', got 0.01"),
        ({"joint_play": {"A": 0.1}}, r"joint_play\['A'\] must be between 0.0 and 0.005, got 0.1"),
        ({"joint_play": {"Z": 0.0}, "plant": "rigid_body"}, "joint_play must .*'P'\\], got 'Z'"),
        (
            {"backlash": 0.01, "plant": "rigid_body", "motor": "ideal"},
            "backlash must be 0 for a motor without rotor_inertia, got 0.01",
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        gym.make(ENV, **arguments)


def test_a_robot_without_a_rotor_is_refused_at_a_reset():
    """After the refusal the environment goes on with its own robot."""
    env = gym.make(ENV, plant="rigid_body", backlash=BACKLASH).unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match="backlash must be 0 for a motor without rotor_inertia"):
        env.reset(options={"robot": replace(BUILT, motor=Motor())})
    assert env.robot.motor.rotor_inertia > 0.0
