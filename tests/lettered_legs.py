"""A leg of Jansen's links, and of the same links assembled the other way round."""

from __future__ import annotations

import math
from dataclasses import replace

from jansen_env.robot import Bar, Leg, Robot, Triangle
from jansen_env.robot.linkage import JANSEN, Dyad, Pin

LENGTHS = {"a": 38.0, "b": 41.5, "c": 39.3, "d": 40.1, "e": 55.8, "f": 39.4, "g": 36.7, "h": 65.7,
           "i": 49.0, "j": 50.0, "k": 61.9, "l": 7.8, "m": 15.0}  # fmt: skip
"""Theo Jansen's lengths by his letters, taken as mm."""
DENSITY = 0.05  # kg/m of a link's sides
OTHER_WAY = replace(
    JANSEN,
    bodies=tuple((name, "PDB" if joints == "PBD" else joints) for name, joints in JANSEN.bodies),
    dyads=(Dyad("B", "A", "P", 1), *JANSEN.dyads[1:]),
)
"""The same links, the upper triangle turned over: B on the other side of the way from A to P."""
PINS = tuple(Pin("C", 8, 6) if pin == Pin("C", 8, 5) else pin for pin in JANSEN.pins)
"""At C the foot turns on the lower rod: one of the ways in which three links share a pin."""
LEGS = {"the other way": OTHER_WAY, "Jansen's leg": JANSEN}


def letters_leg(way: str) -> Robot:
    """Return a leg of thin bars without friction, one of LEGS."""
    s = {letter: 1e-3 * length for letter, length in LENGTHS.items()}
    upper = [s["b"], s["e"], s["d"]]
    sides = {
        "frame": [math.hypot(s["a"], s["l"])], "crank": [s["m"]], "upper_rod": [s["j"]],
        "rocker": [s["c"]], "lower_rod": [s["k"]], "coupler": [s["f"]],
        "upper_triangle": upper if LEGS[way] is JANSEN else upper[::-1],
        "foot": [s["g"], s["h"], s["i"]],
    }  # fmt: skip
    return Robot(
        linkage=replace(LEGS[way], pins=PINS),
        bodies=tuple(link(name, sides[name]) for name in JANSEN.names),
        frame_angle=math.atan2(s["l"], s["a"]),
        damping=(0.0,) * len(JANSEN.damped),
        legs=(Leg("fore"),),
    )


def link(name: str, sides: list[float]) -> Bar | Triangle:
    """Return a bar or triangle with these sides, m."""
    mass = DENSITY * math.fsum(sides)
    if len(sides) == 1:
        return Bar(sides[0], mass).slender()
    return Triangle.from_sides(*sides, mass=mass, outward=name == "foot").slender()
