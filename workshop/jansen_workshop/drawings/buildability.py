"""Check that a machine can be built.

:func:`faults` turns the crank and lists what cannot be built: solids that overlap, screws without
an aligned hole of their size, screws that do not reach their nut or do not enter their thread far
enough, and threads in materials other than metal. All lengths are in mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_workshop.drawings.assembly import Assembly
from jansen_workshop.drawings.convex import Points, gap
from jansen_workshop.drawings.solids import Cavity, Screw, Solid

METAL = 2500.0  # lowest density of a metal, in kg/m^3
TURN = 180  # number of crank angles at which overlaps are checked
SCREW_ANGLES = (0.0, 1.0, 2.5, 4.0)  # crank angles at which screws are checked, in rad
TOUCH = 1e-3  # largest overlap that rounding causes between two faces that touch
ALIGNED = 0.02  # largest distance between the axes of a screw and its hole
LOOSE = 0.4  # largest difference between the radii of a hole and its screw
OPEN = 1.0  # least clearance around a screw in an opening that is not its hole
WIDE = ("spacer", "ring")  # pieces that screws pass through with more clearance


def faults(assembly: Assembly, angles: int = TURN) -> list[str]:
    """Return the reasons why a machine cannot be built.

    Args:
        assembly: Solids of the machine.
        angles: Number of crank angles at which overlaps are checked.

    Returns:
        One sentence per fault. The list is empty if there are no faults.
    """
    return [*_overlaps(assembly, angles), *_soft_threads(assembly), *_screw_faults(assembly)]


# Overlaps


class _Moving(NamedTuple):
    """Solid at all crank angles.

    Attributes:
        solid: The solid.
        name: Name and size of its piece.
        places: Positions of its corners, shape (angles, corners), or (1, corners) if it is fixed.
        middle: Mean of the corners, shape (angles,) or (1,).
        reach: Distance from the mean within which the solid lies.
    """

    solid: Solid
    name: str
    places: Points
    middle: Points
    reach: float


def _moving(assembly: Assembly, solid: Solid, psi: NDArray[np.float64]) -> _Moving:
    """Return a solid at crank angles."""
    piece = assembly.pieces[solid.piece]
    name = f"{piece.name} {piece.size}".strip()
    places = assembly.corner_positions(solid, psi)
    middle = places.mean(axis=-1)
    reach = float(abs(places - middle[:, None]).max()) + solid.outline.radius
    return _Moving(solid, name, places, middle, reach)


def _overlaps(assembly: Assembly, angles: int) -> Iterator[str]:
    """Yield a description of each pair of solids that overlap at some crank angle."""
    psi = np.linspace(0.0, 2.0 * math.pi, angles, endpoint=False)
    found = set()
    for a, b in _neighbours([_moving(assembly, solid, psi) for solid in assembly.solids]):
        if _drilled_together(assembly, a.solid, b.solid):
            continue
        depth = _depth(assembly, a, b, psi)
        names = f"{a.name} and {b.name}"
        if depth > TOUCH and names not in found:
            found.add(names)
            low, high = _common(a.solid, b.solid)
            yield (
                f"{names} overlap by {depth:.2f} mm in the plane and {high - low:.2f} along, "
                f"between {low:.1f} and {high:.1f} mm"
            )


def _neighbours(solids: list[_Moving]) -> Iterator[tuple[_Moving, _Moving]]:
    """Yield pairs of solids of different pieces that are close to one another, lower one first."""
    ordered = sorted(solids, key=lambda moving: moving.solid.low)
    for n, lower in enumerate(ordered):
        for upper in ordered[n + 1 :]:
            if upper.solid.low > lower.solid.high - TOUCH:
                break
            low, high = _common(lower.solid, upper.solid)
            if high - low < TOUCH or lower.solid.piece == upper.solid.piece:
                continue
            if abs(lower.middle - upper.middle).min() <= lower.reach + upper.reach:
                yield lower, upper


def _common(solid: Solid, other: Solid) -> tuple[float, float]:
    """Return the ends of what two solids have in common along the shaft."""
    return max(solid.low, other.low), min(solid.high, other.high)


def _drilled_together(assembly: Assembly, solid: Solid, other: Solid) -> bool:
    """Return whether one solid may cross the other because they are drilled together."""
    name = assembly.pieces[solid.piece].name
    other_name = assembly.pieces[other.piece].name
    return name in other.drilled or other_name in solid.drilled


def _depth(assembly: Assembly, a: _Moving, b: _Moving, psi: NDArray[np.float64]) -> float:
    """Return how far two solids overlap in the plane, in mm; 0 if one is in a hole of the other."""
    times = max(len(a.places), len(b.places))
    a_places = np.broadcast_to(a.places, (times, a.places.shape[1]))
    b_places = np.broadcast_to(b.places, (times, b.places.shape[1]))
    apart = gap(a_places, b_places) - a.solid.outline.radius - b.solid.outline.radius
    if apart.min() >= -TOUCH:
        return 0.0
    low, high = _common(a.solid, b.solid)
    for outer, inner in ((a.solid, b), (b.solid, a)):
        for cavity in outer.cavities:
            if _is_hole(cavity, low, high):
                hole = assembly.positions(outer, cavity.outline.corners, psi)
                if _inside(inner, hole, cavity.outline.radius):
                    return 0.0
    return -float(apart.min())


def _is_hole(cavity: Cavity, low: float, high: float) -> bool:
    """Return whether a cavity is a round hole that reaches from ``low`` to ``high``."""
    through = cavity.low <= low + TOUCH and cavity.high >= high - TOUCH
    return through and len(cavity.outline.corners) == 1


def _inside(inner: _Moving, hole: Points, radius: float) -> bool:
    """Return whether a solid lies within a round hole at all crank angles."""
    reach = abs(inner.places - hole[..., :1]).max() + inner.solid.outline.radius
    return bool(reach <= radius + TOUCH)


# Screws


def _soft_threads(assembly: Assembly) -> Iterator[str]:
    """Yield a description of each thread in a material that does not hold one."""
    for solid in assembly.solids:
        if any(cavity.thread for cavity in solid.cavities) and 0.0 < solid.density < METAL:
            yield f"{assembly.pieces[solid.piece].name} has a thread, but is not made of metal"


def _screw_faults(assembly: Assembly) -> Iterator[str]:
    """Yield what is wrong with each screw: its holes, and its depth in a nut or thread."""
    for screw in assembly.screws:
        piece = assembly.pieces[assembly.solids[screw.shank].piece]
        for fault in (*_hole_faults(assembly, screw), *_thread_faults(assembly, screw)):
            yield f"{piece.name} {piece.size} {fault}"


def _hole_faults(assembly: Assembly, screw: Screw) -> Iterator[str]:
    """Yield a description of each piece that has no fitting hole for a screw."""
    psi = np.array(SCREW_ANGLES)
    shank = assembly.solids[screw.shank]
    axis = assembly.corner_positions(shank, psi)
    for solid in assembly.solids:
        low, high = _common(solid, shank)
        if high - low < TOUCH or solid.piece == shank.piece:
            continue
        if not _crosses(solid, assembly.corner_positions(solid, psi), axis):
            continue
        name = assembly.pieces[solid.piece].name
        rooms = _rooms(assembly, screw, solid)
        if not rooms:
            yield f"has no aligned hole in {name}"
        elif name not in WIDE and min(rooms) > screw.radius + LOOSE:
            yield f"has a hole of {2 * min(rooms):.2f} mm in {name}"


def _crosses(solid: Solid, places: Points, axis: Points) -> bool:
    """Return whether the axis of a screw crosses a solid at some crank angle."""
    times = max(len(places), len(axis))
    distance = gap(
        np.broadcast_to(places, (times, places.shape[1])),
        np.broadcast_to(axis, (times, 1)),
    )
    return bool(distance.min() <= solid.outline.radius)


def _rooms(assembly: Assembly, screw: Screw, solid: Solid) -> list[float]:
    """Return the radii of the holes of a solid through which a screw passes.

    A hole with a bush, and an opening that is far wider than the screw, count as fitting exactly.
    """
    psi = np.array(SCREW_ANGLES)
    shank = assembly.solids[screw.shank]
    axis = assembly.corner_positions(shank, psi)
    low, high = _common(solid, shank)
    rooms = []
    for cavity in solid.cavities:
        if not _is_hole(cavity, low, high):
            continue
        off = abs(assembly.positions(solid, cavity.outline.corners, psi) - axis).max()
        radius = cavity.outline.radius
        if off < ALIGNED:
            rooms.append(screw.radius if cavity.bushed else radius)
        elif off < radius - screw.radius - OPEN:
            rooms.append(screw.radius)
    return rooms


def _thread_faults(assembly: Assembly, screw: Screw) -> Iterator[str]:
    """Yield a description of a screw that enters its nut or thread too little."""
    if screw.into == screw.shank:
        return
    thread = assembly.solids[screw.into]
    low, high = _common(thread, assembly.solids[screw.shank])
    depth = high - low
    needed = thread.high - thread.low if screw.nut else 2.0 * screw.radius
    if depth < needed - TOUCH:
        name = assembly.pieces[thread.piece].name
        yield f"enters {name} by {depth:.1f} mm instead of {needed:.1f} mm"
