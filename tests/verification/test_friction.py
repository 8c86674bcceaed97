"""Coulomb friction with the crank locked: how far a sliding robot slides, and when it begins to.

A locked robot is a block as long as it does not tip: mu < a / z for the centre of mass z above the
ground and a from either toe, which holds for ``MACHINES`` with room to spare.
"""

import math

import numpy as np
import pytest
from motions import momenta, placed, pull, shift

from jansen_env import Leg, Payload, Robot, Terrain
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.robot import ROBOTS, holy_numbers_robot, paper_robot

STEP = 1e-3  # s
SLIDING = 1e-11  # m/s: a hundred times what the solver's compliance lets a sticking toe creep
LOAD = Payload(10.0, 0.2, (0.02, -0.4))
MACHINES = {  # robot, crank angle, the largest mu asked of it
    "paper": (paper_robot(), 0.0, 0.4),
    "paper loaded": (Robot(payload=LOAD), 0.0, 0.8),
    "holy": (holy_numbers_robot(), 3.0, 0.4),
    "two legs": (Robot(legs=(Leg("fore"), Leg("back"))), 4.7, 0.8),
    "klann": (ROBOTS["klann"](), 0.3, 0.4),
    "strider": (ROBOTS["strider"](), 0.3, 0.4),
    "six legs": (paper_robot(3), 1.57, 0.6),
    "twelve legs": (paper_robot(6), 0.52, 0.6),
}
SLIDES = [
    (name, mu, speed)
    for name, (_, _, most) in MACHINES.items()
    for mu, speed in ((0.1, -0.5), (0.2, 0.3), (0.4, 1.03), (0.4, -2.0), (0.6, 0.7), (0.8, 1.5))
    if mu <= most
]
machines = pytest.mark.parametrize("name", MACHINES)


def standing(name, terrain, speed=0.0):
    """The machine placed, its crank locked, moving along at a speed."""
    robot, psi, _ = MACHINES[name]
    return placed(robot, terrain, psi, moved=shift(vx=speed), locked=True)


def slides(plant):
    """Whether the robot moves along the ground."""
    return math.hypot(*plant.state[4:6]) > SLIDING


def loads_while_sliding(plant, drag):
    """(rear, front) loads by moments about the centre of mass: ground force (drag, m g)."""
    toes = plant.toe_positions()[np.flatnonzero(plant.lookahead().contact_force[:, 1])]
    rear, front = toes[:, 0].min(), toes[:, 0].max()
    x, y = momenta(plant)[2]
    weight = plant.robot.mass * GRAVITY
    height = y - toes[:, 1].mean() + plant.robot.pad_radius
    on_front = (weight * (x - rear) - drag * height) / (front - rear)
    return np.array([weight - on_front, on_front])


def sorted_loads(plant, result):
    """(rear, front) loads of a step on two toes."""
    on = np.flatnonzero(result.contact_force[:, 1])
    assert len(on) == 2
    return result.contact_force[on[np.argsort(plant.toe_positions()[on, 0])], 1]


@pytest.mark.parametrize("name, mu, speed", SLIDES)
def test_sliding_to_a_stop(name, mu, speed, measured):
    """It stops after v / (mu g) at v^2 / (2 mu g); a stop inside a step h adds up to mu g
    h^2 / 8.
    """
    plant = standing(name, Terrain.flat(friction=mu), speed)
    mass = plant.robot.mass
    x0 = plant.x
    expected = loads_while_sliding(plant, -math.copysign(mu * mass * GRAVITY, speed))
    assert expected.min() > 0.02 * mass * GRAVITY  # it does not tip
    steps = math.ceil(abs(speed) / (mu * GRAVITY * STEP))
    result = plant.step(0.0, (steps - 1) * STEP)
    measured("loads while sliding", np.abs(sorted_loads(plant, result) - expected).max(), 1e-6, "N")
    assert plant.state[4] * speed > 0.0
    last = plant.step(0.0, STEP)
    measured("speed after the time to stop", np.abs(plant.state[4:]).max(), 1e-12, "m/s")
    distance = speed * abs(speed) / (2.0 * mu * GRAVITY)
    inside = mu * GRAVITY * STEP**2 / 8.0
    measured("stop distance's error", abs(plant.x - x0 - distance), inside + 1e-10, "m")
    measured("the same, relative", abs((plant.x - x0) / distance - 1.0), 2e-5)
    slid = np.sort(result.slip + last.slip)[-2:]
    measured("slip less distance", np.abs(slid - abs(distance)).max(), 5.0 * inside + 1e-10, "m")
    loss = sum(r.slip_loss + r.impact_loss for r in (result, last))
    energy = 0.5 * mass * speed**2
    measured("friction's work, relative", abs(loss / energy - 1.0), 1e-11)
    measured("of it in the last step", 1.0 - (result.slip_loss + last.slip_loss) / energy, 1e-4)
    before = plant.state
    plant.step(0.0, 1.0)
    measured("creep after the stop", np.abs(plant.state - before)[:3].max(), 1e-12, "m")


@machines
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_slip_begins_at_a_pull_of_mu_m_g(name, way, measured):
    """It is pulled at the centre of mass; then it speeds up with pull / m - mu g, like a block."""
    robot, _, mu = MACHINES[name]
    plant = standing(name, Terrain.flat(friction=mu))
    x0 = plant.x
    weight = robot.mass * GRAVITY
    wrong = 0.0
    for share in np.arange(0.996, 1.01, 1e-5):
        pull(plant, way * share * mu * GRAVITY)
        creep = abs(plant.x - x0)
        result = plant.step(0.0, 0.01)
        if slides(plant):
            break
        drag = result.contact_force[:, 0].sum()
        wrong = max(wrong, abs(drag + way * share * mu * weight))
    measured("friction less pull", wrong, 1e-9, "N")
    measured("pull at slip less mu m g, of mu m g", abs(share - 1.0), 1.01e-5)
    measured("creep before it slips", creep, 1e-11, "m")
    pull(plant, way * 1.05 * mu * GRAVITY)
    before = plant.state
    result = plant.step(0.0, 0.2)
    gained = (plant.state - before)[4] / 0.2
    measured("acceleration", abs(gained - way * 0.05 * mu * GRAVITY), 1e-13, "m/s^2")
    drag = result.contact_force[:, 0].sum()
    measured("friction while sliding", abs(drag + way * mu * weight), 1e-12 * weight, "N")


@machines
def test_friction_reverses_with_the_motion(name, measured):
    """Pushed against a pull p, p/m + mu g slows it; then p/m - mu g speeds it up the other way."""
    robot, _, most = MACHINES[name]
    mu = most / 2.0
    speed = 0.5
    against = 1.3 * mu * GRAVITY  # per mass
    plant = standing(name, Terrain.flat(friction=mu), speed)
    pull(plant, -against)
    slowing, gaining = against + mu * GRAVITY, against - mu * GRAVITY
    turning = round(speed / slowing / STEP) * STEP
    first = plant.step(0.0, turning - 2.0 * STEP)
    measured("speed, slowing", abs(plant.state[4] - speed + slowing * (turning - 2 * STEP)), 2e-13)
    plant.step(0.0, 4.0 * STEP)
    middle = plant.state
    last = plant.step(0.0, 0.2)
    measured("speed, gaining", abs((plant.state - middle)[4] + gaining * 0.2), 1e-13, "m/s")
    drag = mu * robot.mass * GRAVITY
    for name, result, force in (("first", first, -drag), ("afterwards", last, drag)):
        error = abs(result.contact_force[:, 0].sum() - force)
        measured(f"friction, {name}", error, 2e-11, "N")
    time = turning + 2.0 * STEP - speed / slowing  # since it turned
    distance = speed**2 / (2.0 * slowing) - 0.5 * gaining * time**2
    measured("place after turning", abs(middle[0] - distance), against * STEP**2, "m")
