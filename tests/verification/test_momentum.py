"""Momentum: only the ground and gravity change it, whatever the motor and the legs do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import Payload, Robot, Terrain
from jansen_env.dynamics import reduced as rd
from jansen_env.gravity import GRAVITY
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot import RIGID, ROBOTS, paper_robot

HOLD = 0.02  # s, for which a torque is held
DESIGNS = {
    **{name: replace(make(), pad_compliance=RIGID) for name, make in ROBOTS.items()},
    "loaded": Robot(payload=Payload(5.0, 0.2, (0.05, -0.2))),
    "six legs": paper_robot(3),
    "twelve legs": paper_robot(6),
}
designs = pytest.mark.parametrize("name", DESIGNS)


def standing(name, terrain):
    """The design placed on the terrain."""
    plant = ProjectionPlant(DESIGNS[name], terrain)
    plant.reset(0.0, 0.3)
    return plant


def wild(plant, rng):
    """A random torque, 5 N m a leg at most."""
    return rng.uniform(-5.0, 5.0) * len(plant.robot.legs)


def momentum(plant):
    """(2,) N s, from the dense mass matrix."""
    q, v = np.split(plant.state, 2)
    return (rd.mass_matrix(plant.tables, q) @ v)[:2]


@designs
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_smooth_ground_cannot_push_it_along(name, restitution, rng, measured):
    """mu = 0: horizontal momentum keeps its value through touchdowns, falls and random torques."""
    plant = standing(name, Terrain.flat(0.0, restitution))
    state = plant.state
    state[4] = 0.5
    plant.state = state
    start, error, most, landed = momentum(plant)[0], 0.0, 0.0, 0
    for _ in range(150):
        result = plant.step(wild(plant, rng), HOLD)
        error = max(error, abs(momentum(plant)[0] - start))
        most = max(most, np.abs(result.contact_force[:, 0]).max())
        landed += result.impact_loss > 1e-3  # J
    assert landed > 5 and np.abs(plant.state[4:]).max() > 0.1
    measured("momentum gained, relative", error / abs(start), 1e-14)
    measured("tangential force", most, 0.0, "N")


@designs
@pytest.mark.parametrize("angle", [0.0, 0.15])
def test_contact_forces_account_for_all_momentum(name, angle, rng, measured):
    """Sum of toes' impulses + m g t = change of momentum, level or on a slope, in every hold.

    Loads are normal and tangential to the slope and within the cone |t| <= mu n.
    """
    plant = standing(name, Terrain.slope(angle))
    along = np.array([math.cos(angle), math.sin(angle)])
    normal = np.array([-along[1], along[0]])
    weight = np.array([0.0, -plant.robot.mass * GRAVITY])
    error, cone, stepped = 0.0, -math.inf, 0.0
    for _ in range(150):
        before = momentum(plant)
        result = plant.step(wild(plant, rng), HOLD)
        if result.non_toe_contact or abs(plant.state[2]) > 1.2:
            plant.reset(0.0, rng.uniform(0.0, 2.0 * math.pi))
            continue
        t, n = result.contact_force.T
        ground = t.sum() * along + n.sum() * normal
        change = momentum(plant) - before
        error = max(error, np.abs(change - (ground + weight) * HOLD).max())
        stepped = max(stepped, np.abs(change).max())
        cone = max(cone, (np.abs(t) - 0.8 * n).max(), -n.min())
    assert stepped > 0.1
    measured("momentum not accounted for", error, 3e-14, "N s")
    measured("force outside the cone", cone, 1e-12, "N")


@designs
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_rough_ground_accounts_for_all_momentum(name, restitution, rng, measured):
    """On kinked ground, where normals change within a hold: by the trace of every time step.

    Its impulses add up to the change of momentum, toes and outer joints together.
    """
    ground = Terrain.rough(np.random.default_rng(1), start=-20.0, restitution=restitution)
    plant = standing(name, ground)
    plant.tracing = True
    weight = np.array([0.0, -plant.robot.mass * GRAVITY])
    error, change_most = 0.0, 0.0
    for _ in range(80):
        before = momentum(plant)
        plant.step(wild(plant, rng), HOLD)
        impulses = plant.trace["impulses"]
        change = momentum(plant) - before
        total = impulses[:, :, :2].sum(axis=(0, 1)) + weight * HOLD
        error = max(error, np.abs(change - total).max())
        change_most = max(change_most, np.abs(change).max())
        if abs(plant.state[2]) > 1.2:
            plant.reset(0.0, rng.uniform(0.0, 2.0 * math.pi))
    assert change_most > 0.1
    measured("momentum not accounted for on rough ground", error, 3e-14, "N s")
