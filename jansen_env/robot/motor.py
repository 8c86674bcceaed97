"""The motor: a direct-current gearmotor, as its data sheet has it; ideal by default.

Of the armature, seen at the output shaft (torque tau_e before the gear's loss, speed n; efficiency
eta; stall torque and no-load speed as sheets give them, at the shaft):

    torque-speed line   tau <= stall (1 - n / n0), and likewise backwards
    winding loss        n0 eta tau_e^2 / stall,  tau_e = tau / eta driving, tau eta driven

See J. J. Craig, *Introduction to Robotics*, 3rd ed. (2005), chapter 9: a rotor of inertia J behind
a gear of ratio G feels like G^2 J at the shaft. The rotor spins with theta' + G psi' (it turns
the way the crank does), so that its inertia couples to the chassis, too.
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
    """A motor with its gear, as seen at the output shaft: the crank. Default: ideal, 20 N m.

    Args:
        stall_torque: at the nominal voltage, N m; inf for no such limit.
        no_load_speed: at the nominal voltage, rad/s; inf for none.
        torque_limit: N m, an action of 1. With a stall torque also what driver and gear allow at
            any speed; a plant gives whatever torque an ideal motor is asked for.
        gear_ratio: turns of the rotor per turn of the crank.
        rotor_inertia: about the rotor's own axis, kg m^2.
        friction: Coulomb friction of gear and motor, N m; at standstill it holds as much.
        viscous_friction: N m s / rad.
        efficiency: share of the motor's power that passes the gear, above 0; counted in the
            electrical power alone.

    Raises:
        ValueError: an argument out of range.
    """

    stall_torque: Annotated[float, OR_INFINITE] = math.inf
    no_load_speed: Annotated[float, OR_INFINITE] = math.inf
    # Of float32, as observations have torques.
    torque_limit: Annotated[float, Limits(LEAST_SINGLE, MOST_SINGLE)] = 20.0
    gear_ratio: Annotated[float, Limits(LEAST_SINGLE, LARGEST)] = 1.0
    rotor_inertia: Size = 0.0
    friction: Size = 0.0
    viscous_friction: Size = 0.0
    efficiency: Annotated[float, Limits(0.01, 1.0)] = 1.0

    RULES: ClassVar[tuple[Rule, ...]] = (
        FiniteWith("no_load_speed", "stall_torque"),
        # The rotor's inertia at the crank, kg m^2.
        Combination(("gear_ratio", "gear_ratio", "rotor_inertia"), "product", SIZE),
    )

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def slope(self) -> float:
        """Torque lost per crank speed, N m s / rad; 0 without a no-load speed."""
        return self.stall_torque / self.no_load_speed if self.no_load_speed < math.inf else 0.0

    @property
    def most_torque(self) -> float:
        """N m at any speed; inf of an ideal motor."""
        return self.torque_limit if self.stall_torque < math.inf else math.inf

    @property
    def winding(self) -> float:
        """Winding loss per torque squared (before the gear's loss), W / (N m)^2."""
        return self.efficiency / self.slope if self.slope > 0.0 else 0.0

    def torque(self, asked: ArrayLike, speed: ArrayLike) -> Array:
        """Return the torque (...), N m, for an asked one (...) at crank speeds (...), rad/s."""
        lost = self.slope * np.asarray(speed, dtype=float)
        high = np.clip(self.stall_torque - lost, -self.most_torque, self.most_torque)
        low = np.clip(-self.stall_torque - lost, -self.most_torque, self.most_torque)
        return np.minimum(high, np.maximum(low, np.asarray(asked, dtype=float)))

    def electrical_power(self, torque: ArrayLike, speed: ArrayLike) -> Array:
        """Drawn at torques (...), N m, and speeds (...), rad/s: W; nothing is fed back."""
        torque, speed = np.asarray(torque, dtype=float), np.asarray(speed, dtype=float)
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
"""Motors by name, from data sheets and as identified: ``docs/built_robot.md`` has all sources."""
