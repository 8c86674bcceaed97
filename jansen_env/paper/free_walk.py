"""Walks of the paper's machine on the ground, its crank kept at a speed: beyond the fixed model."""

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
SETTLE = 1  # turns from standing that are not counted


def walk_on(
    plant: ProjectionPlant, settle: float, duration: float, count: int, torque: float = 0.0
) -> Iterator[tuple[float, StepResult]]:
    """``count`` traced intervals of ``duration`` s after ``settle`` s; a fall ends them.

    Yields x (m) at the interval's start and its result; x and trace of the plant are its end's.
    """
    if settle > 0.0 and _fallen(plant, plant.step(torque, settle)):
        return
    plant.batch.tracing = True
    for _ in range(count):
        start, result = plant.x, plant.step(torque, duration)
        if _fallen(plant, result):
            return
        yield start, result


def _fallen(plant: ProjectionPlant, result: StepResult) -> bool:
    return bool(result.non_toe_contact or abs(plant.state[2]) > FALLEN_PITCH)


def prescribed_speed(
    robot: Robot, terrain: Terrain, speed: float, start: float = 0.0, time_step: float = TIME_STEP
) -> ProjectionPlant:
    """A robot standing at a crank angle (rad), its crank turning at a prescribed speed (rad/s)."""
    plant = ProjectionPlant(robot, terrain, time_step)
    plant.reset(0.0, start)
    plant.state = np.append(plant.state[:7], speed)
    plant.prescribed_crank_speed = True
    return plant


class Walk(NamedTuple):
    """Turns at a constant crank speed on flat ground."""

    speed: float  # of the crank, rad/s
    turns: int  # completed before a fall, after those that settle
    distance: float  # m per turn, negative if it walks backwards
    slip: float  # m per turn
    torque: float  # mean, N m
    one_toe: float  # share of the time on a single toe
    no_toe: float  # and in the air
    fell: bool

    @property
    def slip_per_metre(self) -> float:
        """m slid by all toes for each m walked either way; NaN where it got nowhere."""
        return self.slip / abs(self.distance) if self.distance != 0.0 else math.nan


def walk(
    robot: Robot,
    speed: float,
    turns: int,
    friction: float = FRICTION,
    start: float = 0.0,
    time_step: float = TIME_STEP,
) -> Walk:
    """Walk at a constant crank speed (rad/s, above 0) from standing at an angle ``start`` (rad)."""
    period = 2.0 * math.pi / speed
    plant = prescribed_speed(robot, Terrain.flat(friction=friction), speed, start, time_step)
    places: list[float] = []
    slip, work = 0.0, 0.0
    toes = np.zeros(3)  # time steps with no toe, one, and more on the ground
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
        speed, done,
        distance=(places[-1] - places[0]) / count if places else 0.0,
        slip=slip / count, torque=work / (2.0 * math.pi * count),
        one_toe=one_toe, no_toe=no_toe, fell=done < turns,
    )  # fmt: skip


def walking_forces(
    robot: Robot, speed: float, turns: int, friction: float = FRICTION
) -> JointForces:
    """Joint forces of every eighth time step of a walk at constant crank speed (rad/s).

    Time steps with a touchdown are left out: an impact has an impulse, not a force.

    Raises ValueError: the robot falls.
    """
    period = 2.0 * math.pi / speed
    plant = prescribed_speed(robot, Terrain.flat(friction=friction), speed)
    for _ in walk_on(plant, SETTLE * period, turns * period, count=1):
        rows = plant.batch.trace[~plant.batch.touchdowns][::8]
        return trace_forces(plant.tables, rows, plant.time_step)
    raise ValueError(f"the robot falls at a crank speed of {speed} rad/s")


class Ripple(NamedTuple):
    """A crank's speed under a constant torque, rad/s: its mean, half its range / mean; a fall?"""

    mean: float
    ripple: float
    fell: bool = False

    @classmethod
    def of(cls, speed: Array, fell: bool = False) -> "Ripple":
        """That of the crank speeds (n,) of a motion."""
        mean = float(speed.mean())
        return cls(mean, float(0.5 * np.ptp(speed) / abs(mean)), fell)


def walking_ripple(robot: Robot, torque: float) -> Ripple:
    """A walk of 20 s at a constant torque (N m); its second half, or all of it until a fall."""
    plant = ProjectionPlant(robot, Terrain.flat(friction=FRICTION), TIME_STEP)
    plant.reset()
    parts = walk_on(plant, 0.0, 0.1, 200, torque)
    speeds = [plant.batch.trace["velocity_after"][:, 3] for _ in parts]
    return Ripple.of(np.concatenate(speeds[len(speeds) // 2 :]), len(speeds) < 200)


class Loads(NamedTuple):
    """The largest loads over a motion and all legs."""

    moment: Array  # (8,) N m, of all constraints on each body, M x_ddot - h
    force: Array  # (8,) N, likewise
    bearing: Array  # (17,) N, of each link on each of its joints, in the order of JANSEN.holes

    @property
    def place(self) -> str:
        """Index of the largest bearing force."""
        return corner_name(JANSEN, int(self.bearing.argmax()))

    def on(self, body: int) -> float:
        """The largest bearing force of a link, N."""
        return max(f for f, (b, _) in zip(self.bearing, JANSEN.holes, strict=True) if b == body)


def largest_loads(forces: JointForces) -> Loads:
    """The largest of all instants and legs."""
    every = tuple(range(forces.body.ndim - 2))
    return Loads(
        moment=np.abs(forces.body[..., 0]).max(axis=every),
        force=np.hypot(forces.body[..., 1], forces.body[..., 2]).max(axis=every),
        bearing=forces.bearing.max(axis=every),
    )
