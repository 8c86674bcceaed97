"""Links as arrays: positions of their joints, their lengths, and changes of these lengths.

A row of :data:`LINK` holds the values of a :class:`jansen_env.robot.Bar`, ``Triangle`` or ``Plate``
under their names in robot files. ``points`` holds the joints of plates in m, shape (bodies, most
joints, 2). ``members`` holds the joints of each body, shape (bodies, most joints), and -1 where a
body has fewer.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Bools1, Floats1, Floats2, Floats3, Ints1, Ints2, kernel, stage
from jansen_env.engine.records import floats, row_dtype
from jansen_env.engine.sums import exact_sum

BAR, TRIANGLE, PLATE = range(3)
KINDS = ("Bar", "Triangle", "Plate")
"""Names of the kinds of links in robot files, in the order of their numbers."""
LINK = row_dtype(
    [
        ("kind", "i8"),
        *floats("length", "d", "l", "h", "alpha", "gamma", "mass", "inertia"),
        ("outward", "?"),
    ]
)
"""Record of a link; values are in m, rad, kg and kg m^2."""
BUILD = row_dtype(
    floats(
        "density",
        "bar_thickness",
        "lower_rod_thickness",
        "plate_thickness",
        "width",
        "frame_width",
        "outline",
        "window",
        "pin_share",
        "axis_mass",
        "foot_mass",
    )
)
"""Sizes and masses of built parts in SI units, see :mod:`jansen_env.robot.buildable`."""
ROD, FRAME_BAR, LOWER_ROD, TRIANGULAR, FOOT_PLATE = range(5)
FLAT = 1e-9  # a plate counts as a rod if its area is below this fraction of its size squared

Links = Annotated[NDArray[np.void], LINK, 1]
Builds = Annotated[NDArray[np.void], BUILD, 1]


@stage
def opposite(a, b, angle):
    """Return the side of a triangle opposite the angle between two sides, by the law of cosines.

    Args:
        a: First side, in m.
        b: Second side, in m.
        angle: Angle between the two sides, in rad.
    """
    return math.sqrt(a * a + b * b - 2.0 * a * b * mathematics.cos(angle))


@stage
def triangle_sides(d, l, h, alpha, gamma):  # noqa: E741 - the paper's symbol
    """Return the sides first-second, second-third and third-first of a triangle, in m.

    Args:
        d: Distance of the first corner from the centroid, in m.
        l: Distance of the second corner from the centroid, in m.
        h: Distance of the third corner from the centroid, in m.
        alpha: Angle between the first and the second corner at the centroid, in rad.
        gamma: Angle between the third and the first corner at the centroid, in rad.
    """
    beta = 2.0 * math.pi - alpha - gamma
    return opposite(d, l, alpha), opposite(l, h, beta), opposite(h, d, gamma)


@stage
def is_triangle(a, b, c):
    """Return whether three lengths are the sides of a triangle that is not degenerate."""
    return 2.0 * max(a, b, c) < a + b + c


@stage
def triangle_of_sides(a, b, c):
    """Return (d, l, h, alpha, gamma) of a triangle with known sides.

    This is the inverse of :func:`triangle_sides`. The distances from the centroid are two thirds of
    the medians: 9 d^2 = 2 a^2 + 2 c^2 - b^2, and likewise for l and h.

    Args:
        a: Side first-second, in m.
        b: Side second-third, in m.
        c: Side third-first, in m.
    """
    d = math.sqrt(2.0 * a * a + 2.0 * c * c - b * b) / 3.0
    l = math.sqrt(2.0 * a * a + 2.0 * b * b - c * c) / 3.0  # noqa: E741
    h = math.sqrt(2.0 * b * b + 2.0 * c * c - a * a) / 3.0
    alpha = mathematics.acos((d * d + l * l - a * a) / (2.0 * d * l))
    gamma = mathematics.acos((d * d + h * h - c * c) / (2.0 * d * h))
    return d, l, h, alpha, gamma


@stage
def flat_bar(length, width, end_mass, areal):
    """Return (mass, inertia) of a flat bar with round ends about two pins and a mass on each pin.

    The mass is in kg, and the inertia about the centre of mass in kg m^2.

    Args:
        length: Distance between the pins, in m.
        width: Width of the bar, in m.
        end_mass: Mass on each pin, in kg.
        areal: Mass of the bar per area, in kg/m^2.
    """
    radius, span = 0.5 * width, length * length
    middle, rounds = areal * length * width, areal * math.pi * radius * radius
    inertia = middle * (span + width * width) / 12.0
    # The two half discs have their centroids 4 r / (3 pi) beyond the pins.
    turning = 0.5 * radius * radius + 0.25 * span + length * 4.0 * radius / (3.0 * math.pi)
    inertia += rounds * turning
    return middle + rounds + 2.0 * end_mass, inertia + 0.5 * end_mass * span


@stage
def triangular_plate(a, b, c, end_mass, more, areal, outline, window):
    """Return (mass, inertia) of a plate with a window, and of masses on its three pins.

    Outline, window and pins form similar triangles with one centroid, which is the centre of mass.
    If the third pin carries a larger mass, the window lies nearer to it, so that the centre of mass
    stays at the centroid.

    Args:
        a: Side first-second of the pins' triangle, in m.
        b: Side second-third, in m.
        c: Side third-first, in m.
        end_mass: Mass on each pin, in kg.
        more: Additional mass on the third pin, in kg.
        areal: Mass of the plate per area, in kg/m^2.
        outline: Size of the outline relative to the pins' triangle.
        window: Size of the window relative to the pins' triangle.
    """
    half = 0.5 * (a + b + c)
    area = math.sqrt(half * (half - a) * (half - b) * (half - c))
    spread = (a * a + b * b + c * c) / 36.0  # inertia / mass of a uniform triangle
    outline, window = outline * outline, window * window
    inertia = areal * area * spread * (outline * outline - window * window)
    # For the pins, the sum of |corner - centroid|^2 is (a^2 + b^2 + c^2) / 3.
    mass = areal * area * (outline - window)
    # Distance of the third corner from the centroid
    reach = math.sqrt(2.0 * (b * b + c * c) - a * a) / 3.0
    moment, hole = more * reach, areal * area * window
    # The window is shifted by moment / hole, so that the material around it balances ``more``.
    inertia += moment * reach - moment * moment / hole
    return mass + 3.0 * end_mass + more, inertia + end_mass * 12.0 * spread


@stage(inline=False)
def count_joints(joints):
    """Return the number of joints of a body.

    Args:
        joints: Row of ``members`` of the body, see the module.
    """
    count = 0
    for k in range(len(joints)):
        if joints[k] >= 0:
            count += 1
    return count


@stage(inline=False)
def put_link_corners(link, points, count, corners):
    """Compute polar coordinates (c, o) of each joint of a link.

    If the angle of the link is a, the joint lies at the link's centre + c (cos, sin)(a + o).

    Args:
        link: Record of :data:`LINK`.
        points: Joints of a plate, in m, shape (most joints, 2).
        count: Number of joints.
        corners: Output, coordinates in m and rad, shape (most joints, 2). It must be 0 before.
    """
    if link.kind == BAR:
        corners[0, 0], corners[1, 0] = -0.5 * link.length, 0.5 * link.length
    elif link.kind == TRIANGLE:
        sign = 1.0 if link.outward else -1.0
        corners[0, 0] = sign * link.d
        corners[1, 0], corners[1, 1] = sign * link.l, link.alpha
        corners[2, 0], corners[2, 1] = sign * link.h, -link.gamma
    else:
        for k in range(count):
            x, y = points[k, 0], points[k, 1]
            corners[k, 0], corners[k, 1] = mathematics.hypot(x, y), mathematics.atan2(y, x)


@stage(inline=False)
def distance(link, points, i, k):
    """Return the distance between two different joints of a link, in m.

    Args:
        link: Record of :data:`LINK`.
        points: Joints of a plate, in m, shape (most joints, 2).
        i: Index of the first joint in the link.
        k: Index of the second joint in the link.
    """
    if link.kind == BAR:
        return link.length
    if link.kind == TRIANGLE:
        a, b, c = triangle_sides(link.d, link.l, link.h, link.alpha, link.gamma)
        return a if i + k == 1 else c if i + k == 2 else b
    return mathematics.hypot(points[k, 0] - points[i, 0], points[k, 1] - points[i, 1])


@stage
def _place_in(joints, joint):
    """Return the index of a joint in a body's row of ``members``, or -1 if it is not in the row."""
    for k in range(len(joints)):
        if joints[k] == joint:
            return k
    return -1


@kernel
def assemble(
    links: Links,
    points: Floats3,
    members: Ints2,
    dyads: Ints2,
    corners: Floats3,
    bars: Bools1,
    spans: Floats2,
) -> None:
    """Compute the arrays of links that :mod:`jansen_env.engine.closure` reads.

    Args:
        links: Links of a leg, shape (bodies,).
        points: Joints of plates, see the module.
        members: Joints of the bodies, see the module.
        dyads: Joint, start, end and branch of each dyad, shape (dyads, 6). The last two columns are
            output: the first bodies that connect the joint with start and with end.
        corners: Output of :func:`put_link_corners` for each body, shape (bodies, most joints, 2).
        bars: Output, whether each body is a bar, shape (bodies,).
        spans: Output, distances of the joint from start and end, in m, shape (dyads, 2).
    """
    corners[:] = 0.0
    for k in range(len(links)):
        put_link_corners(links[k], points[k], count_joints(members[k]), corners[k])
        bars[k] = links[k].kind == BAR
    for d in range(len(dyads)):
        joint = dyads[d, 0]
        for end in range(2):
            for k in range(len(members) - 1, -1, -1):
                a, b = _place_in(members[k], dyads[d, 1 + end]), _place_in(members[k], joint)
                if a >= 0 and b >= 0:
                    dyads[d, 4 + end] = k
                    spans[d, end] = distance(links[k], points[k], a, b)


# Lengths of links


@kernel
def put_lengths(links: Links, points: Floats3, members: Ints2, lengths: Floats2) -> None:
    """Compute the lengths of each link.

    The length of a bar is the distance between its joints. The lengths of a triangle are its sides
    first-second, second-third and third-first. The lengths of a plate are the distance between its
    first two joints, and two coordinates of every other joint relative to the first joint: along
    the line to the second joint, and to the left of this line.

    Args:
        links: Links of a leg, shape (bodies,).
        points: Joints of plates, see the module.
        members: Joints of the bodies, see the module.
        lengths: Output, in m, shape (bodies, most lengths).
    """
    for k in range(len(links)):
        link = links[k]
        if link.kind == BAR:
            lengths[k, 0] = link.length
        elif link.kind == TRIANGLE:
            sides = triangle_sides(link.d, link.l, link.h, link.alpha, link.gamma)
            lengths[k, 0], lengths[k, 1], lengths[k, 2] = sides
        else:
            place = points[k]
            x, y = place[0, 0], place[0, 1]
            span, cos, sin = _way(place)
            lengths[k, 0] = span
            for i in range(2, count_joints(members[k])):
                a, b = place[i, 0] - x, place[i, 1] - y
                lengths[k, 2 * i - 3] = cos * a + sin * b
                lengths[k, 2 * i - 2] = cos * b - sin * a


@kernel
def put_lengths_between(kind: int, places: Floats2, lengths: Floats1) -> None:
    """Compute the lengths of a link from the positions of its joints.

    Args:
        kind: ``BAR``, ``TRIANGLE`` or ``PLATE``.
        places: Positions of the joints, in m, shape (joints, 2).
        lengths: Output, in m, in the order of :func:`put_lengths`, shape (lengths,).
    """
    span, cos, sin = _way(places)
    lengths[0] = span
    if kind == TRIANGLE:
        lengths[1] = _between(places[1], places[2])
        lengths[2] = _between(places[2], places[0])
    elif kind == PLATE:
        for i in range(2, len(places)):
            a, b = places[i, 0] - places[0, 0], places[i, 1] - places[0, 1]
            lengths[2 * i - 3], lengths[2 * i - 2] = cos * a + sin * b, cos * b - sin * a


@stage
def _between(a, b):
    """Return the distance between two points, in m."""
    return mathematics.hypot(b[0] - a[0], b[1] - a[1])


@kernel
def frame_angle_of(places: Floats2, corners: Floats2) -> float:
    """Return the angle of a frame in the chassis, from -pi to pi rad.

    Args:
        places: Positions of the frame's joints, in m, shape (joints, 2). Only the first two count.
        corners: Output of :func:`put_link_corners` for the frame, shape (joints, 2).
    """
    half, turn = edge_turn(corners[0], corners[1])
    x, y = places[1, 0] - places[0, 0], places[1, 1] - places[0, 1]
    angle = mathematics.atan2(y, x) + half + turn
    return angle - 2.0 * math.pi * mathematics.nearest(angle / (2.0 * math.pi))


@stage
def edge_turn(first, second):
    """Return the turn from the edge between two corners of a body to the body's angle, in rad.

    The turn is the sum of the two returned numbers. The first of them is half a turn or 0. If the
    body's angle points to the first corner, the edge is taken in the opposite direction.

    Args:
        first: First corner as (c, o), see :func:`put_link_corners`.
        second: Second corner, likewise.
    """
    r, s, way = first[0], second[0], -1.0 if first[0] > 0.0 else 1.0
    x = way * (s * mathematics.cos(second[1]) - r * mathematics.cos(first[1]))
    y = way * (s * mathematics.sin(second[1]) - r * mathematics.sin(first[1]))
    return math.pi if r > 0.0 else 0.0, -mathematics.atan2(y, x)


@stage
def _way(place):
    """Return (distance, cosine, sine) of the line from the first joint of a plate to the second.

    The distance is in m.
    """
    dx, dy = place[1, 0] - place[0, 0], place[1, 1] - place[0, 1]
    span = mathematics.hypot(dx, dy)
    return span, dx / span, dy / span


@kernel
def resize(
    links: Links,
    points: Floats3,
    members: Ints2,
    lengths: Floats2,
    known: Floats2,
    dense: bool,
    new_links: Links,
    new_points: Floats3,
    work: Floats3,
) -> int:
    """Compute links with other lengths.

    A body whose lengths do not change is copied without changes.

    Args:
        links: Links of a leg, shape (bodies,).
        points: Joints of plates, see the module.
        members: Joints of the bodies, see the module.
        lengths: New lengths, in m, in the order of :func:`put_lengths`, shape (bodies, most
            lengths).
        known: Lengths of ``links``, in the same order and shape.
        dense: Whether a changed link keeps its mass per metre of its sides, and the way in which
            this mass is distributed. If False, its mass is 0.1 kg, and the caller must set it
            afterwards.
        new_links: Output, links with the new lengths, shape (bodies,).
        new_points: Output, their joints, in the shape of ``points``.
        work: Work space, shape (2, most joints + 1, 2).

    Returns:
        The index of the first body whose sides form no triangle, or -1 if there is none.
    """
    for k in range(len(links)):
        link, new, count = links[k], new_links[k], count_joints(members[k])
        new_links[k] = link
        for i in range(count):
            new_points[k, i, 0], new_points[k, i, 1] = points[k, i, 0], points[k, i, 1]
        changed = False
        for i in range(2 * count - 3 if link.kind == PLATE else 3 if link.kind == TRIANGLE else 1):
            changed = changed or lengths[k, i] != known[k, i]
        if not changed:
            continue
        if not _set_lengths(new, points[k], count, lengths[k], new_points[k]):
            return k
        if dense:
            spreads = (
                _spread(link, points[k], count, work),
                _spread(new, new_points[k], count, work),
            )
            sizes = (
                _size(link, points[k], count, work[0]),
                _size(new, new_points[k], count, work[0]),
            )
            new.mass = link.mass * sizes[1] / sizes[0]
            new.inertia = link.inertia * new.mass / link.mass * (spreads[1] / spreads[0])
    return -1


@stage(inline=False)
def _set_lengths(link, points, count, lengths, out):
    """Change the lengths of a link; return False if they should form a triangle but do not."""
    if link.kind == BAR:
        link.length = lengths[0]
        link.mass = link.inertia = 0.1
    elif link.kind == TRIANGLE:
        if not is_triangle(lengths[0], lengths[1], lengths[2]):
            return False
        shape = triangle_of_sides(lengths[0], lengths[1], lengths[2])
        link.d, link.l, link.h, link.alpha, link.gamma = shape
        link.mass = link.inertia = 0.1
    else:
        _, cos, sin = _way(points)  # keep the direction from the first joint to the second
        for i in range(count):
            a = b = 0.0
            if i == 1:
                a = lengths[0]
            elif i > 1:
                a, b = lengths[2 * i - 3], lengths[2 * i - 2]
            out[i, 0], out[i, 1] = cos * a - sin * b, sin * a + cos * b
        link.mass = 0.1
        x, y, link.inertia = uniform_plate(out, count, 0.1)
        for i in range(count):
            out[i, 0] -= x
            out[i, 1] -= y
    return True


@stage(inline=False)
def uniform_plate(points, count, mass):
    """Return (x, y, inertia) of a uniform plate over the largest triangle of its joints.

    If the joints are in line, the plate is a rod.

    Args:
        points: Positions of the joints, in m, shape (count or more, 2).
        count: Number of joints.
        mass: Mass of the plate, in kg.

    Returns:
        The centre of mass (x, y) in the axes of ``points``, in m, and the inertia in kg m^2.
    """
    x0, y0 = points[0, 0], points[0, 1]
    squares = longest = 0.0
    farthest = 0
    for i in range(count):
        dx, dy = points[i, 0] - x0, points[i, 1] - y0
        square = dx * dx + dy * dy
        squares += square
        if square > longest:
            farthest, longest = i, square
    first = second = third = -1
    largest = FLAT * squares
    for i in range(count):
        for j in range(i + 1, count):
            ax, ay = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            for k in range(j + 1, count):
                bx, by = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1]
                area = abs(ax * by - ay * bx)
                if area > largest:
                    first, second, third, largest = i, j, k, area
    divisor = 12.0
    if first < 0:
        divisor = 6.0
        u, v = points[farthest, 0] - x0, points[farthest, 1] - y0
        least = most = 0.0
        for i in range(count):
            along = (points[i, 0] - x0) * u + (points[i, 1] - y0) * v
            if i == 0 or along < least:
                first, least = i, along
            if i == 0 or along > most:
                second, most = i, along
    corners = 2.0 if third < 0 else 3.0
    x, y = points[first, 0] + points[second, 0], points[first, 1] + points[second, 1]
    if third >= 0:
        x, y = x + points[third, 0], y + points[third, 1]
    x, y = x / corners, y / corners
    total = _square_from(points[first], x, y, 0.0)
    total = _square_from(points[second], x, y, total)
    if third >= 0:
        total = _square_from(points[third], x, y, total)
    return x, y, mass * total / divisor


@stage
def _square_from(place, x, y, total):
    """Return ``total`` plus the squared distance between a point and (x, y)."""
    dx, dy = place[0] - x, place[1] - y
    return (total + dx * dx) + dy * dy


@stage(inline=False)
def _size(link, points, count, work):
    """Return the sum of a link's sides, in m."""
    sides = work[:, 0]
    for k in range(count - 1):
        sides[k] = distance(link, points, k, k + 1)
    total = exact_sum(sides[: count - 1], work[:, 1])
    return total + (distance(link, points, 0, count - 1) if count > 2 else 0.0)


@stage(inline=False)
def _spread(link, points, count, work):
    """Return inertia divided by mass for a uniform rod or plate with the same joints, in m^2."""
    corners, places = work[0], work[1]
    corners[:] = 0.0
    put_link_corners(link, points, count, corners)
    for k in range(count):
        reach, angle = corners[k, 0], corners[k, 1]
        places[k, 0], places[k, 1] = reach * mathematics.cos(angle), reach * mathematics.sin(angle)
    _, _, inertia = uniform_plate(places, count, 1.0)
    return inertia


@kernel
def put_built_parts(links: Links, points: Floats3, parts: Ints1, legs: int, build: Builds) -> None:
    """Give links the masses and inertias of built parts of the same lengths.

    Args:
        links: Links of a leg, changed in place, shape (bodies,).
        points: Joints of plates, see the module.
        parts: Part of each body, ``ROD`` to ``FOOT_PLATE``, shape (bodies,).
        legs: Number of the robot's legs, which share the mass that the frame carries.
        build: Sizes and masses of the parts, shape (1,).
    """
    size = build[0]
    for k in range(len(links)):
        link, part = links[k], parts[k]
        if part >= TRIANGULAR:
            more = size.foot_mass - size.pin_share if part == FOOT_PLATE else 0.0
            a, b, c = triangle_sides(link.d, link.l, link.h, link.alpha, link.gamma)
            areal = size.density * size.plate_thickness
            link.mass, link.inertia = triangular_plate(
                a, b, c, size.pin_share, more, areal, size.outline, size.window
            )
            continue
        length = distance(link, points[k], 0, 1)
        width, end, thickness = size.width, size.pin_share, size.bar_thickness
        if part == FRAME_BAR:
            width, end = size.frame_width, size.pin_share + size.axis_mass / legs
        elif part == LOWER_ROD:
            thickness = size.lower_rod_thickness
        link.mass, link.inertia = flat_bar(length, width, end, size.density * thickness)
