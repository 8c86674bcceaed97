"""Motion of the toes: symmetry, heave with any number of legs, why two standing toes must slip."""

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

PHASES = tuple(range(1, 13))  # 2 to 24 legs
STEP = 1e-5  # rad, of central differences of closed forms: good to 1e-10


def turn(samples: int) -> Array:
    """Crank angles of one turn (samples,), rad."""
    return 2.0 * math.pi * np.arange(samples) / samples


def mirror_error(robot: Robot) -> float:
    """Largest residual (m) of the paper's back leg constraints at a mirrored fore leg, over a turn.

    0 says that the back leg at crank angle psi is the mirror image of the fore leg at pi - psi, and
    its toe path that of the fore toe.
    """
    x = coordinates(robot, "fore", math.pi - turn(720)).reshape(720, -1, 3)
    x[..., 0] = math.pi - x[..., 0]
    x[..., 1] = -x[..., 1]
    return float(np.abs(constraints(robot, "back", x.reshape(720, -1))).max())


class Heave(NamedTuple):
    """Up-and-down motion of the crank axis over a turn, peak to peak."""

    legs: int
    level: float  # m, with the chassis kept level: the lowest toe carries
    standing: float  # m, where a toe on either side carries and the chassis pitches
    pitch: float  # rad, of that pitching


def heave(phases: int) -> Heave:
    """Heave of the paper's linkage with two legs on each of ``phases`` evenly spaced crank pins.

    All repeats ``phases`` times a turn: 1440 crank angles in such a period, and 48 at which the
    robot is placed on the ground.
    """
    robot = paper_robot(phases)
    fore, back = lowest_toes(robot, turn(1440) / phases)
    height, pitch = standing_poses(robot, turn(48) / phases).T
    sizes = np.ptp(np.minimum(fore, back)), np.ptp(height), np.ptp(pitch)
    return Heave(2 * phases, *map(float, sizes))


def lowest_toes(robot: Robot, angle: Array) -> tuple[Array, Array]:
    """Height (n,) of the lowest fore and of the lowest back toe with the chassis level, m."""
    height = toe_positions(robot, angle)[..., 1]
    fore = np.array([leg.side == "fore" for leg in robot.legs])
    return height[:, fore].min(axis=1), height[:, ~fore].min(axis=1)


def standing_poses(robot: Robot, angle: Array) -> Array:
    """(n, 2) height (m) and pitch (rad) of the chassis standing on flat ground at crank angles."""
    batch = Batch([robot] * len(angle), [Terrain.flat()] * len(angle), threads=1)
    batch.place_at(np.arange(len(angle)), angle)
    return batch.states[:, 1:3]


class DoubleSupport(NamedTuple):
    """A slowly walking robot over a turn: its two standing toes, and how fast they part, m/rad.

    ``x_speed`` is the paper's argument (Fig. 6): the difference of their x velocities with the
    chassis fixed and level. ``slip`` is the speed at which their contact points part along the
    ground with the chassis free to heave and pitch and the pads rolling: 0 would let both stick.
    """

    angle: Array  # (n,) of the crank, rad
    front: Ints  # (n,) leg whose toe carries
    rear: Ints
    x_speed: Array
    slip: Array
    rolling: Array  # the part of it that is the pads' rolling; points do not roll

    @property
    def per_turn(self) -> float:
        """The least total slip of both toes in a turn, m."""
        return float(2.0 * math.pi * np.abs(self.slip).mean())

    @property
    def per_turn_of_points(self) -> float:
        """The same for toes without pads, m."""
        return float(2.0 * math.pi * np.abs(self.slip - self.rolling).mean())

    def zeros(self) -> Array:
        """Crank angles (rad) at which the parting speed passes through 0 within a pair of toes."""
        after = np.roll(self.slip, -1)
        same = (self.front == np.roll(self.front, -1)) & (self.rear == np.roll(self.rear, -1))
        k = np.flatnonzero(same & (self.slip * after <= 0.0) & (self.slip != after))
        share = self.slip[k] / (self.slip[k] - after[k])
        return np.asarray(self.angle[k] + share * (self.angle[1] - self.angle[0]))


def double_support(robot: Robot, samples: int = 1440) -> DoubleSupport:
    """Slow walking on flat ground: a toe before and one behind the centre of mass carry."""
    angle = turn(samples) + math.pi / samples  # off the symmetric positions

    def joints(shift: float) -> NDArray[np.complex128]:
        """x + i y (n, legs, joints) in the chassis."""
        return world_joints(robot, crank_only(angle + shift)) @ np.array([1.0, 1j])

    place, rate = joints(0.0), (joints(STEP) - joints(-STEP)) / (2.0 * STEP)  # per rad of crank
    spin = ((rate[..., E] - rate[..., C]) / (place[..., E] - place[..., C])).imag  # of the feet
    upright = np.exp(1j * standing_poses(robot, angle)[:, 1])
    toe = upright[:, None] * place[..., T]
    centre = upright * (body_sums(compile_robot(robot), angle).c @ [1.0, 1j]) / robot.mass
    ahead = toe.real > centre.real[:, None]
    front = np.where(ahead, toe.imag, np.inf).argmin(axis=1)
    rear = np.where(ahead, np.inf, toe.imag).argmin(axis=1)
    each = np.arange(samples)
    span, parting, turning = (
        values[each, front] - values[each, rear] for values in (place[..., T], rate[..., T], spin)
    )
    along = (span.conj() * parting).real / abs(span)
    rolling = robot.pad_radius * turning
    return DoubleSupport(angle, front, rear, parting.real, along + rolling, rolling)
