"""Linkages as data: the bodies of a leg, their joints, and the order in which joints are computed.

A linkage contains no lengths. The lengths, masses and inertias of the bodies belong to the robot
(:class:`jansen_env.Robot`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from typing_extensions import override

from jansen_env.arrays import Ints
from jansen_env.checks import AtLeast, Rule, check_limits, entries, instance, invalid, shown
from jansen_env.engine.topology import LINKAGE_FAULTS, find_linkage_fault, put_pads

FRAME = 1  # number of the chassis, which all legs share
CRANK = 2  # number of the crank, which all legs share
LONGEST_NAME = 60  # largest length of a body's name, in bytes
LARGEST_NUMBER = 2**31  # largest magnitude of a number in a row, larger than in any linkage
INDEPENDENT = 4  # number of independent coordinates: three of the frame, and the crank angle


class Pin(NamedTuple):
    """A pin that connects two bodies at a joint.

    Attributes:
        joint: Joint in which the pin sits.
        body: Number of the body on which the force of the pin acts, from 1.
        other: Number of the body that exerts this force, from 1.
    """

    joint: str
    body: int
    other: int

    @override
    def __str__(self) -> str:
        return f"{self.joint}{self.other}{self.body}"


class Dyad(NamedTuple):
    """A joint of two bodies, whose position follows from one known joint of each body.

    Attributes:
        joint: The joint.
        start: Known joint of the first body.
        end: Known joint of the second body.
        branch: 1 if the joint lies on the left of the line from ``start`` to ``end``, or -1 if it
            lies on the right.
    """

    joint: str
    start: str
    end: str
    branch: int


@dataclass(frozen=True)
class Linkage:
    """The topology of a leg that one crank moves.

    A joint is a single letter, and bodies are numbered from 1.

    Args:
        bodies: Name and joints of each body. The first body is the frame with all fixed pivots. The
            second body is the crank, whose first joint is the crank axis.
        dyads: Tuples (joint, start, end, branch) in the order in which the joints are computed; see
            :class:`Dyad`.
        toes: Joints on which the robot walks, at least one.
        joints: All joints, in the order of arrays. If empty, they have the order of the bodies.
        pins: All pins, in the order of constraints. If empty, they have the order of the bodies.
        damped: Pairs of bodies with viscous friction between them. If empty, they are the bodies of
            each pin.
        bearings: Pairs of bodies with dry friction between them. The first body of a pair holds the
            pin. If empty, they are the bodies of each pin.
        pads: Joints other than toes that can touch the ground, as pairs (joint, body), where the
            contact pad belongs to ``body``. If empty, they are all joints other than toes and
            the crank's joints. The body is then the frame, or else the last body with this joint.

    Raises:
        ValueError: If a row has the wrong form, a rule of :mod:`jansen_env.engine.topology` is
            broken, the pins do not hold all bodies together, or the leg does not have one degree of
            freedom.
    """

    bodies: tuple[tuple[str, str], ...]
    dyads: tuple[Dyad, ...]
    toes: str
    joints: str = ""
    pins: tuple[Pin, ...] = ()
    damped: tuple[tuple[int, int], ...] = ()
    bearings: tuple[tuple[int, int], ...] = ()
    pads: tuple[tuple[str, int], ...] = ()
    RULES: ClassVar[tuple[Rule, ...]] = (
        AtLeast("bodies", 2),
        AtLeast("dyads", 1),
        AtLeast("toes", 1),
    )

    def __post_init__(self) -> None:
        def default(name: str, value: object) -> None:
            if not getattr(self, name):
                object.__setattr__(self, name, value)

        self._set_rows("bodies", "(name, joints)", (str, str))
        self._set_rows("dyads", "(joint, start, end, branch)", (str, str, str, int), Dyad)
        self._set_rows("pins", "(joint, body, other)", (str, int, int), Pin)
        for name in ("damped", "bearings"):
            self._set_rows(name, "(body, body)", (int, int))
        self._set_rows("pads", "(joint, body)", (str, int))
        self._check_names()
        default("joints", "".join(dict.fromkeys("".join(joints for _, joints in self.bodies))))
        self._check_rules()
        default("pins", self._pins())
        self._check_pins()
        default("damped", tuple((pin.other, pin.body) for pin in self.pins))
        default("bearings", tuple((pin.other, pin.body) for pin in self.pins))
        others = [
            (joint, FRAME if joint in self.bodies[FRAME - 1][1] else k)
            for joint, k in self._last_bodies.items()
            if joint not in self.toes + self.bodies[CRANK - 1][1]
        ]
        default("pads", tuple(sorted(others, key=lambda pad: pad[1] == FRAME)))
        freedom = 3 * len(self.bodies) - 2 * len(self.pins)
        if freedom != INDEPENDENT:
            raise ValueError(
                f"Linkage must have 1 degree of freedom, got {freedom - 3} with "
                f"{len(self.bodies)} bodies and {len(self.pins)} pins"
            )

    def _set_rows(
        self,
        name: str,
        allowed: str,
        kinds: tuple[type, ...],
        make: Callable[..., tuple[object, ...]] = lambda *row: row,
    ) -> None:
        """Convert a field to a tuple of rows, and check the types of their entries.

        Args:
            name: Name of the field.
            allowed: Description of a row, for error messages.
            kinds: Type of each entry of a row.
            make: Function that returns a row from its entries.
        """
        rows = []
        for row in entries(f"Linkage.{name}", getattr(self, name), f"rows {allowed}"):
            cells = entries(f"Linkage.{name}", row, f"rows {allowed}")
            is_large = any(isinstance(cell, int) and abs(cell) > LARGEST_NUMBER for cell in cells)
            if is_large or tuple(map(type, cells)) != kinds:
                raise ValueError(f"Linkage.{name} must have rows {allowed}, got {shown(row)}")
            rows.append(make(*cells))
        object.__setattr__(self, name, tuple(rows))

    def _check_names(self) -> None:
        """Check the names of bodies and joints, and that pins are at joints of their bodies."""
        for name in ("toes", "joints"):
            instance(f"Linkage.{name}", getattr(self, name), str)
        check_limits(self)
        known = {*"".join(joints for _, joints in self.bodies)}
        if len({*self.names}) != len(self.names) or not all(map(str.isidentifier, self.names)):
            raise ValueError(
                f"names of Linkage.bodies must be different words, got {shown(self.names)}"
            )
        if longest := [name for name in self.names if len(name.encode()) > LONGEST_NAME]:
            raise ValueError(
                f"a name of Linkage.bodies must have at most {LONGEST_NAME} bytes, because files "
                f"of drawings are named by it, got {len(longest[0].encode())} bytes"
            )
        for name, joints in self.bodies:
            if len(joints) < 2 or len({*joints}) != len(joints) or not joints.isalpha():
                raise ValueError(
                    f"the joints of Linkage's {name} must be two or more different letters, got "
                    f"{shown(joints)}"
                )
        if self.joints and sorted(self.joints) != sorted(known):
            raise invalid("Linkage.joints", self.joints, f"{sorted(known)}")
        for k, pin in enumerate(self.pins):
            for body in pin[1:]:
                if not 1 <= body <= len(self.bodies) or pin.joint not in self.bodies[body - 1][1]:
                    allowed = "a pin at a joint that both of its bodies have"
                    raise invalid(f"Linkage.pins[{k}]", tuple(pin), allowed)

    def _check_rules(self) -> None:
        """Check the rules that :mod:`jansen_env.engine.topology` defines."""
        where = np.zeros(1, np.int64)
        # The module of a linkage is imported before the engine is built, so no compiled kernel
        # may run here.
        fault = find_linkage_fault.function(
            np.array([*map(len, self.members)]),
            self.padded_members,
            self._indices(self.toes),
            self._pad_rows(),
            _pairs(self.damped),
            _pairs(self.bearings),
            np.array([(*self._indices(dyad[:3]), dyad.branch) for dyad in self.dyads]),
            np.empty(len(self.joints), np.int64),
            where,
        )
        if fault >= 0:
            field, allowed = LINKAGE_FAULTS[fault]
            k = int(where[0])
            raise invalid(f"Linkage.{field}[{k}]", getattr(self, field)[k], allowed)

    def _indices(self, joints: Iterable[str]) -> Ints:
        """Return the indices of joints; -1 stands for a joint that the linkage does not have."""
        index = {joint: k for k, joint in enumerate(self.joints)}
        return np.array([index.get(joint, -1) for joint in joints], np.int64)

    def _pad_rows(self) -> Ints:
        """Return the index of the joint and of the body of each pad that is not at a toe."""
        joints = self._indices(joint for joint, _ in self.pads)
        return np.column_stack([joints, [body - 1 for _, body in self.pads]]).astype(np.int64)

    def _check_pins(self) -> None:
        """Check that the pins hold all bodies together at each joint without redundant pins."""

        def meeting(pins: tuple[Pin, ...]) -> tuple[list[str], set[tuple[str, int]]]:
            bodies = {(pin.joint, body) for pin in pins for body in pin[1:]}
            return sorted(pin.joint for pin in pins), bodies

        pairs = {(pin.joint, frozenset(pin[1:])) for pin in self.pins if pin.body != pin.other}
        if len(pairs) < len(self.pins) or meeting(self.pins) != meeting(self._pins()):
            raise ValueError(
                "Linkage.pins must hold all bodies together at each joint, for example "
                f"{shown(self._pins())}, got {shown(self.pins)}"
            )

    def _pins(self) -> tuple[Pin, ...]:
        """Return a pin for each body at each joint, except for the first body at a joint."""
        first: dict[str, int] = {}
        pins = []
        for k, (_, joints) in enumerate(self.bodies, start=1):
            pins += [Pin(joint, k, first[joint]) for joint in joints if joint in first]
            first.update({joint: k for joint in joints if joint not in first})
        return tuple(pins)

    @property
    def moving_pins(self) -> tuple[Pin, ...]:
        """All pins except the pin of the crank axis, which all legs share."""
        return tuple(pin for pin in self.pins if {pin.body, pin.other} != {FRAME, CRANK})

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(name for name, _ in self.bodies)

    @cached_property
    def members(self) -> tuple[tuple[int, ...], ...]:
        """Joints of each body, as indices into :attr:`joints`."""
        return tuple(tuple(map(self.joints.index, joints)) for _, joints in self.bodies)

    @cached_property
    def padded_members(self) -> Ints:
        """Joints of each body, and -1 where a body has fewer, shape (bodies, most joints)."""
        rows = np.full((len(self.members), max(map(len, self.members))), -1)
        for row, joints in zip(rows, self.members, strict=True):
            row[: len(joints)] = joints
        rows.setflags(write=False)
        return rows

    @property
    def axis(self) -> int:
        """Index of the crank's axis among the joints."""
        return self.members[CRANK - 1][0]

    @cached_property
    def _last_bodies(self) -> dict[str, int]:
        """Number of the last body that contains each joint."""
        return {joint: k for k, (_, joints) in enumerate(self.bodies, start=1) for joint in joints}

    @cached_property
    def all_pads(self) -> tuple[tuple[int, int], ...]:
        """Pair of indices (joint, body) of every pad, toes first."""
        pads = np.empty((len(self.toes) + len(self.pads), 2), np.int64)
        put_pads.function(self.padded_members, self._indices(self.toes), self._pad_rows(), pads)
        return tuple((joint, body) for joint, body in pads.tolist())

    @cached_property
    def corners(self) -> tuple[tuple[int, str], ...]:
        """Pair (body, joint) for every end of a bar and every corner of a plate."""
        return tuple(
            (k, joint) for k, (_, joints) in enumerate(self.bodies, start=1) for joint in joints
        )

    @cached_property
    def holes(self) -> tuple[tuple[int, str], ...]:
        """Those entries of :attr:`corners` whose joint has a pin."""
        pinned = {pin.joint for pin in self.pins}
        return tuple(corner for corner in self.corners if corner[1] in pinned)

    @cached_property
    def edges(self) -> tuple[tuple[tuple[int, int], ...], ...]:
        """Straight edges of each body, as pairs of joints, for drawing."""
        around = (js if len(js) == 2 else (*js, js[0]) for js in self.members)
        return tuple(tuple(pairwise(joints)) for joints in around)

    @property
    def skeleton(self) -> tuple[tuple[int, int], ...]:
        """Straight edges of all bodies, as pairs of joints."""
        return tuple(edge for edges in self.edges for edge in edges)


def _pairs(bodies: tuple[tuple[int, int], ...]) -> Ints:
    """Return pairs of numbers of bodies as indices, shape (pairs, 2)."""
    return np.array(bodies, np.int64).reshape(-1, 2) - 1


JANSEN = Linkage(
    joints="POABCDET",
    bodies=(
        ("frame", "PO"), ("crank", "OA"), ("upper_rod", "AB"), ("upper_triangle", "PBD"),
        ("rocker", "CP"), ("lower_rod", "CA"), ("coupler", "DE"), ("foot", "CET"),
    ),
    dyads=(Dyad("B", "A", "P", -1), Dyad("C", "A", "P", 1), Dyad("E", "D", "C", -1)),
    toes="T",
    # The order is that of the paper's Phi_hf.
    pins=(
        Pin("O", 2, 1), Pin("A", 3, 2), Pin("B", 4, 3), Pin("P", 4, 1), Pin("P", 5, 1),
        Pin("C", 6, 5), Pin("A", 6, 2), Pin("D", 7, 4), Pin("C", 8, 5), Pin("E", 8, 7),
    ),
    # The pairs are those of the paper's h_f, which omits the friction between the frame and the
    # other bodies at P.
    damped=((1, 2), (2, 3), (3, 4), (3, 6), (4, 5), (5, 6), (5, 8), (4, 7), (6, 8), (7, 8)),
    bearings=((1, 2), (2, 3), (2, 6), (3, 4), (1, 4), (1, 5), (5, 6), (5, 8), (4, 7), (7, 8)),
    pads=(("C", 8), ("E", 8), ("D", 4), ("B", 4), ("P", 1)),
)  # fmt: skip
"""Theo Jansen's leg, with the names, numbers and order of section 2.1 of the paper."""
