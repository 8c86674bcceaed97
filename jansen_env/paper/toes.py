"""Motion of the toes: symmetry, heave of any number of legs, and slip of two standing toes."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array, Ints
from jansen_env.dynamics.projection import constraints
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.paper.fixed_model import crank_only
from jansen_env.plants.batch import Batch
from jansen_env.robot import Robot, paper_robot
from jansen_env.robot.kinematics import C, E, T, coordinates, toe_positions, world_joints
from jansen_env.terrain import Terrain

PHASES = tuple(range(1, 13))  # numbers of phases, for 2 to 24 legs
STEP = 1e-5  # step of central differences of closed forms, in rad; their error is 1e-10


def turn(samples: int) -> Array:
    """Return evenly spaced crank angles of one turn, in rad, shape (samples,)."""
    return 2.0 * math.pi * np.arange(samples) / samples


def mirror_error(robot: Robot) -> float:
    """Return the largest residual of a back leg's constraints at the mirror image of a fore leg.

    The residual is the largest over a turn, in m. If it is 0, the back leg at crank angle psi is
    the mirror image of the fore leg at pi - psi, and so is the path of its toe.
    """
    x = coordinates(robot, "fore", math.pi - turn(720)).reshape(720, -1, 3)
    x[..., 0] = math.pi - x[..., 0]
    x[..., 1] = -x[..., 1]
    return float(np.abs(constraints(robot, "back", x.reshape(720, -1))).max())


class Heave(NamedTuple):
    """Up-and-down motion of the crank axis over a turn, peak to peak.

    Attributes:
        legs: Number of legs.
        level: Heave of a robot whose chassis is kept level, so that the lowest toe carries it, in
            m.
        standing: Heave of a robot that stands on a toe on each side, so that the chassis pitches,
            in m.
        pitch: Range of this pitch, in rad.
    """

    legs: int
    level: float
    standing: float
    pitch: float


def heave(phases: int) -> Heave:
    """Return the heave of a robot with the paper's linkage and two legs on each crank pin.

    The motion repeats ``phases`` times per turn. Each such period is sampled at 1440 crank angles
    for a level chassis, and at 48 for a robot that stands on the ground.

    Args:
        phases: Number of evenly spaced crank pins.
    """
    robot = paper_robot(phases)
    fore, back = lowest_toes(robot, turn(1440) / phases)
    height, pitch = standing_poses(robot, turn(48) / phases).T
    sizes = np.ptp(np.minimum(fore, back)), np.ptp(height), np.ptp(pitch)
    return Heave(2 * phases, *map(float, sizes))


def lowest_toes(robot: Robot, angle: Array) -> tuple[Array, Array]:
    """Return the heights of the lowest fore toe and of the lowest back toe with a level chassis.

    Args:
        robot: The robot.
        angle: Crank angles, in rad, shape (n,).

    Returns:
        Two arrays of heights relative to the crank axis, in m, shape (n,).
    """
    height = toe_positions(robot, angle)[..., 1]
    fore = np.array([leg.side == "fore" for leg in robot.legs])
    return height[:, fore].min(axis=1), height[:, ~fore].min(axis=1)


def standing_poses(robot: Robot, angle: Array) -> Array:
    """Return the height and the pitch of the chassis of a robot that stands on flat ground.

    Args:
        robot: The robot.
        angle: Crank angles, in rad, shape (n,).

    Returns:
        Heights in m and pitch angles in rad, shape (n, 2).
    """
    batch = Batch([robot] * len(angle), [Terrain.flat()] * len(angle), threads=1)
    batch.place_at(np.arange(len(angle)), angle)
    return batch.states[:, 1:3]


class DoubleSupport(NamedTuple):
    """The two standing toes of a slowly walking robot over a turn, and how fast they move apart.

    Attributes:
        angle: Crank angles, in rad, shape (n,).
        front: Index of the leg with the front standing toe, shape (n,).
        rear: Index of the leg with the rear standing toe, shape (n,).
        x_speed: Difference of the x velocities of the two toes with a fixed, level chassis, in
            m/rad, shape (n,). This is the argument of the paper (Fig. 6).
        slip: Speed at which the two contact points move apart along the ground if the chassis can
            heave and pitch and the pads roll, in m/rad, shape (n,). Only if it is 0 can both toes
            stick.
        rolling: Part of ``slip`` that is due to the rolling of the pads, in m/rad, shape (n,).
            Toes that are points do not roll.
    """

    angle: Array
    front: Ints
    rear: Ints
    x_speed: Array
    slip: Array
    rolling: Array

    @property
    def per_turn(self) -> float:
        """Smallest possible total slip of both toes in a turn, in m."""
        return float(2.0 * math.pi * np.abs(self.slip).mean())

    @property
    def per_turn_of_points(self) -> float:
        """Smallest possible total slip in a turn for toes without pads, in m."""
        return float(2.0 * math.pi * np.abs(self.slip - self.rolling).mean())

    def zeros(self) -> Array:
        """Return the crank angles in rad at which ``slip`` passes through 0 for a pair of toes."""
        after = np.roll(self.slip, -1)
        same = (self.front == np.roll(self.front, -1)) & (self.rear == np.roll(self.rear, -1))
        k = np.flatnonzero(same & (self.slip * after <= 0.0) & (self.slip != after))
        share = self.slip[k] / (self.slip[k] - after[k])
        return np.asarray(self.angle[k] + share * (self.angle[1] - self.angle[0]))


def double_support(robot: Robot, samples: int = 1440) -> DoubleSupport:
    """Return the motion of the two standing toes of a robot that walks slowly on flat ground.

    The robot stands on one toe ahead of its centre of mass and one toe behind it.

    Args:
        robot: The robot.
        samples: Number of crank angles in the turn.
    """
    angle = turn(samples) + math.pi / samples  # avoids the symmetric positions

    def joints(shift: float) -> NDArray[np.complex128]:
        """Return joint positions x + i y in the chassis frame, in m, shape (n, legs, joints)."""
        return world_joints(robot, crank_only(angle + shift)) @ np.array([1.0, 1j])

    place = joints(0.0)
    rate = (joints(STEP) - joints(-STEP)) / (2.0 * STEP)  # per rad of the crank
    # Angular speed of the feet
    spin = ((rate[..., E] - rate[..., C]) / (place[..., E] - place[..., C])).imag
    upright = np.exp(1j * standing_poses(robot, angle)[:, 1])
    toe = upright[:, None] * place[..., T]
    centre = upright * (body_sums(compile_robot(robot), angle).c @ [1.0, 1j]) / robot.mass
    ahead = toe.real > centre.real[:, None]
    front = np.where(ahead, toe.imag, np.inf).argmin(axis=1)
    rear = np.where(ahead, np.inf, toe.imag).argmin(axis=1)
    each = np.arange(samples)
    span = place[each, front, T] - place[each, rear, T]
    parting = rate[each, front, T] - rate[each, rear, T]
    turning = spin[each, front] - spin[each, rear]
    along = (span.conj() * parting).real / abs(span)
    rolling = robot.pad_radius * turning
    return DoubleSupport(angle, front, rear, parting.real, along + rolling, rolling)
