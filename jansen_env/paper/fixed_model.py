"""The paper's simulation: 10 s of the fixed model (12) with the PID controller (13).

The simulation begins at crank angle pi. Equation numbers are those of the paper.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.policies.pid import PID
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

START = math.pi  # crank angle and reference at time 0, in rad
DURATION = 10.0  # s
SAMPLING = 0.01  # sampling time of the controller, which holds the torque in between, in s
TIME_STEP = 1e-4  # time step of the integration, which divides SAMPLING, in s
SETTLED = 3.0  # time from which on the motion is treated as periodic, in s


class Run(NamedTuple):
    """A simulation at the n + 1 sampling times of the controller.

    Attributes:
        time: Time, in s, shape (n + 1,).
        angle: Crank angle, in rad, shape (n + 1,).
        speed: Crank speed, in rad/s, shape (n + 1,).
        torque: Torque that is held after each sample except the last one, in N m, shape (n,).
    """

    time: Array
    angle: Array
    speed: Array
    torque: Array

    @property
    def settled(self) -> Bools:
        """Flags of the samples whose torque is treated as periodic, shape (n,)."""
        return self.time[:-1] >= SETTLED


Advance = Callable[[float, float, float], tuple[float, float]]
"""Function (angle, speed, torque) -> (angle, speed) from one sample to the next."""


def tables_advance(robot: Robot) -> Advance:
    """Return a function that advances a robot with a fixed chassis, by the projection backend."""
    plant = ProjectionPlant(robot, Terrain.flat(), TIME_STEP, fixed_chassis=True)

    def advance(angle: float, speed: float, torque: float) -> tuple[float, float]:
        plant.state = np.concatenate([crank_only(angle), crank_only(speed)])
        plant.step(torque, SAMPLING)
        return float(plant.state[3]), float(plant.state[7])

    return advance


def crank_only(value: ArrayLike) -> Array:
    """Return q or q_dot of a chassis at rest.

    Args:
        value: Crank angle in rad or crank speed in rad/s, any shape.

    Returns:
        Array of shape (..., 4) whose first three entries are 0.
    """
    psi = np.asarray(value, dtype=float)
    return np.stack([np.zeros(psi.shape)] * 3 + [psi], axis=-1)


def simulate_pid(advance: Advance, direction: float = 1.0, duration: float = DURATION) -> Run:
    """Simulate the PID controller (13) with the error e = r - theta_rf2.

    Args:
        advance: Function that advances the mechanism by one sample.
        direction: 1 for the reference r = pi + t, or -1 for r = pi - t.
        duration: Duration, in s.
    """
    pid = PID()
    integral = np.zeros(())

    def controller(time: float, angle: float, speed: float) -> float:
        nonlocal integral
        error = direction * time + START - angle
        torque, integral = pid.torque(error, direction - speed, integral, SAMPLING)
        return float(torque)

    return simulate(advance, controller, duration)


def pid_run(robot: Robot, motors: int = 1, direction: float = 1.0) -> Run:
    """Simulate 10 s with the PID controller.

    Args:
        robot: The robot.
        motors: Number of motors on the shaft. The torque of the controller is that of one motor.
        direction: 1 for the reference r = pi + t, or -1 for r = pi - t.
    """
    advance = tables_advance(robot)
    return simulate_pid(lambda angle, speed, tau: advance(angle, speed, motors * tau), direction)


def simulate(advance: Advance, controller: Callable[..., float], duration: float) -> Run:
    """Simulate a controller that drives the mechanism from rest.

    Args:
        advance: Function that advances the mechanism by one sample.
        controller: Function ``(time, angle, speed) -> torque``, in s, rad, rad/s and N m.
        duration: Duration, in s.
    """
    time = SAMPLING * np.arange(round(duration / SAMPLING) + 1, dtype=np.float64)
    states = [(START, 0.0)]
    torques = []
    for now in time[:-1]:
        torques.append(controller(now, *states[-1]))
        states.append(advance(*states[-1], torques[-1]))
    angle, speed = np.array(states).T
    return Run(time, angle, speed, np.array(torques))
