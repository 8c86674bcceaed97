"""Joint forces against Newton and Euler, body by body, and against the other models.

Positions and angles come from the closed form here, their derivatives from Fourier series of them.
Points and forces are complex numbers x + i y.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Bar, Payload
from jansen_env.dynamics import projection as pr
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.dynamics.pads import pad_layout
from jansen_env.robot import JANSEN
from jansen_env.robot.kinematics import coordinates, joint_positions

G = GRAVITY
LOAD = Payload(mass=1.7, inertia=0.3, position=(0.2, 0.4))
SAMPLES = 256
FIXED_BASE = pytest.mark.parametrize("fixed_base", [False, True], ids=["free", "fixed"])


@pytest.fixture
def laden(robot):
    """Each design under a load off the crank axis."""
    return replace(robot, payload=LOAD)


def periodic(robot, side, psi):
    """(3, n) of a leg at psi: value and first two d/dpsi of angles, centres and joints."""
    turn = 2.0 * math.pi * np.arange(SAMPLES) / SAMPLES
    bodies = len(robot.bodies)
    x = coordinates(robot, side, turn).reshape(SAMPLES, bodies, 3)
    angle = np.unwrap(x[..., 0], axis=0)
    angle[:, 1] -= turn  # the crank's goes round
    joints = joint_positions(robot, side, turn)
    f = np.concatenate([angle, x[..., 1] + 1j * x[..., 2], joints @ [1.0, 1.0j]], axis=1)
    n = np.fft.fftfreq(SAMPLES, 1.0 / SAMPLES)[:, None]
    waves = np.fft.fft(f, axis=0) / SAMPLES * np.exp(1j * n * psi)
    motion = np.array([(waves * (1j * n) ** order).sum(axis=0) for order in range(3)])
    motion[:, :bodies] = motion[:, :bodies].real
    motion[:2, 1] += psi, 1.0
    return motion


class Moving:
    """Where all bodies of a robot are and how they move, at q and its two rates."""

    def __init__(self, robot, q, v, a):
        legs = [periodic(robot, leg.side, q[3] + leg.phase) for leg in robot.legs]
        f, df, ddf = np.moveaxis(legs, 1, 0)
        bodies = len(robot.bodies)
        axis = q[0] + 1j * q[1]
        turn = np.exp(1j * q[2])
        w = v[2]
        n = v[3]
        self.spin = w + n * df[:, :bodies].real
        self.spin_rate = a[2] + a[3] * df[:, :bodies].real + n * n * ddf[:, :bodies].real
        place = f[:, bodies:]
        slope = df[:, bodies:]
        curve = ddf[:, bodies:]
        relative = (1j * a[2] - w * w) * place + (2j * w * n + a[3]) * slope + n * n * curve
        world = axis + turn * place
        acceleration = a[0] + 1j * a[1] + turn * relative
        self.centre, self.joint = np.split(world, [bodies], axis=1)
        self.acceleration = acceleration[:, :bodies]
        self.joint_slope = turn * slope[:, bodies:]
        self.angle_slope = df[:, :bodies].real
        self.axis = axis


def pads(robot):
    """Leg, joint and body (from 0) of each pad, toes first."""
    layout = pad_layout(robot)
    known = robot.linkage.all_pads
    return [(leg, *known[kind]) for leg, kind in zip(layout.leg, layout.joint, strict=True)]


def misses(forces, moving, contact):
    """(legs, 8) force and moment left over of m a = sum F and J alpha = sum M of every body."""
    robot = forces.robot
    linkage = forces.robot.linkage
    mass = np.array([body.mass for body in robot.bodies])
    inertia = np.array([body.inertia for body in robot.bodies])
    force = mass * (moving.acceleration + 1j * G)  # wanted: all but the weight
    moment = inertia * moving.spin_rate

    def act(body, at, given):
        arm = at - moving.centre[:, body]
        force[:, body] -= given
        moment[:, body] -= (arm.conjugate() * given).imag

    corner = forces.corner_forces() @ [1.0, 1.0j]
    for k, (body, joint) in enumerate(linkage.corners):
        act(body - 1, moving.joint[:, linkage.joints.index(joint)], corner[:, k])
    for k, (leg, joint, body) in enumerate(pads(robot)):
        moment[leg, body] -= contact[k, 2]
        if k >= len(robot.toes):  # a toe's force is in the corner's
            push = np.zeros(len(robot.legs), complex)
            push[leg] = complex(*contact[k, :2])
            act(body, moving.joint[:, joint], push)
    act(0, moving.axis, forces.frame[:, :2] @ [1.0, 1.0j])
    moment[:, 0] -= forces.frame[:, 2]
    moment[:, 1] -= forces.shaft
    for (i, j), viscous in zip(linkage.damped, robot.damping, strict=True):
        given = viscous * (moving.spin[:, j - 1] - moving.spin[:, i - 1])
        moment[:, i - 1] -= given
        moment[:, j - 1] += given
    for (i, j), dry in zip(linkage.bearings, robot.bearing_friction, strict=True):
        given = dry * np.sign(moving.spin[:, j - 1] - moving.spin[:, i - 1])
        moment[:, i - 1] -= given
        moment[:, j - 1] += given
    return np.concatenate([np.abs(force), np.abs(moment)])


def draw(robot, random_state, rng, fixed_base):
    """A state, a torque, and a wrench on every pad."""
    q, v = np.split(random_state(), 2)
    if fixed_base:
        v[:3] = 0.0
    return q, v, rng.uniform(-10.0, 10.0), rng.uniform(-20.0, 20.0, (len(pads(robot)), 3))


@FIXED_BASE
def test_newton_and_euler_hold_for_every_body(laden, random_state, rng, fixed_base):
    """Pins, frame, shaft, contact, weight and viscous torques add up to m a and J alpha: 1e-11."""
    for _ in range(3):
        q, v, torque, contact = draw(laden, random_state, rng, fixed_base)
        forces = joint_forces(laden, q, v, torque, contact, fixed_base=fixed_base)
        assert (forces.toe == contact[: len(laden.toes), :2]).all()
        moving = Moving(laden, q, v, forces.q_ddot)
        assert misses(forces, moving, contact).max() <= 1e-11 * forces.magnitude.max()
        assert np.abs(forces.joints @ [1.0, 1.0j] - moving.joint).max() <= 1e-12
        assert np.abs(forces.centres @ [1.0, 1.0j] - moving.centre).max() <= 1e-12


@FIXED_BASE
def test_constraint_forces_of_the_projection(linkage, random_state, rng, fixed_base):
    """They are C^T lambda of every body in equation (4) of the paper."""
    q, v, torque, _ = draw(linkage, random_state, rng, fixed_base)
    if fixed_base:
        q[:3] = 0.0
    forces = joint_forces(linkage, q, v, torque, fixed_base=fixed_base)
    paper = pr.project(linkage, q, v, torque, fixed_base=fixed_base).constraint_forces()
    assert np.abs(forces.body.ravel() - paper).max() <= 1e-12 * np.abs(paper).max()


def test_gravity_may_point_anywhere(laden, random_state):
    """If robot and gravity are turned by the same angle, every force turns with them and keeps its
    magnitude.
    """
    state = random_state()
    turn = 0.7
    q, v = state[:4], state[4:]
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, -s], [s, c]])
    upright = joint_forces(laden, q, v, 2.0, gravity=G)
    q_turned, v_turned = q.copy(), v.copy()
    q_turned[:2] = R @ q[:2]
    v_turned[:2] = R @ v[:2]
    q_turned[2] = q[2] + turn
    turned = joint_forces(laden, q_turned, v_turned, 2.0, gravity=tuple(R @ [0.0, -G]))
    scale = np.abs(upright.pin).max()
    assert np.abs(turned.pin - upright.pin @ R.T).max() <= 1e-11 * scale
    assert np.abs(turned.pin - upright.pin).max() > 0.1 * scale


@FIXED_BASE
def test_at_a_standstill_bearings_and_gear_share_what_they_hold(fixed_base):
    """Half of all dry friction is half of each share: every force lies half way."""
    robot = replace(ROBOTS["built"](), payload=LOAD)
    q = np.array([0.1, 0.2, 0.3, 1.2])
    rest = np.zeros(4)
    torque = 0.4
    free = joint_forces(robot, q, rest, torque, fixed_base=fixed_base)
    sliding = joint_forces(robot, q, 1e-12 * np.eye(4)[3], torque, fixed_base=fixed_base)
    slope = Moving(robot, q, np.eye(4)[3], np.zeros(4)).angle_slope
    turning = np.diff(slope[:, np.array(JANSEN.bearings) - 1])[..., 0]
    most = (np.abs(turning) @ robot.bearing_friction).sum() + robot.motor.friction
    held = joint_forces(robot, q, rest, torque, dry=-0.5 * most, fixed_base=fixed_base)
    for name in ("pin", "frame", "shaft", "gear", "q_ddot"):
        halfway = 0.5 * (getattr(free, name) + getattr(sliding, name))
        assert getattr(held, name) == pytest.approx(halfway, abs=1e-9)
    assert held.torque == pytest.approx(torque, abs=1e-9)
    assert np.abs(free.pin - sliding.pin).max() > 0.1


def bars(robot, first):
    """Name, link and the corners at both ends of each bar from a body number on."""
    linkage = robot.linkage
    for body, (name, link) in enumerate(zip(linkage.names, robot.bodies, strict=True), start=1):
        if body >= first and isinstance(link, Bar):
            yield name, link, [k for k, (of, _) in enumerate(linkage.corners) if of == body]


def test_virtual_work_of_a_longer_bar(robot, rng):
    """With the robot at rest and the crank held, a bar's mean axial load is -dV/dL, with V the
    potential energy of its leg.
    """
    weight = G * np.array([part.mass for part in robot.bodies])
    h = 1e-4
    for name, link, ends in bars(robot, first=2):
        psi = rng.uniform(-3.0, 3.0)
        q = np.array([0.0, 0.0, 0.0, psi])
        rest = np.zeros(4)
        forces = joint_forces(robot, q, rest, fixed_base=True, q_ddot=rest)
        for loads, leg in zip(forces.link_loads()[:, ends, 0], robot.legs, strict=True):

            def potential(change, leg=leg, psi=psi, name=name, link=link):
                longer = robot.with_bodies(**{name: replace(link, length=link.length + change)})
                return coordinates(longer, leg.side, psi + leg.phase)[2::3] @ weight

            near, far = (potential(s) - potential(-s) for s in (h, 2.0 * h))
            assert loads.mean() == pytest.approx(-(8.0 * near - far) / (12.0 * h), abs=1e-7)


def test_many_instants_are_each_one(laden, random_state, rng):
    """(2, 3) instants at once, one by one, and through :meth:`at` are the same to rounding."""
    draws = [draw(laden, random_state, rng, False) for _ in range(6)]
    shape = ((2, 3, 4), (2, 3, 4), (2, 3), (2, 3, len(pads(laden)), 3))
    args = [np.reshape(arg, s) for arg, s in zip(zip(*draws, strict=True), shape, strict=True)]
    every = joint_forces(laden, *args)
    one_by_one = [joint_forces(laden, *each) for each in draws]
    for k, single in enumerate(one_by_one):
        for name in ("pin", "frame", "shaft", "toe", "joints", "centres", "q_ddot"):
            value, expected = getattr(every.at(k // 3).at(k % 3), name), getattr(single, name)
            assert value.shape == expected.shape
            assert value == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert every.torque.shape == (2, 3) and every.link_loads().shape[:2] == (2, 3)
    assert every.largest()[0] == every.bearing.max()
    size, leg, pin = max(single.largest() for single in one_by_one)
    assert every.largest() == (pytest.approx(size), leg, pin)


def test_bearing_does_not_depend_on_how_links_are_paired(laden, random_state, rng):
    """This holds for every corner but the toe.

    At joints of two links both bear as much, at joints of three they add up.
    """
    q, v, torque, contact = draw(laden, random_state, rng, False)
    forces = joint_forces(laden, q, v, torque, contact[: len(laden.toes)])
    corner = forces.corner_forces()
    bearing = forces.bearing
    linkage = laden.linkage
    held = [k for k, (_, joint) in enumerate(linkage.corners) if joint not in linkage.toes]
    free = [k for k, (_, joint) in enumerate(linkage.holes) if joint not in linkage.toes]
    assert bearing.shape == (len(laden.legs), len(linkage.holes))
    size = np.hypot(corner[:, held, 0], corner[:, held, 1])
    assert bearing[:, free] == pytest.approx(size, abs=1e-12)
    for joint in {*linkage.joints} - {*linkage.toes}:
        at = [k for k, (_, name) in enumerate(linkage.corners) if name == joint]
        scale = np.abs(corner).max()
        assert np.abs(corner[:, at].sum(axis=1)).max() <= 1e-12 * scale  # action and reaction


@pytest.mark.parametrize("side", ["fore", "back"])
def test_pins_are_the_papers_constraints(robot, side):
    """Each pair of rows is x_body - x_other + ..., and closes at the joint that names the pin."""
    x = coordinates(robot, side, 0.7)
    joints = joint_positions(robot, side, 0.7)
    place = x.reshape(-1, 3)[:, 1:]
    linkage = robot.linkage
    phi = pr.constraints(robot, side, x)
    for i, pin in enumerate(linkage.pins):
        for body, sign in ((pin.body, 1.0), (pin.other, -1.0)):
            assert (body, pin.joint) in linkage.corners
            turned = x.copy()
            turned[3 * (body - 1)] += math.pi  # its arm points the other way
            arm = -0.5 * sign * (pr.constraints(robot, side, turned) - phi)[2 * i : 2 * i + 2]
            corner = place[body - 1] + arm
            assert corner == pytest.approx(joints[linkage.joints.index(pin.joint)], abs=1e-12)
    assert len({str(pin) for pin in linkage.pins}) == len(linkage.pins)
    assert str(JANSEN.pins[1]) == "A23"
