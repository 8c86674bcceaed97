"""Order of the parts along the shaft, in which nothing that moves meets anything else.

A crank pin carries a unit: a fore and a back leg, or one leg. From end to end a unit is a frame, a
hub, a web (the crank), links, and again web, hub and frame. The shaft ends at either web, because
links sweep over its axis between them; the crank pin joins the webs. Every link lies in a layer. A
unit of two legs is its own image when it is turned about the vertical, so both legs are alike.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from jansen_env.drawings.mount import units
from jansen_env.drawings.outlines import CutPart, Points, feet_of, gap, link_part
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME

Order = tuple[float, list[int]]  # the length of all discs in layers, the layers of bodies as bits

CLEARANCE = 1.0  # mm, between parts of a layer
GAP, UNIT_GAP = 1.0, 6.0  # mm, between layers (a washer), and between units (heads of pins)
EMPTY = 5.0  # mm, height of a layer that has no link but heads of pins or treads
SAMPLES = 720  # of a turn
WEB = 2  # layers from a unit's end to a web
MOST_LAYERS, MOST_TRIES = 24, 400_000  # of the search; it takes half a minute at most


class CollisionError(ValueError):
    """The links of a unit collide in any order."""


class Placed(NamedTuple):
    """A part on the shaft: its unit, its leg, its body from 1 on, its layer in the unit.

    Its lower face is ``z`` mm from the machine's first one; axles through the whole machine bear
    its joints ``through``.
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
        """Its upper face, mm."""
        return self.z + self.part.thickness


class Solid(NamedTuple):
    """A body, or a disc about a joint: a pin with its head and nut, a tread, the shaft with a hub.

    ``places`` are (SAMPLES, corners) mm. A disc takes the layers of the solids numbered in ``on``,
    those between them, and ``beyond`` more on either side.
    """

    leg: int
    joints: str
    places: Points
    radius: float
    on: tuple[int, ...] = ()
    beyond: int = 1


def carried(part: CutPart, points: Sequence[complex], joints: Points, side: str) -> Points:
    """Places of points of a part (..., points), from those of its joints (..., joints), mm.

    A back leg's part is seen from behind.
    """
    drawn, on = np.array([*part.joints.values()]), np.array(points)
    if side == "back":
        drawn, on = drawn.conj(), on.conj()
    turn = (joints[..., 1] - joints[..., 0]) / (drawn[1] - drawn[0])
    return joints[..., :1] + turn[..., None] * (on - drawn[0])


def _meet(solid: Solid, other: Solid) -> bool:
    return bool(gap(solid.places, other.places).min() < solid.radius + other.radius + CLEARANCE)


def _solids(robot: Robot, legs: Sequence[int]) -> list[Solid]:
    """Bodies of the legs, leg by leg, then all discs but those of axles that nothing meets."""
    build, linkage = robot.build, robot.linkage
    spacer, psi = 1e3 * build.spacer_radius, 2.0 * math.pi / SAMPLES * np.arange(SAMPLES)
    axis, pin, *_ = [*linkage.bodies[CRANK - 1][1]]  # of all legs
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
    """Whether bodies of a leg sweep over the tube about a fixed pivot of either side."""
    tube = pivot._replace(radius=1e3 * robot.build.tube_radius)
    tubes = [tube, tube._replace(places=-tube.places.conj())]
    del tubes[len({leg.side for leg in robot.legs}) :]
    return any(_meet(t, body) for body in bodies for t in tubes[pivot.joints in body.joints :])


class Unit:
    """Legs on one crank pin: what meets what in a turn, and the layers in which nothing meets."""

    def __init__(self, robot: Robot, legs: Sequence[int]) -> None:
        self.linkage, self.count = robot.linkage, len(robot.bodies)
        self.axis, self.pin, *_ = [*self.linkage.bodies[CRANK - 1][1]]
        self.solids, self.bodies = _solids(robot, legs), self.count * len(legs)
        self.tries = MOST_TRIES

        def joined(solid: Solid, other: Solid) -> bool:
            shared = {*solid.joints} & {*other.joints}
            return bool(shared if solid.leg == other.leg else shared & {self.axis, self.pin})

        self.pairs = [
            (i, k)
            for (i, solid), (k, other) in combinations(enumerate(self.solids), 2)
            if (k < self.bodies or not joined(solid, other)) and _meet(solid, other)
        ]  # a disc is meant to be where its bodies are

    def order(self) -> list[int]:
        """Layers of each body as bits, as few as possible, then with the shortest pins.

        Raises CollisionError: there is no such order; says why.
        """
        discs = [k for k in range(self.bodies, len(self.solids)) if not self.solids[k].on]
        for body, name in enumerate(self.linkage.names):
            if body >= CRANK and all((body, disc) in self.pairs for disc in discs):
                raise CollisionError(f"{name} sweeps over the shaft and over the crank pin")
        for count in range(2 * WEB + 3, MOST_LAYERS):
            layers, last = [0] * self.bodies, self.bodies - self.count
            for body, edge in ((FRAME - 1, 0), (CRANK - 1, WEB)):
                layers[body] |= 1 << edge  # of the first leg at one end, of the last at the other
                layers[last + body] |= 1 << count - 1 - edge
            length, best = self._search(count, layers, (math.inf, []))
            if length < math.inf:
                return best
        raise CollisionError(f"{MOST_TRIES - max(self.tries, 0)} orders of the links collide")

    def _search(self, count: int, layers: list[int], best: Order) -> Order:
        """Place the bodies without a layer so that the length is less than that of the best."""
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
        """Layers that all discs go through; infinite if things meet. Bodies may have no layer."""
        self.tries -= 1
        if self.tries < 0 or any(layers[i] & layers[k] for i, k in self.pairs if k < self.bodies):
            return math.inf
        spans = [self._span(count, layers, disc) for disc in self.solids[self.bodies :]]
        taken = layers + spans
        if min(spans) < 0 or any(taken[i] & taken[k] for i, k in self.pairs):
            return math.inf
        return sum(span.bit_count() for span in spans)

    def _span(self, count: int, layers: list[int], disc: Solid) -> int:
        """Layers of a disc as bits, negative if it reaches out of the unit."""
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
    """Every part of every leg in its place along the shaft, unit by unit.

    Raises CollisionError: links collide in any order; ValueError: a part cannot be made;
    LinkageError: a leg does not close.
    """
    known: dict[tuple[str, ...], tuple[list[tuple[int, int]], set[str]]] = {}
    parts = [link_part(robot, body) for body in range(1, len(robot.bodies) + 1)]
    placed, start = [], 0.0
    for number, legs in enumerate(units(robot)):
        sides = tuple(robot.legs[leg].side for leg in legs)
        if sides not in known:
            unit = Unit(robot, legs)
            order = unit.order()
            spots = [(layer, k) for layer in range(MOST_LAYERS)
                     for k, bits in enumerate(order) if bits >> layer & 1]  # fmt: skip
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
