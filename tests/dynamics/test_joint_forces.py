"""Joint forces against Newton and Euler, body by body, and against the other models.

Positions, angles and their derivatives come from the closed form of the linkage here, not from C,
D or M: functions of the crank angle are periodic, so their Fourier series give r' and r'' to
rounding. Points and forces are complex numbers x + i y.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Payload
from jansen_env.dynamics import projection as pr
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics.joint_forces import CORNERS, PINS, joint_forces
from jansen_env.dynamics.pads import PAD_BODIES, PAD_JOINTS, pad_layout
from jansen_env.gravity import GRAVITY
from jansen_env.robot import BEARINGS, JOINT_PAIRS
from jansen_env.robot.kinematics import JOINTS, T, coordinates, joint_positions

G = GRAVITY
LOAD = Payload(mass=1.7, inertia=0.3, position=(0.2, 0.4))
SAMPLES = 256
FIXED_BASE = pytest.mark.parametrize("fixed_base", [False, True], ids=["free", "fixed"])


@pytest.fixture
def laden(robot):
    """Each design under a load off the crank axis."""
    return replace(robot, payload=LOAD)


def periodic(robot, side, psi):
    """(3, 24) of a leg at psi: value and first two d/dpsi of 8 angles, 8 centres, 8 joints."""
    turn = 2.0 * math.pi * np.arange(SAMPLES) / SAMPLES
    x = coordinates(robot, side, turn).reshape(SAMPLES, 8, 3)
    angle = np.unwrap(x[..., 0], axis=0)
    angle[:, 1] -= turn  # the crank's goes round
    joints = joint_positions(robot, side, turn)
    f = np.concatenate([angle, x[..., 1] + 1j * x[..., 2], joints @ [1.0, 1.0j]], axis=1)
    n = np.fft.fftfreq(SAMPLES, 1.0 / SAMPLES)[:, None]
    waves = np.fft.fft(f, axis=0) / SAMPLES * np.exp(1j * n * psi)
    found = np.array([(waves * (1j * n) ** order).sum(axis=0) for order in range(3)])
    found[:, :8] = found[:, :8].real
    found[:2, 1] += psi, 1.0
    return found


class Moving:
    """Where all bodies of a robot are and how they move, at q and its two rates."""

    def __init__(self, robot, q, v, a):
        legs = [periodic(robot, leg.side, q[3] + leg.phase) for leg in robot.legs]
        f, df, ddf = np.moveaxis(legs, 1, 0)
        axis, turn, w, n = q[0] + 1j * q[1], np.exp(1j * q[2]), v[2], v[3]
        self.spin = w + n * df[:, :8].real
        self.spin_rate = a[2] + a[3] * df[:, :8].real + n * n * ddf[:, :8].real
        place, slope, curve = f[:, 8:], df[:, 8:], ddf[:, 8:]
        relative = (1j * a[2] - w * w) * place + (2j * w * n + a[3]) * slope + n * n * curve
        world, acceleration = axis + turn * place, a[0] + 1j * a[1] + turn * relative
        self.centre, self.joint = np.split(world, 2, axis=1)
        self.acceleration = acceleration[:, :8]
        self.joint_slope, self.angle_slope = turn * slope[:, 8:], df[:, :8].real  # d/dpsi
        self.axis = axis


def centres(robot, q):
    """(legs, 8) centres of mass, straight from the linkage."""
    legs = [coordinates(robot, leg.side, q[3] + leg.phase).reshape(8, 3) for leg in robot.legs]
    return q[0] + 1j * q[1] + np.exp(1j * q[2]) * (np.array(legs)[..., 1:] @ [1.0, 1.0j])


def pads(robot):
    """Leg, joint and body (from 0) of each pad, toes first."""
    layout = pad_layout(robot)
    return [
        (leg, PAD_JOINTS[kind], PAD_BODIES[kind] - 1)
        for leg, kind in zip(layout.leg, layout.joint, strict=True)
    ]


def misses(forces, moving, contact):
    """(legs, 8) force and moment left over of m a = sum F and J alpha = sum M of every body."""
    robot = forces.robot
    mass = np.array([body.mass for body in robot.bodies])
    inertia = np.array([body.inertia for body in robot.bodies])
    force = mass * (moving.acceleration + 1j * G)  # wanted: all but the weight
    moment = inertia * moving.spin_rate

    def act(body, at, given):
        arm = at - moving.centre[:, body]
        force[:, body] -= given
        moment[:, body] -= (arm.conjugate() * given).imag

    corner = forces.corner_forces() @ [1.0, 1.0j]
    for k, (body, joint) in enumerate(CORNERS):
        act(body - 1, moving.joint[:, JOINTS.index(joint)], corner[:, k])
    for k, (leg, joint, body) in enumerate(pads(robot)):
        moment[leg, body] -= contact[k, 2]
        if joint != T:  # the toe's force is in the corner's
            push = np.zeros(len(robot.legs), complex)
            push[leg] = complex(*contact[k, :2])
            act(body, moving.joint[:, joint], push)
    act(0, moving.axis, forces.frame[:, :2] @ [1.0, 1.0j])
    moment[:, 0] -= forces.frame[:, 2]
    moment[:, 1] -= forces.shaft
    for (i, j), viscous in zip(JOINT_PAIRS, robot.damping, strict=True):
        given = viscous * (moving.spin[:, j - 1] - moving.spin[:, i - 1])
        moment[:, i - 1] -= given
        moment[:, j - 1] += given
    for (i, j), dry in zip(BEARINGS, robot.bearing_friction, strict=True):
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
    """Pins, frame, shaft, contact, weight and viscous torques add up to m a and J alpha.

    At random states, torques and wrenches on all pads, for each of a leg's eight bodies, to
    rounding: 1e-11 of the largest force.
    """
    for _ in range(3):
        q, v, torque, contact = draw(laden, random_state, rng, fixed_base)
        forces = joint_forces(laden, q, v, torque, contact, fixed_base=fixed_base)
        assert (forces.toe == contact[: len(laden.legs), :2]).all()
        moving = Moving(laden, q, v, forces.q_ddot)
        assert misses(forces, moving, contact).max() <= 1e-11 * forces.magnitude.max()
        assert np.abs(forces.joints @ [1.0, 1.0j] - moving.joint).max() <= 1e-12
        assert np.abs(forces.centres @ [1.0, 1.0j] - moving.centre).max() <= 1e-12


def test_newton_and_euler_with_accelerations_from_differences(robot, random_state, rng):
    """m a of places along the q(t) that is to follow, from the linkage alone, differenced: 1e-7 N.

    Eighth order, steps of 1 ms: rounding of 1e-16 m / (1 ms)^2 makes 1e-8 m/s^2 with 0.1 kg.
    """
    h = 1e-3
    weights = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72])
    weights = np.append(weights, weights[3::-1])
    mass = np.array([body.mass for body in robot.bodies])
    for _ in range(2):
        q, v, torque, contact = draw(robot, random_state, rng, False)
        forces = joint_forces(robot, q, v, torque, contact[: len(robot.legs)])
        t = h * np.arange(-4, 5)[:, None]
        path = q + v * t + 0.5 * forces.q_ddot * t * t
        place = np.array([centres(robot, pose) for pose in path])
        wanted = mass * (np.tensordot(weights, place, 1) / h**2 + 1j * G)
        corner = forces.corner_forces() @ [1.0, 1.0j]
        for body in range(8):
            mine = [k for k, (other, _) in enumerate(CORNERS) if other == body + 1]
            found = corner[:, mine].sum(axis=1)
            if body == 0:
                found = found + forces.frame[:, :2] @ [1.0, 1.0j]
            assert np.abs(found - wanted[:, body]).max() <= 1e-7


@FIXED_BASE
def test_accelerations_are_the_reduced_models(laden, random_state, rng, fixed_base):
    """M a = h - velocity terms + virtual work on all pads, load included: 1e-9 of the largest."""
    tables = rd.compile_robot(laden)
    leg, joint, body = np.transpose(pads(laden))
    for _ in range(5):
        q, v, torque, contact = draw(laden, random_state, rng, fixed_base)
        moving = Moving(laden, q, v, np.zeros(4))
        push, twist = contact[:, :2] @ [1.0, 1.0j], contact[:, 2]
        arm = moving.joint[leg, joint] - moving.axis
        work = [push.real, push.imag, (arm.conjugate() * push).imag + twist,
                (moving.joint_slope[leg, joint].conjugate() * push).real
                + moving.angle_slope[leg, body] * twist]  # fmt: skip
        right = rd.generalised_forces(tables, q, v, torque) - rd.velocity_terms(tables, q, v)
        right += np.sum(work, axis=1)
        turning = moving.angle_slope[:, np.array(BEARINGS) - 1]
        dry = (np.abs(turning[..., 1] - turning[..., 0]) @ laden.bearing_friction).sum()
        right[3] -= np.sign(v[3]) * (dry + laden.motor.friction)
        M = rd.mass_matrix(tables, q)
        a = joint_forces(laden, q, v, torque, contact, fixed_base=fixed_base).q_ddot
        if fixed_base:
            assert (a[:3] == 0.0).all()
            expected = np.array([0.0, 0.0, 0.0, right[3] / M[3, 3]])
        else:
            expected = np.linalg.solve(M, right)
        assert np.abs(a - expected).max() <= 1e-9 * max(1.0, np.abs(expected).max())


def test_a_free_chassis_passes_on_the_motor_and_the_load(laden, random_state, rng):
    """Shafts add up to the torque; frames to the load's weight and inertia, less the reaction."""
    for _ in range(5):
        q, v, torque, contact = draw(laden, random_state, rng, False)
        forces = joint_forces(laden, q, v, torque, contact)
        scale = 1e-9 * forces.magnitude.max()
        assert forces.torque == pytest.approx(torque, abs=scale)
        a, arm = forces.q_ddot, complex(*LOAD.position) * np.exp(1j * q[2])
        carried = LOAD.mass * (a[0] + 1j * a[1] + (1j * a[2] - v[2] ** 2) * arm + 1j * G)
        x, y, moment = -forces.frame.sum(axis=0)
        assert abs(x + 1j * y - carried) <= scale
        about_axis = LOAD.inertia * a[2] + (arm.conjugate() * carried).imag
        to_shaft = torque - forces.gear
        assert moment - to_shaft - forces.rotor == pytest.approx(about_axis, abs=scale)


def test_a_fixed_base_passes_on_weight_and_inertia(robot, random_state):
    """Frames = (0, m g) + d/dt momentum, and their moment + torque = g c_x + d/dt spin; level."""
    tables = rd.compile_robot(robot)
    for _ in range(5):
        q, v = np.split(random_state(), 2)
        q[2] = v[:3] = 0.0
        forces = joint_forces(robot, q, v, 2.0, fixed_base=True)
        s, n, n_dot = rd.body_sums(tables, q[3]), v[3], forces.q_ddot[3]
        x, y, moment = forces.frame.sum(axis=0)
        scale = 1e-9 * forces.magnitude.max()
        inertia = s.dc * n_dot + s.ddc * n * n
        assert [x, y - robot.mass * G] == pytest.approx(inertia, abs=scale)
        spin_rate = s.b * n_dot + s.db * n * n
        to_shaft = forces.torque - forces.gear
        assert moment + to_shaft + forces.rotor == pytest.approx(spin_rate + G * s.c[0], abs=scale)
        assert forces.torque == pytest.approx(2.0, abs=scale)


def test_held_at_rest(robot, rng):
    """With the torque g c_y' nothing accelerates (1e-9) and the frames carry the weight."""
    tables = rd.compile_robot(robot)
    for psi in rng.uniform(-3.0, 3.0, 10):
        q, rest = np.array([0.3, -0.2, 0.0, psi]), np.zeros(4)
        torque = G * rd.body_sums(tables, psi).dc[1]
        forces = joint_forces(robot, q, rest, torque, fixed_base=True)
        assert np.abs(forces.q_ddot).max() <= 1e-9
        support = forces.frame.sum(axis=0)[:2]
        assert support == pytest.approx([0.0, robot.mass * G], abs=1e-9)


@FIXED_BASE
def test_constraint_forces_of_the_projection(linkage, random_state, rng, fixed_base):
    """The paper's C^T lambda of every body (4) is the sum of its pins, its frame's and its shaft's.

    There the motor is an applied force in h: +tau on the first leg's crank, -tau on its frame.
    """
    q, v, torque, _ = draw(linkage, random_state, rng, fixed_base)
    if fixed_base:
        q[:3] = 0.0
    forces = joint_forces(linkage, q, v, torque, fixed_base=fixed_base)
    moving = Moving(linkage, q, v, np.zeros(4))
    total = np.zeros((len(linkage.legs), 8, 3))  # moment, x, y

    def act(body, at, given):
        total[:, body, 1:] += given
        arm = at - moving.centre[:, body]
        total[:, body, 0] += (arm.conjugate() * (given @ [1.0, 1.0j])).imag

    for k, pin in enumerate(PINS):
        at = moving.joint[:, JOINTS.index(pin.joint)]
        act(pin.body - 1, at, forces.pin[:, k])
        act(pin.other - 1, at, -forces.pin[:, k])
    act(0, moving.axis, forces.frame[:, :2])
    total[:, 0, 0] += forces.frame[:, 2]
    total[:, 1, 0] += forces.shaft
    total[0, :2, 0] += torque, -torque
    paper = pr.project(linkage, q, v, torque, fixed_base=fixed_base).constraint_forces()
    assert np.abs(total.ravel() - paper).max() <= 1e-9 * np.abs(paper).max()
    assert np.abs(forces.body.ravel() - paper).max() <= 1e-12 * np.abs(paper).max()


@FIXED_BASE
def test_prescribed_accelerations_give_back_the_torque(laden, random_state, rng, fixed_base):
    """Inverse after forward dynamics: the same forces everywhere, the torque not being told."""
    q, v, torque, contact = draw(laden, random_state, rng, fixed_base)
    forward = joint_forces(laden, q, v, torque, contact, fixed_base=fixed_base)
    inverse = joint_forces(
        laden, q, v, contact=contact, fixed_base=fixed_base, q_ddot=forward.q_ddot
    )
    for name in ("pin", "frame", "shaft"):
        assert (getattr(inverse, name) == getattr(forward, name)).all()


def test_gravity_may_point_anywhere(laden, random_state):
    """Robot and gravity turned by the same angle: every force is turned and is as large."""
    state, turn = random_state(), 0.7
    q, v = state[:4], state[4:]
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, -s], [s, c]])
    upright = joint_forces(laden, q, v, 2.0, gravity=G)
    q_turned, v_turned = q.copy(), v.copy()
    q_turned[:2], v_turned[:2], q_turned[2] = R @ q[:2], R @ v[:2], q[2] + turn
    turned = joint_forces(laden, q_turned, v_turned, 2.0, gravity=tuple(R @ [0.0, -G]))
    scale = np.abs(upright.pin).max()
    assert np.abs(turned.pin - upright.pin @ R.T).max() <= 1e-11 * scale
    assert np.abs(turned.pin - upright.pin).max() > 0.1 * scale


@FIXED_BASE
def test_at_a_standstill_bearings_and_gear_share_what_they_hold(fixed_base):
    """Half of all dry friction is half of each: every force lies half way."""
    robot = replace(ROBOTS["built"](), payload=LOAD)
    q, rest, torque = np.array([0.1, 0.2, 0.3, 1.2]), np.zeros(4), 0.4
    free = joint_forces(robot, q, rest, torque, fixed_base=fixed_base)
    sliding = joint_forces(robot, q, 1e-12 * np.eye(4)[3], torque, fixed_base=fixed_base)
    slope = Moving(robot, q, np.eye(4)[3], np.zeros(4)).angle_slope[:, np.array(BEARINGS) - 1]
    turning = slope[..., 1] - slope[..., 0]
    most = (np.abs(turning) @ robot.bearing_friction).sum() + robot.motor.friction
    held = joint_forces(robot, q, rest, torque, dry=-0.5 * most, fixed_base=fixed_base)
    for name in ("pin", "frame", "shaft", "gear", "rotor", "q_ddot"):
        halfway = 0.5 * (getattr(free, name) + getattr(sliding, name))
        assert getattr(held, name) == pytest.approx(halfway, abs=1e-9)
    assert held.torque == pytest.approx(torque, abs=1e-9)
    assert np.abs(free.pin - sliding.pin).max() > 0.1
