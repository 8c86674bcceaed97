"""A robot in MuJoCo, as much of a plant as walks need, beside the projection plant."""

import math
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np

from jansen_env import ROBOTS, Compliance, Terrain
from jansen_env.plants.mujoco_model import body_names, hinge_angles, to_mjcf
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.plants.rigid.bodies import poses

TORQUE = 10.0  # N m, in the air
HELD_STEP = 1e-5  # s, of the held plant
STIFFNESS, VISCOSITY = 2e4, 600.0  # of pads, N/m; N s/m along the ground


class MujocoPlant:
    """A robot on a terrain in MuJoCo; ``settings``: of :func:`to_mjcf`."""

    def __init__(self, robot, terrain, time_step=1e-4, **settings):
        self.robot, self.terrain, self.time_step = robot, terrain, time_step
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(robot, terrain, time_step, **settings))
        self.data = mujoco.MjData(self.model)
        self._height = float(self.model.body("chassis").pos[2])

    def reset(self, crank_angle=0.0):
        """Place the robot as the projection plant does."""
        q = ProjectionPlant(self.robot, self.terrain).reset(crank_angle=crank_angle)[:4]
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:2] = q[0], q[1] - self._height
        for name, angle in hinge_angles(self.robot, q).items():
            self.data.joint(name).qpos[0] = angle

    @property
    def state(self):
        """(8,) as of any plant."""
        return np.array([*self.data.qpos[:4], *self.data.qvel[:4]]) + self._height * np.eye(8)[1]

    @property
    def x(self):
        """Position of the crank axis, m."""
        return float(self.data.qpos[0])

    def step(self, torque, duration):
        """Hold a torque (N m) for a while (s); of the result a walk's speed and work are right."""
        data, work = self.data, 0.0
        for _ in range(round(duration / self.time_step)):
            before = float(data.qvel[3])
            data.ctrl[0] = self.robot.motor.torque(torque, before)
            mujoco.mj_step(self.model, data)
            work += float(data.ctrl[0]) * self.time_step * 0.5 * (before + float(data.qvel[3]))
        others = {"electrical_work": math.nan, "slip": np.zeros(1), "non_toe_contact": 0}
        return SimpleNamespace(motor_work=work, **others)


def in_the_air(name, time_step, stiffness):
    """Errors over a turn under :data:`TORQUE`: crank angle, rad; mass centres of all links, m."""
    robot, period, worst = ROBOTS[name](), 0.02, np.zeros(2)
    plant, angle = ProjectionPlant(robot, Terrain.flat(), HELD_STEP, fixed_chassis=True), 0.0
    plant.reset()
    text = to_mjcf(robot, None, time_step, stiffness).replace("implicitfast", "RK4")
    model = mujoco.MjModel.from_xml_string(text)
    data, bodies = mujoco.MjData(model), [model.body(name).id for name in body_names(robot)]
    data.ctrl[0] = TORQUE
    while angle < 2.0 * math.pi:
        plant.step(TORQUE, period)
        angle = float(plant.state[3])
        mujoco.mj_step(model, data, round(period / time_step))
        mujoco.mj_kinematics(model, data)
        places = poses(robot, np.array([0.0, 0.0, 0.0, angle]))[:, 1:]
        off = np.abs(data.xipos[bodies][:, ::2] - places).max()
        worst = np.maximum(worst, (abs(float(data.qpos[0]) - angle), off))
    return worst


def half_second(name, friction, damping, time_step):
    """Largest difference of x, y, pitch and crank in half a second from rest, m and rad."""
    # Pads that are springs and dampers, and stick by a damper alone, as MuJoCo's do.
    pads = Compliance(STIFFNESS, damping, 1e-3, VISCOSITY)
    robot, ground = replace(ROBOTS[name](), pad_compliance=pads), Terrain.flat(friction)
    ours = ProjectionPlant(robot, ground, 0.5 * time_step)
    theirs = MujocoPlant(robot, ground, time_step, impratio=VISCOSITY / damping)
    ours.reset()
    theirs.reset()
    worst = 0.0
    for _ in range(50):
        ours.step(6.0, 0.01)
        theirs.step(6.0, 0.01)
        worst = max(worst, float(np.abs(ours.state - theirs.state)[:4].max()))
    return worst
