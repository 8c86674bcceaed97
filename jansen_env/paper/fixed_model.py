"""The paper's simulation: the fixed model (12) under the PID (13), 10 s from crank angle pi."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools
from jansen_env.baselines.pid import PID
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

START = math.pi  # rad, crank angle and reference at time 0
DURATION = 10.0  # s
SAMPLING = 0.01  # s, of the controller; the torque is held in between
TIME_STEP = 1e-4  # s, of the integration; divides SAMPLING
SETTLED = 3.0  # s, from where on the motion is taken to be periodic


class Run(NamedTuple):
    """A simulation, sampled as the controller sees it: (n + 1,) each, torque (n,)."""

    time: Array  # s
    angle: Array  # of the crank, rad
    speed: Array  # rad/s
    torque: Array  # N m, held after each sample but the last

    @property
    def settled(self) -> Bools:
        """(n,) the samples whose torque is counted as periodic."""
        return self.time[:-1] >= SETTLED


Advance = Callable[[float, float, float], tuple[float, float]]
"""(angle, speed, torque) at a sample -> (angle, speed) at the next."""


def tables_advance(robot: Robot) -> Advance:
    """The projection plant with its chassis held."""
    plant = ProjectionPlant(robot, Terrain.flat(), TIME_STEP, held=True)

    def advance(angle: float, speed: float, torque: float) -> tuple[float, float]:
        plant.state = np.concatenate([crank_only(angle), crank_only(speed)])
        plant.step(torque, SAMPLING)
        return float(plant.state[3]), float(plant.state[7])

    return advance


def crank_only(value: ArrayLike) -> Array:
    """q or q_dot (..., 4) of a chassis at rest from the crank's angle or speed (...)."""
    psi = np.asarray(value, dtype=float)
    return np.stack([np.zeros(psi.shape)] * 3 + [psi], axis=-1)


def simulate_pid(advance: Advance, direction: float = 1.0, duration: float = DURATION) -> Run:
    """PID (13) on e = r - theta_rf2, r = t + pi (or pi - t, ``direction`` -1), for a while (s)."""
    pid, integral = PID(), np.zeros(())

    def controller(time: float, angle: float, speed: float) -> float:
        nonlocal integral
        error = direction * time + START - angle
        torque, integral = pid.torque(error, direction - speed, integral, SAMPLING)
        return float(torque)

    return simulate(advance, controller, duration)


def pid_run(robot: Robot, motors: int = 1, direction: float = 1.0) -> Run:
    """The PID's 10 s, with its torque on the shaft ``motors`` times; its torque is one motor's."""
    advance = tables_advance(robot)
    return simulate_pid(lambda angle, speed, tau: advance(angle, speed, motors * tau), direction)


def simulate(advance: Advance, controller: Callable[..., float], duration: float) -> Run:
    """A controller (time, angle, speed) -> torque on the mechanism for a while (s), from rest."""
    time = SAMPLING * np.arange(round(duration / SAMPLING) + 1, dtype=np.float64)
    states, torques = [(START, 0.0)], []
    for now in time[:-1]:
        torques.append(controller(now, *states[-1]))
        states.append(advance(*states[-1], torques[-1]))
    angle, speed = np.array(states).T
    return Run(time, angle, speed, np.array(torques))
