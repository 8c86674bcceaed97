"""Inverse dynamics: the crank torque that a prescribed crank motion takes, pinned or walking."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.checks import finite, positive, positive_integer, whole_number
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.engine import integrator
from jansen_env.gravity import GRAVITY
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CrankTorque:
    """A crank torque by cause, each (...), N m: weight, inertia, joint friction.

    Attributes:
        gravity: g c_y'. inertia: k psi'' + k' psi'^2 / 2. friction: f psi'.
    """

    gravity: Array
    inertia: Array
    friction: Array

    @property
    def total(self) -> Array:
        """Their sum (...), N m."""
        return self.gravity + self.inertia + self.friction


def crank_torque(
    robot: Robot,
    angle: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    gravity: float = GRAVITY,
) -> CrankTorque:
    """The torque for a prescribed crank motion with the chassis pinned: (12) solved for tau.

    Args:
        robot: whose crank turns.
        angle, speed, acceleration: of the crank, rad, rad/s, rad/s^2, of shapes that broadcast.
        gravity: m/s^2.
    """
    psi, n, n_dot = np.broadcast_arrays(
        *(np.asarray(v, float) for v in (angle, speed, acceleration))
    )
    sums = body_sums(compile_robot(robot), psi)
    return CrankTorque(
        gravity=gravity * sums.dc[..., 1],
        inertia=sums.k * n_dot + 0.5 * sums.dk * n**2,
        friction=sums.f * n,
    )


@dataclass(frozen=True)
class WalkingTorque:
    """The crank torque of a walk at constant crank speed, by crank angle.

    Attributes:
        angle: (bins,) middle of each bin of crank angle, rad, within 0 .. 2 pi.
        torque: (bins,) mean torque in each bin over all turns, landings included, N m.
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

    The crank's speed is prescribed and the torque is what that takes, in every time step; a landing
    takes an impulse, which the mean over a bin contains and a single value could not show.

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
    plant = ProjectionPlant(robot, Terrain.flat() if terrain is None else terrain, time_step)
    plant.reset()
    state = plant.state
    state[7] = speed
    plant.state = state
    plant.crank_driven = plant.tracing = True
    fallen = settle > 0 and plant.step(0.0, settle * period).bumped
    rows, means, places = [], [], [plant.x]
    for _ in range(turns):
        fallen = fallen or plant.step(0.0, period).bumped
        if fallen:
            break
        psi, torque = plant.trace[:, integrator.POSE + 3], plant.trace[:, integrator.TORQUE]
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
