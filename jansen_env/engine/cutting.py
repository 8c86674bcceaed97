"""Holes and sizes of the flat parts that are cut for the links of a leg.

All lengths are in mm, as in drawings. A part has a hole for each joint that has a pin, and holes
for the screws of its feet. The crank also has holes for the two screws of the hub on the shaft.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.closure import CRANK, FRAME
from jansen_env.engine.kernel import Bools2, Floats2, Floats3, Ints1, Ints2, kernel, stage
from jansen_env.engine.link_shapes import Links, count_joints
from jansen_env.engine.records import floats, row_dtype

STRAIGHT = 1e-6
"""Sine of an angle below which three points count as in line."""
MILLIMETRES = 1e3
"""Millimetres per metre."""

CUTTING = row_dtype(
    [
        *floats(
            "wall",  # least width of material between two holes
            "frame_width",  # width of the frame's bar
            "width",  # width of the other bars
            # Size of a plate's outline divided by the size of the triangle of its joints.
            "outline",
            "hub_reach",  # distance of the hub's screws from the crank axis
            "hub_radius",  # radius of the holes for these screws
            "foot_radius",  # radius of the holes for the screws of a foot
            # Distances of the two screws of a foot from the toe: if the two sides of the plate at
            # the toe point in different directions, and if they are nearly parallel.
            "apart_first",
            "apart_second",
            "behind_first",
            "behind_second",
            "parallel",  # angle up to which two sides count as nearly parallel, in rad
            "sheet_length",  # longer side of the sheets that parts are cut from, without margins
            "sheet_width",
        ),
        ("foot_screws", "i8"),  # number of screws of a foot, 1 (at the toe) or 2
    ]
)
"""Record of the sizes by which parts are cut."""

Cutting = Annotated[NDArray[np.void], CUTTING, 1]


@kernel
def put_holes(
    body: int, points: Floats2, radii: Floats2, feet: Bools2, cutting: Cutting, holes: Floats2
) -> int:
    """Compute the holes of a part: those of its joints, of its feet, and of the hub, in this order.

    Args:
        body: Index of the body.
        points: Positions of the joints of the body, shape (joints, 2).
        radii: Radius of the hole of each joint in each body; 0 if it has none. The shape is
            (bodies, most joints).
        feet: Whether each joint of each body is a toe whose foot the body carries, shape
            (bodies, most joints).
        cutting: Sizes by which parts are cut, shape (1,).
        holes: Output, position x, y and radius of each hole, shape (3 joints + 2 or more, 3).

    Returns:
        The number of holes.
    """
    return _drill(body, points, radii[body], feet[body], cutting[0], holes)


@kernel
def find_thin_wall(holes: Floats2, wall: float, pair: Ints1) -> bool:
    """Find two holes that are too close to one another.

    Args:
        holes: Position x, y and radius of each hole, shape (holes, 3).
        wall: Least width of material between two holes.
        pair: Output, indices of the first two holes with less material between them, or -1 twice,
            shape (2,).

    Returns:
        Whether there are such holes.
    """
    pair[0], pair[1] = _find_thin_wall(holes, len(holes), wall)
    return pair[0] >= 0


@kernel
def find_uncut(
    links: Links,
    members: Ints2,
    corners: Floats3,
    radii: Floats2,
    feet: Bools2,
    cutting: Cutting,
    points: Floats2,
    holes: Floats2,
) -> int:
    """Find a link of a leg that cannot be cut.

    A link cannot be cut if there is too little material between two holes, if the link is larger
    than a sheet, or if it is too small to balance the mass of its foot, so that its inertia would
    be negative.

    Args:
        links: Links of the leg, shape (bodies,).
        members: Joints of the bodies, see :mod:`jansen_env.engine.link_shapes`.
        corners: Polar coordinates of the joints of each body, in m and rad, see
            :func:`jansen_env.engine.link_shapes.put_link_corners`.
        radii: See :func:`put_holes`.
        feet: See :func:`put_holes`.
        cutting: Sizes by which parts are cut, shape (1,).
        points: Work space, shape (most joints + 1, 2).
        holes: Work space, shape (3 most joints + 2, 3).

    Returns:
        The index of the first link that cannot be cut, or -1 if there is none.
    """
    sizes = cutting[0]
    for k in range(len(links)):
        count = count_joints(members[k])
        for i in range(count):
            reach, angle = MILLIMETRES * corners[k, i, 0], corners[k, i, 1]
            points[i, 0] = reach * mathematics.cos(angle)
            points[i, 1] = reach * mathematics.sin(angle)
        drilled = _drill(k, points[:count], radii[k], feet[k], sizes, holes)
        first, _ = _find_thin_wall(holes, drilled, sizes.wall)
        if first >= 0 or links[k].inertia < 0.0:
            return k
        if k == CRANK:  # The crank extends to the hub's second screw.
            points[count, 0], points[count, 1] = holes[drilled - 1, 0], holes[drilled - 1, 1]
            count += 1
        if not _fits_sheet(points[:count], sizes.frame_width if k == FRAME else sizes.width, sizes):
            return k
    return -1


@stage(inline=False)
def _drill(body, points, radii, feet, cutting, holes):
    """Compute the holes of a part, see :func:`put_holes`."""
    count = 0
    for i in range(len(points)):
        if radii[i] > 0.0:
            count = _add_hole(holes, count, points[i, 0], points[i, 1], radii[i])
    for i in range(len(points)):
        if feet[i]:
            count = _add_foot(points, i, cutting, holes, count)
    if body == CRANK:
        reach, radius = cutting.hub_reach, cutting.hub_radius
        count = _add_hole_towards(points, 0, 1, reach, radius, holes, count)
        count = _add_hole_towards(points, 0, 1, -reach, radius, holes, count)
    return count


@stage
def _add_hole(holes, count, x, y, radius):
    """Add a hole to ``count`` others, and return their number."""
    holes[count, 0], holes[count, 1], holes[count, 2] = x, y, radius
    return count + 1


@stage(inline=False)
def _add_hole_towards(points, start, end, reach, radius, holes, count):
    """Add a hole at a distance from one point towards another, and return the number of holes."""
    x, y = points[start, 0], points[start, 1]
    dx, dy = points[end, 0] - x, points[end, 1] - y
    span = mathematics.hypot(dx, dy)
    return _add_hole(holes, count, x + reach * dx / span, y + reach * dy / span, radius)


@stage(inline=False)
def _add_foot(points, toe, cutting, holes, count):
    """Add the holes for the screws of a foot to ``count`` others, and return their number.

    Two screws lie on the lines from the toe to those two joints that it sees farthest apart. If
    these lines are nearly parallel, the screws lie behind one another.
    """
    radius = cutting.foot_radius
    if cutting.foot_screws == 1:
        return _add_hole(holes, count, points[toe, 0], points[toe, 1], radius)
    first = second = 1 if toe == 0 else 0
    widest = 0.0
    for i in range(len(points)):
        for k in range(i + 1, len(points)):
            if i != toe and k != toe:
                angle = _angle_at(points, toe, i, k)
                if abs(angle) > abs(widest):
                    first, second, widest = i, k, angle
    # Counter-clockwise around the part, ``first`` follows the toe if the angle is positive, and
    # ``second`` precedes it. The first screw lies towards the joint that precedes the toe. If the
    # outline begins at the toe, which is then its leftmost corner, it is the other way round.
    if (widest > 0.0) != _is_leftmost(points, toe):
        first, second = second, first
    is_apart = abs(widest) > cutting.parallel
    near = cutting.apart_first if is_apart else cutting.behind_first
    far = cutting.apart_second if is_apart else cutting.behind_second
    count = _add_hole_towards(points, toe, first, near, radius, holes, count)
    return _add_hole_towards(points, toe, second, far, radius, holes, count)


@stage(inline=False)
def _angle_at(points, corner, i, k):
    """Return the angle by which point ``i`` must turn about a corner to point to ``k``, in rad."""
    ax, ay = points[i, 0] - points[corner, 0], points[i, 1] - points[corner, 1]
    bx, by = points[k, 0] - points[corner, 0], points[k, 1] - points[corner, 1]
    return mathematics.atan2(ax * by - ay * bx, ax * bx + ay * by)


@stage
def _is_leftmost(points, toe):
    """Return whether a point is the leftmost one, or the lower one of two leftmost points."""
    for i in range(len(points)):
        x, y = points[i, 0] - points[toe, 0], points[i, 1] - points[toe, 1]
        if x < 0.0 or (x == 0.0 and y < 0.0):
            return False
    return True


@stage(inline=False)
def _find_thin_wall(holes, count, wall):
    """Return the indices of the first two of ``count`` holes that are too close, or (-1, -1)."""
    for i in range(count):
        for k in range(i + 1, count):
            apart = mathematics.hypot(holes[k, 0] - holes[i, 0], holes[k, 1] - holes[i, 1])
            if apart < holes[i, 2] + holes[k, 2] + wall:
                return i, k
    return -1, -1


@stage(inline=False)
def _fits_sheet(points, width, cutting):
    """Return whether a part fits a sheet if it lies as low as possible.

    Args:
        points: Points inside the part, which has a margin around them, shape (points, 2).
        width: Width of a bar, which is twice the margin of a part that is a bar.
        cutting: Sizes by which parts are cut.
    """
    low = length = twice_area = around = 0.0
    is_first = True
    for i in range(len(points)):
        for k in range(len(points)):
            if i == k or not _is_side(points, i, k):
                continue
            dx, dy = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
            span = mathematics.hypot(dx, dy)
            around += span
            twice_area += points[i, 0] * points[k, 1] - points[i, 1] * points[k, 0]
            left, right = _range_along(points, dx / span, dy / span)
            bottom, top = _range_along(points, -dy / span, dx / span)
            if is_first or top - bottom < low:
                is_first = False
                low, length = top - bottom, right - left
    rim = 2.0 * margin_of(width, 0.5 * twice_area, around, cutting.outline)
    return length + rim <= cutting.sheet_length and low + rim <= cutting.sheet_width


@stage
def margin_of(width, area, around, outline):
    """Return the margin of a part around the convex hull of its joints.

    The outline of a plate is larger than its hull by the factor ``outline``, measured at the
    inscribed circle of a triangle. Its margin is at least that of a bar.

    Args:
        width: Width of a bar.
        area: Area of the hull; 0 for a bar.
        around: Total length of the sides of the hull.
        outline: Size of a plate's outline divided by the size of its hull.
    """
    return max(0.5 * width, (outline - 1.0) * 2.0 * area / around)


@stage(inline=False)
def _is_side(points, i, k):
    """Return whether the line from point ``i`` to ``k`` is a whole side of the convex hull.

    The hull lies on the left of the line. A line with two ends has two sides.
    """
    dx, dy = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
    for j in range(len(points)):
        x, y = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        left, along = dx * y - dy * x, dx * x + dy * y
        least = STRAIGHT * mathematics.hypot(dx, dy) * mathematics.hypot(x, y)
        is_between = 0.0 <= along <= dx * dx + dy * dy
        if left < -least or (left <= least and not is_between):
            return False
    return True


@stage
def _range_along(points, cos, sin):
    """Return the least and the greatest coordinate of points in a direction."""
    least = most = cos * points[0, 0] + sin * points[0, 1]
    for i in range(1, len(points)):
        value = cos * points[i, 0] + sin * points[i, 1]
        least, most = min(least, value), max(most, value)
    return least, most
