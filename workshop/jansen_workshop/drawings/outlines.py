"""Flat parts at 1:1, in mm: outline, window, holes and engraved name of each plate and bar.

Every line to cut is a :class:`~jansen_workshop.drawings.convex.Round`. The polygon of a hole has
one corner, that of a bar has two, and those of a triangular plate and its window have three.
"""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jansen_env.engine.cutting import find_thin_wall, margin_of, put_holes
from jansen_env.robot import Robot, Spring
from jansen_env.robot import buildable as built
from jansen_env.robot.buildable import ALUMINIUM, Build
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.part_sizes import (
    M3,
    WALL,
    cutting_row,
    feet_of,
    hole_rows,
    pin_hole_radii,
    radii,
)
from jansen_env.robot.spring import carrier
from jansen_workshop.drawings.convex import Round, gap, hull, rectangle, sides
from jansen_workshop.drawings.mount import SIZES, mount_of, ties

BRACE = 6.0  # thickness of the brace, which fills the gap between neighbouring units
FILLET = 4.0  # radius of a window's corners
# Classes of holes: for a bush, for a fixed pin, and for a screw.
CLASSES = ("press", "slide", "clear")
FITS = {"laser": (-0.05, 0.1, 0.2), "water_jet": (-0.05, 0.15, 0.3), "print": (0.1, 0.3, 0.5)}
"""Initial estimates of the fit allowances of each process.

An entry has one value for each class of holes in :data:`CLASSES`: by how much the diameter of the
hole is enlarged, in mm.
"""
# Allowances that are added to the diameters of the coupon's holes and to the radii of its pegs, in
# mm.
STEPS = [round(0.1 * k, 1) for k in range(-4, 5)]


class CutPart(NamedTuple):
    """Flat part to cut.

    Attributes:
        name: Name of the part.
        thickness: Thickness of the part, in mm.
        outline: Outline of the part.
        windows: Large openings that make the part lighter.
        holes: Holes of the part.
        joints: Position of each joint by name, in mm.
        text: Two points, in mm. The part's number and name are engraved half way between them.
        number: Number in the bill of materials; 0 if the part has none.
        labels: Further texts to engrave, each with two points as in ``text``.
        density: Density of the material, in kg/m^3.
    """

    name: str
    thickness: float
    outline: Round
    windows: tuple[Round, ...]
    holes: tuple[Round, ...]
    joints: dict[str, complex]
    text: tuple[complex, complex]
    number: int = 0
    labels: tuple[tuple[str, complex, complex], ...] = ()
    density: float = built.DENSITY

    @property
    def title(self) -> str:
        """Number of the part, if it has one, and its name."""
        return f"{self.number} {self.name}" if self.number else self.name

    @property
    def lines(self) -> tuple[Round, ...]:
        """All lines to cut, the outline first."""
        return (self.outline, *self.windows, *self.holes)

    def moved(self, turn: complex, shift: complex) -> CutPart:
        """Return the part turned about the origin, then shifted.

        Args:
            turn: Complex number of magnitude 1 by which all points are multiplied.
            shift: Displacement in mm.
        """
        return self._replace(
            outline=self.outline.moved(turn, shift),
            windows=tuple(shape.moved(turn, shift) for shape in self.windows),
            holes=tuple(shape.moved(turn, shift) for shape in self.holes),
            joints={name: turn * z + shift for name, z in self.joints.items()},
            text=(turn * self.text[0] + shift, turn * self.text[1] + shift),
            labels=tuple((text, turn * a + shift, turn * b + shift) for text, a, b in self.labels),
        )

    def with_fit(self, fit: Sequence[float]) -> CutPart:
        """Return the part with holes enlarged by the allowance of their class.

        Args:
            fit: Increase of the diameter for each class in :data:`CLASSES`, in mm.
        """
        holes = (
            hole._replace(radius=hole.radius + 0.5 * fit[CLASSES.index(hole.fit)])
            for hole in self.holes
        )
        return self._replace(holes=tuple(holes))

    def with_kerf(self, kerf: float) -> CutPart:
        """Offset all lines by half the kerf, so that the cut part has its nominal size.

        Args:
            kerf: Width of the cut, in mm.

        Returns:
            The part whose lines are the centre lines of the cuts.
        """
        half = 0.5 * kerf
        windows, holes = (
            tuple(shape._replace(radius=shape.radius - half) for shape in shapes)
            for shapes in (self.windows, self.holes)
        )
        outline = self.outline._replace(radius=self.outline.radius + half)
        part = self._replace(outline=outline, windows=windows, holes=holes)
        return part.moved(1 + 0j, complex(half, half))

    def lying(self) -> CutPart:
        """Return the part turned so that its bounding box is as low as possible.

        One side of the outline is then horizontal, and the lower left corner of the box is at the
        origin.
        """
        turns = [abs(q - p) / (q - p) for p, q in sides(self.outline.corners)]
        boxes = [(self.outline.moved(turn, 0j).box, turn) for turn in turns]
        (low, _), turn = min(boxes, key=lambda box: round((box[0][1] - box[0][0]).imag, 6))
        return self.moved(turn, -low)

    @property
    def mass(self) -> float:
        """Mass of the part as drawn, in kg."""
        area = self.outline.area - sum(shape.area for shape in (*self.windows, *self.holes))
        return 1e-9 * self.density * self.thickness * area


def link_part(robot: Robot, body: int) -> CutPart:
    """Return the part that is cut for one body of every leg, in the axes of the body.

    Args:
        robot: Robot whose part is returned.
        body: Number of the body, from 1 on.

    Raises:
        ValueError: If two holes are too close to one another. The message names the part.
    """
    build = robot.build
    name, joints = robot.linkage.bodies[body - 1]
    corners = [cmath.rect(1e3 * reach, turn) for reach, turn in robot.bodies[body - 1].corners]
    at = dict(zip(joints, corners, strict=True))
    flat = Round(hull(corners))
    holes = _holes(robot, body, corners)
    feet = [at[toe] for toe in feet_of(robot, body)]
    if body == CRANK:  # extend the crank beyond the axis to the hub's second screw
        flat = Round(hull([*corners, *holes[-1].corners]))
    if body == FRAME:
        holes += _mount_holes(robot, at)
    thickness, margin = _thickness_and_margin(robot, body, flat)
    text = _name_line(robot, body, at, flat, holes)
    holes += spring_holes(robot, body, Round(flat.corners, margin), holes)
    _check_walls(name, holes)
    windows = _windows(flat, margin, holes, feet if build is ALUMINIUM else [])
    return CutPart(
        name,
        1e3 * thickness,
        Round(flat.corners, margin),
        windows,
        tuple(holes),
        at,
        text,
        body,
        density=build.density,
    )


def _check_walls(name: str, holes: Sequence[Round]) -> None:
    """Raise ValueError if two holes of the part ``name`` are too close to one another."""
    rows = [(hole.corners[0].real, hole.corners[0].imag, hole.radius) for hole in holes]
    pair = np.empty(2, np.int64)
    if find_thin_wall(np.array(rows), WALL, pair):
        hole, other = (holes[k] for k in pair.tolist())
        apart = abs(other.corners[0] - hole.corners[0])
        raise ValueError(
            f"holes of {name} must have {WALL:g} mm between them, got holes of "
            f"{2 * hole.radius:g} and {2 * other.radius:g} mm at {apart:.1f} mm from each other"
        )


def _thickness_and_margin(robot: Robot, body: int, flat: Round) -> tuple[float, float]:
    """Return the thickness (m) of a link, and the margin (mm) around its joints.

    Args:
        robot: Robot that the link belongs to.
        body: Number of the body, from 1 on.
        flat: Convex hull of the joints.
    """
    build = robot.build
    width = 1e3 * (build.frame_width if body == FRAME else build.width)
    margin = margin_of(width, flat.area, flat.around, built.OUTLINE)
    if len(flat.corners) > 2:
        return build.plate_thickness, margin
    if robot.linkage.names[body - 1] == "lower_rod":
        return build.lower_rod_thickness, margin
    return build.bar_thickness, margin


def _name_line(
    robot: Robot, body: int, at: dict[str, complex], flat: Round, holes: Sequence[Round]
) -> tuple[complex, complex]:
    """Return the ends of the line on which the name of a link is engraved.

    Args:
        robot: Robot that the link belongs to.
        body: Number of the body, from 1 on.
        at: Position of each joint by name.
        flat: Convex hull of the joints.
        holes: Holes of the link.
    """
    corners = [*at.values()]
    feet = {at[toe] for toe in feet_of(robot, body)}
    if body == FRAME:  # beyond the mounting holes
        axis = at[robot.linkage.joints[robot.linkage.axis]]
        pivot = next(z for z in corners if z != axis)
        return pivot, holes[-1].corners[0]
    spots = sorted(corners, key=lambda z: (z / (flat.corners[1] - flat.corners[0])).real)
    lines = sides(flat.corners) if len(flat.corners) > 2 else [*pairwise(spots)]
    start, end = max(lines, key=lambda line: (not {*line} & feet, abs(line[1] - line[0])))
    if body == CRANK and robot.build is not ALUMINIUM:  # beside the hub's second screw
        start = holes[-2].corners[0]
    return start, end


def _holes(robot: Robot, body: int, points: Sequence[complex]) -> list[Round]:
    """Return the holes of a body for its joints, its feet and the hub, in this order.

    Args:
        robot: Robot that the link belongs to.
        body: Number of the body, from 1 on.
        points: Positions of its joints, in mm.
    """
    pin, *_ = radii(robot.build)
    of_joints, feet = hole_rows(robot)
    of_pins = pin_hole_radii(robot, body).values()
    # A joint may have a hole for its pin and two for a foot; a crank has two more for the hub.
    rows = np.empty((3 * len(points) + 2, 3))
    places = np.array([(z.real, z.imag) for z in points])
    count = put_holes(body - 1, places, of_joints, feet, cutting_row(robot), rows)
    fits = ["slide" if radius == pin else "press" for radius in of_pins]
    fits += ["clear"] * (count - len(fits))
    holes = zip(rows[:count].tolist(), fits, strict=True)
    return [Round((complex(x, y),), radius, fit) for (x, y, radius), fit in holes]


def _mount_holes(robot: Robot, at: dict[str, complex]) -> list[Round]:
    """Return a frame's two holes for the standoffs of the motor plate, or for the brace.

    They lie on the line from the crank axis to the frame's first pivot.
    """
    axis = at[robot.linkage.bodies[CRANK - 1][1][0]]
    pivot = next(z for z in at.values() if z != axis)
    way = (pivot - axis) / abs(pivot - axis)
    radius = SIZES[robot.build.screw].clearance
    return [Round((axis + reach * way,), radius) for reach in mount_of(robot.build).screws]


class SpringEnd(NamedTuple):
    """End of a linear spring on a part.

    Attributes:
        joint: Name of the joint at the end; empty for a point of the chassis.
        body: Number of the body that carries the end, from 1 on.
        place: Position in the axes of this body, in mm.
    """

    joint: str
    body: int
    place: complex


def spring_ends(robot: Robot, spring: Spring) -> tuple[SpringEnd, SpringEnd]:
    """Return both ends of a linear spring."""
    start = _joint_end(robot, spring.start, carrier(robot.linkage, spring.start) + 1)
    if spring.end:
        return start, _joint_end(robot, spring.end, carrier(robot.linkage, spring.end) + 1)
    axis = _joint_end(robot, robot.linkage.joints[robot.linkage.axis], FRAME)
    anchor = 1e3 * complex(*spring.anchor) * cmath.exp(-1j * robot.frame_angle)
    return start, SpringEnd("", FRAME, axis.place + anchor)


def _joint_end(robot: Robot, joint: str, body: int) -> SpringEnd:
    """Return the end of a spring at a joint of a body."""
    corner = robot.linkage.bodies[body - 1][1].index(joint)
    reach, turn = robot.bodies[body - 1].corners[corner]
    return SpringEnd(joint, body, cmath.rect(1e3 * reach, turn))


def spring_holes(robot: Robot, body: int, outline: Round, holes: Sequence[Round]) -> list[Round]:
    """Return the holes of a part for screws that hold ends of springs.

    An end has no hole if it lies at another hole, such as that of a pin, if the part carries its
    foot there, or if the part does not reach so far.

    Args:
        robot: Robot that the part belongs to.
        body: Number of the body, from 1 on.
        outline: Outline of the part.
        holes: Other holes of the part.
    """
    springs = [spring for spring in robot.springs if isinstance(spring, Spring)]
    ends = [end for spring in springs for end in spring_ends(robot, spring) if end.body == body]
    free: list[Round] = []
    for end in ends:
        taken = (hole.corners[0] for hole in (*holes, *free))
        if end.joint in feet_of(robot, body) or any(abs(z - end.place) < 1e-3 for z in taken):
            continue
        beyond = gap(np.array([end.place]), np.array(outline.corners))
        if beyond + M3 + WALL <= outline.radius:
            free.append(Round((end.place,), M3))
    return free


def _windows(
    plate: Round, margin: float, holes: Sequence[Round], feet: Sequence[complex]
) -> tuple[Round, ...]:
    """Return the largest window of a triangular plate that leaves walls around all holes.

    In a plate with one foot, the window is shifted towards the toe, as in the simulated robot. The
    result is empty for other shapes, and for a plate that has no room for a window.
    """
    if len(plate.corners) != 3:
        return ()
    corners = np.array(plate.corners)
    inradius = 2.0 * plate.area / plate.around
    opposite = abs(np.roll(corners, -1) - np.roll(corners, 1))
    middle = opposite @ corners / plate.around  # incentre of the triangle
    shift = 0j
    if len(feet) == 1:  # as in ``buildable.triangular_plate``
        hole = 1e-6 * built.PLATE_THICKNESS * built.DENSITY * plate.area * built.WINDOW**2
        shift = (feet[0] - corners.mean()) * (built.FOOT_MASS - built.PIN_SHARE) / hole
    for rim in np.arange(margin + FILLET, inradius - FILLET):
        z = middle + shift + (1.0 - rim / inradius) * (corners - middle)
        walls = (hole.radius + 2.0 * WALL for hole in holes)
        rooms = (gap(np.array(hole.corners), z) - FILLET for hole in holes)
        if all(room > wall for room, wall in zip(rooms, walls, strict=True)):
            return (Round(tuple(z.tolist()), FILLET),)
    return ()


def toe_way(part: CutPart, toe: str) -> complex:
    """Return the direction in which a tread points, as a complex number of magnitude 1.

    The direction bisects the two edges at the toe and points away from the part.

    Args:
        part: Part that carries the tread.
        toe: Name of the toe.
    """
    z = part.joints[toe]
    ways = [(other - z) / abs(other - z) for name, other in part.joints.items() if name != toe]
    inwards = sum(ways, 0j)
    if abs(inwards) < 0.1:  # the toe lies between two other joints, in line with them
        inwards = 1j * ways[0]
    return -inwards / abs(inwards)


def frame_ways(robot: Robot) -> dict[str, complex]:
    """Return the direction from the crank axis to the first pivot of a frame, for each side.

    Args:
        robot: Robot that the frames belong to.
    """
    linkage = robot.linkage
    axis = linkage.joints[linkage.axis]
    pivot = next(joint for joint in linkage.bodies[FRAME - 1][1] if joint != axis)
    ways: dict[str, complex] = {}
    for side in sorted({leg.side for leg in robot.legs}, reverse=True):  # fore legs first
        at = joint_positions(robot, side, 0.0) @ np.array([1.0, 1j])
        way = complex(at[linkage.joints.index(pivot)] - at[linkage.axis])
        ways[side] = way / abs(way)
    return ways


def brace(robot: Robot) -> CutPart | None:
    """Return the plate that ties a fore frame to a back frame, in the axes of the chassis.

    Return None if the robot has a single crank pin, or if all its legs face the same way.

    Args:
        robot: Robot that the frames belong to.
    """
    build = robot.build
    ways = [*frame_ways(robot).values()]
    if not ties(robot):
        return None
    screw = SIZES[build.screw]
    spots = [reach * way for way in ways for reach in mount_of(build).screws]
    holes = [Round((z,), screw.clearance) for z in spots]
    holes.append(Round((0j,), 1e3 * build.shaft_radius + 0.5))
    margin = 2.0 * screw.clearance + 2.0 * WALL
    thickness = BRACE if build is ALUMINIUM else 1e3 * build.plate_thickness
    outline = Round(hull([0j, *spots]), margin)
    bottom = outline.box[0].imag
    middle = 0.5j * (bottom - holes[-1].radius)
    half = 0.5 * mount_of(build).screws[0]
    text = middle - half, middle + half
    return CutPart("brace", thickness, outline, (), tuple(holes), {}, text, density=build.density)


def motor_plate(robot: Robot) -> CutPart:
    """Return the plate that holds the motor; x points from the crank axis along the frame's bar.

    Args:
        robot: Robot that the machine is built from.
    """
    build = robot.build
    mount = mount_of(robot.build)
    radius = SIZES[build.screw].clearance
    holes = [Round((0j,), mount.plate_hole)]
    holes += [Round((z,), radius) for z in mount.motor_screws]
    holes += [Round((complex(x),), radius) for x in mount.screws]
    outline = Round(hull(mount.plate), mount.plate_margin)
    thickness = 1e3 * build.plate_thickness
    return CutPart(
        "motor-plate",
        thickness,
        outline,
        (),
        tuple(holes),
        {},
        mount.plate_text,
        density=build.density,
    )


def cut_parts(robot: Robot) -> list[CutPart]:
    """Return every flat part, turned to lie as low as possible, in the order of their numbers.

    The links come first, then the parts of the feet, the motor and the frames.

    Args:
        robot: Robot that the parts belong to.

    Raises:
        ValueError: If a part cannot be made. The message names the part.
    """
    parts = [link_part(robot, body) for body in range(1, len(robot.bodies) + 1)]
    build = robot.build
    thick = 1e3 * build.plate_thickness
    if build is not ALUMINIUM:  # a disc is glued to either side of each toe
        centre = complex(500.0 * build.width, 500.0 * build.width)
        hole = Round((centre,), M3)
        disc = Round((centre,), centre.real)
        ends = centre - 4 - 3.2j, centre + 4 - 3.2j
        parts.append(
            CutPart("foot-disc", thick, disc, (), (hole,), {}, ends, density=build.density)
        )
    parts.append(motor_plate(robot))
    if mount_of(build).doublers:
        parts.append(parts[FRAME - 1]._replace(name="frame-doubler"))
    if tie := brace(robot):
        parts.append(tie)
    lying = [part if len(part.outline.corners) == 1 else part.lying() for part in parts]
    return [part._replace(number=k) for k, part in enumerate(lying, 1)]


def coupon(thickness: float, build: Build = ALUMINIUM) -> list[CutPart]:
    """Return the coupon: the pieces to cut first, to find the kerf and the fits.

    The coupon is a plate with a slot, a row of holes for a pin and a row of holes for a bush, and
    nine pegs. If the build has no bushes, pins turn in the holes of the second row. The mark at a
    hole is its clearance, in mm. The mark of the widest peg that fits into the slot is the part of
    the kerf, in mm, for which the drawing does not compensate.

    Args:
        thickness: Thickness of the material, in mm.
        build: Sizes and materials of the parts.
    """
    pin, bush, *_ = radii(build)
    pressed = "bush" if build is ALUMINIUM else "turns"
    pitch = 18.0
    slot = Round((15 + 12j, 45 + 12j), 4.0)
    holes = []
    labels = []
    for radius, y, name in ((pin, 56j, f"pin {2 * pin:g}"), (bush, 34j, f"{pressed} {2 * bush:g}")):
        labels.append((name, 2.0 + y, 24.0 + y))
        for k, step in enumerate(STEPS):
            z = pitch * (k + 2.0) + y
            below = bush + 5.0
            holes.append(Round((z,), radius + 0.5 * step))
            labels.append((f"{step:+.1f}", z - pitch / 2 - 1j * below, z + pitch / 2 - 1j * below))
    size = complex(pitch * (len(STEPS) + 2.0), 68.0)
    text = 55 + 12j, complex(size.real - 5.0, 12.0)
    plate = CutPart(
        "slot: widest peg that fits is your kerf",
        thickness,
        rectangle(size),
        (slot,),
        tuple(holes),
        {},
        text,
        labels=tuple(labels),
    )
    pegs = (
        CutPart(
            f"{step:+.1f}", thickness, Round((0j, 30 + 0j), 4.0 + step), (), (), {}, (0j, 30 + 0j)
        )
        for step in STEPS
    )
    return [plate, *(peg.lying() for peg in pegs)]
