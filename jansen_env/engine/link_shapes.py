"""Links as arrays: where their joints are, their lengths, and the same links with other lengths.

A row of :data:`LINK` has the numbers of a :class:`jansen_env.robot.Bar`, ``Triangle`` or ``Plate``
under their names in robot files; ``points`` (bodies, most joints, 2) has the joints of plates, m.
``members`` (bodies, most joints) has the joints of each body; -1 where a body has fewer.
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
"""A link: m, rad, kg, kg m^2."""
BUILD = row_dtype(
    floats(
        "density", "bar_thickness", "lower_rod_thickness", "plate_thickness", "width",
        "frame_width", "outline", "window", "pin_share", "axis_mass", "foot_mass",
    )
)  # fmt: skip
"""Sizes and masses of built parts, see :mod:`jansen_env.robot.buildable`; SI units."""
ROD, FRAME_BAR, LOWER_ROD, TRIANGULAR, FOOT_PLATE = range(5)
FLAT = 1e-9  # of the squares of a plate's sides: an area below it is that of a rod

Links = Annotated[NDArray[np.void], LINK, 1]
Builds = Annotated[NDArray[np.void], BUILD, 1]


@stage
def opposite(a, b, angle):
    """Side of a triangle opposite an angle between two sides (law of cosines), m."""
    return math.sqrt(a * a + b * b - 2.0 * a * b * mathematics.cos(angle))


@stage
def triangle_sides(d, l, h, alpha, gamma):  # noqa: E741 - the paper's symbol
    """Lengths first-second, second-third, third-first of a triangle seen from its centroid, m."""
    beta = 2.0 * math.pi - alpha - gamma
    return opposite(d, l, alpha), opposite(l, h, beta), opposite(h, d, gamma)


@stage
def is_triangle(a, b, c):
    """Whether three lengths form a triangle."""
    return 2.0 * max(a, b, c) < a + b + c


@stage
def triangle_of_sides(a, b, c):
    """(d, l, h, alpha, gamma) of a triangle with sides first-second, second-third, third-first.

    Two thirds of each median: 9 d^2 = 2 a^2 + 2 c^2 - b^2, and so on around.
    """
    d = math.sqrt(2.0 * a * a + 2.0 * c * c - b * b) / 3.0
    l = math.sqrt(2.0 * a * a + 2.0 * b * b - c * c) / 3.0  # noqa: E741
    h = math.sqrt(2.0 * b * b + 2.0 * c * c - a * a) / 3.0
    alpha = mathematics.acos((d * d + l * l - a * a) / (2.0 * d * l))
    gamma = mathematics.acos((d * d + h * h - c * c) / (2.0 * d * h))
    return d, l, h, alpha, gamma


@stage
def flat_bar(length, width, end_mass, areal):
    """(mass, inertia) of a flat bar with round ends about two pins, and a mass on each.

    ``areal``: kg/m^2.
    """
    radius, span = 0.5 * width, length * length
    middle, rounds = areal * length * width, areal * math.pi * radius * radius
    inertia = middle * (span + width * width) / 12.0
    # Two half discs, with their centroids 4 r / 3 pi beyond the pins.
    turning = 0.5 * radius * radius + 0.25 * span + length * 4.0 * radius / (3.0 * math.pi)
    inertia += rounds * turning
    return middle + rounds + 2.0 * end_mass, inertia + 0.5 * end_mass * span


@stage
def triangular_plate(a, b, c, end_mass, more, areal, outline, window):
    """(mass, inertia) of a windowed plate about the triangle of its pins, with masses on them.

    Outline, hole and pins are similar triangles about one centroid, which is the centre of mass.
    A third corner that is ``more`` heavy draws the hole towards it, as far as leaves the centre of
    mass there. ``outline`` and ``window``: sizes, to the pins' triangle.
    """
    half = 0.5 * (a + b + c)
    area = math.sqrt(half * (half - a) * (half - b) * (half - c))
    spread = (a * a + b * b + c * c) / 36.0  # inertia / mass of a uniform triangle
    outline, window = outline * outline, window * window
    inertia = areal * area * spread * (outline * outline - window * window)
    # The pins: sum of |corner - centroid|^2 is (a^2 + b^2 + c^2) / 3.
    mass = areal * area * (outline - window)
    reach = math.sqrt(2.0 * (b * b + c * c) - a * a) / 3.0  # of the third corner
    moment, hole = more * reach, areal * area * window
    inertia += moment * reach - moment * moment / hole
    return mass + 3.0 * end_mass + more, inertia + end_mass * 12.0 * spread


@stage(inline=False)
def count_joints(joints):
    """Number of joints of a body, a row of ``members``."""
    count = 0
    for k in range(len(joints)):
        if joints[k] >= 0:
            count += 1
    return count


@stage(inline=False)
def put_link_corners(link, points, count, corners):
    """Put (c, o) of each joint into (most joints, 2): it is at the centre + c (cos, sin)(a + o)."""
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
    """Distance between two different joints of a link, by their places in it, m."""
    if link.kind == BAR:
        return link.length
    if link.kind == TRIANGLE:
        a, b, c = triangle_sides(link.d, link.l, link.h, link.alpha, link.gamma)
        return a if i + k == 1 else c if i + k == 2 else b
    return mathematics.hypot(points[k, 0] - points[i, 0], points[k, 1] - points[i, 1])


@stage
def _place_in(joints, joint):
    """Place of a joint in a body, a row of ``members``; -1 for none."""
    for k in range(len(joints)):
        if joints[k] == joint:
            return k
    return -1


@kernel
def assemble(
    links: Links, points: Floats3, members: Ints2, dyads: Ints2, corners: Floats3, bars: Bools1,
    spans: Floats2,
) -> None:  # fmt: skip
    """Put what :mod:`jansen_env.engine.closure` has of links.

    Args:
        dyads: (dyads, 6) joint, start, end and branch; the bodies from start and end to the joint
            are put behind them, the first that have both.
        corners: (bodies, most joints, 2) out. bars: (bodies,) out. spans: (dyads, 2) out, m.
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


# Lengths.


@kernel
def put_lengths(links: Links, points: Floats3, members: Ints2, lengths: Floats2) -> None:
    """Put the lengths of each link into (bodies, most of them), m.

    Of a bar its length; of a triangle its sides first-second, second-third, third-first. Of a plate
    the distance of its first two joints, and where each other one lies from the first: along the
    way to the second, and to its left.
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
    """Put the lengths of a link of a kind from the places of its joints (joints, 2), m.

    In the order of :func:`put_lengths`.
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
    """Distance of two places, m."""
    return mathematics.hypot(b[0] - a[0], b[1] - a[1])


@kernel
def frame_angle_of(places: Floats2, corners: Floats2) -> float:
    """Return the angle of a frame in the chassis, rad, whose first two joints are at places, m."""
    half, turn = edge_turn(corners[0], corners[1])
    return mathematics.atan2(places[1, 1] - places[0, 1], places[1, 0] - places[0, 0]) + half + turn


@stage
def edge_turn(first, second):
    """Turn from the edge between two corners (c, o) of a body to its angle.

    Half a turn or none, and more. For a body whose angle points to the first of them the edge is
    taken the other way round.
    """
    r, s, way = first[0], second[0], -1.0 if first[0] > 0.0 else 1.0
    x = way * (s * mathematics.cos(second[1]) - r * mathematics.cos(first[1]))
    y = way * (s * mathematics.sin(second[1]) - r * mathematics.sin(first[1]))
    return math.pi if r > 0.0 else 0.0, -mathematics.atan2(y, x)


@stage
def _way(place):
    """Distance of the first two joints of a plate, m, and cosine and sine of the way."""
    dx, dy = place[1, 0] - place[0, 0], place[1, 1] - place[0, 1]
    span = mathematics.hypot(dx, dy)
    return span, dx / span, dy / span


@kernel
def resize(
    links: Links, points: Floats3, members: Ints2, lengths: Floats2, known: Floats2, dense: bool,
    new_links: Links, new_points: Floats3, work: Floats3,
) -> int:  # fmt: skip
    """Put links with other lengths; those of a body whose lengths are as before stay as they are.

    Args:
        lengths: as of :func:`put_lengths`. known: those of ``links``.
        dense: Whether a link is as heavy per metre of its sides as before, its mass spread in the
            same way; else its mass is 0.1 kg, and must be put in afterwards.
        work: (2, most joints + 1, 2) work space.

    Returns:
        The first body whose sides form no triangle, or -1.
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
    """Give a link other lengths; returns whether they form a triangle where they must."""
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
        _, cos, sin = _way(points)  # of its first two joints, as before
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
    """(x, y, inertia) of a uniform plate over the largest triangle of joints, or of a rod.

    The centre, m, in the axes of the points (count or more, 2), and kg m^2. It is a rod if the
    joints are in line.
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
    share = 12.0
    if first < 0:
        share = 6.0
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
    return x, y, mass * total / share


@stage
def _square_from(place, x, y, total):
    """A sum of squares, with those of the way from a place added."""
    dx, dy = place[0] - x, place[1] - y
    return (total + dx * dx) + dy * dy


@stage(inline=False)
def _size(link, points, count, work):
    """Sum of a link's sides, m."""
    sides = work[:, 0]
    for k in range(count - 1):
        sides[k] = distance(link, points, k, k + 1)
    total = exact_sum(sides[: count - 1], work[:, 1])
    return total + (distance(link, points, 0, count - 1) if count > 2 else 0.0)


@stage(inline=False)
def _spread(link, points, count, work):
    """Inertia over mass of a rod or uniform plate about the same joints, m^2."""
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
    """Give links the masses and inertias of built parts, by their lengths.

    Args:
        parts: (bodies,) ``ROD`` ... ``FOOT_PLATE``. legs: Number of the robot's legs, which share
            what the frame carries. build: (1,) sizes and masses.
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
