"""Link lengths of a robot by name, and copies of a robot with other link lengths.

The names begin with the name of the body:

- ``upper_rod`` is the length of a bar.
- ``foot_CE`` is the side of a triangle between the joints C and E.
- ``foot_FJ`` is the distance between the first two joints of a plate. ``foot_T_along`` and
  ``foot_T_across`` are the coordinates of another joint relative to the first joint, along the line
  to the second joint and to the left of this line.

All lengths are in m. The angle of the frame in the chassis, ``frame_angle`` in rad, counts as a
length, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import invalid, listed, named_errors, shown
from jansen_env.engine.link_shapes import put_lengths, resize
from jansen_env.robot.designs import is_of_built_parts, with_built_parts
from jansen_env.robot.links import LENGTH, PLACE, Bar, Link, Plate, Triangle, within_a_turn
from jansen_env.robot.robot import Robot
from jansen_env.robot.robot_arrays import NUMBERS, leg_links


def lengths(robot: Robot) -> dict[str, float]:
    """Return all lengths of a robot by name, in m, and ``frame_angle`` in rad."""
    known: dict[str, float] = {}
    most = max(len(joints) for _, joints in robot.linkage.bodies)
    values = np.zeros((len(robot.bodies), max(3, 2 * most - 3)))
    put_lengths(*leg_links(robot), values)
    bodies = zip(robot.linkage.bodies, robot.bodies, values.tolist(), strict=True)
    for (name, joints), link, numbers in bodies:
        known.update(zip(_names(name, joints, link), numbers, strict=False))
    known["frame_angle"] = robot.frame_angle
    return known


def is_signed(name: str) -> bool:
    """Return whether a length may be negative, because it is an angle or a coordinate."""
    return name == "frame_angle" or name.endswith(("_along", "_across"))


def length_names(robot: Robot) -> list[list[str]]:
    """Return a list of the names of its lengths for each body."""
    bodies = zip(robot.linkage.bodies, robot.bodies, strict=True)
    return [_names(*body, link) for body, link in bodies]


def with_lengths(robot: Robot, changed: Mapping[str, float]) -> Robot:
    """Return a copy of the robot with some other lengths, in the same material.

    If the robot consists of the parts of the robot ``built``, the copy consists of such parts with
    the new lengths. Otherwise each changed link keeps its mass per metre of its sides, and the way
    in which this mass is distributed. The function does not check whether the linkage closes. That
    is checked when the robot is compiled.

    Args:
        robot: The robot.
        changed: New lengths in m, and ``frame_angle`` in rad, by the names of :func:`lengths`.

    Raises:
        ValueError: If a name is unknown, a length is out of range, or three lengths do not form a
            triangle.
    """
    known = lengths(robot)
    if not isinstance(changed, Mapping):
        raise ValueError(
            f"lengths must be a dictionary with some of {[*known]}, got {shown(changed)}"
        )
    if unknown := [name for name in changed if name not in known]:
        allowed = listed(known, unknown[0])
        raise invalid("a key of lengths", unknown[0], f"one of {allowed}")
    new = {**known}
    for name, value in changed.items():
        if name == "frame_angle":
            new[name] = within_a_turn(f"lengths[{name!r}]", value)
        else:
            limits = PLACE if is_signed(name) else LENGTH
            new[name] = limits.check(f"lengths[{name!r}]", value)
    resized = _resized(robot, known, new)
    return replace(resized, frame_angle=new["frame_angle"])


def _resized(robot: Robot, known: Mapping[str, float], new: Mapping[str, float]) -> Robot:
    """Return a copy of the robot whose links have other lengths.

    Args:
        robot: The robot.
        known: Present lengths of the robot by name, in m.
        new: New lengths by name, in m.
    """
    rows = leg_links(robot)
    built = is_of_built_parts(robot)
    before = _length_rows(robot, known)
    after = _length_rows(robot, new)
    links = np.empty_like(rows.links)
    points = np.empty_like(rows.points)
    work = np.empty((2, points.shape[1] + 1, 2))
    fault = resize(*rows, after, before, not built, links, points, work)
    changed: dict[str, Link] = {}
    for k, (name, joints) in enumerate(robot.linkage.bodies):
        names = _names(name, joints, robot.bodies[k])
        if all(new[key] == known[key] for key in names):
            continue
        with named_errors(f"lengths of {name}"):
            if k == fault:
                Triangle.from_sides(*(new[key] for key in names))
        given = ", ".join(f"lengths[{key!r}] of {new[key]:g} m" for key in names)
        with named_errors(f"{given}: {name} would be too large; lengths are in metres"):
            changed[name] = _link_of(robot.bodies[k], links[k], points[k, : len(joints)])
    resized = robot.with_bodies(**changed)
    if not (changed and built):
        return resized
    with named_errors(f"lengths of {', '.join(changed)}, in metres: parts would be too large"):
        return with_built_parts(resized)


def _link_of(link: Link, row: np.void, points: Array) -> Link:
    """Return a link of the same kind with other values.

    Args:
        link: The link.
        row: New values, a record of type ``LINK``.
        points: New positions of the joints, used only for a plate, in m, shape (joints, 2).
    """
    if isinstance(link, Plate):
        places = tuple((x, y) for x, y in points.tolist())
        return Plate(places, float(row["mass"]), float(row["inertia"]))
    numbers = {name: row[name].item() for name in NUMBERS if hasattr(link, name)}
    return replace(link, **numbers)


def _length_rows(robot: Robot, named: Mapping[str, float]) -> Array:
    """Return lengths by name as an array, shape (bodies, most lengths of a body)."""
    bodies = zip(robot.linkage.bodies, robot.bodies, strict=True)
    values = [[named[key] for key in _names(*body, link)] for body, link in bodies]
    rows = np.zeros((len(values), max(map(len, values))))
    for row, lengths_of_body in zip(rows, values, strict=True):
        row[: len(lengths_of_body)] = lengths_of_body
    return rows


def _names(name: str, joints: str, link: Link) -> list[str]:
    """Return the names of a link's lengths from the name and the joints of its body."""
    if isinstance(link, Bar):
        return [name]
    if isinstance(link, Triangle):
        return [f"{name}_{a}{b}" for a, b in pairwise(joints + joints[0])]
    others = [f"{name}_{joint}_{way}" for joint in joints[2:] for way in ("along", "across")]
    return [f"{name}_{joints[:2]}", *others]
