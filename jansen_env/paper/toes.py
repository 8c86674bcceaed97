"""Motion of the toes: symmetry, heave with any number of legs, why two standing toes must slip."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.projection import constraints
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.plants.initial_pose import resting_pose
from jansen_env.robot import JANSEN, Robot, paper_robot
from jansen_env.robot.kinematics import coordinates, world_joints
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

TOE = JANSEN.joints.index("T")
FOOT = 8  # the body whose pad is the toe
PHASES = tuple(range(1, 13))  # 2 to 24 legs
STEP = 1e-5  # rad, of central differences of closed forms: good to 1e-10


def turn(samples: int) -> Array:
    """Crank angles of one turn (samples,), rad."""
    return 2.0 * math.pi * np.arange(samples) / samples


def toe_positions(robot: Robot, angle: Array) -> Array:
    """Toe centres (n, legs, 2) at crank angles (n,), m, chassis frame."""
    q = np.zeros((len(angle), 4))
    q[:, 3] = angle
    return world_joints(robot, q)[:, :, TOE]


def mirror_error(robot: Robot, samples: int = 720) -> float:
    """Largest residual (m) of the paper's back leg constraints at a mirrored fore leg, over a turn.

    0 says that the back leg at crank angle psi is the mirror image of the fore leg at pi - psi, and
    its toe path that of the fore toe.
    """
    x = coordinates(robot, "fore", math.pi - turn(samples)).reshape(samples, -1, 3)
    x[..., 0] = math.pi - x[..., 0]
    x[..., 1] = -x[..., 1]
    return float(np.abs(constraints(robot, "back", x.reshape(samples, -1))).max())


@dataclass(frozen=True)
class Heave:
    """Up-and-down motion of the crank axis over a turn, peak to peak."""

    legs: int
    level: float  # m, with the chassis kept level: the lowest toe carries
    one_side: float  # m, the same on the fore toes alone
    standing: float  # m, where a toe on either side carries and the chassis pitches
    pitch: float  # rad, of that pitching


def heave(phases: int, samples: int = 1440, poses: int = 48) -> Heave:
    """Heave of the paper's linkage with two legs on each of ``phases`` evenly spaced crank pins.

    All repeats ``phases`` times a turn: ``samples`` crank angles in such a period, and ``poses`` at
    which the robot is placed on the ground.
    """
    robot = paper_robot(phases)
    fore, back = lowest_toes(robot, turn(samples) / phases)
    standing = standing_poses(robot, turn(poses) / phases)
    return Heave(
        2 * phases, float(np.ptp(np.minimum(fore, back))), float(np.ptp(fore)),
        float(np.ptp(standing[:, 0])), float(np.ptp(standing[:, 1])),
    )  # fmt: skip


def level_heave(robot: Robot, samples: int = 2880) -> float:
    """Up-and-down motion over a turn of a chassis kept level, on its lowest toe, m."""
    return float(np.ptp(np.minimum(*lowest_toes(robot, turn(samples)))))


def standing_poses(robot: Robot, angle: Array) -> Array:
    """(n, 2) height (m) and pitch (rad) of the chassis standing on flat ground at crank angles."""
    centres = body_sums(compile_robot(robot), angle).c / robot.mass
    flat = Terrain.flat()
    return np.array([
        resting_pose(robot, centre, flat, 0.0, float(psi), None)
        for psi, centre in zip(angle, centres, strict=True)
    ])  # fmt: skip


@dataclass(frozen=True)
class DoubleSupport:
    """A slowly walking robot over a turn: its two standing toes, and how fast they part, m/rad.

    ``x_speed`` is the paper's argument (Fig. 6): the difference of their x velocities with the
    chassis fixed and level. ``slip`` is the speed at which their contact points part along the
    ground with the chassis free to heave and pitch and the pads rolling: 0 would let both stick.
    """

    angle: Array  # (n,) of the crank, rad
    front: NDArray[np.int64]  # (n,) leg whose toe carries
    rear: NDArray[np.int64]
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
    poses = standing_poses(robot, angle)
    q = np.stack([np.zeros(samples), poses[:, 0], poses[:, 1], angle], axis=-1)
    toes = world_joints(robot, q)[:, :, TOE]
    c = body_sums(compile_robot(robot), angle).c / robot.mass
    centre = np.cos(poses[:, 1]) * c[:, 0] - np.sin(poses[:, 1]) * c[:, 1]
    ahead = toes[..., 0] > centre[:, None]
    front = np.where(ahead, toes[..., 1], np.inf).argmin(axis=1)
    rear = np.where(ahead, np.inf, toes[..., 1]).argmin(axis=1)
    rate, spin = _toe_rates(robot, angle)
    each = np.arange(samples)
    span, parting, turning = (
        toe[each, front] - toe[each, rear] for toe in (toe_positions(robot, angle), rate, spin)
    )
    along = (span * parting).sum(axis=1) / np.hypot(span[:, 0], span[:, 1])
    rolling = robot.pad_radius * turning
    return DoubleSupport(angle, front, rear, parting[:, 0], along + rolling, rolling)


def _toe_rates(robot: Robot, angle: Array) -> tuple[Array, Array]:
    """d/dpsi of toe centres (n, legs, 2), m/rad, and of foot angles (n, legs), in the chassis."""
    rate = (toe_positions(robot, angle + STEP) - toe_positions(robot, angle - STEP)) / (2.0 * STEP)
    spin = np.empty(rate.shape[:2])
    for i, leg in enumerate(robot.legs):
        after, before = (
            coordinates(robot, leg.side, angle + leg.phase + step)[:, 3 * (FOOT - 1)]
            for step in (STEP, -STEP)
        )
        spin[:, i] = np.angle(np.exp(1j * (after - before))) / (2.0 * STEP)
    return rate, spin


def lowest_toes(robot: Robot, angle: Array) -> tuple[Array, Array]:
    """Height (n,) of the lowest fore and of the lowest back toe with the chassis level, m."""
    height = toe_positions(robot, angle)[..., 1]
    fore = np.array([leg.side == "fore" for leg in robot.legs])
    return height[:, fore].min(axis=1), height[:, ~fore].min(axis=1)
