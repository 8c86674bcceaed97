"""Collision detection: a robot's contact planes on the stretch of a height line that it can reach.

See ``plants/grounds.py``. A pad's planes are those within its robot's speculative margin; a pad
farther than that in the ground has the plane by which it comes out soonest. On a ground that is
not a height line, pymunk lists the planes instead, see ``plants/shape_planes.py``.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.contact_solver import STICK
from jansen_env.engine.kernel import Floats1, Floats2, Floats4, Ints2, kernel, stage
from jansen_env.engine.records import Layout, Planes, Robots, World
from jansen_env.engine.tables import locate, pad_place

SPECULATIVE_MARGIN = 0.05  # m within which a plane counts, or as far as a pad gets in a time step
LARGEST_MARGIN = 0.2  # m, of the fastest robots
MARGIN = 1.0  # m that a robot moves before its stretch is asked for again
WAY_OUT = 0.35  # m within which a pad that is deep in the ground is looked for a way out
LEAN = 0.1  # sine by which a side of a link may enter the ground beside a vertex that carries it
FACE = 1e-6  # rad, how far a contact's normal may be off a segment's to be taken as the face's
SAME = 1e-9  # difference of two planes' numbers below which they are one


@stage(inline=False)
def detect(state, robot, model, ground, world, sides, planes):
    """Find the planes near a robot's pads and sides; False where it has left its stretch of ground.

    Sets the robot's ``margin``, its ``planes`` and ``too_deep``; arguments: see ``records.py``.
    """
    status = robot.status
    set_margin(state, robot, world.time_step)
    if not abs(state[0] - status.asked_x) <= status.room:
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
    """List the vertices that links' ``sides`` may touch, as planes of their second ends.

    Where one end of a side is below ``near``, of the pads that may be near the ground.
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
            if distance < 0.0:  # in the ground, or beyond a ridge
                foot_x, foot_y = x + distance * nx, y + distance * ny
                carries = carries and foot_y < height_at(surface, start, end, foot_x)
            if carries and distance < reach:
                _list(a, b, x, y, status, nx, ny, 0.0, distance, world.capacity, planes)
            vertex += 1


@stage(inline=False)
def _side_normal(surface, k, x, y, ex, ey):
    """Return whether vertex ``k`` can carry a side, and the side's normal, out of the ground.

    Only the vertex of a ridge can: in a valley the ground's own faces are in the way.

    ``x, y``: m, of the vertex from the side's first end; ``ex, ey``: of its second end.
    """
    square = ex * ex + ey * ey
    share, length = (ex * x + ey * y) / square, np.sqrt(square)
    nx, ny = -ey / length, ex / length
    px, py = surface[k - 1, 0] - surface[k, 0], surface[k - 1, 1] - surface[k, 1]
    qx, qy = surface[k + 1, 0] - surface[k, 0], surface[k + 1, 1] - surface[k, 1]
    before = (nx * px + ny * py) / mathematics.hypot(px, py)
    after = (nx * qx + ny * qy) / mathematics.hypot(qx, qy)
    if before + after > 0.0:
        nx, ny, before, after = -nx, -ny, -before, -after
    ridge = px * qy - py * qx >= 0.0
    return ridge and 0.0 < share < 1.0 and max(before, after) < LEAN, nx, ny


@stage
def set_margin(state, robot, time_step):
    """Set a robot's speculative margin to the way of its fastest pad in a time step."""
    speed = abs(state[4]) + abs(state[5])  # no pad is faster
    speed += robot.params.pitch_arm * abs(state[6]) + robot.params.crank_arm * abs(state[7])
    robot.status.margin = min(max(SPECULATIVE_MARGIN, speed * time_step), LARGEST_MARGIN)


@stage
def _others_near(state, status, ground):
    """Whether a pad that is no toe may be near the ground."""
    depths = ground.depths
    pitches, farthest = len(depths) - 1, depths[-1]
    extra = status.pad_radius + status.margin - SPECULATIVE_MARGIN
    depth = depths[locate(pitches, state[2])[0]] + extra
    left, right = state[0] - farthest - extra, state[0] + farthest + extra
    return _rises_above(ground.surface, status, left, right, state[1] - depth)


@stage
def _rises_above(surface, status, left, right, height):
    """Whether a robot's ground rises above a height between two x."""
    begin, end = status.first_near, status.end_near
    first, last = segment_at(surface, begin, end, left), segment_at(surface, begin, end, right)
    above = _height(surface, first, left) > height or _height(surface, last, right) > height
    for k in range(first + 1, last + 1):
        above = above or surface[k, 1] > height
    return above


@stage
def segment_at(surface, begin, end, x):
    """Index of the segment of the ground surface[begin:end] above or below ``x``."""
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
    """Height of segment ``k`` at ``x``."""
    slope = (surface[k + 1, 1] - surface[k, 1]) / (surface[k + 1, 0] - surface[k, 0])
    return surface[k, 1] + slope * (x - surface[k, 0])


@stage(inline=False)
def height_at(surface, begin, end, x):
    """Height of the ground surface[begin:end] at ``x``, m; it goes on beyond its ends."""
    return _height(surface, segment_at(surface, begin, end, x), x)


@kernel
def pad_centres(state: Floats1, pads: Floats4, layout: Layout, out: Floats2) -> None:
    """Centres (pads, 2) of a robot's pads, m, into ``out``; arguments: as of a Model."""
    find_centres(state, pads, layout, out)


@stage(inline=False)
def find_centres(state, pads, layout, out):
    """:func:`pad_centres`, within kernels."""
    cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
    for j in range(len(layout)):
        out[j, 0], out[j, 1] = _centre(state, cos, sin, pads, layout[j])


@stage
def _centre(state, cos, sin, pads, pad):
    """(x, y) of a pad's centre, m; ``cos``, ``sin``: of the pitch."""
    x, y = pad_place(pads, pad, state[3])
    return state[0] + cos * x - sin * y, state[1] + sin * x + cos * y


@stage(inline=False)
def links_in_ground(state, status, model, ground, toes, sides, places):
    """How many of a robot's ``sides``, pairs (n, 2) of pads, are in the ground between their ends.

    Those with a toe come first, toe first. ``places`` is work space for two numbers a pad.
    """
    if status.end_near - status.first_near <= 2:
        return 0  # no vertices
    count, layout, pads = len(sides), model.layout, model.pads
    cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
    near = len(layout) if _others_near(state, status, ground) else toes
    while near == toes and count > 0 and sides[count - 1, 0] >= toes:
        count -= 1  # all ground is below the other sides
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
    """:func:`links_in_ground` of pads at places (2 pads,), x and y in turn, m, on one ground."""
    return _count_sides(places, len(sides), sides, surface, 0, len(surface))


@stage(inline=False)
def _count_sides(places, first, sides, surface, begin, end):
    """How many of the ``first`` sides pass below a vertex of the ground surface[begin:end]."""
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
    """Find the planes near points (pads, 2), m, that are taken for the pads of robot ``r``."""
    find_planes(centres, robots[r].status, surface, world[0], planes)


@stage(inline=False)
def find_planes(centres, status, surface, world, planes):
    """:func:`planes_near`, within kernels."""
    begin_planes(status)
    for j in range(len(centres)):
        list_planes(centres[j, 0], centres[j, 1], j, status, surface, world, planes)
    sort_planes(status.first_plane, status.end_plane, planes)


@stage
def begin_planes(status):
    """Forget a robot's planes."""
    status.end_plane = status.first_plane
    status.too_deep = False


@stage(inline=False)
def list_planes(x, y, pad, status, surface, world, planes):
    """List the planes of a pad at (x, y)."""
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
    """List the planes of a pad at (x, y), in the ground, but those on the far side of a ridge.

    Of the segments ``first`` to ``last`` it is the least deep behind ``nearest``.
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
    """The nearest plane whose ground a point is in: (whether within ``reach``, normal, offset)."""
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
    """Plane by which segment ``k`` of surface[start:end] faces a point (x, y).

    Returns (whether it is nearer than ``near`` and no neighbour's task; normal x, y; offset).
    """
    ax, ay = surface[k, 0], surface[k, 1]
    ex, ey = surface[k + 1, 0] - ax, surface[k + 1, 1] - ay
    length = mathematics.hypot(ex, ey)
    share = (ex * (x - ax) + ey * (y - ay)) / (ex * ex + ey * ey)
    if k > start:  # beyond its ends the ground goes on
        share = max(0.0, share)
    if k < end - 2:
        share = min(share, 1.0)
    px, py = ax + ex * share, ay + ey * share
    if share == 1.0:
        px, py = surface[k + 1, 0], surface[k + 1, 1]
    away_x, away_y = px - x, py - y
    square = away_x * away_x + away_y * away_y
    if not square < near * near:
        return False, 0.0, 0.0, 0.0
    nx, ny = -ey / length, ex / length
    offset = nx * ax + ny * ay
    sunk = nx * (x - ax) + ny * (y - ay) < 0.0
    if (share == 0.0 or share == 1.0) and square > 0.0:  # a vertex
        other = k - 1 if share == 0.0 else k + 2
        if start <= other < end:  # the neighbour's, if the point is on its side
            side = away_x * (surface[other, 0] - px) + away_y * (surface[other, 1] - py)
            if side < 0.0:
                return False, 0.0, 0.0, 0.0
        inverse = 1.0 / np.sqrt(square)
        vertex_x, vertex_y = -away_x * inverse, -away_y * inverse
        sunk = vertex_y < 0.0
        # On a face, take the face's own normal: the direction to a point is rounded.
        if abs(vertex_x * ex + vertex_y * ey) >= FACE * length:
            nx, ny = (-vertex_x, -vertex_y) if sunk else (vertex_x, vertex_y)
            offset = nx * px + ny * py
    # Behind that segment, yet above the ground: it sees the far side of a ridge.
    faces = not (sunk and y > height_at(surface, start, end, x))
    return faces, nx, ny, offset


@stage(inline=False)
def _list(pad, far_pad, vertex_x, vertex_y, status, nx, ny, offset, distance, capacity, planes):
    """Add a plane to a robot's, unless it is there, or there are ``capacity`` nearer ones."""
    begin, end = status.first_plane, status.end_plane
    for k in range(begin, end):
        other = planes[k]
        if other.pad == pad and other.far_pad == far_pad:
            apart = abs(other.vertex_x - vertex_x) + abs(other.vertex_y - vertex_y)
            apart += abs(other.normal_x - nx) + abs(other.normal_y - ny)
            apart += abs(other.offset - offset)
            if apart < SAME:
                return  # a vertex is found from both its sides
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
    """Insertion sort by pad, then distance."""
    for i in range(begin + 1, end):
        k = i
        while k > begin and _comes_before(planes[k], planes[k - 1]):
            _swap(planes[k], planes[k - 1])
            k -= 1


@stage
def _comes_before(a, b):
    return a.pad < b.pad or (a.pad == b.pad and a.distance < b.distance)


@stage
def _swap(a, b):
    a.normal_x, b.normal_x = b.normal_x, a.normal_x
    a.normal_y, b.normal_y = b.normal_y, a.normal_y
    a.offset, b.offset = b.offset, a.offset
    a.distance, b.distance = b.distance, a.distance
    a.pad, b.pad = b.pad, a.pad
    a.mode, b.mode = b.mode, a.mode
    a.far_pad, b.far_pad = b.far_pad, a.far_pad
    a.vertex_x, b.vertex_x = b.vertex_x, a.vertex_x
    a.vertex_y, b.vertex_y = b.vertex_y, a.vertex_y
