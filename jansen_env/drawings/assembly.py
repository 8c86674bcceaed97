"""Picture of a unit: from the side, and along the shaft with a bar for each part."""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jansen_env.drawings.materials import SHAFT_END
from jansen_env.drawings.shaft_order import Placed
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ANGLE = 1.0  # rad, of the crank in the picture
HEAD = 4.5  # mm, of a pin, and of its nut
SIZE = (15.0, 7.5)  # inches


def assembly_svg(robot: Robot, placed: Sequence[Placed], title: str) -> str:
    """The first unit as SVG, the same text every time."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    unit, text = [item for item in placed if item.unit == 0], io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "jansen_env", "font.size": 9}):
        figure = Figure(figsize=SIZE, layout="constrained")
        figure.suptitle(title)
        side, order = figure.subplots(1, 2)
        _draw_side(side, robot, unit)
        _draw_order(order, robot, unit)
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()


def _draw_side(axes: Axes, robot: Robot, unit: Sequence[Placed]) -> None:
    """Draw the rims of all parts at an angle of the crank, the first on the shaft on top."""
    joints = robot.linkage.joints
    for item in reversed(unit):
        side = robot.legs[item.leg].side
        place = joint_positions(robot, side, ANGLE) @ np.array([1e3, 1e3j])
        at = place[[joints.index(name) for name in item.part.joints]]
        axes.fill(at.real, at.imag, fill=False, ec=f"C{item.body - 1}", lw=8, joinstyle="round")
        axes.scatter(at.real, at.imag, 10, "black", zorder=3)
    for name, z in zip(joints, place, strict=True):
        axes.annotate(name, (z.real, z.imag), (6, 6), textcoords="offset points", zorder=3)
    axes.set_aspect("equal")
    axes.set_xlabel("mm")


def _draw_order(axes: Axes, robot: Robot, unit: Sequence[Placed]) -> None:
    """Draw a row for each joint of either leg, a bar for each part, a line for each pin."""
    axis, pin, *_ = [*robot.linkage.bodies[CRANK - 1][1]]
    others = [joint for joint in robot.linkage.joints if joint not in (axis, pin)]
    rows: dict[tuple[int, str], int] = {}
    for leg, way in zip(dict.fromkeys(item.leg for item in unit), (1, -1), strict=False):
        rows |= {(leg, axis): 0, (leg, pin): 1}
        rows |= {(leg, joint): way * (k + 1) + (way > 0) for k, joint in enumerate(others)}
    pinned = {item.joint for item in robot.linkage.pins} - {axis}
    end, pins = unit[-1].top, defaultdict[int, list[float]](list)
    for item in unit:
        at = {joint: rows[item.leg, joint] for joint in item.part.joints}
        for joint in (joint for joint in at if joint in pinned):
            pins[at[joint]] += (0.0, end) if joint in item.through else (item.z, item.top)
        # Parts of a leg in one layer share its width here.
        mates = [other for other in unit if (other.leg, other.layer) == (item.leg, item.layer)]
        width = item.part.thickness / len(mates)
        x, low, high = (
            item.z + width * (mates.index(item) + 0.5),
            min(at.values()),
            max(at.values()),
        )
        axes.bar(x, high - low + 0.6, width, low - 0.3, color=f"C{item.body - 1}", edgecolor="k")
        axes.scatter([x] * len(at), [*at.values()], 22, "black", zorder=3)
        axes.text(x, (low + high) / 2, item.part.name.replace("_", " "), rotation=90, zorder=4,
                  ha="center", va="center", color="white", fontweight="bold")  # fmt: skip
    for row, faces in pins.items():
        ends = min(faces) - HEAD, max(faces) + HEAD
        axes.plot(ends, (row, row), "black", linewidth=2.5, zorder=0)
    first, last = (item for item in unit if item.body == CRANK)
    for shaft in ((-SHAFT_END, first.z), (last.top, end + SHAFT_END)):
        axes.plot(shaft, (0, 0), "dimgray", linewidth=7, solid_capstyle="butt", zorder=0)
    axes.set_yticks([*rows.values()], [joint for _, joint in rows])
    axes.set_xlabel("mm along the shaft; dots are joints of a part, lines pins with their heads")
    if min(rows.values()) < 0:
        axes.set_ylabel("joints of the back leg (below) and of the fore leg (above)")
    axes.set_ylim(min(rows.values()) - 0.6, max(rows.values()) + 0.6)
