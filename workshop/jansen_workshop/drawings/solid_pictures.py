"""Pictures of the solid model in the instructions: views, a section along the shaft, and ties.

Each function draws one picture on Matplotlib axes. Lengths are in mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from jansen_env.robot.linkage import CRANK, FRAME
from jansen_workshop.drawings.assembly import Assembly
from jansen_workshop.drawings.convex import Points, Round, rectangle
from jansen_workshop.drawings.drive_solids import motor_way
from jansen_workshop.drawings.outlines import toe_way
from jansen_workshop.drawings.part_pictures import (
    ANGLE,
    LETTERS,
    PALE,
    fill,
    hide_frame,
    points_per_mm,
    spread,
    write_in_box,
)
from jansen_workshop.drawings.solids import AssemblyPiece, Solid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Numbers = Mapping[tuple[str, str], int]
"""Numbers in the bill of materials, by name and size."""
AT_REST = np.array([0.0])
IN_PICTURES = np.array([ANGLE])
SLENDER = 3.5  # radius below which a solid is drawn over the parts that it passes through
EDGE = 15.0  # distance from the farther standoff to the edge of a section


def _named(assembly: Assembly, name: str) -> list[Solid]:
    """Return the solids of the pieces of a name."""
    return [solid for solid in assembly.solids if assembly.pieces[solid.piece].name == name]


def _number(assembly: Assembly, numbers: Numbers, solid: Solid) -> int:
    """Return the number of a solid's piece in the bill of materials."""
    piece = assembly.pieces[solid.piece]
    return numbers[piece.name, piece.size]


# Views


def draw_side_view(assembly: Assembly, numbers: Numbers, stage: str, axes: Axes) -> None:
    """Draw all solids as seen from the motor.

    Args:
        assembly: Machine to draw.
        numbers: Numbers in the bill of materials, which select the colours.
        stage: Stage whose pieces are in colour; empty for all.
        axes: Axes to draw on.
    """
    for solid in sorted(assembly.solids, key=lambda solid: -solid.low):  # the farthest first
        windows = [c.outline for c in solid.cavities if len(c.outline.corners) > 1]
        rims = [
            assembly.positions(solid, shape.polygon, IN_PICTURES)[0]
            for shape in (solid.outline, *windows)
        ]
        fill(axes, rims, _color(assembly, numbers, stage, solid))
    _finish_view(axes, "from the motor's side")


def draw_top_view(assembly: Assembly, numbers: Numbers, stage: str, axes: Axes) -> None:
    """Draw all solids as seen from above, with the motor's end at the bottom.

    Args:
        assembly: Machine to draw.
        numbers: Numbers in the bill of materials, which select the colours.
        stage: Stage whose pieces are in colour and have a label; empty for all, without labels.
        axes: Axes to draw on.
    """
    boxes = [_box_from_above(assembly, solid) for solid in assembly.solids]
    for k, (_, rim) in sorted(enumerate(boxes), key=lambda each: each[1][0]):  # the lowest first
        fill(axes, [rim], _color(assembly, numbers, stage, assembly.solids[k]))
    labels = [
        (complex(rim.mean()), _title(assembly, numbers, solid))
        for solid, (_, rim) in zip(assembly.solids, boxes, strict=True)
        if assembly.pieces[solid.piece].stage == stage
    ]
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    room = 0.25 * (right - left) if labels else 0.0
    axes.set_xlim(left - room, right + room)
    line = 13.0 / points_per_mm(axes, right - left + 2.0 * room, high - low)
    for x, align in ((left, "right"), (right, "left")):
        beside = [label for label in labels if (label[0].real < 0.0) == (x < 0.0)]
        _label_beside(axes, beside, x, align, line)
    _finish_view(axes, "from above")


def _color(assembly: Assembly, numbers: Numbers, stage: str, solid: Solid) -> str:
    """Return the colour of a solid in a view, which is pale if it belongs to another stage."""
    if stage and assembly.pieces[solid.piece].stage != stage:
        return PALE
    return f"C{_number(assembly, numbers, solid) % 10}"


def _title(assembly: Assembly, numbers: Numbers, solid: Solid) -> str:
    """Return the number and the name of a solid's piece."""
    return f"{_number(assembly, numbers, solid)} {assembly.pieces[solid.piece].name}"


def _label_beside(
    axes: Axes, labels: Sequence[tuple[complex, str]], x: float, align: str, line: float
) -> None:
    """Write labels below one another beside a picture, with lines to what they name.

    Args:
        axes: Axes to draw on.
        labels: Point to which each label's line leads, and the label.
        x: Position of the labels.
        align: Horizontal alignment of the labels.
        line: Distance between two labels.
    """
    ordered = sorted(labels, key=lambda label: label[0].imag)
    places = spread([z.imag for z, _ in ordered], line)
    for (z, text), y in zip(ordered, places, strict=True):
        axes.annotate(
            text,
            (z.real, z.imag),
            (x, y),
            fontsize=LETTERS,
            ha=align,
            va="center",
            arrowprops={"arrowstyle": "-", "lw": 0.6},
            zorder=8,
        )


def _box_from_above(assembly: Assembly, solid: Solid) -> tuple[float, Points]:
    """Return the highest point of a solid, and the rectangle that it covers from above."""
    corners = assembly.corner_positions(solid, IN_PICTURES)[0]
    low, high = Round(tuple(corners.tolist()), solid.outline.radius).box
    size = complex(high.real - low.real, solid.high - solid.low)
    return high.imag, np.array(rectangle(size).polygon) + complex(low.real, solid.low)


def _finish_view(axes: Axes, title: str) -> None:
    """Add a scale bar and a title to a view of the machine."""
    left, _ = axes.get_xlim()
    bottom, _ = axes.get_ylim()
    axes.plot((left, left + 100.0), (bottom, bottom), "k", lw=3)
    axes.annotate("100 mm", (left, bottom), (0, -12), textcoords="offset points", fontsize=9)
    axes.set_title(title, fontsize=10, loc="left")
    hide_frame(axes)


# Ties


def draw_ties(assembly: Assembly, axes: Axes) -> None:
    """Draw two neighbouring frames with their brace, and the first frame with its standoffs.

    Args:
        assembly: Machine to draw.
        axes: Axes to draw on.
    """
    first, *others = _named(assembly, "frame")
    braces = _named(assembly, "brace")
    height = 1.5 * 1e3 * assembly.robot.bodies[FRAME - 1].distance(0, 1)
    _draw_tied(
        assembly,
        [first, *_named(assembly, "standoff")],
        0j,
        "first frame, from the motor's side",
        0.13j * height,
        axes,
    )
    if braces:
        pair = [solid for solid in others if abs(solid.high - braces[0].low) < 1e-6]
        pair += [
            solid
            for solid in others
            if abs(solid.low - braces[-1].high) < 10.0 and solid not in pair
        ]
        _draw_tied(
            assembly,
            [*pair[:2], braces[0]],
            -0.4j * height,
            "two frames and the brace between them",
            0.13j * height,
            axes,
        )
    hide_frame(axes)


def _draw_tied(
    assembly: Assembly, solids: list[Solid], at: complex, title: str, above: complex, axes: Axes
) -> None:
    """Draw frames with what is fixed to them.

    Args:
        assembly: Machine that they belong to.
        solids: Solids to draw.
        at: Position of the crank axis in the picture.
        title: Title of the drawing.
        above: Position of the title from the crank axis.
        axes: Axes to draw on.
    """
    for solid in solids:
        rims = [
            at + assembly.positions(solid, rim.polygon, AT_REST)[0]
            for rim in (solid.outline, *_through_holes(solid))
        ]
        frame = assembly.pieces[solid.piece].name == "frame"
        fill(axes, rims, PALE if frame else "C1")
        if frame:
            _name_joints(assembly, solid, at, axes)
    write_in_box(axes, at + above, title)


def _name_joints(assembly: Assembly, frame: Solid, at: complex, axes: Axes) -> None:
    """Write the name of each joint of a frame above it."""
    joints = assembly.parts[FRAME - 1].joints
    places = assembly.positions(frame, [*joints.values()], AT_REST)[0]
    for name, z in zip(joints, (at + places).tolist(), strict=True):
        axes.annotate(
            name,
            (z.real, z.imag),
            (0, 9),
            textcoords="offset points",
            ha="center",
            fontweight="bold",
            zorder=6,
        )


def _through_holes(solid: Solid) -> list[Round]:
    """Return the outlines of the cavities that are as long as their solid."""
    return [
        cavity.outline
        for cavity in solid.cavities
        if cavity.high - cavity.low >= solid.high - solid.low - 1e-6
    ]


# Foot


def draw_foot(assembly: Assembly, numbers: Numbers, axes: Axes) -> None:
    """Draw the first foot from the side and from the front, with the numbers of its parts.

    The tip of the foot points downwards.

    Args:
        assembly: Machine that the foot belongs to.
        numbers: Numbers in the bill of materials.
        axes: Axes to draw on.
    """
    first = next(piece for piece in assembly.pieces if piece.stage == "foot")
    solids = _solids_of_foot(assembly, first)
    part = assembly.parts[solids[0].carrier.body - 1]
    toe = part.joints[first.joint]
    turn = -1j / toe_way(part, first.joint)
    radius = 1e3 * assembly.build.foot_radius
    tops = [turn * (np.array(each.outline.polygon) - toe) for each in solids[1:]]
    # Height up to which the foot is drawn, in mm.
    height = 0.2 * radius + max(float(rim.imag.max()) for rim in tops)
    front = 1j * (height + 2.2 * radius)  # position of the front view
    middle = 0.5 * (min(each.low for each in solids) + max(each.high for each in solids))

    blocks = []  # pieces in the front view
    for solid in sorted(solids, key=lambda each: -each.low):  # the farthest first
        shapes = [solid.outline, *(cavity.outline for cavity in solid.cavities)]
        rims = [_below(turn * (np.array(shape.polygon) - toe), height) for shape in shapes]
        link = assembly.pieces[solid.piece].stage != "foot"
        color = PALE if link else _color(assembly, numbers, "", solid)
        fill(axes, [rim for rim in rims if rim.size], color)
        low, high = float(rims[0].imag.min()), float(rims[0].imag.max())
        corners = (complex(solid.low - middle, low), complex(solid.high - middle, high))
        number = str(_number(assembly, numbers, solid))
        blocks.append((float(rims[0].real.max()), corners, number, color))

    ends: dict[str, complex] = {}  # outermost point of the parts with each number
    blocks.sort(key=lambda block: block[0])  # the nearest last
    for _, (corner, opposite), number, color in blocks:
        shape = rectangle(opposite - corner).moved(1 + 0j, front + corner)
        fill(axes, [np.array(shape.polygon)], color)
        x = max(corner.real, opposite.real, key=lambda each: (round(abs(each), 6), each))
        if number not in ends or abs(x) >= abs(ends[number].real) - 1e-6:
            y = 0.1 * corner.imag + 0.9 * opposite.imag
            ends[number] = front + complex(x, y)

    line = 14.0 / points_per_mm(axes, 4.0 * radius, front.imag + height + 1.8 * radius)
    for way, align in ((-1, "right"), (1, "left")):
        beside = [(z, number) for number, z in ends.items() if way * z.real > 0.0]
        _label_beside(axes, beside, 1.6 * way * radius, align, line)
    for y, title in ((0.0, "from the side"), (front.imag, "from the front")):
        axes.text(0.0, y - 1.15 * radius, title, ha="center", va="top", fontsize=10)
    axes.set(xlim=(-2.0 * radius, 2.0 * radius), ylim=(-1.6 * radius, front.imag + height))
    hide_frame(axes)


def _solids_of_foot(assembly: Assembly, first: AssemblyPiece) -> list[Solid]:
    """Return the solids of the foot that a piece belongs to, and of the link that carries it."""
    place = first.stage, first.leg, first.joint
    feet = []
    for solid in assembly.solids:
        piece = assembly.pieces[solid.piece]
        if (piece.stage, piece.leg, piece.joint) == place:
            feet.append(solid)
    carrier = feet[0].carrier
    links = (
        solid
        for solid in assembly.solids
        if solid.carrier == carrier and assembly.pieces[solid.piece].body == carrier.body
    )
    return [next(links), *feet]


def _below(rim: Points, height: float) -> Points:
    """Return the rim of the part of a convex polygon that lies below a height, in mm."""
    points: list[complex] = []
    corners = rim.tolist()
    for start, end in zip(corners, [*corners[1:], corners[0]], strict=True):
        if start.imag <= height:
            points.append(start)
        if (start.imag <= height) != (end.imag <= height):
            points.append(start + (end - start) * (height - start.imag) / (end.imag - start.imag))
    return np.array(points)


# Section


def draw_section(assembly: Assembly, numbers: Numbers, axes: Axes) -> None:
    """Draw a numbered section along the shaft and the frame's bar, at the motor.

    Args:
        assembly: Machine to draw.
        numbers: Numbers in the bill of materials.
        axes: Axes to draw on.
    """
    turn = motor_way(assembly)
    hub = _named(assembly, "hub")[0]
    top = hub.high + assembly.parts[CRANK - 1].thickness + 0.5
    spots: dict[int, tuple[float, float]] = {}  # point in the first solid with each number
    for solid in sorted(assembly.solids, key=_flat_first):
        cut = _cut(assembly, solid, turn) if solid.low <= top else None
        if cut is None:
            continue
        number = _number(assembly, numbers, solid)
        width = min(solid.high, top) - solid.low
        spans = _spans(solid, turn, *cut)
        for start, end in spans:
            axes.bar(
                solid.low,
                end - start,
                width,
                start,
                align="edge",
                color=f"C{number % 10}",
                ec="black",
                lw=0.6,
            )
        if spans:
            start, end = spans[-1]
            # Close to the upper edge, where no shaft or screw passes through the solid.
            spots.setdefault(number, (solid.low + 0.5 * width, start + 0.95 * (end - start)))
    _number_section(spots, axes)
    axes.set_aspect("equal")
    axes.yaxis.tick_right()
    axes.tick_params(axis="x", pad=24.0)
    axes.set_xlabel("mm along the shaft from the first frame")
    axes.set_title("upwards: mm along the bar of the first frame from O", fontsize=10, pad=28.0)


def _number_section(spots: dict[int, tuple[float, float]], axes: Axes) -> None:
    """Write the numbers of solids above and below a section, with lines to points in them."""
    box = axes.get_position()
    axes.set_position((box.x0, box.y0 + 0.1, box.width, box.height - 0.17))  # room for numbers
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    apart = 22.0 / points_per_mm(axes, right - left, high - low)
    heights = [y for _, y in spots.values()]
    middle = 0.5 * (min(heights) + max(heights))
    for upper in (True, False):
        row = [each for each in spots.items() if (each[1][1] >= middle) == upper]
        row.sort(key=lambda each: each[1])
        places = spread([x for _, (x, _) in row], apart)
        for (number, end), x in zip(row, places, strict=True):
            axes.annotate(
                str(number),
                end,
                (x, 1.04 if upper else -0.04),
                textcoords=axes.get_xaxis_transform(),
                fontsize=11,
                ha="center",
                va="center",
                arrowprops={"arrowstyle": "-", "lw": 0.8},
            )


def _flat_first(solid: Solid) -> tuple[bool, float]:
    """Return a key that sorts parts before the thin solids that pass through them."""
    return solid.outline.radius < SLENDER, solid.low


def _cut(assembly: Assembly, solid: Solid, turn: complex) -> tuple[float, float] | None:
    """Return where a line through O crosses a solid within a section, or None.

    Args:
        assembly: Machine that the solid belongs to.
        solid: Solid that the line crosses.
        turn: Direction of the line, as a complex number of magnitude 1.

    Returns:
        Start and end, in mm from O.
    """
    place = assembly.corner_positions(solid, AT_REST)[0] / turn
    crossing = _crossing(Round(tuple(place.tolist()), solid.outline.radius))
    if crossing is None:
        return None
    low = max(crossing[0], -1.6 * assembly.mount.motor[0])
    high = min(crossing[1], assembly.mount.screws[1] + EDGE)
    return (low, high) if low < high else None


def _crossing(outline: Round) -> tuple[float, float] | None:
    """Return where the x axis crosses an outline, or None if it does not cross the outline."""
    points = np.array(outline.polygon)
    after = np.roll(points, -1)
    cross = (points.imag <= 0.0) != (after.imag <= 0.0)
    if not cross.any():
        return None
    p = points[cross]
    q = after[cross]
    x = p.real - p.imag * (q.real - p.real) / (q.imag - p.imag)
    return float(x.min()), float(x.max())


def _spans(solid: Solid, turn: complex, low: float, high: float) -> list[tuple[float, float]]:
    """Return the intervals of a line through O that lie in a solid but not in its holes.

    Holes are taken into account only for a solid that is fixed in the chassis.

    Args:
        solid: Solid that the line crosses.
        turn: Direction of the line, as a complex number of magnitude 1.
        low: Start of the line in the solid, in mm from O.
        high: End of the line in the solid, in mm from O.
    """
    spans = [(low, high)]
    if not solid.fixed:
        return spans
    for cavity in solid.cavities:
        if cavity.low > solid.low + 1e-6 or cavity.high < solid.high - 1e-6:
            continue
        hole = _crossing(cavity.outline.moved(1.0 / turn, 0j))
        if hole:
            parts = [
                part
                for start, end in spans
                for part in ((start, min(end, hole[0])), (max(start, hole[1]), end))
            ]
            spans = [(start, end) for start, end in parts if end > start + 1e-6]
    return spans
