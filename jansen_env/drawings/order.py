"""What is cut, sawn and bought for a machine: its bill of materials, made from its solids."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

from jansen_env.drawings.assembly import Assembly, Piece, bought_parts
from jansen_env.drawings.materials import BAR, SHEET, Part, bill_of_materials, counts, flat_size
from jansen_env.drawings.outlines import cut_parts
from jansen_env.drawings.shaft_order import Placed
from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM

PLYWOOD_SPREAD = -0.10, 0.13
"""Share by which the mass of a plywood part may be off: 2.9 to 3.2 mm thick, 640 to 720 kg/m^3."""
SPREAD = -0.03, 0.03  # of all else


class Mass(NamedTuple):
    """Mass of an assembly by its drawing, kg, and the least and most that is all right."""

    nominal: float
    least: float
    most: float


def flat_rows(robot: Robot, prices: dict[str, Any]) -> list[Part]:
    """Return the lines of what is cut, by number, with the masses of the drawing."""
    number, metal = counts(robot), robot.build is ALUMINIUM
    rows = []
    for part in cut_parts(robot):
        material = robot.build.material
        if metal:
            bar = len(part.outline.corners) == 2 and part.joints
            material = BAR if bar else SHEET
        price = round(prices["flat"][robot.material] * part.mass, 2)
        size = flat_size(robot, part)
        rows.append(
            Part(
                part.name, material, size, number[part.name], part.mass, part.thickness,
                price=price,
            )
        )  # fmt: skip
    return rows


class Order:
    """The bill of materials of a machine, from its solids, with masses and prices.

    Args:
        robot: the robot.
        placed: its parts along the shaft; None where links collide, so that the bill has only what
            is cut and what has a maker.
    """

    def __init__(self, robot: Robot, placed: Sequence[Placed] | None) -> None:
        self.robot = robot
        self.assembly = None if placed is None else Assembly(robot, placed)

    @cached_property
    def parts(self) -> list[Part]:
        """All lines: what is cut, by number; what has a maker; what joins all, by name and size."""
        words = bought_parts()
        prices, material = words["prices"], self.robot.material
        rows = flat_rows(self.robot, prices)
        cut = {part.name for part in rows}
        bought = [
            Part(name, made_of, size, number, 1e-3 * grams, price=float(price))
            for _, name, made_of, size, number, grams, price, *_ in words[material]
        ]
        known = {part.name for part in bought}
        joining = []
        if self.assembly is None:  # shares of the model, as nobody knows how long the screws are
            joining = [
                part._replace(note="a share of the simulated robot")
                for part in bill_of_materials(self.robot)[len(self.robot.bodies) :]
                if part.name.startswith(("pin", "foot's"))
            ]
        else:
            masses: dict[tuple[str, str], float] = {}
            count = self.assembly.count
            for piece, mass in zip(self.assembly.pieces, self.assembly.masses(), strict=True):
                key = piece.name, piece.size  # sawn off to different lengths: their mean
                masses[key] = masses.get(key, 0.0) + mass / count[key]
            for (name, size), number in sorted(count.items(), key=_by_size):
                if name in cut or name in known:
                    continue
                price = prices[name]
                each = price[material] if isinstance(price, dict) else price
                made_of = words["materials"].get(name, "steel")
                joining.append(Part(name, made_of, size, number, masses[name, size], price=each))
        return [*rows, *bought, *joining]

    @cached_property
    def numbers(self) -> dict[tuple[str, str], int]:
        """Number of each line by name and size, and of a flat part by its name alone."""
        numbers = {(part.name, part.dimensions): k for k, part in enumerate(self.parts, 1)}
        flat = {(part.name, ""): k for k, part in enumerate(self.parts, 1) if part.thickness}
        return numbers | flat

    @property
    def mass(self) -> float:
        """Mass of everything, kg."""
        return sum(part.mass for part in self.parts)

    @property
    def price(self) -> float:
        """Price of everything, EUR."""
        return sum(part.number * part.price for part in self.parts)

    def line(self, piece: Piece) -> Part:
        """Return the line of a piece."""
        return self.parts[self.numbers[piece.name, piece.size] - 1]

    def weigh(self, pieces: Sequence[Piece]) -> Mass:
        """Return the mass of some pieces, with what plywood and all else may differ by."""
        low = high = nominal = 0.0
        for piece in pieces:
            part = self.line(piece)
            wood = part.thickness and self.robot.build is not ALUMINIUM
            less, more = PLYWOOD_SPREAD if wood else SPREAD
            nominal += part.each
            low += part.each * (1.0 + less)
            high += part.each * (1.0 + more)
        return Mass(nominal, low, high)


def _by_size(piece: tuple[tuple[str, str], int]) -> tuple[str, list[float]]:
    (name, size), _ = piece
    return name, [*map(float, re.findall(r"\d+\.?\d*", size))]
