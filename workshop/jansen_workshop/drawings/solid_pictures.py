"""Pictures of the solid model in the instructions: views, a section along the shaft, and ties.

Each function draws one picture on Matplotlib axes. Lengths are in mm.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from jansen_env.robot.linkage import CRANK, FRAME
from jansen_workshop.drawings.assembly import Assembly
from jansen_workshop.drawings.convex import Points, Round, rectangle
from jansen_workshop.drawings.drive_solids import motor_way
from jansen_workshop.drawings.part_pictures import ANGLE, PALE, fill, hide_frame, write_in_box
from jansen_workshop.drawings.solids import Solid

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


def draw_side_view(assembly: Assembly, numbers: Numbers, axes: Axes) -> None:
    """Draw all solids as seen from the motor.

    Args:
        assembly: Machine to draw.
        numbers: Numbers in the bill of materials, which select the colours.
        axes: Axes to draw on.
    """
    for solid in sorted(assembly.solids, key=lambda solid: -solid.low):  # the farthest first
        windows = [c.outline for c in solid.cavities if len(c.outline.corners) > 1]
        rims = [
            assembly.positions(solid, shape.polygon, IN_PICTURES)[0]
            for shape in (solid.outline, *windows)
        ]
        fill(axes, rims, f"C{_number(assembly, numbers, solid) % 10}")
    _finish_view(axes, "from the motor's side")


def draw_top_view(assembly: Assembly, numbers: Numbers, axes: Axes) -> None:
    """Draw all solids as seen from above, with the motor's end at the bottom.

    Args:
        assembly: Machine to draw.
        numbers: Numbers in the bill of materials, which select the colours.
        axes: Axes to draw on.
    """
    boxes = [_box_from_above(assembly, solid) for solid in assembly.solids]
    for k, (_, rim) in sorted(enumerate(boxes), key=lambda each: each[1][0]):  # the lowest first
        fill(axes, [rim], f"C{_number(assembly, numbers, assembly.solids[k]) % 10}")
    _finish_view(axes, "from above")


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
    write_in_box(axes, at + above, title)


def _through_holes(solid: Solid) -> list[Round]:
    """Return the outlines of the cavities that are as long as their solid."""
    return [
        cavity.outline
        for cavity in solid.cavities
        if cavity.high - cavity.low >= solid.high - solid.low - 1e-6
    ]


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
    middles: dict[int, tuple[float, float]] = {}  # middle of the first solid with each number
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
            middle = solid.low + 0.5 * width, 0.5 * (spans[-1][0] + spans[-1][1])
            middles.setdefault(number, middle)
    _number_section(middles, axes)
    axes.set_aspect("equal")
    axes.yaxis.tick_right()
    axes.set(xlabel="mm along the shaft from the first frame; upwards along its bar from O")


def _number_section(middles: dict[int, tuple[float, float]], axes: Axes) -> None:
    """Write the numbers of solids in a row above a section, with lines to their middles."""
    ordered = sorted(middles.items(), key=lambda each: each[1])
    for k, (number, (x, y)) in enumerate(ordered):
        axes.annotate(
            str(number),
            (x, y),
            (0.03 + 0.94 * k / max(len(middles) - 1, 1), (1.03, 1.07)[k % 2]),
            textcoords="axes fraction",
            fontsize=9,
            ha="center",
            arrowprops={"arrowstyle": "-", "lw": 0.6},
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
