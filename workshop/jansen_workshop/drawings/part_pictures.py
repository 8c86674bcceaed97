"""Pictures of the instructions: flat parts, links, exploded legs, stacks, phases and wiring.

Each function draws one picture on Matplotlib axes. Lengths are in mm.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jansen_env.robot import Robot
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.part_sizes import feet_of
from jansen_workshop.drawings.convex import Points
from jansen_workshop.drawings.outlines import CutPart, toe_way
from jansen_workshop.drawings.shaft_order import Placed, carried

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Picture = Callable[["Axes"], object]
"""Function that draws a picture."""
ANGLE = 1.0  # crank angle in pictures, in rad
LABEL = 36  # characters per line of a label
LETTERS = 8.5  # size of the font in pictures, in points
SMALLEST = 6.5  # smallest size of this font
TILT = (0.6 - 0.12j, 1j, 0.9 + 0.25j)  # directions of x, y and z in exploded views
HALF_CIRCLE = np.exp(1j * np.linspace(-0.5 * math.pi, 0.5 * math.pi, 30))
HOLE_COLORS = {"press": "#d62728", "slide": "#1f77b4", "clear": "#7f7f7f"}
PALE = "0.88"  # colour of parts that are not new
WIRES: dict[str, dict[str, Any]] = {
    "power": {"color": "#b22222", "lw": 3.0},
    "signal": {"color": "black", "lw": 1.2},
}
"""Style of the lines of each kind of wire."""


def draw_flat(parts: Sequence[CutPart], axes: Axes) -> None:
    """Draw flat parts with their engravings.

    Holes have the colours of their classes.

    Args:
        parts: Parts to draw.
        axes: Axes to draw on.
    """
    boxes = [part.outline.box for part in parts]
    width = max(high.real for _, high in boxes) - min(low.real for low, _ in boxes)
    height = max(high.imag for _, high in boxes) - min(low.imag for low, _ in boxes)
    scale = points_per_mm(axes, width, height)
    for part in parts:
        fill(axes, [np.array(shape.polygon) for shape in (part.outline, *part.windows)], "0.9")
        for hole in part.holes:
            visible = hole._replace(radius=max(hole.radius, width / 150.0))
            fill(axes, [np.array(visible.polygon)], HOLE_COLORS[hole.fit])
        for text, start, end in ((part.title, *part.text), *part.labels):
            room = 1.4 * scale * abs(end - start) / len(text)
            if room < SMALLEST:  # below the part
                low, high = part.outline.box
                x = 0.5 * (low.real + high.real)
                y = low.imag - 1.5 / scale
                axes.text(x, y, text, ha="center", va="top", fontsize=SMALLEST)
                continue
            middle = (start + end) / 2.0
            turn = math.degrees(np.angle(end - start))
            axes.text(
                middle.real,
                middle.imag,
                text,
                ha="center",
                va="center",
                zorder=5,
                fontsize=min(LETTERS, room),
                rotation=(turn + 90.0) % 180.0 - 90.0,
            )
    hide_frame(axes)


# Links


def draw_links(
    robot: Robot, items: Sequence[Placed], fresh: set[int], joint: str, axes: Axes
) -> None:
    """Draw parts as seen from the side, with new parts in colour.

    If the parts belong to several legs, the number of each leg stands below its foot.

    Args:
        robot: Robot that the parts belong to.
        items: Parts to draw. The first part is on top.
        fresh: Numbers of the bodies that are new in this step.
        joint: Name of the joint that is marked by a circle; empty for none.
        axes: Axes to draw on.
    """
    for item in reversed(items):
        new = item.body in fresh
        at = dict(zip(item.part.joints, _joints(robot, item), strict=True))
        rims = _rims(robot, item)
        for toe in feet_of(robot, item.body):
            fill(axes, [_tread(robot, item, toe)], "black")
            if len({other.leg for other in items}) > 1:
                axes.annotate(
                    f"leg {item.leg + 1}",
                    (at[toe].real, at[toe].imag - 1e3 * robot.build.foot_radius),
                    (0, -14),
                    textcoords="offset points",
                    ha="center",
                    fontweight="bold",
                )
        fill(axes, rims, f"C{item.body - 1}" if new else PALE)
        middle = complex(rims[0].mean())
        if joint in at:
            axes.plot(at[joint].real, at[joint].imag, "o", ms=22, mfc="none", mec="red", mew=2)
            middle += 0.4 * (middle - at[joint])
        if new:
            write_in_box(axes, middle, item.part.title)
    hide_frame(axes)


def _tread(robot: Robot, item: Placed, toe: str) -> Points:
    """Return the half circle of the tread on a part's foot."""
    z = item.part.joints[toe]
    ahead = [z, z + toe_way(item.part, toe)]
    side = robot.legs[item.leg].side
    start, end = carried(item.part, ahead, _joints(robot, item), side)
    centre = dict(zip(item.part.joints, _joints(robot, item), strict=True))[toe]
    half_circle: Points = centre + 1e3 * robot.build.foot_radius * (end - start) * HALF_CIRCLE
    return half_circle


def draw_exploded(robot: Robot, items: Sequence[Placed], axes: Axes) -> None:
    """Draw an exploded view of parts along the shaft, with lines through their pins.

    Args:
        robot: Robot that the parts belong to.
        items: Parts to draw.
        axes: Axes to draw on.
    """
    apart = 2.4 * max(np.ptp(_rims(robot, item)[0].real) for item in items) / len(items)
    centres: dict[str, list[complex]] = {}
    for k, item in reversed([*enumerate(sorted(items, key=lambda item: item.z))]):
        rims = [_tilted(rim, apart * k) for rim in _rims(robot, item)]
        fill(axes, rims, f"C{item.body - 1}")
        at = _tilted(_joints(robot, item), apart * k)
        for joint, z in zip(item.part.joints, at.tolist(), strict=True):
            centres.setdefault(joint, []).append(z)
        along = (0.7, 0.3)[k % 2]
        write_in_box(axes, at[0] + along * (at[1] - at[0]), item.part.title)
    for joint, ends in centres.items():
        axes.plot(np.real(ends), np.imag(ends), "k--", lw=0.8, zorder=5)
        axes.annotate(
            joint,
            (ends[-1].real, ends[-1].imag),
            (-15, -4),
            zorder=8,
            textcoords="offset points",
            fontweight="bold",
            bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.8},
        )
    hide_frame(axes)


def _tilted(flat: Points, depth: float) -> Points:
    """Return the positions in an exploded view of points at a depth along the shaft."""
    x, y, z = TILT
    return flat.real * x + flat.imag * y + depth * z


def _joints(robot: Robot, item: Placed) -> Points:
    """Return the positions of a part's joints in pictures."""
    joints = robot.linkage.joints
    place = joint_positions(robot, robot.legs[item.leg].side, ANGLE) @ np.array([1e3, 1e3j])
    return place[[joints.index(joint) for joint in item.part.joints]]


def _rims(robot: Robot, item: Placed) -> list[Points]:
    """Return the rim, windows and holes of a part in pictures."""
    at = _joints(robot, item)
    side = robot.legs[item.leg].side
    return [carried(item.part, shape.polygon, at, side) for shape in item.part.lines]


# Schemes


def draw_column(title: str, blocks: Sequence[tuple[str, str, float]], axes: Axes) -> None:
    """Draw what is on a pin as a column of blocks.

    Args:
        title: Title of the picture.
        blocks: Text, colour and width of each block, from top to bottom.
        axes: Axes to draw on.
    """
    for y, (text, color, width) in enumerate(blocks):
        axes.bar(0.0, 0.7, width, y - 0.35, color=color, ec="black", zorder=2)
        axes.text(
            0.65,
            y,
            "\n".join(wrapped(text, LABEL)),
            va="center",
            zorder=3,
            fontsize=min(9.0, 200.0 / len(blocks)),
        )
    axes.plot((0.0, 0.0), (0.0, len(blocks) - 1.0), "k", lw=5, zorder=1)
    axes.set_title(title, fontsize=10, loc="left")
    axes.set(xlim=(-0.6, 4.4), ylim=(max(len(blocks), 9.0), -1.0))
    axes.axis("off")


def draw_phases(turns: Sequence[float], axes: Axes) -> None:
    """Draw the crank pins around the shaft, as seen from the first frame.

    Args:
        turns: Angle of each crank pin, in rad.
        axes: Axes to draw on.
    """
    right = HALF_CIRCLE
    axes.plot(right.real, right.imag, "k:", -right.real, -right.imag, "k:")
    for k, turn in enumerate(turns, 1):
        z = np.exp(1j * turn)
        axes.plot((0.0, z.real), (0.0, z.imag), lw=20, color=f"C{k}", solid_capstyle="round")
        axes.plot(z.real, z.imag, "o", ms=13, mfc="white", mec="black", zorder=3)
        write_in_box(axes, 0.55 * z, f"crank pin {k}: {math.degrees(turn):.0f} degrees", 10.0)
    axes.plot(0.0, 0.0, "o", ms=24, mfc="0.7", mec="black", zorder=3)
    axes.text(0.0, -0.12, "shaft (O)", ha="center", va="top", fontsize=10)
    arrow = {"arrowstyle": "->", "lw": 2.0, "connectionstyle": "arc3,rad=0.25"}
    axes.annotate("", (0.3, 0.5), (0.6, 0.12), arrowprops=arrow)
    axes.text(0.0, 0.62, "angles increase anticlockwise", ha="center", fontsize=10)
    hide_frame(axes)


class Wire(NamedTuple):
    """Connection of two electrical components.

    Attributes:
        kind: ``"power"`` or ``"signal"``.
        start: Name of the component at the first end.
        start_place: Position of this component in the picture.
        end: Name of the component at the other end.
        end_place: Position of this component in the picture.
        label: Text on the wire; may be empty.
    """

    kind: str
    start: str
    start_place: complex
    end: str
    end_place: complex
    label: str


def draw_wiring(wires: Sequence[Wire], axes: Axes) -> None:
    """Draw the electrical components as boxes, with labelled wires.

    Args:
        wires: Wires to draw.
        axes: Axes to draw on.
    """
    for wire in wires:
        ends = np.array([wire.start_place, wire.end_place])
        axes.plot(ends.real, ends.imag, **WIRES[wire.kind], zorder=1)
        write_in_box(axes, complex(ends.mean()), wire.label, 9.0)
        for z, text in zip(ends.tolist(), (wire.start, wire.end), strict=True):
            write_in_box(axes, z, text.replace(" ", "\n", 1), 11.0, "#dce9f7")
    for kind, style in WIRES.items():
        axes.plot([], [], **style, label=kind)
    axes.legend(loc="upper center", ncols=len(WIRES), frameon=False, fontsize=10)
    axes.set(xlim=(-0.8, 6.8), ylim=(-0.8, 3.8))
    axes.axis("off")


# Tools


def points_per_mm(axes: Axes, width: float, height: float) -> float:
    """Return the size of 1 mm on paper, in points, in a picture that fills its axes.

    Args:
        axes: Axes to draw on.
        width: Width of what is drawn, in mm.
        height: Height of what is drawn, in mm.
    """
    points_per_pixel = 72.0 / axes.figure.dpi
    pixels_per_mm = min(axes.bbox.width / width, axes.bbox.height / height)
    return points_per_pixel * pixels_per_mm / 1.1  # with margins


def spread(places: Sequence[float], least: float) -> list[float]:
    """Return places for labels that keep a distance, and whose mean is that of their targets.

    Args:
        places: Targets, in ascending order.
        least: Least distance between two labels.
    """
    labels: list[float] = []
    for place in places:
        labels.append(max(place, labels[-1] + least) if labels else place)
    late = sum(labels) - sum(places)
    return [label - late / len(places) for label in labels]


def hide_frame(axes: Axes) -> None:
    """Draw axes to scale and hide their frame.

    Args:
        axes: Axes to change.
    """
    axes.set_aspect("equal")
    axes.axis("off")


def fill(axes: Axes, rims: Sequence[Points], color: str) -> None:
    """Fill the area inside the first rim, without the areas inside the other rims.

    Args:
        axes: Axes to draw on.
        rims: Corners of each rim.
        color: Colour of the area.
    """
    closed = [np.append(rim, rim[:1]) for rim in rims]
    inner = [z for rim in closed[1:] for z in (rim[::-1], rims[0][:1])]
    whole = np.concatenate([closed[0], *inner])
    axes.fill(whole.real, whole.imag, color=color, ec="none", zorder=2)
    for rim in closed:
        axes.plot(rim.real, rim.imag, "k", lw=0.7, zorder=2)


def write_in_box(
    axes: Axes, z: complex, text: str, size: float = LETTERS, color: str = "white"
) -> None:
    """Write a text in a box centred at a point; nothing for an empty text.

    Args:
        axes: Axes to draw on.
        z: Centre of the box.
        text: Text to write.
        size: Size of the font.
        color: Colour of the box.
    """
    box = {"boxstyle": "round,pad=0.25", "fc": color, "ec": "0.4", "alpha": 0.9}
    if text:
        axes.text(z.real, z.imag, text, ha="center", va="center", fontsize=size, bbox=box, zorder=7)


def wrapped(text: str, width: int) -> list[str]:
    """Return the lines of a wrapped text, in which no unit is separated from its number.

    Args:
        text: Text to wrap.
        width: Most characters per line.
    """
    units = r" (?=(?:k?g|mm?|V|A|k?ohm|rad/s|EUR|°C|\d+$)\b|x |%)"
    bound = re.sub(rf"{units}|(?<= x) |(?<=ISO) |(?<=DIN) ", "\u00a0", text)
    return textwrap.wrap(bound, width, subsequent_indent="  ", break_on_hyphens=False)
