"""Placement of a robot on the ground: clearances of its pads, and the level pitch."""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.collision import (
    SPECULATIVE_MARGIN,
    find_centres,
    find_planes,
    height_at,
    segment_at,
)
from jansen_env.engine.kernel import Floats1, Floats2, Ints1, kernel, stage
from jansen_env.engine.records import Designs, Motions, Planes
from jansen_env.engine.tables import centre_of_mass, pad_place

GRADIENT_STEP = 1e-4  # m, distance to either side of a point at which a slope is measured
WIDEST_PITCH = 0.7  # rad, largest magnitude of the pitches that are tried
# Number of pitches that are tried between two limits, and number of times that these limits are
# narrowed down.
TRIES, LEVELS = 33, 4
ROUNDS = 3  # Newton steps of lowering a robot onto the ground
# Gap at which these steps have converged, in m. Near steep faces, and if pads other than toes are
# the lowest, they do not converge; then the height is corrected once more.
CLOSE = 1e-6
# Depth by which a robot is placed in the ground, in m. It is within the penetration that is left
# uncorrected, and so large that the toes carry the robot at once and stay on the ground. At a depth
# of a nanometre, the toes rattle.
PLACEMENT_DEPTH = 1e-5
DEEPEST = 0.02  # largest static deflection of the feet, in m


@stage
def resting_depth(mass, stiffness, gravity):
    """Return the static deflection of the feet if two feet carry a mass, in m.

    Args:
        mass: Mass, in kg.
        stiffness: Stiffness of a foot, in N/m.
        gravity: Downward acceleration, in m/s^2.
    """
    return 0.5 * mass * max(gravity, 0.0) / stiffness


@kernel
def place(
    rows: Ints1,
    crank_angles: Floats1,
    x: float,
    pitch: float,
    designs: Designs,
    motions: Motions,
    centres: Floats2,
    planes: Planes,
) -> int:
    """Put robots at rest on their lowest toes, sunk by the static deflection of compliant feet.

    If another pad, or a side of a link that collides, is lower, the robot stands on this pad or
    side. A robot with a fixed chassis stays at y = 0.

    Args:
        rows: Indices of the robots, shape (k,).
        crank_angles: Crank angle of each robot of the batch, in rad, shape (n,).
        x: Position of the crank axis, in m.
        pitch: Pitch, in rad. NaN selects the pitch of :func:`_level_pitch`, or 0 for a fixed
            chassis.
        designs: Tables of the designs, and terrains.
        motions: Records of the robots.
        centres: Work space, shape (toes + 1 or pads, 2).
        planes: Work space.

    Returns:
        The index of the first robot whose feet would deflect by more than :data:`DEEPEST`, or -1 if
        there is none. If there is such a robot, no robot is placed.
    """
    for r in rows:
        properties = motions.robots[r].properties
        depth = resting_depth(properties.mass, properties.stiffness[0], -properties.gravity_y)
        if not properties.fixed_chassis and depth > DEEPEST:
            return r
    for r in rows:
        state, statistics = motions.robots[r].state, motions.statistics[r]
        for i in range(8):
            state[i] = 0.0
        state[0], state[2], state[3] = x, pitch, crank_angles[r]
        for j in range(len(statistics)):
            deflection = statistics[j].deflection
            deflection[0], deflection[1] = math.inf, 0.0  # UNKNOWN_DEFLECTION
        motions.robots[r].diverged = False
    _stand(rows, designs, motions.robots, centres, planes)
    return -1


@stage
def _stand(rows, designs, robots, centres, planes):
    """Set height and pitch of robots so that they stand on the ground."""
    world, surface = designs.world[0], designs.surface
    toes = world.toes
    for r in rows:
        robot = robots[r]
        state, properties, status = robot.state, robot.properties, robot.status
        if properties.fixed_chassis:
            if math.isnan(state[2]):
                state[2] = 0.0
            continue
        design, radius = properties.design, properties.pad_radius
        body, pads, layout = designs.body[design], designs.pads[design], designs.layout[design]
        near = surface, status.first_near, status.end_near
        # Place the lowest toes so that they have no gap, as discs on the slope below them.
        for j in range(toes):
            centres[j, 0], centres[j, 1] = pad_place(pads, layout[j], state[3])
        centres[toes, 0], centres[toes, 1] = centre_of_mass(body, properties, state[3])
        common = centres[:toes], centres[toes], *near, state[0], radius
        if math.isnan(state[2]):
            state[2] = _level_pitch(*common)
        height, _, _ = _clearances(*common, state[2])
        state[1] = -height
        # Correct the height by the true gap, because the ground may not be straight.
        status.margin = SPECULATIVE_MARGIN
        for _ in range(ROUNDS):
            find_centres(state, pads, layout, centres)
            find_planes(centres, status, surface, world, planes)
            least = math.inf
            for i in range(status.first_plane, status.end_plane):
                plane = planes[i]
                x, y = centres[plane.pad]
                gap = plane.normal_x * x + plane.normal_y * y - plane.offset - radius
                least = min(least, gap / plane.normal_y)
            if least < math.inf:
                state[1] -= least
        find_centres(state, pads, layout, centres)
        left = _clearance(centres[: len(layout)], *near, status.pad_radius)
        if world.links_collide:
            left = min(left, _side_clearance(centres, designs.sides, *near, status.pad_radius))
        if abs(left) > CLOSE:
            state[1] -= left
        depth = resting_depth(properties.mass, properties.stiffness[0], -properties.gravity_y)
        state[1] -= PLACEMENT_DEPTH + depth


@stage(inline=False)
def _clearance(centres, surface, begin, end, radius):
    """Return the height by which discs clear a terrain, in m.

    Args:
        centres: Centres of the discs, in m, shape (n, 2).
        surface: Vertices of all terrains, in m, shape (vertices, 2).
        begin: First vertex of the terrain.
        end: End of the range of its vertices.
        radius: Radius of the discs, in m.
    """
    least = math.inf
    for j in range(len(centres)):
        x, y = centres[j, 0], centres[j, 1]
        for k in range(
            segment_at(surface, begin, end, x - radius),
            segment_at(surface, begin, end, x + radius) + 1,
        ):
            ax, ay = surface[k, 0], surface[k, 1]
            slope = (surface[k + 1, 1] - ay) / (surface[k + 1, 0] - ax)
            # Find where the disc touches the line of the segment, or the end of the segment. The
            # terrain continues beyond its own ends.
            touched = x + radius * slope / math.sqrt(1.0 + slope * slope)
            if k > begin:
                touched = max(touched, ax)
            if k < end - 2:
                touched = min(touched, surface[k + 1, 0])
            rise = math.sqrt(max(0.0, radius * radius - (touched - x) * (touched - x)))
            least = min(least, y - rise - ay - slope * (touched - ax))
    return least


@stage(inline=False)
def _side_clearance(centres, sides, surface, begin, end, radius):
    """Return the height by which the sides of links clear the vertices of a terrain, in m.

    Args:
        centres: Centres of the pads, in m, shape (pads, 2).
        sides: Pads at the ends of the sides, shape (sides, 2).
        surface: Vertices of all terrains, in m, shape (vertices, 2).
        begin: First vertex of the terrain.
        end: End of the range of its vertices.
        radius: Radius of the pads, in m.
    """
    least = math.inf
    for k in range(len(sides)):
        a, b = sides[k, 0], sides[k, 1]
        if centres[b, 0] < centres[a, 0]:
            a, b = b, a
        ax, ay, bx, by = centres[a, 0], centres[a, 1], centres[b, 0], centres[b, 1]
        if not ax < bx:
            continue
        slope = (by - ay) / (bx - ax)
        length = math.sqrt(1.0 + slope * slope)
        vertex = max(segment_at(surface, begin, end, ax - radius), begin) + 1
        while vertex < end - 1 and surface[vertex, 0] < bx + radius:
            x, y = surface[vertex, 0], surface[vertex, 1]
            if ax < x - radius * slope / length < bx:  # the point of the side that would touch
                least = min(least, ay + slope * (x - ax) - radius * length - y)
            vertex += 1
    return least


@stage(inline=False)
def _clearances(toes, centre, surface, begin, end, x, radius, pitch):
    """Compute the heights by which the toes clear a terrain if the crank axis is at (x, 0).

    Args:
        toes: Positions of the toes in the chassis frame, in m, shape (toes, 2).
        centre: Centre of mass in the chassis frame, in m, shape (2,).
        surface: Vertices of all terrains, in m, shape (vertices, 2).
        begin: First vertex of the terrain.
        end: End of the range of its vertices.
        x: Position of the crank axis, in m.
        radius: Radius of the toes, in m.
        pitch: Pitch, in rad.

    Returns:
        The smallest heights of all toes, of the toes ahead of the centre of mass, and of the other
        toes, in m. A height is infinite if there are no such toes.
    """
    cos, sin = mathematics.cos(pitch), mathematics.sin(pitch)
    centre_x = x + cos * centre[0] - sin * centre[1]
    front = rear = math.inf
    for j in range(len(toes)):
        toe_x = x + cos * toes[j, 0] - sin * toes[j, 1]
        toe_y = sin * toes[j, 0] + cos * toes[j, 1]
        before = height_at(surface, begin, end, toe_x - GRADIENT_STEP)
        after = height_at(surface, begin, end, toe_x + GRADIENT_STEP)
        gradient = (after - before) / (2.0 * GRADIENT_STEP)
        # A disc over a straight slope touches with its centre radius / cos(slope) above it.
        height = height_at(surface, begin, end, toe_x)
        lift = toe_y - height - radius * math.sqrt(1.0 + gradient * gradient)
        if toe_x > centre_x:
            front = min(front, lift)
        else:
            rear = min(rear, lift)
    return min(front, rear), front, rear


@stage
def _tip(toes, centre, surface, begin, end, x, radius, pitch):
    """Return the clearance of the front toes minus that of the rear toes, in m.

    The result is infinite if there are only rear toes, and minus infinity if there are no rear
    toes. The arguments are those of :func:`_clearances`.
    """
    _, front, rear = _clearances(toes, centre, surface, begin, end, x, radius, pitch)
    if front < math.inf and rear < math.inf:
        return front - rear
    return math.inf if rear < math.inf else -math.inf


@stage(inline=False)
def _level_pitch(toes, centre, surface, begin, end, x, radius):
    """Return the most level pitch at which front and rear toes touch the ground together, in rad.

    The search tries pitches from the most level one outwards. It then refines the first interval in
    which the front toes take off. The arguments are those of :func:`_clearances`.
    """
    low, high = -WIDEST_PITCH, WIDEST_PITCH
    pitch = 0.0
    for _ in range(LEVELS):
        left = _most_level(low, high)
        right = left + 1
        left_tip = _tip(toes, centre, surface, begin, end, x, radius, _tried(low, high, left))
        right_tip = _tip(toes, centre, surface, begin, end, x, radius, _tried(low, high, right))
        any_both = abs(left_tip) < math.inf or abs(right_tip) < math.inf
        found = left if left_tip <= 0.0 and right_tip > 0.0 else -1
        below, above = left_tip, right_tip
        while (found < 0 or not any_both) and (left > 0 or right < TRIES - 1):
            if _is_left_next(low, high, left, right):
                left -= 1
                first, after = left, left_tip
                before = _tip(toes, centre, surface, begin, end, x, radius, _tried(low, high, left))
                left_tip = before
                any_both = any_both or abs(before) < math.inf
            else:
                right += 1
                first, before = right - 1, right_tip
                after = _tip(toes, centre, surface, begin, end, x, radius, _tried(low, high, right))
                right_tip = after
                any_both = any_both or abs(after) < math.inf
            if found < 0 and before <= 0.0 and after > 0.0:
                found, below, above = first, before, after
        if not any_both:
            return 0.0
        if found < 0:
            return pitch
        low, high = _tried(low, high, found), _tried(low, high, found + 1)
        if abs(below) < math.inf and abs(above) < math.inf:
            fraction = below / (below - above)
            pitch = low + fraction * (high - low)
        else:
            pitch = 0.5 * (low + high)
    return pitch


@stage
def _tried(low, high, i):
    """Return pitch number ``i`` of the pitches that are tried between two limits, in rad."""
    return high if i == TRIES - 1 else i * ((high - low) / (TRIES - 1)) + low


@stage
def _between(low, high, i):
    """Return the magnitude of the sum of tried pitches ``i`` and ``i + 1``, in rad."""
    return abs(_tried(low, high, i) + _tried(low, high, i + 1))


@stage(inline=False)
def _most_level(low, high):
    """Return the number of the tried pitch at the lower end of the most level interval."""
    best = 0
    for i in range(1, TRIES - 1):
        if _between(low, high, i) < _between(low, high, best):
            best = i
    return best


@stage
def _is_left_next(low, high, left, right):
    """Return whether the search continues with the interval below tried pitch ``left``.

    It does if this interval is at least as level as the one above pitch ``right``, or if no
    interval is left above ``right``.
    """
    if left == 0 or right == TRIES - 1:
        return right == TRIES - 1
    return _between(low, high, left - 1) <= _between(low, high, right)
