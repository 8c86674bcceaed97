"""Walks of the paper's robot on the ground at constant crank speed or torque.

The paper itself contains only the model with a fixed chassis.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Array
from jansen_env.dynamics.joint_forces import JointForces, corner_name
from jansen_env.engine.walk_reward import FALLEN_PITCH
from jansen_env.plants.base import StepResult
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.plants.trace import pads_in_contact, trace_forces
from jansen_env.robot import JANSEN, Robot
from jansen_env.terrain import Terrain

TIME_STEP = 1e-3  # s
FRICTION = 0.8  # as in JansenWalker-v0
SETTLE = 1  # number of turns after standing that are not counted


def walk_on(
    plant: ProjectionPlant, settle: float, duration: float, count: int, torque: float = 0.0
) -> Iterator[tuple[float, StepResult]]:
    """Simulate several intervals and trace them, until the robot falls.

    After each interval, ``plant`` is at the end of the interval and contains its trace.

    Args:
        plant: Simulation backend with the robot.
        settle: Time before the first interval, in s.
        duration: Duration of an interval, in s.
        count: Number of intervals.
        torque: Commanded torque, in N m.

    Yields:
        Position x at the start of the interval in m, and the result of the interval.
    """
    if settle > 0.0 and _fallen(plant, plant.step(torque, settle)):
        return
    plant.batch.tracing = True
    for _ in range(count):
        start = plant.x
        result = plant.step(torque, duration)
        if _fallen(plant, result):
            return
        yield start, result


def _fallen(plant: ProjectionPlant, result: StepResult) -> bool:
    """Return whether the robot has fallen."""
    return bool(result.non_toe_contact or abs(plant.state[2]) > FALLEN_PITCH)


def prescribed_speed(
    robot: Robot, terrain: Terrain, speed: float, start: float = 0.0, time_step: float = TIME_STEP
) -> ProjectionPlant:
    """Return a simulation of a robot that stands and whose crank turns at a prescribed speed.

    Args:
        robot: The robot.
        terrain: The terrain.
        speed: Crank speed, in rad/s.
        start: Crank angle at which the robot stands, in rad.
        time_step: Time step, in s.
    """
    plant = ProjectionPlant(robot, terrain, time_step)
    plant.reset(0.0, start)
    plant.state = np.append(plant.state[:7], speed)
    plant.prescribed_crank_speed = True
    return plant


class Walk(NamedTuple):
    """A walk at a constant crank speed on flat ground.

    Attributes:
        speed: Crank speed, in rad/s.
        turns: Number of turns that the robot completed before a fall, after the first
            :data:`SETTLE` turns.
        distance: Distance walked per turn, in m. It is negative if the robot walks backwards.
        slip: Slip of all toes per turn, in m.
        torque: Mean torque, in N m.
        one_toe: Fraction of the time in which exactly one toe touches the ground.
        no_toe: Fraction of the time in which no toe touches the ground.
        fell: Whether the robot fell.
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
        """Slip of all toes per metre walked in either direction. NaN if the robot did not move."""
        return self.slip / abs(self.distance) if self.distance != 0.0 else math.nan


def walk(
    robot: Robot,
    speed: float,
    turns: int,
    friction: float = FRICTION,
    start: float = 0.0,
    time_step: float = TIME_STEP,
) -> Walk:
    """Simulate a walk at a constant crank speed.

    Args:
        robot: The robot.
        speed: Crank speed, in rad/s, above 0.
        turns: Number of turns after the first :data:`SETTLE` turns.
        friction: Coulomb friction coefficient of the flat ground.
        start: Crank angle at which the robot stands at first, in rad.
        time_step: Time step, in s.
    """
    period = 2.0 * math.pi / speed
    plant = prescribed_speed(robot, Terrain.flat(friction=friction), speed, start, time_step)
    places: list[float] = []
    slip = 0.0
    work = 0.0
    toes = np.zeros(3)  # numbers of time steps with no toe, one toe, and several toes on the ground
    for begin, result in walk_on(plant, SETTLE * period, period, turns):
        places += [begin, plant.x]
        slip += float(result.slip.sum())
        work += result.motor_work
        down = pads_in_contact(plant.batch.trace).sum(axis=1)
        toes += np.bincount(np.minimum(down, 2), minlength=3)
    done = len(places) // 2
    count = max(done, 1)
    no_toe, one_toe, _ = (toes / max(toes.sum(), 1.0)).tolist()
    return Walk(
        speed,
        done,
        distance=(places[-1] - places[0]) / count if places else 0.0,
        slip=slip / count,
        torque=work / (2.0 * math.pi * count),
        one_toe=one_toe,
        no_toe=no_toe,
        fell=done < turns,
    )


def walking_forces(
    robot: Robot, speed: float, turns: int, friction: float = FRICTION
) -> JointForces:
    """Return the joint forces at every eighth time step of a walk at a constant crank speed.

    Time steps with a touchdown are left out, because an impact has an impulse and not a force.

    Args:
        robot: The robot.
        speed: Crank speed, in rad/s.
        turns: Number of turns after the first :data:`SETTLE` turns.
        friction: Coulomb friction coefficient of the flat ground.

    Raises:
        ValueError: If the robot falls.
    """
    period = 2.0 * math.pi / speed
    plant = prescribed_speed(robot, Terrain.flat(friction=friction), speed)
    for _ in walk_on(plant, SETTLE * period, turns * period, count=1):
        rows = plant.batch.trace[~plant.batch.touchdowns][::8]
        return trace_forces(plant.tables, rows, plant.time_step)
    raise ValueError(f"the robot falls at a crank speed of {speed} rad/s")


class Ripple(NamedTuple):
    """Variation of the crank speed under a constant torque.

    Attributes:
        mean: Mean crank speed, in rad/s.
        ripple: Half the range of the crank speed, divided by the magnitude of the mean.
        fell: Whether the robot fell.
    """

    mean: float
    ripple: float
    fell: bool = False

    @classmethod
    def of(cls, speed: Array, fell: bool = False) -> "Ripple":
        """Return the variation of the crank speed in a motion.

        Args:
            speed: Crank speeds, in rad/s, shape (n,).
            fell: Whether the robot fell.
        """
        mean = float(speed.mean())
        return cls(mean, float(0.5 * np.ptp(speed) / abs(mean)), fell)


def walking_ripple(robot: Robot, torque: float) -> Ripple:
    """Return the variation of the crank speed in a walk of 20 s at a constant torque.

    It is computed from the second half of the walk, or of the part before a fall.

    Args:
        robot: The robot.
        torque: Torque on the crank, in N m.
    """
    plant = ProjectionPlant(robot, Terrain.flat(friction=FRICTION), TIME_STEP)
    plant.reset()
    parts = walk_on(plant, 0.0, 0.1, 200, torque)
    speeds = [plant.batch.trace["velocity_after"][:, 3] for _ in parts]
    return Ripple.of(np.concatenate(speeds[len(speeds) // 2 :]), len(speeds) < 200)


class Loads(NamedTuple):
    """The largest loads over a motion and over all legs.

    Attributes:
        moment: Moment of all constraints on each body, M x_ddot - h, in N m, shape (8,).
        force: Magnitude of the force of all constraints on each body, in N, shape (8,).
        bearing: Force on each link at each of its joints, in N, in the order of ``JANSEN.holes``,
            shape (17,).
    """

    moment: Array
    force: Array
    bearing: Array

    @property
    def place(self) -> str:
        """Name of the corner with the largest bearing force, such as ``"link 1 at P"``."""
        return corner_name(JANSEN, int(self.bearing.argmax()))

    def on(self, body: int) -> float:
        """Return the largest bearing force on a link, in N.

        Args:
            body: Number of the link, from 1.
        """
        return max(f for f, (b, _) in zip(self.bearing, JANSEN.holes, strict=True) if b == body)


def largest_loads(forces: JointForces) -> Loads:
    """Return the largest loads over all instants and legs."""
    every = tuple(range(forces.body.ndim - 2))
    return Loads(
        moment=np.abs(forces.body[..., 0]).max(axis=every),
        force=np.hypot(forces.body[..., 1], forces.body[..., 2]).max(axis=every),
        bearing=forces.bearing.max(axis=every),
    )
