"""Momentum: only the ground and gravity change it, whatever the motor and the legs do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from walks import HOLD, momenta, placed, shift

from jansen_env import Payload, Robot, Terrain
from jansen_env.gravity import GRAVITY
from jansen_env.robot import RIGID, ROBOTS, paper_robot

DESIGNS = {
    **{name: replace(make(), pad_compliance=RIGID) for name, make in ROBOTS.items()},
    "loaded": Robot(payload=Payload(5.0, 0.2, (0.05, -0.2))),
    "six legs": paper_robot(3),
    "twelve legs": paper_robot(6),
}
designs = pytest.mark.parametrize("name", DESIGNS)


def wild(plant, rng):
    """A random torque, 5 N m a leg at most."""
    return rng.uniform(-5.0, 5.0) * len(plant.robot.legs)


@designs
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_smooth_ground_cannot_push_it_along(name, restitution, rng, measured):
    """mu = 0: horizontal momentum keeps its value through touchdowns, falls and random torques."""
    plant = placed(DESIGNS[name], Terrain.flat(0.0, restitution), moved=shift(vx=0.5))
    start, error, most, landed = momenta(plant)[0][0], 0.0, 0.0, 0
    for _ in range(150):
        result = plant.step(wild(plant, rng), HOLD)
        error = max(error, abs(momenta(plant)[0][0] - start))
        most = max(most, np.abs(result.contact_force[:, 0]).max())
        landed += result.impact_loss > 1e-3  # J
    assert landed > 5 and np.abs(plant.state[4:]).max() > 0.1
    measured("momentum gained, relative", error / abs(start), 1e-14)
    measured("tangential force", most, 0.0, "N")


@designs
@pytest.mark.parametrize("angle", [0.0, 0.15])
def test_contact_forces_account_for_all_momentum(name, angle, rng, measured):
    """Toes' impulses + m g t = change of momentum, level or on a slope, within |t| <= mu n."""
    plant = placed(DESIGNS[name], Terrain.slope(angle))
    along = np.array([math.cos(angle), math.sin(angle)])
    normal = np.array([-along[1], along[0]])
    weight = np.array([0.0, -plant.robot.mass * GRAVITY])
    error, cone, stepped = 0.0, -math.inf, 0.0
    for _ in range(150):
        before = momenta(plant)[0]
        result = plant.step(wild(plant, rng), HOLD)
        if result.non_toe_contact or abs(plant.state[2]) > 1.2:
            plant.reset(0.0, rng.uniform(0.0, 2.0 * math.pi))
            continue
        t, n = result.contact_force.T
        ground = t.sum() * along + n.sum() * normal
        change = momenta(plant)[0] - before
        error = max(error, np.abs(change - (ground + weight) * HOLD).max())
        stepped = max(stepped, np.abs(change).max())
        cone = max(cone, (np.abs(t) - 0.8 * n).max(), -n.min())
    assert stepped > 0.1
    measured("momentum not accounted for", error, 3e-14, "N s")
    measured("force outside the cone", cone, 1e-12, "N")


@designs
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_rough_ground_accounts_for_all_momentum(name, restitution, rng, measured):
    """Normals change within a hold: by the trace, toes and outer joints together."""
    ground = Terrain.rough(np.random.default_rng(1), start=-20.0, restitution=restitution)
    plant = placed(DESIGNS[name], ground, tracing=True)
    weight = np.array([0.0, -plant.robot.mass * GRAVITY])
    error, change_most = 0.0, 0.0
    for _ in range(80):
        before = momenta(plant)[0]
        plant.step(wild(plant, rng), HOLD)
        impulses = plant.trace["impulses"]
        change = momenta(plant)[0] - before
        total = impulses[:, :, :2].sum(axis=(0, 1)) + weight * HOLD
        error = max(error, np.abs(change - total).max())
        change_most = max(change_most, np.abs(change).max())
        if abs(plant.state[2]) > 1.2:
            plant.reset(0.0, rng.uniform(0.0, 2.0 * math.pi))
    assert change_most > 0.1
    measured("momentum not accounted for on rough ground", error, 3e-14, "N s")
