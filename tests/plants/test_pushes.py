"""Pushes on the chassis: the impulse named arrives, its work is in the accounts, on both plants."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import HOLD, PLANTS, governor, momenta, placed

from jansen_env import ROBOTS, Payload, Robot, Terrain
from jansen_env.plants.batch import Batch
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.plants.trace import trace_forces
from jansen_env.tasks.walking import JansenWalkerEnv

FLYING = np.array([0.3, 50.0, 0.4, 2.0, 0.5, 1.0, 0.8, 3.0])
"""A state high above the ground, everything moving."""
IMPULSE = np.array([3.0, -1.5])  # N s
DURATION = 0.1  # s, of a push on the ground
BRIEF = 0.02  # s, of a push in flight
LADEN = replace(Robot(), payload=Payload(2.0, 0.1, (0.1, 0.2)))
DESIGNS = {"laden": LADEN, "built": ROBOTS["built"]()}  # the latter with a geared rotor


def half_sine(steps, impulse=IMPULSE):
    """(steps, 2) N s, a force that rises and falls as half a sine."""
    phase = np.linspace(0.0, math.pi, steps + 1)
    return np.outer(-0.5 * np.diff(np.cos(phase)), impulse)


def thrown(plant, momenta):
    """In flight without gravity: changes of the momenta in a push, and its arm x impulse."""
    plant.state = FLYING
    start = momenta(plant)
    moment = 0.0
    for impulse in half_sine(round(BRIEF / plant.time_step)):
        before = plant.state[:2] - momenta(plant)[2]
        result = plant.step(2.0, plant.time_step, pushes=impulse[None])
        assert result.push_work != 0.0
        x, y = 0.5 * (before + plant.state[:2] - momenta(plant)[2])  # at the middle of the step
        moment += x * impulse[1] - y * impulse[0]
    linear, angular, _ = momenta(plant)
    return linear - start[0], angular - start[1], moment


@pytest.mark.parametrize("design", DESIGNS)
def test_the_impulse_named_arrives(design):
    """In flight, linear momentum changes by it to 1e-7, and angular momentum by arm x impulse to
    second order.
    """
    errors = []
    for time_step in (1e-3, 5e-4):
        plant = placed(DESIGNS[design], time_step=time_step, gravity=0.0)
        linear, angular, moment = thrown(plant, momenta)
        assert linear == pytest.approx(IMPULSE, abs=1e-7)
        assert abs(moment) > 0.01
        errors.append(abs(angular - moment))
    assert errors[0] < 1e-5 and errors[0] / errors[1] > 3.0


def walk(plant, impulse):
    """A second near 1 rad/s with a push at 0.4 s, or with none: the results of all steps."""
    pushes = np.zeros((50, 20, 2))
    results = []
    pushes[20:25] = half_sine(100, impulse).reshape(5, 20, 2)
    for push in pushes:
        push = push if push.any() else None
        results.append(plant.step(governor(plant), HOLD, pushes=push))
    return results


@pytest.mark.parametrize("design, limit", [("laden", 8e-6), ("built", 4e-5)])
def test_accounts_close_with_pushes(design, limit):
    """As a share of the energy turned over, the residual is that of a fast walk without pushes, and
    larger where a light robot reels.
    """
    for push in ([0.0, 0.0], [6.0, 3.0], [-6.0, -3.0]):
        plant = placed(DESIGNS[design])
        results = walk(plant, push)
        turned = sum(abs(r.motor_work) + abs(r.push_work) + abs(r.energy_change) for r in results)
        assert sum(abs(r.energy_residual) for r in results) < limit * turned
        worked = sum(abs(r.push_work) for r in results)
        assert worked > 0.2 if any(push) else worked == 0.0


def test_plants_and_time_steps_agree_on_a_push():
    """A robot that stands on slippery ground ends in the same place with half the time step and on
    both backends.
    """
    ends = {}
    for name, plant in {
        "projection": ProjectionPlant(LADEN, Terrain.flat(0.3)),
        "half the time step": ProjectionPlant(LADEN, Terrain.flat(0.3), 5e-4),
        "rigid_body": RigidBodyPlant(LADEN, Terrain.flat(0.3)),
    }.items():
        plant.reset(0.0, 0.3)
        steps = round(DURATION / plant.time_step)
        results = [plant.step(1.0, DURATION, pushes=half_sine(steps, [12.0, 2.0]))]
        results.append(plant.step(1.0, DURATION))
        assert results[1].push_work == 0.0
        ends[name] = np.array([*plant.state[:4], results[0].push_work])
    expected = ends["half the time step"]
    assert expected[0] > 0.05 and expected[4] > 1.0
    assert ends["projection"] == pytest.approx(expected, rel=2e-3, abs=2e-4)
    assert ends["rigid_body"] == pytest.approx(expected, rel=2e-2, abs=1e-3)


def test_frames_carry_what_pushes_the_chassis():
    """In the joint forces of a trace, the chassis passes push, weight and motor torque on to the
    legs' frames.
    """
    plant = placed(tracing=True)
    pushes = half_sine(100, [6.0, 3.0])
    plant.step(2.0, DURATION, pushes=pushes)
    forces = trace_forces(plant.tables, plant.batch.trace, plant.time_step)
    frame = forces.frame.sum(axis=1)
    assert frame[:, :2] == pytest.approx(pushes / plant.time_step, abs=1e-8)
    assert frame[:, 2] == pytest.approx(-plant.batch.trace["torque"], abs=1e-4)
    assert forces.torque == pytest.approx(plant.batch.trace["torque"], abs=1e-4)


def test_robots_of_a_batch_are_pushed_one_by_one():
    """Each is pushed by its own row, bit for bit as alone; a delay and several looks for the ground
    continue.
    """
    robot = Robot()
    terrain = Terrain.flat()
    pushes = np.zeros((3, 40, 2))
    pushes[1] = half_sine(40)
    pushes[2, 25:] = IMPULSE / 15.0
    batch = Batch([robot] * 3, [terrain] * 3)
    batch.place_at(np.arange(3), np.zeros(3))
    torque = np.ones(3)
    earlier = np.zeros(3)
    switch = np.full(3, 5)
    batch.step(torque, 40, earlier, switch, pushes=pushes)
    for k in range(3):
        alone = Batch([robot], [terrain])
        alone.place_at(np.zeros(1, int), np.zeros(1))
        alone.step(torque[:1], 40, earlier[:1], switch[:1], pushes=pushes[[k]])
        assert alone.states.tobytes() == batch.states[k].tobytes()
        assert alone.accumulators["push_work"] == batch.accumulators["push_work"][k]
    assert len(set(batch.states[:, 0].tolist())) == 3


@pytest.mark.parametrize("plant", PLANTS)
def test_refused(plant):
    plant = PLANTS[plant](Robot(), Terrain.flat(), 1e-3)
    with pytest.raises(ValueError, match=r"pushes must have the shape \(20, 2\), got \(19, 2\)"):
        plant.step(0.0, 0.02, pushes=np.zeros((19, 2)))
    plant.reset()
    before = plant.state
    with pytest.raises(FloatingPointError):
        plant.step(0.0, 0.02, pushes=np.full((20, 2), math.nan))
    assert plant.state == pytest.approx(before, abs=1e-12)


def test_joint_forces_know_of_the_push_that_goes_on():
    """They are those that a control step of one time step finds."""
    env = JansenWalkerEnv(track_joint_forces=True, control_dt=1e-3, reset_noise_scale=0.0)
    env.reset(seed=0, options={"crank_angle": 1.0, "pushes": [(0.01, 2.0, 0.0)]})
    largest = []
    for _ in range(60):
        now = env.joint_forces().bearing.max()
        info = env.step(np.zeros(1))[4]
        if info["joint_impulse_max"] == 0.0:  # no toe has landed
            assert info["joint_force_max"] == pytest.approx(now)
            largest.append(now)
    assert max(largest) > 1.5 * largest[0] and len(largest) > 40
