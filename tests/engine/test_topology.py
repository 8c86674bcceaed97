"""Rules for the linkage and the springs of a leg, as pages call them: by indices."""

import numpy as np
import pytest

from jansen_env.engine.closure import CRANK
from jansen_env.engine.topology import (
    CHASSIS,
    CRANK_AXIS,
    LINKAGE_FAULTS,
    PAD,
    SPRING_ENDS,
    SPRING_FAULTS,
    SPRING_ON_FRAME,
    SPRING_ON_LINK,
    TORSION_LINKS,
    find_linkage_fault,
    find_spring_fault,
    find_torsion_fault,
    put_pads,
)
from jansen_env.robot import JANSEN, ROBOTS

MEMBERS = JANSEN.padded_members


def fault_of(members, pads):
    """Fault of a linkage without dyads, and the index of the entry at fault."""
    none = np.empty((0, 2), np.int64)
    sizes = (members >= 0).sum(axis=1)
    where = np.zeros(1, np.int64)
    toes, known = np.array([1]), np.empty(members.max() + 1, np.int64)
    dyads = np.empty((0, 4), np.int64)
    fault = find_linkage_fault(sizes, members, toes, pads, none, none, dyads, known, where)
    return fault, int(where[0])


@pytest.mark.parametrize("pad", [[0, 5], [0, -1], [0, 2**40], [-1, 0], [1, 1], [2, 0]])
def test_a_pad_is_at_a_joint_of_its_body(pad):
    """The third body does not exist, joint 1 is a toe, and joint 2 is on the other body."""
    members = np.array([[0, 1], [1, 2]])
    assert fault_of(members, np.array([[0, 0], pad])) == (PAD, 1)


def test_a_linkage_without_a_crank_is_at_fault():
    assert fault_of(np.array([[0, 1]]), np.empty((0, 2), np.int64)) == (CRANK_AXIS, CRANK)


def test_springs_are_between_points_that_move():
    joint = JANSEN.joints.index
    for start, end, fault in (
        (joint("D"), CHASSIS, -1),
        (joint("D"), joint("C"), -1),
        (joint("P"), CHASSIS, SPRING_ON_FRAME),
        (joint("D"), joint("B"), SPRING_ON_LINK),
        (joint("D"), joint("D"), SPRING_ON_LINK),
        (joint("D"), -1, SPRING_ENDS),
        (-1, joint("D"), SPRING_ENDS),
    ):
        assert find_spring_fault(MEMBERS, start, end) == fault, (start, end)


def test_torsion_springs_are_between_links_that_share_a_pin():
    body = JANSEN.names.index
    assert find_torsion_fault(MEMBERS, body("foot"), body("coupler")) == -1
    for other in (body("frame"), body("foot"), -1):
        assert find_torsion_fault(MEMBERS, body("foot"), other) == TORSION_LINKS


@pytest.mark.parametrize("name", ROBOTS)
def test_toes_are_on_the_last_body_that_has_them(name):
    linkage = ROBOTS[name]().linkage
    toes = np.array([linkage.joints.index(toe) for toe in linkage.toes])
    pads = np.empty((len(toes), 2), np.int64)
    put_pads(linkage.padded_members, toes, np.empty((0, 2), np.int64), pads)
    last = [max(k for k, joints in enumerate(linkage.members) if toe in joints) for toe in toes]
    assert pads.tolist() == [list(pair) for pair in zip(toes.tolist(), last, strict=True)]


def test_each_fault_has_a_text():
    assert len(LINKAGE_FAULTS) == 11 and len(SPRING_FAULTS) == 4
    fields = {field for field, _ in LINKAGE_FAULTS}
    assert all(hasattr(JANSEN, field) for field in fields)
