"""Parts laid on sheets, and their drawings at 1:1 as DXF and SVG: cut, engraved, marked lines."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

import numpy as np

from jansen_env.drawings.outlines import CutPart, Round

MARGIN = 5.0  # mm, between parts, and to the edge of a sheet
CROSS = 3.0  # mm, half a line of a mark
COLORS = {"CUT": (1, "#d00000"), "ENGRAVE": (5, "#0000d0"), "MARK": (3, "#00a000")}
"""Colours of the layers: AutoCAD's number, and SVG's."""
LETTERS, ROOM = 5.0, 0.7  # mm, height of a font's square; of the length that a name may take

Line = tuple[str, list[tuple[complex, float]], float]
"""Layer; corners, each with the bulge of the edge that follows; radius of a circle, or 0."""


def nest(parts: Sequence[CutPart], sheet: complex) -> list[list[CutPart]]:
    """Lay parts on sheets in rows, the highest first, each where it fits first.

    Args:
        parts: lying. sheet: width and height, mm.

    Raises:
        ValueError: a part is larger than a sheet; names it.
    """
    sheets: list[list[CutPart]] = []
    rows: list[tuple[int, complex, float]] = []  # sheet, corner where the next part goes, height
    for part in sorted(parts, key=lambda part: -part.outline.box[1].imag):
        size = part.outline.box[1]
        if size.real + 2.0 * MARGIN > sheet.real or size.imag + 2.0 * MARGIN > sheet.imag:
            raise ValueError(
                f"--sheet is {sheet.real:g}x{sheet.imag:g}, must hold {part.name} of "
                f"{size.real:.0f}x{size.imag:.0f} mm with {MARGIN:g} mm about it"
            )
        fits = [row[1].real + size.real + MARGIN <= sheet.real for row in rows]
        if not any(fits):
            foot = rows[-1][1].imag + rows[-1][2] + MARGIN if rows else MARGIN
            if not rows or foot + size.imag + MARGIN > sheet.imag:
                sheets.append([])
                foot = MARGIN
            rows.append((len(sheets) - 1, complex(MARGIN, foot), size.imag))
        k = [*fits, True].index(True)
        number, corner, height = rows[k]
        sheets[number].append(part.moved(1 + 0j, corner))
        rows[k] = (number, corner + size.real + MARGIN, height)
    return sheets


def lines(parts: Sequence[CutPart], sheet: complex | None = None) -> Iterator[Line]:
    """All that is drawn of parts, and the edge of a sheet."""
    if sheet:
        edge = Round((0j, complex(sheet.real), sheet, complex(0.0, sheet.imag)), 0.0)
        yield "MARK", edge.path, 0.0
    for part in parts:
        for one in (part.outline, *part.windows):
            yield "CUT", one.path, 0.0
        for hole in part.holes:
            yield "CUT", [(hole.corners[0], 0.0)], hole.radius
        for letter in _engraving(part):
            yield "ENGRAVE", [(z, 0.0) for z in letter], 0.0
        drilled = [hole.corners[0] for hole in part.holes]
        for z in part.joints.values():
            if min(abs(z - one) for one in drilled) > CROSS:
                for way in (CROSS, CROSS * 1j):
                    yield "MARK", [(z - way, 0.0), (z + way, 0.0)], 0.0


def _engraving(part: CutPart) -> list[list[complex]]:
    """Outlines of the letters of a part's name, in a font that comes with matplotlib."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    drawn = TextPath((0.0, 0.0), part.name, size=LETTERS, prop=FontProperties("DejaVu Sans"))
    letters = [
        [complex(x, y) for x, y in np.array(letter)[:-1].tolist()] for letter in drawn.to_polygons()
    ]
    low, high = Round(tuple(z for letter in letters for z in letter), 0.0).box
    start, end = part.text
    scale = min(1.0, ROOM * abs(end - start) / (high - low).real) / abs(end - start)
    way, middle = scale * (end - start), (start + end) / 2.0
    return [[middle + way * (z - (low + high) / 2.0) for z in letter] for letter in letters]


def to_dxf(parts: Sequence[CutPart], sheet: complex | None = None) -> str:
    """Parts, and the edge of a sheet, as DXF R2010 in mm; the same text every time."""
    import ezdxf

    fixed = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True  # dates and identifiers
    try:
        drawing = ezdxf.new("R2010", units=ezdxf.units.MM)
        for name, (color, _) in COLORS.items():
            drawing.layers.add(name, color=color)
        space = drawing.modelspace()
        for layer, path, radius in lines(parts, sheet):
            corners = [(z.real, z.imag, bulge) for z, bulge in path]
            look = {"layer": layer}
            if radius:
                space.add_circle(corners[0][:2], radius, dxfattribs=look)
            else:
                space.add_lwpolyline(corners, "xyb", close=len(path) > 2, dxfattribs=look)
        text = io.StringIO()
        drawing.write(text)
        return text.getvalue()
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = fixed


def to_svg(parts: Sequence[CutPart], sheet: complex | None = None) -> str:
    """Parts, and the edge of a sheet, as SVG in mm; a group for each layer."""
    size = sheet or max((part.outline.box[1] for part in parts), key=abs)
    width, height = f"{size.real:.3f}", f"{size.imag:.3f}"
    found = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}" fill="none" stroke-width="0.2">'
    ]
    for name, (_, color) in COLORS.items():
        found.append(f'<g id="{name}" stroke="{color}">')
        for layer, path, radius in lines(parts, sheet):
            if layer == name:
                found.append(
                    _element([(size.imag * 1j + z.conjugate(), b) for z, b in path], radius)
                )
        found.append("</g>")
    return "\n".join([*found, "</svg>", ""])


def _element(path: list[tuple[complex, float]], radius: float) -> str:
    """A line as SVG has it, y downwards: arcs bulge to the other side."""
    x, y = path[0][0].real, path[0][0].imag
    if radius:
        return f'<circle cx="{x:.4f}" cy="{y:.4f}" r="{radius:g}"/>'
    words = [f"M{x:.4f} {y:.4f}"]
    for (start, bulge), (end, _) in zip(path, path[1:] + path[:1], strict=True):
        curve = abs(end - start) * (1.0 + bulge**2) / (4.0 * bulge) if bulge else 0.0
        kind = f"A{curve:.4f} {curve:.4f} 0 0 0 " if bulge else "L"
        words.append(f"{kind}{end.real:.4f} {end.imag:.4f}")
    return f'<path d="{" ".join(words)}"/>'
