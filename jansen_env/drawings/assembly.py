"""Picture of a unit: from the side, and along the shaft with a bar for each part."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from jansen_env.drawings.materials import SHAFT_END
from jansen_env.drawings.outlines import Round
from jansen_env.drawings.shaft_order import Placed, carried
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK

ANGLE = 1.0  # rad, of the crank in the picture
HEAD = 4.5  # mm, of a pin, and of its nut
SIZE = (15.0, 7.5)  # inches


def assembly_svg(robot: Robot, placed: Sequence[Placed], title: str) -> str:
    """The first unit as SVG, the same text every time."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    unit = [one for one in placed if one.unit == 0]
    colors = [mpl.colormaps["tab10"](body % 10) for body in range(len(robot.bodies))]
    with mpl.rc_context({"svg.hashsalt": "jansen_env", "font.size": 9}):
        figure = Figure(figsize=SIZE, layout="constrained")
        side, order = figure.subplots(1, 2)
        figure.suptitle(title)
        _draw_side(side, robot, unit, colors)
        _draw_order(order, robot, unit, colors)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()


def _ring(shape: Round) -> list[complex]:
    """Points along a convex outline."""
    ways = np.exp(2j * np.pi * np.arange(120) / 120)
    corners = np.array(shape.corners)
    support = (corners * ways.conj()[:, None]).real.argmax(axis=1)
    ring: list[complex] = (corners[support] + shape.radius * ways).tolist()
    return ring


def _draw_side(axes: Any, robot: Robot, unit: Sequence[Placed], colors: Sequence[Any]) -> None:
    """Draw all parts as they lie at an angle of the crank, the first on the shaft on top."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    joints = robot.linkage.joints
    for one in reversed(unit):
        side = robot.legs[one.leg].side
        place = joint_positions(robot, side, ANGLE) @ np.array([1e3, 1e3j])
        at, shapes = place[[joints.index(name) for name in one.part.joints]], []
        for k, shape in enumerate((one.part.outline, *one.part.windows)):
            z = carried(one.part, _ring(shape)[:: -1 if k else 1], at, side)
            shapes.append(Path(np.array([z.real, z.imag]).T, closed=True))
        outline = Path.make_compound_path(*shapes)
        axes.add_patch(PathPatch(outline, facecolor=colors[one.body - 1], alpha=0.75))
        if one is unit[0]:
            for name, z in zip(joints, place, strict=True):
                axes.annotate(name, (z.real, z.imag), (6, 6), textcoords="offset points", zorder=3)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("mm")


def _draw_order(axes: Any, robot: Robot, unit: Sequence[Placed], colors: Sequence[Any]) -> None:
    """Draw a row for each joint of either leg, a bar for each part, a line for each pin."""
    axis, pin, *_ = [*robot.linkage.bodies[CRANK - 1][1]]
    others = [joint for joint in robot.linkage.joints if joint not in (axis, pin)]
    rows: dict[tuple[int, str], int] = {}
    for leg, way in zip(dict.fromkeys(one.leg for one in unit), (1, -1), strict=False):
        rows |= {(leg, axis): 0, (leg, pin): 1}
        rows |= {(leg, joint): way * (k + 1) + (way > 0) for k, joint in enumerate(others)}
    pinned = {one.joint for one in robot.linkage.pins} - {axis}
    end = unit[-1].z + unit[-1].part.thickness
    pins: dict[int, list[float]] = {}
    for one in unit:
        at = {joint: rows[one.leg, joint] for joint in one.part.joints}
        for joint in pinned & {*at}:
            faces = (0.0, end) if joint in one.through else (one.z, one.z + one.part.thickness)
            pins.setdefault(at[joint], []).extend(faces)
        # Parts of a leg in one layer share its width here.
        mates = [other for other in unit if (other.leg, other.layer) == (one.leg, one.layer)]
        width = one.part.thickness / len(mates)
        x, low, high = one.z + width * (mates.index(one) + 0.5), min(at.values()), max(at.values())
        axes.bar(x, high - low + 0.6, width, low - 0.3, color=colors[one.body - 1], edgecolor="k")
        axes.scatter([x] * len(at), [*at.values()], 22, "black", zorder=3)
        axes.text(x, (low + high) / 2, one.part.name.replace("_", " "), rotation=90, zorder=4,
                  ha="center", va="center", color="white", fontweight="bold")  # fmt: skip
    for row, sides in pins.items():
        ends = min(sides) - HEAD, max(sides) + HEAD
        axes.plot(ends, (row, row), "black", linewidth=2.5, zorder=0)
    first, last = (one for one in unit if one.body == CRANK)
    for shaft in ((-SHAFT_END, first.z), (last.z + last.part.thickness, end + SHAFT_END)):
        axes.plot(shaft, (0, 0), "dimgray", linewidth=7, solid_capstyle="butt", zorder=0)
    axes.set_yticks([*rows.values()], [joint for _, joint in rows])
    axes.set_xlabel("mm along the shaft; dots are joints of a part, lines pins with their heads")
    if min(rows.values()) < 0:
        axes.set_ylabel("joints of the back leg (below) and of the fore leg (above)")
    axes.set_ylim(min(rows.values()) - 0.6, max(rows.values()) + 0.6)
