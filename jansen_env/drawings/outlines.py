"""Flat parts at 1:1 in mm: outline, window, holes and engraved name of each plate and bar.

Points are complex numbers x + i y. Every line that is cut is a convex polygon made larger by a
radius all round: a hole has one corner, a bar two, a triangular plate and its window three.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise
from typing import NamedTuple

from jansen_env.robot import Robot
from jansen_env.robot import buildable as built
from jansen_env.robot.linkage import CRANK, FRAME

PIN, BUSH = 1e3 * built.PIN_RADIUS, 1e3 * built.PIN_RADIUS + 1.0  # radii of holes
SHAFT, HUB, HUB_SCREW = 6.0, 12.5, 1.6  # radii; screws M3
HUB_SCREWS = 9.25  # from the axis to either screw, along the crank
SHOE_SCREW, SHOE_THICKNESS = 2.25, 3.0  # radius for M4
MOTOR_PLATE, MOTOR_HOLE = 100.0, 30.0  # side, radius
WALL = 1.5  # least material between two holes; twice as much to a window
FILLET = 4.0  # radius of a window's corners
STRAIGHT = 1e-6  # height over length of a link whose joints are in line


class Round(NamedTuple):
    """A convex polygon, its corners counter-clockwise, made larger by a radius all round."""

    corners: tuple[complex, ...]
    radius: float

    @property
    def box(self) -> tuple[complex, complex]:
        """Lower left and upper right corner of the bounding box."""
        xs, ys = [z.real for z in self.corners], [z.imag for z in self.corners]
        out = complex(self.radius, self.radius)
        return complex(min(xs), min(ys)) - out, complex(max(xs), max(ys)) + out

    @property
    def area(self) -> float:
        """mm^2."""
        inner = sum(0.5 * (p.conjugate() * q).imag for p, q in sides(self.corners))
        around = sum(abs(q - p) for p, q in sides(self.corners))
        return inner + around * self.radius + math.pi * self.radius**2

    @property
    def path(self) -> list[tuple[complex, float]]:
        """Its corners, each with the bulge of the edge that follows, as in DXF; not of a circle."""
        found, corners = [], self.corners
        for (a, b), (_, c) in zip(sides(corners), sides(corners[1:] + corners[:1]), strict=True):
            start, end = (-1j * self.radius * (q - p) / abs(q - p) for p, q in ((a, b), (b, c)))
            bulge = math.tan(abs(cmath.phase((c - b) / (b - a))) / 4.0)
            found += [(b + start, bulge), (b + end, 0.0)] if self.radius else [(b, 0.0)]
        return found

    def moved(self, turn: complex, shift: complex) -> Round:
        """Turned about the origin by a unit, then shifted."""
        return Round(tuple(turn * z + shift for z in self.corners), self.radius)


class CutPart(NamedTuple):
    """A flat part.

    Attributes:
        thickness: mm. text: the name is engraved half way between these.
    """

    name: str
    thickness: float
    outline: Round
    windows: tuple[Round, ...]
    holes: tuple[Round, ...]
    joints: dict[str, complex]
    text: tuple[complex, complex]

    def moved(self, turn: complex, shift: complex) -> CutPart:
        """The part turned about the origin by a unit, then shifted."""
        return self._replace(
            outline=self.outline.moved(turn, shift),
            windows=tuple(one.moved(turn, shift) for one in self.windows),
            holes=tuple(one.moved(turn, shift) for one in self.holes),
            joints={name: turn * z + shift for name, z in self.joints.items()},
            text=(turn * self.text[0] + shift, turn * self.text[1] + shift),
        )

    def lying(self) -> CutPart:
        """The part turned so that it is as low as it can lie, the corner of its box at 0."""
        turns = [abs(q - p) / (q - p) for p, q in sides(self.outline.corners)]
        boxes = [(self.outline.moved(turn, 0j).box, turn) for turn in turns]
        (low, _), turn = min(boxes, key=lambda one: round((one[0][1] - one[0][0]).imag, 6))
        return self.moved(turn, -low)

    @property
    def mass(self) -> float:
        """Mass as drawn, kg."""
        area = self.outline.area - sum(one.area for one in (*self.windows, *self.holes))
        return 1e-9 * built.DENSITY * self.thickness * area


def sides(corners: Sequence[complex]) -> list[tuple[complex, complex]]:
    """Start and end of each side of a polygon."""
    return [*zip(corners, [*corners[1:], *corners[:1]], strict=True)]


def hull(points: Iterable[complex]) -> list[complex]:
    """Corners of the convex hull, counter-clockwise; both ends of points in line."""
    ordered = sorted(points, key=lambda z: (z.real, z.imag))
    found: list[complex] = []
    for row in (ordered, ordered[::-1]):
        kept: list[complex] = []
        for z in row:
            while len(kept) > 1 and _height(z, kept[-2], kept[-1]) < STRAIGHT * abs(z - kept[-2]):
                kept.pop()
            kept.append(z)
        found += kept[:-1]
    return found


def _height(z: complex, p: complex, q: complex) -> float:
    """How far a point is to the left of the line from p to q."""
    return ((q - p).conjugate() * (z - p)).imag / abs(q - p)


def _inset(corners: Sequence[complex], by: float) -> list[complex]:
    """A convex polygon made smaller by a distance all round; empty if that leaves none."""
    kept = [*corners]
    for p, q in sides(corners):
        cut = []
        for z, w in sides(kept):
            h, k = _height(z, p, q) - by, _height(w, p, q) - by
            cut += [z] if h >= 0.0 else []
            cut += [z + (w - z) * h / (h - k)] if h * k < 0.0 else []
        kept = cut
    return kept


def link_part(robot: Robot, body: int) -> CutPart:
    """The part of a body of every leg, by its number from 1 on, in the body's own axes.

    Raises ValueError: holes are too near to one another; names them.
    """
    name, joints = robot.linkage.bodies[body - 1]
    corners = [cmath.rect(1e3 * reach, turn) for reach, turn in robot.bodies[body - 1].corners]
    at = dict(zip(joints, corners, strict=True))
    outer = hull(corners)
    holes = _pin_holes(robot, body, at)
    margin = 500.0 * (built.FRAME_WIDTH if body == FRAME else built.WIDTH)
    feet = [at[toe] for toe in feet_of(robot, body)]
    for toe in feet:
        holes += _shoe_holes(toe, outer)
    if body == CRANK:  # room for the hub's second screw
        axis = at[joints[0]]
        screw = HUB_SCREWS * (at[joints[1]] - axis) / abs(at[joints[1]] - axis)
        holes += [Round((axis + way * screw,), HUB_SCREW) for way in (1, -1)]
        outer = hull([*corners, axis - screw])
    for one, other in combinations(holes, 2):
        apart = abs(other.corners[0] - one.corners[0])
        if apart < one.radius + other.radius + WALL:
            raise ValueError(
                f"{name} has holes of {2 * one.radius:g} and {2 * other.radius:g} mm at "
                f"{apart:.1f} mm from one another, must have {WALL:g} mm between them"
            )
    windows: tuple[Round, ...] = ()
    thickness = built.bar_thickness(name)
    if len(outer) > 2:
        flat = Round(tuple(outer), 0.0)
        inradius = 2.0 * flat.area / sum(abs(q - p) for p, q in sides(outer))
        margin = max(margin, (built.OUTLINE - 1.0) * inradius)
        thickness = built.PLATE_THICKNESS
        if len(outer) == len(at):
            shift = _window_shift(flat, feet[0]) if len(feet) == 1 and len(at) == 3 else 0j
            windows = _windows(outer, margin, holes, shift)
    spots = sorted(corners, key=lambda z: (z / (outer[1] - outer[0])).real)
    lines = sides(outer) if len(outer) > 2 else [*pairwise(spots)]
    p, q = max(lines, key=lambda line: (not {*line} & {*feet}, abs(line[1] - line[0])))
    outline = Round(tuple(outer), margin)
    return CutPart(name, 1e3 * thickness, outline, windows, tuple(holes), at, (p, q))


def _pin_holes(robot: Robot, body: int, at: dict[str, complex]) -> list[Round]:
    """Holes of the joints: for a pin in the body that holds it, for a bush in the others."""
    holders = {pin.joint: pin.other for pin in reversed(robot.linkage.pins)}
    radii = {joint: PIN if holders[joint] == body else BUSH for joint in at if joint in holders}
    axis = robot.linkage.bodies[CRANK - 1][1][0]
    if body == FRAME:
        radii[axis] = SHAFT + BUSH - PIN
    elif body == CRANK:
        radii[axis] = PIN  # for the hub's spigot
    return [Round((at[joint],), radius) for joint, radius in radii.items()]


def _shoe_holes(toe: complex, corners: list[complex]) -> list[Round]:
    """Two holes on the lines from a toe to its neighbours, behind one another if these are near."""
    near = [q if p == toe else p for p, q in sides(corners) if toe in (p, q)]
    ways = [z - toe for z in near or corners[:2]]
    apart = abs(cmath.phase(ways[0] / ways[1])) > math.pi / 6.0
    reaches = (15.0, 15.0) if apart else (14.0, 28.0)
    found = [toe + reach * way / abs(way) for reach, way in zip(reaches, ways, strict=True)]
    return [Round((z,), SHOE_SCREW) for z in found]


def _window_shift(triangle: Round, toe: complex) -> complex:
    """How far a foot draws the window to its toe, as ``buildable.triangular_plate`` has it."""
    areal = 1e-6 * built.PLATE_THICKNESS * built.DENSITY
    hole = areal * triangle.area * built.WINDOW**2
    return (toe - sum(triangle.corners) / 3.0) * (built.FOOT_MASS - built.PIN_SHARE) / hole


def _windows(
    corners: list[complex], margin: float, holes: list[Round], shift: complex
) -> tuple[Round, ...]:
    """The largest window that leaves a margin, and walls about all holes; none if it is small."""
    by = margin + FILLET
    while _inset(corners, by + FILLET):
        window = Round(tuple(z + shift for z in _inset(corners, by)), FILLET)
        if all(_outside(one.corners[0], window) > one.radius + 2.0 * WALL for one in holes):
            return (window,)
        by += 1.0
    return ()


def _outside(z: complex, window: Round) -> float:
    """Distance of a point from a window, 0 or less within."""
    lines = sides(window.corners)
    if max(-_height(z, p, q) for p, q in lines) <= 0.0:
        return 0.0
    shares = [min(max(((z - p) / (q - p)).real, 0.0), 1.0) for p, q in lines]
    nearest = (p + t * (q - p) for t, (p, q) in zip(shares, lines, strict=True))
    return min(abs(z - one) for one in nearest) - window.radius


def feet_of(robot: Robot, body: int) -> list[str]:
    """Toes whose treads a body carries."""
    toes = robot.linkage.all_pads[: len(robot.linkage.toes)]
    return [robot.linkage.joints[joint] for joint, one in toes if one == body - 1]


def cut_parts(robot: Robot) -> list[CutPart]:
    """Every flat part, lying: the links', a foot's shoe, the motor's plate.

    Raises ValueError: a part cannot be made; names it.
    """
    shoe = complex(2e3 * built.FOOT_RADIUS, 1e3 * built.FOOT_WIDTH)
    screws = [(complex(x, 0.5 * shoe.imag), SHOE_SCREW) for x in (8.0, shoe.real - 8.0)]
    plate = complex(MOTOR_PLATE, MOTOR_PLATE)
    parts = [
        *(link_part(robot, body) for body in range(1, len(robot.bodies) + 1)),
        _rectangle("foot-shoe", SHOE_THICKNESS, shoe, screws),
        _rectangle("motor-plate", 1e3 * built.PLATE_THICKNESS, plate, [(plate / 2, MOTOR_HOLE)]),
    ]
    return [part.lying() for part in parts]


def _rectangle(
    name: str, thickness: float, size: complex, holes: list[tuple[complex, float]]
) -> CutPart:
    outline = Round((0j, complex(size.real), size, complex(0.0, size.imag)), 0.0)
    round_ = tuple(Round((z,), radius) for z, radius in holes)
    return CutPart(name, thickness, outline, (), round_, {}, (5j, complex(size.real, 5.0)))
