"""Painleve's paradox: the friction from which on a toe may have no way to slide.

A toe slides with P_n = -q_n / (W_nn -+ mu W_nt) (C. R. Acad. Sci. 121, 1895): beyond W_nn / |W_nt|
that has no solution, or several; time stepping stops the toe at once (SIAM Review 42, 2000).
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Payload, Robot, Terrain
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.projection import system_coordinates
from jansen_env.paper import toes
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.robot.kinematics import T, world_joints

HOLD = 0.02  # s, for which a torque is held
LEFT = 2e-5  # m, penetration that is left alone
THETA_8 = 21  # of a leg's coordinates: the angle of its foot
THRESHOLDS = {  # friction: in any posture on any slope, and standing on level ground
    "paper": (3.43, 3.44),
    "paper_slender": (0.79, 0.97),
    "holy": (4.13, 4.23),
    "holy_slender": (0.77, 0.78),
}
LOADED = {"paper": 1.65, "paper_slender": 0.46, "holy": 1.91, "holy_slender": 0.49}  # 5 kg


def delassus(robot, psi, pitch, toe):
    """W (..., n, 2, 2), tangential first, of a toe at psi (n,), pitch (..., n): J by difference."""
    q = np.zeros((len(psi), 4))
    q[:, 3] = psi
    centre = np.zeros((len(psi), 2, 4))
    rolled = np.zeros((len(psi), 1, 4))
    small = 1e-6
    for i in range(4):
        step = small * np.eye(4)[i]
        after, before = (world_joints(robot, q + s)[:, toe, T] for s in (step, -step))
        centre[..., i] = (after - before) / (2.0 * small)
        after, before = (system_coordinates(robot, q + s)[:, toe, THETA_8] for s in (step, -step))
        rolled[:, 0, i] = np.angle(np.exp(1j * (after - before))) / (2.0 * small)
    cos, sin = np.cos(pitch), np.sin(pitch)
    world = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    J = world @ centre + np.array([[robot.pad_radius], [0.0]]) * rolled
    M = np.array([rd.mass_matrix(rd.compile_robot(robot), pose) for pose in q])
    return J @ np.linalg.inv(M) @ np.swapaxes(J, -1, -2)


def threshold(robot, psi, pitch, toe):
    """The least W_nn / |W_nt| of a toe over crank angles (n,) and pitches (..., n)."""
    W = delassus(robot, psi, pitch, toe)
    return (W[..., 1, 1] / np.abs(W[..., 0, 1])).min()


def any_posture(robot):
    """The least threshold of all toes over crank angles and pitches."""
    psi = toes.turn(180)
    pitch = np.linspace(-1.5, 1.5, 61)[:, None] * np.ones(180)
    return min(threshold(robot, psi, pitch, toe) for toe in range(len(robot.legs)))


@pytest.mark.slow
@pytest.mark.parametrize("name", THRESHOLDS)
def test_thresholds(name):
    """They agree by robot to 1 %, at postures 2 and 3 degrees apart; a load on the crank axis
    lowers them.
    """
    robot = ROBOTS[name]()
    anywhere, standing = THRESHOLDS[name]
    assert any_posture(robot) == pytest.approx(anywhere, rel=0.01)
    support = toes.double_support(robot, samples=360)
    poses = toes.standing_poses(robot, support.angle)
    least = min(
        threshold(robot, support.angle[carries == toe], poses[carries == toe, 1], toe)
        for carries in (support.front, support.rear)
        for toe in np.unique(carries)
    )
    assert least == pytest.approx(standing, rel=0.01)
    loaded = replace(robot, payload=Payload(5.0))
    assert any_posture(loaded) == pytest.approx(LOADED[name], rel=0.01)


def painleve_postures(plant, mu):
    """Postures on one toe, sliding so that W_nn -+ mu W_nt < 0: (state, toe, crank angle)."""
    postures = []
    for psi in np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False):
        for pitch in np.linspace(-0.6, 0.6, 9):
            state = plant.reset(0.0, psi, pitch)
            toe = int(np.argmin(plant.toe_positions()[:, 1]))
            W = delassus(plant.robot, np.array([psi]), np.array([pitch]), toe)[0]
            if W[1, 1] < 0.98 * mu * abs(W[0, 1]):
                state[4] = math.copysign(1.0, W[0, 1])  # slides with friction pressing it down
                postures.append((state, toe))
    return postures


@pytest.mark.parametrize("mu", [pytest.param(4.0, marks=pytest.mark.slow), 5.0])
def test_painleve(mu, measured):
    """The toe is stopped by an impulse without a collision, and the robot never gains energy."""
    robot = Robot()
    plant = ProjectionPlant(robot, Terrain.flat(friction=mu))
    postures = painleve_postures(plant, mu)
    assert len(postures) > 10
    residual = gained = sliding = deepest = 0.0
    for state, toe in postures:
        plant.state = state
        kinetic = 0.5 * robot.mass
        first = plant.step(0.0, plant.time_step)
        weight = robot.mass * GRAVITY
        assert first.contact_force[toe, 1] > 10.0 * weight  # no force balance: an impact
        sliding = max(sliding, first.slip[toe])
        for result in [first, *(plant.step(0.0, HOLD) for _ in range(10))]:
            residual = max(residual, result.residual / (robot.mass * 1.0))
            gained = max(gained, result.energy_change / kinetic)
            deepest = max(deepest, float((robot.pad_radius - plant.toe_positions()[:, 1]).max()))
        assert np.isfinite(plant.state).all()
    measured(f"Painleve, friction {mu:g}: contact law violated", residual, 1e-14)
    measured(f"Painleve, friction {mu:g}: energy gained in 20 ms", gained, 1e-9)
    measured(f"Painleve, friction {mu:g}: slip in the step of the impact", sliding, 1e-12, "m")
    measured(f"Painleve, friction {mu:g}: penetration", deepest, 2.0 * LEFT, "m")
