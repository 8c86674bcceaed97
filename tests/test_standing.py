"""The robot with its crank at rest: it stands, slides, bounces and lies as mechanics says.

Crank angles are such that a fore and a back toe carry, and slopes such that it does not tip over.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from jansen_env import Robot, Terrain
from jansen_env import reduced as rd
from jansen_env.gravity import GRAVITY
from jansen_env.linkage import joint_positions
from jansen_env.plants.projection import ProjectionPlant

WEIGHT = Robot().mass * GRAVITY  # N
TWO_TOES = (0.3, 1.0, 2.0, 4.5)  # rad


def standing(terrain, crank_angle, locked=True):
    """The paper's machine, set down."""
    plant = ProjectionPlant(Robot(), terrain)
    plant.crank_driven = locked
    plant.reset(0.0, crank_angle)
    return plant


def along(angle):
    return np.array([math.cos(angle), math.sin(angle)])


@pytest.mark.parametrize("angle", [0.0, 0.1])
def test_it_stands_at_every_crank_angle(angle):
    """Set down on a gentle slope with the crank locked, it stays: within 1 um for half a second."""
    fallen = []
    for psi in np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False):
        plant = standing(Terrain.slope(angle), psi)
        before = plant.state
        plant.step(0.0, 0.5)
        if np.abs(plant.state - before).max() > 1e-6:
            fallen.append(round(float(psi), 2))
    assert fallen == []


@pytest.mark.parametrize("locked", [True, False])
@pytest.mark.parametrize("psi", [0.3, 1.0, 4.0])
def test_a_resting_robot_stays_at_rest(psi, locked):
    """10 s without torque: nothing moves (1e-10), toes carry the weight and no toe slips.

    Two sticking toes hold all four freedoms, so the crank need not be locked at these angles.
    """
    plant = standing(Terrain.flat(), psi, locked)
    before = plant.state
    result = plant.step(0.0, 10.0)
    assert np.abs(plant.state - before).max() <= 1e-10
    assert result.contact_force[:, 1].sum() == pytest.approx(WEIGHT, rel=1e-9)
    assert (result.contact_force[:, 1] > 0.1 * WEIGHT).sum() == 2
    assert result.slip.sum() <= 1e-10 and not result.bumped


@pytest.mark.parametrize("psi", TWO_TOES)
@pytest.mark.parametrize("mu", [0.15, 0.3])
def test_no_creep_below_the_friction_angle(psi, mu):
    """On a slope 0.1 % less steep than atan(mu): less than 1 um in 10 s, loads m g (sin, cos)."""
    angle = 0.999 * math.atan(mu)
    plant = standing(Terrain.slope(angle, friction=mu), psi)
    before = plant.state
    result = plant.step(0.0, 10.0)
    assert np.abs(plant.state - before)[:3].max() < 1e-6
    load = WEIGHT * np.array([math.sin(angle), math.cos(angle)])
    assert result.contact_force.sum(axis=0) == pytest.approx(load, rel=1e-6)


@pytest.mark.parametrize("psi", TWO_TOES)
@pytest.mark.parametrize("mu, angle", [(0.3, 0.301), (0.3, 0.35), (0.2, 0.4), (0.0, 0.2)])
def test_slides_above_the_friction_angle(psi, mu, angle):
    """It slides with g (sin a - mu cos a) like a block: 1e-6 m/s^2, both toes keep the ground."""
    plant = standing(Terrain.slope(angle, friction=mu), psi)
    plant.step(0.0, 0.1)  # the toes settle
    before = plant.state
    result = plant.step(0.0, 1.0)
    gained = (before - plant.state)[4:6] @ along(angle)
    assert gained == pytest.approx(GRAVITY * (math.sin(angle) - mu * math.cos(angle)), abs=1e-6)
    assert (result.contact_force[:, 1] > 0.0).sum() == 2 and not result.bumped
    travelled = math.hypot(*(plant.state - before)[:2])
    assert np.sort(result.slip)[-2:] == pytest.approx([travelled] * 2, rel=1e-6)


def test_sliding_to_a_stop():
    """Pushed to 0.5 m/s on level ground: v^2 / (2 mu g) and no farther, friction takes m v^2 / 2.

    At this crank angle both toes keep the ground meanwhile. The stop falls inside one time step,
    which is 1e-4 of the distance.
    """
    mu, speed = 0.3, 0.5
    plant = standing(Terrain.flat(friction=mu), 0.3)
    state = plant.state
    state[4] = speed
    plant.state = state
    result = plant.step(0.0, 1.0)
    assert plant.x == pytest.approx(speed**2 / (2.0 * mu * GRAVITY), rel=1e-4)
    loss = result.slip_loss + result.impact_loss
    assert loss == pytest.approx(0.5 * Robot().mass * speed**2, rel=1e-6)
    assert result.slip_loss >= 0.999 * loss
    assert np.abs(plant.state[4:]).max() <= 1e-10


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_toe_bounces_by_newtons_law(restitution):
    """The struck toe leaves at -e times the speed it came with: 1e-10, as the blow is exact.

    No gravity, crank locked and pitched so that one toe strikes: a rigid body in uniform motion
    before and after. The energy lost is booked as impact loss.
    """
    ground = Terrain.flat(friction=0.0, restitution=restitution)
    plant = ProjectionPlant(Robot(), ground, gravity=0.0)
    plant.crank_driven = True
    plant.reset(0.0, 1.0, pitch=0.1)
    before = plant.state
    before[1] += 0.0123
    before[5] = -1.0
    plant.state = before
    c = complex(*rd.body_sums(plant.tables, 1.0).c) / Robot().mass  # in the chassis frame
    toes = plant.toe_positions() @ [1.0, 1.0j] - before[:2] @ [1.0, 1.0j]
    struck = np.argmin(toes.imag)
    arm = toes[struck] - c * np.exp(1j * before[2])  # toe from the centre of mass at the blow
    for _ in range(20):
        result = plant.step(0.0, plant.time_step)
        if plant.state[6] != 0.0:
            break
    _, _, theta, _, _, vy, w, _ = plant.state
    centre_vy = vy + w * (c * np.exp(1j * theta)).real
    assert w != 0.0
    assert centre_vy + w * arm.real == pytest.approx(restitution, abs=1e-10)
    assert result.energy_change == pytest.approx(-result.impact_loss, abs=1e-12)
    assert (abs(result.impact_loss) < 1e-9) == (restitution == 1.0)


@pytest.mark.parametrize("psi", [0.3, 2.0, 4.5])
def test_upside_down_it_comes_to_rest_on_its_bumpers(psi):
    """Dropped on its back with the crank locked: at rest after 4 s, pads no deeper than 0.1 mm."""
    plant = ProjectionPlant(Robot(), Terrain.flat())
    plant.crank_driven = True
    plant.state = [0.0, 0.6, math.pi, psi, 0.0, 0.0, 0.0, 0.0]
    assert not plant.step(0.0, 0.05).bumped  # still falling
    plant.step(0.0, 4.0)
    result = plant.step(0.0, 0.1)
    assert result.bumped and (result.contact_force == 0.0).all()
    assert np.abs(plant.state[4:]).max() <= 1e-6
    x, y, theta = plant.state[:3]
    legs = plant.robot.legs
    joints = np.array([joint_positions(plant.robot, leg.side, psi + leg.phase) for leg in legs])
    height = y + (np.exp(1j * theta) * (joints @ [1.0, 1.0j])).imag - plant.robot.pad_radius
    assert -1e-4 <= height.min() <= 1e-9
    assert abs(x) < 0.1
