"""Instructions to build a machine from its drawings, as a PDF to print with one page per step.

The file ``instructions.yml`` contains the text.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jansen_env.files.plain_yaml import read_yaml
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.part_sizes import feet_of
from jansen_workshop.drawings.assembly import Piece, Solid
from jansen_workshop.drawings.materials import Row, Stack, counts, stacks
from jansen_workshop.drawings.mount import units
from jansen_workshop.drawings.order import Mass, Order
from jansen_workshop.drawings.outlines import FITS, CutPart, Points, Round, rectangle, toe_way
from jansen_workshop.drawings.shaft_order import Placed, carried

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = (11.69, 8.27)  # inches, size of an A4 page
ANGLE = 1.0  # rad, crank angle in pictures
LINES, COLUMN, LABEL = 50, 48, 36  # rows of a list per page, characters per line and per label
TILT = (0.6 - 0.12j, 1j, 0.9 + 0.25j)  # directions of x, y and z in exploded views
HALF = np.exp(1j * np.linspace(-0.5 * math.pi, 0.5 * math.pi, 30))  # points of a half circle
HOLES = {"press": "#d62728", "slide": "#1f77b4", "clear": "#7f7f7f"}
Picture = Callable[["Axes"], object]


class Step(NamedTuple):
    """Page of the instructions.

    Attributes:
        title: Title of the page.
        text: Instructions, one per line.
        pictures: Functions that draw the pictures, which are placed side by side.
        weighed: Name of the assembly to weigh.
        mass: Mass of this assembly; None if nothing is weighed.
    """

    title: str
    text: list[str]
    pictures: Sequence[Picture] = ()
    weighed: str = ""
    mass: Mass | None = None


class Manual:
    """Pages and pictures that explain how to build a machine.

    Args:
        order: Bill of materials, which numbers all parts, with the solids of the machine.
        flat: Every flat part, laid out on one sheet.
        first: Pieces of the coupon.
    """

    def __init__(self, order: Order, flat: Sequence[CutPart], first: Sequence[CutPart]) -> None:
        assert order.assembly is not None
        self.order, self.assembly = order, order.assembly
        self.robot, self.placed = order.robot, order.assembly.placed
        self.bill = order.parts
        self.flat, self.first = flat, first
        self.words = read_yaml(Path(__file__).with_name("instructions.yml"))
        self.pin = self.robot.linkage.bodies[CRANK - 1][1][1]
        self.stacks, self.units = stacks(self.robot, self.placed), units(self.robot)
        legs = self.robot.legs
        phases = [legs[on[0]].phase - legs[0].phase for on in self.units]
        self.turns = [phase % (2.0 * math.pi) for phase in phases]

    def label(self, row: Row) -> str:
        """Return the number, name and size of an entry of a stack.

        Args:
            row: Entry of the stack.
        """
        many = f"{row.number} x " if row.number > 1 else ""
        number = row.item.body if row.item else self.order.numbers[row.name, row.size]
        return f"{many}no. {number}: {row.name} {row.size}".strip()

    def _listed(self, name: str, pieces: Sequence[Piece]) -> list[str]:
        """Return a line for each size of the pieces called ``name``, with count and number."""
        found = Counter((piece.name, piece.size) for piece in pieces if piece.name == name)
        lines = []
        for (_, size), number in sorted(found.items()):
            part = self.bill[self.order.numbers[name, size] - 1]
            known = self.order.numbers[name, size]
            lines.append(f"{number} x no. {known}: {name} {part.dimensions}")
        return lines

    def _page(
        self,
        name: str,
        pictures: Sequence[Picture],
        weighed: Sequence[Piece] = (),
        put_on: Sequence[Piece] = (),
        **fields: object,
    ) -> Step:
        """Return a page of ``instructions.yml``; the head of that file explains its markup.

        Args:
            name: Name of the page.
            pictures: Functions that draw the pictures, which are placed side by side.
            weighed: Pieces whose total mass is shown in the page's box.
            put_on: Pieces that are added on the page, which the page may list.
            **fields: Values for the names in braces.
        """
        words, text = self.words[name], []
        names = {part.name for part in self.bill}
        for line in words["text"].format(**fields).splitlines():
            needed, mark, said = line.partition("? ")
            if mark and (needed.lstrip("!") in names) == needed.startswith("!"):
                continue
            line = said if mark else line
            if line.startswith("= "):
                text += self._listed(line[2:], put_on)
            else:
                text.append(line)
        title = words["title"].format(**fields)
        mass = self.order.weigh(weighed) if weighed else None
        return Step(title, text, pictures, words.get("weighed", ""), mass)

    def _of_stages(self, *stages: str) -> list[Piece]:
        """Return the pieces that are assembled in any of the stages."""
        return [piece for piece in self.assembly.pieces if piece.stage in stages]

    def steps(self) -> list[Step]:
        """Return all steps in order.

        The last step that has a mass has that of the whole machine.
        """
        robot = self.robot
        cut = counts(robot)
        flat = [piece for piece in self.assembly.pieces if piece.name in cut]
        bushes = [piece for piece in self.assembly.pieces if piece.name == "bush"]
        found = [self._page("flat", [partial(draw_flat, self.flat)], flat, bushes)]
        kinds: dict[tuple[str, ...], list[int]] = {}  # equal units, by the sides of their legs
        for unit, on in enumerate(self.units):
            kinds.setdefault(tuple(robot.legs[leg].side for leg in on), []).append(unit)
        for alike in kinds.values():
            which = f" of leg {self.units[alike[0]][0] + 1}" if len(kinds) > 1 else ""
            found += self._unit(alike[0], len(alike), which)
        radius, heights = 1e3 * robot.bodies[CRANK - 1].distance(0, 1), []
        for k, turn in enumerate(self.turns, 1):
            up, right = radius * math.sin(turn), radius * math.cos(turn)
            heights.append(
                f"Pin {k}: {math.degrees(turn):.0f} degrees; {up:+.1f} mm above the "
                f"shaft, {right:+.1f} mm to the right"
            )
        mount = self.assembly.mount
        fields = {
            "heights": "\n".join(heights),
            "screws": robot.build.screw,
            "near": mount.screws[0],
            "far": mount.screws[1],
            **self._brace(),
        }
        frames = [
            piece for piece in self.assembly.pieces if piece.stage == "ties" or piece.body == FRAME
        ]
        stages = ["foot", "links", "pin", "crank", "ties"]
        for name, pictures in (
            ("ties", [self.draw_ties]),
            ("frames", [partial(self.draw_stack, s) for s in self.stacks if s.axle]),
            ("phases", [self.draw_phases]),
            ("motor", [self.draw_section]),
            ("wiring", [self.draw_wiring]),
            ("power", [self.draw_machine]),
        ):
            stages.append(name)
            weighed = frames if name == "ties" else self._of_stages(*stages)
            found.append(self._page(name, pictures, weighed, self._of_stages(name), **fields))
        found.append(
            self._page(
                "assembled",
                [self.draw_side_view, self.draw_top_view],
                turned=math.degrees(ANGLE),
            )
        )
        return found

    def _brace(self) -> dict[str, object]:
        """Return fields of the brace: angle between frames in degrees, distance of pivots in mm."""
        ways = [*self.assembly.ways.values()]
        angle = abs(np.angle(ways[0] / ways[-1]))
        reach = 1e3 * self.robot.bodies[FRAME - 1].distance(0, 1)
        pivot = next(
            joint
            for joint in self.robot.linkage.bodies[FRAME - 1][1]
            if joint != self.robot.linkage.joints[self.robot.linkage.axis]
        )
        return {
            "angle": math.degrees(angle),
            "apart": reach * abs(ways[0] - ways[-1]),
            "pivot": pivot,
        }

    def _unit(self, unit: int, number: int, which: str) -> list[Step]:
        """Return the steps that build a unit.

        They build one leg, pin by pin from its foot on, and then the crank pin with its links.

        Args:
            unit: Index of the unit.
            number: Number of equal units.
            which: Text added to the titles to tell different units apart.
        """
        on, linkage = self.units[unit], self.robot.linkage
        every = [item for item in self.placed if item.unit == unit]
        mine = [item for item in every if item.leg == on[0]]
        links = [item for item in mine if item.body not in (FRAME, CRANK)]
        pieces = [piece for piece in self.assembly.pieces if piece.unit == unit]
        leg = [piece for piece in pieces if piece.leg == on[0]]
        joined = {body + 1 for _, body in linkage.all_pads[: len(linkage.toes)]}
        feet = [piece for piece in leg if piece.stage == "foot"]
        done: set[str] = set()

        def so_far() -> list[Piece]:
            return [
                piece
                for piece in leg
                if piece.stage == "foot"
                or (piece.stage == "links" and piece.body in joined)
                or (piece.stage == "pin" and piece.joint in done)
            ]

        many = f"{number * len(on)} of them"
        if len(on) > 1:
            many += "; fore and back legs are the same, turned about the vertical"
        picture = partial(self.draw_apart, links)
        found = [self._page("foot", [picture], so_far(), feet, which=which, many=many)]
        pins = [s for s in self.stacks if not s.axle and (s.unit, s.leg) == (unit, on[0])]
        pins.sort(key=lambda stack: stack.joint == self.pin)  # the crank pin is last
        while pins:
            stack = next((s for s in pins[:-1] if joined & s.bodies), pins[0])
            pins.remove(stack)
            name, fresh = "pin", stack.bodies - joined
            joined |= fresh
            done.add(stack.joint)
            items = [item for item in mine if item.body in joined]
            weighed, put_on = so_far(), list[Piece]()
            if not pins:  # the unit is complete: all legs, and two cranks with their hubs
                name, fresh, many = "crank", stack.bodies, f"{number} of them"
                weighed = [
                    piece for piece in pieces if piece.stage in ("foot", "links", "pin", "crank")
                ]
                put_on = [piece for piece in pieces if piece.stage == "crank"]
                items = [item for item in every if item.body in joined]
            screw, nut = map(self.label, stack.bolt)
            side = partial(self.draw_side, items, fresh, stack.joint)
            found.append(
                self._page(
                    name,
                    [side, partial(self.draw_stack, stack)],
                    weighed,
                    put_on,
                    joint=stack.joint,
                    screw=screw,
                    nut=nut,
                    which=which,
                    many=many,
                )
            )
        return found

    def to_pdf(self, title: str) -> bytes:
        """Return the instructions as a PDF on A4 pages: cover, list of parts, coupon and steps.

        The bytes are the same every time.

        Args:
            title: Title on the cover.
        """
        from matplotlib.backends.backend_pdf import PdfPages

        steps, robot, out = self.steps(), self.robot, io.BytesIO()
        low, high = self.assembly.extent
        cover = self._page(
            "cover",
            [self.draw_machine],
            title=title,
            legs=len(robot.legs),
            pins=len(self.units),
            width=high - low,
            weight=self.order.mass,
            simulated=robot.mass,
            price=self.order.price,
            cut=sum(counts(robot).values()),
            lines=len(self.bill),
            steps=len(steps) - 1,
        )
        fits = [f"{name}: {', '.join(f'{mm:+g}' for mm in fit)}" for name, fit in FITS.items()]
        coupon = self._page("coupon", [partial(draw_flat, self.first)], fits="\n".join(fits))
        pages = [cover, coupon]
        numbered = steps[:-1]
        pages += [
            step._replace(title=f"Step {k} of {len(numbered)}: {step.title}")
            for k, step in enumerate(numbered, 1)
        ]
        pages.append(steps[-1])
        rows = [
            f"{'no.':>3}  {'name':29}{'material':46}{'size':54}{'count':>5}{'each g':>8}{'EUR':>8}"
        ]
        for k, part in enumerate(self.bill, 1):
            each = f"{1e3 * part.each:.1f}" if part.each else ""
            price = f"{part.number * part.price:.2f}" if part.price else ""
            rows.append(
                f"{k:3}  {part.name:29.28}{part.material:46.45}{part.dimensions:54.53}"
                f"{part.number:5}{each:>8}{price:>8}"
            )
        rows.append(f"{'':5}{'all':134}{1e3 * self.order.mass:8.1f}{self.order.price:8.2f}")
        rows.append("     Prices are assumptions, for orientation: nobody has asked a shop.")
        figures = [_figure(page) for page in pages]
        for start in range(0, len(rows), LINES):
            figures.insert(1 + start // LINES, figure := _figure(Step("Parts and fasteners", [])))
            figure.text(
                0.04,
                0.9,
                "\n".join(rows[start : start + LINES]),
                fontsize=7.5,
                family="monospace",
                va="top",
                linespacing=1.35,
            )
        with PdfPages(out, metadata={"CreationDate": None}) as pdf:
            for figure in figures:
                pdf.savefig(figure)
        return out.getvalue()

    def _joints(self, item: Placed) -> Points:
        """Return the positions of a part's joints in pictures, in mm."""
        joints, side = self.robot.linkage.joints, self.robot.legs[item.leg].side
        place = joint_positions(self.robot, side, ANGLE) @ np.array([1e3, 1e3j])
        return place[[joints.index(joint) for joint in item.part.joints]]

    def _side(self, item: Placed) -> str:
        """Return the side of a part's leg."""
        return self.robot.legs[item.leg].side

    def _rims(self, item: Placed) -> list[Points]:
        """Return the rim, windows and holes of a part in pictures, in mm."""
        at, side = self._joints(item), self.robot.legs[item.leg].side
        return [carried(item.part, shape.polygon, at, side) for shape in item.part.lines]

    def draw_side(self, items: Sequence[Placed], fresh: set[int], joint: str, axes: Axes) -> None:
        """Draw parts as seen from the side, with new parts in colour.

        Args:
            items: Parts to draw. The first part is on top.
            fresh: Numbers of the bodies that are new in this step.
            joint: Name of the joint that is marked by a circle; empty for none.
            axes: Axes to draw on.
        """
        for item in reversed(items):
            at = dict(zip(item.part.joints, self._joints(item), strict=True))
            rims = self._rims(item)
            middle = complex(rims[0].mean())
            for toe in feet_of(self.robot, item.body):
                z = item.part.joints[toe]
                ahead = [z, z + toe_way(item.part, toe)]
                start, end = carried(item.part, ahead, self._joints(item), self._side(item))
                way = end - start
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
        """Draw the first crank pin with its legs and frames."""
        items = [item for item in self.placed if item.unit == 0]
        self.draw_side(items, {item.body for item in items}, "", axes)

    def draw_apart(self, items: Sequence[Placed], axes: Axes) -> None:
        """Draw an exploded view of parts along the shaft, with lines through their pins.

        Args:
            items: Parts to draw.
            axes: Axes to draw on.
        """
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
            axes.annotate(
                joint,
                (ends[-1].real, ends[-1].imag),
                (-12, -4),
                zorder=6,
                textcoords="offset points",
                fontweight="bold",
            )
        _bare(axes)

    def draw_stack(self, stack: Stack, axes: Axes) -> None:
        """Draw the stack on a pin, with part numbers and sizes.

        Args:
            stack: Stack to draw. The head of its screw is on top.
            axes: Axes to draw on.
        """
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
        """Draw the crank pins around the shaft, as seen from the first frame."""
        for k, turn in enumerate(self.turns, 1):
            z = np.exp(1j * turn)
            axes.plot((0.0, z.real), (0.0, z.imag), "o-", lw=14, color=f"C{k}")
            _name(axes, 0.6 * z, f"pin {k}: {math.degrees(turn):.0f} deg")
        axes.plot(HALF.real, HALF.imag, "k:", -HALF.real, -HALF.imag, "k:")
        _bare(axes)

    def draw_section(self, axes: Axes) -> None:
        """Draw a numbered section along the shaft and the frame's bar, at the motor."""
        mount = self.assembly.mount
        turn = self.assembly.ways[self.robot.legs[self.placed[0].leg].side]
        edge = mount.screws[1] + 15.0
        hubs = [solid for solid in self.assembly.solids if self._name_of(solid) == "hub"]
        top = hubs[0].high + self.assembly.parts[CRANK - 1].thickness + 0.5
        seen: dict[int, tuple[float, float]] = {}
        for solid in sorted(self.assembly.solids, key=self._is_flat):
            cut = self._cut(solid, turn)
            if solid.low > top or cut is None or cut[0] > edge:
                continue
            low, high = max(cut[0], -1.6 * mount.motor[0]), min(cut[1], edge)
            if high <= low:
                continue
            number = self._number_of(solid)
            color = f"C{number % 10}"
            width = min(solid.high, top) - solid.low
            spans = _spans(solid, turn, low, high)
            for start, end in spans:
                axes.bar(
                    solid.low,
                    end - start,
                    width,
                    start,
                    align="edge",
                    color=color,
                    ec="black",
                    lw=0.6,
                )
            if spans:
                middle = solid.low + 0.5 * width, 0.5 * (spans[-1][0] + spans[-1][1])
                seen.setdefault(number, middle)
        for k, (number, (x, y)) in enumerate(sorted(seen.items(), key=lambda one: one[1])):
            axes.annotate(
                str(number),
                (x, y),
                (0.03 + 0.94 * k / max(len(seen) - 1, 1), (1.03, 1.07)[k % 2]),
                textcoords="axes fraction",
                fontsize=9,
                ha="center",
                arrowprops={"arrowstyle": "-", "lw": 0.6},
            )
        axes.set_aspect("equal")
        axes.yaxis.tick_right()
        axes.set(xlabel="mm along the shaft from the first frame; upwards along its bar from O")

    def _number_of(self, solid: Solid) -> int:
        """Return the number of a solid's piece in the bill of materials."""
        piece = self.assembly.pieces[solid.piece]
        return self.order.numbers[piece.name, piece.size]

    def _name_of(self, solid: Solid) -> str:
        """Return the name of a solid's piece."""
        return self.assembly.pieces[solid.piece].name

    def _is_flat(self, solid: Solid) -> tuple[bool, float]:
        """Return a key that sorts parts before the thin solids that pass through them."""
        return solid.outline.radius < 3.5, solid.low

    def _cut(self, solid: Solid, turn: complex) -> tuple[float, float] | None:
        """Return where the line through O along a direction crosses a solid, in mm, or None."""
        place = self.assembly.places(solid, np.array([0.0]))[0] / turn
        outline = Round(tuple(place.tolist()), solid.outline.radius)
        return _crossing(outline)

    def draw_ties(self, axes: Axes) -> None:
        """Draw two neighbouring frames with their brace, and the first frame with its standoffs."""
        psi = np.array([0.0])
        first, *others = [s for s in self.assembly.solids if self._name_of(s) == "frame"]
        braces = [s for s in self.assembly.solids if self._name_of(s) == "brace"]
        standoffs = [s for s in self.assembly.solids if self._name_of(s) == "standoff"]
        high = 1.5 * 1e3 * self.robot.bodies[FRAME - 1].distance(0, 1)
        groups = [("first frame, from the motor's side", [first, *standoffs], 0j)]
        if braces:
            pair = [s for s in others if abs(s.high - braces[0].low) < 1e-6]
            pair += [s for s in others if abs(s.low - braces[-1].high) < 10.0 and s not in pair]
            groups.append(("two frames and the brace between them", [*pair[:2], braces[0]], -1j))
        for title, solids, shift in groups:
            at = 0.4 * shift * high
            for solid in solids:
                rims = [solid.outline]
                rims += [
                    cavity.outline
                    for cavity in solid.cavities
                    if cavity.high - cavity.low >= solid.high - solid.low - 1e-6
                ]
                drawn = [at + self.assembly.at(solid, rim.polygon, psi)[0] for rim in rims]
                _fill(axes, drawn, "0.88" if self._name_of(solid) == "frame" else "C1")
            _name(axes, at + 0.13j * high, title)
        _bare(axes)

    def draw_side_view(self, axes: Axes) -> None:
        """Draw all solids as seen from the motor."""
        self._draw_solids(axes, top=False)

    def draw_top_view(self, axes: Axes) -> None:
        """Draw all solids as seen from above, with the motor's end at the bottom."""
        self._draw_solids(axes, top=True)

    def _draw_solids(self, axes: Axes, *, top: bool) -> None:
        """Draw the outlines of all solids, the farthest first, and a scale bar."""
        psi = np.array([ANGLE])
        drawn = []
        for k, solid in enumerate(self.assembly.solids):
            corners = self.assembly.places(solid, psi)[0]
            low, high = Round(tuple(corners.tolist()), solid.outline.radius).box
            if top:
                box = rectangle(complex(high.real - low.real, solid.high - solid.low))
                rims = [np.array(box.polygon) + complex(low.real, solid.low)]
            else:
                windows = [c.outline for c in solid.cavities if len(c.outline.corners) > 1]
                shapes = [solid.outline, *windows]
                rims = [self.assembly.at(solid, shape.polygon, psi)[0] for shape in shapes]
            drawn.append((high.imag if top else -solid.low, k, rims))
        for _, k, rims in sorted(drawn, key=lambda one: one[:2]):
            _fill(axes, rims, f"C{self._number_of(self.assembly.solids[k]) % 10}")
        left, bottom = axes.get_xlim()[0], axes.get_ylim()[0]
        axes.plot((left, left + 100.0), (bottom, bottom), "k", lw=3)
        axes.annotate("100 mm", (left, bottom), (0, -12), textcoords="offset points", fontsize=9)
        axes.set_title("from above" if top else "from the motor's side", fontsize=10, loc="left")
        _bare(axes)

    def draw_wiring(self, axes: Axes) -> None:
        """Draw the electrical components as boxes, with labelled wires."""
        for name, x, y, other, u, v, wire in self.words["wires"]:
            axes.plot((x, u), (y, v), "k", lw=1.5)
            _name(axes, complex(x + u, y + v) / 2, wire)
            for z, text in ((complex(x, y), name), (complex(u, v), other)):
                _name(axes, z, text.replace(" ", "\n", 1), 10.0, "#dce9f7")
        axes.set(xlim=(-0.8, 6.8), ylim=(-0.8, 3.8))
        axes.axis("off")


def draw_flat(parts: Sequence[CutPart], axes: Axes) -> None:
    """Draw flat parts with their engravings.

    Holes have the colours of their classes.

    Args:
        parts: Parts to draw.
        axes: Axes to draw on.
    """
    width = max(part.outline.box[1].real for part in parts)
    for part in parts:
        _fill(axes, [np.array(shape.polygon) for shape in (part.outline, *part.windows)], "0.9")
        for hole in part.holes:
            seen = hole._replace(radius=max(hole.radius, width / 150.0))
            _fill(axes, [np.array(seen.polygon)], HOLES[hole.fit])
        for text, start, end in ((part.title, *part.text), *part.labels):
            z, turn = (start + end) / 2.0, math.degrees(np.angle(end - start))
            room = 750.0 * abs(end - start) / width / len(text)
            axes.text(
                z.real,
                z.imag,
                text,
                ha="center",
                va="center",
                zorder=5,
                fontsize=min(8.0, room),
                rotation=(turn + 90.0) % 180.0 - 90.0,
            )
    _bare(axes)


def _column(axes: Axes, title: str, blocks: Sequence[tuple[str, str, float]]) -> None:
    """Draw a column of blocks, each with its text, colour and width."""
    for y, (text, color, wide) in enumerate(blocks):
        axes.bar(0.0, 0.7, wide, y - 0.35, color=color, ec="black", zorder=2)
        axes.text(
            0.65,
            y,
            "\n".join(_wrapped(text, LABEL)),
            va="center",
            zorder=3,
            fontsize=min(9.0, 200.0 / len(blocks)),
        )
    axes.plot((0.0, 0.0), (0.0, len(blocks) - 1.0), "k", lw=5, zorder=1)
    axes.set_title(title, fontsize=10, loc="left")
    axes.set(xlim=(-0.6, 4.4), ylim=(max(len(blocks), 9.0), -1.0))
    axes.axis("off")


def _bare(axes: Axes) -> None:
    """Draw axes to scale and hide their frame."""
    axes.set_aspect("equal")
    axes.axis("off")


def _tilted(flat: Points, depth: float) -> Points:
    """Return the positions in an exploded view of points at a depth along the shaft."""
    x, y, z = TILT
    return flat.real * x + flat.imag * y + depth * z


def _fill(axes: Axes, rims: Sequence[Points], color: str) -> None:
    """Fill the area inside the first rim, without the areas inside the other rims."""
    closed = [np.append(rim, rim[:1]) for rim in rims]
    inner = [z for rim in closed[1:] for z in (rim[::-1], rims[0][:1])]
    whole = np.concatenate([closed[0], *inner])
    axes.fill(whole.real, whole.imag, color=color, ec="none", zorder=2)
    for rim in closed:
        axes.plot(rim.real, rim.imag, "k", lw=0.7, zorder=2)


def _name(axes: Axes, z: complex, text: str, size: float = 8.0, color: str = "white") -> None:
    """Write a text in a box centred at a point."""
    box = {"boxstyle": "round,pad=0.25", "fc": color, "ec": "0.4", "alpha": 0.9}
    if text:
        axes.text(z.real, z.imag, text, ha="center", va="center", fontsize=size, bbox=box, zorder=7)


def _wrapped(text: str, width: int) -> list[str]:
    """Return the lines of a wrapped text, in which no unit is separated from its number."""
    bound = re.sub(r" (?=(?:k?g|mm|\d+$)\b|x )|(?<= x) ", "\u00a0", text)
    return textwrap.wrap(bound, width, subsequent_indent="  ")


def _grams(mass: Mass) -> str:
    """Return a text with a mass and its acceptable range, in g."""
    digits = int(mass.nominal < 0.1)
    nominal, least, most = (f"{1e3 * kilograms:.{digits}f}" for kilograms in mass)
    return f"{nominal} g ({least} to {most})"


def _crossing(outline: Round) -> tuple[float, float] | None:
    """Return where the x axis crosses an outline, or None if it does not cross the outline."""
    points = np.array(outline.polygon)
    after = np.roll(points, -1)
    cross = (points.imag <= 0.0) != (after.imag <= 0.0)
    if not cross.any():
        return None
    p, q = points[cross], after[cross]
    x = p.real - p.imag * (q.real - p.real) / (q.imag - p.imag)
    return float(x.min()), float(x.max())


def _spans(solid: Solid, turn: complex, low: float, high: float) -> list[tuple[float, float]]:
    """Return the intervals of a line through O that lie in a solid but not in its holes.

    Holes are taken into account only for a solid that is fixed in the chassis.

    Args:
        solid: Solid that the line crosses.
        turn: Direction of the line, as a complex number of magnitude 1.
        low: Start of the line in the solid, in mm from O.
        high: End of the line in the solid, in mm from O.
    """
    spans = [(low, high)]
    if solid.leg >= 0:
        return spans
    for cavity in solid.cavities:
        if cavity.low > solid.low + 1e-6 or cavity.high < solid.high - 1e-6:
            continue
        shape = cavity.outline.moved(1.0 / turn, 0j)
        hole = _crossing(shape)
        if hole:
            pieces = [((a, min(b, hole[0])), (max(a, hole[1]), b)) for a, b in spans]
            spans = [span for pair in pieces for span in pair if span[1] > span[0] + 1e-6]
    return spans


def _figure(step: Step) -> Figure:
    """Return a page with pictures on the left, text on the right, and the mass below the text."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE)
    figure.text(0.04, 0.94, step.title, fontsize=18, fontweight="bold")
    lines = []
    for line in step.text:
        lines += _wrapped(line if line[:1] == "[" else f"- {line}", COLUMN)
    size = min(9.5, 9.5 * (31.0 if step.mass else 36.0) / max(len(lines), 1))
    figure.text(0.68, 0.88, "\n".join(lines), fontsize=size, va="top", linespacing=1.45)
    if step.mass:
        check = "\n".join(_wrapped(f"{step.weighed}: {_grams(step.mass)}", LABEL))
        box = {"boxstyle": "round,pad=0.5", "fc": "#fff3c4"}
        figure.text(0.68, 0.05, check, fontsize=11, va="bottom", fontweight="bold", bbox=box)
    wide = 0.64 / max(len(step.pictures), 1)
    for k, draw in enumerate(step.pictures):
        draw(figure.add_axes((0.03 + k * wide, 0.05, 0.95 * wide, 0.81)))
    return figure
