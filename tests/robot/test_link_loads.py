"""Pins, corners and loads of links: statics by virtual work, names and signs, batches, refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import Bar, Payload
from jansen_env.dynamics import projection as pr
from jansen_env.dynamics.joint_forces import CORNERS, PINS, joint_forces
from jansen_env.gravity import GRAVITY
from jansen_env.robot.kinematics import JOINTS, coordinates, joint_positions


@pytest.fixture
def laden(robot):
    """Each design under a load off the crank axis."""
    return replace(robot, payload=Payload(mass=1.7, inertia=0.3, position=(0.2, 0.4)))


def draw(robot, random_state, rng):
    """A state, a torque, and a wrench on every toe."""
    q, v = np.split(random_state(), 2)
    return q, v, rng.uniform(-10.0, 10.0), rng.uniform(-20.0, 20.0, (len(robot.legs), 3))


BARS = {2: "crank", 3: "upper_rod", 5: "rocker", 6: "lower_rod", 7: "coupler"}


@pytest.mark.parametrize("body, name", BARS.items(), ids=BARS.values())
def test_virtual_work_of_a_longer_bar(robot, rng, body, name):
    """At rest, crank held: a bar's mean axial load is -dV/dL, V the potential energy of its leg.

    Lengthening a bar moves everything that hangs on it, and the loads at its two ends do the work.
    V is differenced to fourth order with 0.1 mm: 1e-8 N.
    """
    link, psi, h = getattr(robot, name), rng.uniform(-3.0, 3.0), 1e-4
    forces = joint_forces(robot, np.array([0.0, 0.0, 0.0, psi]), np.zeros(4), fixed_base=True,
                          q_ddot=np.zeros(4))  # fmt: skip
    ends = [k for k, (other, _) in enumerate(CORNERS) if other == body]
    weight = GRAVITY * np.array([part.mass for part in robot.bodies])
    for loads, leg in zip(forces.link_loads()[:, ends, 0], robot.legs, strict=True):

        def potential(change, leg=leg):
            longer = replace(robot, **{name: replace(link, length=link.length + change)})
            return coordinates(longer, leg.side, psi + leg.phase)[2::3] @ weight

        near, far = (potential(s) - potential(-s) for s in (h, 2.0 * h))
        assert loads.mean() == pytest.approx(-(8.0 * near - far) / (12.0 * h), abs=1e-8)


def test_loads_of_a_massless_bar_are_tension_or_compression(robot, random_state, rng):
    """Weightless bars without friction: both ends pulled alike, no shear, at any motion.

    Their mass cannot be 0; 1e-12 kg leaves less than 1e-9 of the largest pin force.
    """
    names = ("upper_rod", "rocker", "lower_rod", "coupler")
    light = {name: Bar(getattr(robot, name).length, 1e-12, 0.0) for name in names}
    robot = replace(robot, damping=(0.0,) * 10, bearing_friction=(0.0,) * 10, **light)
    q, v, torque, contact = draw(robot, random_state, rng)
    forces = joint_forces(robot, q, v, torque, contact)
    loads, scale = forces.link_loads(), forces.magnitude.max()
    for body in (3, 5, 6, 7):
        ends = [k for k, (other, _) in enumerate(CORNERS) if other == body]
        (one, other), shear = loads[:, ends, 0].T, loads[:, ends, 1]
        assert np.abs(one - other).max() <= 1e-9 * scale
        assert np.abs(shear).max() <= 1e-9 * scale
        assert np.abs(one).max() > 1e-3 * scale  # and it does carry


@pytest.mark.parametrize("side", ["fore", "back"])
def test_pins_are_the_papers_constraints(robot, side):
    """Each pair of rows is x_body - x_other + ..., closed at the joint the pin is named after."""
    x = coordinates(robot, side, 0.7)
    joints, (angle, place) = joint_positions(robot, side, 0.7), (x[0::3], x.reshape(8, 3)[:, 1:])
    for pin, closure in zip(PINS, pr.leg_closures(robot, side), strict=True):
        assert (pin.body, pin.other) == (closure.plus, closure.minus)
        assert {(pin.body, pin.joint), (pin.other, pin.joint)} <= set(CORNERS)
        corner = place[pin.other - 1].copy()  # its arm is minus the other body's own terms
        for term in closure.terms:
            if term.body == pin.other:
                turned = angle[term.body - 1] + term.offset
                corner -= term.coefficient * np.array([math.cos(turned), math.sin(turned)])
        assert corner == pytest.approx(joints[JOINTS.index(pin.joint)], abs=1e-12)
    assert str(PINS[1]) == "A23" and len({str(pin) for pin in PINS}) == 10


def test_many_instants_are_each_one(laden, random_state, rng):
    """(2, 3) instants at once, then one by one, and :meth:`at`: the same to rounding."""
    draws = [draw(laden, random_state, rng) for _ in range(6)]
    shape = ((2, 3, 4), (2, 3, 4), (2, 3), (2, 3, len(laden.legs), 3))
    args = [np.reshape(arg, s) for arg, s in zip(zip(*draws, strict=True), shape, strict=True)]
    every = joint_forces(laden, *args)
    one_by_one = [joint_forces(laden, *each) for each in draws]
    for k, one in enumerate(one_by_one):
        for name in ("pin", "frame", "shaft", "toe", "joints", "centres", "q_ddot"):
            found, expected = getattr(every.at(k // 3).at(k % 3), name), getattr(one, name)
            assert found.shape == expected.shape
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert every.torque.shape == (2, 3) and every.link_loads().shape[:2] == (2, 3)
    assert every.largest()[0] == every.bearing.max()
    size, leg, pin = max(one.largest() for one in one_by_one)
    assert every.largest() == (pytest.approx(size), leg, pin)


def test_bearing_does_not_depend_on_how_links_are_paired(laden, random_state, rng):
    """Every corner but the toe; at joints of two links both bear as much, at three they add up."""
    q, v, torque, contact = draw(laden, random_state, rng)
    forces = joint_forces(laden, q, v, torque, contact)
    corner, bearing = forces.corner_forces(), forces.bearing
    assert bearing.shape == (len(laden.legs), 17)
    assert bearing == pytest.approx(np.hypot(corner[:, :17, 0], corner[:, :17, 1]), abs=1e-12)
    for joint in "OABPCDE":
        at = [k for k, (_, name) in enumerate(CORNERS) if name == joint]
        scale = np.abs(corner).max()
        assert np.abs(corner[:, at].sum(axis=1)).max() <= 1e-12 * scale  # action and reaction
