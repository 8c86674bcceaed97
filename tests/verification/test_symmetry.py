"""Mirror image and change of scale: what the laws of motion do not see, the robot does not feel.

Mirrored are psi -> pi - psi, phase -> -phase, theta -> -theta, torque -> -torque. Lengths times S
and masses times F make times sqrt(S), forces F, torques F S, inertias F S^2, viscous
coefficients F S^1.5.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import FLIGHT, HOLD, ODD, governor, placed

from jansen_env import ROBOTS, Leg, Payload, Robot, Terrain, paper_robot
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.plants import batch
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.robot import Bar, Plate

TOUCHING = 1e-9  # m, by which the small robot is in the ground
ODD_LADEN = replace(ODD, payload=Payload(2.0, 0.1, (0.1, 0.2)))
ROUGH = Terrain.rough(np.random.default_rng(0), start=-5.0)
WALKS = {
    "paper flat": (Robot(), Terrain.flat()),
    "paper uphill": (Robot(), Terrain.slope(0.1)),
    "paper bouncing": (Robot(), Terrain.flat(restitution=0.5)),
    "holy rough": (ROBOTS["holy"](), ROUGH),
    "klann flat": (ROBOTS["klann"](), Terrain.flat()),
    "strider uphill": (ROBOTS["strider"](), Terrain.slope(0.1)),
    "odd downhill": (ODD_LADEN, Terrain.slope(-0.1)),
    "odd rough": (ODD_LADEN, ROUGH),
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
        if isinstance(old, Plate):
            points = tuple((S * x, S * y) for x, y in old.points)
            return Plate(points, F * old.mass, F * S**2 * old.inertia)
        lengths = ("length",) if isinstance(old, Bar) else ("d", "l", "h")
        new = {name: S * getattr(old, name) for name in lengths}
        return replace(old, mass=F * old.mass, inertia=F * S**2 * old.inertia, **new)

    load = robot.payload
    return replace(
        robot,
        bodies=tuple(body(link) for link in robot.bodies),
        damping=tuple(F * S**1.5 * c for c in robot.damping),
        pad_radius=S * robot.pad_radius,
        payload=Payload(
            F * load.mass, F * S**2 * load.inertia, (S * load.position[0], S * load.position[1])
        ),
    )


@pytest.mark.parametrize("name", WALKS)
def test_mirrored_walk(name, measured):
    """In 5 s only rounding differs in pose, rates, slip and forces (velocity changes over 1 ms)."""
    robot, terrain = WALKS[name]
    plant, image = placed(robot, terrain), placed(mirrored(robot), mirrored_ground(terrain))
    image.state = mirrored_state(plant.state)
    state = slip = force = 0.0
    for _ in range(250):
        here = plant.step(governor(plant, 1.0), HOLD)
        there = image.step(governor(image, -1.0), HOLD)
        state = max(state, np.abs(mirrored_state(plant.state) - image.state).max())
        slip = max(slip, np.abs(here.slip - there.slip).max())
        force = max(force, np.abs(here.contact_force * [-1.0, 1.0] - there.contact_force).max())
    assert abs(plant.state[3] - 0.3) > 4.0  # it did walk
    measured(f"mirror image of 5 s, {name}: state", state, 1e-11, "m, rad, 1/s")
    measured(f"mirror image of 5 s, {name}: slip in 20 ms", slip, 1e-12, "m")
    measured(f"mirror image of 5 s, {name}: toe forces", force, 1e-9, "N")


def test_the_papers_robot_is_its_own_mirror_image(measured):
    """The friction is 0.5: at 0.8 Coulomb's law may have three answers, of which the legs' order
    decides.
    """
    ground = Terrain.flat(friction=0.5)
    plants = placed(terrain=ground), placed(terrain=ground)
    plants[1].state = mirrored_state(plants[0].state)
    state = force = 0.0
    for _ in range(250):
        right = plants[0].step(governor(plants[0], 1.0), HOLD)
        left = plants[1].step(governor(plants[1], -1.0), HOLD)
        state = max(state, np.abs(mirrored_state(plants[0].state) - plants[1].state).max())
        image = right.contact_force[[2, 3, 0, 1]] * [-1.0, 1.0]
        force = max(force, np.abs(image - left.contact_force).max())
    assert plants[0].x > 0.1
    measured("paper's robot walking left as right in 5 s: state", state, 1e-11, "m, rad, 1/s")
    measured("paper's robot walking left as right in 5 s: toe forces", force, 1e-9, "N")


def compare_scales(robot, terrain, law, duration, time_step, state=None, locked=False):
    """Largest difference of state (8,), force, slip and energies, scaled back; ``law`` of rate."""
    small = ProjectionPlant(robot, terrain, time_step)
    ground = replace(terrain, points=tuple((S * x, S * y) for x, y in terrain.points))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "DETECTION_INTERVAL", TIME * batch.DETECTION_INTERVAL)
        large = ProjectionPlant(scaled(robot), ground, TIME * time_step)
    small.reset(0.0, 0.3)
    placed = small.state
    placed[1] += PLACEMENT_DEPTH - TOUCHING  # or the large one would be too deep
    small.state = placed if state is None else state
    large.state = UNITS * small.state
    small.prescribed_crank_speed = large.prescribed_crank_speed = locked
    apart = np.zeros(8)
    force = slip = energy = 0.0
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
    "flight": (ODD_LADEN, Terrain.flat(), lambda rate: 2.0, 1.0, 1e-3, FLIGHT),
    "standing": (Robot(), Terrain.flat(), lambda rate: 0.0, 1.0, 1e-3),
    "sliding": (Robot(), Terrain.slope(0.4, friction=0.2), lambda rate: 0.0, 1.0, 1e-3, None, True),
    "walk at 20 us": (Robot(), Terrain.flat(), lambda rate: governor(rate), 2.0, 2e-5),
}


@pytest.mark.parametrize("name", SCALED)
def test_scaled_robot(name, measured):
    """4 times as long, 8 times as heavy: the same motion, forces and energies in scaled units.

    At 20 us a landing toe goes no deeper than the 20 um that are left alone. In flight collision
    detection runs after 5 cm, whatever the scale, and rounds 1500 J to 2e-13 J every time.
    """
    apart, force, slip, energy = compare_scales(*SCALED[name])
    measured(f"scaled robot, {name}: state", apart.max(), 1e-13, "m, rad, 1/s")
    measured(f"scaled robot, {name}: toe forces", force, 5e-12, "N")
    measured(f"scaled robot, {name}: slip in 20 ms", slip, 1e-14, "m")
    measured(f"scaled robot, {name}: energies in 20 ms", energy, 2e-12, "J")


SLOPES = {  # robot, crank angle, friction, torque
    "paper": (Robot(), 0.3, 0.8, 6.0),
    "holy slipping": (ROBOTS["holy"](), 2.0, 0.2, 6.0),
    "six legs": (paper_robot(3), 1.0, 0.8, -8.0),
    "trotbot": (ROBOTS["trotbot"](), 1.0, 0.5, 6.0),
}


@pytest.mark.parametrize("name", SLOPES)
@pytest.mark.parametrize("angle", [0.1, -0.2])
def test_a_slope_is_gravity_turned(name, angle, measured):
    """In 2 s, a walk on a slope is one on level ground with g turned by -angle, in the turned
    frame.
    """
    robot, psi, mu, torque = SLOPES[name]
    slope = placed(robot, Terrain.slope(angle, friction=mu), psi)
    turn = np.exp(1j * angle)
    gravity = -GRAVITY * math.sin(angle), -GRAVITY * math.cos(angle)

    def turned(state, turn, angle):
        """A state on the level as seen on the slope, or the other way round."""
        q = state.copy()
        for i in (0, 4):
            place = turn * complex(*q[i : i + 2])
            q[i : i + 2] = place.real, place.imag
        q[2] += angle
        return q

    start = turned(slope.state, 1.0 / turn, -angle)
    level = placed(robot, Terrain.flat(friction=mu), state=start, gravity=gravity)
    apart = work = slip = 0.0
    for k in range(100):
        push = torque * (1.0 + math.sin(0.3 * k))
        results = [plant.step(push, 0.02) for plant in (slope, level)]
        apart = max(apart, np.abs(slope.state - turned(level.state, turn, angle)).max())
        work += abs(results[0].contact_force - results[1].contact_force).max() * 0.02
        slip += results[0].slip.sum()
    assert abs(slope.state[3] - psi) > 1.0 and slip > 1e-4  # it stepped, it slid
    measured("state apart after 2 s", apart, 1e-12)
    measured("impulses apart", work, 1e-11, "N s")
