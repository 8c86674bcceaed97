"""Measures of a held leg against closed forms, virtual work, and the table they were found for."""

import math
from dataclasses import replace

import numpy as np
import pytest
from lettered_legs import LEGS, OTHER_WAY, letters_leg

from agents.design.held_leg import (
    held_leg_measures,
    in_stance,
    path_measures,
    pin_loads,
    wear_of_pins,
)
from jansen_env import ROBOTS
from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.gravity import GRAVITY
from jansen_env.robot import Bar, Leg
from jansen_env.robot.kinematics import joint_positions, toe_positions

TURN = 2.0 * math.pi * np.arange(360) / 360
WAYS = pytest.mark.parametrize("way", LEGS)


def test_a_straight_even_stance_is_flat_and_has_no_ripple():
    """Along the ground at one speed, then back over it."""
    k = np.arange(360)
    across = np.where(k <= 120, 2.0 * k, 360.0 - k)
    height = np.where((k >= 10) & (k < 110), -3.0, -1.0)
    found = path_measures(np.stack([across, height], axis=-1))
    assert found == pytest.approx((198.0, 2.0, 100 / 360, 0.0, 0.0), abs=1e-12)
    bent = path_measures(np.stack([across + 0.01 * k**2, height + 1e-3 * k], axis=-1))
    assert bent[3] > 0.0 < bent[4]


def test_stance_is_the_lowest_part_of_the_path():
    height = np.linspace(2.0, 4.0, 201)
    assert in_stance(height).sum() == 31
    assert in_stance(-height)[-31:].all()


def test_wear_of_a_pin_that_turns_once_under_a_known_load():
    """2 pi r F; under half of it for half of a turn, and of its mean where sliding is even."""
    radius, load = 3e-3, np.where(np.arange(360) < 180, 10.0, 0.0)
    force, angle = np.stack([np.full(360, 7.0), load], axis=-1), np.stack([TURN, 5.0 - TURN], -1)
    wear, of_mean = wear_of_pins(force, angle, radius)
    assert wear == pytest.approx([2.0 * math.pi * radius * 7.0, math.pi * radius * 10.0])
    assert of_mean == pytest.approx(wear)


def test_wear_counts_both_ways_of_a_pin_that_rocks():
    """Loaded only one way: half of what its mean load would wear, where that is even in time."""
    angle = np.minimum(TURN, 2.0 * math.pi - TURN)[:, None] / math.pi  # 0 to 1 rad and back
    force = np.full((360, 1), 5.0)
    assert wear_of_pins(force, angle, 2e-3)[0] == pytest.approx([2 * 5.0 * 2e-3])


def forces_at_rest(leg, load=0.0):
    """Forces that hold a leg at all crank angles, under a load on its toe."""
    q, still, contact = np.zeros((360, 4)), np.zeros((360, 4)), np.zeros((360, 1, 3))
    q[:, 3], contact[:, 0, 1] = TURN, load
    return joint_forces(leg, q, still, contact=contact, fixed_base=True, q_ddot=still)


@WAYS
def test_the_crank_gets_what_lifts_the_toe(way):
    """Virtual work, by finite differences: the crank's torque is -load dy/dpsi without weights."""
    leg, load, d = letters_leg(way), 20.0, 1e-6
    leg = replace(leg, bodies=tuple(replace(b, mass=1e-12, inertia=0.0) for b in leg.bodies))
    before, after = (toe_positions(leg, TURN + e)[:, 0, 1] for e in (-d, d))
    found = forces_at_rest(leg, load)
    assert found.torque == pytest.approx(-load * (after - before) / (2.0 * d), abs=1e-8)
    pins = pin_loads(leg, TURN, 0.0, np.full(360, load))
    assert pins == pytest.approx(found.magnitude[:, 0])


@WAYS
def test_what_lifts_the_legs_comes_back(way):
    """The crank's torque is the slope of the weights' energy, so its work in a turn is nothing."""
    leg = letters_leg(way)
    found = forces_at_rest(leg)
    weights = GRAVITY * np.array([body.mass for body in leg.bodies])
    energy = np.fft.rfft(found.centres[:, 0, :, 1] @ weights)
    slope = np.fft.irfft(1j * np.arange(energy.size) * energy, 360)
    assert found.torque == pytest.approx(slope, abs=1e-9)
    assert abs(found.torque.sum()) < 1e-9 * np.abs(found.torque).sum()


def test_both_assemblies_have_the_same_links():
    """All sides are as long; B alone lies on the other side of the way from A to P."""
    ours, other = (letters_leg(way) for way in reversed(LEGS))
    assert other.linkage.dyads == OTHER_WAY.dyads != ours.linkage.dyads
    for one, two in zip(ours.bodies, other.bodies, strict=True):
        sides = [one.length] if isinstance(one, Bar) else one.sides
        assert sorted(sides) == pytest.approx(
            sorted([two.length] if isinstance(two, Bar) else two.sides)
        )
    place = np.stack([joint_positions(leg, "fore", TURN) for leg in (ours, other)])
    P, A, B = (place[:, :, OTHER_WAY.joints.index(joint)] for joint in "PAB")
    way, to = P - A, B - A
    side = way[..., 0] * to[..., 1] - way[..., 1] * to[..., 0]
    assert side[0] == pytest.approx(-side[1])


def test_measures_of_a_leg_need_no_legs_motor_or_size():
    """Its robot's other legs and motor change nothing; twice as long a leg steps twice as far."""
    built = ROBOTS["built"]()
    assert held_leg_measures(built) == held_leg_measures(replace(built, legs=(Leg("fore"),)))
    small = letters_leg("Jansen's leg")
    found, large = (held_leg_measures(one, load=20.0) for one in (small, ROBOTS["holy_slender"]()))
    for name in ("leg_duty", "leg_flatness", "leg_ripple"):
        assert found[name] == pytest.approx(large[name], rel=1e-9)
    assert large["leg_step"] == pytest.approx(found["leg_step"] * 108.34 / 15.0)


def test_a_leg_that_does_not_close_has_no_measures():
    leg = ROBOTS["holy"]().with_bodies(upper_rod=Bar(0.01))
    found = held_leg_measures(leg)
    assert list(found) == list(held_leg_measures(ROBOTS["holy"]()))
    assert all(map(math.isnan, found.values()))
