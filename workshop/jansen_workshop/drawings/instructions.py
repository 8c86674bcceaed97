"""Instructions to build a machine from its drawings, as a PDF to print with one page per step.

The file ``instructions.yml`` contains the text.
"""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from jansen_env.files.plain_yaml import read_yaml
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_workshop.drawings.holes import HoleLine, list_holes
from jansen_workshop.drawings.machine_solids import encoder_gap
from jansen_workshop.drawings.manual_pages import Step, bill_figures, hole_figures, page_figure
from jansen_workshop.drawings.materials import Row, Stack, counts, stacks
from jansen_workshop.drawings.mount import units
from jansen_workshop.drawings.order import Order
from jansen_workshop.drawings.outlines import FITS, CutPart
from jansen_workshop.drawings.part_pictures import (
    ANGLE,
    Picture,
    Wire,
    draw_column,
    draw_exploded,
    draw_flat,
    draw_links,
    draw_phases,
    draw_wiring,
)
from jansen_workshop.drawings.shaft_order import Placed
from jansen_workshop.drawings.solid_pictures import (
    draw_foot,
    draw_section,
    draw_side_view,
    draw_ties,
    draw_top_view,
)
from jansen_workshop.drawings.solids import AssemblyPiece


class Manual:
    """Pages that explain how to build a machine.

    Args:
        order: Bill of materials, which numbers all parts, with the solids of the machine.
        flat: Every flat part, laid out on one sheet.
        first: Pieces of the coupon.

    Attributes:
        order: Bill of materials.
        assembly: Solids of the machine.
        robot: Robot that the machine is built from.
        stacks: Pins and axles with everything on them.
        units: Indices of the legs on each crank pin.
        turns: Angle of each crank pin from the first one, in rad.
    """

    def __init__(self, order: Order, flat: Sequence[CutPart], first: Sequence[CutPart]) -> None:
        assert order.assembly is not None
        self.order = order
        self.assembly = order.assembly
        self.robot = order.robot
        self.stacks = stacks(self.robot, self.assembly.placed)
        self.units = units(self.robot)
        legs = self.robot.legs
        phases = [legs[on[0]].phase - legs[0].phase for on in self.units]
        self.turns = [phase % (2.0 * math.pi) for phase in phases]
        self._flat = flat
        self._coupon = first
        self._pages = read_yaml(Path(__file__).with_name("instructions.yml"))
        self._pin = self.robot.linkage.bodies[CRANK - 1][1][1]

    def label(self, row: Row) -> str:
        """Return the number, name and size of an entry of a stack.

        Args:
            row: Entry of the stack.
        """
        many = f"{row.number} x " if row.number > 1 else ""
        number = row.item.body if row.item else self.order.numbers[row.name, row.size]
        return f"{many}no. {number}: {row.name} {row.size}".strip()

    def steps(self) -> list[Step]:
        """Return all steps in order.

        The last step that has a mass has that of the whole machine.
        """
        return [self._flat_step(), *self._unit_steps(), *self._machine_steps(), self._last_step()]

    def holes(self) -> list[HoleLine]:
        """Return the list of the holes of all flat parts."""
        return list_holes(self.robot, self._flat)

    # Pages

    def _page(
        self,
        name: str,
        pictures: Sequence[Picture],
        weighed: Sequence[AssemblyPiece] = (),
        put_on: Sequence[AssemblyPiece] = (),
        **fields: object,
    ) -> Step:
        """Return a page of ``instructions.yml``; the head of that file explains its markup.

        Args:
            name: Name of the page.
            pictures: Functions that draw the pictures.
            weighed: Pieces whose total mass is shown in the page's box.
            put_on: Pieces that are added on the page, which the page may list.
            **fields: Values for the names in braces.
        """
        page = self._pages[name]
        text: list[str] = []
        for line in page["text"].format(**fields).splitlines():
            said = self._applicable(line)
            if said is None:
                continue
            if said.startswith("= "):
                text += self._listed(said[2:], put_on)
            else:
                text.append(said)
        title = page["title"].format(**fields)
        mass = self.order.weigh(weighed) if weighed else None
        return Step(
            title,
            text,
            pictures,
            page.get("weighed", ""),
            mass,
            page.get("stacked", False),
            page.get("widths", ()),
        )

    def _applicable(self, line: str) -> str | None:
        """Return a line without its conditions; None if the machine does not meet one of them.

        A condition is the name of a part that the machine has, or, after an exclamation mark,
        does not have.
        """
        names = {part.name for part in self.order.parts}
        *conditions, text = line.split("? ")
        for condition in conditions:
            if (condition.lstrip("!") in names) == condition.startswith("!"):
                return None
        return text

    def _listed(self, name: str, pieces: Sequence[AssemblyPiece]) -> list[str]:
        """Return a line for each size of the pieces called ``name``, with count and number."""
        found = Counter((piece.name, piece.size) for piece in pieces if piece.name == name)
        lines = []
        for (_, size), count in sorted(found.items()):
            number = self.order.numbers[name, size]
            part = self.order.parts[number - 1]
            lines.append(f"{count} x no. {number}: {name} {part.dimensions}")
        return lines

    def _of_stages(self, *stages: str) -> list[AssemblyPiece]:
        """Return the pieces that are assembled in any of the stages."""
        return [piece for piece in self.assembly.pieces if piece.stage in stages]

    # Steps

    def _flat_step(self) -> Step:
        """Return the step that prepares the flat parts."""
        cut = counts(self.robot)
        flat = [piece for piece in self.assembly.pieces if piece.name in cut]
        bushes = [piece for piece in self.assembly.pieces if piece.name == "bush"]
        return self._page("flat", [partial(draw_flat, self._flat)], flat, bushes)

    def _unit_steps(self) -> list[Step]:
        """Return the steps that build the units, once for each kind of unit."""
        kinds: dict[tuple[str, ...], list[int]] = {}  # equal units, by the sides of their legs
        for unit, legs in enumerate(self.units):
            sides = tuple(self.robot.legs[leg].side for leg in legs)
            kinds.setdefault(sides, []).append(unit)
        steps = []
        for alike in kinds.values():
            which = f" of leg {self.units[alike[0]][0] + 1}" if len(kinds) > 1 else ""
            steps += self._steps_of_unit(alike[0], len(alike), which)
        return steps

    def _steps_of_unit(self, unit: int, number: int, which: str) -> list[Step]:
        """Return the steps that build a unit.

        They build one leg, pin by pin from its foot on, and then the crank pin with its links.

        Args:
            unit: Index of the unit.
            number: Number of equal units.
            which: Text added to the titles to tell different units apart.
        """
        legs = self.units[unit]
        leg = legs[0]
        every = [item for item in self.assembly.placed if item.unit == unit]
        mine = [item for item in every if item.leg == leg]
        links = [item for item in mine if item.body not in (FRAME, CRANK)]
        pieces = [piece for piece in self.assembly.pieces if piece.unit == unit]
        joined = self._bodies_with_feet()
        done: set[str] = set()

        many = f"{number * len(legs)} of them"
        if len(legs) > 1:
            many += ": fore and back legs are identical, turned by half a turn about the vertical"
        steps = [
            self._page(
                "foot",
                [
                    partial(draw_exploded, self.robot, links),
                    partial(draw_foot, self.assembly, self.order.numbers),
                ],
                _built(pieces, leg, joined, done),
                [piece for piece in pieces if piece.leg == leg and piece.stage == "foot"],
                which=which,
                many=many,
            )
        ]
        *pins, crank_pin = self._pin_sequence(unit, leg)
        for stack in pins:
            fresh = stack.bodies - joined
            joined |= fresh
            done.add(stack.joint)
            items = [item for item in mine if item.body in joined]
            weighed = _built(pieces, leg, joined, done)
            page = self._pin_page("pin", stack, items, fresh, weighed, which=which, many=many)
            steps.append(page)
        # The unit is complete: all legs, and two cranks with their hubs.
        joined |= crank_pin.bodies
        steps.append(
            self._pin_page(
                "crank",
                crank_pin,
                [item for item in every if item.body in joined],
                crank_pin.bodies,
                [piece for piece in pieces if piece.stage in ("foot", "links", "pin", "crank")],
                [piece for piece in pieces if piece.stage == "crank"],
                reach=self._hub_screw_distance(),
                which=which,
                many=f"{number} of them",
            )
        )
        return steps

    def _hub_screw_distance(self) -> float:
        """Return the distance of a hub's two screws from the axis, in mm."""
        crank = self.assembly.parts[CRANK - 1]
        axis = crank.joints[self.robot.linkage.bodies[CRANK - 1][1][0]]
        return round(abs(crank.holes[-1].corners[0] - axis), 2)

    def _bodies_with_feet(self) -> set[int]:
        """Return the numbers of the bodies that carry feet, from 1 on."""
        linkage = self.robot.linkage
        return {body + 1 for _, body in linkage.all_pads[: len(linkage.toes)]}

    def _pin_sequence(self, unit: int, leg: int) -> list[Stack]:
        """Return the pins of a leg in the order of assembly, from the foot on, crank pin last."""
        pins = [
            stack
            for stack in self.stacks
            if not stack.axle and stack.unit == unit and stack.leg == leg
        ]
        pins.sort(key=lambda stack: stack.joint == self._pin)
        joined = self._bodies_with_feet()
        sequence = []
        while pins:
            stack = next((s for s in pins[:-1] if joined & s.bodies), pins[0])
            pins.remove(stack)
            joined |= stack.bodies
            sequence.append(stack)
        return sequence

    def _pin_page(
        self,
        name: str,
        stack: Stack,
        items: Sequence[Placed],
        fresh: set[int],
        weighed: Sequence[AssemblyPiece],
        put_on: Sequence[AssemblyPiece] = (),
        **fields: object,
    ) -> Step:
        """Return a page that puts links on a pin.

        Args:
            name: Name of the page.
            stack: What is on the pin.
            items: Links that are shown.
            fresh: Numbers of the bodies that are new.
            weighed: Pieces whose total mass is shown in the page's box.
            put_on: Pieces that the page may list.
            **fields: Values for the names in braces.
        """
        screw, nut = map(self.label, stack.bolt)
        pictures: list[Picture] = [
            partial(draw_links, self.robot, items, fresh, stack.joint),
            self._stack_picture(stack),
        ]
        return self._page(
            name,
            pictures,
            weighed,
            put_on,
            joint=stack.joint,
            screw=screw,
            nut=nut,
            **fields,
        )

    def _machine_steps(self) -> list[Step]:
        """Return the steps that put the units, the motor and the electronics together."""
        mount = self.assembly.mount
        numbers = self.order.numbers
        fields = {
            "heights": "\n".join(self._pin_heights()),
            "near": mount.screws[0],
            "far": mount.screws[1],
            "gap": encoder_gap(self.assembly),
            **self._brace_fields(),
        }
        axles = [self._stack_picture(stack) for stack in self.stacks if stack.axle]
        pictures: dict[str, list[Picture]] = {
            "ties": [partial(draw_ties, self.assembly)],
            "frames": axles,
            "phases": [partial(draw_phases, self.turns)],
            "motor": [partial(draw_section, self.assembly, numbers)],
            "mounting": [
                partial(draw_side_view, self.assembly, numbers, "mounting"),
                partial(draw_top_view, self.assembly, numbers, "mounting"),
            ],
            "wiring": [partial(draw_wiring, self._wires())],
            "power": [self._first_unit_picture()],
        }
        frames = [
            piece for piece in self.assembly.pieces if piece.stage == "ties" or piece.body == FRAME
        ]
        stages = ["foot", "links", "pin", "crank"]
        steps = []
        for name, drawings in pictures.items():
            stages.append(name)
            weighed = frames if name == "ties" else self._of_stages(*stages)
            steps.append(self._page(name, drawings, weighed, self._of_stages(name), **fields))
        return steps

    def _pin_heights(self) -> list[str]:
        """Return a line for each crank pin with its angle and its position from the shaft."""
        radius = 1e3 * self.robot.bodies[CRANK - 1].distance(0, 1)
        lines = []
        for k, turn in enumerate(self.turns, 1):
            up = round(radius * math.sin(turn), 1)
            right = round(radius * math.cos(turn), 1)
            lines.append(
                f"Crank pin {k}: {math.degrees(turn):.0f} degrees; "
                f"{abs(up):.1f} mm {'below' if up < 0.0 else 'above'} and "
                f"{abs(right):.1f} mm {'left' if right < 0.0 else 'right'} of the shaft"
            )
        return lines

    def _wires(self) -> list[Wire]:
        """Return the wires of the machine."""
        wires = []
        for kind, start, x, y, end, u, v, label in self._pages["wires"]:
            name = self._applicable(start)
            if name is not None:
                wires.append(Wire(kind, name, complex(x, y), end, complex(u, v), label))
        return wires

    def _brace_fields(self) -> dict[str, object]:
        """Return fields of the brace: angle between frames in degrees, distance of pivots in mm."""
        ways = [*self.assembly.ways.values()]
        angle = abs(np.angle(ways[0] / ways[-1]))
        reach = 1e3 * self.robot.bodies[FRAME - 1].distance(0, 1)
        linkage = self.robot.linkage
        axis = linkage.joints[linkage.axis]
        pivot = next(joint for joint in linkage.bodies[FRAME - 1][1] if joint != axis)
        return {
            "angle": math.degrees(angle),
            "apart": reach * abs(ways[0] - ways[-1]),
            "pivot": pivot,
        }

    def _last_step(self) -> Step:
        """Return the page that shows the assembled machine."""
        numbers = self.order.numbers
        pictures = [
            partial(draw_side_view, self.assembly, numbers, ""),
            partial(draw_top_view, self.assembly, numbers, ""),
        ]
        return self._page("assembled", pictures, turned=math.degrees(ANGLE))

    # Pictures

    def _first_unit_picture(self) -> Picture:
        """Return a function that draws the first crank pin with its legs and frames."""
        items = [item for item in self.assembly.placed if item.unit == 0]
        return partial(draw_links, self.robot, items, {item.body for item in items}, "")

    def _stack_picture(self, stack: Stack) -> Picture:
        """Return a function that draws the stack on a pin, with part numbers and sizes.

        The head of the screw is on top.
        """
        bolt = [(self.label(row._replace(number=1)), "0.4", 0.55) for row in stack.bolt]
        title = f"Pin {stack.joint}"
        if stack.axle:
            title = f"{bolt[0][0]},\n{stack.joint} of {stack.side} legs"
        rows = [self._block(stack, row) for row in stack.rows if row.name != "ring"]
        return partial(draw_column, title, [bolt[stack.axle], *rows, bolt[1]])

    def _block(self, stack: Stack, row: Row) -> tuple[str, str, float]:
        """Return the text, the colour and the width of the block that shows an entry of a stack."""
        text = self.label(row)
        if row.item is None:
            return text, "0.8", 0.34
        pins = self.robot.linkage.pins
        fixed_on_pin = next((pin.other for pin in pins if pin.joint == stack.joint), 0)
        text += " (is held)" if row.item.body == fixed_on_pin else " (turns)"
        if stack.axle or stack.joint == self._pin:
            text += f", leg {row.item.leg + 1}"
        return text, f"C{row.item.body - 1}", 1.0

    # PDF

    def to_pdf(self, title: str) -> bytes:
        """Return the instructions as a PDF on A4 pages: cover, lists, coupon and steps.

        The lists are those of the parts and of the holes. The bytes are the same every time.

        Args:
            title: Title on the cover.
        """
        from matplotlib.backends.backend_pdf import PdfPages

        *steps, last = self.steps()
        numbered = [
            step._replace(title=f"Step {k} of {len(steps)}: {step.title}")
            for k, step in enumerate(steps, 1)
        ]
        cover = self._cover(title, len(steps))
        pages = [page_figure(page) for page in (self._coupon_page(), *numbered, last)]
        lists = [*bill_figures(self.order), *hole_figures(self.holes())]
        figures = [page_figure(cover), *lists, *pages]
        out = io.BytesIO()
        with PdfPages(out, metadata={"CreationDate": None}) as pdf:
            for figure in figures:
                pdf.savefig(figure)
        return out.getvalue()

    def _cover(self, title: str, steps: int) -> Step:
        """Return the first page, which has a ``title`` and tells the number of ``steps``."""
        low, high = self.assembly.extent
        return self._page(
            "cover",
            [self._first_unit_picture()],
            title=title,
            legs=len(self.robot.legs),
            pins=len(self.units),
            width=high - low,
            weight=self.order.mass,
            simulated=self.robot.mass,
            price=self.order.price,
            cut=sum(counts(self.robot).values()),
            lines=len(self.order.parts),
            steps=steps,
        )

    def _coupon_page(self) -> Step:
        """Return the page that explains the coupon."""
        fits = [f"{name}: {', '.join(f'{mm:+g}' for mm in fit)}" for name, fit in FITS.items()]
        return self._page("coupon", [partial(draw_flat, self._coupon)], fits="\n".join(fits))


def _built(
    pieces: Sequence[AssemblyPiece], leg: int, joined: set[int], done: set[str]
) -> list[AssemblyPiece]:
    """Return the pieces of a leg that are assembled so far.

    Args:
        pieces: Pieces of the unit.
        leg: Index of the leg.
        joined: Numbers of the bodies that are joined to the foot.
        done: Names of the joints whose pins are in place.
    """
    return [
        piece
        for piece in pieces
        if piece.leg == leg
        and (
            piece.stage == "foot"
            or (piece.stage == "links" and piece.body in joined)
            or (piece.stage == "pin" and piece.joint in done)
        )
    ]
