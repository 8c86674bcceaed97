"""The worst that can be asked of contacts: no NaN, no crash, the law obeyed, nothing sinks in."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import HOLD, depth, governor, placed, shift

from jansen_env import ROBOTS, Leg, Payload, Robot, Terrain
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.plants.batch import Batch
from jansen_env.robot.kinematics import B, C, D, E, P, joint_positions

LEFT = 2e-5  # m, penetration that is left alone
SPIKE = ((-1.0, 0.0), (-0.05, 0.0), (0.0, 0.28), (0.05, 0.0), (1.0, 0.0))  # 80 degrees steep
GROOVE = ((-1.0, 1.5), (0.0, 0.0), (1.0, 1.5))
ROUGH = replace(Terrain.rough(np.random.default_rng(0), start=-5.0), friction=100.0)
HEAVY = replace(Robot(), payload=Payload(1000.0, 10.0, (0.0, 0.2)))
INERT = replace(Robot(), payload=Payload(1e-6, 1e3))
FLAT = Terrain.flat()
CASES = {  # robot, terrain, time step, sunk at the start, largest torque
    "friction 0": (Robot(), Terrain.flat(0.0), 1e-3, 0.0, 20.0),
    "friction 5": (Robot(), Terrain.flat(5.0), 1e-3, 0.0, 20.0),
    "friction 100": (Robot(), Terrain.flat(100.0), 1e-3, 0.0, 20.0),
    "friction 100 on rough ground": (Robot(), ROUGH, 1e-3, 0.0, 20.0),
    "restitution 1": (Robot(), Terrain.flat(restitution=1.0), 1e-3, 0.0, 20.0),
    "torque of 100 N m": (Robot(), FLAT, 1e-3, 0.0, 100.0),
    "time step 10 ms": (Robot(), FLAT, 1e-2, 0.0, 20.0),
    "time step 20 ms": (Robot(), FLAT, 2e-2, 0.0, 20.0),
    "payload of 1000 kg": (HEAVY, FLAT, 1e-3, 0.0, 200.0),
    "payload all inertia": (INERT, FLAT, 1e-3, 0.0, 20.0),
    "5 cm below the ground": (Robot(), FLAT, 1e-3, 0.05, 20.0),
    "on a spike": (Robot(), Terrain(SPIKE), 1e-3, 0.0, 20.0),
    "in a V-groove": (Robot(), Terrain(GROOVE), 1e-3, 0.0, 20.0),
    "in a V-groove, friction 5": (Robot(), Terrain(GROOVE, friction=5.0), 1e-3, 0.0, 20.0),
}


@pytest.mark.parametrize("name", CASES)
def test_contact_law_and_penetration(name, measured):
    """The robot is thrown from 5 cm and walks for 3 s: a toe touches down anywhere in a step, at up
    to 0.4 m/s.
    """
    robot, terrain, step, sunk, most = CASES[name]
    thrown = shift(y=-sunk or 0.05, vx=0.5)
    plant = placed(robot, terrain, moved=thrown, tracing=True, time_step=step)
    speed = 1e4 if most == 100.0 else 1.0
    residual = 0.0
    deepest = -math.inf
    landings = 0
    for k in range(150):
        result = plant.step(governor(plant, speed, most), HOLD)
        residual = max(residual, result.residual)
        landings = landings + plant.batch.touchdowns.sum()
        assert np.isfinite(plant.state).all() and np.isfinite(result.contact_force).all()
        assert (result.contact_force[:, 1] >= 0.0).all()
        if k >= 25:
            deepest = max(deepest, depth(plant))
    measured(f"contact law violated, {name}", residual / (robot.mass * GRAVITY * step), 2e-13)
    assert landings > 2
    measured(f"penetration, {name}", deepest, LEFT + 0.4 * 0.5 * step, "m")


@pytest.mark.parametrize("torque", [1e3, 1e5, 1e8, -1e8])
def test_absurd_torque_ends_in_a_plain_error(torque):
    """The state stays finite, or FloatingPointError says that it diverged: no NaN gets out."""
    plant = placed()
    diverged = False
    for _ in range(50):
        try:
            plant.step(torque, HOLD)
        except FloatingPointError:
            diverged = True
        assert np.isfinite(plant.state).all()
    assert diverged == (abs(torque) > 1e3)


def bounced(step):
    """Lost in 4 s of bouncing with e = 1, mean of six starts, and unaccounted for at worst."""
    ground = Terrain.flat(friction=0.0, restitution=1.0)
    lost = missed = 0.0
    for height in np.linspace(0.8, 0.9, 6):
        start = [0.0, height, 0.1, 0.3, 0.2, 0.0, 0.5, 0.0]
        plant = placed(None, ground, state=start, locked=True, time_step=step)
        start = plant.energy()
        results = [plant.step(0.0, HOLD) for _ in range(200)]
        losses = [result.impact_loss - result.correction_work for result in results]
        lost += abs(sum(losses)) / start / 6.0
        missed = max(missed, abs(plant.energy() - start + sum(losses)) / start)
    return lost, missed


def test_restitution_1_keeps_the_energy(measured):
    """Lifting a pad out of the ground adds energy of first order, accounted for to rounding."""
    coarse, missed = bounced(1e-3)
    fine, _ = bounced(2.5e-4)
    measured("bouncing with e = 1: energy lost in 4 s at 1 ms", coarse, 1e-3)
    measured("bouncing with e = 1: order lost of 1", 1.0 - math.log(coarse / fine, 4.0), 0.3)
    measured("bouncing with e = 1: energy unaccounted for", missed, 1e-12)


def farthest_outer_joint(plant):
    """Crank angle at which an outer joint is farthest from the crank axis, how far, and where."""
    best = (0.0, 0.0, 0.0)
    for leg in plant.robot.legs:
        for psi in np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False):
            joints = joint_positions(plant.robot, leg.side, psi + leg.phase)[[B, C, D, E, P]]
            far = int(np.argmax(np.hypot(*joints.T)))
            distance = float(np.hypot(*joints[far]))
            best = max(best, (distance, float(psi), math.atan2(joints[far, 1], joints[far, 0])))
    return best


def test_an_outer_joint_is_found_before_it_strikes(measured):
    """The farthest one first, straight down at 2.2 m/s: no deeper than v h / 2 after the impact.

    Found late it would be 2 cm deep (10 ms of falling), and be lifted all the way.
    """
    plant = placed(None, Terrain.flat(friction=0.0, restitution=1.0), locked=True)
    reach, psi, direction = farthest_outer_joint(plant)
    depth_allowed = math.hypot(2.0, math.sqrt(2.0 * GRAVITY * 0.06)) * 0.5 * plant.time_step
    gained = 0.0
    for extra in np.linspace(0.0, 0.02, 11):
        plant.state = [0, reach + 0.05 + extra, -0.5 * math.pi - direction, psi, 0, -2.0, 0, 0]
        start = plant.energy()
        assert plant.step(0.0, 0.1).non_toe_contact
        gained = max(gained, plant.energy() - start)
    share = gained / (plant.robot.mass * GRAVITY * depth_allowed)
    measured("farthest outer joint touches down: energy gained over m g v h / 2", share, 0.25)


@pytest.mark.parametrize("height", [5.0, 80.0])
def test_fast_touchdown(height, measured):
    """Dropped from 5 and 80 m, touching down at 10 and 40 m/s: nothing stays below the ground."""
    plant = placed(locked=True)
    deepest = 0.0
    for extra in np.linspace(0.0, 0.2, 8):
        plant.state = [0.0, height + 0.6 + extra, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0]
        plant.step(0.0, 4.0 + math.sqrt(2.0 * height / GRAVITY))
        deepest = max(deepest, depth(plant))
    measured(f"dropped from {height:g} m: penetration at rest", deepest, 2.0 * LEFT, "m")


LIGHT = ROBOTS["holy_slender"]()
REACH = np.array([1.0, 1.0, 0.8, 0.4])  # m, of toes: what rates make of their speed
FAST = {  # robot, largest torque
    "100 N m": (Robot(), 100.0),
    "slender, 100 N m": (LIGHT, 100.0),
    "slender, damping 0.01": (replace(LIGHT, damping=(0.01,) * 10), 20.0),
    "one leg, 60 N m": (replace(Robot(), legs=(Leg("fore"),)), 60.0),
    "one slender leg, 60 N m": (replace(LIGHT, legs=(Leg("fore"),)), 60.0),
}


SLOW = {"one leg, 60 N m": [pytest.mark.slow]}


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in FAST])
def test_fast_toes_do_not_tunnel(name, measured):
    """Full torque back and forth: no toe gets deeper in a step than it comes in one."""
    robot, torque = FAST[name]
    worst = lifted = 0.0
    for seed in range(2):
        rng = np.random.default_rng(seed)
        plant = placed(robot, psi=rng.uniform(0.0, 2.0 * math.pi))
        before = speed = now = 0.0
        for k in range(2000):
            if k % 20 == 0:
                now = torque * rng.choice([-1.0, -0.3, 0.3, 1.0])
            speed = max(0.999 * speed, float(np.abs(plant.state[4:]) @ REACH))
            result = plant.step(now, plant.time_step)
            given = -result.slip_loss - result.impact_loss
            lifted = max(lifted, given / plant.energy())
            deep = robot.pad_radius - float(plant.toe_positions()[:, 1].min())
            if deep > before:
                worst = max(worst, deep - before - plant.time_step * speed)
            before = max(deep, 0.0)
    measured(f"fast toes, {name}: depth gained in a step beyond its path", worst, 1e-4, "m")
    measured(f"fast toes, {name}: energy given back in a step over energy", lifted, 0.03)


def test_a_toe_deep_in_the_ground_is_found_again(measured):
    """20 cm below the ground, where no plane is near: it comes up at 1 m/s, and stays up."""
    plant = placed(moved=shift(y=-0.2))
    plant.step(0.0, 0.1)
    assert depth(plant) > 0.05
    plant.step(0.0, 1.0)
    measured("20 cm below the ground: penetration after 1.1 s", depth(plant), 2.0 * LEFT, "m")


def test_a_toe_too_deep_is_refused():
    """A metre below the ground: FloatingPointError, and all stays as it was."""
    plant = placed(tracing=True)
    state = plant.state + shift(y=-1.0)
    plant.step(0.0, 0.02)
    plant.state = state
    plant.batch.in_contact = np.ones(22, bool)
    with pytest.raises(FloatingPointError, match="a pad too deep in the ground"):
        plant.step(0.0, 0.1)
    assert (plant.state == state).all() and plant.batch.in_contact.all()
    assert len(plant.batch.trace) == len(plant.batch.touchdowns) == 0


def test_deep_toes_come_out_of_grooves(measured):
    """Put 5 to 30 cm into grooves 25 cm wide and 40 cm deep: 3 s later nothing is in the ground."""
    at = 0.125 * np.arange(-40, 41)
    ground = Terrain(tuple(zip(at, np.where(np.arange(81) % 2, -0.4, 0.0), strict=True)), 0.3)
    plant = placed(None, ground)
    deepest = 0.0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x, psi, sunk = rng.uniform([-0.2, 0.0, 0.05], [0.2, 2.0 * math.pi, 0.3])
        plant.reset(x, psi)
        plant.state = plant.state - shift(y=sunk)
        plant.step(0.0, 3.0)
        deepest = max(deepest, depth(plant))
    measured("put into grooves: penetration after 3 s", deepest, 1e-3, "m")


def test_deep_toes_move_alike_beside_others():
    """Put up to 40 cm into rough ground: the same alone and beside a fast robot, bit for bit."""
    x = np.arange(-5.0, 5.01, 0.1)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        ground = Terrain(tuple(zip(x, rng.uniform(-0.2, 0.2, len(x)), strict=True)), 0.5)
        state = placed(None, ground, rng.uniform(0.0, 6.0)).state - shift(y=rng.uniform(0.1, 0.4))
        state[4:6] = 3.0 * rng.normal(size=2)
        alone, beside = Batch([Robot()], [ground]), Batch([Robot()] * 2, [ground] * 2)
        for batch in (alone, beside):
            batch.set_mechanical_state(0, state)
        beside.set_mechanical_state(1, state + shift(y=3.0, vx=30.0))
        for _ in range(15):
            alone.step(np.zeros(1), 20)
            beside.step(np.zeros(2), 20)
            assert np.array_equal(alone.states[0], beside.states[0])
            assert alone.diverged[0] == beside.diverged[0]
