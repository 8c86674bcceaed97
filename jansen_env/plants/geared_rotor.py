"""The motor's rotor as a body of its own, behind a stiff gear: for the rigid-body plant.

The rotor turns in the chassis; a gear of ratio G makes it turn by theta + G psi. That gear is a
torsional spring and damper here, on the twist delta = phi - theta - G psi = phi - G alpha
- (1 - G) theta of the rotor's angle phi and the shaft's alpha = theta + psi, so that a torque
lambda on the rotor comes with -G lambda on the shaft and (G - 1) lambda on the chassis: together
nothing, as no gear changes the angular momentum of the whole. The spring is as stiff as the time
step lets it be, and its damper as strong as an eighth of a critical one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.plants import bodies as links
from jansen_env.plants.bodies import CHASSIS, SHAFT
from jansen_env.plants.snapshot import ANGLE, SPIN
from jansen_env.robot import Robot

Array = NDArray[np.float64]

STIFFNESS = 0.3  # rad: what the gear's fastest vibration turns on in a time step
DAMPING_RATIO = 0.125


class GearedRotor:
    """A robot's rotor, of an inertia above 0.

    Attributes:
        angle: phi, rad. speed: rad/s. torque: the gear's on the rotor in the next time step, N m.
        energy: of the rotor and the gear's spring, J. loss: in the gear in the last time step, J.
    """

    def __init__(self, robot: Robot, time_step: float) -> None:
        motor = robot.motor
        self.inertia, self.ratio, self.time_step = motor.rotor_inertia, motor.gear_ratio, time_step
        twist = np.array([0.0, 0.0, -1.0, -self.ratio])  # its rate, of the rates of q
        inverse = 1.0 / self.inertia + max(
            float(twist @ np.linalg.solve(motion.mass_matrix, twist))
            for motion in links.turn_motions(robot)
        )
        self.stiffness = (STIFFNESS / time_step) ** 2 / inverse  # N m/rad, at the rotor
        self.damping = 2.0 * DAMPING_RATIO * STIFFNESS / time_step / inverse
        self.angle = self.speed = self.torque = self.energy = self.loss = 0.0

    def start(self, motion: Array) -> None:
        """Turn as an ideal gear would have it, from a motion (bodies, 6) on."""
        self.angle, self.speed = (
            motion[CHASSIS, k] + self.ratio * (motion[SHAFT, k] - motion[CHASSIS, k])
            for k in (ANGLE, SPIN)
        )
        self._twist_rate = self.torque = 0.0
        self._load(motion)

    def step(self, motion: Array) -> None:
        """End a time step in which the bodies came to a motion (bodies, 6)."""
        self.angle += self.time_step * self.speed
        self.speed += self.time_step * self.torque / self.inertia
        self._load(motion)

    def _load(self, motion: Array) -> None:
        """The gear's torque: of the twist at the end of the time step, as pymunk moves first."""
        h, before = self.time_step, self._twist_rate
        twist, self._twist_rate = (
            value - motion[CHASSIS, k] - self.ratio * (motion[SHAFT, k] - motion[CHASSIS, k])
            for value, k in ((self.angle, ANGLE), (self.speed, SPIN))
        )
        rate = self._twist_rate
        # Velocities are those of the middle of the move that comes next (leapfrog).
        middle = twist + 0.5 * h * rate
        self.energy = 0.5 * self.inertia * self.speed**2 + 0.5 * self.stiffness * middle**2
        self.loss = h * self.damping * before * 0.5 * (before + rate)
        self.torque = -self.stiffness * (twist + h * rate) - self.damping * rate

    @property
    def on_bodies(self) -> tuple[float, float]:
        """The gear's torque on the chassis and on the shaft in the next time step, N m."""
        return (self.ratio - 1.0) * self.torque, -self.ratio * self.torque
