"""Contact of rigid and compliant pads with the ground in the rigid-body backend, and step sums."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pymunk
import pymunk.batch

from jansen_env.arrays import Array, Bools, Ints
from jansen_env.engine.collision import LEAN
from jansen_env.plants.rigid import bodies
from jansen_env.plants.shape_planes import ShapePlanes
from jansen_env.robot import Robot
from jansen_env.terrain import Ground, Terrain

_Arbiter = pymunk.batch.ArbiterFields
_BODIES = _Arbiter.BODY_A_ID | _Arbiter.BODY_B_ID
_CONTACT = _BODIES | _Arbiter.TOTAL_IMPULSE | _Arbiter.NORMAL | _Arbiter.POINT_A_1

# Time for which a loaded pad may leave the ground and still count as on the ground, in s.
CONTACT_HYSTERESIS = 2e-3
# Largest (k h^2 + d h) / effective mass. Beyond 2 to 4, oscillations of the springs would grow.
SHORT_ENOUGH = 1.0
# Distance from the ground, in m, below which the normal is computed from the slope of the ground.
FLAT = 1e-9


class Sums(NamedTuple):
    """Sums over a step.

    Attributes:
        total: Record ``ACCUMULATORS`` of :mod:`jansen_env.engine.records`.
        slip: Distance that each pad slid, in m, shape (pads,).
        impulse: Tangential and normal impulse on each pad, in N s, shape (pads, 2).
        pressed: Sum of the normal impulses on all pads and links in this time step, in N s, shape
            (1,).
    """

    total: np.void
    slip: Array
    impulse: Array
    pressed: Array


class PadContacts:
    """Slip, impulses and landings of a robot's rigid pads, read from pymunk's contacts.

    Args:
        space: pymunk space with the robot.
        ground: The ground.
        time_step: Time step of pymunk, in s.
        shapes: The ground in pymunk, if it consists of shapes; None for a height line.
    """

    def __init__(
        self,
        space: bodies.BodySpace,
        ground: Ground,
        time_step: float,
        shapes: ShapePlanes | None = None,
    ) -> None:
        self._shapes = shapes
        self._space = space.space
        self._index = space.index
        self._ground = ground
        owners = self._owners = space.owners
        self._radius = space.radius
        self._time_step = time_step
        self._pads_of: dict[int, list[int]] = {body: [] for body in range(len(space.bodies))}
        for pad, body in enumerate(owners):
            self._pads_of[body].append(pad)
        self._touched = pymunk.batch.Buffer()
        self._off = np.full(len(owners), math.inf)  # time since a pad was last on the ground, in s
        self._pending = np.zeros(len(owners))  # distance moved along the ground since then, in m
        self._normals = np.tile([0.0, 1.0], (len(owners), 1))
        self._gaps = np.full(len(owners), math.inf)  # in m; at first, any pad may land

    @property
    def pressed(self) -> Bools:
        """Whether each pad was on the ground within :data:`CONTACT_HYSTERESIS`, shape (pads,)."""
        return self._off <= CONTACT_HYSTERESIS

    def set_pressed(self, pressed: Bools | None) -> None:
        """Set which pads were on the ground just before.

        Args:
            pressed: Whether each pad was on the ground, shape (pads,). None if that is not known;
                no pad counts as on the ground in that case.
        """
        self._off[:] = math.inf if pressed is None else np.where(pressed, 0.0, math.inf)
        self._pending[:] = 0.0

    def note(self, touching: Bools) -> None:
        """Store which pads touched the ground in a time step.

        Args:
            touching: Whether each pad touched the ground, shape (pads,).
        """
        self._off = np.where(touching, 0.0, self._off + self._time_step)

    def book(self, now: bodies.Snapshot, sums: Sums) -> tuple[float, bool]:
        """Add the slip and the impulses of a time step to the sums.

        A loaded pad hops by nanometres and is then off the ground for a few time steps. If it
        returns within :data:`CONTACT_HYSTERESIS`, the distance that it slid meanwhile counts as
        slip, and its return does not count as a landing.

        Args:
            now: Positions and velocities of the bodies at the end of the time step.
            sums: Sums over the step.

        Returns:
            The energy that friction dissipated, in J, and whether a pad landed.
        """
        self._touched.clear()
        pymunk.batch.get_space_arbiters(self._space, _CONTACT, self._touched)
        pairs = np.frombuffer(self._touched.int_buf(), dtype=np.uintp).reshape(-1, 2)
        ids = map(tuple, pairs.tolist())
        values = np.frombuffer(self._touched.float_buf()).reshape(-1, 6).tolist()
        touching = np.zeros(len(self._owners), bool)
        loss = 0.0
        # pymunk orders contacts by pointers. Sorted by position, their order is the same in every
        # process.
        for (px, py, nx, ny, x, y), names in sorted(zip(values, ids, strict=True)):
            normal = -(px * nx + py * ny)
            if normal <= 0.0:
                continue
            name = names[0]
            if name not in self._index:  # pymunk may name the ground before the side of a link
                name = names[1]
                px = -px
                py = -py
                nx = -nx
                ny = -ny
            body = self._index[name]
            tangential = -px * ny + py * nx
            speed = now.speed_along(body, x, y, -ny, nx)
            loss -= tangential * speed
            rims = [(self._off_rim(now.pads[k], x, y), k) for k in self._pads_of[body]]
            off, pad = min(rims, default=(math.inf, 0))
            sums.pressed[0] += normal
            if off > 0.5 * (1.0 - bodies.INSET) * self._radius:  # contact of a link's side
                continue
            sums.slip[pad] += self._time_step * abs(speed)
            sums.impulse[pad] += tangential, normal
            touching[pad] = True
            self._normals[pad] = -nx, -ny
        back = touching & (self._off <= CONTACT_HYSTERESIS)
        sums.slip[back] += self._pending[back]
        landed = bool((touching & (self._off > CONTACT_HYSTERESIS)).any())
        self.note(touching)
        self._pending[self._off == 0.0] = 0.0
        for pad in np.flatnonzero((self._off > 0.0) & (self._off <= CONTACT_HYSTERESIS)).tolist():
            nx, ny = self._normals[pad].tolist()
            x, y = now.pads[pad].tolist()
            x, y = x - self._radius * nx, y - self._radius * ny
            speed = now.speed_along(self._owners[pad], x, y, ny, -nx)
            self._pending[pad] += self._time_step * abs(speed)
        return loss, landed

    def _off_rim(self, pad: Array, x: float, y: float) -> float:
        """Return the distance of a point from the rim of a pad, in m.

        The distance tells apart two pads on the same body.

        Args:
            pad: Centre of the pad, in m, shape (2,).
            x: Position of the point, in m.
            y: Height of the point, in m.
        """
        return abs(math.hypot(x - pad[0], y - pad[1]) - self._radius)

    def landing_soon(self, now: bodies.Snapshot) -> bool:
        """Return whether a pad may touch down within the next two time steps.

        On a height line, the method considers only the ground vertically below each pad, so it does
        not foresee some landings on rough ground. On shapes, it considers the nearest shape.

        Args:
            now: Positions and velocities of the bodies.
        """
        if isinstance(self._ground, Terrain):
            x, y = now.pads.T
            tilt = np.sqrt(1.0 + self._ground.gradient(x) ** 2)
            gaps = (y - self._ground.height(x)) / tilt - self._radius
        else:
            assert self._shapes is not None
            gaps = self._shapes.distances(now.pads) - self._radius
        fallen = self._gaps - gaps
        self._gaps = gaps
        return bool(((self._off > 0.0) & (gaps - 2.0 * fallen < bodies.SLOP)).any())


def check_stiffness(robot: Robot, time_step: float, owners: list[int]) -> None:
    """Check that a time step is short enough for the springs and dampers of compliant pads.

    Args:
        robot: The robot.
        time_step: Time step of pymunk, in s.
        owners: Index of the body to which each pad belongs.

    Raises:
        ValueError: If the time step is too long.
    """
    give = robot.pad_compliance
    lightest = math.inf
    for motion in bodies.turn_motions(robot):
        x, y = (motion.pads - motion.poses[owners, 1:]).T[..., None]
        spin, vx, vy = motion.rates[:, owners].T
        # Tangential and normal velocity of the point that touches level ground, per rate of q,
        # shape (pads, 2, 4).
        rows = np.stack([vx - spin * y + spin * robot.pad_radius, vy + spin * x], axis=1)
        yielding = rows @ np.linalg.inv(motion.mass_matrix) @ rows.swapaxes(1, 2)
        lightest = min(lightest, 1.0 / np.linalg.eigvalsh(yielding)[:, -1].max())
    k = max(give.stiffness, give.tangential_stiffness or 0.0)
    d = max(give.damping, give.tangential_damping or 0.0)
    # The positive root of k h^2 + d h = SHORT_ENOUGH m.
    m = SHORT_ENOUGH * lightest
    longest = 2.0 * m / (d + math.sqrt(d * d + 4.0 * k * m))
    if time_step > longest:
        raise ValueError(
            f"time_step must be at most {longest:.3g} s for feet of {k:g} N/m and {d:g} N s/m on "
            f"the rigid-body plant, whose feet are explicit springs, got {time_step}"
        )


class SpringPads:
    """Compliant pads of a robot on a terrain: explicit springs, dampers and bristles.

    The normal force is f_n = -k g - d g' while the gap g is negative, and it never pulls. Along the
    ground, a bristle of length s exerts the force f_t = -k_t s - d_t s' with |f_t| <= mu f_n. While
    the pad sticks, the bristle follows the pad. While the pad slides, the bristle keeps the length
    at which the law holds.

    The contact law is the same as in the projection backend, but its implementation is different.
    The forces follow from the last velocity and from the position to which pymunk moves the bodies
    before it changes their velocities. They act on the bodies directly, and no complementarity
    problem is solved. The time step must therefore be short; see :func:`check_stiffness`.

    Only the nearest point of the ground pushes a pad. In a groove, this point is on the nearer
    side. The sides of links follow the same law. A side is pushed at its point over the vertex that
    penetrates it most deeply.

    The axis "pads" of the arrays below contains the pads first, and then the sides of links.

    Args:
        robot: The robot.
        terrain: The ground.
        owners: Index of the body to which each pad, and then each side, belongs.
        time_step: Time step of pymunk, in s.
        sides: Indices of the pads at the two ends of each side, shape (sides, 2).
        shapes: The ground in pymunk, if it consists of shapes; None for a height line.

    Attributes:
        bristle: Present length s of each bristle, in m, shape (pads,).
        stored: Energy in springs and bristles, in J.
        forces: Tangential and normal force on each pad in the next time step, in N, shape
            (pads, 2).
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Ground,
        owners: list[int],
        time_step: float,
        sides: Ints,
        shapes: ShapePlanes | None = None,
    ) -> None:
        self._shapes = shapes
        self._sides = sides
        pads = len(owners) - len(sides)
        check_stiffness(robot, time_step, owners[:pads])
        self._give = robot.pad_compliance
        self._radius = robot.pad_radius
        self._kt = float(self._give.tangential_stiffness or 0.0)
        self._dt = float(self._give.tangential_damping or 0.0)
        self._terrain = terrain
        self._owners = owners
        self._h = time_step
        self._tilt = math.sqrt(1.0 + terrain.steepest**2)

    def start(self, now: bodies.Snapshot, space: pymunk.Space, bristle: Array | None) -> None:
        """Initialise the bristles, and compute the forces of the first time step.

        Args:
            now: Positions and velocities of the bodies.
            space: pymunk space that contains the ground.
            bristle: Length of each bristle, in m, shape (pads,). None for bristles at rest.
        """
        pads = len(self._owners)
        self.bristle = np.zeros(pads) if bristle is None else bristle.copy()
        self.forces = np.zeros((pads, 2))
        self.stored = 0.0
        self._normals = np.tile([0.0, 1.0], (pads, 1))
        self._vertices = np.zeros((len(self._sides), 2))
        # Values for the next time step: length of the bristle and gap (0 if open) at its end, speed
        # of the bristle along the ground and of the pad across it, and sliding speed.
        self._then = self.bristle.copy()
        self._gap = np.zeros(pads)
        self._rate = np.zeros((pads, 2))
        self._slide = np.zeros(pads)
        self.step(now, space)

    @property
    def touching(self) -> Bools:
        """Whether the ground will push each pad in the next time step, shape (pads,)."""
        return np.asarray(self.forces[:, 1] > 0.0)

    def loads(self, now: bodies.Snapshot) -> Array:
        """Return the loads of the pads on every body in the next time step.

        Args:
            now: Positions and velocities of the bodies.

        Returns:
            Force in x and y, in N, and moment, in N m, shape (bodies, 3).
        """
        loads = np.zeros((len(now.motion), 3))
        for pad in np.flatnonzero(self.forces.any(axis=1)).tolist():
            owner = self._owners[pad]
            tangential, normal = self.forces[pad].tolist()
            nx, ny = self._normals[pad].tolist()
            x, y = self._centres[pad].tolist()
            fx, fy = normal * nx + tangential * ny, normal * ny - tangential * nx
            x, y = x - now.motion[owner, 0], y - now.motion[owner, 1]
            loads[owner] += fx, fy, x * fy - y * fx + self._radius * tangential
        return loads

    def step(self, now: bodies.Snapshot, space: pymunk.Space, sums: Sums | None = None) -> None:
        """Compute the forces of the next time step.

        Args:
            now: Positions and velocities of the bodies.
            space: pymunk space that contains the ground.
            sums: Sums over the step, to which the work of the last time step's forces is added.
                None to leave the work out.
        """
        h = self._h
        k = self._give.stiffness
        d = self._give.damping
        kt = self._kt
        dt = self._dt
        spin = now.motion[self._owners, bodies.SPIN]
        self._centres = np.concatenate([now.pads, self._find_vertices(now.pads)])
        arm = self._centres - now.motion[self._owners, :2]
        speed = now.motion[self._owners][:, [bodies.VX, bodies.VY]]
        speed = speed + spin[:, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        then = self._centres + h * speed
        if isinstance(self._terrain, Terrain):
            height = self._terrain.height(then[:, 0])
            near = (then[:, 1] - height) / self._tilt <= self._radius
        else:
            assert self._shapes is not None
            height = np.zeros(len(then))  # unused
            near = self._shapes.distances(then) <= self._radius
        near[len(now.pads) :] = np.isfinite(self._vertices[:, 0])
        self.bristle[:] = self._then
        active = near | self.forces.any(axis=1) | (self.bristle != 0.0)
        self.stored = 0.0
        for pad in np.flatnonzero(active).tolist():
            gap = self._find_ground(space, pad, then[pad], float(height[pad]))
            nx, ny = self._normals[pad].tolist()
            vx, vy = speed[pad].tolist()
            along = vx * ny - vy * nx + self._radius * float(spin[pad])
            across = vx * nx + vy * ny
            depth = min(gap, 0.0)
            s = float(self.bristle[pad])
            normal = max(0.0, -k * depth - d * across) if gap < 0.0 else 0.0
            new = s + h * along
            tangential = 0.0
            wanted = -kt * new - dt * along
            most = self._terrain.friction * normal
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
                    sums.total["impact_loss"] += held
                new = rate = slide = self.bristle[pad] = 0.0
            self._then[pad] = new
            self.forces[pad] = (tangential, normal)
            self._gap[pad] = depth
            self._rate[pad] = (rate, across)
            self._slide[pad] = slide

    def _find_vertices(self, pads: Array) -> Array:
        """Find the vertex of the ground that penetrates each side most deeply or is nearest to it.

        The method also stores the normals and the vertices. A side without a vertex nearby gets an
        infinite vertex.

        Args:
            pads: Centres of the pads, in m, shape (pads, 2), without sides.

        Returns:
            The point of each side over its vertex, in m, shape (sides, 2).
        """
        a, b = pads[self._sides].swapaxes(0, 1)
        self._vertices[:] = np.inf
        if len(a) == 0 or not isinstance(self._terrain, Terrain):
            return a
        line = self._terrain.polyline
        if len(line) == 2:
            return a
        vertices = line[1:-1]
        before = line[:-2] - line[1:-1]
        after = line[2:] - line[1:-1]
        along = b - a
        normals = np.stack([-along[:, 1], along[:, 0]], 1) / np.hypot(*along.T)[:, None]
        before = normals @ (before / np.hypot(*before.T)[:, None]).T  # (sides, vertices)
        after = normals @ (after / np.hypot(*after.T)[:, None]).T
        flip = np.where(before + after > 0.0, -1.0, 1.0)
        away = vertices - a[:, None]
        share = np.einsum("svk,sk->sv", away, along) / (along**2).sum(axis=1)[:, None]
        gap = -flip * np.einsum("svk,sk->sv", away, normals)
        feet = a[:, None] + share[:, :, None] * along[:, None]
        carries = (share > 0.0) & (share < 1.0) & (flip * before < LEAN) & (flip * after < LEAN)
        carries &= gap < 2.0 * self._radius
        carries &= (gap >= 0.0) | (feet[:, :, 1] < self._terrain.height(feet[:, :, 0]))
        gap = np.where(carries, gap, np.inf)
        every = np.arange(len(a))
        nearest = gap.argmin(axis=1)
        self._normals[len(pads) :] = flip[every, nearest][:, None] * normals
        has = np.isfinite(gap[every, nearest])
        self._vertices[has] = vertices[nearest[has]]
        return np.where(has[:, None], feet[every, nearest], a)

    def _account(self, sums: Sums, pad: int, across: float, rate: float, slide: float) -> None:
        """Add the work of the last time step's forces to the sums.

        The work is computed with the mean of the speeds at the beginning and at the end of the time
        step.

        Args:
            sums: Sums over the step.
            pad: Index of the pad or side.
            across: Speed along the normal of the ground at the end of the time step, in m/s.
            rate: Speed of the bristle at the end of the time step, in m/s.
            slide: Sliding speed at the end of the time step, in m/s.
        """
        h = self._h
        tangential, normal = self.forces[pad].tolist()
        before, down = self._rate[pad].tolist()
        drift = 0.5 * (slide + float(self._slide[pad]))
        bristle = 0.5 * (rate + before)
        # The springs store their work or give it back. The rest of the work is lost.
        elastic = -self._give.stiffness * float(self._gap[pad])
        bent = tangential + self._kt * float(self.bristle[pad])
        sums.total["impact_loss"] -= h * (normal - elastic) * 0.5 * (across + down)
        sums.total["impact_loss"] -= h * bent * bristle
        sums.total["slip_loss"] -= h * tangential * drift
        sums.pressed[0] += h * normal
        if pad >= len(sums.slip):
            return
        sums.slip[pad] += h * abs(float(self._slide[pad]))
        sums.impulse[pad] += h * tangential, h * normal

    def _find_ground(self, space: pymunk.Space, pad: int, centre: Array, height: float) -> float:
        """Return the gap between a pad or a side and the ground, in m, and store the normal.

        Args:
            space: pymunk space that contains the ground.
            pad: Index of the pad or side.
            centre: Centre of the pad, or point of the side, in m, shape (2,).
            height: Height of the ground below the centre, in m. Used only on a height line.
        """
        x, y = centre.tolist()
        side = pad - len(self._owners) + len(self._sides)
        if side >= 0:
            apart = float(self._normals[pad] @ (centre - self._vertices[side]))
            return apart - self._radius if math.isfinite(apart) else math.inf
        if self._shapes is not None:
            answer = self._shapes.nearest(x, y)
            self._normals[pad] = answer.gradient
            return answer.distance - self._radius
        assert isinstance(self._terrain, Terrain)
        nearest = space.point_query_nearest((x, y), math.inf, pymunk.ShapeFilter())
        assert nearest is not None, "the ground has no end"
        above = math.copysign(1.0, y - height)
        distance = math.hypot(x - nearest.point.x, y - nearest.point.y)
        if distance > FLAT:
            scale = above / distance
            self._normals[pad] = scale * (x - nearest.point.x), scale * (y - nearest.point.y)
        else:
            slope = float(self._terrain.gradient(x))
            self._normals[pad] = -slope / math.hypot(1.0, slope), 1.0 / math.hypot(1.0, slope)
        return above * distance - self._radius
