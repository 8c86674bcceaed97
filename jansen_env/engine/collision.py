"""Collision detection: from each pad's candidate segments to its contact planes, without pymunk.

The broad phase is pymunk's (``plants/detector.py``): it says which segments of its terrain may be
near a pad, for as long as the pad stays within a skin of where it was then. A pad's planes are
those of these candidates within its robot's speculative margin.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine.contact_solver import STICK
from jansen_env.engine.jit import compiled, macro, stage
from jansen_env.engine.records import PAD, PLANE, QUERY, ROBOT, Terrains
from jansen_env.engine.tables import locate, pad_place

SPECULATIVE_MARGIN = 0.05  # m within which a plane counts, or as far as a pad gets in a time step
SKIN = 0.3  # m that a pad may move before the next broad phase, with a margin of the above
LARGEST_MARGIN = SPECULATIVE_MARGIN + 0.5 * SKIN  # m: pads that moved by half a SKIN are not moved
FACE = 1e-6  # rad, how far a contact's normal may be off a segment's to be taken as the face's
SAME = 1e-9  # difference of two planes' numbers below which they are one
PARK = 1e7  # m, where pads wait that are not in use, and how far apart


@compiled(nogil=True)
def detect(
    moving_only, states, pads, layout, depths, time_step, toes, surface, radius, reach, capacity,
    robots, queries, planes,
):  # fmt: skip
    """Find the planes near the pads, unless the broad phase must be asked before.

    Args:
        moving_only: whether only for the robots that have steps left.
        states: (robots, 8). pads: of a :class:`jansen_env.engine.records.Model`.
        depths: m, how far below the crank axis a pad that is no toe can feel the ground, at pitches
            evenly spread over one turn; and last, how far it can in any direction.
        time_step: s. toes: the first so many pads are toes.
        surface, radius, reach, capacity: of :class:`jansen_env.engine.records.Terrains`.
        layout: (pads,) PAD, robots: (robots,) ROBOT, queries: (rows,) QUERY and planes: (robots *
            capacity,) PLANE, as their bytes.

    Returns:
        (rows needed; whether the broad phase must be asked; whether a pad is too deep)
    """
    layout, robots = layout.view(PAD), robots.view(ROBOT)
    queries, planes = queries.view(QUERY), planes.view(PLANE)
    _set_margins(states, robots, time_step)
    rows = _list_queries(states, robots, len(layout), toes, depths, surface, queries)
    if rows > len(queries):
        return rows, False, False
    stale = _place(rows, states, robots, pads, layout, moving_only, queries)
    if stale:
        return rows, True, False
    too_deep = find_planes(
        rows, robots, moving_only, surface, radius, reach, capacity, queries, planes
    )
    return rows, False, too_deep


@macro
def _set_margins(states, robots, time_step):
    """Let each robot's speculative margin be as far as its fastest pad gets in a time step."""
    for r in range(len(states)):
        params = robots[r].params
        speed = abs(states[r, 4]) + abs(states[r, 5])  # no pad is faster
        speed += params.pitch_arm * abs(states[r, 6])
        speed += params.crank_arm * abs(states[r, 7])
        robots[r].status.margin = min(max(SPECULATIVE_MARGIN, speed * time_step), LARGEST_MARGIN)


@macro
def _list_queries(states, robots, pads, toes, depths, surface, queries):
    """List the pads to ask about: all toes, and what else has come near the ground.

    Returns:
        Rows needed; those beyond the length of ``queries`` are only counted.
    """
    rows = len(robots) * toes
    pitches, farthest = len(depths) - 1, depths[-1]
    for r in range(len(robots)):
        x, y, status = states[r, 0], states[r, 1], robots[r].status
        extra = status.margin - SPECULATIVE_MARGIN
        depth = depths[locate(pitches, states[r, 2])[0]] + extra
        left, right = x - farthest - extra, x + farthest + extra
        if not _rises_above(surface, status, left, right, y - depth):
            continue
        for j in range(toes, pads):
            if rows < len(queries):
                query = queries[rows]
                if query.robot != r or query.pad != j:
                    query.known_x = np.inf
                query.robot, query.pad = r, j
            rows += 1
    return rows


@macro
def _place(rows, states, robots, pads, layout, moving_only, queries):
    """Place the first rows' pads; whether one of them has left its skin."""
    stale = False
    last = -1
    cos, sin = 1.0, 0.0
    for i in range(rows):
        query = queries[i]
        r, pad, status = query.robot, layout[query.pad], robots[query.robot].status
        if moving_only and not status.steps_left > 0:
            continue
        if r != last:
            last = r
            cos, sin = np.cos(states[r, 2]), np.sin(states[r, 2])
        px, py = pad_place(pads, pad.table, states[r, 3] + pad.phase)
        query.x = states[r, 0] + cos * px - sin * py
        query.y = states[r, 1] + sin * px + cos * py
        moved_x, moved_y = query.x - query.known_x, query.y - query.known_y
        skin = SKIN - (status.margin - SPECULATIVE_MARGIN)
        if not moved_x * moved_x + moved_y * moved_y <= skin * skin:
            stale = True
    return stale


@macro
def _rises_above(surface, status, left, right, height):
    """Whether a robot's terrain rises above a height between two x."""
    begin, end = status.first_vertex, status.end_vertex
    first, last = _segment(surface, begin, end, left), _segment(surface, begin, end, right)
    above = _height(surface, first, left) > height or _height(surface, last, right) > height
    for k in range(first + 1, last + 1):
        above = above or surface[k, 1] > height
    return above


@stage
def _segment(surface, begin, end, x):
    """Index of the segment of the terrain surface[begin:end] above or below ``x``."""
    low, high = begin, end - 1
    while high - low > 1:
        middle = (low + high) // 2
        if surface[middle, 0] <= x:
            low = middle
        else:
            high = middle
    return low


@macro
def _height(surface, k, x):
    """Height of segment ``k`` at ``x``."""
    slope = (surface[k + 1, 1] - surface[k, 1]) / (surface[k + 1, 0] - surface[k, 0])
    return surface[k, 1] + slope * (x - surface[k, 0])


@stage(inline=False)
def height_at(surface, begin, end, x):
    """Height of the terrain surface[begin:end] at ``x``, m; it goes on beyond its ends."""
    return _height(surface, _segment(surface, begin, end, x), x)


@compiled
def move_pads(rows, robots, queries, placed):
    """Move pymunk's pads to the queries; those that are near enough stay, which spares its tree.

    Args:
        rows: in use; the pads beyond are parked.
        placed: (bodies, 2) m, out: where the pads are in pymunk's space.
    """
    for i in range(len(queries)):
        query = queries[i]
        if i >= rows:
            query.known_x = query.known_y = np.inf
            placed[i, 0] = placed[i, 1] = PARK * (i + 1)
            continue
        x, y = query.x - query.known_x, query.y - query.known_y
        if not x * x + y * y <= 0.25 * SKIN * SKIN:
            query.known_x, query.known_y = query.x, query.y
            status = robots[query.robot].status
            placed[i, 0], placed[i, 1] = query.x + status.cell_x, query.y + status.cell_y


@compiled
def keep_candidates(ids, points, known_ids, row_of, robots, surface, reach, queries):
    """The candidates of each query, from what pymunk's circles touch.

    pymunk leaves out segments that only their ends bring near; as far as the circle goes in x,
    neighbours are candidates, too. So is what goes on beyond the ends of the terrain, where pymunk
    has nothing.

    Args:
        ids: (n,) pymunk's bodies. points: (2 n,) m, where each touches.
        known_ids: (rows,) bodies, sorted. row_of: (rows,) the query of each.
        robots, surface, reach, queries: see :func:`detect`.
    """
    for i in range(len(queries)):
        query = queries[i]
        query.first_segment, query.last_segment = 0, -1
        status = robots[query.robot].status
        start, end = status.first_vertex, status.end_vertex
        if query.known_x - reach < surface[start, 0]:
            query.first_segment = query.last_segment = start
        elif query.known_x + reach > surface[end - 1, 0]:
            query.first_segment = query.last_segment = end - 2
    for n in range(len(ids)):
        query = queries[row_of[_find(known_ids, ids[n])]]
        status = robots[query.robot].status
        start, end = status.first_vertex, status.end_vertex
        first = last = _segment(surface, start, end, points[2 * n] - status.cell_x)
        while first > start and surface[first, 0] > query.known_x - reach:
            first -= 1
        while last < end - 2 and surface[last + 1, 0] < query.known_x + reach:
            last += 1
        if query.last_segment < 0:
            query.first_segment, query.last_segment = first, last
        query.first_segment = min(query.first_segment, first)
        query.last_segment = max(query.last_segment, last)


@macro
def _find(known, key):
    """Place of ``key`` in the sorted ``known``."""
    low, high = 0, len(known)
    while high - low > 1:
        middle = (low + high) // 2
        if known[middle] <= key:
            low = middle
        else:
            high = middle
    return low


@compiled
def find_planes(rows, robots, moving_only, surface, radius, reach, capacity, queries, planes):
    """The planes of the first rows' candidates within each robot's margin; whether one is too deep.

    For a pad that is farther than that in the ground, the plane by which it comes out soonest.
    """
    terrains = Terrains(surface, radius, reach, capacity)
    for r in range(len(robots)):
        status = robots[r].status
        if not moving_only or status.steps_left > 0:
            status.end_plane = status.first_plane
            status.too_deep = False
    any_too_deep = False
    for i in range(rows):
        status = robots[queries[i].robot].status
        if moving_only and not status.steps_left > 0:
            continue
        if not _find_planes_of(queries[i], status, terrains, planes):
            status.too_deep = True
            any_too_deep = True
    for r in range(len(robots)):
        status = robots[r].status
        if not moving_only or status.steps_left > 0:
            _sort(status.first_plane, status.end_plane, planes)
    return any_too_deep


@macro
def _find_planes_of(query, status, terrains, planes):
    """List one pad's planes; False where it is too deep in the ground for any."""
    surface, x, y = terrains.surface, query.x, query.y
    start, end = status.first_vertex, status.end_vertex
    near = terrains.radius + status.margin
    no_plane = True
    for k in range(query.first_segment, query.last_segment + 1):
        found, nx, ny, offset = _plane(surface, start, end, k, x, y, near)
        if found:
            no_plane = False
            _list(query, status, nx, ny, offset, terrains.capacity, planes)
    if not (no_plane and y < height_at(surface, start, end, x)):
        return True
    found, nx, ny, offset = _way_out(surface, start, end, x, y, terrains.reach)
    if found:
        _list(query, status, nx, ny, offset, terrains.capacity, planes)
    return found


@stage(inline=False)
def _way_out(surface, start, end, x, y, reach):
    """The nearest plane whose ground a point is in.

    Returns:
        (whether there is one within ``reach`` (m); normal x, y; offset)
    """
    highest, best_x, best_y, best_offset = -reach, 0.0, 0.0, 0.0
    first, last = _segment(surface, start, end, x - reach), _segment(surface, start, end, x + reach)
    for k in range(first, last + 1):
        found, nx, ny, offset = _plane(surface, start, end, k, x, y, reach)
        distance = nx * x + ny * y - offset
        if found and highest < distance < 0.0:
            highest, best_x, best_y, best_offset = distance, nx, ny, offset
    return highest > -reach, best_x, best_y, best_offset


@stage(inline=False)
def _plane(surface, start, end, k, x, y, near):
    """Plane by which segment ``k`` of surface[start:end] faces a point (x, y).

    Returns:
        (whether it is nearer than ``near`` and no neighbour's task; normal x, y; offset)
    """
    ax, ay = surface[k, 0], surface[k, 1]
    ex, ey = surface[k + 1, 0] - ax, surface[k + 1, 1] - ay
    length = np.hypot(ex, ey)
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
    found = not (sunk and y > height_at(surface, start, end, x))
    return found, nx, ny, offset


@stage(inline=False)
def _list(query, status, nx, ny, offset, capacity, planes):
    """Add a plane to a robot's, unless it is there, or there are ``capacity`` nearer ones."""
    distance = nx * query.x + ny * query.y - offset
    begin, end = status.first_plane, status.end_plane
    for k in range(begin, end):
        other = planes[k]
        if other.pad == query.pad:
            apart = abs(other.normal_x - nx) + abs(other.normal_y - ny) + abs(other.offset - offset)
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
    plane.pad, plane.mode = query.pad, STICK


@stage(inline=False)
def _sort(begin, end, planes):
    """Insertion sort by pad, then distance."""
    for i in range(begin + 1, end):
        k = i
        while k > begin and _comes_before(planes[k], planes[k - 1]):
            _swap(planes[k], planes[k - 1])
            k -= 1


@macro
def _comes_before(a, b):
    return a.pad < b.pad or (a.pad == b.pad and a.distance < b.distance)


@macro
def _swap(a, b):
    a.normal_x, b.normal_x = b.normal_x, a.normal_x
    a.normal_y, b.normal_y = b.normal_y, a.normal_y
    a.offset, b.offset = b.offset, a.offset
    a.distance, b.distance = b.distance, a.distance
    a.pad, b.pad = b.pad, a.pad
    a.mode, b.mode = b.mode, a.mode
