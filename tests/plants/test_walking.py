"""The robot walking, at rest and on its back: contact law, energy, distance, on all grounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from walks import HOLD, placed, walked

from jansen_env import ROBOTS, Terrain
from jansen_env.gravity import GRAVITY
from jansen_env.robot.kinematics import joint_positions

FALLEN = 1.2  # rad of pitch


def walk(plant, speed, duration):
    """Hold the crank near a speed; the results of all steps, all on toes."""
    results = walked(plant, speed, duration)
    assert not any(result.non_toe_contact for result in results)
    return results


@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_it_walks_the_way_its_crank_turns(speed):
    """Half a metre in 10 s at least, either way; its mean load is its weight within 1 %."""
    plant = placed()
    loads = [result.contact_force[:, 1].sum() for result in walk(plant, speed, 10.0)]
    assert np.sign(speed) * plant.x > 0.5
    assert np.mean(loads) == pytest.approx(plant.robot.mass * GRAVITY, rel=0.01)


@pytest.mark.parametrize("psi", [0.3, 1.0, 4.0])
def test_distance_walked_does_not_depend_on_the_time_step(psi):
    """10 s at 1 rad/s with half the time step: 2 %. Single slips differ, the gait does not."""
    distance = []
    for time_step in (1e-3, 5e-4):
        plant = placed(psi=psi, time_step=time_step)
        walk(plant, 1.0, 10.0)
        distance.append(plant.x)
    assert distance[0] == pytest.approx(distance[1], rel=0.02)
    assert distance[1] > 0.5


def test_looking_for_the_ground_less_often():
    """Every 10 ms as every 1 ms: 20 s over four rough grounds, within 3 %, as steps are chaotic."""
    distance = []
    for interval in (1e-3, 1e-2):
        distance.append(0.0)
        for seed in range(4):
            terrain = Terrain.rough(np.random.default_rng(seed), start=-5.0)
            plant = placed(None, terrain, detection_interval=interval)
            walk(plant, 1.0, 20.0)
            distance[-1] += plant.x
    assert distance[0] == pytest.approx(distance[1], rel=0.03)
    assert distance[0] > 4.0


RANDOM_TORQUE = {
    "paper flat": ("paper", 2, Terrain.flat()),
    "holy rough": ("holy", 2, Terrain.rough(np.random.default_rng(0), start=-20.0)),
    "slender bouncing": ("paper_slender", 2, Terrain.flat(restitution=0.5)),
    "twelve legs rough": ("paper", 6, Terrain.rough(np.random.default_rng(1), start=-20.0)),
}


@pytest.mark.parametrize("name, phases, terrain", RANDOM_TORQUE.values(), ids=RANDOM_TORQUE)
def test_contact_law_holds_in_every_step(name, phases, terrain, rng):
    """60 s of random torque, set down again after each fall: residual <= 1e-9 N s throughout."""
    plant = placed(ROBOTS[name](phases), terrain)
    loads = 0.0
    for _ in range(round(60.0 / HOLD)):
        result = plant.step(rng.uniform(-20.0, 20.0), HOLD)
        loads += result.contact_force[:, 1].sum() * HOLD
        assert result.residual <= 1e-9
        if result.non_toe_contact or abs(plant.state[2]) > FALLEN:
            plant.reset(rng.uniform(-5.0, 5.0), rng.uniform(0.0, 2.0 * math.pi))
    assert loads > 30.0 * plant.robot.mass * GRAVITY  # it was on the ground most of the time


@pytest.mark.parametrize("rise", [0.1, -0.1])
def test_it_walks_over_a_kink(rise):
    """From level ground onto a slope of 10 % and off again, contact law and all."""
    plant = placed(None, Terrain(((-1.0, 0.0), (0.3, 0.0), (1.3, rise), (2.0, rise))))
    results = walk(plant, 1.0, 20.0)
    assert plant.x > 1.0
    assert max(result.residual for result in results) <= 1e-9


@pytest.mark.parametrize("psi", [0.3, 2.0, 4.5])
def test_upside_down_it_comes_to_rest_on_its_bumpers(psi):
    """Dropped on its back with the crank locked: at rest after 4 s, pads no deeper than 0.1 mm."""
    plant = placed(state=[0.0, 0.6, math.pi, psi, 0.0, 0.0, 0.0, 0.0], locked=True)
    assert not plant.step(0.0, 0.05).non_toe_contact  # still falling
    plant.step(0.0, 4.0)
    result = plant.step(0.0, 0.1)
    assert result.non_toe_contact and (result.contact_force == 0.0).all()
    assert np.abs(plant.state[4:]).max() <= 1e-6
    x, y, theta = plant.state[:3]
    legs = plant.robot.legs
    joints = np.array([joint_positions(plant.robot, leg.side, psi + leg.phase) for leg in legs])
    height = y + (np.exp(1j * theta) * (joints @ [1.0, 1.0j])).imag - plant.robot.pad_radius
    assert -1e-4 <= height.min() <= 1e-9
    assert abs(x) < 0.1
