"""The robot on the ground: it rests, slides, bounces and walks as mechanics says.

Crank angles are such that a fore and a back toe carry, and slopes such that it does not tip over.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from jansen_env import ROBOTS, Robot, Terrain, paper_robot
from jansen_env import reduced as rd
from jansen_env.plants.projection import ProjectionPlant
from jansen_env.projection import GRAVITY

WEIGHT = Robot().mass * GRAVITY  # N
HOLD = 0.02  # s, for which a torque is held
FALLEN = 1.2  # rad of pitch
TWO_TOES = (0.3, 1.0, 2.0, 4.5)  # rad


def standing(terrain, crank_angle=0.3, locked=False, time_step=1e-3, robot=None):
    plant = ProjectionPlant(robot or Robot(), terrain, time_step)
    plant.crank_locked = locked
    plant.reset(0.0, crank_angle)
    return plant


def walk(plant, speed, duration):
    """Hold the crank near ``speed`` rad/s; the results of all steps."""
    results = []
    for _ in range(round(duration / HOLD)):
        torque = 10.0 * (speed - plant.state[7]) + 1.5 * speed
        results.append(plant.step(float(np.clip(torque, -20.0, 20.0)), HOLD))
    assert not any(result.bumped for result in results)
    return results


def momentum(plant):
    """(2,) N s."""
    q, v = np.split(plant.state, 2)
    return (rd.mass_matrix(plant.tables, q) @ v)[:2]


def along(angle):
    return np.array([math.cos(angle), math.sin(angle)])


@pytest.mark.parametrize("angle", [0.0, 0.1])
def test_it_stands_at_every_crank_angle(angle):
    """Set down on a gentle slope with the crank locked, it stays: within 1 um for half a second."""
    fallen = []
    for psi in np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False):
        plant = standing(Terrain.slope(angle), psi, locked=True)
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
    plant = standing(Terrain.slope(angle, friction=mu), psi, locked=True)
    before = plant.state
    result = plant.step(0.0, 10.0)
    assert np.abs(plant.state - before)[:3].max() < 1e-6
    load = WEIGHT * np.array([math.sin(angle), math.cos(angle)])
    assert result.contact_force.sum(axis=0) == pytest.approx(load, rel=1e-6)


@pytest.mark.parametrize("psi", TWO_TOES)
@pytest.mark.parametrize("mu, angle", [(0.3, 0.301), (0.3, 0.35), (0.2, 0.4), (0.0, 0.2)])
def test_slides_above_the_friction_angle(psi, mu, angle):
    """It slides with g (sin a - mu cos a) like a block: 1e-6 m/s^2, both toes keep the ground."""
    plant = standing(Terrain.slope(angle, friction=mu), psi, locked=True)
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
    plant = standing(Terrain.flat(friction=mu), 0.3, locked=True)
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
    plant.crank_locked = True
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
    assert centre_vy + w * arm.real == pytest.approx(restitution * 1.0, abs=1e-10)
    assert result.energy_change == pytest.approx(-result.impact_loss, abs=1e-12)
    assert (abs(result.impact_loss) < 1e-9) == (restitution == 1.0)


@pytest.mark.parametrize("psi", [0.3, 2.0, 4.5])
def test_smooth_ground_cannot_push_it_along(psi):
    """mu = 0: horizontal momentum stays 0 to 1e-10 N s however the crank turns."""
    plant = standing(Terrain.flat(friction=0.0), psi)
    results = walk(plant, 1.0, 5.0)
    assert abs(momentum(plant)[0]) <= 1e-10
    assert all((result.contact_force[:, 0] == 0.0).all() for result in results)
    assert sum(result.slip.sum() for result in results) > 0.1


@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_contact_forces_account_for_all_momentum(speed):
    """Sum of toe impulses = change of momentum + weight * time over a walk: rounding, 1e-9 N s.

    So the mean vertical load is the weight, but for m v / (weight T), here within 1 %.
    """
    plant = standing(Terrain.flat())
    before = momentum(plant)
    results = walk(plant, speed, 10.0)
    impulse = HOLD * sum(result.contact_force.sum(axis=0) for result in results)
    change = momentum(plant) - before + [0.0, 10.0 * WEIGHT]
    assert impulse == pytest.approx(change, abs=1e-9)
    assert impulse[1] / 10.0 == pytest.approx(WEIGHT, rel=0.01)
    assert np.sign(plant.x) == np.sign(speed) and abs(plant.x) > 0.5
    for result in results:
        assert (result.contact_force[:, 1] >= 0.0).all() and (result.slip >= 0.0).all()
        friction, load = np.abs(result.contact_force).T
        assert (friction <= 0.8 * load + 1e-9).all()


@pytest.mark.parametrize("psi", [0.3, 1.0, 4.0])
def test_distance_walked_does_not_depend_on_the_time_step(psi):
    """10 s at 1 rad/s with half the time step: 2 %. Single slips differ, the gait does not."""
    distance = []
    for time_step in (1e-3, 5e-4):
        plant = standing(Terrain.flat(), psi, time_step=time_step)
        walk(plant, 1.0, 10.0)
        distance.append(plant.x)
    assert distance[0] == pytest.approx(distance[1], rel=0.02)
    assert distance[1] > 0.5


def test_energy_balance_of_a_walk():
    """Motor work = losses + energy change: 1e-5 of the work, and less for smaller time steps."""
    miss = []
    for time_step in (2e-3, 5e-4):
        plant = standing(Terrain.flat(), time_step=time_step)
        start = plant.energy()
        results = walk(plant, 1.0, 10.0)
        work = sum(result.motor_work for result in results)
        miss.append(sum(abs(result.energy_residual) for result in results) / work)
        assert sum(r.energy_change for r in results) == pytest.approx(plant.energy() - start)
        assert all(result.joint_loss >= 0.0 and result.slip_loss >= 0.0 for result in results)
        for share in ("joint_loss", "slip_loss", "impact_loss"):  # none is negligible
            assert sum(getattr(result, share) for result in results) > 0.01 * work
    assert miss[0] <= 1e-5 and miss[0] / miss[1] > 2.0


RANDOM_TORQUE = {
    "paper flat": ("paper", 2, Terrain.flat()),
    "holy rough": ("holy", 2, Terrain.rough(np.random.default_rng(0), start=-20.0)),
    "slender bouncing": ("paper_slender", 2, Terrain.flat(restitution=0.5)),
    "twelve legs rough": ("paper", 6, Terrain.rough(np.random.default_rng(1), start=-20.0)),
}


@pytest.mark.parametrize("name, phases, terrain", RANDOM_TORQUE.values(), ids=RANDOM_TORQUE)
def test_contact_law_holds_in_every_step(name, phases, terrain, rng):
    """60 s of random torque, set down again after each fall: residual <= 1e-9 N s throughout."""
    plant = standing(terrain, robot=ROBOTS[name](phases))
    loads = 0.0
    for _ in range(round(60.0 / HOLD)):
        result = plant.step(rng.uniform(-20.0, 20.0), HOLD)
        loads += result.contact_force[:, 1].sum() * HOLD
        assert result.residual <= 1e-9
        if result.bumped or abs(plant.state[2]) > FALLEN:
            plant.reset(rng.uniform(-5.0, 5.0), rng.uniform(0.0, 2.0 * math.pi))
    assert loads > 30.0 * plant.robot.mass * GRAVITY  # it was on the ground most of the time


@pytest.mark.parametrize("rise", [0.1, -0.1])
def test_it_walks_over_a_kink(rise):
    """From level ground onto a slope of 10 % and off again, contact law and all."""
    plant = standing(Terrain(((-1.0, 0.0), (0.3, 0.0), (1.3, rise), (2.0, rise))))
    results = walk(plant, 1.0, 20.0)
    assert plant.x > 1.0
    assert max(result.residual for result in results) <= 1e-9


@pytest.mark.parametrize("psi", [0.3, 2.0, 4.5])
def test_upside_down_it_comes_to_rest_on_its_bumpers(psi):
    """Dropped on its back with the crank locked: at rest after 4 s, pads no deeper than 0.1 mm."""
    plant = ProjectionPlant(paper_robot(), Terrain.flat())
    plant.crank_locked = True
    plant.state = [0.0, 0.6, math.pi, psi, 0.0, 0.0, 0.0, 0.0]
    assert not plant.step(0.0, 0.05).bumped  # still falling
    plant.step(0.0, 4.0)
    result = plant.step(0.0, 0.1)
    assert result.bumped and (result.contact_force == 0.0).all()
    assert np.abs(plant.state[4:]).max() <= 1e-6
    layout, x, y, theta = plant.tables.layout, *plant.state[:3]
    lowest = [
        y + (np.exp(1j * theta) * complex(*joints[list(rd.PAD_JOINTS)[j]])).imag - 0.01
        for j, joints in zip(layout.joint, legs_of(plant, psi), strict=True)
    ]
    assert -1e-4 <= min(lowest) <= 1e-9
    assert x == pytest.approx(0.0, abs=0.1)
