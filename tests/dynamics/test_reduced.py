"""The periodic tables against the dense projection they were compiled from."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import Bar, LinkageError, Payload, Robot, holy_numbers_robot, paper_robot
from jansen_env.dynamics import projection as pr
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.plants.design_tables import kernel_model
from jansen_env.robot.kinematics import coordinates, joint_positions
from jansen_env.robot.lengths import with_lengths

LOAD = Payload(mass=1.7, inertia=0.3, position=(0.2, 0.4))


def dense(robot, q, v, torque):
    """M, velocity terms and forces in (x, y, theta, psi), from the independent speeds T v."""

    def T_at(turn):
        return pr.tangent_matrix(robot, q + np.array([0.0, 0.0, turn, 0.0]))[0]

    p = pr.project(robot, q, v, torque)
    T = T_at(0.0)
    T_dot = v[2] * (T_at(0.5 * math.pi) - T_at(-0.5 * math.pi)) / 2.0
    terms = p.velocity_terms + p.mass @ T_dot @ v
    return T.T @ p.mass @ T, T.T @ terms, T.T @ p.generalised_forces


def test_equations_of_motion_are_the_projections(linkage, random_state, rng):
    """They agree to 1e-11 (kg, kg m^2, N, N m) anywhere, at speeds of metres and radians a second.

    Velocity terms contain second derivatives of the tables and agree to 1e-9.
    """
    tables = compile_robot(linkage)
    for _ in range(25):
        q, v = np.split(random_state(), 2)
        torque = rng.uniform(-20.0, 20.0)
        M, terms, forces = dense(linkage, q, v, torque)
        assert np.abs(rd.mass_matrix(tables, q) - M).max() <= 1e-11
        assert np.abs(rd.velocity_terms(tables, q, v) - terms).max() <= 1e-9
        assert np.abs(rd.generalised_forces(tables, q, v, torque) - forces).max() <= 1e-11


def test_a_load_adds_a_rigid_body(random_state):
    """Its centre moves with J v, J = [1, S R p, 0], and adds J^T m J, J^T m J_dot v and J^T (0, -m
    g).
    """
    bare, laden = compile_robot(paper_robot()), compile_robot(replace(paper_robot(), payload=LOAD))
    for _ in range(25):
        q, v = np.split(random_state(), 2)
        place = LOAD.position[0] + 1j * LOAD.position[1]
        arm = place * np.exp(1j * q[2])
        J = np.array([[1.0, 0.0, -arm.imag, 0.0], [0.0, 1.0, arm.real, 0.0]])
        J_dot_v = -(v[2] ** 2) * np.array([arm.real, arm.imag])
        M = LOAD.mass * J.T @ J + np.diag([0.0, 0.0, LOAD.inertia, 0.0])
        terms = LOAD.mass * J.T @ J_dot_v
        forces = J.T @ [0.0, -9.81 * LOAD.mass]
        grown = rd.mass_matrix(laden, q) - rd.mass_matrix(bare, q)
        assert np.abs(grown - M).max() <= 1e-13
        grown = rd.velocity_terms(laden, q, v) - rd.velocity_terms(bare, q, v)
        assert np.abs(grown - terms).max() <= 1e-12
        args = q, v, 2.0
        grown = rd.generalised_forces(laden, *args) - rd.generalised_forces(bare, *args)
        assert np.abs(grown - forces).max() <= 1e-12


def test_pads_follow_their_joints(robot, tables, rng):
    """Positions from the tables, mirrored for back legs, agree to 1e-12, and turning rates
    to 1e-9.
    """
    width = 2.0 * math.pi / tables.pads.shape[1]
    layout = tables.layout
    pads = kernel_model(tables).layout[0]
    for k in range(len(layout.leg)):
        leg = robot.legs[layout.leg[k]]
        psi = rng.uniform(0.0, 2.0 * math.pi)
        angle = (pads["mirror"][k] * psi + pads["phase"][k]) % (2.0 * math.pi)
        row = int(angle / width)
        t = angle - (row + 0.5) * width
        x, y, turn = (np.polynomial.Polynomial(c) for c in tables.pads[pads["table"][k], row].T)
        joint, body = robot.linkage.all_pads[layout.joint[k]]
        place = joint_positions(robot, leg.side, psi + leg.phase)[joint]
        assert [pads["mirror"][k] * x(t), y(t)] == pytest.approx(place, abs=1e-12)
        leg_x = coordinates(robot, leg.side, psi + leg.phase)
        D = pr.orthogonal_complement(pr.constraint_matrix(robot, leg.side, leg_x), 4)
        assert turn.deriv()(t) == pytest.approx(D[3 * body, 3], abs=1e-9)
        if leg.side == "fore":
            assert np.exp(1j * turn(t)) == pytest.approx(np.exp(1j * leg_x[3 * body]), abs=1e-12)


def test_pads_are_all_toes_then_bumpers(robot, tables):
    """Toes come in the order of legs, then each leg's knee, ankle and hip corners, and a pivot for
    each side.
    """
    layout = tables.layout
    linkage = robot.linkage
    sides = {leg.side for leg in robot.legs}
    toes = len(robot.toes)
    each = len(linkage.toes)
    pads = [(leg, linkage.all_pads[k][0]) for leg, k in zip(layout.leg, layout.joint, strict=True)]
    assert layout.toes == toes and (*pads[:toes],) == robot.toes
    assert (layout.joint[:toes] < each).all() and (layout.joint[toes:] >= each).all()
    frames = sum(body == 1 for _, body in linkage.pads)
    others = (len(linkage.pads) - frames) * len(robot.legs) + frames * len(sides)
    assert len(layout.leg) == toes + others
    assert len(set(zip(layout.leg, layout.joint, strict=True))) == len(layout.leg)


def test_built_in_tables_have_converged(tables):
    """The terms that are cut off are rounding for the paper's lengths, and below 1e-12 for the holy
    numbers.
    """
    assert tables.tail <= 1e-12


def test_a_linkage_near_a_singular_position_is_refused():
    """A crank of 0.165 m still turns, but its tables would be wrong; 0.2 m does not turn."""
    with pytest.raises(ValueError, match="tables have not converged") as error:
        compile_robot(Robot().with_bodies(crank=Bar(0.165)))
    assert not isinstance(error.value, LinkageError)
    with pytest.raises(LinkageError, match="does not close at crank angle"):
        compile_robot(Robot().with_bodies(crank=Bar(0.2)))


@pytest.mark.parametrize(
    "frame, tail, pads, inertia",
    [(38.0, 1e-6, 1e-9, 5e-7), (37.93, rd.TAIL_TOLERANCE, 1e-8, 1e-5)],
)
def test_near_a_dead_point_the_tables_are_as_exact_as_they_say(frame, tail, pads, inertia):
    """This holds for the holy numbers with a level frame (38 instead of 38.8), and for lengths that
    are nearly refused.
    """
    crank = holy_numbers_robot().body("crank").length
    robot = with_lengths(holy_numbers_robot(), {"frame": crank / 15.0 * frame, "frame_angle": 0.0})
    tables = compile_robot(robot)
    assert rd.CONVERGED < 0.5 * tail < tables.tail <= tail
    psi = np.linspace(-math.pi, math.pi, 2001)
    places = joint_positions(robot, "fore", psi)
    for table, (joint, _) in zip(tables.pads, robot.linkage.all_pads, strict=True):
        assert np.abs(rd._evaluate(table, psi)[0][:, :2] - places[:, joint]).max() < pads
    slow = [
        np.diag(dense(robot, np.array([0.0, 1.0, 0.0, angle]), np.zeros(4), 0.0)[0])
        for angle in psi[::20]
    ]
    fast = [
        np.diag(rd.mass_matrix(tables, np.array([0.0, 1.0, 0.0, angle]))) for angle in psi[::20]
    ]
    assert np.abs(np.array(fast) - slow).max() < inertia * np.max(slow, axis=0)[3]


def test_equal_robots_are_compiled_once():
    """The second compilation returns the first one's tables, which nobody can write to."""
    tables = compile_robot(paper_robot())
    assert compile_robot(Robot()).body is tables.body
    assert not tables.body.flags.writeable and not tables.pads.flags.writeable
