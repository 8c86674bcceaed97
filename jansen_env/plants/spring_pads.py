"""Compliant pads of the rigid-body plant: explicit springs, dampers and bristles.

Along the ground's normal f_n = -k g - d g', while the gap g is negative, and never a pull; along
the ground a bristle of length s with f_t = -k_t s - d_t s', |f_t| <= mu f_n: it follows the pad
while it holds, and keeps the length at which the law holds while it slides. The law is that of
the projection plant, the way to it is not: forces of the last velocity and of the place where the
bodies will be (pymunk moves them first), on the bodies, without a complementarity problem. So the
time step must be short, see :func:`check_stiffness`.

A pad is pushed by the nearest point of the ground alone: in a groove, by the nearer side.
"""

from __future__ import annotations

import math

import numpy as np
import pymunk
from numpy.typing import NDArray

from jansen_env.plants import bodies as links
from jansen_env.plants.snapshot import SPIN, VX, VY, Snapshot, Sums
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

SHORT_ENOUGH = 1.0  # (k h^2 + d h) / effective mass; beyond 2 to 4 the springs would swing up
FLAT = 1e-9  # m: nearer to the ground, its own normal is taken


def check_stiffness(robot: Robot, time_step: float, owners: list[int]) -> None:
    """Raise ValueError unless a time step, s, is short enough for the pads' springs and dampers."""
    give, lightest = robot.pad_compliance, math.inf
    for motion in links.turn_motions(robot):
        inverse = np.linalg.inv(motion.mass_matrix)
        for pad, owner in zip(motion.pads, owners, strict=True):
            x, y = pad - motion.poses[owner, 1:]
            spin, vx, vy = motion.rates[:, owner].T
            # Of the point that touches level ground: (tangential, normal) per rate of q.
            rows = np.array([vx - spin * y + spin * robot.pad_radius, vy + spin * x])
            lightest = min(lightest, 1.0 / np.linalg.eigvalsh(rows @ inverse @ rows.T)[-1])
    k = max(give.stiffness, give.tangential_stiffness or 0.0)
    d = max(give.damping, give.tangential_damping or 0.0)
    # The positive root of k h^2 + d h = SHORT_ENOUGH m.
    m = SHORT_ENOUGH * lightest
    longest = 2.0 * m / (d + math.sqrt(d * d + 4.0 * k * m))
    if time_step > longest:
        raise ValueError(
            f"time_step is {time_step}, must be at most {longest:.3g} s for pads of {k:g} N/m and "
            f"{d:g} N s/m on the rigid-body plant, whose pads are explicit springs"
        )


class SpringPads:
    """The pads of a robot on a terrain; ``owners``: the body that each is part of.

    Attributes:
        bristle: (pads,) s now, m. stored: energy in springs and bristles, J.
        forces: (pads, 2) tangential and normal in the next time step, N.
    """

    def __init__(self, robot: Robot, terrain: Terrain, owners: list[int], time_step: float) -> None:
        check_stiffness(robot, time_step, owners)
        self._give, self._radius = robot.pad_compliance, robot.pad_radius
        self._terrain, self._owners, self._h = terrain, owners, time_step
        self._tilt = math.sqrt(1.0 + terrain.steepest**2)

    def start(self, now: Snapshot, space: pymunk.Space, bristle: Array | None) -> None:
        """Begin with bristles (pads,), m; None for none."""
        pads = len(self._owners)
        self.bristle = np.zeros(pads) if bristle is None else bristle.copy()
        self.forces, self.stored = np.zeros((pads, 2)), 0.0
        self._normals = np.tile([0.0, 1.0], (pads, 1))
        # Of the next time step: bristle and gap (0 if open) at its end, speeds of bristle and pad,
        # speed of sliding.
        self._then = self.bristle.copy()
        self._gap, self._rate, self._slide = np.zeros(pads), np.zeros((pads, 2)), np.zeros(pads)
        self.step(now, space)

    @property
    def touching(self) -> NDArray[np.bool_]:
        """(pads,) whether the ground will push in the next time step."""
        return np.asarray(self.forces[:, 1] > 0.0)

    def loads(self, now: Snapshot) -> Array:
        """(bodies, 3) force x, y and moment on every body in the next time step, N and N m."""
        loads = np.zeros((len(now.motion), 3))
        for pad in np.flatnonzero(self.forces.any(axis=1)).tolist():
            owner, (tangential, normal) = self._owners[pad], self.forces[pad].tolist()
            (nx, ny), (x, y) = self._normals[pad].tolist(), now.pads[pad].tolist()
            fx, fy = normal * nx + tangential * ny, normal * ny - tangential * nx
            x, y = x - now.motion[owner, 0], y - now.motion[owner, 1]
            loads[owner] += fx, fy, x * fy - y * fx + self._radius * tangential
        return loads

    def step(self, now: Snapshot, space: pymunk.Space, sums: Sums | None = None) -> None:
        """Forces of the next time step; ``sums`` takes the work of those of the last one."""
        h, give = self._h, self._give
        k, d = give.stiffness, give.damping
        kt, dt = float(give.tangential_stiffness or 0.0), float(give.tangential_damping or 0.0)
        spin = now.motion[self._owners, SPIN]
        arm = now.pads - now.motion[self._owners, :2]
        speed = now.motion[self._owners][:, [VX, VY]]
        speed = speed + spin[:, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        then = now.pads + h * speed
        height = self._terrain.height(then[:, 0])
        near = (then[:, 1] - height) / self._tilt <= self._radius
        self.bristle[:] = self._then
        active = near | self.forces.any(axis=1) | (self.bristle != 0.0)
        self.stored = 0.0
        for pad in np.flatnonzero(active).tolist():
            gap = self._find_ground(space, pad, then[pad], float(height[pad]))
            nx, ny = self._normals[pad].tolist()
            vx, vy = speed[pad].tolist()
            along = vx * ny - vy * nx + self._radius * float(spin[pad])
            across = vx * nx + vy * ny
            depth, s = min(gap, 0.0), float(self.bristle[pad])
            normal = max(0.0, -k * depth - d * across) if gap < 0.0 else 0.0
            new, tangential = s + h * along, 0.0
            wanted, most = -kt * new - dt * along, self._terrain.friction * normal
            tangential = min(max(wanted, -most), most)
            if tangential != wanted:
                new = (-tangential + dt / h * s) / (kt + dt / h)
            rate = (new - s) / h
            slide = along - rate
            held = 0.5 * kt * (s + 0.5 * h * rate) ** 2
            middle = min(gap - 0.5 * h * across, 0.0)
            if sums is not None:
                self._account(sums, pad, across, rate, slide)
            if gap < 0.0:
                self.stored += 0.5 * k * middle**2 + held
            else:
                if sums is not None:
                    sums.impact_loss += held
                new = rate = slide = self.bristle[pad] = 0.0
            self._then[pad], self.forces[pad] = new, (tangential, normal)
            self._gap[pad], self._rate[pad], self._slide[pad] = depth, (rate, across), slide

    def _account(self, sums: Sums, pad: int, across: float, rate: float, slide: float) -> None:
        """Book the work of the last time step's forces, at mean speeds of its beginning and end."""
        h, (tangential, normal) = self._h, self.forces[pad].tolist()
        before, down = self._rate[pad].tolist()
        drift, bristle = 0.5 * (slide + float(self._slide[pad])), 0.5 * (rate + before)
        kt = float(self._give.tangential_stiffness or 0.0)
        # Work of the springs alone is stored or given back; the rest is lost.
        elastic = -self._give.stiffness * float(self._gap[pad])
        sums.impact_loss -= h * (normal - elastic) * 0.5 * (across + down)
        sums.impact_loss -= h * (tangential + kt * float(self.bristle[pad])) * bristle
        sums.slip_loss -= h * tangential * drift
        sums.slip[pad] += h * abs(float(self._slide[pad]))
        sums.impulse[pad] += h * tangential, h * normal

    def _find_ground(self, space: pymunk.Space, pad: int, centre: Array, height: float) -> float:
        """The gap below a pad, m; takes the normal there."""
        x, y = centre.tolist()
        found = space.point_query_nearest((x, y), math.inf, pymunk.ShapeFilter())
        assert found is not None, "the ground has no end"
        above = math.copysign(1.0, y - height)
        distance = math.hypot(x - found.point.x, y - found.point.y)
        if distance > FLAT:
            scale = above / distance
            self._normals[pad] = scale * (x - found.point.x), scale * (y - found.point.y)
        else:
            slope = float(self._terrain.gradient(x))
            self._normals[pad] = -slope / math.hypot(1.0, slope), 1.0 / math.hypot(1.0, slope)
        return above * distance - self._radius
