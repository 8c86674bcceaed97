"""Order of the parts along the shaft in which no moving part collides with another part.

A crank pin carries a unit: a fore and a back leg, or a single leg. From end to end, a unit consists
of a frame, a hub, a web (the crank), the links, and again a web, a hub and a frame. The shaft ends
at either web, because links sweep over its axis between the webs. The crank pin joins the webs.
Every link lies in a layer. A unit of two legs coincides with itself when it is turned about the
vertical, so both legs are alike.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from jansen_env.robot import Robot
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.part_sizes import feet_of
from jansen_workshop.drawings.mount import units
from jansen_workshop.drawings.outlines import CutPart, Points, gap, link_part

# Total length of all discs, in layers, and the layers of each body as bits.
Order = tuple[float, list[int]]

CLEARANCE = 1.0  # mm, least distance between parts in the same layer
GAP, UNIT_GAP = 1.0, 6.0  # mm, between layers (a washer), between units (heads of pins)
EMPTY = 5.0  # mm, height of a layer without links, which has heads of pins or treads
SAMPLES = 720  # number of crank angles per turn at which collisions are checked
WEB = 2  # number of layers from a unit's end to a web
MOST_LAYERS, MOST_TRIES = 24, 400_000  # limits of the search, which takes at most 30 s


class CollisionError(ValueError):
    """Error raised if the links of a unit collide in every order."""


class Placed(NamedTuple):
    """Part at its position along the shaft.

    Attributes:
        unit: Index of the part's unit.
        leg: Index of the part's leg.
        body: Number of the part's body, from 1 on.
        layer: Index of the part's layer in the unit.
        z: Position of the part's lower face along the shaft, in mm from the lower face of the first
            part of the machine.
        part: Flat part that is placed.
        through: Names of those joints of the part that turn on axles through the whole machine.
    """

    unit: int
    leg: int
    body: int
    layer: int
    z: float
    part: CutPart
    through: str

    @property
    def top(self) -> float:
        """Position of the part's upper face along the shaft, in mm."""
        return self.z + self.part.thickness


class Solid(NamedTuple):
    """Body, or disc around a joint.

    A disc stands for a pin with its head and nut, for a tread, or for the shaft with a hub.

    Attributes:
        leg: Index of the leg.
        joints: Names of the body's joints, or of the joint at the centre of the disc.
        places: Positions of the corners at each crank angle, in mm, shape (SAMPLES, corners).
        radius: Radius by which the polygon of the corners is enlarged, in mm.
        on: Indices of the bodies on a disc. The disc occupies their layers and all layers between
            them.
        beyond: Number of layers that the disc occupies in addition on either side.
    """

    leg: int
    joints: str
    places: Points
    radius: float
    on: tuple[int, ...] = ()
    beyond: int = 1


def carried(part: CutPart, points: Sequence[complex], joints: Points, side: str) -> Points:
    """Return the positions of points of a part, from the positions of its joints.

    Args:
        part: Part that carries the points.
        points: Points in the axes of the part, in mm.
        joints: Positions of the part's joints, in mm, shape (..., joints).
        side: Side of the leg. A part of a "back" leg is seen from behind, so it is mirrored.

    Returns:
        Positions in mm, shape (..., points).
    """
    drawn, on = np.array([*part.joints.values()]), np.array(points)
    if side == "back":
        drawn, on = drawn.conj(), on.conj()
    turn = (joints[..., 1] - joints[..., 0]) / (drawn[1] - drawn[0])
    return joints[..., :1] + turn[..., None] * (on - drawn[0])


def _meet(solid: Solid, other: Solid) -> bool:
    """Return whether two solids come closer than :data:`CLEARANCE` during a turn."""
    return bool(gap(solid.places, other.places).min() < solid.radius + other.radius + CLEARANCE)


def _solids(robot: Robot, legs: Sequence[int]) -> list[Solid]:
    """Return the bodies of the legs, leg by leg, followed by the discs.

    A fixed pivot has no disc if no body sweeps over it: an axle through the machine bears it.
    """
    build, linkage = robot.build, robot.linkage
    spacer, psi = 1e3 * build.spacer_radius, 2.0 * math.pi / SAMPLES * np.arange(SAMPLES)
    axis, pin, *_ = [*linkage.bodies[CRANK - 1][1]]  # shared by all legs
    bodies: list[Solid] = []
    discs: list[Solid] = []
    for leg in legs:
        side, first = robot.legs[leg].side, len(bodies)
        at = joint_positions(robot, side, psi) @ np.array([1e3, 1e3j])
        for body, members in enumerate(linkage.members, 1):
            part = link_part(robot, body)
            places = carried(part, part.outline.corners, at[:, members], side)
            for toe in feet_of(robot, body):
                radius, tread = 1e3 * build.foot_radius, at[:, [linkage.joints.index(toe)]]
                discs.append(Solid(leg, toe, tread, radius, (len(bodies),), build.tread_layers))
            bodies.append(Solid(leg, linkage.bodies[body - 1][1], places, part.outline.radius))
        links = bodies[first:]
        for k, joint in enumerate(linkage.joints):
            on = tuple(first + i for i, body in enumerate(links) if joint in body.joints)
            disc = Solid(leg, joint, at[:, [k]], spacer, on)
            if joint in (axis, pin):
                hub = 1e3 * build.hub_radius
                shared = disc._replace(radius=hub if joint == axis else spacer, on=())
                discs += [shared] if leg == legs[0] else []
            elif len(on) > 1 and (joint not in linkage.bodies[0][1] or _swept(robot, disc, links)):
                discs.append(disc)
    return bodies + discs


def _swept(robot: Robot, pivot: Solid, bodies: Sequence[Solid]) -> bool:
    """Return whether a body of a leg sweeps over the tube around a fixed pivot.

    The pivots of both sides are checked if the robot has legs on both sides.
    """
    tube = pivot._replace(radius=1e3 * robot.build.tube_radius)
    tubes = [tube, tube._replace(places=-tube.places.conj())]
    del tubes[len({leg.side for leg in robot.legs}) :]
    return any(_meet(t, body) for body in bodies for t in tubes[pivot.joints in body.joints :])


class Unit:
    """Legs on one crank pin, for which an order without collisions is searched.

    Args:
        robot: Robot that the legs belong to.
        legs: Indices of the legs on the crank pin.

    Attributes:
        linkage: Linkage of the robot.
        count: Number of bodies per leg.
        axis: Name of the joint at the crank axis.
        pin: Name of the joint at the crank pin.
        solids: Bodies of the legs, followed by the discs.
        bodies: Number of bodies among the solids.
        tries: Number of orders that the search may still try.
        pairs: Pairs of indices of solids that meet during a turn.
    """

    def __init__(self, robot: Robot, legs: Sequence[int]) -> None:
        self.linkage, self.count = robot.linkage, len(robot.bodies)
        self.axis, self.pin, *_ = [*self.linkage.bodies[CRANK - 1][1]]
        self.solids, self.bodies = _solids(robot, legs), self.count * len(legs)
        self.tries = MOST_TRIES

        def joined(solid: Solid, other: Solid) -> bool:
            shared = {*solid.joints} & {*other.joints}
            return bool(shared if solid.leg == other.leg else shared & {self.axis, self.pin})

        # A disc always meets the bodies that it joins, so these pairs are left out.
        self.pairs = [
            (i, k)
            for (i, solid), (k, other) in combinations(enumerate(self.solids), 2)
            if (k < self.bodies or not joined(solid, other)) and _meet(solid, other)
        ]

    def order(self) -> list[int]:
        """Return the layers of each body as bits.

        The order has as few layers as possible and, among such orders, the shortest pins.

        Raises:
            CollisionError: If the links collide in every order that was tried. The message states
                the reason.
        """
        discs = [k for k in range(self.bodies, len(self.solids)) if not self.solids[k].on]
        for body, name in enumerate(self.linkage.names):
            if body >= CRANK and all((body, disc) in self.pairs for disc in discs):
                raise CollisionError(f"{name} sweeps over the shaft and over the crank pin")
        for count in range(2 * WEB + 3, MOST_LAYERS):
            layers, last = [0] * self.bodies, self.bodies - self.count
            for body, edge in ((FRAME - 1, 0), (CRANK - 1, WEB)):
                layers[body] |= 1 << edge  # first leg at one end, last leg at the other end
                layers[last + body] |= 1 << count - 1 - edge
            length, best = self._search(count, layers, (math.inf, []))
            if length < math.inf:
                return best
        raise CollisionError(f"{MOST_TRIES - max(self.tries, 0)} orders of the links collide")

    def _search(self, count: int, layers: list[int], best: Order) -> Order:
        """Place the bodies without a layer; return the shortest order found, or ``best``."""
        length = self._length(count, layers)
        left = [body for body in range(self.count) if not layers[body]]
        if length >= best[0] or not left:
            return min(best, (length, layers), key=lambda order: order[0])
        body = min(left, key=lambda body: self.pin not in self.solids[body].joints)
        edge = WEB + 1 if self.pin in self.solids[body].joints else 1
        for layer in range(edge, count - edge):
            tried = [*layers]
            tried[body] = 1 << layer
            if self.bodies > self.count:
                tried[self.count + body] = 1 << count - 1 - layer
            best = self._search(count, tried, best)
        return best

    def _length(self, count: int, layers: list[int]) -> float:
        """Return the number of layers that all discs occupy together.

        The number is infinite if solids collide, or if no tries are left. Bodies without a layer
        are ignored.
        """
        self.tries -= 1
        if self.tries < 0 or any(layers[i] & layers[k] for i, k in self.pairs if k < self.bodies):
            return math.inf
        spans = [self._span(count, layers, disc) for disc in self.solids[self.bodies :]]
        taken = layers + spans
        if min(spans) < 0 or any(taken[i] & taken[k] for i, k in self.pairs):
            return math.inf
        return sum(span.bit_count() for span in spans)

    def _span(self, count: int, layers: list[int], disc: Solid) -> int:
        """Return the layers of a disc as bits; -1 if the disc extends beyond the unit."""
        every = (1 << count) - 1
        if disc.joints == self.pin:
            return every >> WEB - 1 & every << WEB - 1
        if disc.joints == self.axis:
            return every & ~(every >> WEB + 1 & every << WEB + 1)
        on = [layers[body] for body in disc.on if layers[body]]
        if not on:
            return 0
        low = min((bits & -bits).bit_length() for bits in on) - 1 - disc.beyond
        high = max(bits.bit_length() for bits in on) + disc.beyond
        if disc.joints in self.linkage.bodies[0][1]:
            low, high = max(low, 0), min(high, count)
        return (1 << high) - (1 << low) if low >= 0 and high <= count else -1


def layers(robot: Robot) -> list[Placed]:
    """Return every part of every leg at its position along the shaft, unit by unit.

    Raises:
        CollisionError: If the links of a unit collide in every order.
        ValueError: If a part cannot be made.
        LinkageError: If the linkage of a leg does not close.
    """
    known: dict[tuple[str, ...], tuple[list[tuple[int, int]], set[str]]] = {}
    parts = [link_part(robot, body) for body in range(1, len(robot.bodies) + 1)]
    placed, start = [], 0.0
    for number, legs in enumerate(units(robot)):
        sides = tuple(robot.legs[leg].side for leg in legs)
        if sides not in known:
            unit = Unit(robot, legs)
            order = unit.order()
            spots = [
                (layer, k)
                for layer in range(MOST_LAYERS)
                for k, bits in enumerate(order)
                if bits >> layer & 1
            ]
            short = {disc.joints for disc in unit.solids[unit.bodies :]}
            known[sides] = spots, {*robot.linkage.bodies[0][1]} - short
        spots, through = known[sides]
        heights = [0.0] * (1 + spots[-1][0])
        heights[WEB - 1] = heights[-WEB] = 1e3 * robot.build.hub_length
        for layer, k in spots:
            heights[layer] = max(heights[layer], parts[k % len(parts)].thickness)
        heights = [height or EMPTY for height in heights]
        for layer, k in spots:
            leg, body = divmod(k, len(parts))
            z = start + sum(heights[:layer]) + GAP * layer
            z += 0.5 * (heights[layer] - parts[body].thickness)
            axles = "".join(joint for joint in parts[body].joints if joint in through)
            placed.append(Placed(number, legs[leg], body + 1, layer, z, parts[body], axles))
        start += sum(heights) + GAP * (len(heights) - 1) + UNIT_GAP
    return placed
