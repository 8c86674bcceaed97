"""Robots set down, thrown and walked: what physics tests of all folders begin with."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Compliance, Leg, Payload, Robot, Terrain, paper_robot
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.plants.parameters import nominal
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.robot import RIGID, Spring, TorsionSpring
from jansen_env.robot.kinematics import coordinates, joint_positions

HOLD = 0.02  # s, for which a torque is held
FLIGHT = np.array([0.3, 50.0, 0.4, 2.0, 0.5, 1.0, 1.0, 5.0])
"""A state high above the ground, everything moving."""
ODD = Robot(legs=(Leg("back"), Leg("fore", 1.0), Leg("fore", 2.7), Leg("back", -2.0)))
SPRINGS = (
    Spring("E", anchor=(-0.3, 0.1), stiffness=30.0, rest_length=0.2),
    Spring("D", "C", stiffness=40.0, rest_length=0.3),
    TorsionSpring("rocker", "foot", stiffness=0.2, rest_angle=0.3),
    TorsionSpring("frame", "upper_triangle", stiffness=0.3, rest_angle=-0.3),
)
"""Springs of every kind for Jansen's leg, with torques of up to 3 N m on a crank of four legs."""
STATE = ("x", "y", "pitch", "psi", "vx", "vy", "spin", "crank")
DESIGNS = {
    **{name: replace(make(), pad_compliance=RIGID) for name, make in ROBOTS.items()},
    "loaded": Robot(payload=Payload(5.0, 0.2, (0.02, -0.2))),
    "six legs": paper_robot(3),
    "twelve legs": paper_robot(6),
}
PLANTS = {"projection": ProjectionPlant, "rigid_body": RigidBodyPlant}
PADS = {"rigid": Compliance(), "compliant": Compliance(3e4, 60.0)}
pads = pytest.mark.parametrize("name", PADS)


def shift(**by):
    """A change of state (8,) by entries of :data:`STATE`."""
    return np.array([float(by.pop(name, 0.0)) for name in STATE])


def placed(
    robot=None,
    terrain=None,
    psi=0.3,
    pitch=None,
    *,
    state=None,
    moved=None,
    locked=False,
    tracing=False,
    **arguments,
):
    """A projection plant with its robot set down, or in a ``state``; then ``moved`` by (8,)."""
    plant = ProjectionPlant(robot or Robot(), terrain or Terrain.flat(), **arguments)
    plant.reset(0.0, psi, pitch)
    if state is not None or moved is not None:
        moved = np.zeros(8) if moved is None else moved
        plant.state = np.add(plant.state if state is None else state, moved)
    plant.prescribed_crank_speed = locked
    plant.batch.tracing = tracing
    return plant


def governor(plant, speed=1.0, most=20.0):
    """Torque that holds a plant's crank, or one of a given rate, near ``speed`` rad/s, N m."""
    rate = plant.state[7] if hasattr(plant, "state") else plant
    return float(np.clip(10.0 * (speed - rate) + 1.5 * speed, -most, most))


def pull(plant, along):
    """Let gravity pull with ``along``, m/s^2, along the ground, too."""
    row = nominal(plant.robot, plant.terrain)
    row["tilt"] = -math.atan2(along, GRAVITY)
    row["gravity_scale"] = math.hypot(along, GRAVITY) / GRAVITY
    plant.set_parameters(row)


def walked(plant, speed, duration):
    """Hold the crank near ``speed`` rad/s; the results of all steps."""
    return [plant.step(governor(plant, speed), HOLD) for _ in range(round(duration / HOLD))]


def pinned(robot, psi=0.3, speed=0.0, time_step=1e-3, **arguments):
    """A plant whose chassis is held, its crank at an angle, rad, and a speed, rad/s."""
    plant = ProjectionPlant(robot, Terrain.flat(), time_step, fixed_chassis=True, **arguments)
    plant.state = shift(psi=psi, crank=speed)
    return plant


def audit(plant, torque, duration):
    """Energy not accounted for and turned over, J, and the worst residual, N s, of a motion."""
    missed = turned = residual = 0.0
    for _ in range(round(duration / HOLD)):
        result = plant.step(torque(plant), HOLD)
        assert min(result.joint_loss, result.slip_loss, result.electrical_work) >= 0.0
        missed += abs(result.energy_residual)
        turned += abs(result.motor_work) + abs(result.energy_change)
        residual = max(residual, result.residual)
    return missed, turned, residual


def depth(plant, centres=None):
    """How deep the deepest of pads, the toes' by default, reaches below the ground's line, m."""
    p = plant.toe_positions() if centres is None else centres
    line = plant.terrain.polyline
    a = line[:-1]
    along = np.diff(line, axis=0)
    share = np.clip(((p[:, None] - a) * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    away = np.linalg.norm(p[:, None] - a - share[..., None] * along, axis=-1).min(axis=1)
    away = np.where(p[:, 1] < plant.terrain.height(p[:, 0]), -away, away)
    return float((plant.robot.pad_radius - away).max())


def toes_of(robot, q):
    """(toes, 3) x, y of the pads' centres and the angles of the foot links, from the linkage."""
    rows = []
    for leg in robot.legs:
        joints = joint_positions(robot, leg.side, q[3] + leg.phase) @ [1.0, 1.0j]
        x = coordinates(robot, leg.side, q[3] + leg.phase)
        for toe, body in robot.linkage.all_pads[: len(robot.linkage.toes)]:
            centre = q[0] + 1j * q[1] + np.exp(1j * q[2]) * joints[toe]
            rows.append((centre.real, centre.imag, q[2] + x[3 * body]))
    return np.array(rows)


def momenta(plant):
    """Linear momentum (2,), spin about the centre of mass, that centre (2,), all from M(q)."""
    q, v = np.split(plant.state, 2)
    p = rd.mass_matrix(plant.tables, q) @ v
    c = complex(*rd.body_sums(plant.tables, q[3]).c) / plant.robot.mass * np.exp(1j * q[2])
    return p[:2], p[2] - (c.real * p[1] - c.imag * p[0]), q[:2] + np.array([c.real, c.imag])


def runge_kutta(slope, y, step, steps):
    """Classical fourth order; (steps + 1, n)."""
    path = [y]
    for _ in range(steps):
        k1 = slope(y)
        k2 = slope(y + 0.5 * step * k1)
        k3 = slope(y + 0.5 * step * k2)
        y = y + step / 6.0 * (k1 + 2.0 * (k2 + k3) + slope(y + step * k3))
        path.append(y)
    return np.array(path)
