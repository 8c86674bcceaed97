"""Layout of parts on sheets, their DXF, SVG and STL files, and all files of a robot's drawings."""

import io
import math
import os
from collections.abc import Iterator, Sequence

import numpy as np

from jansen_env.robot import Robot
from jansen_env.robot.part_sizes import MARGIN
from jansen_workshop.drawings import holes
from jansen_workshop.drawings.buildability import faults
from jansen_workshop.drawings.convex import Round, rectangle, sides
from jansen_workshop.drawings.instructions import Manual
from jansen_workshop.drawings.materials import counts, to_csv
from jansen_workshop.drawings.order import Order
from jansen_workshop.drawings.outlines import CutPart, coupon, cut_parts
from jansen_workshop.drawings.shaft_order import CollisionError, layers
from jansen_workshop.drawings.spring_parts import missing_brackets

COUPON = 215 + 125j  # width and height of the sheet for the coupon, in mm
CROSS = 3.0  # half the length of a mark's line, in mm
SCALE = 100.0  # length of the scale bar in the lower margin of every sheet, in mm
SCALE_LETTERS = 2.5  # font size at the scale bar, in mm
COLORS = {"CUT": (1, "#d00000"), "ENGRAVE": (5, "#0000d0"), "MARK": (3, "#00a000")}
"""Colour of each layer: its AutoCAD colour number and its SVG colour."""
ALIKE = 0.02  # relative difference of the masses of machine and robot that causes no warning
MOST_FAULTS = 3  # number of faults of an assembly that the summary describes
LETTERS = 5.0  # font size of engraved names, in mm
ROOM = 0.7  # fraction of its line that a name may take


def nest(parts: Sequence[CutPart], sheet: complex) -> list[list[CutPart]]:
    """Lay parts on sheets in rows.

    The highest part comes first. Each part goes into the first row in which it fits.

    Args:
        parts: Parts to lay on sheets.
        sheet: Width and height of a sheet, in mm.

    Returns:
        The parts on each sheet, at their positions.

    Raises:
        ValueError: If a part is larger than a sheet. The message names the part.
    """
    sheets: list[list[CutPart]] = []
    rows: list[tuple[list[CutPart], complex]] = []  # sheet, and corner of the next part
    top = math.inf  # upper edge of the last row
    for part in sorted(parts, key=lambda part: -part.outline.box[1].imag):
        size = part.outline.box[1] + complex(MARGIN, MARGIN)
        if size.real + MARGIN > sheet.real or size.imag + MARGIN > sheet.imag:
            raise ValueError(
                f"--sheet must hold {part.name} of {size.real - MARGIN:.0f}x"
                f"{size.imag - MARGIN:.0f} mm with a margin of {MARGIN:g} mm on every side, got "
                f"{sheet.real:g}x{sheet.imag:g}"
            )
        k = next((k for k, (_, at) in enumerate(rows) if (at + size).real <= sheet.real), len(rows))
        if k == len(rows):
            if top + size.imag > sheet.imag:
                sheets.append([])
                top = MARGIN
            rows.append((sheets[-1], complex(MARGIN, top)))
            top += size.imag
        row, at = rows[k]
        row.append(part.moved(1 + 0j, at))
        rows[k] = row, at + size.real
    return sheets


def lines(parts: Sequence[CutPart], sheet: complex | None) -> Iterator[tuple[str, Round]]:
    """Yield every line of the parts, and the marks of the sheet, each with its layer.

    Args:
        parts: Parts to draw.
        sheet: Width and height of the sheet, in mm. If None, its edge and scale bar are left out.
    """
    if sheet:
        yield "MARK", rectangle(sheet)
        yield from (("MARK", shape) for shape in _scale_bar(sheet))
    for part in parts:
        for shape in part.lines:
            yield "CUT", shape
        for text, start, end in ((part.title, *part.text), *part.labels):
            for letter in _engraving(text, start, end):
                yield "ENGRAVE", letter
        for z in part.joints.values():
            if all(abs(z - hole.corners[0]) > CROSS for hole in part.holes):
                yield from (("MARK", Round((z - way, z + way))) for way in (CROSS, CROSS * 1j))


def _scale_bar(sheet: complex) -> list[Round]:
    """Return the lines and letters of the bar in a sheet's lower margin that shows its scale."""
    size = 1.5 * MARGIN
    length = SCALE if sheet.real > 2.0 * SCALE else 10.0 * math.floor((sheet.real - size) / 20.0)
    start = complex(size, MARGIN / 2.0)
    end = start + length
    bar = [Round((start, end))]
    bar += [Round((z - 0.3j * MARGIN, z + 0.3j * MARGIN)) for z in (start, end)]
    text = f"{length:g} mm"
    return bar + _engraving(text, end + 2.0, end + 12.0, SCALE_LETTERS)


def _engraving(text: str, start: complex, end: complex, height: float = LETTERS) -> list[Round]:
    """Return the outlines of a text half way from start to end, in a font of matplotlib."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0.0, 0.0), text, size=height, prop=FontProperties("DejaVu Sans"))
    outlines = (np.array(outline)[:-1] @ [1, 1j] for outline in path.to_polygons())
    letters = [Round(tuple(outline.tolist())) for outline in outlines]
    low, high = Round(tuple(z for letter in letters for z in letter.corners)).box
    way = (end - start) * min(1.0 / abs(end - start), ROOM / (high - low).real)
    return [letter.moved(way, (start + end - way * (low + high)) / 2.0) for letter in letters]


def _need_home() -> None:
    """Set HOME if there is no home folder, because ezdxf cannot be imported without one."""
    if os.path.expanduser("~") == "~":
        os.environ["HOME"] = os.devnull


def to_stl(parts: Sequence[CutPart]) -> bytes:
    """Return parts as a binary STL file, in mm.

    Each part is a plate of its thickness, bounded by a closed surface of triangles.

    Args:
        parts: Parts in the file.
    """
    _need_home()
    from ezdxf.math.triangulation import mapbox_earcut_2d

    corners = np.empty((0, 3, 3))
    for part in parts:
        rims = [shape.polygon for shape in part.lines]
        rims[1:] = [rim[::-1] for rim in rims[1:]]
        flat = [[(z.real, z.imag) for z in rim] for rim in rims]
        cap = np.array([[(*z, 0.0) for z in face] for face in mapbox_earcut_2d(flat[0], flat[1:])])
        up = np.array([0.0, 0.0, part.thickness])
        walls = []
        for (px, py), (qx, qy) in (side for rim in flat for side in sides(rim)):
            low, end = np.array([(px, py, 0.0), (qx, qy, 0.0)])
            walls += [(low, end, end + up), (low, end + up, low + up)]
        corners = np.concatenate([corners, cap[:, ::-1], cap + up, walls])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
    facets["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    facets["corners"] = corners
    return bytes(80) + np.uint32(len(corners)).tobytes() + facets.tobytes()


def to_dxf(parts: Sequence[CutPart], sheet: complex | None = None) -> str:
    """Return parts as a DXF R2010 file, in mm.

    The text is the same every time.

    Args:
        parts: Parts to draw.
        sheet: Width and height of the sheet, in mm. If None, its edge and scale bar are left out.
    """
    _need_home()
    import ezdxf

    fixed = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True  # fixes dates and identifiers
    try:
        drawing = ezdxf.new("R2010", units=ezdxf.units.MM)
        space = drawing.modelspace()
        for name, (color, _) in COLORS.items():
            drawing.layers.add(name, color=color)
        for layer, shape in lines(parts, sheet):
            look = {"layer": layer}
            z = shape.corners[0]
            if len(shape.corners) == 1:
                space.add_circle((z.real, z.imag), shape.radius, look)
            else:
                path = [(z.real, z.imag, bulge) for z, bulge in shape.path]
                space.add_lwpolyline(path, "xyb", close=shape.closed, dxfattribs=look)
        text = io.StringIO()
        drawing.write(text)
        return text.getvalue()
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = fixed


def to_svg(parts: Sequence[CutPart], sheet: complex | None = None) -> str:
    """Return parts as an SVG file, in mm, with one group per layer.

    The y axis of SVG points downwards.

    Args:
        parts: Parts to draw.
        sheet: Width and height of the sheet, in mm. If None, its edge and scale bar are left out.
    """
    size = sheet or max((part.outline.box[1] for part in parts), key=abs)
    width = f"{size.real:.3f}"
    height = f"{size.imag:.3f}"
    groups = {name: [f'<g id="{name}" stroke="{color}">'] for name, (_, color) in COLORS.items()}
    for layer, shape in lines(parts, sheet):
        z = shape.corners[0]
        radius = f"{shape.radius:.4f}"
        if len(shape.corners) == 1:
            text = f'circle cx="{z.real:.4f}" cy="{size.imag - z.imag:.4f}" r="{radius}"'
        else:
            path = [(f"{z.real:.4f} {size.imag - z.imag:.4f}", bulge) for z, bulge in shape.path]
            edges = sides(path) if shape.closed else sides(path)[:-1]
            words = [
                f"A{radius} {radius} 0 0 0 {end}" if bulge else f"L{end}"
                for (_, bulge), (end, _) in edges
            ]
            if shape.closed:  # the last edge is straight
                words[-1] = "Z"
            text = f'path d="M{path[0][0]} {" ".join(words)}"'
        groups[layer].append(f"<{text}/>")
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}" fill="none" stroke-width="0.2">'
    )
    elements = [element for group in groups.values() for element in (*group, "</g>")]
    return "\n".join([head, *elements, "</svg>", ""])


def drawings(
    robot: Robot, title: str, sheet: complex, kerf: float, fit: Sequence[float]
) -> tuple[dict[str, str | bytes], str]:
    """Return the contents of every file by its name, and the summary for the user.

    If the links collide in every order along the shaft, there are no instructions and the bill of
    materials has no list of fasteners.

    Args:
        robot: Robot to draw.
        title: Title of the instructions.
        sheet: Width and height of a sheet, in mm.
        kerf: Width of a cut, in mm, for which the lines compensate.
        fit: Increase of the diameter of press, slide and clear holes, in mm.

    Raises:
        ValueError: If a part is larger than the sheet, or cannot be made. The message names the
            part.
        LinkageError: If the linkage of a leg does not close.
    """
    exact = [part.with_fit(fit) for part in cut_parts(robot)]
    coupon_parts = coupon(exact[0].thickness, robot.build)
    files: dict[str, str | bytes] = {}
    for name, (parts, size) in _layouts(robot, exact, coupon_parts, sheet, kerf).items():
        files[f"{name}.dxf"] = to_dxf(parts, size)
        files[f"{name}.svg"] = to_svg(parts, size)
    for part in exact:
        files[f"parts/{part.name}.stl"] = to_stl([part])
    files["coupon.stl"] = to_stl(nest(coupon_parts, COUPON)[0])
    warnings = []
    try:
        placed = layers(robot)
    except CollisionError as error:
        warnings.append(f"warning: there are no instructions, because {error}")
        order = Order(robot, None)
    else:
        order = Order(robot, placed)
        width = 1.3 * max(part.outline.box[1].real for part in exact)
        flat = nest(exact, complex(width, 100.0 * width))[0]
        cut_coupon = nest([part.with_kerf(kerf) for part in coupon_parts], COUPON)[0]
        files["instructions.pdf"] = Manual(order, flat, cut_coupon).to_pdf(title)
        warnings += _fault_warnings(order)
    files["materials.csv"] = to_csv(order.parts)
    files["holes.csv"] = holes.to_csv(holes.list_holes(robot, exact))
    warnings += missing_brackets(robot)
    warnings += _mass_warnings(order)
    return files, "\n".join([_summary(order), *warnings])


def _layouts(
    robot: Robot,
    exact: Sequence[CutPart],
    coupon_parts: Sequence[CutPart],
    sheet: complex,
    kerf: float,
) -> dict[str, tuple[list[CutPart], complex | None]]:
    """Return what is cut by the name of its file: the parts, and the size of their sheet.

    Args:
        robot: Robot that the parts belong to.
        exact: Flat parts of the robot, not compensated for the kerf.
        coupon_parts: Pieces of the coupon, not compensated for the kerf.
        sheet: Width and height of a sheet, in mm.
        kerf: Width of a cut, in mm.
    """
    parts = [part.with_kerf(kerf) for part in exact]
    layouts: dict[str, tuple[list[CutPart], complex | None]] = {
        f"parts/{part.name}": ([part], None) for part in parts
    }
    number = counts(robot)
    for thickness in sorted({part.thickness for part in parts}):
        same = [part for part in parts if part.thickness == thickness]
        sheets = nest([part for part in same for _ in range(number[part.name])], sheet)
        for k, on_sheet in enumerate(sheets, 1):
            layouts[f"sheets/{thickness:g}mm_{k}"] = on_sheet, sheet
    layouts["coupon"] = nest([part.with_kerf(kerf) for part in coupon_parts], COUPON)[0], COUPON
    return layouts


def _summary(order: Order) -> str:
    """Return a sentence with the number of parts, the mass and the price of a machine."""
    return (
        f"{sum(counts(order.robot).values())} parts to cut; the machine weighs {order.mass:.2f} kg "
        f"with all parts, which cost about {order.price:.0f} EUR in total"
    )


def _fault_warnings(order: Order) -> list[str]:
    """Return warnings of what cannot be built."""
    assert order.assembly is not None
    found = faults(order.assembly)
    warnings = [
        f"warning: this machine cannot be built as drawn: {fault}" for fault in found[:MOST_FAULTS]
    ]
    if len(found) > MOST_FAULTS:
        warnings.append(f"warning: there are {len(found) - MOST_FAULTS} more faults of this kind")
    return warnings


def _mass_warnings(order: Order) -> list[str]:
    """Return a warning if the machine and the simulated robot have different masses."""
    robot = order.robot
    if abs(order.mass - robot.mass) <= ALIKE * robot.mass:
        return []
    return [
        f"warning: the simulated robot weighs {robot.mass:.2f} kg, so this machine will "
        "walk differently; --as-robot-file FILE writes the machine as a robot"
    ]
