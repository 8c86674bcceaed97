"""Resting for a minute without torque: nothing is gained, nothing moves, no load changes."""

import math

import numpy as np
import pytest
from motions import DESIGNS, placed, toes_of

from jansen_env import Leg, Robot, Terrain
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics.gravity import GRAVITY

FRICTION = 0.8
TWINS = Robot(legs=(Leg("fore"), Leg("fore"), Leg("back"), Leg("back")))
DESIGNS = {**DESIGNS, "twins": TWINS}
POSES = [(slope, psi) for slope in (0.1, 0.0, -0.2) for psi in (0.3, 1.0, 2.0, 4.0)]  # rad
some_and_more = pytest.mark.parametrize(
    "poses",
    [pytest.param(POSES[:1], id="one"), pytest.param(POSES[1:], id="more", marks=pytest.mark.slow)],
)


def standing(name, slope, psi, locked):
    """The design placed on a slope."""
    ground = Terrain.slope(slope, friction=FRICTION)
    return placed(DESIGNS[name], ground, psi, locked=locked)


def friction_needed(plant, slope):
    """Largest |tangential| / normal load with which two toes hold all of a robot with free crank.

    J^T P = dV/dq: four loads, four equations. None where there are not two toes, or where they
    leave one free; infinite where one of them would have to pull.
    """
    q = plant.state[:4]
    d = 1e-5
    on = np.flatnonzero(plant.lookahead().contact_force[:, 1])
    if len(on) != 2:
        return None
    along = np.array([math.cos(slope), math.sin(slope)])
    normal = np.array([-along[1], along[0]])

    def look(q):
        rows = []
        for *place, angle in toes_of(plant.robot, q)[on]:
            rows += [place @ normal, place @ along + plant.robot.pad_radius * angle]
        return np.array([*rows, rd.energy(plant.tables, q, np.zeros(4))])

    slopes = np.array([look(q + d * e) - look(q - d * e) for e in np.eye(4)]).T / (2.0 * d)
    if np.linalg.cond(slopes[:4]) > 1e3:  # Chebyshev's toes all but keep their distance
        return None
    P = np.linalg.solve(slopes[:4].T, slopes[4])
    return math.inf if P[::2].min() <= 0.0 else np.abs(P[1::2] / P[::2]).max()


def rest(plant, slope, measured):
    """A minute of rest; note what is not constant in it."""
    weight = plant.robot.mass * GRAVITY
    energy = plant.energy()
    before = plant.state
    first = plant.step(0.0, 0.1).contact_force
    settled = plant.state
    plant.step(0.0, 59.8)
    last = plant.step(0.0, 0.1).contact_force
    measured("energy won", plant.energy() - energy, 1e-14 * weight, "J")
    measured("energy lost", energy - plant.energy(), 1e-10 * weight, "J")
    measured("settling", np.abs(plant.state - before)[:4].max(), 2e-9, "m, rad")
    measured("drift", np.abs(plant.state - settled)[:4].max(), 2e-9, "m, rad")
    measured("speed", np.abs(plant.state[4:]).max(), 3e-11, "m/s, rad/s")
    measured("a load's change / weight", np.abs(last - first).max() / weight, 5e-6)
    load = weight * np.array([math.sin(slope), math.cos(slope)])
    measured("loads less weight / weight", np.abs(last.sum(axis=0) - load).max() / weight, 1e-14)


@some_and_more
@pytest.mark.parametrize("name", DESIGNS)
def test_a_minute_at_rest_with_the_crank_locked(name, poses, measured):
    """It rests on the level and on slopes below atan(mu), at several crank angles."""
    for slope, psi in poses:
        rest(standing(name, slope, psi, True), slope, measured)


@pytest.mark.slow
@some_and_more
@pytest.mark.parametrize("name", DESIGNS)
def test_a_minute_with_the_crank_free(name, poses, measured):
    """It never wins energy; it rests where statics lets it (|t| <= mu n), and only there."""
    held = DESIGNS[name].motor.friction > 0.0  # the gear may hold what the ground does not
    for slope, psi in poses:
        plant = standing(name, slope, psi, False)
        energy = plant.energy()
        before = plant.state
        needed = friction_needed(plant, slope)
        if needed is not None and needed < 0.98 * FRICTION:
            rest(plant, slope, measured)
            continue
        most = energy
        for _ in range(60):
            plant.step(0.0, 1.0)
            most = max(most, plant.energy())
        measured("energy won with the crank free", most - energy, 1e-12 * plant.robot.mass, "J")
        if needed is not None and needed > 1.02 * FRICTION and not held:
            assert np.abs(plant.state - before)[:4].max() > 1e-3
