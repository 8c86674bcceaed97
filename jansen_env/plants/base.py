"""The result of a plant's step, and checks of what plants are given."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools
from jansen_env.checks import finite_numbers, invalid, numbers_of, shown, within
from jansen_env.engine import placement
from jansen_env.engine.integrator import DIVERGED
from jansen_env.engine.placement import DEEPEST
from jansen_env.robot import Robot
from jansen_env.terrain import Ground, Shapes

SHORTEST_STEP, LONGEST_STEP = 1e-9, 1.0  # s, of the integration
LARGEST = 1e12  # of a state's numbers, m, rad, m/s and rad/s


class StepResult(NamedTuple):
    """Slip, forces and energies of one step; energies in J, what is not known NaN."""

    slip: Array  #: (toes,) m, path each toe slid while loaded
    contact_force: Array  #: (toes, 2) N, mean tangential and normal force on each toe
    motor_work: float
    joint_loss: float  #: in joints, bearings and gear
    slip_loss: float
    impact_loss: float  #: at touchdowns, and in springs and dampers of compliant pads
    energy_change: float  #: kinetic and potential, that of compliant pads included
    non_toe_contact: bool  #: whether a joint other than a toe was pressed on the ground
    residual: float  #: N s, worst violation of the contact law
    #: The most that contact impulses of one time step added. Rolling contacts may add some, as the
    #: time step is finite; where pads can bounce or wedge it is 0.
    contact_gain: float
    joint_gap: float = 0.0  #: m, the widest of any joint; 0 where joints cannot open
    electrical_work: float = 0.0  #: drawn by the motor, see :class:`jansen_env.robot.motor.Motor`
    torque: float = math.nan  #: N m, mean, of the motor
    push_work: float = 0.0  #: of pushes on the chassis
    #: Of taking pads out of the ground: little from touchdowns, much where a robot began in it.
    correction_work: float = 0.0

    @property
    def energy_residual(self) -> float:
        """Work less losses and energy change, J: the time step's error."""
        losses = self.joint_loss + self.slip_loss + self.impact_loss
        work = self.motor_work + self.push_work + self.correction_work
        return work - losses - self.energy_change


def static_deflection(robot: Robot, gravity: float) -> float:
    """:func:`resting_depth` of a robot."""
    return resting_depth(robot.mass, robot.pad_compliance.stiffness, gravity)


def resting_depth(mass: float, stiffness: float, gravity: float) -> float:
    """Static deflection of feet, m: the weight of a mass, kg, on two of a stiffness, N/m.

    ``gravity``: m/s^2, downwards.

    Raises:
        ValueError: deeper than :data:`DEEPEST`: the feet are too soft.
    """
    depth = placement.resting_depth(mass, stiffness, gravity)
    if depth > DEEPEST:
        raise ValueError(
            f"pad_compliance.stiffness must be at least {stiffness * depth / DEEPEST:.3g} N/m to "
            f"carry a robot of {mass:.3g} kg, got {stiffness} N/m"
        )
    return depth


def check_legs(robot: Robot, other: Robot) -> None:
    """Raise ValueError unless a robot's legs are another's linkage, on its sides in its order."""
    if robot.linkage != other.linkage:
        names, allowed = robot.linkage.names, other.linkage.names
        raise ValueError(f"a robot's linkage has the bodies {names}, must be that with {allowed}")
    sides, others = ([leg.side for leg in each.legs] for each in (robot, other))
    if sides != others:
        raise ValueError(f"a robot's legs are on the sides {sides}, must be on {others}")


def check_colliding(grounds: Iterable[Ground], links_collide: bool) -> None:
    """Check that links need not collide with shapes.

    Raises:
        ValueError: If ``links_collide`` is True and a ground consists of shapes. Sides of links
            collide only with the vertices of height lines.
    """
    if links_collide and any(isinstance(ground, Shapes) for ground in grounds):
        raise ValueError(
            "links_collide must be False on a ground of pymunk shapes, got True: the sides of "
            "links collide only with the vertices of height lines"
        )


def check_time_step(value: object) -> float:
    """Return a time step, s. Raises ValueError: out of range."""
    return within("time_step", value, SHORTEST_STEP, LONGEST_STEP)


def check_state(value: object) -> Array:
    """Return a plant's state. Raises ValueError unless it is 8 finite numbers."""
    return finite_numbers("state", value, 8, LARGEST)


def check_held(state: ArrayLike) -> None:
    """Raise ValueError if the chassis of a state (8,) moves."""
    if np.asarray(state)[4:7].any():
        raise ValueError(f"state is {shown(state)}, its chassis must not move: it is held")


def check_deflection(value: object, pads: int) -> Array:
    """Return pads' deflection (pads, 2), m, or raise ValueError: shape, compression, bend."""
    deflection = numbers_of(value)
    if deflection.shape == (pads, 2):
        compression, bend = deflection.T
        known = np.where(compression == np.inf, 0.0, compression)
        if (known >= 0.0).all() and (np.abs([known, bend]) <= LARGEST).all():
            return deflection
    pair = "a compression of 0 or above (infinity where unknown) and a bend"
    raise invalid("deflection", value, f"{pads} pairs of {pair}, within {LARGEST:g}")


def check_pushes(value: object, *shape: int) -> Array:
    """Return impulses (..., 2), of any size. Raises ValueError: another shape."""
    pushes = np.ascontiguousarray(value, dtype=float)
    if pushes.shape != (*shape, 2):
        raise ValueError(f"pushes have shape {pushes.shape}, must be {(*shape, 2)}")
    return pushes


def check_in_contact(value: object, pads: int) -> Bools | None:
    """Return a copy of flags (pads,) or None. Raises ValueError: another shape."""
    if value is None:
        return None
    flags = np.array(value, dtype=object)
    if flags.shape != (pads,) or not all(isinstance(flag, (bool, np.bool_)) for flag in flags):
        raise invalid("in_contact", value, f"None or {pads} flags")
    return flags.astype(bool)


def divergence(state: Array, torque: float) -> FloatingPointError:
    """The error of a step that is refused, with the state (8,) it began in."""
    return FloatingPointError(
        f"the simulation diverged from {state.tolist()} under a torque of {torque} N m: a speed "
        f"beyond {DIVERGED:g} m/s or rad/s, or a pad too deep in the ground to find its way out; "
        "try a smaller time_step"
    )
