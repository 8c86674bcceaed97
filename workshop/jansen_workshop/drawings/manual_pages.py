"""Layout of the instructions on A4 pages: steps, and the lists of parts and holes."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from jansen_workshop.drawings.holes import HoleLine, count_by_diameter
from jansen_workshop.drawings.order import Mass, Order
from jansen_workshop.drawings.part_pictures import LABEL, Picture, wrapped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = (11.69, 8.27)  # size of an A4 page, in inches
LINES = 40  # most parts in the list of a page
COLUMN = 48  # characters per line of a page's text


class Step(NamedTuple):
    """Page of the instructions.

    Attributes:
        title: Title of the page.
        text: Instructions, one per line.
        pictures: Functions that draw the pictures.
        weighed: Name of the assembly to weigh.
        mass: Mass of this assembly; None if nothing is weighed.
        stacked: Whether the pictures are placed one below the other rather than side by side.
        widths: Relative widths of pictures that are side by side; empty for equal widths.
    """

    title: str
    text: list[str]
    pictures: Sequence[Picture] = ()
    weighed: str = ""
    mass: Mass | None = None
    stacked: bool = False
    widths: Sequence[float] = ()


def bill_figures(order: Order) -> list[Figure]:
    """Return the pages with the bill of materials.

    Args:
        order: Bill of materials.
    """
    return _table_figures("List of parts", _bill_rows(order))


def hole_figures(lines: Sequence[HoleLine]) -> list[Figure]:
    """Return the pages with the list of holes, and with the number of holes of each diameter.

    Args:
        lines: List of holes.
    """
    return _table_figures("List of holes", _hole_rows(lines))


def _table_figures(title: str, table: Sequence[str]) -> list[Figure]:
    """Return pages with a table, whose lines are in a font of constant width, the header first."""
    header, *rows = table
    pages = math.ceil(len(rows) / LINES)
    length = math.ceil(len(rows) / pages)
    size = min(9.0, 760.0 / (0.602 * max(map(len, table))))  # points; a letter is 0.602 wide
    figures = []
    for start in range(0, len(rows), length):
        figure = page_figure(Step(title, []))
        figure.text(
            0.04,
            0.89,
            "\n".join([header, *rows[start : start + length]]),
            fontsize=size,
            family="monospace",
            va="top",
            linespacing=min(2.0, 490.0 / ((length + 1) * size)),
        )
        figures.append(figure)
    return figures


def _bill_rows(order: Order) -> list[str]:
    """Return the bill of materials as lines of a table in a font of constant width."""
    cells = [("no.", "name", "material", "size", "count", "g each", "EUR in all")]
    for k, part in enumerate(order.parts, 1):
        grams = 1e3 * part.each
        each = f"{grams:.{1 if grams >= 0.1 else 2}f}" if part.each else ""
        price = f"{part.number * part.price:.2f}" if part.price else ""
        cells.append(
            (str(k), part.name, part.material, part.dimensions, str(part.number), each, price)
        )
    cells.append(("", "total", "", "", "", f"{1e3 * order.mass:.1f}", f"{order.price:.2f}"))
    rows = _aligned(cells, left=(1, 2, 3))
    return [*rows, "     The prices are assumptions: nobody has asked a shop."]


def _hole_rows(lines: Sequence[HoleLine]) -> list[str]:
    """Return the list of holes as lines of a table in a font of constant width."""
    cells = [("no.", "name", "mm", "use", "holes each", "parts", "holes in all")]
    cells += [
        (
            str(line.number),
            line.name,
            f"{line.diameter:g}",
            line.use,
            str(line.each),
            str(line.parts),
            str(line.total),
        )
        for line in lines
    ]
    totals = (f"{mm:g} mm: {count}" for mm, count in count_by_diameter(lines).items())
    return [
        *_aligned(cells, left=(1, 3)),
        "",
        f"Holes by diameter: {'; '.join(totals)}.",
        "The diameters include the allowances of --fit. Do not drill a hole that is already cut.",
    ]


def _aligned(cells: Sequence[Sequence[str]], left: Sequence[int]) -> list[str]:
    """Return the rows of a table as texts with aligned columns.

    Args:
        cells: Texts by row and column.
        left: Columns that are aligned to the left; all others are aligned to the right.
    """
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(
            text.ljust(width) if column in left else text.rjust(width)
            for column, (text, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]


def _grams(mass: Mass) -> str:
    """Return a text with a mass and its acceptable range, in g."""
    digits = int(mass.nominal < 0.1)
    nominal, least, most = (f"{1e3 * kilograms:.{digits}f}" for kilograms in mass)
    return f"{nominal} g ({least} to {most} g)"


def _text_lines(text: str) -> list[str]:
    """Return the lines of one instruction: a part to take, a box to tick, or a sentence."""
    if text.startswith("["):
        return wrapped(text, COLUMN)
    if re.match(r"\d+ x no", text):
        return [f"     {line}" for line in wrapped(text, COLUMN - 5)]
    return wrapped(f"- {text}", COLUMN)


def page_figure(step: Step) -> Figure:
    """Return a page with pictures on the left, text on the right, and the mass below the text.

    Args:
        step: Contents of the page.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE)
    figure.text(0.04, 0.94, step.title, fontsize=18, fontweight="bold")
    lines = [line for text in step.text for line in _text_lines(text)]
    size = min(9.5, 9.5 * (31.0 if step.mass else 36.0) / max(len(lines), 1))
    figure.text(0.68, 0.88, "\n".join(lines), fontsize=size, va="top", linespacing=1.45)
    if step.mass:
        check = "\n".join([*textwrap.wrap(f"{step.weighed}:", LABEL), _grams(step.mass)])
        yellow = {"boxstyle": "round,pad=0.5", "fc": "#fff3c4"}
        figure.text(0.68, 0.05, check, fontsize=11, va="bottom", fontweight="bold", bbox=yellow)
    for box, draw in zip(_boxes(step), step.pictures, strict=True):
        draw(figure.add_axes(box))
    return figure


def _boxes(step: Step) -> list[tuple[float, float, float, float]]:
    """Return the left edge, lower edge, width and height of each picture of a page.

    They are fractions of the page.
    """
    many = len(step.pictures)
    if step.stacked:
        height = 0.84 / many
        return [(0.03, 0.89 - k * height, 0.61, 0.88 * height) for k in range(1, many + 1)]
    widths = step.widths or [1.0] * many
    boxes = []
    left = 0.03
    for part in widths:
        width = 0.64 * part / sum(widths)
        boxes.append((left, 0.05, 0.95 * width, 0.81))
        left += width
    return boxes
