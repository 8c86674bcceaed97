"""Impacts with restitution and friction: Newton's law as far as it creates no energy."""

from __future__ import annotations

import numpy as np
import pytest

from jansen_env import ROBOTS, Payload, Robot, Terrain
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.plants.projected import ProjectionPlant

STEP = 1e-6  # s
HEAVY = Robot(payload=Payload(60.0, 1.0, (0.1, 0.0)))


def impacts(robot, friction, restitution, rng, count=300):
    """(n, 2) energies before and after random single impacts in weightlessness, crank free.

    All but placed on level ground at any pitch, and thrown at it.
    """
    ground = Terrain.flat(friction, restitution)
    plant = ProjectionPlant(robot, ground, time_step=STEP, gravity=0.0)
    plant.tracing = True
    energies = []
    for _ in range(count):
        state = plant.reset(0.0, rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.3, 0.3))
        state[4:] = rng.normal(size=4) * (1.0, 0.0, 1.0, 3.0) - (0.0, 1.0, 0.0, 0.0)
        state[1] += PLACEMENT_DEPTH + 0.2 * STEP  # it touches down next, if it comes near
        plant.state = state
        before = plant.energy()
        plant.step(0.0, STEP)
        if plant.touchdowns[0]:
            energies.append((before, plant.energy()))
    assert len(energies) > count // 2
    return np.array(energies)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8, 2.0])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("robot", [ROBOTS["holy_slender"](2), HEAVY], ids=["holy_slender", "60 kg"])
def test_no_impact_creates_energy(robot, friction, restitution, rng, measured):
    """Kinetic energy after <= before, for any friction and restitution: 2e-6, from its length.

    Newton's law alone gives more than twice as much (60 kg, friction 0.8, e = 1).
    """
    energies = impacts(robot, friction, restitution, rng)
    gain = (energies[:, 1] / energies[:, 0]).max() - 1.0
    measured(f"energy gained in an impact, friction {friction}, e = {restitution}", gain, 2e-6)


def test_what_bounces_lawfully_bounces_as_asked(rng, measured):
    """One toe struck, no friction: no energy is at risk, and it leaves at e times its speed."""
    for e in (0.5, 1.0):
        ground = Terrain.flat(0.0, e)
        plant = ProjectionPlant(Robot(), ground, time_step=1e-6, gravity=0.0)
        plant.prescribed_crank_speed = (
            True  # locked: a rigid body, whose struck toe's speed is easily told
        )
        plant.reset(0.0, 1.0, 0.2)
        toe = int(np.argmin(plant.toe_positions()[:, 1]))
        state = plant.state
        state[5] = -1.0
        plant.state = state
        plant.step(0.0, 1e-6)
        left = plant.toe_positions()[toe, 1]
        plant.step(0.0, 1e-4)
        speed = (plant.toe_positions()[toe, 1] - left) / 1e-4
        measured(f"rebound speed, e = {e}, less e", abs(speed - e), 5e-5, "m/s")
