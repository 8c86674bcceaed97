"""The solid model of a machine: nothing overlaps, every screw has its hole and holds."""

import math
import re
from functools import cache

import numpy as np
import pytest
from known_designs import DESIGNS

from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.part_sizes import feet_of
from jansen_workshop.drawings import shaft_order
from jansen_workshop.drawings.bought import read_catalogue
from jansen_workshop.drawings.buildability import faults
from jansen_workshop.drawings.convex import Round
from jansen_workshop.drawings.instructions import Manual
from jansen_workshop.drawings.leg_solids import tread_arc
from jansen_workshop.drawings.machine_solids import PADDED, assemble, encoder_gap
from jansen_workshop.drawings.materials import counts
from jansen_workshop.drawings.order import Order
from jansen_workshop.drawings.outlines import coupon, cut_parts, toe_way
from jansen_workshop.drawings.shaft_order import carried
from jansen_workshop.drawings.solids import Cavity

layers = cache(shaft_order.layers)  # a search of a second or more
PLYWOOD = 680.0  # kg/m^3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["weekend", "built"])
def test_a_machine_can_be_assembled_and_turned(name):
    """No two solids overlap in a turn of the crank, all screws fit, threads are in metal."""
    assert faults(assemble(DESIGNS[name], layers(DESIGNS[name]))) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["weekend", "built"])
def test_what_is_in_the_solid_model_is_in_the_bill_and_the_reverse(name):
    robot = DESIGNS[name]
    order = Order(robot, layers(robot))
    count = order.assembly.count
    for part in order.parts:
        key = part.name, "" if part.thickness else part.dimensions
        assert count.pop(key) == part.number, key
    assert not count
    for flat, number in counts(robot).items():
        assert sum(piece.name == flat for piece in order.assembly.pieces) == number
    solids = {order.assembly.pieces[solid.piece].name for solid in order.assembly.solids}
    loose = {part.name for part in order.parts} - solids
    assert loose <= {
        "switch", "fuse", "emergency stop", "resistor", "wire and plugs", "foam tape", "cable tie",
    }  # fmt: skip


def test_the_encoders_chip_is_near_its_magnet_and_its_blocks_clear_the_shaft():
    """0.5 to 1.8 mm are usual for a magnet of 6 x 2.5 mm; nothing at rest touches the shaft."""
    assembly = assemble(DESIGNS["built"], layers(DESIGNS["built"]))
    assert 0.5 < encoder_gap(assembly) < 1.8
    blocks = [assembly.solids[k] for k in of(assembly, "encoder block")]
    (board,) = (assembly.solids[k] for k in of(assembly, "crank encoder"))
    shaft = 1e3 * assembly.build.shaft_radius
    assert len(blocks) == 2
    for block in blocks:
        assert (block.low, block.high) == (assembly.end, board.low)
        assert min(abs(z) for z in block.outline.corners) > shaft + 1.0
    assert math.isnan(encoder_gap(assemble(DESIGNS["weekend"], layers(DESIGNS["weekend"]))))


def test_a_turned_hub_is_one_piece_and_its_bore_ends_where_the_shaft_ends():
    """Spigot and bottom touch, the bottom fills the bore, and a piece of the shaft meets it."""
    assembly = assemble(DESIGNS["built"], layers(DESIGNS["built"]))
    shafts = [assembly.solids[k] for k in of(assembly, "shaft")]
    ends = {round(z, 6) for shaft in shafts for z in (shaft.low, shaft.high)}
    solids = [assembly.solids[k] for k in of(assembly, "hub")]
    for piece in {solid.piece for solid in solids}:
        ring, spigot, bottom = (solid for solid in solids if solid.piece == piece)
        assert {spigot.low, spigot.high} & {bottom.low, bottom.high}
        assert ring.low <= bottom.low and bottom.high <= ring.high
        assert bottom.outline.radius > spigot.outline.radius
        assert bottom.outline.radius == ring.cavities[0].outline.radius
        assert {round(bottom.low, 6), round(bottom.high, 6)} & ends


@pytest.mark.parametrize("name", ["weekend", "built"])
def test_the_foam_tape_fills_what_it_has_to_fill(name):
    """Four layers under what is at a pivot, and one layer under each board on top of that."""
    robot = DESIGNS[name]
    assembly = assemble(robot, layers(robot))
    components = read_catalogue(robot.material).components
    (tape,) = (component for component in components if component.name == "foam tape")
    width, length = map(float, re.findall(r"\d+", tape.size))
    needed = 0.0
    for component in components:
        if component.place in ("first", "last", "both", "axis"):
            along, across, *_ = component.room
            for k in of(assembly, component.name):
                solid = assembly.solids[k]
                padded = min(abs(solid.high - assembly.outside), abs(solid.low - assembly.end))
                strip = along * min(across, width)
                needed += strip * (4 if padded == pytest.approx(PADDED) else 1)
    assert needed < width * length


def of(assembly, name):
    """Numbers of the solids of pieces of a name."""
    return [k for k, s in enumerate(assembly.solids) if assembly.pieces[s.piece].name == name]


def change(assembly, k, **values):
    assembly.solids[k] = assembly.solids[k]._replace(**values)


def shift_holes(assembly):
    """The motor plate as it was: screws 15 mm to either side of the axis."""
    k = of(assembly, "motor-plate")[0]
    moved = [
        c._replace(outline=c.outline.moved(1 + 0j, 2 + 0j)) for c in assembly.solids[k].cavities
    ]
    change(assembly, k, cavities=tuple(moved))


def lengthen_hub_screw(assembly):
    """M3 x 10 through a crank of 3 mm and a hub of 5 mm meets the frame."""
    shank = next(s.shank for s in assembly.screws if assembly.solids[s.into].density == 2700.0)
    change(assembly, shank, low=assembly.solids[shank].low - 2.5)


def shorten_screw(assembly):
    screw = next(screw for screw in assembly.screws if screw.nut)
    solid = assembly.solids[screw.shank]
    change(assembly, screw.shank, low=solid.low + 2.0, high=solid.high - 2.0)


def meet_shafts(assembly):
    """The machine's shaft reaches as far as the motor's."""
    k = min(of(assembly, "shaft"), key=lambda k: assembly.solids[k].low)
    change(assembly, k, low=assembly.solids[k].low - 3.0)


def thread_wood(assembly):
    k = of(assembly, "brace")[0]
    solid = assembly.solids[k]
    thread = Cavity(Round((30 + 0j,), 1.5), solid.low, solid.high, thread=True)
    change(assembly, k, cavities=(*solid.cavities, thread))


def drill_wide(assembly):
    k = of(assembly, "brace")[0]
    wide = [c._replace(outline=c.outline._replace(radius=3.0)) for c in assembly.solids[k].cavities]
    change(assembly, k, cavities=tuple(wide))


def thicken_nut(assembly):
    """A nut between motor plate and motor touches the motor."""
    k = of(assembly, "thin nut DIN 439")[-1]
    solid = assembly.solids[k]
    change(assembly, k, low=solid.low - 9.0, high=solid.high + 9.0)


@pytest.mark.slow
@pytest.mark.parametrize("spoil, said", [
    (shift_holes, "has no aligned hole in motor-plate"),
    (lengthen_hub_screw, "frame"),
    (shorten_screw, "enters"),
    (meet_shafts, "gearmotor"),
    (thread_wood, "brace has a thread, but is not made of metal"),
    (drill_wide, "has a hole of 6.00 mm in brace"),
    (thicken_nut, "overlap"),
])  # fmt: skip
def test_faults_are_found(spoil, said):
    assembly = assemble(DESIGNS["weekend"], layers(DESIGNS["weekend"]))
    spoil(assembly)
    assert any(said in fault for fault in faults(assembly, 12)), faults(assembly, 12)


def test_the_strip_covers_what_touches_the_ground():
    """The lowest point of a toe's circle is on the strip while the toe is near the ground."""
    robot = DESIGNS["weekend"]
    psi = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    names = robot.linkage.joints
    for item in layers(robot):
        for toe in feet_of(robot, item.body):
            side = robot.legs[item.leg].side
            at = joint_positions(robot, side, psi) @ np.array([1e3, 1e3j])
            joints = at[:, [names.index(joint) for joint in item.part.joints]]
            z = item.part.joints[toe]
            start, end = carried(item.part, [z, z + toe_way(item.part, toe)], joints, side).T
            low = start.imag < start.imag.min() + 3.0
            off = np.abs(np.angle((end - start)[low] / -1j))
            assert off.max() < tread_arc(item.part, toe)


def test_the_weekend_machine_weighs_what_is_simulated():
    """The trim weight makes up for screws that are lighter than their share in the model: 0.1 %."""
    robot = DESIGNS["weekend"]
    order = Order(robot, layers(robot))
    assert order.mass == pytest.approx(robot.mass, rel=1e-3)
    plywood = [part for part in order.parts if part.thickness]
    honest = {0.0: 1.0}
    for thick in (2.9, 3.2):
        for density in (640.0, 720.0):
            honest[density * thick] = density * thick / (PLYWOOD * 3.0)
    wood = [piece for piece in order.assembly.pieces if order.line(piece) in plywood]
    mass = order.weigh(wood)
    for share in honest.values():
        assert mass.least <= share * mass.nominal <= mass.most


def test_the_last_page_is_the_assembled_machine():
    robot = DESIGNS["weekend"]
    manual = Manual(Order(robot, layers(robot)), cut_parts(robot), coupon(3.0, robot.build))
    last = manual.steps()[-1]
    assert last.title == "The assembled machine" and len(last.pictures) == 2
