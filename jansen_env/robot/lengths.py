"""Lengths of a robot by name, and the same robot with others.

Names are those of the bodies: ``upper_rod`` for a bar's length; ``foot_CE`` for a side of a
triangle, by its joints; of a plate ``foot_FJ`` between its first two joints, and ``foot_T_along``
and ``foot_T_across``, where another joint lies from the first, along that line and to its left.
``frame_angle`` turns the frame in the chassis, rad; all others are in m.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

from jansen_env.checks import finite, listed, named_errors, positive, shown
from jansen_env.engine.mathematics import cos, hypot, sin
from jansen_env.robot.designs import is_of_built_parts, with_built_parts
from jansen_env.robot.links import Bar, Link, Plate, Triangle, within_a_turn
from jansen_env.robot.robot import LONGEST, Robot


def lengths(robot: Robot) -> dict[str, float]:
    """Return all lengths of a robot by name, m; ``frame_angle`` in rad."""
    known: dict[str, float] = {}
    for (name, joints), link in zip(robot.linkage.bodies, robot.bodies, strict=True):
        known.update(zip(_names(name, joints, link), _values(link), strict=True))
    known["frame_angle"] = robot.frame_angle
    return known


def with_lengths(robot: Robot, changed: Mapping[str, float]) -> Robot:
    """Return the same robot with some other lengths, m, in the same material.

    A robot of the built robot's parts gets such parts of the new lengths. Of any other a link is as
    heavy per metre of its sides as before, and its mass is spread in the same way. Whether the
    linkage closes is found when the robot is compiled.

    Args:
        changed: by the names of :func:`lengths`.

    Raises:
        ValueError: another name, a length out of range, or three that form no triangle.
    """
    known = lengths(robot)
    if not isinstance(changed, Mapping):
        raise ValueError(
            f"lengths must be a dictionary with some of {[*known]}, got {shown(changed)}"
        )
    if unknown := [name for name in changed if name not in known]:
        allowed = listed(known, unknown[0])
        raise ValueError(f"lengths has {shown(unknown[0])}, must be of {allowed}")
    new = {**known}
    for name, value in changed.items():
        signed = name == "frame_angle" or name.endswith(("_along", "_across"))
        new[name] = (finite if signed else positive)(f"lengths[{name!r}]", value)
        if name == "frame_angle":
            within_a_turn(f"lengths[{name!r}]", value)
        elif abs(new[name]) > LONGEST:
            raise ValueError(
                f"lengths[{name!r}] must be at most {LONGEST:g} m, got {new[name]:g} m; lengths "
                "are in metres"
            )
    links, built = {}, is_of_built_parts(robot)
    for (name, joints), link in zip(robot.linkage.bodies, robot.bodies, strict=True):
        names = _names(name, joints, link)
        if any(new[key] != known[key] for key in names):
            fresh = _of_lengths(name, link, [new[key] for key in names])
            given = ", ".join(f"lengths[{key!r}] of {new[key]:g} m" for key in names)
            with named_errors(f"{given}: {name} would be too large; lengths are in metres"):
                links[name] = fresh if built else _as_dense(link, fresh)
    resized = replace(robot.with_bodies(**links), frame_angle=new["frame_angle"])
    if not (links and built):
        return resized
    with named_errors(f"lengths of {', '.join(links)}, in metres: parts would be too large"):
        return with_built_parts(resized)


def _names(name: str, joints: str, link: Link) -> list[str]:
    if isinstance(link, Bar):
        return [name]
    if isinstance(link, Triangle):
        return [f"{name}_{a}{b}" for a, b in pairwise(joints + joints[0])]
    others = [f"{name}_{joint}_{way}" for joint in joints[2:] for way in ("along", "across")]
    return [f"{name}_{joints[:2]}", *others]


def _values(link: Link) -> list[float]:
    """Return the lengths of a link, m."""
    if isinstance(link, Bar):
        return [link.length]
    if isinstance(link, Triangle):
        return [*link.sides]
    (x, y), (u, v), *others = link.points
    span = hypot(u - x, v - y)
    cos, sin = (u - x) / span, (v - y) / span
    values = [span]
    for a, b in others:
        values += [cos * (a - x) + sin * (b - y), cos * (b - y) - sin * (a - x)]
    return values


def _of_lengths(name: str, link: Link, values: list[float]) -> Link:
    with named_errors(f"lengths of {name}"):
        if isinstance(link, Bar):
            return Bar(values[0])
        if isinstance(link, Triangle):
            return Triangle.from_sides(*values, outward=link.outward)
        others = zip(values[1::2], values[2::2], strict=True)
        (x, y), (u, v) = link.points[:2]
        span = hypot(u - x, v - y)
        c, s = (u - x) / span, (v - y) / span  # the way of its first two joints
        places = [(0.0, 0.0), (values[0], 0.0), *others]
        return Plate.uniform([(c * a - s * b, s * a + c * b) for a, b in places])


def _as_dense(link: Link, fresh: Link) -> Link:
    """A link with as much mass a metre as another, spread as there."""
    mass = link.mass * _size(fresh) / _size(link)
    spread = _spread(fresh) / _spread(link)
    return replace(fresh, mass=mass, inertia=link.inertia * mass / link.mass * spread)


def _size(link: Link) -> float:
    """The sum of a link's sides, m."""
    count = len(link.corners)
    sides = math.fsum(link.distance(k, k + 1) for k in range(count - 1))
    return sides + (link.distance(0, count - 1) if count > 2 else 0.0)


def _spread(link: Link) -> float:
    """Inertia over mass of a rod or uniform plate about the same joints, m^2."""
    points = [(c * cos(o), c * sin(o)) for c, o in link.corners]
    return Plate.uniform(points, 1.0).inertia
