"""What the pinned model cannot show: the same machine on the ground, its crank kept at a speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import positive, positive_integer
from jansen_env.dynamics.joint_forces import CORNERS, JointForces, corner_name
from jansen_env.engine import integrator
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.trace import pads_pressed, trace_forces
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
        distance, slip: m per turn. torque: mean, N m.
        one_toe, no_toe: share of the time on a single toe, and in the air.
        fell: whether the robot fell.
    """

    speed: float
    turns: int
    distance: float
    slip: float
    torque: float
    one_toe: float
    no_toe: float
    fell: bool

    @property
    def slip_per_metre(self) -> float:
        """m slid by all toes for each m walked."""
        return self.slip / self.distance if self.distance > 0.0 else math.nan


def walk(
    robot: Robot, speed: float, turns: int, friction: float = FRICTION, start: float = 0.0
) -> Walk:
    """Walk at a constant crank speed (rad/s, above 0) from standing at crank angle ``start`` (rad).

    Raises:
        ValueError: a speed or a number of turns that is not above 0.
    """
    positive_integer("turns", turns)
    plant = _turning(robot, speed, friction, start)
    plant.tracing = True
    period = 2.0 * math.pi / speed
    done, slip, work, begin = 0, 0.0, 0.0, plant.x
    end = plant.x
    toes = np.zeros(3)  # time steps with no toe, one, and more on the ground
    fell = False
    for turn in range(SETTLE + turns):
        result = plant.step(0.0, period)
        fell = result.bumped or abs(plant.state[2]) > FALLEN_PITCH
        if fell:
            break
        if turn < SETTLE:
            begin = plant.x
            continue
        done += 1
        slip += float(result.slip.sum())
        work += result.motor_work
        down = pads_pressed(plant.trace).sum(axis=1)
        toes += np.bincount(np.minimum(down, 2), minlength=3)
        end = plant.x
    count = max(done, 1)
    distance = (end - begin) / count if done else 0.0
    share = toes / max(toes.sum(), 1.0)
    torque = work / (2.0 * math.pi * count)
    return Walk(
        speed, done, distance, slip / count, torque, float(share[1]), float(share[0]), bool(fell)
    )


def walking_forces(
    robot: Robot, speed: float, turns: int, friction: float = FRICTION, every: int = 8
) -> JointForces:
    """Joint forces of every ``every``-th time step of a walk at constant crank speed (rad/s).

    Time steps in which a toe lands are left out: an impact has an impulse, not a force.

    Raises:
        ValueError: an argument not above 0, or the robot falls.
    """
    for name, value in (("turns", turns), ("every", every)):
        positive_integer(name, value)
    plant = _turning(robot, speed, friction)
    period = 2.0 * math.pi / speed
    plant.step(0.0, SETTLE * period)
    plant.tracing = True
    if plant.step(0.0, turns * period).bumped or abs(plant.state[2]) > FALLEN_PITCH:
        raise ValueError(f"the robot falls at a crank speed of {speed} rad/s")
    rows = plant.trace[~plant.landings][::every]
    return trace_forces(plant.tables, rows, plant.time_step)


def _turning(
    robot: Robot, speed: float, friction: float = FRICTION, start: float = 0.0
) -> ProjectionPlant:
    plant = ProjectionPlant(robot, Terrain.flat(friction=friction), TIME_STEP)
    plant.reset(0.0, start)
    state = plant.state
    state[7] = positive("speed", speed)
    plant.state = state
    plant.crank_driven = True
    return plant


@dataclass(frozen=True)
class Ripple:
    """A crank's speed under a constant torque, rad/s: its mean, half its range / mean; a fall?"""

    mean: float
    ripple: float
    fell: bool = False


def walking_ripple(robot: Robot, torque: float, duration: float = 20.0) -> Ripple:
    """A walk at a constant torque (N m), s long; its second half, or all of it until a fall."""
    plant = ProjectionPlant(robot, Terrain.flat(friction=FRICTION), TIME_STEP)
    plant.reset()
    plant.tracing = True
    speeds, fell = [], False
    for _ in range(round(duration / 0.1)):
        fell = plant.step(torque, 0.1).bumped or abs(plant.state[2]) > FALLEN_PITCH
        if fell:
            break
        speeds.append(plant.trace[:, integrator.AFTER + 3])
    late = np.concatenate(speeds[len(speeds) // 2 :])
    return Ripple(float(late.mean()), float(0.5 * np.ptp(late) / abs(late.mean())), bool(fell))


@dataclass(frozen=True)
class Loads:
    """The largest loads over a motion and all legs: by body (8,), and by link and joint (17,).

    Attributes:
        moment: N m, and force: N, of all constraints on each body, M x_ddot - h.
        bearing: N, of each link on each of its joints, see
            :data:`jansen_env.dynamics.joint_forces.CORNERS`.
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
