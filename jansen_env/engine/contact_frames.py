"""Contacts of toes as pictures show them: points of the ground, whether a toe slips, and forces."""

from __future__ import annotations

from jansen_env.engine.kernel import Floats2, Ints1, kernel
from jansen_env.engine.records import Motions, Planes, Robots

AIR, GRIP, SLIP = range(3)
"""What a toe does: it is lifted, sticks to the ground, or slides under load."""
SLIPPING = 0.01
"""Mean slip speed, in m/s, above which a toe counts as slipping."""
TOUCHING = 1e-6
"""Normal force, divided by the weight, above which a toe counts as on the ground."""


@kernel
def put_contact_frames(
    r: int,
    begin: int,
    end: int,
    planes: Planes,
    robots: Robots,
    centres: Floats2,
    points: Floats2,
    tangents: Floats2,
) -> None:
    """Compute the point of the ground nearest to each toe of robot ``r``, and the tangent there.

    If no plane is listed for a toe, its point is the lowest point of the pad, and its tangent
    points in the +x direction.

    Args:
        r: Index of the robot.
        begin: Index of the first plane of the robot's toes.
        end: Index after the last one of these planes.
        planes: Contact planes, ordered by pad and then by distance.
        robots: Records of the robots.
        centres: Centres of the toes, in m, shape (toes, 2).
        points: Output, the points in m, shape (toes, 2).
        tangents: Output, the tangents, shape (toes, 2).
    """
    radius = robots[r].status.pad_radius
    for j in range(len(centres)):
        points[j, 0], points[j, 1] = centres[j, 0], centres[j, 1] - radius
        tangents[j, 0], tangents[j, 1] = 1.0, 0.0
    for k in range(end - 1, begin - 1, -1):  # The nearest plane of a toe comes last.
        plane = planes[k]
        j = plane.pad
        points[j, 0] = centres[j, 0] - radius * plane.normal_x
        points[j, 1] = centres[j, 1] - radius * plane.normal_y
        tangents[j, 0], tangents[j, 1] = plane.normal_y, -plane.normal_x


@kernel
def put_contacts(
    r: int, period: float, motions: Motions, tangents: Floats2, contacts: Ints1, forces: Floats2
) -> None:
    """Determine what each toe of robot ``r`` did in the last control step, and the force on it.

    Args:
        r: Index of the robot.
        period: Duration of a control step, in s.
        motions: Records of the robots.
        tangents: Tangent of the ground at each toe, shape (toes, 2).
        contacts: Output, :data:`AIR`, :data:`GRIP` or :data:`SLIP` for each toe, shape (toes,).
        forces: Output, force of the ground on each toe in x and y, in N, shape (toes, 2).
    """
    least = TOUCHING * motions.robots[r].weight
    for j in range(len(tangents)):
        u, v = tangents[j, 0], tangents[j, 1]
        along, across = motions.contact_force[r, j, 0], motions.contact_force[r, j, 1]
        forces[j, 0] = along * u - across * v
        forces[j, 1] = along * v + across * u
        contacts[j] = GRIP if across > least else AIR
        if motions.slip[r, j] > SLIPPING * period:
            contacts[j] = SLIP
