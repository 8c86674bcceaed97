"""Layout of the instructions on A4 pages: steps, and the list of parts and fasteners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from jansen_workshop.drawings.order import Mass, Order
from jansen_workshop.drawings.part_pictures import LABEL, Picture, wrapped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = (11.69, 8.27)  # size of an A4 page, in inches
LINES = 50  # rows of a list per page
COLUMN = 48  # characters per line of a page's text


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


def bill_figures(order: Order) -> list[Figure]:
    """Return the pages with the bill of materials.

    Args:
        order: Bill of materials.
    """
    rows = _bill_rows(order)
    figures = []
    for start in range(0, len(rows), LINES):
        figure = page_figure(Step("Parts and fasteners", []))
        figure.text(
            0.04,
            0.9,
            "\n".join(rows[start : start + LINES]),
            fontsize=7.5,
            family="monospace",
            va="top",
            linespacing=1.35,
        )
        figures.append(figure)
    return figures


def _bill_rows(order: Order) -> list[str]:
    """Return the bill of materials as lines of a table in a font of constant width."""
    rows = [f"{'no.':>3}  {'name':29}{'material':46}{'size':54}{'count':>5}{'each g':>8}{'EUR':>8}"]
    for k, part in enumerate(order.parts, 1):
        each = f"{1e3 * part.each:.1f}" if part.each else ""
        price = f"{part.number * part.price:.2f}" if part.price else ""
        rows.append(
            f"{k:3}  {part.name:29.28}{part.material:46.45}{part.dimensions:54.53}"
            f"{part.number:5}{each:>8}{price:>8}"
        )
    rows.append(f"{'':5}{'all':134}{1e3 * order.mass:8.1f}{order.price:8.2f}")
    rows.append("     Prices are assumptions, for orientation: nobody has asked a shop.")
    return rows


def _grams(mass: Mass) -> str:
    """Return a text with a mass and its acceptable range, in g."""
    digits = int(mass.nominal < 0.1)
    nominal, least, most = (f"{1e3 * kilograms:.{digits}f}" for kilograms in mass)
    return f"{nominal} g ({least} to {most})"


def page_figure(step: Step) -> Figure:
    """Return a page with pictures on the left, text on the right, and the mass below the text.

    Args:
        step: Contents of the page.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE)
    figure.text(0.04, 0.94, step.title, fontsize=18, fontweight="bold")
    lines = []
    for line in step.text:
        lines += wrapped(line if line[:1] == "[" else f"- {line}", COLUMN)
    size = min(9.5, 9.5 * (31.0 if step.mass else 36.0) / max(len(lines), 1))
    figure.text(0.68, 0.88, "\n".join(lines), fontsize=size, va="top", linespacing=1.45)
    if step.mass:
        check = "\n".join(wrapped(f"{step.weighed}: {_grams(step.mass)}", LABEL))
        box = {"boxstyle": "round,pad=0.5", "fc": "#fff3c4"}
        figure.text(0.68, 0.05, check, fontsize=11, va="bottom", fontweight="bold", bbox=box)
    width = 0.64 / max(len(step.pictures), 1)
    for k, draw in enumerate(step.pictures):
        draw(figure.add_axes((0.03 + k * width, 0.05, 0.95 * width, 0.81)))
    return figure
