"""Mirror image and change of scale: what the laws of motion do not see, the robot does not feel.

Mirror x -> -x: a leg's own crank angle a becomes pi - a and its side the other one. With
a = psi + phase this is psi -> pi - psi, phase -> -phase, theta -> -theta, torque -> -torque.

Scale: lengths times S and masses times F under the same gravity make times sqrt(S), forces F,
torques F S, inertias F S^2 and viscous coefficients (torque times time) F S^1.5 times as large.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Leg, Payload, Robot, Terrain
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.plants.projected import ProjectionPlant

HOLD = 0.02  # s, for which a torque is held
TOUCHING = 1e-9  # m, by which the small robot is in the ground
FLIGHT = np.array([0.3, 50.0, 0.4, 2.0, 0.5, 1.0, 1.0, 5.0])
ODD_LEGS = (Leg("back"), Leg("fore", 1.0), Leg("fore", 2.7), Leg("back", -2.0))
ODD = Robot(legs=ODD_LEGS, payload=Payload(2.0, 0.1, (0.1, 0.2)))
ROUGH = Terrain.rough(np.random.default_rng(0), start=-5.0)
BODIES = ("frame", "crank", "upper_rod", "upper_triangle", "rocker", "lower_rod", "coupler", "foot")
WALKS = {
    "paper flat": (Robot(), Terrain.flat()),
    "paper uphill": (Robot(), Terrain.slope(0.1)),
    "paper bouncing": (Robot(), Terrain.flat(restitution=0.5)),
    "holy rough": (ROBOTS["holy"](), ROUGH),
    "odd downhill": (ODD, Terrain.slope(-0.1)),
    "odd rough": (ODD, ROUGH),
}
S, F = 4.0, 8.0  # powers of two, which round nothing
TIME = math.sqrt(S)
UNITS = np.array([S, S, 1.0, 1.0, TIME, TIME, 1.0 / TIME, 1.0 / TIME])


def mirrored(robot):
    """Its mirror image, leg by leg, so that toes keep their numbers."""
    other = {"fore": "back", "back": "fore"}
    x, y = robot.payload.position
    return replace(
        robot,
        legs=tuple(Leg(other[leg.side], -leg.phase) for leg in robot.legs),
        payload=replace(robot.payload, position=(-x, y)),
    )


def mirrored_ground(terrain):
    return replace(terrain, points=tuple((-x, y) for x, y in reversed(terrain.points)))


def mirrored_state(state):
    x, y, theta, psi, vx, vy, w, n = state
    return np.array([-x, y, -theta, math.pi - psi, -vx, vy, -w, -n])


def scaled(robot):
    """The robot S times as long and F times as heavy."""

    def body(old):
        lengths = ("length",) if hasattr(old, "length") else ("d", "l", "h")
        new = {name: S * getattr(old, name) for name in lengths}
        return replace(old, mass=F * old.mass, inertia=F * S**2 * old.inertia, **new)

    load = robot.payload
    return replace(
        robot,
        **{name: body(getattr(robot, name)) for name in BODIES},
        damping=tuple(F * S**1.5 * c for c in robot.damping),
        pad_radius=S * robot.pad_radius,
        payload=Payload(
            F * load.mass, F * S**2 * load.inertia, (S * load.position[0], S * load.position[1])
        ),
    )


def governor(speed, angle_rate):
    """Torque that holds the crank near a speed, N m."""
    return float(np.clip(10.0 * (speed - angle_rate) + 1.5 * speed, -20.0, 20.0))


@pytest.mark.parametrize("name", WALKS)
def test_mirrored_walk(name, measured):
    """5 s of walking and its mirror image: pose, rates, slip and forces; only rounding differs.

    A difference grows in touchdowns and slips; forces are velocity changes over 1 ms.
    """
    robot, terrain = WALKS[name]
    plant, image = (
        ProjectionPlant(robot, terrain),
        ProjectionPlant(mirrored(robot), mirrored_ground(terrain)),
    )
    plant.reset(0.0, 0.3)
    image.state = mirrored_state(plant.state)
    state = slip = force = 0.0
    for _ in range(250):
        here = plant.step(governor(1.0, plant.state[7]), HOLD)
        there = image.step(governor(-1.0, image.state[7]), HOLD)
        state = max(state, np.abs(mirrored_state(plant.state) - image.state).max())
        slip = max(slip, np.abs(here.slip - there.slip).max())
        force = max(force, np.abs(here.contact_force * [-1.0, 1.0] - there.contact_force).max())
    assert abs(plant.state[3] - 0.3) > 4.0  # it did walk
    measured(f"mirror image of 5 s, {name}: state", state, 1e-11, "m, rad, 1/s")
    measured(f"mirror image of 5 s, {name}: slip in 20 ms", slip, 1e-12, "m")
    measured(f"mirror image of 5 s, {name}: toe forces", force, 1e-9, "N")


def test_the_papers_robot_is_its_own_mirror_image(measured):
    """It walks to the left as to the right, rf's toe moving as rb's and lf's as lb's did.

    At friction 0.5, where Coulomb's law has one answer. At 0.8 a step's contact problem may have
    three (one foot slides, or the other, or both), and the order of the legs decides.
    """
    ground = Terrain.flat(friction=0.5)
    plants = ProjectionPlant(Robot(), ground), ProjectionPlant(Robot(), ground)
    plants[0].reset(0.0, 0.3)
    plants[1].state = mirrored_state(plants[0].state)
    state = force = 0.0
    for _ in range(250):
        right, left = (
            plant.step(governor(speed, plant.state[7]), HOLD)
            for plant, speed in zip(plants, (1.0, -1.0), strict=True)
        )
        state = max(state, np.abs(mirrored_state(plants[0].state) - plants[1].state).max())
        image = right.contact_force[[2, 3, 0, 1]] * [-1.0, 1.0]
        force = max(force, np.abs(image - left.contact_force).max())
    assert plants[0].x > 0.1
    measured("paper's robot walking left as right in 5 s: state", state, 1e-11, "m, rad, 1/s")
    measured("paper's robot walking left as right in 5 s: toe forces", force, 1e-9, "N")


def compare_scales(robot, terrain, law, duration, time_step, state=None, locked=False):
    """Largest difference of the scaled robot's state (8,), force, slip and energies, scaled back.

    ``law``: torque in N m of the crank's rate, both in the small robot's units.
    """
    small = ProjectionPlant(robot, terrain, time_step)
    ground = replace(terrain, points=tuple((S * x, S * y) for x, y in terrain.points))
    large = ProjectionPlant(
        scaled(robot), ground, TIME * time_step, detection_interval=TIME * small.detection_interval
    )
    small.reset(0.0, 0.3)
    placed = small.state
    placed[1] += PLACEMENT_DEPTH - TOUCHING  # or the large one would be too deep
    small.state = placed if state is None else state
    large.state = UNITS * small.state
    small.prescribed_crank_speed = large.prescribed_crank_speed = locked
    apart, force, slip, energy = np.zeros(8), 0.0, 0.0, 0.0
    for _ in range(round(duration / HOLD)):
        here = small.step(law(small.state[7]), HOLD)
        there = large.step(F * S * law(TIME * large.state[7]), TIME * HOLD)
        apart = np.maximum(apart, np.abs(small.state - large.state / UNITS))
        force = max(force, np.abs(here.contact_force - there.contact_force / F).max())
        slip = max(slip, np.abs(here.slip - there.slip / S).max())
        for name in ("motor_work", "joint_loss", "slip_loss", "impact_loss", "energy_change"):
            energy = max(energy, abs(getattr(here, name) - getattr(there, name) / (F * S)))
    return apart, force, slip, energy


SCALED = {  # no toe is ever pushed out of the ground here
    "flight": (ODD, Terrain.flat(), lambda rate: 2.0, 1.0, 1e-3, FLIGHT),
    "standing": (Robot(), Terrain.flat(), lambda rate: 0.0, 1.0, 1e-3),
    "sliding": (Robot(), Terrain.slope(0.4, friction=0.2), lambda rate: 0.0, 1.0, 1e-3, None, True),
    "walk at 20 us": (Robot(), Terrain.flat(), lambda rate: governor(1.0, rate), 2.0, 2e-5),
}


@pytest.mark.parametrize("name", SCALED)
def test_scaled_robot(name, measured):
    """4 times as long, 8 times as heavy: the same motion, forces and energies in scaled units.

    To rounding, which is why the walk's time step is so small: a toe that touches down at 1 m/s
    goes no deeper than 20 um, which the kernels leave alone (and to larger depths they apply a
    length). In flight collision detection runs after 5 cm, whatever the scale: energies are 1500 J
    there, rounded to 2e-13 J at every query.
    """
    apart, force, slip, energy = compare_scales(*SCALED[name])
    measured(f"scaled robot, {name}: state", apart.max(), 1e-13, "m, rad, 1/s")
    measured(f"scaled robot, {name}: toe forces", force, 2e-12, "N")
    measured(f"scaled robot, {name}: slip in 20 ms", slip, 1e-14, "m")
    measured(f"scaled robot, {name}: energies in 20 ms", energy, 2e-12, "J")


@pytest.mark.parametrize("name", ["paper flat", "paper uphill"])
def test_scaled_walk_at_1_ms(name, measured):
    """What the 20 um of penetration that are left alone do to a walk: they do not scale.

    Landing toes stay 20 um deep where 80 um / 4 would be 5 um, so that the next one lands sooner
    or later: in 2 s about a millimetre of pose, friction 0.5.
    """
    robot, terrain = WALKS[name]
    terrain = replace(terrain, friction=0.5)
    apart, *_ = compare_scales(robot, terrain, lambda rate: governor(1.0, rate), 2.0, 1e-3)
    measured(f"scaled robot, 2 s at 1 ms, {name}: pose", apart[:4].max(), 2e-3, "m, rad")
