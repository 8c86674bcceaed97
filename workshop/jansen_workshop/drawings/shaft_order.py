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
from jansen_workshop.drawings.convex import Points, gap
from jansen_workshop.drawings.mount import units
from jansen_workshop.drawings.outlines import CutPart, link_part

CLEARANCE = 1.0  # least distance between parts in the same layer, in mm
GAP = 1.0  # distance between layers (a washer), in mm
UNIT_GAP = 6.0  # distance between units (heads of pins), in mm
EMPTY = 5.0  # height of a layer without links, which has heads of pins or treads, in mm
SAMPLES = 720  # number of crank angles per turn at which collisions are checked
WEB = 2  # number of layers from a unit's end to a web
# Limits of the search, which takes at most 30 s: layers of a unit, and orders that are tried.
MOST_LAYERS = 24
MOST_TRIES = 400_000


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


class Spot(NamedTuple):
    """Place of a body in a unit.

    Attributes:
        layer: Index of the layer.
        body: Index of the body among the bodies of all legs of the unit, leg by leg.
    """

    layer: int
    body: int


class Layering(NamedTuple):
    """Order of the bodies of a unit along the shaft.

    Attributes:
        length: Number of layers that all discs occupy together; infinite if shapes collide.
        layers: Layers of each body as bits.
    """

    length: float
    layers: list[int]


class SweptShape(NamedTuple):
    """Body, or disc around a joint, with its positions during a turn of the crank.

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
    origin, second, *_ = part.joints.values()
    bar = second - origin
    from_origin = np.array(points) - origin
    if side == "back":
        bar = bar.conjugate()
        from_origin = from_origin.conj()
    turn = (joints[..., 1] - joints[..., 0]) / bar
    return joints[..., :1] + turn[..., None] * from_origin


def _meet(shape: SweptShape, other: SweptShape) -> bool:
    """Return whether two shapes come closer than :data:`CLEARANCE` during a turn."""
    return bool(gap(shape.places, other.places).min() < shape.radius + other.radius + CLEARANCE)


def _shapes(robot: Robot, legs: Sequence[int]) -> list[SweptShape]:
    """Return the bodies of the legs, leg by leg, followed by the discs."""
    psi = 2.0 * math.pi / SAMPLES * np.arange(SAMPLES)
    bodies: list[SweptShape] = []
    discs: list[SweptShape] = []
    for leg in legs:
        at = joint_positions(robot, robot.legs[leg].side, psi) @ np.array([1e3, 1e3j])
        first = len(bodies)
        links = _links(robot, leg, at)
        discs += _treads(robot, leg, at, first)
        bodies += links
        discs += _pin_discs(robot, leg, at, links, first, shared=leg == legs[0])
    return bodies + discs


def _links(robot: Robot, leg: int, at: Points) -> list[SweptShape]:
    """Return the bodies of a leg.

    Args:
        robot: Robot that the leg belongs to.
        leg: Index of the leg.
        at: Positions of the leg's joints at each crank angle, shape (SAMPLES, joints).
    """
    links = []
    for body, members in enumerate(robot.linkage.members, 1):
        part = link_part(robot, body)
        places = carried(part, part.outline.corners, at[:, members], robot.legs[leg].side)
        joints = robot.linkage.bodies[body - 1][1]
        links.append(SweptShape(leg, joints, places, part.outline.radius))
    return links


def _treads(robot: Robot, leg: int, at: Points, first: int) -> list[SweptShape]:
    """Return the discs around the toes of a leg, whose first body has the index ``first``."""
    radius = 1e3 * robot.build.foot_radius
    layers = robot.build.tread_layers
    return [
        SweptShape(leg, toe, at[:, [robot.linkage.joints.index(toe)]], radius, (first + k,), layers)
        for k in range(len(robot.linkage.bodies))
        for toe in feet_of(robot, k + 1)
    ]


def _pin_discs(
    robot: Robot, leg: int, at: Points, links: Sequence[SweptShape], first: int, *, shared: bool
) -> list[SweptShape]:
    """Return the discs around the joints of a leg.

    A fixed pivot has no disc if no body sweeps over it: an axle through the machine bears it.

    Args:
        robot: Robot that the leg belongs to.
        leg: Index of the leg.
        at: Positions of the leg's joints at each crank angle, shape (SAMPLES, joints).
        links: Bodies of the leg.
        first: Index of the leg's first body among the bodies of the unit.
        shared: Whether the discs at the crank axis and the crank pin, which the legs of a unit
            share, are included.
    """
    linkage = robot.linkage
    spacer = 1e3 * robot.build.spacer_radius
    axis, pin, *_ = [*linkage.bodies[CRANK - 1][1]]
    discs = []
    for k, joint in enumerate(linkage.joints):
        on = tuple(first + i for i, body in enumerate(links) if joint in body.joints)
        disc = SweptShape(leg, joint, at[:, [k]], spacer, on)
        if joint in (axis, pin):
            if shared:
                radius = 1e3 * robot.build.hub_radius if joint == axis else spacer
                discs.append(disc._replace(radius=radius, on=()))
        elif len(on) > 1 and (joint not in linkage.bodies[0][1] or _swept(robot, disc, links)):
            discs.append(disc)
    return discs


def _swept(robot: Robot, pivot: SweptShape, bodies: Sequence[SweptShape]) -> bool:
    """Return whether a body of a leg sweeps over the tube around a fixed pivot.

    The pivots of both sides are checked if the robot has legs on both sides.
    """
    tube = pivot._replace(radius=1e3 * robot.build.tube_radius)
    tubes = [tube]
    if len({leg.side for leg in robot.legs}) > 1:
        tubes.append(tube._replace(places=-tube.places.conj()))
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
        shapes: Bodies of the legs, followed by the discs.
        bodies: Number of bodies among the shapes.
        tries: Number of orders that the search may still try.
        pairs: Pairs of indices of shapes that meet during a turn.
    """

    def __init__(self, robot: Robot, legs: Sequence[int]) -> None:
        self.linkage = robot.linkage
        self.count = len(robot.bodies)
        self.axis, self.pin, *_ = [*self.linkage.bodies[CRANK - 1][1]]
        self.shapes = _shapes(robot, legs)
        self.bodies = self.count * len(legs)
        self.tries = MOST_TRIES
        # A disc always meets the bodies that it joins, so these pairs are left out.
        self.pairs = [
            (i, k)
            for (i, shape), (k, other) in combinations(enumerate(self.shapes), 2)
            if (k < self.bodies or not self._joined(shape, other)) and _meet(shape, other)
        ]

    def _joined(self, shape: SweptShape, other: SweptShape) -> bool:
        """Return whether two shapes share a joint."""
        shared = {*shape.joints} & {*other.joints}
        if shape.leg != other.leg:  # the legs share only the crank axis and the crank pin
            shared &= {self.axis, self.pin}
        return bool(shared)

    def order(self) -> list[int]:
        """Return the layers of each body as bits.

        The order has as few layers as possible and, among such orders, the shortest pins.

        Raises:
            CollisionError: If the links collide in every order that was tried. The message states
                the reason.
        """
        discs = [k for k in range(self.bodies, len(self.shapes)) if not self.shapes[k].on]
        for body, name in enumerate(self.linkage.names):
            if body >= CRANK and all((body, disc) in self.pairs for disc in discs):
                raise CollisionError(f"{name} sweeps over the shaft and over the crank pin")
        for count in range(2 * WEB + 3, MOST_LAYERS):
            layers = [0] * self.bodies
            last = self.bodies - self.count
            for body, edge in ((FRAME - 1, 0), (CRANK - 1, WEB)):
                layers[body] |= 1 << edge  # first leg at one end, last leg at the other end
                layers[last + body] |= 1 << count - 1 - edge
            best = self._search(count, layers, Layering(math.inf, []))
            if best.length < math.inf:
                return best.layers
        tried = MOST_TRIES - max(self.tries, 0)
        raise CollisionError(f"the links collide in all {tried} orders that were tried")

    def _search(self, count: int, layers: list[int], best: Layering) -> Layering:
        """Place the bodies without a layer; return the shortest order found, or ``best``."""
        length = self._length(count, layers)
        left = [body for body in range(self.count) if not layers[body]]
        if length >= best.length:
            return best
        if not left:
            return Layering(length, layers)
        body = min(left, key=lambda body: self.pin not in self.shapes[body].joints)
        edge = WEB + 1 if self.pin in self.shapes[body].joints else 1
        for layer in range(edge, count - edge):
            tried = [*layers]
            tried[body] = 1 << layer
            if self.bodies > self.count:
                tried[self.count + body] = 1 << count - 1 - layer
            best = self._search(count, tried, best)
        return best

    def _length(self, count: int, layers: list[int]) -> float:
        """Return the number of layers that all discs occupy together.

        The number is infinite if shapes collide, or if no tries are left. Bodies without a layer
        are ignored.
        """
        self.tries -= 1
        if self.tries < 0 or any(layers[i] & layers[k] for i, k in self.pairs if k < self.bodies):
            return math.inf
        spans = [self._span(count, layers, disc) for disc in self.shapes[self.bodies :]]
        taken = layers + spans
        if min(spans) < 0 or any(taken[i] & taken[k] for i, k in self.pairs):
            return math.inf
        return sum(span.bit_count() for span in spans)

    def _span(self, count: int, layers: list[int], disc: SweptShape) -> int:
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
            low = max(low, 0)
            high = min(high, count)
        return (1 << high) - (1 << low) if low >= 0 and high <= count else -1


def layers(robot: Robot) -> list[Placed]:
    """Return every part of every leg at its position along the shaft, unit by unit.

    Args:
        robot: Robot that the machine is built from.

    Raises:
        CollisionError: If the links of a unit collide in every order.
        ValueError: If a part cannot be made.
        LinkageError: If the linkage of a leg does not close.
    """
    known: dict[tuple[str, ...], tuple[list[Spot], set[str]]] = {}
    parts = [link_part(robot, body) for body in range(1, len(robot.bodies) + 1)]
    placed = []
    start = 0.0
    for number, legs in enumerate(units(robot)):
        sides = tuple(robot.legs[leg].side for leg in legs)
        if sides not in known:  # equal units have the same order
            known[sides] = _ordered(robot, legs)
        spots, through = known[sides]
        heights = _heights(robot, spots, parts)
        for layer, k in spots:
            leg, body = divmod(k, len(parts))
            z = start + sum(heights[:layer]) + GAP * layer
            z += 0.5 * (heights[layer] - parts[body].thickness)
            axles = "".join(joint for joint in parts[body].joints if joint in through)
            placed.append(Placed(number, legs[leg], body + 1, layer, z, parts[body], axles))
        start += sum(heights) + GAP * (len(heights) - 1) + UNIT_GAP
    return placed


def _ordered(robot: Robot, legs: Sequence[int]) -> tuple[list[Spot], set[str]]:
    """Return the bodies of a unit in order, and the names of the pivots that axles bear."""
    unit = Unit(robot, legs)
    order = unit.order()
    spots = [
        Spot(layer, k)
        for layer in range(MOST_LAYERS)
        for k, bits in enumerate(order)
        if bits >> layer & 1
    ]
    with_disc = {disc.joints for disc in unit.shapes[unit.bodies :]}
    return spots, {*robot.linkage.bodies[0][1]} - with_disc


def _heights(robot: Robot, spots: Sequence[Spot], parts: Sequence[CutPart]) -> list[float]:
    """Return the height of each layer of a unit, in mm."""
    heights = [0.0] * (1 + spots[-1].layer)
    heights[WEB - 1] = heights[-WEB] = 1e3 * robot.build.hub_length
    for layer, k in spots:
        heights[layer] = max(heights[layer], parts[k % len(parts)].thickness)
    return [height or EMPTY for height in heights]
