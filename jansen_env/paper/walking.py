"""What the pinned model cannot show: the same machine on the ground, its crank kept at a speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jansen_env import kernels
from jansen_env.joint_forces import CORNERS, JointForces, corner_name
from jansen_env.plants.projection import ProjectionPlant
from jansen_env.plants.trace import trace_forces
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

TIME_STEP = 1e-3  # s
FALLEN_PITCH = 1.2  # rad, as in JansenWalker-v0
FRICTION = 0.8  # as in JansenWalker-v0
SETTLE = 1  # turns from standing that are not counted


@dataclass(frozen=True)
class Walk:
    """Turns at a constant crank speed on flat ground.

    Attributes:
        speed: of the crank, rad/s. turns: completed before a fall, after those that settle.
        distance, slip: m per turn. torque: mean, N m. landings: toes put down per turn.
        fell: whether the robot fell.
    """

    speed: float
    turns: int
    distance: float
    slip: float
    torque: float
    landings: float
    fell: bool

    @property
    def slip_per_metre(self) -> float:
        """m slid by all toes for each m walked."""
        return self.slip / self.distance if self.distance > 0.0 else math.nan


def walk(robot: Robot, speed: float, turns: int, friction: float = FRICTION) -> Walk:
    """Walk at a constant crank speed (rad/s) from standing at crank angle 0."""
    plant = _turning(robot, speed, friction)
    plant.tracing = True
    period = 2.0 * math.pi / speed
    done, fell, slip, work, landings, start = 0, False, 0.0, 0.0, 0, 0.0
    for turn in range(SETTLE + turns):
        if turn == SETTLE:
            start = plant.x
        result = plant.step(0.0, period)
        if result.bumped or abs(plant.state[2]) > FALLEN_PITCH:
            fell = True
            break
        if turn >= SETTLE:
            done += 1
            slip += float(result.slip.sum())
            work += result.motor_work
            landings += int(plant.landings.sum())
    count = max(done, 1)
    distance = (plant.x - start) / count if done else 0.0
    torque = work / (2.0 * math.pi * count)
    return Walk(speed, done, distance, slip / count, torque, landings / count, fell)


def walking_forces(robot: Robot, speed: float, turns: int, every: int = 4) -> JointForces:
    """Joint forces of every ``every``-th time step of a walk at constant crank speed (rad/s).

    Time steps in which a toe lands are left out: an impact has an impulse, not a force.
    """
    plant = _turning(robot, speed)
    period = 2.0 * math.pi / speed
    plant.step(0.0, SETTLE * period)
    plant.tracing = True
    plant.step(0.0, turns * period)
    rows = plant.trace[~plant.landings][::every]
    return trace_forces(plant.tables, rows, plant.time_step)


def _turning(robot: Robot, speed: float, friction: float = FRICTION) -> ProjectionPlant:
    plant = ProjectionPlant(robot, Terrain.flat(friction=friction), TIME_STEP)
    plant.reset()
    state = plant.state
    state[7] = speed
    plant.state = state
    plant.crank_driven = True
    return plant


def constant_torque_speeds(robot: Robot, torque: float, duration: float = 20.0) -> Array:
    """Crank speeds (n,) rad/s every 10 ms of a walk at a constant torque (N m), first half cut."""
    plant = ProjectionPlant(robot, Terrain.flat(), TIME_STEP)
    plant.reset()
    plant.tracing = True
    plant.step(torque, duration)
    return np.asarray(plant.trace[len(plant.trace) // 2 :: 10, kernels.AFTER + 3])


@dataclass(frozen=True)
class Loads:
    """The largest loads over a motion and all legs: by body (8,), and by link and joint (17,).

    Attributes:
        moment: N m, and force: N, of all constraints on each body, M x_ddot - h.
        bearing: N, of each link on each of its joints (:data:`jansen_env.joint_forces.CORNERS`).
    """

    moment: Array
    force: Array
    bearing: Array

    @property
    def place(self) -> str:
        """Where the largest bearing force is."""
        return corner_name(int(self.bearing.argmax()))

    def on(self, body: int) -> float:
        """The largest bearing force of a link, N."""
        return max(f for f, (b, _) in zip(self.bearing, CORNERS, strict=False) if b == body)


def largest_loads(forces: JointForces) -> Loads:
    """The largest of all instants and legs."""
    every = tuple(range(forces.body.ndim - 2))
    return Loads(
        moment=np.abs(forces.body[..., 0]).max(axis=every),
        force=np.hypot(forces.body[..., 1], forces.body[..., 2]).max(axis=every),
        bearing=forces.bearing.max(axis=every),
    )
