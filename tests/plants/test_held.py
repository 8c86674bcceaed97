"""A held chassis, and the torque that a prescribed crank motion takes, held and walking."""

import math

import numpy as np
import pytest
from motions import pinned, shift

from jansen_env import Terrain, paper_robot
from jansen_env.dynamics import projection as pr
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.paper import free_walk
from jansen_env.plants.plant import ProjectionPlant


def crank_acceleration(plant, torque, h=2e-5):
    """Of the plant's own steps, from mean accelerations over h, 2 h, 4 h: error of order h^3."""
    mean = []
    for step in (h, 2.0 * h, 4.0 * h):
        other = pinned(plant.robot, *plant.state[[3, 7]], step)
        other.step(torque, step)
        mean.append((other.state[7] - plant.state[7]) / step)
    near, far = 2.0 * mean[0] - mean[1], 2.0 * mean[1] - mean[2]
    return (4.0 * near - far) / 3.0


@pytest.mark.slow
def test_accelerations_are_the_dense_projections(linkage, random_state, rng):
    """joint_forces() agrees with equation (12), 15 system rows, to 1e-9, and the backend's own
    steps to 1e-7.
    """
    for _ in range(5):
        psi, n = random_state()[[3, 7]]
        torque = rng.uniform(-5.0, 5.0)
        plant = pinned(linkage, psi, n)
        q, v = np.array([[0.0, 0.0, 0.0, psi], [0.0, 0.0, 0.0, n]])
        (expected,) = pr.project(linkage, q, v, torque, fixed_base=True).acceleration()
        size = max(1.0, abs(expected))
        forces = plant.batch.joint_forces(torque)
        assert forces.q_ddot == pytest.approx([0.0, 0.0, 0.0, expected], abs=1e-9 * size)
        assert forces.torque == pytest.approx(torque, abs=1e-9 * size)
        assert crank_acceleration(plant, torque) == pytest.approx(expected, abs=1e-7 * size)


def test_gravity_turns_with_a_held_chassis():
    """A robot pitched by 0.4 rad moves as a level one under gravity that is turned back by as much,
    to 1e-12.
    """
    pitched, level = (
        pinned(paper_robot(), 0.3, 2.0, gravity=g)
        for g in (9.81, (-9.81 * math.sin(0.4), -9.81 * math.cos(0.4)))
    )
    pitched.state = pitched.state + shift(pitch=0.4, x=1.0, y=-2.0)
    for plant in (pitched, level):
        plant.step(1.0, 1.0)
    assert pitched.state[[3, 7]] == pytest.approx(level.state[[3, 7]], abs=1e-12)
    assert pitched.state[[0, 1, 2, 4, 5, 6]].tolist() == [1.0, -2.0, 0.4, 0.0, 0.0, 0.0]


def test_crank_torque_is_equation_12_solved_for_tau(linkage, random_state, rng):
    """Forward dynamics of the dense projection give the acceleration back: 1e-10."""
    psi, n, n_dot = np.array([[*random_state()[[3, 7]], rng.normal()] for _ in range(10)]).T
    parts = crank_torque(linkage, psi, n, n_dot)
    assert (parts.total == parts.gravity + parts.inertia + parts.friction).all()
    for k, torque in enumerate(parts.total):
        q, v = np.array([[0.0, 0.0, 0.0, psi[k]], [0.0, 0.0, 0.0, n[k]]])
        p = pr.project(linkage, q, v, torque, fixed_base=True)
        assert p.acceleration() == pytest.approx(n_dot[k], abs=1e-10 * max(1.0, abs(torque)))
    rest, back = crank_torque(linkage, psi, 0.0), crank_torque(linkage, psi, -n, n_dot)
    assert (rest.total == parts.gravity).all()
    assert (back.friction == -parts.friction).all() and (back.inertia == parts.inertia).all()
    assert crank_torque(linkage, psi, n, n_dot, gravity=0.0).gravity == pytest.approx(0.0 * psi)


def test_walking_torque_pays_the_losses():
    """Mean torque * speed * time is the motor work (to 1e-12), and the losses of whole turns to 1
    %.
    """
    walk = free_walk.walk(paper_robot(), 1.0, turns=4)
    plant = ProjectionPlant(paper_robot(), Terrain.flat())
    plant.reset()
    plant.state = np.append(plant.state[:7], 1.0)
    plant.prescribed_crank_speed = True
    turn = 2.0 * math.pi
    plant.step(0.0, turn)
    start = plant.x
    results = [plant.step(0.0, turn) for _ in range(4)]
    work = sum(r.motor_work for r in results)
    losses = sum(r.joint_loss + r.slip_loss + r.impact_loss for r in results)
    assert walk.torque * 4.0 * turn == pytest.approx(work, rel=1e-12)
    assert work == pytest.approx(losses, rel=0.01)
    assert walk.distance == pytest.approx((plant.x - start) / 4.0, rel=1e-12)
    assert plant.state[7] == 1.0 and not walk.fell


def test_a_fall_ends_the_evaluation():
    """At 2.5 rad/s the paper's machine falls: the turns before it count, and forces are refused."""
    fallen = free_walk.walk(paper_robot(), 2.5, turns=15)
    assert fallen.fell and 0 < fallen.turns < 15 and fallen.torque > 0.0
    with pytest.raises(ValueError, match=r"the robot falls at a crank speed of 2\.5 rad/s"):
        free_walk.walking_forces(paper_robot(), 2.5, turns=15)
