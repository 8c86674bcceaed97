"""Contact planes near pads, worked out from the ground's segments: compiled geometry, no pymunk.

Which segments may be near a pad is remembered from pymunk's answer (``contact.py``); a pad's planes
are those of its segments within its robot's margin.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine.contact_solver import STICK
from jansen_env.engine.jit import compiled
from jansen_env.engine.tables import LONGEST, PHASE, TABLE, WIDEST, locate, pad_place

MARGIN = 0.05  # m from a pad within which a plane counts, or as far as it gets in a time step
STRIDE = 0.3  # m that a pad may move before pymunk is asked again, with a margin of MARGIN
WIDEST_MARGIN = MARGIN + 0.5 * STRIDE  # m: pads that moved by half a STRIDE are not asked about
FACE = 1e-6  # rad, how far a contact's normal may be off a segment's to be taken as the face's
SAME = 1e-9  # difference of two planes' numbers below which they are one
PARK = 1e7  # m, where pads wait that are not looked at, and how far apart

# Columns of a contact: its pad, and the last step's contact mode, a first guess.
PAD, MODE = range(2)
# Columns of a row's owner.
ROBOT, ITS_PAD = range(2)
# Columns of a robot's status: time steps to go until all robots' planes are found again (-1: it has
# diverged), m from its pads within which planes are listed, and whether (1 or 0) a pad is so deep
# in the ground that there are none.
STEPS_LEFT, SPECULATIVE_MARGIN, TOO_DEEP = range(3)


@compiled
def look(
    states, parameters, pads, layout, depths, time_step, moving_only, toes, surface, bounds, ground,
    radius, far, most, stretch, owner, centres, asked_at, status, spans, planes, contacts, gaps,
):  # fmt: skip
    """:func:`_place`, and unless pymunk must be asked before, :func:`find_planes`, in one call.

    Returns:
        (rows needed, whether pymunk must be asked, whether a pad is too deep)
    """
    rows, stale = _place(
        states, parameters, pads, layout, depths, time_step, moving_only, toes, surface, bounds,
        ground, status, owner, centres, asked_at,
    )  # fmt: skip
    if stale or rows > len(owner):
        return rows, stale, False
    too_deep = find_planes(
        rows, moving_only, surface, bounds, ground, radius, far, most, stretch, owner, centres,
        status, spans, planes, contacts, gaps,
    )  # fmt: skip
    return rows, stale, too_deep


@compiled
def _place(
    states, parameters, pads, layout, depths, time_step, moving_only, toes, surface, bounds, ground,
    status, owner, centres, asked_at,
):  # fmt: skip
    """Choose which pads to look at, where they are, and how wide each robot's margin is.

    Returns:
        (rows needed, nothing is placed where they are more than there are; whether one of them is
        too far from where pymunk was asked about it)
    """
    robots, bumpers = len(states), len(layout) - toes
    rows = robots * toes
    pitches, reach = len(depths) - 1, depths[-1]
    stale = False
    for r in range(robots):
        x, y = states[r, 0], states[r, 1]
        begin, end = bounds[ground[r]], bounds[ground[r] + 1]
        speed = abs(states[r, 4]) + abs(states[r, 5])  # no pad is faster
        speed += parameters[r, LONGEST] * abs(states[r, 6])
        speed += parameters[r, WIDEST] * abs(states[r, 7])
        status[r, SPECULATIVE_MARGIN] = min(max(MARGIN, speed * time_step), WIDEST_MARGIN)
        extra = status[r, SPECULATIVE_MARGIN] - MARGIN
        depth = depths[locate(pitches, states[r, 2])[0]] + extra
        if _reaches(surface, begin, end, x - reach - extra, x + reach + extra, y - depth):
            for j in range(bumpers):
                if rows < len(owner):
                    if owner[rows, ROBOT] != r or owner[rows, ITS_PAD] != toes + j:
                        asked_at[rows, 0] = np.inf
                    owner[rows, ROBOT], owner[rows, ITS_PAD] = r, toes + j
                rows += 1
    if rows > len(owner):
        return rows, stale
    last = -1
    cos, sin = 1.0, 0.0
    for i in range(rows):
        r, j = owner[i, ROBOT], owner[i, ITS_PAD]
        if moving_only and not status[r, STEPS_LEFT] > 0.0:
            continue
        if r != last:
            last = r
            cos, sin = np.cos(states[r, 2]), np.sin(states[r, 2])
        px, py = pad_place(pads, int(layout[j, TABLE]), states[r, 3] + layout[j, PHASE])
        x = states[r, 0] + cos * px - sin * py
        y = states[r, 1] + sin * px + cos * py
        centres[i, 0], centres[i, 1] = x, y
        moved_x, moved_y = x - asked_at[i, 0], y - asked_at[i, 1]
        skin = STRIDE - (status[r, SPECULATIVE_MARGIN] - MARGIN)
        if not moved_x * moved_x + moved_y * moved_y <= skin * skin:
            stale = True
    return rows, stale


@compiled(forceinline=True)
def _reaches(surface, begin, end, left, right, height):
    """Whether the ground surface[begin:end] rises above a height between two x."""
    first, last = _segment(surface, begin, end, left), _segment(surface, begin, end, right)
    above = _height(surface, first, left) > height or _height(surface, last, right) > height
    for k in range(first + 1, last + 1):
        above = above or surface[k, 1] > height
    return above


@compiled(forceinline=True)
def _segment(surface, begin, end, x):
    """Index of the segment of the ground surface[begin:end] above or below ``x``."""
    low, high = begin, end - 1
    while high - low > 1:
        middle = (low + high) // 2
        if surface[middle, 0] <= x:
            low = middle
        else:
            high = middle
    return low


@compiled(forceinline=True)
def _height(surface, k, x):
    """Height of segment ``k`` at ``x``."""
    slope = (surface[k + 1, 1] - surface[k, 1]) / (surface[k + 1, 0] - surface[k, 0])
    return surface[k, 1] + slope * (x - surface[k, 0])


@compiled(forceinline=True)
def height_at(surface, begin, end, x):
    """Height of the ground surface[begin:end] at ``x``, m; it goes on beyond its ends."""
    return _height(surface, _segment(surface, begin, end, x), x)


@compiled
def move_pads(rows, centres, owner, cells, asked_at, placed):
    """Move pymunk's pads to where they are; those that are near enough stay, which spares its tree.

    The pads beyond the first ``rows`` are parked.
    """
    for i in range(len(asked_at)):
        if i >= rows:
            asked_at[i, 0] = asked_at[i, 1] = np.inf
            placed[i, 0] = placed[i, 1] = PARK * (i + 1)
            continue
        x, y = centres[i, 0] - asked_at[i, 0], centres[i, 1] - asked_at[i, 1]
        if not x * x + y * y <= 0.25 * STRIDE * STRIDE:
            asked_at[i, 0], asked_at[i, 1] = centres[i, 0], centres[i, 1]
            r = owner[i, ROBOT]
            placed[i, 0], placed[i, 1] = centres[i, 0] + cells[r, 0], centres[i, 1] + cells[r, 1]


@compiled
def remember(
    ids, points, known, row_of, owner, asked_at, cells, surface, bounds, ground, far, stretch
):  # fmt: skip
    """From pymunk's contacts, (n,) body ids and 2 n numbers, the points: the stretch near each row.

    pymunk leaves out segments that only their ends bring near; as far as the circle goes in x,
    neighbours belong to the stretch, too. So does what goes on beyond the ends of the ground, where
    pymunk has nothing.
    """
    for i in range(len(stretch)):
        stretch[i, 0], stretch[i, 1] = 0, -1
        r = owner[i, ROBOT]
        start, end = bounds[ground[r]], bounds[ground[r] + 1]
        if asked_at[i, 0] - far < surface[start, 0]:
            stretch[i, 0], stretch[i, 1] = start, start
        elif asked_at[i, 0] + far > surface[end - 1, 0]:
            stretch[i, 0], stretch[i, 1] = end - 2, end - 2
    for n in range(len(ids)):
        i = row_of[_find(known, ids[n])]
        r = owner[i, ROBOT]
        start, end = bounds[ground[r]], bounds[ground[r] + 1]
        first = last = _segment(surface, start, end, points[2 * n] - cells[r, 0])
        while first > start and surface[first, 0] > asked_at[i, 0] - far:
            first -= 1
        while last < end - 2 and surface[last + 1, 0] < asked_at[i, 0] + far:
            last += 1
        if stretch[i, 1] < 0:
            stretch[i, 0], stretch[i, 1] = first, last
        stretch[i, 0], stretch[i, 1] = min(stretch[i, 0], first), max(stretch[i, 1], last)


@compiled(forceinline=True)
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
def find_planes(
    rows, moving_only, surface, bounds, ground, radius, far, most, stretch, owner, centres,
    status, spans, planes, contacts, gaps,
):  # fmt: skip
    """The planes of the stretches within each robot's margin of its pads; whether one is too deep.

    For a pad that is farther than that in the ground, the plane by which it comes out soonest.
    """
    for r in range(len(spans)):
        if not moving_only or status[r, STEPS_LEFT] > 0.0:
            spans[r, 1] = spans[r, 0]
            status[r, TOO_DEEP] = 0.0
    any_too_deep = False
    for i in range(rows):
        r, j = owner[i, ROBOT], owner[i, ITS_PAD]
        if moving_only and not status[r, STEPS_LEFT] > 0.0:
            continue
        start, end = bounds[ground[r]], bounds[ground[r] + 1]
        x, y = centres[i, 0], centres[i, 1]
        near = radius + status[r, SPECULATIVE_MARGIN]
        no_plane = True
        for k in range(stretch[i, 0], stretch[i, 1] + 1):
            found, nx, ny, offset = _plane(surface, start, end, k, x, y, near)
            if found:
                no_plane = False
                gap = nx * x + ny * y - offset
                _list(r, j, nx, ny, offset, gap, most, spans, planes, contacts, gaps)
        if no_plane and y < height_at(surface, start, end, x):
            found, nx, ny, offset = _way_out(surface, start, end, x, y, far)
            if found:
                gap = nx * x + ny * y - offset
                _list(r, j, nx, ny, offset, gap, most, spans, planes, contacts, gaps)
            else:
                status[r, TOO_DEEP] = 1.0
                any_too_deep = True
    for r in range(len(spans)):
        if not moving_only or status[r, STEPS_LEFT] > 0.0:
            _sort(spans[r, 0], spans[r, 1], planes, contacts, gaps)
    return any_too_deep


@compiled
def _way_out(surface, start, end, x, y, far):
    """The nearest plane whose ground a point is in.

    Returns:
        (whether there is one within ``far`` (m); normal x, y; offset)
    """
    highest, best_x, best_y, best_offset = -far, 0.0, 0.0, 0.0
    first, last = _segment(surface, start, end, x - far), _segment(surface, start, end, x + far)
    for k in range(first, last + 1):
        found, nx, ny, offset = _plane(surface, start, end, k, x, y, far)
        gap = nx * x + ny * y - offset
        if found and highest < gap < 0.0:
            highest, best_x, best_y, best_offset = gap, nx, ny, offset
    return highest > -far, best_x, best_y, best_offset


@compiled(forceinline=True)
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


@compiled(forceinline=True)
def _list(r, pad, nx, ny, offset, gap, most, spans, planes, contacts, gaps):
    """Add a plane to robot ``r``'s, unless it is there, or there are ``most`` nearer ones."""
    begin, end = spans[r, 0], spans[r, 1]
    for k in range(begin, end):
        if contacts[k, PAD] == pad:
            apart = abs(planes[k, 0] - nx) + abs(planes[k, 1] - ny) + abs(planes[k, 2] - offset)
            if apart < SAME:
                return  # a vertex is found from both its sides
    place = end
    if end - begin == most:
        place = begin
        for k in range(begin, end):
            if gaps[k] > gaps[place]:
                place = k
        if gap >= gaps[place]:
            return
    else:
        spans[r, 1] += 1
    contacts[place, PAD], contacts[place, MODE], gaps[place] = pad, STICK, gap
    planes[place, 0], planes[place, 1], planes[place, 2] = nx, ny, offset


@compiled
def _sort(begin, end, planes, contacts, gaps):
    """Insertion sort by pad, then gap."""
    for i in range(begin + 1, end):
        k = i
        while k > begin and (
            contacts[k, PAD] < contacts[k - 1, PAD]
            or (contacts[k, PAD] == contacts[k - 1, PAD] and gaps[k] < gaps[k - 1])
        ):
            contacts[k, PAD], contacts[k - 1, PAD] = contacts[k - 1, PAD], contacts[k, PAD]
            gaps[k], gaps[k - 1] = gaps[k - 1], gaps[k]
            for j in range(3):
                planes[k, j], planes[k - 1, j] = planes[k - 1, j], planes[k, j]
            k -= 1
