"""Rules for the linkage of a leg and for its springs.

Joints and bodies are indices from 0. ``members`` holds the joints of each body, shape (bodies, most
joints), and -1 where a body has fewer. Any other -1 stands for a joint or a body that the linkage
does not have.
"""

from __future__ import annotations

from jansen_env.engine.closure import CRANK, FRAME
from jansen_env.engine.kernel import Ints1, Ints2, kernel, stage
from jansen_env.engine.link_shapes import count_joints

(
    BODY,
    CRANK_AXIS,
    TOE,
    PAD,
    DAMPED,
    BEARING,
    DYAD_ENDS,
    DYAD_JOINT,
    DYAD_BODIES,
    DYAD_BRANCH,
    LOST_JOINT,
) = range(11)
KNOWN = "of the frame, of the crank or of a body of an earlier dyad"
"""Description of the joints whose positions are known when a dyad is computed."""

LINKAGE_FAULTS = (
    ("bodies", "a body with the same number of joints as its link, all of them of the linkage"),
    ("bodies", "the crank, whose first joint must be a joint of the frame"),
    ("toes", "a joint of the linkage that is not already a toe"),
    (
        "pads",
        "a joint and the number of a body that has this joint, and the joint must be neither a toe "
        "nor the joint of an earlier pad",
    ),
    ("damped", "the numbers of two different bodies of the linkage"),
    ("bearings", "the numbers of two different bodies of the linkage"),
    ("dyads", f"a dyad whose start and end are known, that is, joints {KNOWN}"),
    ("dyads", f"a dyad whose joint is not known yet, that is, not a joint {KNOWN}"),
    (
        "dyads",
        "a dyad of two different bodies, one of which has its joint and its start, and the other "
        "its joint and its end",
    ),
    ("dyads", "a dyad whose branch is 1 or -1"),
    (
        "joints",
        "a joint whose position is known, that is, a joint of the frame, of the crank or of a body "
        "of a dyad",
    ),
)
"""Field of a linkage that each rule is about, and what an entry of this field must be."""

SPRING_ENDS, SPRING_ON_FRAME, SPRING_ON_LINK, TORSION_LINKS = range(4)
SPRING_FAULTS = (
    "between two joints of the linkage, or between a joint and a point of the chassis",
    "between two points that move relative to each other, and no joint of the frame moves relative "
    "to the chassis",
    "between two joints that are not on the same link",
    "between two different links that share a pin",
)
"""Description of an allowed spring, by the number of the fault."""
CHASSIS = -2
"""Stands for a point of the chassis at the end of a spring."""


@kernel
def find_linkage_fault(
    sizes: Ints1,
    members: Ints2,
    toes: Ints1,
    pads: Ints2,
    damped: Ints2,
    bearings: Ints2,
    dyads: Ints2,
    known: Ints1,
    where: Ints1,
) -> int:
    """Find the first rule that a linkage breaks.

    Args:
        sizes: Number of joints of the link of each body, shape (bodies,).
        members: Joints of the bodies, see the module.
        toes: Joints on which the robot walks, shape (toes,).
        pads: Joint and body of each contact pad that is not at a toe, shape (pads, 2).
        damped: Pairs of bodies with viscous friction between them, shape (pairs, 2).
        bearings: Pairs of bodies with dry friction between them, shape (pairs, 2).
        dyads: Joint, start, end and branch of each dyad, shape (dyads, 4 or more).
        known: Work space, shape (joints,).
        where: Output, index of the entry that breaks the rule, shape (1,).

    Returns:
        The index of the rule in :data:`LINKAGE_FAULTS`, or -1 if there is no fault.
    """
    bodies = len(members)
    for k in range(bodies):
        where[0] = k
        if count_joints(members[k]) != sizes[k]:
            return BODY
    where[0] = CRANK
    if bodies <= CRANK or not _has(members[FRAME], members[CRANK, 0]):
        return CRANK_AXIS
    for k in range(len(toes)):
        where[0] = k
        if toes[k] < 0 or _has(toes[:k], toes[k]):
            return TOE
    for k in range(len(pads)):
        where[0] = k
        joint, body = pads[k, 0], pads[k, 1]
        if body < 0 or body >= bodies or not _has(members[body], joint):
            return PAD
        if _has(toes, joint) or _has(pads[:k, 0], joint):
            return PAD
    for k in range(len(damped)):
        where[0] = k
        if not _are_bodies(damped[k], bodies):
            return DAMPED
    for k in range(len(bearings)):
        where[0] = k
        if not _are_bodies(bearings[k], bodies):
            return BEARING
    return _find_dyad_fault(members, dyads, known, where)


@stage(inline=False)
def _find_dyad_fault(members, dyads, known, where):
    """Find the first rule that the dyads of a linkage break, see :func:`find_linkage_fault`."""
    known[:] = 0
    _note_joints(members[FRAME], known)
    _note_joints(members[CRANK], known)
    for k in range(len(dyads)):
        where[0] = k
        joint, start, end = dyads[k, 0], dyads[k, 1], dyads[k, 2]
        if start < 0 or end < 0 or known[start] == 0 or known[end] == 0:
            return DYAD_ENDS
        if joint >= 0 and known[joint] == 1:
            return DYAD_JOINT
        first, second = _body_of(members, joint, start), _body_of(members, joint, end)
        if joint < 0 or first < 0 or second < 0 or first == second:
            return DYAD_BODIES
        if dyads[k, 3] != 1 and dyads[k, 3] != -1:
            return DYAD_BRANCH
        _note_joints(members[first], known)
        _note_joints(members[second], known)
    for joint in range(len(known)):
        where[0] = joint
        if known[joint] == 0:
            return LOST_JOINT
    return -1


@kernel
def find_spring_fault(members: Ints2, start: int, end: int) -> int:
    """Find the first rule that a spring between two points breaks.

    Args:
        members: Joints of the bodies, see the module.
        start: Joint at one end of the spring.
        end: Joint at the other end, or :data:`CHASSIS`.

    Returns:
        The index of the rule in :data:`SPRING_FAULTS`, or -1 if there is no fault.
    """
    if start < 0 or (end < 0 and end != CHASSIS):
        return SPRING_ENDS
    if end == CHASSIS:
        return SPRING_ON_FRAME if _has(members[FRAME], start) else -1
    return SPRING_ON_LINK if _body_of(members, start, end) >= 0 else -1


@kernel
def find_torsion_fault(members: Ints2, first: int, second: int) -> int:
    """Find the first rule that a torsion spring between two links breaks.

    Args:
        members: Joints of the bodies, see the module.
        first: Body at one end of the spring.
        second: Body at the other end.

    Returns:
        The index of the rule in :data:`SPRING_FAULTS`, or -1 if there is no fault.
    """
    if first < 0 or second < 0 or first == second:
        return TORSION_LINKS
    for joint in members[first]:
        if joint >= 0 and _has(members[second], joint):
            return -1
    return TORSION_LINKS


@kernel
def put_pads(members: Ints2, toes: Ints1, others: Ints2, pads: Ints2) -> None:
    """List all contact pads of a leg, toes first. A toe belongs to the last body that has it.

    Args:
        members: Joints of the bodies, see the module.
        toes: Joints on which the robot walks, shape (toes,).
        others: Joint and body of each other pad, shape (others, 2).
        pads: Output, joint and body of each pad, shape (toes + others, 2).
    """
    for k in range(len(toes)):
        pads[k, 0] = toes[k]
        for body in range(len(members)):
            if _has(members[body], toes[k]):
                pads[k, 1] = body
    for k in range(len(others)):
        pads[len(toes) + k, 0], pads[len(toes) + k, 1] = others[k, 0], others[k, 1]


@stage
def _has(joints, joint):
    """Return whether a joint of the linkage is one of some joints."""
    found = False
    for each in joints:
        found = found or (each == joint and joint >= 0)
    return found


@stage
def _body_of(members, first, second):
    """Return the first body with two joints, or -1 if there is none."""
    for k in range(len(members)):
        if _has(members[k], first) and _has(members[k], second):
            return k
    return -1


@stage
def _are_bodies(pair, bodies):
    """Return whether a pair consists of two different indices of bodies."""
    first, second = pair[0], pair[1]
    return 0 <= first < bodies and 0 <= second < bodies and first != second


@stage
def _note_joints(joints, known):
    """Note that the positions of a body's joints are known."""
    for joint in joints:
        if joint >= 0:
            known[joint] = 1
