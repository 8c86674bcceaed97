"""Result of a step of a simulation backend, and checks of the arguments of backends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools
from jansen_env.checks import finite_numbers, invalid, numbers_of, within
from jansen_env.engine import placement
from jansen_env.engine.integrator import DIVERGED
from jansen_env.engine.placement import DEEPEST
from jansen_env.robot import Robot
from jansen_env.terrain import Ground, Shapes

SHORTEST_STEP, LONGEST_STEP = 1e-9, 1.0  # limits of the time step of the integration, in s
LARGEST_PLAY = 5e-3  # largest radial clearance of a pin, in m
LARGEST_BACKLASH = 1.0  # largest dead band of a gear, in rad at the crank
LARGEST = 1e12  # largest magnitude of a value of a state, in m, rad, m/s and rad/s


JointPlay: TypeAlias = float | Mapping[str, float]
"""Radial clearance of all pins of the legs, in m; or clearances by joint."""


class StepResult(NamedTuple):
    """Slip, forces and energies of one step. Values that are not known are NaN.

    Attributes:
        slip: Distance that each toe slid under load, in m, shape (toes,).
        contact_force: Mean tangential and normal force on each toe, in N, shape (toes, 2).
        motor_work: Work of the motor, in J.
        joint_loss: Energy lost in joints, bearings and gear, in J.
        slip_loss: Energy lost by friction of sliding pads, in J.
        impact_loss: Energy lost at touchdowns and in the springs and dampers of compliant pads, in
            J.
        energy_change: Change of the kinetic and potential energy, compliant pads included, in J.
        non_toe_contact: Whether a joint other than a toe pressed on the ground.
        residual: Largest violation of the contact law, in N s.
        contact_gain: Largest energy that the contact impulses of one time step added, in J. Rolling
            contacts may add some energy, because the time step is finite. If pads can bounce or
            wedge, the value is 0.
        joint_gap: Widest gap of any joint, in m. It is 0 if joints cannot open.
        electrical_work: Electrical energy that the motor drew, in J; see
            :class:`jansen_env.robot.motor.Motor`.
        torque: Mean torque of the motor, in N m.
        push_work: Work of the pushes on the chassis, in J.
        correction_work: Work of moving pads out of the ground, in J. Touchdowns cause little of it;
            a robot that starts inside the ground causes much.
    """

    slip: Array
    contact_force: Array
    motor_work: float
    joint_loss: float
    slip_loss: float
    impact_loss: float
    energy_change: float
    non_toe_contact: bool
    residual: float
    contact_gain: float
    joint_gap: float = 0.0
    electrical_work: float = 0.0
    torque: float = math.nan
    push_work: float = 0.0
    correction_work: float = 0.0

    @property
    def energy_residual(self) -> float:
        """Work minus losses and energy change, in J, which is the error of the integration."""
        losses = self.joint_loss + self.slip_loss + self.impact_loss
        work = self.motor_work + self.push_work + self.correction_work
        return work - losses - self.energy_change


def static_deflection(robot: Robot, gravity: float) -> float:
    """Return the static deflection of a robot's feet, in m; see :func:`resting_depth`.

    Args:
        robot: The robot.
        gravity: Downward acceleration, in m/s^2.

    Raises:
        ValueError: If the feet are too soft to carry the robot.
    """
    return resting_depth(robot.mass, robot.pad_compliance.stiffness, gravity)


def resting_depth(mass: float, stiffness: float, gravity: float) -> float:
    """Return the static deflection of feet if two feet carry a mass, in m.

    Args:
        mass: Mass, in kg.
        stiffness: Stiffness of a foot, in N/m.
        gravity: Downward acceleration, in m/s^2.

    Raises:
        ValueError: If the feet are so soft that the deflection exceeds :data:`DEEPEST`.
    """
    depth = placement.resting_depth(mass, stiffness, gravity)
    if depth > DEEPEST:
        raise ValueError(
            f"pad_compliance.stiffness must be at least {stiffness * depth / DEEPEST:.3g} N/m to "
            f"carry a robot of {mass:.3g} kg, got {stiffness} N/m"
        )
    return depth


def check_legs(robot: Robot, other: Robot) -> None:
    """Check that two robots have the same linkage, with legs on the same sides in the same order.

    Args:
        robot: Robot to check.
        other: Robot with the required linkage and legs.

    Raises:
        ValueError: If the linkages or the sides of the legs differ.
    """
    if robot.linkage != other.linkage:
        names = robot.linkage.names
        allowed = other.linkage.names
        raise ValueError(f"a robot must have the linkage with the bodies {allowed}, got {names}")
    sides = [leg.side for leg in robot.legs]
    others = [leg.side for leg in other.legs]
    if sides != others:
        raise ValueError(f"a robot's legs must be on the sides {others}, got {sides}")


def check_colliding(grounds: Iterable[Ground], links_collide: bool) -> None:
    """Check that links do not have to collide with shapes.

    The sides of links collide only with the vertices of height lines.

    Args:
        grounds: Grounds of the robots.
        links_collide: Whether the sides of links collide with the ground.

    Raises:
        ValueError: If ``links_collide`` is True and a ground consists of shapes.
    """
    if links_collide and any(isinstance(ground, Shapes) for ground in grounds):
        raise ValueError(
            "links_collide must be False on a ground of pymunk shapes, got True: the sides of "
            "links collide only with the vertices of height lines"
        )


def check_joint_play(value: object) -> float | dict[str, float]:
    """Return the radial clearance of pins, in m, as a float or as floats by joint.

    Args:
        value: A clearance for all pins of the legs, or a mapping from joints to clearances.

    Raises:
        ValueError: If a clearance is not a number from 0 to :data:`LARGEST_PLAY`.
    """
    if not isinstance(value, Mapping):
        return within("joint_play", value, 0.0, LARGEST_PLAY)
    return {
        joint: within(f"joint_play[{joint!r}]", play, 0.0, LARGEST_PLAY)
        for joint, play in value.items()
    }


def has_play(joint_play: JointPlay) -> bool:
    """Return whether any pin has play.

    Args:
        joint_play: Value of :func:`check_joint_play`.
    """
    plays = joint_play.values() if isinstance(joint_play, Mapping) else [joint_play]
    return any(play > 0.0 for play in plays)


def check_backlash(value: object) -> float:
    """Return the dead band of a gear, in rad at the crank, as a float.

    Raises:
        ValueError: If it is not a number from 0 to :data:`LARGEST_BACKLASH`.
    """
    return within("backlash", value, 0.0, LARGEST_BACKLASH)


def check_no_play(joint_play: JointPlay, backlash: float) -> None:
    """Check that neither pins nor the gear have play.

    Raises:
        ValueError: If they have play, which only the rigid-body backend can simulate.
    """
    if has_play(joint_play):
        raise invalid("joint_play", joint_play, "0 without plant='rigid_body'")
    if backlash > 0.0:
        raise invalid("backlash", backlash, "0 without plant='rigid_body'")


def check_time_step(value: object) -> float:
    """Return a time step, in s, as a float.

    Raises:
        ValueError: If it is not a number from :data:`SHORTEST_STEP` to :data:`LONGEST_STEP`.
    """
    return within("time_step", value, SHORTEST_STEP, LONGEST_STEP)


def check_state(value: object, name: str = "state") -> Array:
    """Return the mechanical state of a robot as an array, shape (8,).

    Args:
        value: x, y, theta, psi and their rates, in m, rad and s.
        name: Name of the state, for the error message.

    Raises:
        ValueError: If it is not 8 finite numbers of at most :data:`LARGEST`.
    """
    return finite_numbers(name, value, 8, LARGEST)


def check_fixed_chassis(state: ArrayLike) -> None:
    """Check that the chassis does not move.

    Args:
        state: x, y, theta, psi and their rates, in m, rad and s, shape (8,).

    Raises:
        ValueError: If the chassis moves.
    """
    if np.asarray(state)[4:7].any():
        raise invalid("state", state, "one in which the fixed chassis does not move")


def check_deflection(value: object, pads: int, name: str = "deflection") -> Array:
    """Return the deflection of compliant pads as an array.

    Args:
        value: Compression and bend of each pad, in m. An infinite compression stands for an unknown
            compression.
        pads: Number of pads.
        name: Name of the deflection, for the error message.

    Returns:
        The same values, shape (pads, 2).

    Raises:
        ValueError: If the shape is different, a compression is negative, or a value is out of
            range.
    """
    deflection = numbers_of(value)
    if deflection.shape == (pads, 2):
        compression, bend = deflection.T
        known = np.where(compression == np.inf, 0.0, compression)
        if (known >= 0.0).all() and (np.abs([known, bend]) <= LARGEST).all():
            return deflection
    pair = "a compression of 0 or above (infinity where unknown) and a bend"
    raise invalid(name, value, f"{pads} pairs of {pair}, within {LARGEST:g}")


def check_pushes(value: object, *shape: int) -> Array:
    """Return impulses of pushes as an array. Their magnitudes are not checked.

    Args:
        value: Impulses in x and y, in N s.
        *shape: Required shape without the last axis, whose length is 2.

    Raises:
        ValueError: If the shape is different.
    """
    pushes = np.ascontiguousarray(value, dtype=float)
    if pushes.shape != (*shape, 2):
        raise ValueError(f"pushes must have the shape {(*shape, 2)}, got {pushes.shape}")
    return pushes


def check_in_contact(value: object, pads: int) -> Bools | None:
    """Return a copy of the flags of the pads that are on the ground.

    Args:
        value: Whether each pad is on the ground, shape (pads,). None if that is not known.
        pads: Number of pads.

    Returns:
        The flags, shape (pads,), or None.

    Raises:
        ValueError: If ``value`` is neither None nor a flag per pad.
    """
    if value is None:
        return None
    flags = np.array(value, dtype=object)
    if flags.shape != (pads,) or not all(isinstance(flag, (bool, np.bool_)) for flag in flags):
        raise invalid("in_contact", value, f"None or {pads} flags")
    return flags.astype(bool)


def divergence(state: Array, torque: float) -> FloatingPointError:
    """Return the error of a step that was rejected because the simulation diverged.

    Args:
        state: State before the step, shape (8,).
        torque: Commanded crank torque, in N m.
    """
    return FloatingPointError(
        f"the simulation diverged from {state.tolist()} under a torque of {torque} N m: a speed "
        f"beyond {DIVERGED:g} m/s or rad/s, or a pad too deep in the ground to find its way out; "
        "try a smaller time_step"
    )
