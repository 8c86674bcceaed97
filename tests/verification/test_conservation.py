"""Energy, momentum and Galilean invariance: what mechanics keeps, the time step keeps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import DESIGNS, FLIGHT, HOLD, SPRINGS, audit, governor, momenta, placed, shift

from jansen_env import Payload, Robot, Terrain
from jansen_env.dynamics.gravity import GRAVITY

THROWN = np.array([0.0, 0.8, 2.0, 0.3, 1.0, 0.0, 3.0, 0.0])  # near the ground, on its back
DROPPED = shift(y=0.8, pitch=0.1, psi=0.3)
SLIDE = Terrain.slope(0.4, friction=0.2)
LADEN = replace(Robot(), payload=Payload(5.0, 0.2, (0.1, 0.2)))
SPRUNG = Robot(springs=SPRINGS)
ROUGH = Terrain.rough(np.random.default_rng(0), start=-5.0)
BOUNCY = Terrain.flat(restitution=0.5)
loads = pytest.mark.parametrize("robot", [Robot(), LADEN, SPRUNG], ids=["paper", "laden", "sprung"])


def held(torque):
    """The same torque, N m, whatever happens."""
    return lambda plant: torque


def walking(speed):
    """The torque that holds the crank near ``speed`` rad/s."""
    return lambda plant: governor(plant, speed)


# Each motion with the error allowed at 1 ms, relative to the energy turned over.
MOTIONS = {
    "flight": (held(2.0), 1.0, dict(state=FLIGHT), 2e-6),
    "standing": (held(0.0), 2.0, {}, 4e-12),
    "sliding, crank locked": (held(0.0), 1.0, dict(terrain=SLIDE, locked=True), 2e-13),
    "slow walk": (walking(0.5), 4.0, {}, 2e-6),
    "fast walk": (walking(4.0), 4.0, {}, 8e-6),
    "walk uphill": (walking(1.0), 4.0, dict(terrain=Terrain.slope(0.1)), 2e-6),
    "walk downhill": (walking(1.0), 4.0, dict(terrain=Terrain.slope(-0.1)), 2e-6),
    "walk on rough ground": (walking(1.0), 4.0, dict(terrain=ROUGH), 1e-6),
    "walk with payload": (walking(1.0), 4.0, dict(robot=LADEN), 3e-6),
    "flight with springs": (held(2.0), 1.0, dict(robot=SPRUNG, state=FLIGHT), 2e-6),
    "walk with springs": (walking(1.0), 4.0, dict(robot=SPRUNG), 6e-6),
    "walk with springs on rough ground": (
        walking(1.0),
        4.0,
        dict(robot=SPRUNG, terrain=ROUGH),
        3e-6,
    ),
    "walk, restitution 0.5": (walking(1.0), 4.0, dict(terrain=BOUNCY), 1e-5),
    "dropped, restitution 0.5": (held(0.0), 2.0, dict(terrain=BOUNCY, state=DROPPED), 2e-5),
    "tumbling on outer joints": (held(0.0), 3.0, dict(state=THROWN), 6e-5),
    "tumbling, crank locked": (held(0.0), 3.0, dict(state=THROWN, locked=True), 1e-7),
}


def unaccounted(time_step, law, duration, placing):
    """Energy not accounted for, and turned over (at least m g times 0.1 m), J."""
    plant = placed(**placing, time_step=time_step)
    missed, turned, _ = audit(plant, law, duration)
    return missed, max(turned, 0.1 * plant.robot.mass * GRAVITY)


@pytest.mark.parametrize("name", MOTIONS)
def test_energy_audit(name, measured):
    """Motor work is joint, slip and impact loss plus the change of energy, step by step at 1 ms."""
    *arguments, limit = MOTIONS[name]
    missed, turned = unaccounted(1e-3, *arguments)
    measured(f"energy unaccounted for, {name}", missed / turned, limit)


ORDERS = {  # of the energy error: the midpoint rule's between impacts, the impacts' elsewhere
    "flight": (2.0, 0.01),
    "flight with springs": (2.0, 0.01),
    "walk with springs": (1.0, 0.3),
    "slow walk": (1.0, 0.3),
    "walk on rough ground": (1.0, 0.3),
    "fast walk": (1.0, 0.3),
    "dropped, restitution 0.5": (1.0, 0.3),
    "tumbling on outer joints": (1.0, 0.3),
}


@pytest.mark.parametrize("name", ORDERS)
def test_energy_error_falls_with_the_time_step(name, measured):
    """Between 2 and 0.25 ms the order is 2 in smooth motion, and 1 with impacts, whose error
    scatters.
    """
    order, lost = ORDERS[name]
    coarse, fine = (unaccounted(step, *MOTIONS[name][:3])[0] for step in (2e-3, 2.5e-4))
    fitted = math.log(coarse / fine) / math.log(8.0)
    measured(f"energy error's order lost of {order:.0f}, {name}", order - fitted, lost)


@loads
@pytest.mark.parametrize("velocity", [(7.0, 3.0), (-20.0, 15.0)])
def test_galilean_invariance_in_flight(robot, velocity, measured):
    """Thrown or not, pitch, crank angle and rates are the same, and the centres are V t apart."""
    rest = placed(robot, state=FLIGHT)
    moving = placed(robot, state=FLIGHT + shift(vx=velocity[0], vy=velocity[1]))
    inside = outside = 0.0
    for k in range(1, 51):
        torque = 3.0 * math.sin(0.7 * k)
        rest.step(torque, HOLD)
        moving.step(torque, HOLD)
        apart = moving.state - rest.state
        inside = max(inside, np.abs(apart[[2, 3, 6, 7]]).max())
        outside = max(outside, np.abs(apart[:2] - HOLD * k * np.array(velocity)).max())
        outside = max(outside, np.abs(apart[4:6] - velocity).max())
    measured("Galilean invariance: internal motion in 1 s", inside, 1e-13, "rad, rad/s")
    measured("Galilean invariance: place less V t in 1 s", outside, 2e-12, "m, m/s")


@loads
def test_parabola_and_momentum_in_flight(robot, measured):
    """Under any crank torque c(t) is c + v t - g t^2 / 2 and p(t) is p - m g t, at every look in 1
    s.
    """
    plant = placed(robot, state=FLIGHT)
    p, _, c = momenta(plant)
    worst_c = worst_p = 0.0
    for k in range(1, 51):
        plant.step(6.0 * math.sin(0.7 * k), HOLD)
        t = HOLD * k
        p_now, _, c_now = momenta(plant)
        fallen = p / robot.mass * t - [0.0, 0.5 * GRAVITY * t * t]
        worst_c = max(worst_c, np.abs(c_now - c - fallen).max())
        worst_p = max(worst_p, np.abs(p_now - p + [0.0, robot.mass * GRAVITY * t]).max())
    measured("flight: centre of mass off its parabola in 1 s", worst_c, 1e-12, "m")
    measured("flight: momentum off p - m g t in 1 s", worst_p, 2e-12, "N s")


def spin_drift(robot, time_step):
    """Largest change of the spin about the centre of mass in 0.5 s of changing torque, N m s."""
    plant = placed(robot, state=FLIGHT, time_step=time_step)
    _, spin, _ = momenta(plant)
    drift = 0.0
    for k in range(25):
        plant.step(6.0 * math.sin(0.7 * k), HOLD)
        drift = max(drift, abs(momenta(plant)[1] - spin))
    return drift / abs(spin)


@loads
def test_crank_torque_cannot_spin_it_up_in_flight(robot, measured):
    """Motor torque is internal: the spin is kept to the step's error, which is of second order."""
    steps = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    drift = np.array([spin_drift(robot, step) for step in steps])
    order = np.polyfit(np.log(steps), np.log(drift), 1)[0]
    measured("flight: spin's relative drift in 0.5 s at 1 ms", drift[2], 2e-6)
    measured("flight: spin's drift, order lost of 2", 2.0 - order, 0.01)


designs = pytest.mark.parametrize("name", DESIGNS)


def wild(plant, rng):
    """A random torque, for each leg up to a quarter of the motor's limit."""
    return rng.uniform(-0.25, 0.25) * plant.robot.motor.torque_limit * len(plant.robot.legs)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(DESIGNS.keys() - {"weekend"}))  # its gear hardly turns
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_smooth_ground_cannot_push_it_along(name, restitution, rng, measured):
    """With mu = 0, horizontal momentum keeps its value through touchdowns, falls and random
    torques.
    """
    plant = placed(DESIGNS[name], Terrain.flat(0.0, restitution), moved=shift(vx=0.5))
    start = momenta(plant)[0][0]
    error = most = 0.0
    landed = 0
    for _ in range(150):
        result = plant.step(wild(plant, rng), HOLD)
        error = max(error, abs(momenta(plant)[0][0] - start))
        most = max(most, np.abs(result.contact_force[:, 0]).max())
        landed += result.impact_loss > 1e-3  # J
    assert landed > 5 and np.abs(plant.state[4:]).max() > 0.1
    measured("momentum gained, relative", error / abs(start), 1e-14)
    measured("tangential force", most, 0.0, "N")


@pytest.mark.slow
@designs
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_rough_ground_accounts_for_all_momentum(name, restitution, rng, measured):
    """Normals change within a hold; the trace has the impulses on toes and outer joints
    together.
    """
    ground = replace(Terrain.rough(np.random.default_rng(1), start=-20.0), restitution=restitution)
    plant = placed(DESIGNS[name], ground, tracing=True)
    weight = np.array([0.0, -plant.robot.mass * GRAVITY])
    error = change_most = 0.0
    for _ in range(80):
        before = momenta(plant)[0]
        plant.step(wild(plant, rng), HOLD)
        impulses = plant.batch.trace["impulses"]
        change = momenta(plant)[0] - before
        total = impulses[:, :, :2].sum(axis=(0, 1)) + weight * HOLD
        error = max(error, np.abs(change - total).max())
        change_most = max(change_most, np.abs(change).max())
        if abs(plant.state[2]) > 1.2:
            plant.reset(0.0, rng.uniform(0.0, 2.0 * math.pi))
    assert change_most > 0.02 * plant.robot.mass
    measured("momentum not accounted for on rough ground", error, 3e-14, "N s")
