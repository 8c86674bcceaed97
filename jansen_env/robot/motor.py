"""Motor model: a direct-current gearmotor with the values of its data sheet, ideal by default.

All quantities are those at the output shaft: the torque tau, the torque tau_e before the loss of
the gear, the speed n, the efficiency eta, and the stall torque and the no-load speed n0, which data
sheets give for the output shaft. The model is:

    torque-speed line   tau <= stall (1 - n / n0), and likewise backwards
    winding loss        n0 eta tau_e^2 / stall,  tau_e = tau / eta driving, tau eta driven

A rotor of inertia J behind a gear of ratio G has the inertia G^2 J at the shaft; see J. J. Craig,
*Introduction to Robotics*, 3rd ed. (2005), chapter 9. The rotor turns in the same direction as the
crank, at the speed theta' + G psi'. Its inertia therefore couples to the chassis, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array
from jansen_env.checks import (
    LEAST_SINGLE,
    MOST_SINGLE,
    Combination,
    FiniteWith,
    Limits,
    Rule,
    check_limits,
)
from jansen_env.robot.links import LARGEST, SIZE, Size

OR_INFINITE = Limits(0.0, above=True, infinite=True)


@dataclass(frozen=True)
class Motor:
    """A motor with its gear, described at the output shaft, which is the crank.

    The default is an ideal motor with a torque limit of 20 N m.

    Args:
        stall_torque: Stall torque at the nominal voltage, in N m. Infinity for no limit.
        no_load_speed: No-load speed at the nominal voltage, in rad/s. Infinity for no limit.
        torque_limit: Torque that an action of 1 commands, in N m. If ``stall_torque`` is finite, it
            is also the largest torque that the driver and the gear allow at any speed. A simulation
            backend applies any torque that is commanded from an ideal motor.
        gear_ratio: Turns of the rotor per turn of the crank.
        rotor_inertia: Moment of inertia of the rotor about its own axis, in kg m^2.
        friction: Coulomb friction torque of gear and motor, in N m. At standstill, the friction
            resists torques up to this value.
        viscous_friction: Viscous friction coefficient, in N m s/rad.
        efficiency: Fraction of the motor's power that passes through the gear, above 0. It affects
            only the electrical power.

    Raises:
        ValueError: If an argument is out of range.
    """

    stall_torque: Annotated[float, OR_INFINITE] = math.inf
    no_load_speed: Annotated[float, OR_INFINITE] = math.inf
    # The limits are those of float32, because observations contain torques.
    torque_limit: Annotated[float, Limits(LEAST_SINGLE, MOST_SINGLE)] = 20.0
    gear_ratio: Annotated[float, Limits(LEAST_SINGLE, LARGEST)] = 1.0
    rotor_inertia: Size = 0.0
    friction: Size = 0.0
    viscous_friction: Size = 0.0
    efficiency: Annotated[float, Limits(0.01, 1.0)] = 1.0

    RULES: ClassVar[tuple[Rule, ...]] = (
        FiniteWith("no_load_speed", "stall_torque"),
        # The product is the rotor's inertia at the crank, in kg m^2.
        Combination(("gear_ratio", "gear_ratio", "rotor_inertia"), "product", SIZE),
    )

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def slope(self) -> float:
        """Torque lost per crank speed, in N m s/rad. It is 0 if the no-load speed is infinite."""
        return self.stall_torque / self.no_load_speed if self.no_load_speed < math.inf else 0.0

    @property
    def most_torque(self) -> float:
        """Largest torque at any speed, in N m. It is infinite for an ideal motor."""
        return self.torque_limit if self.stall_torque < math.inf else math.inf

    @property
    def winding(self) -> float:
        """Winding loss per square of the torque before the loss of the gear, in W/(N m)^2."""
        return self.efficiency / self.slope if self.slope > 0.0 else 0.0

    def torque(self, commanded: ArrayLike, speed: ArrayLike) -> Array:
        """Return the torque that the motor applies for a commanded torque.

        Args:
            commanded: Commanded torque, in N m, any shape.
            speed: Crank speed, in rad/s, a shape that broadcasts with that of
                ``commanded``.

        Returns:
            Torque in N m, in the broadcast shape.
        """
        lost = self.slope * np.asarray(speed, dtype=float)
        high = np.clip(self.stall_torque - lost, -self.most_torque, self.most_torque)
        low = np.clip(-self.stall_torque - lost, -self.most_torque, self.most_torque)
        return np.minimum(high, np.maximum(low, np.asarray(commanded, dtype=float)))

    def electrical_power(self, torque: ArrayLike, speed: ArrayLike) -> Array:
        """Return the electrical power that the motor draws. The motor feeds no power back.

        Args:
            torque: Torque of the motor, in N m, any shape.
            speed: Crank speed, in rad/s, a shape that broadcasts with that of ``torque``.

        Returns:
            Power in W, at least 0, in the broadcast shape.
        """
        torque = np.asarray(torque, dtype=float)
        speed = np.asarray(speed, dtype=float)
        driving = torque * speed >= 0.0
        inner = np.where(driving, torque / self.efficiency, torque * self.efficiency)
        return np.maximum(inner * speed + self.winding * inner**2, 0.0)


IDEAL = Motor()
MOTORS: dict[str, Motor] = {
    "ideal": IDEAL,
    "ak80_6": Motor(
        stall_torque=60.2, no_load_speed=38.2, torque_limit=12.0, gear_ratio=6.0,
        rotor_inertia=6.0719e-5, friction=0.16, viscous_friction=0.001, efficiency=0.9,
    ),
    "mx_106": Motor(
        stall_torque=8.4, no_load_speed=4.71, torque_limit=8.4, gear_ratio=225.0,
        rotor_inertia=5.26e-7, friction=0.104, viscous_friction=0.035, efficiency=0.634,
    ),
    "xm540_w270": Motor(
        stall_torque=10.6, no_load_speed=3.14, torque_limit=10.6, gear_ratio=272.5,
        rotor_inertia=5.26e-7, friction=0.126, viscous_friction=0.052, efficiency=0.631,
    ),
    "lp_25d_75": Motor(
        stall_torque=0.686, no_load_speed=7.78, torque_limit=0.35, gear_ratio=74.83,
        rotor_inertia=8e-7, friction=0.046, viscous_friction=0.0, efficiency=0.578,
    ),
}  # fmt: skip
"""Motors by name.

Their values come from data sheets and from identification. ``docs/built_robot.md`` contains all
sources.
"""
