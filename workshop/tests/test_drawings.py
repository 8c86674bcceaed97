"""Drawings: lengths as they are read back, sheets, layers that do not collide, what is refused."""

import cmath
import csv
import io
import itertools
import math
import os
import re
import subprocess
import sys
from collections import Counter, defaultdict
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree as ET

import ezdxf
import numpy as np
import pytest
from ezdxf.math import area
from ezdxf.path import make_path
from known_designs import DESIGNS

from jansen_env import Bar, Spring, TorsionSpring, built_robot
from jansen_env.robot import ROBOTS, Leg, Plate
from jansen_env.robot import buildable as built
from jansen_env.robot.kinematics import joint_positions, toe_positions
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.part_sizes import M3, WALL, feet_of, radii
from jansen_env.robot.robot_file import read_robot, write_robot
from jansen_env.scoring.rollout import make_env
from jansen_workshop.commands import drawings as command
from jansen_workshop.drawings import shaft_order
from jansen_workshop.drawings.convex import Round, gap
from jansen_workshop.drawings.holes import count_by_diameter, list_holes
from jansen_workshop.drawings.instructions import Manual
from jansen_workshop.drawings.manual_pages import LINES
from jansen_workshop.drawings.materials import bill_of_materials, counts, stacks, to_csv
from jansen_workshop.drawings.materials import machine as machine_of
from jansen_workshop.drawings.mount import units
from jansen_workshop.drawings.order import Order
from jansen_workshop.drawings.outlines import coupon, cut_parts
from jansen_workshop.drawings.shaft_order import CollisionError, carried
from jansen_workshop.drawings.sheets import ALIKE, MARGIN, SCALE, nest, to_dxf, to_stl, to_svg
from jansen_workshop.drawings.spring_parts import missing_brackets, spring_rows

DIFFERENT = [name for name in DESIGNS if not name.endswith("slender")]
OTHER_LINKS = [name for name in DIFFERENT if name not in ("paper", "phases3", "odd")]
HEAD, NUT = 4.5, 2.7  # mm, of a shoulder screw of 6 mm and of its thin nut
SVG = "{http://www.w3.org/2000/svg}"
layers = cache(shaft_order.layers)  # a search of a second or more


def points_of(drawing):
    """Centres of holes and of crosses."""
    circles = [complex(*circle.dxf.center.vec2) for circle in drawing.modelspace().query("CIRCLE")]
    marks = drawing.modelspace().query('LWPOLYLINE[layer=="MARK"]')
    return circles, [sum(complex(x, y) for x, y in mark.get_points("xy")) / 2 for mark in marks]


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER_LINKS)
def test_the_drawing_read_back_has_the_lengths_of_the_links(name):
    """Holes lie as far from one another as joints, a toe's cross too; within 0.01 mm."""
    robot = DESIGNS[name]
    for (link, joints), part in zip(robot.linkage.bodies, cut_parts(robot), strict=False):
        circles, crosses = points_of(ezdxf.read(io.StringIO(to_dxf([part]))))
        i, j = np.array([*itertools.combinations(range(len(joints)), 2)]).T
        wanted = [1e3 * robot.body(link).distance(*pair) for pair in zip(i, j, strict=True)]
        orders = np.array([*itertools.permutations(circles + crosses[::2], len(joints))])
        off = np.abs(np.abs(orders[:, j] - orders[:, i]) - wanted).max(axis=1)
        assert off.min() < 0.01, link
        root = ET.fromstring(to_svg([part]))
        size = part.outline.box[1]
        assert root.get("width") == f"{size.real:.3f}mm"
        assert root.get("viewBox") == f"0 0 {size.real:.3f} {size.imag:.3f}"
        drawn = [complex(float(circle.get("cx")), size.imag - float(circle.get("cy")))
                 for circle in root.iter(f"{SVG}circle")]  # fmt: skip
        np.testing.assert_allclose(drawn, circles, atol=1e-3)
        assert {group.get("id") for group in root} == {"CUT", "ENGRAVE", "MARK"}


def segments_of(path):
    """Ends of the straight lines of an SVG path, which has no curve but arcs; and if it closes."""
    words = re.findall(r"[MLAZ][^MLAZ]*", path)
    assert words[0][0] == "M" and sum(word[0] == "M" for word in words) == 1, path
    points = [tuple(map(float, word[1:].split()[-2:])) for word in words if word[0] != "Z"]
    closed = words[-1] == "Z"
    lines = [pair for pair, word in zip(itertools.pairwise(points), words[1:], strict=False)
             if word[0] == "L"]  # fmt: skip
    return lines + [(points[-1], points[0])] * closed, closed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["built", "weekend"])
def test_every_cut_line_of_every_sheet_is_closed_and_none_is_drawn_twice(name):
    """In SVG and DXF; a bar of known length is in every sheet's margin."""
    robot = DESIGNS[name]
    number = counts(robot)
    parts = cut_parts(robot)
    sheet = 600 + 300j if name == "weekend" else 1600 + 600j
    drawn = [([part], None) for part in parts]
    for thickness in {part.thickness for part in parts}:
        same = [part for part in parts if part.thickness == thickness]
        laid = nest([part for part in same for _ in range(number[part.name])], sheet)
        drawn += [(each, sheet) for each in laid]
    drawn.append((nest(coupon(4.0, robot.build), 215 + 125j)[0], 215 + 125j))
    for laid, size in drawn:
        root = ET.fromstring(to_svg(laid, size))
        seen = set()
        for group in root:
            for shape in group:
                if shape.tag == f"{SVG}circle":
                    lines = [("circle", *(shape.get(key) for key in ("cx", "cy", "r")))]
                else:
                    lines, closed = segments_of(shape.get("d"))
                    assert closed or group.get("id") == "MARK", shape.get("d")
                    lines = [tuple(sorted(line)) for line in lines]
                assert not seen & {*lines}, lines
                seen |= {*lines}
        space = ezdxf.read(io.StringIO(to_dxf(laid, size))).modelspace()
        for line in space.query('LWPOLYLINE[layer!="MARK"]'):
            assert line.closed
        if size:
            margin = [line for line in seen if line[0] != "circle" and line[0][1] == line[1][1]]
            level = [abs(b[0] - a[0]) for a, b in margin if a[1] == size.imag - MARGIN / 2.0]
            assert max(level) == pytest.approx(SCALE)


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER_LINKS)
def test_holes_and_names_have_material_around_them(name):
    """Each hole is within the outline and outside windows and other holes by a wall."""
    robot = DESIGNS[name]
    for part in cut_parts(robot)[: len(robot.bodies)]:
        corners = np.array(part.outline.corners)
        for hole in part.holes:
            z = np.array(hole.corners)
            assert gap(corners, z) + hole.radius + WALL <= part.outline.radius + 1e-9
            for other in (*part.windows, *(other for other in part.holes if other is not hole)):
                room = gap(np.array(other.corners), z) - other.radius - hole.radius
                assert room > WALL - 1e-9, part.name
        drawing = ezdxf.read(io.StringIO(to_dxf([part]))).modelspace()
        points = [z for letter in drawing.query('LWPOLYLINE[layer=="ENGRAVE"]')
                  for z in letter.get_points("xy")]  # fmt: skip
        letters = np.array(points) @ [[1], [1j]]
        assert len(letters) > 10
        rim = np.broadcast_to(corners, (len(letters), len(corners)))
        assert (gap(rim, letters) < part.outline.radius - 1.0).all()
        for shape in (*part.windows, *part.holes):
            assert (gap(np.array([shape.corners]), letters) > shape.radius).all()


@pytest.mark.parametrize("name", ["paper", "holy", "built"])
def test_parts_weigh_what_the_model_says(name):
    """Holes, hub screws and round corners, which the model leaves out, are 4 % at most."""
    robot = DESIGNS[name]
    parts = {part.name: part.mass for part in cut_parts(robot)}
    for part in bill_of_materials(robot)[: len(robot.bodies)]:
        assert parts[part.name] == pytest.approx(part.each, rel=0.04), part.name


@pytest.mark.slow
def test_a_cut_leaves_parts_of_their_size(tmp_path):
    """Lines with a kerf, shrunk and grown by half of it, are those without; from the origin on."""
    for kerf, folder in ((0.0, "exact"), (0.4, "cut")):
        command.main(["chebyshev", "--out", str(tmp_path / folder), "--kerf", str(kerf)])
    for name in ("foot", "crank", "motor-plate"):
        paths = [tmp_path / folder / "parts" / f"{name}.dxf" for folder in ("exact", "cut")]
        drawings = [ezdxf.readfile(path) for path in paths]
        exact, cut = (points_of(drawing)[0] for drawing in drawings)
        np.testing.assert_allclose(np.array(cut) - exact, 0.2 + 0.2j, atol=1e-9)
        holes = [drawing.modelspace().query("CIRCLE") for drawing in drawings]
        radii_of = [[circle.dxf.radius for circle in circles] for circles in holes]
        np.testing.assert_allclose(np.subtract(*radii_of), 0.2, atol=1e-9)
    drawings = [tmp_path / folder / "parts" / "foot.svg" for folder in ("exact", "cut")]
    sizes = [float(ET.parse(path).getroot().get("width")[:-2]) for path in drawings]
    assert sizes[1] - sizes[0] == pytest.approx(0.4, abs=2e-3)


def test_holes_of_each_class_have_their_allowance():
    pin, bush, shaft, _ = radii(built.ALUMINIUM)
    for part in cut_parts(DESIGNS["built"]):
        wider = part.with_fit((-0.1, 0.2, 0.4)).holes
        for hole, fitted in zip(part.holes, wider, strict=True):
            pressed, slid = hole.radius in (bush, shaft + bush - pin), hole.radius == pin
            allowance = -0.1 if pressed else 0.2 if slid else 0.4
            assert 2.0 * (fitted.radius - hole.radius) == pytest.approx(allowance), part.name


@pytest.mark.parametrize("name", ["built", "strider"])
def test_plates_to_print_are_closed_and_have_their_volume(name):
    """Each edge of a triangle is another's backwards; volume by the divergence theorem."""
    parts = cut_parts(DESIGNS[name])
    for plates in ([part] for part in parts) if name == "built" else [nest(parts, 3000 + 900j)[0]]:
        data = to_stl(plates)
        facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
        facets = np.frombuffer(data, facet, offset=84)
        assert len(facets) == int.from_bytes(data[80:84], "little")
        edges = Counter((tuple(a), tuple(b)) for face in facets["corners"].tolist()
                        for a, b in zip(face, face[1:] + face[:1], strict=True))  # fmt: skip
        assert all(edges[b, a] == count for (a, b), count in edges.items())
        corners = facets["corners"].astype(float)
        volume = np.linalg.det(corners).sum() / 6.0
        exact = sum(1e9 * part.mass / built.DENSITY for part in plates)
        assert volume == pytest.approx(exact, rel=1e-3)


def test_the_list_of_holes_has_every_hole_with_its_allowance():
    """A bush of 8 mm for every link that turns; the weekend robot's screws turn in plain holes."""
    for name, fit in (("built", (0.0, 0.0, 0.0)), ("weekend", (-0.05, 0.1, 0.2))):
        robot = DESIGNS[name]
        number = counts(robot)
        parts = [part.with_fit(fit) for part in cut_parts(robot)]
        lines = list_holes(robot, parts)
        cut = sum(number[part.name] * len(part.holes) for part in parts)
        assert sum(line.total for line in lines) == sum(count_by_diameter(lines).values()) == cut
        assert [line.number for line in lines] == sorted(line.number for line in lines)
        if name == "built":
            assert count_by_diameter(lines)[8.0] == 36  # one for each bush of 6 x 8 mm
            assert {line.use for line in lines if line.diameter == 14.0} == {"bush"}
        else:
            (turning,) = (line for line in lines if line.name == "lower_rod")
            assert turning[2:] == (3.15, "turning screw or shaft", 2, 4)


@pytest.mark.parametrize(
    ("name", "names"), [("built", ["pin 6", "bush 8"]), ("weekend", ["pin 3", "turns 3.2"])]
)
def test_the_coupon_names_what_its_holes_are_for(name, names):
    plate, *_ = coupon(3.0, DESIGNS[name].build)
    assert [text for text, *_ in plate.labels if text[0] not in "+-"] == names


def test_the_coupon_finds_the_kerf():
    """A cut leaves pegs narrower and the slot wider; the widest that fits has the kerf's mark."""
    plate, *pegs = coupon(4.0)
    for kerf in (-0.2, 0.0, 0.1, 0.3):
        slot = 2.0 * plate.windows[0].radius + kerf
        fitting = [peg.name for peg in pegs if 2.0 * peg.outline.radius - kerf < slot + 1e-9]
        assert float(fitting[-1]) == pytest.approx(kerf)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["built", "klann", "strider"])
def test_every_fastener_is_counted_and_long_enough(name):
    """From the parts' places alone: a screw and a nut for each pin, which holds its stack."""
    robot = DESIGNS[name]
    placed = layers(robot)
    axis, crank_pin = robot.linkage.bodies[CRANK - 1][1][:2]
    on = defaultdict(list)
    for item in placed:
        for joint in {*item.part.joints} - {axis, *item.through}:
            on[joint, item.unit, item.leg if joint != crank_pin else None].append(item)
    pins = {key: items for key, items in on.items() if len(items) > 1}
    bill = Order(robot, placed).parts
    number = Counter()
    for part in bill:
        number[part.name, part.dimensions.rpartition(", ")[2]] += part.number
    assert number["shoulder screw ISO 7379", "M5"] == len(pins) == number["thin nut DIN 439", "M5"]
    webs = sum(item.body == CRANK for item in placed)
    feet = sum(len(feet_of(robot, item.body)) for item in placed)
    ties = 1 if name != "strider" else 0  # its legs face one way... a frame each
    assert number["lock nut DIN 985", "M4"] == 2 * feet
    assert number["thin nut DIN 439", "M4"] == 4 * ties
    assert number["countersunk screw ISO 10642", "M3 x 12 mm"] == 2 * webs
    bushes = sum(hole.fit == "press" for item in placed for hole in item.part.holes)
    assert sum(part.number for part in bill if part.name == "bush") == bushes
    for stack in stacks(robot, placed):
        long = sum(
            row.item.part.thickness if row.item else row.number * row.height
            for row in stack.rows
            if row.name != "ring"
        )
        if stack.axle:
            assert placed[-1].top - 1.0 < long < placed[-1].top + 0.1
        else:
            screw = float(stack.bolt[0].size.split(" x ")[1].split()[0])
            assert 0.1 <= screw - long + 1e-6 < 1.2, stack


@pytest.mark.slow
@pytest.mark.parametrize("name", ["built", "weekend", "strider", "phases3"])
def test_instructions_put_every_part_on_with_its_number_and_mass(name):
    """A step for each kind of pin, whose picture has its links in order; then the whole machine."""
    robot = DESIGNS[name]
    placed = layers(robot)
    order = Order(robot, placed)
    manual = Manual(order, cut_parts(robot), coupon(4.0))
    steps, kinds = manual.steps(), {stack.joint for stack in manual.stacks if not stack.axle}
    # Cut parts, feet, ties, frames, phases, motor, boards, wiring, power; and the assembled view.
    assert len(steps) == 10 + len(kinds)
    masses = [step.mass.nominal for step in steps if step.mass]
    assert masses[-1] == pytest.approx(order.mass)
    whole = masses[1:]  # without the flat parts alone
    grown = [*whole[: len(kinds) + 1], *whole[len(kinds) + 2 :]]  # the ties stand beside the legs
    assert grown == sorted(grown)
    for step in steps[:-1]:
        assert step.mass.least < step.mass.nominal < step.mass.most
    text = "\n".join(line for step in steps for line in step.text)
    drawn = {manual.label(row) for stack in manual.stacks for row in (*stack.rows, *stack.bolt)}
    for number, part in enumerate(order.parts, 1):
        numbered = f"no. {number}: {part.name} {part.dimensions}"
        flat_number = f"no. {number}: {part.name}"
        seen = any(numbered in line or line == flat_number for line in (*text.splitlines(), *drawn))
        assert seen, numbered
    for item in placed:
        number = next(k for k, part in enumerate(order.parts, 1) if part.name == item.part.name)
        assert number == item.part.number
        assert f"no. {number}: {item.part.name}" in drawn
    for stack in manual.stacks:
        heights = [row.item.z for row in stack.rows if row.item]
        assert heights == sorted(heights)
    pages = manual.to_pdf(name).count(b"/Type /Page ")
    assert pages == len(steps) + 3 + math.ceil((len(order.parts) + 2) / LINES)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["built", "weekend"])
def test_pages_of_all_kinds_list_as_many_fasteners_as_the_bill_has(name):
    """Each page says what it takes: pages of a pin by its picture, all others by their text."""
    robot = DESIGNS[name]
    order = Order(robot, layers(robot))
    manual = Manual(order, cut_parts(robot), coupon(4.0))
    listed = Counter()
    for step in manual.steps():
        times = 1
        for line in step.text:
            if match := re.match(r"Build (\d+) of them", line):
                times = int(match[1])
        for line in step.text:
            if match := re.match(r"(\d+) x no\. (\d+): ", line):
                listed[int(match[2])] += times * int(match[1])
    for stack in manual.stacks:
        for row in (*stack.rows, *stack.bolt):
            if row.item is None and not (stack.axle and row in stack.bolt):
                listed[manual.order.numbers[row.name, row.size]] += row.number
    for number, part in enumerate(order.parts, 1):
        if part.thickness and part.name in robot.linkage.names:
            continue  # links are in the pictures
        extra = {"frame-doubler": 2, "ring": 2}.get(part.name, 1)  # listed and drawn
        assert listed[number] == extra * part.number, (number, part)


def test_the_weekend_robots_screws_hold_their_stacks():
    """M3 screws that are longer than their stack by a nut, but by less than the next size."""
    robot = DESIGNS["weekend"]
    placed = layers(robot)
    screws = [stack for stack in stacks(robot, placed) if not stack.axle]
    for stack in screws:
        items = [row.item for row in stack.rows if row.item]
        long, nut = items[-1].top - items[0].z, stack.bolt[1].size
        screw = float(stack.bolt[0].size.removeprefix("M3 x ").split()[0])
        assert 5.0 <= screw - long < 10.0 and nut == "M3", stack
    number = Counter()
    for part in Order(robot, placed).parts:
        number[part.name] += part.number
    axles = 2
    assert number["lock nut DIN 985"] == len(screws) + 2 * axles
    assert number["hub"] == 4 and number["battery"] == 1
    assert {"Hall switch", "magnet", "resistor", "emergency stop", "coupling"} <= {*number}
    assert "bush" not in number


def test_what_is_drawn_has_the_area_of_its_shape():
    shape = Round((0j, 40 + 0j, 10 + 30j), 7.0)
    points = [(z.real, z.imag, bulge) for z, bulge in shape.path]
    line = ezdxf.new().modelspace().add_lwpolyline(points, "xyb", close=True)
    assert area([*make_path(line).flattening(1e-4)]) == pytest.approx(shape.area, rel=1e-5)


@pytest.mark.parametrize("name", DIFFERENT)
def test_sheets_hold_all_parts_and_none_overlaps_another(name):
    robot, sheet = DESIGNS[name], 1600 + 600j
    number = counts(robot)
    assert [part.title for part in cut_parts(robot)] == [
        f"{k} {part.name}" for k, part in enumerate(Order(robot, None).parts[: len(number)], 1)
    ]
    parts = [part for part in cut_parts(robot) for _ in range(number[part.name])]
    sheets = nest(parts, sheet)
    names = [part.name for laid in sheets for part in laid]
    assert sorted(names) == sorted(part.name for part in parts)
    for laid in sheets:
        for part in laid:
            low, high = part.outline.box
            assert min(low.real, low.imag) > MARGIN - 1e-6
            assert min((sheet - high).real, (sheet - high).imag) > MARGIN - 1e-6
        for a, b in itertools.combinations(laid, 2):
            apart = gap(np.array(a.outline.corners), np.array(b.outline.corners))
            assert apart > a.outline.radius + b.outline.radius + MARGIN - 1e-6


def test_distances_between_polygons(rng):
    """Those of many points in them, which are never nearer and at last as near."""
    for count, more in itertools.product((1, 2, 3), repeat=2):
        pair = [
            rng.normal(size=(300, n)) + 1j * rng.normal(size=(300, n)) + shift
            for n, shift in ((count, 0.0), (more, 1.5))
        ]
        inside = [z @ rng.dirichlet(np.full(z.shape[1], 0.4), 60).T for z in pair]
        nearest = abs(inside[0][:, :, None] - inside[1][:, None, :]).min(axis=(1, 2))
        beyond = nearest - gap(*pair)
        assert beyond.min() > -1e-12 and beyond.max() < 0.8 and beyond.mean() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", [
    pytest.param(name, marks=pytest.mark.slow) if name in ("strider", "phases3") else name
    for name in DIFFERENT if name != "chebyshev"
])  # fmt: skip
def test_nothing_on_the_shaft_meets_anything_else(name):
    """Every half degree: parts that share some z lie apart, and no pin is where a part passes."""
    robot = DESIGNS[name]
    placed, bodies = layers(robot), range(1, len(robot.bodies) + 1)
    drawn = {(item.leg, item.body) for item in placed}
    assert drawn == {*itertools.product(range(len(robot.legs)), bodies)}
    psi, end = np.radians(np.arange(0.0, 360.0, 0.5)), placed[-1].top
    axis, pin = robot.linkage.bodies[CRANK - 1][1][:2]
    at = [joint_positions(robot, leg.side, psi + leg.phase) @ [1e3, 1e3j] for leg in robot.legs]

    def places(leg, joints):
        return at[leg][:, [robot.linkage.joints.index(joint) for joint in joints]]

    def corners(item):
        joints, side = places(item.leg, item.part.joints), robot.legs[item.leg].side
        return carried(item.part, item.part.outline.corners, joints, side)

    for item, other in itertools.combinations(placed, 2):
        if other.z < item.top and item.z < other.top:
            apart = gap(corners(item), corners(other)).min()
            assert apart > item.part.outline.radius + other.part.outline.radius + 0.5
    build, discs = robot.build, []  # leg, joint, both ends, radius
    hub, spacer, tube = 1e3 * build.hub_radius, 1e3 * build.spacer_radius, 1e3 * build.tube_radius
    radius, half = 1e3 * build.foot_radius, 500.0 * build.foot_width
    for unit, legs in enumerate(units(robot)):
        parts = [item for item in placed if item.unit == unit]
        first, last = (item for item in parts if item.body == CRANK)
        discs.append((legs[0], axis, parts[0].z, first.top, hub))
        discs.append((legs[0], axis, last.z, parts[-1].top, hub))
        for item in parts:
            middle = (item.z + item.top) / 2
            discs += [(item.leg, toe, middle - half, middle + half, radius)
                      for toe in feet_of(robot, item.body)]  # fmt: skip
            discs += [(item.leg, joint, 0.0, end, tube) for joint in item.through]
    for stack in (stack for stack in stacks(robot, placed) if not stack.axle):
        thick = [row.item or row.number * row.height for row in stack.rows]
        on = [k for k, row in enumerate(stack.rows) if row.item]
        low = thick[on[0]].z - sum(thick[: on[0]]) - HEAD
        high = thick[on[-1]].top + sum(thick[on[-1] + 1 :]) + NUT
        discs.append((stack.leg, stack.joint, low, high, spacer))
    for leg, joint, low, high, radius in discs:
        side = robot.legs[leg].side
        for item in placed:
            alike = robot.legs[item.leg].side == side if radius == tube else item.leg == leg
            shared = joint in item.part.joints and (alike or joint in (axis, pin))
            if item.z < high and low < item.top and not shared:
                apart = gap(corners(item), places(leg, joint)).min() - item.part.outline.radius
                assert apart > radius, (joint, item.part.name)


def test_a_search_that_finds_no_order_ends(monkeypatch):
    """Klann's foot sweeps over the pivot B: a leg alone cannot have it between the frames."""
    robot = DESIGNS["klann"]
    monkeypatch.setattr(shaft_order, "MOST_TRIES", 20_000)  # of 400,000, all of which collide
    with pytest.raises(
        CollisionError, match=r"^the links collide in all 20000 orders that were tried$"
    ):
        layers(replace(robot, legs=robot.legs[:1]))
    monkeypatch.setattr(shaft_order, "MOST_TRIES", 20)
    with pytest.raises(
        CollisionError, match=r"^the links collide in all 20 orders that were tried$"
    ):
        shaft_order.layers(DESIGNS["built"])


def test_legs_of_any_phases_have_webs_of_their_own():
    robot = replace(built_robot(), legs=(Leg("fore"), Leg("back", 0.3), Leg("fore", 2.0)))
    assert units(robot) == [(0,), (1,), (2,)]
    placed = layers(robot)
    webs = [item for item in placed if item.body == CRANK]
    assert len(webs) == counts(robot)["crank"] == 6
    shafts = [part for part in Order(robot, placed).parts if part.name == "shaft"]
    assert sum(part.number for part in shafts) == 4


@pytest.mark.parametrize("phases", [1, 2, 3])
def test_the_table_of_materials_adds_up_to_the_robot(phases):
    """The machine as drawn is as heavy as the simulated robot: 1 % with two crank pins."""
    robot = built_robot(phases)
    assert sum(part.mass for part in bill_of_materials(robot)) == pytest.approx(robot.mass)
    order = Order(robot, layers(robot))
    rows = [*csv.DictReader(io.StringIO(to_csv(order.parts)))]
    mass = sum(int(row["number"]) * float(row["each g"] or 0.0) for row in rows)
    assert mass == pytest.approx(1e3 * order.mass, rel=1e-5)
    assert order.mass == pytest.approx(robot.mass, rel=0.01 if phases == 2 else 0.15)
    price = sum(int(row["number"]) * float(row["each EUR"] or 0.0) for row in rows)
    assert price == pytest.approx(order.price, rel=1e-3)
    names = [row["name"] for row in rows]
    keys = [(row["name"], row["stock size"]) for row in rows]
    assert len({*keys}) == len(keys)  # nothing is ordered twice
    assert {"shaft", "spacer", "axle", "tread", "motor-plate", "battery"} <= {*names}


@pytest.mark.slow
def test_files_are_the_same_every_time(tmp_path, capsys):
    """In another process too, where sets have another order."""
    arguments = ["built", "--sheet", "1000x500", "--out"]
    first, second = tmp_path / "first", tmp_path / "second"
    command.main([*arguments, str(first)])
    printed = capsys.readouterr().out
    assert "34 parts to cut; the machine weighs 5.20 kg" in printed and "warning" not in printed
    again = [sys.executable, "-m", "jansen_workshop", "drawings", *arguments, str(second)]
    subprocess.run(again, check=True, env=os.environ | {"PYTHONHASHSEED": "1"})
    files = {str(path.relative_to(first)) for path in first.rglob("*.*")}
    for file in files:
        texts = [(folder / file).read_bytes() for folder in (first, second)]
        if file.endswith(".dxf"):  # ezdxf lists what it registers in the order of a set
            texts = [b"".join(sorted(text.splitlines())) for text in texts]
        assert texts[0] == texts[1], file
    assert files >= {
        "coupon.stl", "coupon.svg", "holes.csv", "instructions.pdf", "materials.csv",
        "parts/foot.stl", "parts/foot.dxf", "parts/foot.svg", "sheets/4mm_1.dxf",
        "sheets/6mm_1.svg",
    }  # fmt: skip
    drawing = ezdxf.readfile(first / "sheets" / "6mm_1.dxf")
    assert drawing.units == ezdxf.units.MM
    assert not ezdxf.audit.Auditor(drawing).run()
    root = ET.parse(first / "sheets" / "6mm_1.svg").getroot()
    assert (root.get("width"), root.get("height")) == ("1000.000mm", "500.000mm")


def test_a_robot_file_is_drawn_under_its_own_name(tmp_path, monkeypatch, capsys):
    """And the machine that would be cut is a robot file, with a warning where it is another."""
    monkeypatch.chdir(tmp_path)
    robot = DESIGNS["chebyshev"]
    robot = replace(robot, legs=robot.legs[:1])
    write_robot("mine.json", robot)
    command.main(["mine.json", "--as-robot-file", "cut.json"])
    printed, reason = capsys.readouterr().out, "foot sweeps over the shaft and over the crank pin"
    assert f"there are no instructions, because {reason}" in printed
    assert f"warning: the simulated robot weighs {robot.mass:.2f} kg" in printed
    assert read_robot("cut.json") == machine_of(robot)
    assert (tmp_path / "mine" / "parts" / "tie.dxf").exists()
    assert not (tmp_path / "mine" / "instructions.pdf").exists()


@pytest.mark.parametrize("name", ["built", "weekend", "klann", "strider"])
def test_the_machine_that_would_be_cut_is_a_robot(name, tmp_path):
    """With the masses of the bill of materials and the robot's joints."""
    robot = ROBOTS[name]()
    path = write_robot(tmp_path / "machine.json", machine_of(robot))
    cut, mass = read_robot(path), sum(part.mass for part in bill_of_materials(robot))
    assert cut.mass == pytest.approx(mass, rel=1e-12)
    assert (abs(mass / robot.mass - 1.0) > ALIKE) == (name not in ("built", "weekend"))  # a warning
    psi = np.linspace(0.0, 6.0, 7)
    assert np.allclose(toe_positions(cut, psi), toe_positions(robot, psi), atol=1e-12)
    if name in ("built", "weekend"):  # the weekend robot is simulated as it is cut
        off = 0.05 if name == "built" else 2e-3  # holes for brace and standoffs
        inertias = [[body.inertia for body in each.bodies] for each in (cut, robot)]
        assert inertias[0] == pytest.approx(inertias[1], rel=off)
        assert cut.pad_compliance == robot.pad_compliance
    make_env("JansenWalker-v0", {"robot": str(path)}).reset(seed=0)


def test_parts_too_small_for_their_pins_are_refused():
    robot = built_robot().with_bodies(crank=Bar(0.01))
    with pytest.raises(ValueError, match=r"holes of crank .* got holes of 6 and 3"):
        cut_parts(robot)


ANCHOR = -0.2 * np.exp(1j * built_robot().frame_angle)  # m, on the bar of the frame
SPRINGS = (
    Spring("E", anchor=(ANCHOR.real, ANCHOR.imag), stiffness=30.0, rest_length=0.2),
    Spring("D", "C", stiffness=40.0, rest_length=0.3),
    Spring("B", anchor=(-0.4, 0.4), stiffness=50.0),
    TorsionSpring("rocker", "foot", stiffness=0.2, rest_angle=0.3),
)


def test_springs_have_holes_and_lines_in_the_bill():
    """An end on a frame has a hole at its distance from the axis; one beside it needs a bracket."""
    plain = built_robot()
    sprung = replace(plain, springs=SPRINGS)
    for part, other in zip(cut_parts(plain), cut_parts(sprung), strict=True):
        more = len(other.holes) - len(part.holes)
        assert more == (part.number == FRAME or part.name == "frame-doubler"), part.name
    frame = cut_parts(sprung)[FRAME - 1]
    hole = frame.holes[-1]
    assert hole.radius == M3
    assert abs(hole.corners[0] - frame.joints["O"]) == pytest.approx(200.0)
    rows = spring_rows(sprung)
    assert [row.number for row in rows] == [4] * 4
    assert [row.name for row in rows] == [
        "spring E-chassis",
        "spring D-C",
        "spring B-chassis",
        "torsion spring rocker-foot",
    ]
    assert rows[0].dimensions.startswith("30 N/m, rest 200.0 mm, longest ")
    assert rows[0].note.startswith(
        "eye on the pin of 6 mm at E; hole of 3.2 mm in frame at (-197.99"
    )
    assert rows[1].note == "eye on the pin of 6 mm at D; eye on the pin of 6 mm at C"
    assert "bracket at (-400, 400) mm" in rows[2].note
    assert rows[3].dimensions == "0.2 N m/rad, no torque at 17.2 degrees"
    (warning,) = missing_brackets(sprung)
    assert "spring B-chassis" in warning
    assert spring_rows(plain) == [] and missing_brackets(plain) == []


def test_a_point_of_a_link_without_a_pin_has_a_hole_for_its_spring():
    plain = built_robot()
    body = plain.linkage.names.index("upper_triangle")
    triangle = plain.bodies[body]
    corners = [cmath.rect(reach, angle) for reach, angle in triangle.corners]
    point = 0.25 * (corners[0] + corners[1]) + sum(corners) / 6.0
    places = tuple((z.real, z.imag) for z in (*corners, point))
    links = [*plain.linkage.bodies]
    links[body] = "upper_triangle", "PBDX"
    bodies = [*plain.bodies]
    bodies[body] = Plate(places, triangle.mass, triangle.inertia)
    robot = replace(
        plain,
        linkage=replace(plain.linkage, bodies=tuple(links), joints=plain.linkage.joints + "X"),
        bodies=tuple(bodies),
        springs=(Spring("X", "E", stiffness=50.0, rest_length=0.1),),
    )
    hole = cut_parts(robot)[body].holes[-1]
    assert hole.radius == M3
    assert hole.corners[0] == pytest.approx(cut_parts(robot)[body].joints["X"])
    (row,) = spring_rows(robot)
    assert row.note == "hole of 3.2 mm in upper_triangle at X; eye on the pin of 6 mm at E"


@pytest.mark.slow
def test_a_robot_with_springs_is_drawn(tmp_path, capsys):
    """The command writes all files, the springs are lines of the bill, and nothing else changes."""
    bills = []
    for name, springs in (("plain", ()), ("sprung", SPRINGS[1:2])):
        write_robot(tmp_path / f"{name}.json", replace(built_robot(), springs=springs))
        command.main([str(tmp_path / f"{name}.json"), "--out", str(tmp_path / name)])
        with (tmp_path / name / "materials.csv").open(encoding="utf-8") as file:
            bills.append([row[1:] for row in csv.reader(file)])
    assert [row for row in bills[1] if row not in bills[0]] == [
        row for row in bills[1] if row[0] == "spring D-C"
    ]
    assert len(bills[1]) == len(bills[0]) + 1
    assert "the 4 springs are in the bill of materials" in capsys.readouterr().out
    for path in sorted((tmp_path / "plain").rglob("*.svg")):
        assert (
            path.read_bytes()
            == (tmp_path / "sprung" / path.relative_to(tmp_path / "plain")).read_bytes()
        )
