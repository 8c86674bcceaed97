"""Collision detection: contact planes of a robot on the part of a height line that it can reach.

:mod:`jansen_env.plants.grounds` explains which ground a robot stands on. A pad has a plane for each
face of the ground within the robot's speculative margin. A pad that lies deeper in the ground than
this margin has only the plane through which it can leave the ground on the shortest way. If the
ground is not a height line, pymunk lists the planes instead, see
:mod:`jansen_env.plants.shape_planes`.

Most stages share these arguments:

- ``state``: state of the robot relative to the crank axis, shape (8,).
- ``status``: record ``STATUS`` of the robot, see :mod:`jansen_env.engine.records`.
- ``surface``: vertices of all height lines, in m, shape (vertices, 2). The vertices from ``start``
  or ``begin`` to ``end``, excluding ``end``, are the part that the robot can reach.
- ``sides``: pads at the ends of each side of a link, lower number first, shape (sides, 2).
- ``planes``: records ``PLANE`` of the contact planes that are found.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.contact_solver import STICK
from jansen_env.engine.kernel import Floats1, Floats2, Floats4, Ints2, kernel, stage
from jansen_env.engine.records import Layout, Planes, Robots, World
from jansen_env.engine.tables import locate, pad_place

SPECULATIVE_MARGIN = 0.05
"""Smallest speculative margin, in m.

Faces of the ground within the speculative margin of a pad become contact planes. The margin grows
with the distance that a pad can travel in a time step.
"""
LARGEST_MARGIN = 0.2
"""Largest speculative margin, in m, which the fastest robots have."""
MARGIN = 1.0
"""Distance, in m, after which the part of the ground that a robot can reach is determined again."""
WAY_OUT = 0.35
"""Distance, in m, within which a pad that lies deep in the ground must find a way out."""
LEAN = 0.1
"""Sine of the largest angle at which a side of a link may enter the ground beside a vertex.

The vertex carries the side only up to this angle.
"""
FACE = 1e-6
"""Angle, in rad, between a contact's normal and a segment's below which they count as equal."""
SAME = 1e-9
"""Sum of the differences of two planes' values below which the planes count as the same plane."""


@stage(inline=False)
def detect(state, robot, model, ground, world, sides, planes):
    """Find the contact planes near a robot's pads and near the sides of its links.

    The function sets the robot's ``margin``, its range of ``planes``, and ``too_deep``.

    Args:
        state: State of the robot relative to the crank axis, shape (8,).
        robot: The robot's record.
        model: Tables of the robot, a :class:`jansen_env.engine.records.Model`.
        ground: The ground, a :class:`jansen_env.engine.records.Ground`.
        world: Data that the robots have in common.
        sides: Pads at the ends of each side of a link, shape (sides, 2).
        planes: Output, contact planes.

    Returns:
        False if the robot has left the part of the ground that is known.
    """
    status = robot.status
    set_margin(state, robot, world.time_step)
    if not abs(state[0] - status.ground_x) <= status.room:
        return False
    toes, pads = world.toes, len(model.layout)
    near = pads if pads > toes and _others_near(state, status, ground) else toes
    begin_planes(status)
    cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
    for j in range(near):
        x, y = _centre(state, cos, sin, model.pads, model.layout[j])
        list_planes(x, y, j, status, ground.surface, world, planes)
    if world.links_collide:
        _list_sides(state, cos, sin, near, status, model, ground.surface, world, sides, planes)
    sort_planes(status.first_plane, status.end_plane, planes)
    return True


@stage(inline=False)
def _list_sides(state, cos, sin, near, status, model, surface, world, sides, planes):
    """List a contact plane for each vertex of the ground that the side of a link may touch.

    The plane belongs to the pad at the second end of the side, and ``far_pad`` is the pad at the
    first end. Only sides whose first pad is below ``near``, the number of pads that may be near the
    ground, are considered.
    """
    start, end, reach = status.first_near, status.end_near, status.pad_radius + status.margin
    for k in range(len(sides)):
        a, b = sides[k, 1], sides[k, 0]
        if b >= near:
            continue
        ax, ay = _centre(state, cos, sin, model.pads, model.layout[a])
        bx, by = _centre(state, cos, sin, model.pads, model.layout[b])
        ex, ey = bx - ax, by - ay
        vertex = max(segment_at(surface, start, end, min(ax, bx) - reach), start) + 1
        while vertex < end - 1 and surface[vertex, 0] < max(ax, bx) + reach:
            x, y = surface[vertex, 0], surface[vertex, 1]
            carries, nx, ny = _side_normal(surface, vertex, x - ax, y - ay, ex, ey)
            distance = nx * (ax - x) + ny * (ay - y)
            if distance < 0.0:  # The side is in the ground, or beyond a ridge.
                foot_x, foot_y = x + distance * nx, y + distance * ny
                carries = carries and foot_y < height_at(surface, start, end, foot_x)
            if carries and distance < reach:
                _list(a, b, x, y, status, nx, ny, 0.0, distance, world.capacity, planes)
            vertex += 1


@stage(inline=False)
def _side_normal(surface, k, x, y, ex, ey):
    """Return whether vertex ``k`` can carry a side, and the side's normal (x, y) out of the ground.

    Only the vertex of a ridge can carry a side. In a valley, the faces of the ground are in the
    way.

    Args:
        surface: Vertices of the ground, in m, shape (vertices, 2).
        k: Index of the vertex.
        x: Horizontal position of the vertex relative to the side's first end, in m.
        y: Vertical position of the vertex relative to the side's first end, in m.
        ex: Horizontal position of the side's second end relative to its first end, in m.
        ey: Vertical position of the side's second end relative to its first end, in m.
    """
    square = ex * ex + ey * ey
    fraction, length = (ex * x + ey * y) / square, np.sqrt(square)
    nx, ny = -ey / length, ex / length
    px, py = surface[k - 1, 0] - surface[k, 0], surface[k - 1, 1] - surface[k, 1]
    qx, qy = surface[k + 1, 0] - surface[k, 0], surface[k + 1, 1] - surface[k, 1]
    before = (nx * px + ny * py) / mathematics.hypot(px, py)
    after = (nx * qx + ny * qy) / mathematics.hypot(qx, qy)
    if before + after > 0.0:
        nx, ny, before, after = -nx, -ny, -before, -after
    ridge = px * qy - py * qx >= 0.0
    return ridge and 0.0 < fraction < 1.0 and max(before, after) < LEAN, nx, ny


@stage
def set_margin(state, robot, time_step):
    """Set a robot's speculative margin to the distance that its fastest pad covers in a time step.

    The margin always lies between :data:`SPECULATIVE_MARGIN` and :data:`LARGEST_MARGIN`.
    """
    # An upper bound of the speed of all pads.
    speed = abs(state[4]) + abs(state[5])
    speed += robot.properties.pitch_arm * abs(state[6]) + robot.properties.crank_arm * abs(state[7])
    robot.status.margin = min(max(SPECULATIVE_MARGIN, speed * time_step), LARGEST_MARGIN)


@stage
def _others_near(state, status, ground):
    """Return whether a pad that is not a toe may be near the ground."""
    depths = ground.depths
    pitches, farthest = len(depths) - 1, depths[-1]
    extra = status.pad_radius + status.margin - SPECULATIVE_MARGIN
    depth = depths[locate(pitches, state[2])[0]] + extra
    left, right = state[0] - farthest - extra, state[0] + farthest + extra
    return _rises_above(ground.surface, status, left, right, state[1] - depth)


@stage
def _rises_above(surface, status, left, right, height):
    """Return whether the ground rises above ``height`` anywhere between ``left`` and ``right``."""
    begin, end = status.first_near, status.end_near
    first, last = segment_at(surface, begin, end, left), segment_at(surface, begin, end, right)
    above = _height(surface, first, left) > height or _height(surface, last, right) > height
    for k in range(first + 1, last + 1):
        above = above or surface[k, 1] > height
    return above


@stage
def segment_at(surface, begin, end, x):
    """Return the index of the segment of the ground ``surface[begin:end]`` above or below ``x``."""
    low, high = begin, end - 1
    while high - low > 1:
        middle = (low + high) // 2
        if surface[middle, 0] <= x:
            low = middle
        else:
            high = middle
    return low


@stage
def _height(surface, k, x):
    """Return the height of segment ``k`` at ``x``, in m."""
    slope = (surface[k + 1, 1] - surface[k, 1]) / (surface[k + 1, 0] - surface[k, 0])
    return surface[k, 1] + slope * (x - surface[k, 0])


@stage(inline=False)
def height_at(surface, begin, end, x):
    """Return the height of the ground ``surface[begin:end]`` at ``x``, in m.

    The first and the last segment continue beyond the ends of the ground.
    """
    return _height(surface, segment_at(surface, begin, end, x), x)


@kernel
def pad_centres(state: Floats1, pads: Floats4, layout: Layout, out: Floats2) -> None:
    """Compute the centres of a robot's pads.

    Args:
        state: State of the robot relative to the crank axis, shape (8,).
        pads: Tables of the pads, see :class:`jansen_env.engine.records.Model`.
        layout: Records of the pads, shape (pads,).
        out: Output, centres of the pads in m, shape (pads, 2).
    """
    find_centres(state, pads, layout, out)


@stage(inline=False)
def find_centres(state, pads, layout, out):
    """Compute the centres of a robot's pads, see :func:`pad_centres`."""
    cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
    for j in range(len(layout)):
        out[j, 0], out[j, 1] = _centre(state, cos, sin, pads, layout[j])


@stage
def _centre(state, cos, sin, pads, pad):
    """Return the centre (x, y) of a pad, in m; ``cos`` and ``sin`` are those of the pitch."""
    x, y = pad_place(pads, pad, state[3])
    return state[0] + cos * x - sin * y, state[1] + sin * x + cos * y


@stage(inline=False)
def links_in_ground(state, status, model, ground, toes, sides, places):
    """Count the sides of a robot's links that pass through the ground between their ends.

    Args:
        state: State of the robot relative to the crank axis, shape (8,).
        status: The robot's status.
        model: Tables of the robot, a :class:`jansen_env.engine.records.Model`.
        ground: The ground, a :class:`jansen_env.engine.records.Ground`.
        toes: Number of toes.
        sides: Pads at the ends of each side, shape (sides, 2). Sides with a toe come first, and the
            toe is their first pad.
        places: Work space for two values per pad.
    """
    if status.end_near - status.first_near <= 2:
        return 0  # The ground has no inner vertices.
    count, layout, pads = len(sides), model.layout, model.pads
    cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
    near = len(layout) if _others_near(state, status, ground) else toes
    while near == toes and count > 0 and sides[count - 1, 0] >= toes:
        count -= 1  # Sides without a toe are above all of the ground.
    for j in range(near):
        places[2 * j], places[2 * j + 1] = _centre(state, cos, sin, pads, layout[j])
    for k in range(count):
        j = sides[k, 1]
        if j >= near:
            places[2 * j], places[2 * j + 1] = _centre(state, cos, sin, pads, layout[j])
    surface = ground.surface
    return _count_sides(places, count, sides, surface, status.first_near, status.end_near)


@kernel
def sides_in_ground(places: Floats1, sides: Ints2, surface: Floats2) -> int:
    """Count the sides of links that pass through the ground between their ends.

    Args:
        places: Centres of the pads, x and y alternating, in m, shape (2 pads,).
        sides: Pads at the ends of each side, shape (sides, 2).
        surface: Vertices of the ground, in m, shape (vertices, 2).
    """
    return _count_sides(places, len(sides), sides, surface, 0, len(surface))


@stage(inline=False)
def _count_sides(places, first, sides, surface, begin, end):
    """Count the sides, among the first ``first``, that pass below a vertex of the ground.

    The ground is ``surface[begin:end]``.
    """
    count = 0
    for k in range(first):
        a, b = 2 * sides[k, 0], 2 * sides[k, 1]
        if places[b] < places[a]:
            a, b = b, a
        ax, ay = places[a], places[a + 1]
        ex, ey = places[b] - ax, places[b + 1] - ay
        vertex = segment_at(surface, begin, end, ax) + 1
        below = False
        while not below and vertex < end - 1 and surface[vertex, 0] - ax < ex:
            x, y = surface[vertex, 0] - ax, surface[vertex, 1] - ay
            below = x > 0.0 and ex * y > ey * x
            vertex += 1
        count += below
    return count


@kernel
def planes_near(
    r: int, centres: Floats2, robots: Robots, surface: Floats2, world: World, planes: Planes
) -> None:
    """Find the contact planes near given points, as if the points were the pads of robot ``r``.

    Args:
        r: Index of the robot.
        centres: The points, in m, shape (pads, 2).
        robots: Records of the robots.
        surface: Vertices of all height lines, in m, shape (vertices, 2).
        world: Data that the robots have in common.
        planes: Output, contact planes.
    """
    find_planes(centres, robots[r].status, surface, world[0], planes)


@stage(inline=False)
def find_planes(centres, status, surface, world, planes):
    """Find the contact planes near given points, see :func:`planes_near`."""
    begin_planes(status)
    for j in range(len(centres)):
        list_planes(centres[j, 0], centres[j, 1], j, status, surface, world, planes)
    sort_planes(status.first_plane, status.end_plane, planes)


@stage
def begin_planes(status):
    """Remove all contact planes of a robot."""
    status.end_plane = status.first_plane
    status.too_deep = False


@stage(inline=False)
def list_planes(x, y, pad, status, surface, world, planes):
    """List the contact planes of a pad at (x, y)."""
    start, end = status.first_near, status.end_near
    near = status.pad_radius + status.margin
    no_plane = True
    first, last = (
        segment_at(surface, start, end, x - near),
        segment_at(surface, start, end, x + near),
    )
    begin, nearest, least = status.end_plane, first, -np.inf
    for k in range(first, last + 1):
        faces, nx, ny, offset = _plane(surface, start, end, k, x, y, near)
        if faces:
            no_plane = False
            distance = nx * x + ny * y - offset
            if least < distance < 0.0:
                nearest, least = k, distance
            _list(pad, -1, 0.0, 0.0, status, nx, ny, offset, distance, world.capacity, planes)
    if least > -np.inf:
        status.end_plane = begin
        _list_near_side(x, y, pad, first, last, nearest, near, status, surface, world, planes)
    if not (no_plane and y < height_at(surface, start, end, x)):
        return
    is_out, nx, ny, offset = _way_out(surface, start, end, x, y, status.pad_radius + WAY_OUT)
    if is_out:
        distance = nx * x + ny * y - offset
        _list(pad, -1, 0.0, 0.0, status, nx, ny, offset, distance, world.capacity, planes)
    else:
        status.too_deep = True


@stage(inline=False)
def _list_near_side(x, y, pad, first, last, nearest, near, status, surface, world, planes):
    """List the contact planes of a pad in the ground, except those on the far side of a ridge.

    The pad is at (x, y). Of the segments ``first`` to ``last``, the pad is least deep below the
    segment ``nearest``.
    """
    start, end = status.first_near, status.end_near
    for k in range(first, last + 1):
        faces, nx, ny, offset = _plane(surface, start, end, k, x, y, near)
        distance = nx * x + ny * y - offset
        a, b = min(k, nearest), max(k, nearest)
        ax, ay = surface[a + 1, 0] - surface[a, 0], surface[a + 1, 1] - surface[a, 1]
        bx, by = surface[b + 1, 0] - surface[b, 0], surface[b + 1, 1] - surface[b, 1]
        beyond = distance < 0.0 and ax * by - ay * bx < 0.0
        if faces and not beyond:
            _list(pad, -1, 0.0, 0.0, status, nx, ny, offset, distance, world.capacity, planes)


@stage(inline=False)
def _way_out(surface, start, end, x, y, reach):
    """Find the nearest plane through which a point in the ground can leave it.

    Returns:
        Whether there is such a plane within ``reach``, its normal (x, y), and its offset in m.
    """
    highest, best_x, best_y, best_offset = -reach, 0.0, 0.0, 0.0
    first, last = (
        segment_at(surface, start, end, x - reach),
        segment_at(surface, start, end, x + reach),
    )
    for k in range(first, last + 1):
        faces, nx, ny, offset = _plane(surface, start, end, k, x, y, reach)
        distance = nx * x + ny * y - offset
        if faces and highest < distance < 0.0:
            highest, best_x, best_y, best_offset = distance, nx, ny, offset
    return highest > -reach, best_x, best_y, best_offset


@stage(inline=False)
def _plane(surface, start, end, k, x, y, near):
    """Compute the plane with which segment ``k`` of ``surface[start:end]`` faces a point (x, y).

    Returns:
        Whether the plane counts, its normal (x, y), and its offset in m. The plane counts if it is
        nearer than ``near`` and does not belong to a neighbouring segment.
    """
    ax, ay = surface[k, 0], surface[k, 1]
    ex, ey = surface[k + 1, 0] - ax, surface[k + 1, 1] - ay
    length = mathematics.hypot(ex, ey)
    fraction = (ex * (x - ax) + ey * (y - ay)) / (ex * ex + ey * ey)
    # The first and the last segment continue beyond the ends of the ground.
    if k > start:
        fraction = max(0.0, fraction)
    if k < end - 2:
        fraction = min(fraction, 1.0)
    px, py = ax + ex * fraction, ay + ey * fraction
    if fraction == 1.0:
        px, py = surface[k + 1, 0], surface[k + 1, 1]
    away_x, away_y = px - x, py - y
    square = away_x * away_x + away_y * away_y
    if not square < near * near:
        return False, 0.0, 0.0, 0.0
    nx, ny = -ey / length, ex / length
    offset = nx * ax + ny * ay
    sunk = nx * (x - ax) + ny * (y - ay) < 0.0
    if (fraction == 0.0 or fraction == 1.0) and square > 0.0:  # The nearest point is a vertex.
        other = k - 1 if fraction == 0.0 else k + 2
        if start <= other < end:  # The vertex belongs to the neighbour if the point is beside it.
            side = away_x * (surface[other, 0] - px) + away_y * (surface[other, 1] - py)
            if side < 0.0:
                return False, 0.0, 0.0, 0.0
        inverse = 1.0 / np.sqrt(square)
        vertex_x, vertex_y = -away_x * inverse, -away_y * inverse
        sunk = vertex_y < 0.0
        # Straight above a face, keep the face's own normal: the direction from the vertex to the
        # point is subject to rounding.
        if abs(vertex_x * ex + vertex_y * ey) >= FACE * length:
            nx, ny = (-vertex_x, -vertex_y) if sunk else (vertex_x, vertex_y)
            offset = nx * px + ny * py
    # A point that is behind the segment but above the ground is on the other side of a ridge.
    faces = not (sunk and y > height_at(surface, start, end, x))
    return faces, nx, ny, offset


@stage(inline=False)
def _list(pad, far_pad, vertex_x, vertex_y, status, nx, ny, offset, distance, capacity, planes):
    """Add a plane to the planes of a robot.

    The plane is not added if it is listed already. If ``capacity`` planes are listed, it replaces
    the farthest one, or is not added if it is the farthest itself.
    """
    begin, end = status.first_plane, status.end_plane
    for k in range(begin, end):
        other = planes[k]
        if other.pad == pad and other.far_pad == far_pad:
            apart = abs(other.vertex_x - vertex_x) + abs(other.vertex_y - vertex_y)
            apart += abs(other.normal_x - nx) + abs(other.normal_y - ny)
            apart += abs(other.offset - offset)
            if apart < SAME:
                return  # The segments on both sides of a vertex find the same plane.
    place = end
    if end - begin == capacity:
        place = begin
        for k in range(begin, end):
            if planes[k].distance > planes[place].distance:
                place = k
        if distance >= planes[place].distance:
            return
    else:
        status.end_plane += 1
    plane = planes[place]
    plane.normal_x, plane.normal_y, plane.offset, plane.distance = nx, ny, offset, distance
    plane.pad, plane.far_pad, plane.mode = pad, far_pad, STICK
    plane.vertex_x, plane.vertex_y = vertex_x, vertex_y


@stage(inline=False)
def sort_planes(begin, end, planes):
    """Sort planes by pad and then by distance, using insertion sort."""
    for i in range(begin + 1, end):
        k = i
        while k > begin and _comes_before(planes[k], planes[k - 1]):
            _swap(planes[k], planes[k - 1])
            k -= 1


@stage
def _comes_before(a, b):
    """Return whether plane ``a`` comes before plane ``b``."""
    return a.pad < b.pad or (a.pad == b.pad and a.distance < b.distance)


@stage
def _swap(a, b):
    """Exchange the values of two planes."""
    a.normal_x, b.normal_x = b.normal_x, a.normal_x
    a.normal_y, b.normal_y = b.normal_y, a.normal_y
    a.offset, b.offset = b.offset, a.offset
    a.distance, b.distance = b.distance, a.distance
    a.pad, b.pad = b.pad, a.pad
    a.mode, b.mode = b.mode, a.mode
    a.far_pad, b.far_pad = b.far_pad, a.far_pad
    a.vertex_x, b.vertex_x = b.vertex_x, a.vertex_x
    a.vertex_y, b.vertex_y = b.vertex_y, a.vertex_y
