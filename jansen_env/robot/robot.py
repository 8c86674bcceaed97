"""The robot: every leg the same linkage, all cranks on one shaft."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from jansen_env.checks import entries, finite, instance, non_negative, positive, shown
from jansen_env.robot.links import (
    BEARINGS,
    BODIES,
    CRANK_RADIUS,
    JOINT_PAIRS,
    RIGID,
    Bar,
    Compliance,
    Leg,
    Payload,
    Triangle,
    phased_legs,
    set_checked,
)
from jansen_env.robot.motor import IDEAL, Motor

# Triangle 4's constraint equations use the printed centroid data, 1.0101 times (L4, L10, L5).
_PAPER_TRIANGLE_4 = Triangle(d=0.122562, l=0.170599, h=0.178215, alpha=1.87097, gamma=1.98742)
_PAPER_TRIANGLE_8 = Triangle(d=0.147877, l=0.205316, h=0.252632, alpha=1.57408, gamma=2.19281)


@dataclass(frozen=True)
class Robot:
    """A Jansen walker: every leg the same linkage, all cranks on one shaft. Default: the paper's.

    Args:
        frame, frame_angle: P to O, its length and its angle in the chassis frame (fore legs).
        crank, upper_rod, upper_triangle, rocker, lower_rod, coupler, foot: the other bodies.
        damping: viscous coefficient of each pair in :data:`JOINT_PAIRS`, N m s / rad.
        legs: at least one; the first one's crank defines the crank angle, so its phase is 0.
        pad_radius: radius of the round pads at toes and outer joints, m.
        payload: extra rigid load on the chassis.
        motor: what turns the crank; pad_compliance: how the pads give.
        bearing_friction: Coulomb friction torque of each pair in :data:`BEARINGS`, N m.

    Raises:
        ValueError: an argument of another kind or out of range.
            :func:`jansen_env.robot.kinematics.check_closure` refuses a design that cannot turn (run
            when a robot is compiled).
    """

    frame: Bar = Bar(0.32436)
    frame_angle: float = math.atan2(0.04632, 0.32436)
    crank: Bar = Bar(CRANK_RADIUS)
    upper_rod: Bar = Bar(0.34885)
    upper_triangle: Triangle = _PAPER_TRIANGLE_4
    rocker: Bar = Bar(0.23508)
    lower_rod: Bar = Bar(0.38322)
    coupler: Bar = Bar(0.23934)
    foot: Triangle = _PAPER_TRIANGLE_8
    damping: tuple[float, ...] = (0.1,) * len(JOINT_PAIRS)
    legs: tuple[Leg, ...] = field(default_factory=lambda: phased_legs(2))
    pad_radius: float = 0.01
    payload: Payload = Payload()
    motor: Motor = IDEAL
    pad_compliance: Compliance = RIGID
    bearing_friction: tuple[float, ...] = (0.0,) * len(BEARINGS)

    def __post_init__(self) -> None:
        for name in BODIES:
            kind = Triangle if name in ("upper_triangle", "foot") else Bar
            instance(f"Robot.{name}", getattr(self, name), kind)
        instance("Robot.payload", self.payload, Payload)
        instance("Robot.motor", self.motor, Motor)
        instance("Robot.pad_compliance", self.pad_compliance, Compliance)
        set_checked(self, finite, "frame_angle")
        set_checked(self, positive, "pad_radius")
        self._set_pairs("damping", "joint pairs", JOINT_PAIRS)
        self._set_pairs("bearing_friction", "bearings", BEARINGS)
        object.__setattr__(self, "legs", entries("Robot.legs", self.legs, "at least one Leg"))
        if not self.legs:
            raise ValueError("Robot.legs is empty, must have at least one Leg")
        if not all(isinstance(leg, Leg) for leg in self.legs):
            raise ValueError(
                f"Robot.legs is {shown(self.legs)}, must be at least one Leg and nothing else"
            )
        if self.legs[0].phase != 0.0:
            raise ValueError(
                f"Robot.legs[0].phase is {self.legs[0].phase}, must be 0: the first leg's crank "
                "defines the crank angle"
            )

    def _set_pairs(self, name: str, label: str, pairs: tuple[tuple[int, int], ...]) -> None:
        """Check a field with one number for each of some pairs of bodies."""
        each = f"one number for each of the {len(pairs)} {label} {pairs}"
        values = entries(f"Robot.{name}", getattr(self, name), each)
        if len(values) != len(pairs):
            raise ValueError(f"Robot.{name} has {len(values)} values, must be {each}")
        checked = tuple(non_negative(f"Robot.{name}", value) for value in values)
        object.__setattr__(self, name, checked)

    @property
    def bodies(self) -> tuple[Bar | Triangle, ...]:
        """Bodies 1 to 8 of a leg."""
        return tuple(getattr(self, name) for name in BODIES)

    @property
    def links_mass(self) -> float:
        """Mass of every body of every leg, kg."""
        return len(self.legs) * sum(body.mass for body in self.bodies)

    @property
    def mass(self) -> float:
        """Total mass, kg: that of the links and the payload."""
        return self.links_mass + self.payload.mass

    @property
    def leg_names(self) -> tuple[str, ...]:
        """``rf``, ``lf``, ``rb``, ``lb`` for the paper's four, else ``f1``.. and ``b1``.."""
        if self.legs == phased_legs(2):
            return ("rf", "lf", "rb", "lb")
        count = {"fore": 0, "back": 0}
        names = []
        for leg in self.legs:
            count[leg.side] += 1
            names.append(f"{leg.side[0]}{count[leg.side]}")
        return tuple(names)

    def with_slender_inertias(self) -> Robot:
        """The same robot with rods of inertia m L^2 / 12 and triangles as uniform plates."""
        return replace(self, **{name: getattr(self, name).slender() for name in BODIES})
