"""A robot in MuJoCo, as a simulation backend that policies and controllers can drive.

The robot is the one that ``jansen-env mjcf`` exports. Walks, policies and benchmarks see the same
interface as on the backends of the package:

    with environments_in_mujoco():
        env = gym.make("JansenWalkerBuilt-v0", plant="rigid_body", time_step=1e-4)

MuJoCo replaces the equations of motion, the joints and the contacts. The motor, the placement at a
reset, the observations and the rewards are those of the package.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import override

from jansen_env.arrays import Array, Ints
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.plants import plant
from jansen_env.plants.mujoco_model import hinge_angles, to_mjcf
from jansen_env.plants.plant import Plant
from jansen_env.plants.rigid.rigid_batch import RigidBodyBatch
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

TIME_STEP = 1e-4  # s
SLIDING = 0.999  # fraction of the friction limit from which a pad counts as sliding
RATE_STEP = 1e-6  # crank angle, in rad, over which the rates of the hinges are computed


class MujocoBatch(RigidBodyBatch):
    """A single robot on level ground or a slope, simulated by MuJoCo.

    Args:
        robot: The robot.
        terrain: The ground.
        time_step: Time step of MuJoCo, in s.
        *arguments: Further arguments of :class:`RigidBodyBatch`.
        settings: Further arguments of :func:`jansen_env.plants.mujoco_model.to_mjcf`, by name.
        **others: Further arguments of :class:`RigidBodyBatch`, by name.

    Attributes:
        model: Model of MuJoCo.
        data: State of MuJoCo.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        time_step: float = TIME_STEP,
        *arguments: Any,
        settings: dict[str, float] | None = None,
        **others: Any,
    ) -> None:
        self._settings = settings or {}
        super().__init__(robot, terrain, time_step, *arguments, **others)

    @override
    def _take_parameters(self) -> None:
        """Export the robot with the parameters of its episode."""
        super()._take_parameters()
        if not np.allclose(self._effective_gravity, (0.0, -GRAVITY)):
            raise ValueError(f"gravity must be {GRAVITY} m/s^2, got {self._effective_gravity}")
        self.model = mujoco.MjModel.from_xml_string(self._model_text())
        self.data = mujoco.MjData(self.model)
        self._height = float(self.model.body("chassis").pos[2])
        pads = np.flatnonzero(self.model.geom_contype)
        names = [f"{robot_leg}_{joint}" for robot_leg, joint in toe_names(self._machine)]
        toes = {self.model.geom(name).id: k for k, name in enumerate(names)}
        self._toe = {pad: toes.get(pad, -1) for pad in pads.tolist()}  # -1: joints other than toes

    def _model_text(self) -> str:
        """Return the robot on its terrain as MJCF."""
        ground: Any = self._ground
        return to_mjcf(self._machine, ground, self.time_step, **self._settings)

    @override
    def _build(self, state: Array, bristle: Array | None = None) -> None:
        """Set the pose and the speeds of the bodies in MuJoCo, too."""
        super()._build(state, bristle)
        mujoco.mj_resetData(self.model, self.data)
        q, v = state[:4], state[4:]
        self.data.qpos[:2] = q[0], q[1] - self._height
        self.data.qvel[:2] = v[:2]
        put_hinges(self.data, self._machine, q, v)

    @override
    def place_at(
        self, rows: Ints, crank_angles: ArrayLike, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place the robot as the projection backend does, with toes slightly in the ground."""
        super().place_at(rows, crank_angles, x, pitch)
        self._build(self.states[0] - PLACEMENT_DEPTH * np.eye(8)[1])

    @property
    def mujoco_state(self) -> Array:
        """x, y, theta, psi and their rates, in m, rad and s, shape (8,)."""
        state = np.concatenate([self.data.qpos[:4], self.data.qvel[:4]])
        state[1] += self._height
        return state

    @override
    def _run(self, torque: float, earlier: float, switch: int, impulses: Array) -> None:
        """Simulate one time step for each impulse; pushes have no effect in MuJoCo."""
        data = self.data
        h = self.time_step
        motor = self._machine.motor
        self.accumulators[:] = np.zeros((), self.accumulators.dtype)
        self.slip[:] = self.contact_force[:] = self.joint_gap[:] = 0.0
        self._pressed = np.zeros(len(impulses))
        total = self.accumulators[0]
        duration = h * len(impulses)
        for k in range(len(impulses)):
            speed = float(data.qvel[3])
            data.ctrl[0] = motor.torque(earlier if k < switch else torque, speed)
            mujoco.mj_step(self.model, data)
            self.joint_gap[0] = max(self.joint_gap[0], widest_gap(data))
            used = float(data.ctrl[0])
            mean_speed = 0.5 * (speed + float(data.qvel[3]))
            total["motor_work"] += h * used * mean_speed
            total["electrical_work"] += h * float(motor.electrical_power(used, mean_speed))
            total["torque_impulse"] += h * (used - torque)
            self._pressed[k] = self._add_contacts(total, duration)
        self.any_diverged = not np.isfinite(data.qpos).all()
        self.diverged[:] = self.any_diverged
        self.states[0] = self.mujoco_state

    def _add_contacts(self, total: np.void, duration: float) -> float:
        """Add the forces and the slip of the pads in a time step to the sums of the step.

        Returns:
            The sum of the normal impulses on all pads in the time step, in N s.
        """
        h = self.time_step
        data = self.data
        pressed = 0.0
        for geoms, row in zip(data.contact.geom, data.contact.efc_address, strict=True):
            normal, *tangential = data.efc_force[row : row + 3].tolist()
            if row < 0 or normal <= 0.0:
                continue
            pressed += h * normal
            toe = self._toe[int(geoms[1])]
            if toe < 0:
                total["non_toe_impulse"] += h * normal
                continue
            # The first tangent of a contact may point along any direction in the ground.
            frame = data.contact.frame[np.flatnonzero(data.contact.efc_address == row)[0]]
            force = tangential[0] * frame[3] + tangential[1] * frame[6]
            self.contact_force[0, toe] += np.array([force, normal]) * h / duration
            rub = math.hypot(*tangential)
            if rub >= SLIDING * self._ground.friction * normal:
                self.slip[0, toe] += h * math.hypot(*data.efc_vel[row + 1 : row + 3])
        return pressed


class MujocoPlant(Plant):
    """Single robot on a terrain, simulated by MuJoCo.

    Args:
        robot: The robot.
        terrain: Level ground or a slope.
        time_step: Time step of MuJoCo, in s.
        **settings: Further arguments of :func:`jansen_env.plants.mujoco_model.to_mjcf`.
    """

    batch: MujocoBatch

    def __init__(
        self, robot: Robot, terrain: Terrain, time_step: float = TIME_STEP, **settings: float
    ) -> None:
        super().__init__(MujocoBatch(robot, terrain, time_step, settings=settings))

    @property
    def model(self) -> mujoco.MjModel:
        """Model of MuJoCo."""
        return self.batch.model

    @property
    def data(self) -> mujoco.MjData:
        """State of MuJoCo."""
        return self.batch.data


def put_hinges(data: mujoco.MjData, robot: Robot, q: Array, v: Array) -> None:
    """Set the angles and the rates of all hinges for a motion in which all loops are closed.

    Args:
        data: State of MuJoCo. If the chassis is fixed, it has no hinge, which is left out.
        robot: The robot.
        q: Pose (x, y, theta, psi), in m and rad, shape (4,).
        v: Rates of the pose, in m/s and rad/s, shape (4,).
    """
    before = hinge_angles(robot, q - 0.5 * RATE_STEP * v)
    after = hinge_angles(robot, q + 0.5 * RATE_STEP * v)
    known = {data.model.joint(k).name for k in range(data.model.njnt)}
    for name, angle in hinge_angles(robot, q).items():
        if name in known:
            turned = math.remainder(after[name] - before[name], 2.0 * math.pi)
            data.joint(name).qpos[0] = angle
            data.joint(name).qvel[0] = turned / RATE_STEP


def widest_gap(data: mujoco.MjData) -> float:
    """Return the widest gap of the pins that close loops, at the last evaluation, in m."""
    gaps = data.efc_pos[: data.ne].reshape(-1, 3)
    return float(np.sqrt(np.square(gaps).sum(axis=1).max())) if len(gaps) else 0.0


def toe_names(robot: Robot) -> list[tuple[str, str]]:
    """Return the leg and the joint of each toe, by name."""
    return [(robot.leg_names[leg], robot.linkage.joints[joint]) for leg, joint in robot.toes]


@contextmanager
def environments_in_mujoco() -> Iterator[None]:
    """Simulate environments with ``plant="rigid_body"`` that are made in this block by MuJoCo."""
    with patch.object(plant, "RigidBodyBatch", MujocoBatch):
        yield
