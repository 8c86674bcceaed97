"""What the fixed model cannot show: the same machine on the ground, its crank kept at a speed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, positive, positive_integer, whole_number
from jansen_env.dynamics.joint_forces import CORNERS, JointForces, corner_name
from jansen_env.engine.task import FALLEN_PITCH
from jansen_env.plants.base import StepResult
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.trace import pads_pressed, trace_forces
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

TIME_STEP = 1e-3  # s
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
    robot: Robot,
    speed: float,
    turns: int,
    friction: float = FRICTION,
    start: float = 0.0,
    time_step: float = TIME_STEP,
) -> Walk:
    """Walk at a constant crank speed (rad/s, above 0) from standing at crank angle ``start`` (rad).

    Raises:
        ValueError: a speed, a number of turns or a time step (s) that is not above 0.
    """
    positive_integer("turns", turns)
    terrain = Terrain.flat(friction=friction)
    plant = _driven(robot, terrain, positive("speed", speed), start, time_step)
    plant.tracing = True
    period = 2.0 * math.pi / speed
    done, slip, work, begin = 0, 0.0, 0.0, plant.x
    end = plant.x
    toes = np.zeros(3)  # time steps with no toe, one, and more on the ground
    fell = False
    for turn in range(SETTLE + turns):
        result = plant.step(0.0, period)
        fell = _fallen(plant, result)
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
    fraction = toes / max(toes.sum(), 1.0)
    torque = work / (2.0 * math.pi * count)
    return Walk(
        speed, done, distance, slip / count, torque, float(fraction[1]), float(fraction[0]), fell
    )


def walking_forces(
    robot: Robot,
    speed: float,
    turns: int,
    friction: float = FRICTION,
    every: int = 8,
    time_step: float = TIME_STEP,
) -> JointForces:
    """Joint forces of every ``every``-th time step of a walk at constant crank speed (rad/s).

    Time steps with a touchdown are left out: an impact has an impulse, not a force.

    Raises:
        ValueError: an argument not above 0, or the robot falls.
    """
    for name, value in (("turns", turns), ("every", every)):
        positive_integer(name, value)
    terrain = Terrain.flat(friction=friction)
    plant = _driven(robot, terrain, positive("speed", speed), 0.0, time_step)
    period = 2.0 * math.pi / speed
    plant.step(0.0, SETTLE * period)
    plant.tracing = True
    if _fallen(plant, plant.step(0.0, turns * period)):
        raise ValueError(f"the robot falls at a crank speed of {speed} rad/s")
    rows = plant.trace[~plant.landings][::every]
    return trace_forces(plant.tables, rows, plant.time_step)


@dataclass(frozen=True)
class WalkingTorque:
    """The crank torque of a walk at constant crank speed, by crank angle.

    Attributes:
        angle: (bins,) middle of each bin of crank angle, rad, within 0 .. 2 pi.
        torque: (bins,) mean torque in each bin over all turns, touchdowns included, N m.
        spread: (bins,) standard deviation between the turns' own means, N m.
        mean: over the time of all turns, N m.
        distance: walked per turn, m.
        fell: whether the robot fell; its turns then are those before.
    """

    angle: Array
    torque: Array
    spread: Array
    mean: float
    distance: float
    fell: bool


def walking_torque(
    robot: Robot,
    terrain: Terrain | None = None,
    speed: float = 1.0,
    turns: int = 10,
    settle: int = 2,
    bins: int = 72,
    time_step: float = 1e-3,
) -> WalkingTorque:
    """The torque that keeps the crank at a constant speed while the robot walks.

    The crank's speed is prescribed and the torque is what that takes, in every time step. A
    touchdown takes an impulse: the mean over a bin contains it, a single value could not show it.

    Args:
        robot, terrain: who walks where; None is flat ground.
        speed: of the crank, rad/s, not 0.
        turns: of the crank that are evaluated, after ``settle`` turns from standing.
        bins: of crank angle in a turn, of two time steps or more each. time_step: s.

    Raises:
        ValueError: an argument out of range, or a fall before the first turn was complete.
    """
    if finite("speed", speed) == 0.0:
        raise ValueError("speed is 0, must be another number: a standing crank walks nowhere")
    for name, value in (("turns", turns), ("bins", bins)):
        positive_integer(name, value)
    whole_number("settle", settle)
    period = 2.0 * math.pi / abs(speed)
    most = int(0.5 * period / positive("time_step", time_step))
    if bins > most:
        raise ValueError(f"bins is {bins}, must be at most {most}, half the time steps of a turn")
    plant = _driven(robot, Terrain.flat() if terrain is None else terrain, speed, 0.0, time_step)
    fallen = settle > 0 and _fallen(plant, plant.step(0.0, settle * period))
    plant.tracing = True
    rows, means, places = [], [], [plant.x]
    for _ in range(turns):
        fallen = fallen or _fallen(plant, plant.step(0.0, period))
        if fallen:
            break
        psi, torque = plant.trace["pose"][:, 3], plant.trace["torque"]
        index = (psi % (2.0 * math.pi) / (2.0 * math.pi) * bins).astype(int) % bins
        count = np.bincount(index, minlength=bins)
        rows.append(np.bincount(index, torque, minlength=bins) / np.maximum(count, 1))
        means.append(torque.mean())
        places.append(plant.x)
    if not rows:
        raise ValueError(f"the robot falls at a crank speed of {speed} rad/s")
    every = np.array(rows)
    return WalkingTorque(
        angle=2.0 * math.pi * (np.arange(bins) + 0.5) / bins,
        torque=every.mean(axis=0),
        spread=every.std(axis=0),
        mean=float(np.mean(means)),
        distance=abs(places[-1] - places[0]) / len(rows),
        fell=fallen,
    )


def _driven(
    robot: Robot, terrain: Terrain, speed: float, start: float, time_step: float
) -> ProjectionPlant:
    """A robot standing at a crank angle, its crank turning at a speed that is kept."""
    plant = ProjectionPlant(robot, terrain, time_step)
    plant.reset(0.0, start)
    state = plant.state
    state[7] = speed
    plant.state = state
    plant.crank_driven = True
    return plant


def _fallen(plant: ProjectionPlant, result: StepResult) -> bool:
    return bool(result.bumped or abs(plant.state[2]) > FALLEN_PITCH)


@dataclass(frozen=True)
class Ripple:
    """A crank's speed under a constant torque, rad/s: its mean, half its range / mean; a fall?"""

    mean: float
    ripple: float
    fell: bool = False

    @classmethod
    def of(cls, speed: Array, fell: bool = False) -> Ripple:
        """That of the crank speeds (n,) of a motion."""
        mean = float(speed.mean())
        return cls(mean, float(0.5 * np.ptp(speed) / abs(mean)), fell)


def walking_ripple(robot: Robot, torque: float, duration: float = 20.0) -> Ripple:
    """A walk at a constant torque (N m), s long; its second half, or all of it until a fall."""
    plant = ProjectionPlant(robot, Terrain.flat(friction=FRICTION), TIME_STEP)
    plant.reset()
    plant.tracing = True
    speeds, fell = [], False
    for _ in range(round(duration / 0.1)):
        fell = _fallen(plant, plant.step(torque, 0.1))
        if fell:
            break
        speeds.append(plant.trace["velocity_after"][:, 3])
    return Ripple.of(np.concatenate(speeds[len(speeds) // 2 :]), fell)


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
