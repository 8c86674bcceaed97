"""Bill of materials of a machine, made from its solids: every part to cut, to saw, or to buy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM
from jansen_workshop.drawings.assembly import Assembly
from jansen_workshop.drawings.bought import Catalogue, read_catalogue
from jansen_workshop.drawings.machine_solids import assemble
from jansen_workshop.drawings.materials import (
    BAR,
    SHEET,
    Part,
    bill_of_materials,
    counts,
    flat_size,
)
from jansen_workshop.drawings.outlines import cut_parts
from jansen_workshop.drawings.shaft_order import Placed
from jansen_workshop.drawings.solids import AssemblyPiece
from jansen_workshop.drawings.spring_parts import spring_rows

PLYWOOD_SPREAD = -0.10, 0.13
"""Lowest and highest relative deviation of a plywood part's mass from its nominal mass.

The limits allow for plywood that is 2.9 to 3.2 mm thick and has a density of 640 to 720 kg/m^3.
"""
SPREAD = -0.03, 0.03  # relative deviation of the mass of any other part


class Mass(NamedTuple):
    """Mass of an assembly, in kg.

    Attributes:
        nominal: Mass according to the drawings.
        least: Lowest acceptable mass.
        most: Highest acceptable mass.
    """

    nominal: float
    least: float
    most: float


def flat_rows(robot: Robot, prices: dict[str, Any]) -> list[Part]:
    """Return the lines of the parts to cut, in the order of their numbers.

    Args:
        robot: Robot whose parts are cut.
        prices: Prices as in ``parts.yml``. ``prices["flat"]`` has the price of flat parts by the
            robot's material, in EUR/kg.

    Returns:
        One line per flat part, with its mass as drawn.
    """
    number = counts(robot)
    metal = robot.build is ALUMINIUM
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
                part.name,
                material,
                size,
                number[part.name],
                part.mass,
                part.thickness,
                price=price,
            )
        )
    return rows


class Order:
    """Bill of materials of a machine, with masses and prices.

    Args:
        robot: Robot that the machine is built from.
        placed: Parts of the robot along the shaft. If None, because the links collide, there is
            no solid model. The bill then lists the parts to cut, the bought components, and the
            simulated robot's shares of pins and feet.
    """

    def __init__(self, robot: Robot, placed: Sequence[Placed] | None) -> None:
        self.robot = robot
        self.assembly = None if placed is None else assemble(robot, placed)

    @cached_property
    def parts(self) -> list[Part]:
        """All lines of the bill.

        First come the parts to cut, in the order of their numbers. Then come the bought components
        of ``parts.yml`` and the springs, and last the fasteners and other joining parts, sorted by
        name and size.
        """
        catalogue = read_catalogue(self.robot.material)
        cut = flat_rows(self.robot, catalogue.prices)
        bought = [
            Part(
                component.name,
                component.material,
                component.size,
                component.number,
                1e-3 * component.grams,
                price=float(component.price),
            )
            for component in catalogue.components
        ]
        bought += spring_rows(self.robot)
        if self.assembly is None:
            return [*cut, *bought, *_simulated_joining_parts(self.robot)]
        listed = {part.name for part in (*cut, *bought)}
        return [*cut, *bought, *_joining_parts(self.assembly, catalogue, listed)]

    @cached_property
    def numbers(self) -> dict[tuple[str, str], int]:
        """Number of each line of the bill, by name and size.

        A flat part is also listed by its name and an empty size.
        """
        numbers = {(part.name, part.dimensions): k for k, part in enumerate(self.parts, 1)}
        flat = {(part.name, ""): k for k, part in enumerate(self.parts, 1) if part.thickness}
        return numbers | flat

    @property
    def mass(self) -> float:
        """Mass of all parts, in kg."""
        return sum(part.mass for part in self.parts)

    @property
    def price(self) -> float:
        """Price of all parts, in EUR."""
        return sum(part.number * part.price for part in self.parts)

    def line(self, piece: AssemblyPiece) -> Part:
        """Return the line of the bill that lists a piece.

        Args:
            piece: Piece of the machine.
        """
        return self.parts[self.numbers[piece.name, piece.size] - 1]

    def weigh(self, pieces: Sequence[AssemblyPiece]) -> Mass:
        """Return the mass of pieces, with its lowest and highest acceptable value.

        :data:`PLYWOOD_SPREAD` applies to plywood parts, and :data:`SPREAD` to all other parts.

        Args:
            pieces: Pieces to weigh together.
        """
        low = high = nominal = 0.0
        for piece in pieces:
            part = self.line(piece)
            wood = part.thickness and self.robot.build is not ALUMINIUM
            less, more = PLYWOOD_SPREAD if wood else SPREAD
            nominal += part.each
            low += part.each * (1.0 + less)
            high += part.each * (1.0 + more)
        return Mass(nominal, low, high)


def _simulated_joining_parts(robot: Robot) -> list[Part]:
    """Return the simulated robot's shares of pins and feet, for a machine without solid model."""
    return [
        part._replace(note="a share of the simulated robot")
        for part in bill_of_materials(robot)[len(robot.bodies) :]
        if part.name.startswith(("pin", "foot's"))
    ]


def _joining_parts(assembly: Assembly, catalogue: Catalogue, listed: set[str]) -> list[Part]:
    """Return the lines of the pieces that are not yet listed, sorted by name and size."""
    count = assembly.count
    masses: dict[tuple[str, str], float] = {}
    for piece, mass in zip(assembly.pieces, assembly.masses(), strict=True):
        # Pieces that are sawn to different lengths have their mean mass.
        key = piece.name, piece.size
        masses[key] = masses.get(key, 0.0) + mass / count[key]
    rows = []
    for (name, size), number in sorted(count.items(), key=_by_size):
        if name in listed:
            continue
        price = catalogue.prices[name]
        each = price[assembly.robot.material] if isinstance(price, dict) else price
        material = catalogue.materials.get(name, "steel")
        rows.append(Part(name, material, size, number, masses[name, size], price=each))
    return rows


def _by_size(piece: tuple[tuple[str, str], int]) -> tuple[str, list[float]]:
    """Return a key that sorts pieces by name, then by the numbers in their size."""
    (name, size), _ = piece
    return name, [*map(float, re.findall(r"\d+\.?\d*", size))]
