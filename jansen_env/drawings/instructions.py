"""Instructions to build a machine from its drawings: a PDF to print, with a page for each step.

``instructions.yml`` has their text.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jansen_env.drawings.materials import SHAFT_END, Part, Row, Stack, brace, counts, stacks
from jansen_env.drawings.outlines import FITS, CutPart, Points, feet_of
from jansen_env.drawings.shaft_order import Placed, carried, units
from jansen_env.plain_yaml import read_yaml
from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = (11.69, 8.27)  # inches, A4
ANGLE = 1.0  # rad, of the crank in pictures
LINES, COLUMN, LABEL = 50, 48, 36  # rows of a list on a page, letters of a line and of a label
TILT = (0.6 - 0.12j, 1j, 0.9 + 0.25j)  # where x, y and z point where parts are drawn apart
HALF = np.exp(1j * np.linspace(-0.5 * math.pi, 0.5 * math.pi, 30))  # of a circle
HOLES = {"press": "#d62728", "slide": "#1f77b4", "clear": "#7f7f7f"}
Picture = Callable[["Axes"], object]


class Step(NamedTuple):
    """A page: instructions, a line each; pictures side by side; what to weigh, and its mass, kg."""

    title: str
    text: list[str]
    pictures: Sequence[Picture] = ()
    weighed: str = ""
    mass: float = 0.0


class Manual:
    """Pages and pictures of a machine, whose bill of materials numbers all parts; ``flat``: every
    flat part, laid out; ``first``: pieces of the coupon."""

    def __init__(
        self, robot: Robot, placed: Sequence[Placed], bill: Sequence[Part],
        flat: Sequence[CutPart], first: Sequence[CutPart],
    ) -> None:  # fmt: skip
        self.robot, self.placed, self.bill = robot, placed, bill
        self.flat, self.first = flat, first
        self.words = read_yaml(Path(__file__).with_name("instructions.yml"))
        self.pin = robot.linkage.bodies[CRANK - 1][1][1]
        self.stacks, self.units = stacks(robot, placed), units(robot)
        self.numbers = {(part.name, part.dimensions): k for k, part in enumerate(bill, 1)}
        self.each = {part.name: part.each for part in bill}
        phases = [robot.legs[on[0]].phase - robot.legs[0].phase for on in self.units]
        self.turns = [phase % (2.0 * math.pi) for phase in phases]

    def _mass(self, *names: str) -> float:
        """Mass of all parts whose names begin with one of these, kg."""
        return sum(part.mass for part in self.bill if part.name.startswith(names))

    def label(self, row: Row) -> str:
        """Number, name and size of an entry of a stack."""
        many = f"{row.number} x " if row.number > 1 else ""
        number = row.item.body if row.item else self.numbers[row.name, row.size]
        return f"{many}no. {number}: {row.name} {row.size}".strip()

    def _page(
        self, name: str, pictures: Sequence[Picture], mass: float = 0.0, **fields: object
    ) -> Step:
        """A page of ``instructions.yml``, whose head explains its marks."""
        words, build, text = self.words[name], self.robot.build, []
        fields |= {"screws": build.screw, "apart_screws": 40 if build is ALUMINIUM else 15}
        for line in words["text"].format(**fields).splitlines():
            needed, mark, said = line.partition("? ")
            if mark and (needed.lstrip("!") in self.each) == needed.startswith("!"):
                continue
            line = said if mark else line
            if line.startswith("= "):
                wanted, _, size = line[2:].partition(", ")
                text += [f"{part.number} x no. {k}: {part.name} {part.dimensions}"
                         for k, part in enumerate(self.bill, 1)
                         if part.name == wanted and part.dimensions.startswith(size)]  # fmt: skip
            else:
                text.append(line)
        return Step(words["title"].format(**fields), text, pictures, words.get("weighed", ""), mass)

    def steps(self) -> list[Step]:
        """All steps in order; the last one's mass is the machine's."""
        robot, whole = self.robot, sum(part.mass for part in self.bill)
        flat = sum(part.mass for part in self.bill if part.name in counts(robot))
        found = [self._page("flat", [partial(draw_flat, self.flat)], flat)]
        kinds: dict[tuple[str, ...], list[int]] = {}  # units that are alike
        for unit, on in enumerate(self.units):
            kinds.setdefault(tuple(robot.legs[leg].side for leg in on), []).append(unit)
        for alike in kinds.values():
            which = f" of leg {self.units[alike[0]][0] + 1}" if len(kinds) > 1 else ""
            found += self._unit(alike[0], len(alike), which)
        radius, heights = 1e3 * robot.bodies[CRANK - 1].distance(0, 1), []
        for k, turn in enumerate(self.turns, 1):
            up, right = radius * math.sin(turn), radius * math.cos(turn)
            heights.append(f"Pin {k}: {math.degrees(turn):.0f} degrees; {up:+.1f} mm above the "
                           f"shaft, {right:+.1f} mm to the right")  # fmt: skip
        for name, pictures in (
            ("frames", [partial(self.draw_stack, s) for s in self.stacks if s.axle]),
            ("phases", [self.draw_phases]), ("motor", [self.draw_motor]),
            ("wiring", [self.draw_wiring]), ("power", [self.draw_machine]),
        ):  # fmt: skip
            mass = whole - self._mass(*self.words[name]["lacks"])
            fields = {"heights": "\n".join(heights), "away": SHAFT_END, **brace(robot)}
            found.append(self._page(name, pictures, mass, **fields))
        return found

    def _unit(self, unit: int, number: int, which: str) -> list[Step]:
        """Steps to a unit: a leg, pin by pin from its foot, then the crank pin with its links."""
        on, linkage, bodies = self.units[unit], self.robot.linkage, self.robot.linkage.names
        share = next(part.each for part in self.bill if part.name.startswith("pin"))
        every = [item for item in self.placed if item.unit == unit]
        mine = [item for item in every if item.leg == on[0]]
        links = [item for item in mine if item.body not in (FRAME, CRANK)]
        joined = {body + 1 for _, body in linkage.all_pads[: len(linkage.toes)]}
        mass = sum(self.each[bodies[body - 1]] for body in joined)
        mass += self._mass("foot-", "foot's") / len(self.robot.legs)
        many = f"{number * len(on)} of them"
        if len(on) > 1:
            many += "; fore and back legs are the same, turned about the vertical"
        picture = partial(self.draw_apart, links)
        found = [self._page("foot", [picture], mass, which=which, many=many)]
        pins = [s for s in self.stacks if not s.axle and (s.unit, s.leg) == (unit, on[0])]
        pins.sort(key=lambda stack: stack.joint == self.pin)  # the crank pin last
        while pins:
            stack = next((s for s in pins[:-1] if joined & s.bodies), pins[0])
            pins.remove(stack)
            name, fresh = "pin", stack.bodies - joined
            joined |= fresh
            mass += share * len(stack.bodies) + sum(self.each[bodies[k - 1]] for k in fresh)
            items = [item for item in mine if item.body in joined]
            if not pins:  # all legs, and two cranks
                name, fresh, many = "crank", stack.bodies, f"{number} of them"
                mass = len(on) * mass + (2 - len(on)) * self.each[bodies[CRANK - 1]]
                items = [item for item in every if item.body in joined]
            screw, nut = map(self.label, stack.bolt)
            side = partial(self.draw_side, items, fresh, stack.joint)
            found.append(self._page(
                name, [side, partial(self.draw_stack, stack)], mass, joint=stack.joint,
                screw=screw, nut=nut, which=which, many=many,
            ))  # fmt: skip
        return found

    def to_pdf(self, title: str) -> bytes:
        """Cover, list of parts, coupon and steps on pages of A4; the same bytes every time."""
        from matplotlib.backends.backend_pdf import PdfPages

        steps, robot, out = self.steps(), self.robot, io.BytesIO()
        cover = self._page(
            "cover", [self.draw_machine], title=title, legs=len(robot.legs), pins=len(self.units),
            width=self.placed[-1].top, weight=steps[-1].mass, cut=sum(counts(robot).values()),
            lines=len(self.bill), steps=len(steps),
        )  # fmt: skip
        fits = [f"{name}: {', '.join(f'{mm:+g}' for mm in fit)}" for name, fit in FITS.items()]
        coupon = self._page("coupon", [partial(draw_flat, self.first)], fits="\n".join(fits))
        pages = [cover, coupon]
        pages += [step._replace(title=f"Step {k} of {len(steps)}: {step.title}")
                  for k, step in enumerate(steps, 1)]  # fmt: skip
        rows = [f"{'no.':>3}  {'name':31}{'material':50}{'size':58}{'count':>5}{'each g':>8}"]
        for k, part in enumerate(self.bill, 1):
            each = f"{1e3 * part.each:.1f}" if part.each else ""
            rows.append(f"{k:3}  {part.name:31.30}{part.material:50.49}{part.dimensions:58.57}"
                        f"{part.number:5}{each:>8}")  # fmt: skip
        figures = [_figure(page) for page in pages]
        for start in range(0, len(rows), LINES):
            figures.insert(1 + start // LINES, figure := _figure(Step("Parts and fasteners", [])))
            figure.text(0.04, 0.9, "\n".join(rows[start : start + LINES]), fontsize=7.5,
                        family="monospace", va="top", linespacing=1.35)  # fmt: skip
        with PdfPages(out, metadata={"CreationDate": None}) as pdf:
            for figure in figures:
                pdf.savefig(figure)
        return out.getvalue()

    def _joints(self, item: Placed) -> Points:
        """Places of a part's joints in pictures, mm."""
        joints, side = self.robot.linkage.joints, self.robot.legs[item.leg].side
        place = joint_positions(self.robot, side, ANGLE) @ np.array([1e3, 1e3j])
        return place[[joints.index(joint) for joint in item.part.joints]]

    def _rims(self, item: Placed) -> list[Points]:
        """Rim, windows and holes of a part in pictures, mm."""
        at, side = self._joints(item), self.robot.legs[item.leg].side
        return [carried(item.part, shape.polygon, at, side) for shape in item.part.lines]

    def draw_side(self, items: Sequence[Placed], fresh: set[int], joint: str, axes: Axes) -> None:
        """Parts from the side, the first on top; new ones in colour, a pin in a circle."""
        for item in reversed(items):
            at = dict(zip(item.part.joints, self._joints(item), strict=True))
            rims = self._rims(item)
            middle = complex(rims[0].mean())
            for toe in feet_of(self.robot, item.body):
                way = (at[toe] - middle) / abs(at[toe] - middle)
                _fill(axes, [at[toe] + 1e3 * self.robot.build.foot_radius * way * HALF], "black")
            new = item.body in fresh
            _fill(axes, rims, f"C{item.body - 1}" if new else "0.88")
            if joint in at:
                axes.plot(at[joint].real, at[joint].imag, "o", ms=22, mfc="none", mec="red", mew=2)
                middle += 0.4 * (middle - at[joint])
            if new:
                _name(axes, middle, item.part.title)
        _bare(axes)

    def draw_machine(self, axes: Axes) -> None:
        """The first crank pin with its legs and frames."""
        items = [item for item in self.placed if item.unit == 0]
        self.draw_side(items, {item.body for item in items}, "", axes)

    def draw_apart(self, items: Sequence[Placed], axes: Axes) -> None:
        """Parts drawn apart along the shaft, and lines through their pins."""
        spread = 2.0 * max(np.ptp(self._rims(item)[0].real) for item in items) / len(items)
        centres: dict[str, list[complex]] = {}
        for k, item in reversed([*enumerate(sorted(items, key=lambda item: item.z))]):
            _fill(axes, [_tilted(rim, spread * k) for rim in self._rims(item)], f"C{item.body - 1}")
            at = _tilted(self._joints(item), spread * k)
            for joint, z in zip(item.part.joints, at.tolist(), strict=True):
                centres.setdefault(joint, []).append(z)
            _name(axes, at[0] + (0.7, 0.3)[k % 2] * (at[1] - at[0]), item.part.title)
        for joint, ends in centres.items():
            axes.plot(np.real(ends), np.imag(ends), "k--", lw=0.8, zorder=5)
            axes.annotate(joint, (ends[-1].real, ends[-1].imag), (-12, -4), zorder=6,
                          textcoords="offset points", fontweight="bold")  # fmt: skip
        _bare(axes)

    def draw_stack(self, stack: Stack, axes: Axes) -> None:
        """Draw the stack on a pin, its head on top, with part numbers and sizes."""
        held = next((pin.other for pin in self.robot.linkage.pins if pin.joint == stack.joint), 0)
        bolt = [(self.label(row._replace(number=1)), "0.4", 0.55) for row in stack.bolt]
        blocks, title = [bolt[stack.axle]], f"Pin {stack.joint}"
        if stack.axle:
            title = f"{bolt[0][0]},\n{stack.joint} of {stack.side} legs"
        for row in stack.rows:
            text, color, wide = self.label(row), "0.8", 0.34
            if row.item:
                color, wide = f"C{row.item.body - 1}", 1.0
                text += " (is held)" if row.item.body == held else " (turns)"
                if stack.axle or stack.joint == self.pin:
                    text += f", leg {row.item.leg + 1}"
            blocks += [(text, color, wide)] if row.name != "ring" else []
        _column(axes, title, [*blocks, bolt[1]])

    def draw_phases(self, axes: Axes) -> None:
        """Crank pins about the shaft, seen from the first frame."""
        for k, turn in enumerate(self.turns, 1):
            z = np.exp(1j * turn)
            axes.plot((0.0, z.real), (0.0, z.imag), "o-", lw=14, color=f"C{k}")
            _name(axes, 0.6 * z, f"pin {k}: {math.degrees(turn):.0f} deg")
        axes.plot(HALF.real, HALF.imag, "k:", -HALF.real, -HALF.imag, "k:")
        _bare(axes)

    def draw_motor(self, axes: Axes) -> None:
        """Draw the parts around the motor's end of the shaft."""
        _column(axes, "About the shaft's end, from the outside in", self.words["shaft_end"])

    def draw_wiring(self, axes: Axes) -> None:
        """Draw components as boxes, with labelled wires."""
        for name, x, y, other, u, v, wire in self.words["wires"]:
            axes.plot((x, u), (y, v), "k", lw=1.5)
            _name(axes, complex(x + u, y + v) / 2, wire)
            for z, text in ((complex(x, y), name), (complex(u, v), other)):
                _name(axes, z, text.replace(" ", "\n", 1), 10.0, "#dce9f7")
        axes.set(xlim=(-0.8, 6.8), ylim=(-0.8, 3.8))
        axes.axis("off")


def draw_flat(parts: Sequence[CutPart], axes: Axes) -> None:
    """Flat parts with their engravings, and holes in the colours of their classes."""
    width = max(part.outline.box[1].real for part in parts)
    for part in parts:
        _fill(axes, [np.array(shape.polygon) for shape in (part.outline, *part.windows)], "0.9")
        for hole in part.holes:
            seen = hole._replace(radius=max(hole.radius, width / 150.0))
            _fill(axes, [np.array(seen.polygon)], HOLES[hole.fit])
        for text, start, end in ((part.title, *part.text), *part.labels):
            z, turn = (start + end) / 2.0, math.degrees(np.angle(end - start))
            room = 750.0 * abs(end - start) / width / len(text)
            axes.text(z.real, z.imag, text, ha="center", va="center", zorder=5,
                      fontsize=min(8.0, room), rotation=(turn + 90.0) % 180.0 - 90.0)  # fmt: skip
    _bare(axes)


def _column(axes: Axes, title: str, blocks: Sequence[tuple[str, str, float]]) -> None:
    """Blocks under one another, each with its text, its colour and its width."""
    for y, (text, color, wide) in enumerate(blocks):
        axes.bar(0.0, 0.7, wide, y - 0.35, color=color, ec="black", zorder=2)
        axes.text(0.65, y, "\n".join(_wrapped(text, LABEL)), va="center", zorder=3,
                  fontsize=min(9.0, 200.0 / len(blocks)))  # fmt: skip
    axes.plot((0.0, 0.0), (0.0, len(blocks) - 1.0), "k", lw=5, zorder=1)
    axes.set_title(title, fontsize=10, loc="left")
    axes.set(xlim=(-0.6, 4.4), ylim=(max(len(blocks), 9.0), -1.0))
    axes.axis("off")


def _bare(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.axis("off")


def _tilted(flat: Points, depth: float) -> Points:
    """Where points are seen that lie at a depth, of parts drawn apart."""
    x, y, z = TILT
    return flat.real * x + flat.imag * y + depth * z


def _fill(axes: Axes, rims: Sequence[Points], color: str) -> None:
    """A part: the inside of its first rim without that of the others."""
    closed = [np.append(rim, rim[:1]) for rim in rims]
    inner = [z for rim in closed[1:] for z in (rim[::-1], rims[0][:1])]
    whole = np.concatenate([closed[0], *inner])
    axes.fill(whole.real, whole.imag, color=color, ec="none", zorder=2)
    for rim in closed:
        axes.plot(rim.real, rim.imag, "k", lw=0.7, zorder=2)


def _name(axes: Axes, z: complex, text: str, size: float = 8.0, color: str = "white") -> None:
    box = {"boxstyle": "round,pad=0.25", "fc": color, "ec": "0.4", "alpha": 0.9}
    if text:
        axes.text(z.real, z.imag, text, ha="center", va="center", fontsize=size, bbox=box, zorder=7)


def _wrapped(text: str, width: int) -> list[str]:
    """Lines of a text, in which a unit stays with its number."""
    bound = re.sub(r" (?=(?:k?g|mm|\d+$)\b|x )|(?<= x) ", "\u00a0", text)
    return textwrap.wrap(bound, width, subsequent_indent="  ")


def _figure(step: Step) -> Figure:
    """A page with pictures on its left, text on its right and the mass below."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE)
    figure.text(0.04, 0.94, step.title, fontsize=18, fontweight="bold")
    lines = []
    for line in step.text:
        lines += _wrapped(line if line[:1] == "[" else f"- {line}", COLUMN)
    size = min(9.5, 9.5 * 36.0 / max(len(lines), 1))
    figure.text(0.68, 0.88, "\n".join(lines), fontsize=size, va="top", linespacing=1.45)
    if step.mass:
        grams = f"{1e3 * step.mass:.{int(step.mass < 0.1)}f}"
        check = "\n".join(_wrapped(f"{step.weighed}: {grams} g", LABEL))
        box = {"boxstyle": "round,pad=0.5", "fc": "#fff3c4"}
        figure.text(0.68, 0.05, check, fontsize=11, va="bottom", fontweight="bold", bbox=box)
    wide = 0.64 / max(len(step.pictures), 1)
    for k, draw in enumerate(step.pictures):
        draw(figure.add_axes((0.03 + k * wide, 0.05, 0.95 * wide, 0.81)))
    return figure
