"""Solids of the drive of a machine: motor, coupling, shaft and hubs.

All lengths are in mm.
"""

from __future__ import annotations

from jansen_env.robot.linkage import CRANK
from jansen_env.robot.part_sizes import radii
from jansen_workshop.drawings.assembly import Assembly
from jansen_workshop.drawings.bought import read_catalogue
from jansen_workshop.drawings.convex import Round
from jansen_workshop.drawings.materials import LENGTHS, standard
from jansen_workshop.drawings.mount import SIZES
from jansen_workshop.drawings.outlines import motor_plate
from jansen_workshop.drawings.solids import (
    ALLOY,
    CHASSIS,
    SHAFT_AXIS,
    Axis,
    Cavity,
    Solid,
)

MOTOR = "gearmotor"  # name of the motor among the bought components
SHAFT_OUT = 3.0  # length of the shaft beyond the last frame
SPRING_PIN = 1.5  # radius of the spring pins through the hubs and the shaft
HUB_BOTTOM = 2.0  # thickness of the bottom of a turned hub's bore, which carries the spigot
SPIGOT_PLAY = 0.5  # length by which a spigot ends before the far side of its crank
HUB_THREAD = 3.0 * 2.5  # largest length of an M3 screw in a hub: 2.5 diameters


def add_hubs(assembly: Assembly) -> None:
    """Add the hubs that hold the cranks on the shaft, with their screws.

    Args:
        assembly: Machine to add them to.
    """
    for k, web in enumerate(assembly.webs):
        _add_hub(assembly, web, 1 if k % 2 else -1)


def _add_hub(assembly: Assembly, web: int, out: int) -> None:
    """Add the hub of one crank, with its screws.

    Args:
        assembly: Machine to add it to.
        web: Index of the crank's solid.
        out: Direction along the shaft from the crank to the hub, 1 or -1.
    """
    pin, _, shaft, radius = radii(assembly.build)
    length = 1e3 * assembly.build.hub_length
    plate = assembly.solids[web]
    unit = assembly.pieces[plate.piece].unit
    crank = assembly.parts[CRANK - 1]
    axis = Axis(plate.carrier, crank.joints[assembly.robot.linkage.bodies[CRANK - 1][1][0]])
    spots = [hole.corners[0] for hole in crank.holes[-2:]]
    face = plate.high if out > 0 else plate.low
    low, high = sorted((face, face + out * length))

    bore = f"bore {2 * shaft:g}"
    kind = "set screw"
    if assembly.metal:
        bore += f" x {length - HUB_BOTTOM:g}"
        kind = f"spigot {2 * pin:g} x {plate.high - plate.low - SPIGOT_PLAY:g}"
    size = f"{2 * radius:g} x {length:g} mm, {bore}, {kind}, two threads M3"
    piece = assembly.add_piece("hub", size, "crank", unit=unit)
    hub = assembly.add_ring(piece, axis, (radius, shaft), low, high, ALLOY)
    if assembly.metal:
        _add_spigot(assembly, piece, web, axis, out)
    for spot in spots:
        _add_hub_screw(assembly, Axis(plate.carrier, spot), web, hub, out)
    if assembly.metal:
        size = f"3 x {2.0 * radius - 1.0:g} mm"
        spring = assembly.add_piece("spring pin ISO 8752", size, "phases", unit=unit)
        across = 1j * (spots[0] - axis.centre) / abs(spots[0] - axis.centre)
        middle = 0.5 * (low + high + out * HUB_BOTTOM)  # middle of the bore
        _add_spring_pin(assembly, spring, axis, across, radius - 0.5, middle, ("hub", "shaft"))


def _add_spigot(assembly: Assembly, piece: int, web: int, axis: Axis, out: int) -> None:
    """Add the bottom of a hub's bore, and the spigot on it that fits into the crank.

    Args:
        assembly: Machine to add it to.
        piece: Index of the hub's piece.
        web: Index of the crank's solid.
        axis: Axis of the hub.
        out: Direction along the shaft from the crank to the hub, 1 or -1.
    """
    pin, _, shaft, _ = radii(assembly.build)
    plate = assembly.solids[web]
    face, far = (plate.high, plate.low) if out > 0 else (plate.low, plate.high)
    for radius, start, end in (
        (pin, far + out * SPIGOT_PLAY, face),
        (shaft, face, face + out * HUB_BOTTOM),
    ):
        low, high = sorted((start, end))
        assembly.add_solid(
            Solid(piece, plate.carrier, axis.circle(radius), low, high, density=ALLOY)
        )


def _add_hub_screw(assembly: Assembly, axis: Axis, web: int, hub: int, out: int) -> None:
    """Add a countersunk screw through a crank into a thread in its hub.

    Args:
        assembly: Machine to add it to.
        axis: Axis of the screw.
        web: Index of the crank's solid.
        hub: Index of the hub's solid.
        out: Direction along the shaft from the crank to the hub, 1 or -1.
    """
    size = SIZES["M3"]
    plate = assembly.solids[web]
    ring = assembly.solids[hub]
    thread = Cavity(axis.circle(size.radius), ring.low, ring.high, thread=True)
    assembly.cut_cavity(hub, thread)
    reach = plate.high - plate.low + min(1e3 * assembly.build.hub_length, HUB_THREAD)
    length = max(mm for mm in LENGTHS if mm <= reach + 1e-6)
    unit = assembly.pieces[plate.piece].unit
    name = f"M3 x {length:g} mm"
    screw = assembly.add_piece("countersunk screw ISO 10642", name, "crank", unit=unit)
    assembly.add_screw(
        screw,
        axis,
        seat=plate.low if out > 0 else plate.high,
        way=out,
        radius=size.radius,
        length=length,
        head=size.countersunk,
        into=hub,
        sunk=web,
    )


def _add_spring_pin(
    assembly: Assembly,
    piece: int,
    axis: Axis,
    across: complex,
    half: float,
    middle: float,
    drilled: tuple[str, str],
) -> None:
    """Add a spring pin across the shaft.

    Args:
        assembly: Machine to add it to.
        piece: Index of the pin's piece.
        axis: Axis of the shaft.
        across: Direction of the pin, as a complex number of magnitude 1.
        half: Half of the pin's length.
        middle: Position of the pin's axis along the shaft.
        drilled: Names of the pieces that are drilled together for the pin.
    """
    reach = (half - SPRING_PIN) * across
    shape = Round((axis.centre - reach, axis.centre + reach), SPRING_PIN)
    low = middle - SPRING_PIN
    high = middle + SPRING_PIN
    assembly.add_solid(Solid(piece, axis.carrier, shape, low, high, drilled=drilled))


def add_shaft(assembly: Assembly) -> None:
    """Add the pieces of the shaft, which end at the cranks, or at the bottoms of turned hubs.

    Args:
        assembly: Machine to add them to.
    """
    *_, shaft, _ = radii(assembly.build)
    gap = HUB_BOTTOM if assembly.metal else 0.0
    lows = [assembly.solids[web].low - gap for web in assembly.webs[::2]]
    highs = [assembly.solids[web].high + gap for web in assembly.webs[1::2]]
    bottoms = [assembly.shaft_end, *highs]
    tops = [*lows, assembly.end + SHAFT_OUT]
    for low, high in zip(bottoms, tops, strict=True):
        piece = assembly.add_piece("shaft", f"{2 * shaft:g} x {high - low:.1f} mm", "frames")
        assembly.add_solid(Solid(piece, CHASSIS, SHAFT_AXIS.circle(shaft), low, high))


# Motor


def motor_way(assembly: Assembly) -> complex:
    """Return the direction of the bar of the frame that carries the motor.

    Args:
        assembly: Machine with the motor.
    """
    return assembly.ways[assembly.robot.legs[assembly.placed[0].leg].side]


def add_motor_plate(assembly: Assembly) -> None:
    """Add the plate of the motor on its standoffs.

    Args:
        assembly: Machine to add it to.
    """
    turn = motor_way(assembly)
    low, high = assembly.motor_plate
    part = motor_plate(assembly.robot).moved(turn, 0j)
    piece = assembly.add_piece("motor-plate", "", "motor")
    cavities = tuple(Cavity(hole, low, high) for hole in part.holes)
    assembly.add_solid(Solid(piece, CHASSIS, part.outline, low, high, cavities, part.density))
    for reach in assembly.mount.screws:
        _add_standoff(assembly, reach, Axis(CHASSIS, reach * turn))


def _add_standoff(assembly: Assembly, reach: float, axis: Axis) -> None:
    """Add a standoff between the first frame and the motor plate, with a screw at either end.

    Args:
        assembly: Machine to add it to.
        reach: Distance of the standoff from the crank axis, along the frame's bar.
        axis: Axis of the standoff.
    """
    mount = assembly.mount
    size = assembly.screw_size
    thread_name = assembly.build.screw
    low, high = assembly.motor_plate
    standoff = assembly.add_piece("standoff", f"{thread_name} x {mount.standoff:g} mm", "ties")
    thread = Cavity(axis.circle(size.radius), high, assembly.outside, thread=True)
    shape = axis.circle(mount.standoff_radius)
    into = assembly.add_solid(
        Solid(standoff, CHASSIS, shape, high, assembly.outside, (thread,), ALLOY)
    )

    thickness = assembly.thickness * (1 + mount.doublers)
    length = max(mm for mm in LENGTHS if mm <= thickness + 2.0 * 2.0 * size.radius)
    name = f"{thread_name} x {length:g} mm"
    inner = assembly.add_piece("countersunk screw ISO 10642", name, "ties")
    seat = assembly.thickness
    assembly.add_screw(
        inner,
        axis,
        seat=seat,
        way=-1,
        radius=size.radius,
        length=length,
        head=size.countersunk,
        into=into,
    )
    assembly.countersink_frame(assembly.frames[0], reach, seat, -1, size.countersunk)

    length = standard(high - low + 2.0 * size.radius + 1.0)
    name = f"{thread_name} x {length:g} mm"
    outer = assembly.add_piece("socket screw ISO 4762", name, "motor")
    assembly.add_screw(
        outer,
        axis,
        seat=low,
        way=1,
        radius=size.radius,
        length=length,
        head=size.socket,
        into=into,
    )


def add_motor(assembly: Assembly) -> None:
    """Add the motor with its shaft and screws, and the coupling or the hub on its flange.

    Args:
        assembly: Machine to add them to.
    """
    mount = assembly.mount
    size = assembly.screw_size
    low, high = assembly.motor_plate
    motor = _add_motor_body(assembly)
    length = high - low + mount.into_motor
    for z in mount.motor_screws:
        name = f"{assembly.build.screw} x {length:g} mm"
        screw = assembly.add_piece("socket screw ISO 4762", name, "motor")
        assembly.add_screw(
            screw,
            Axis(CHASSIS, motor_way(assembly) * z),
            seat=high,
            way=-1,
            radius=size.radius,
            length=length,
            head=size.socket,
            into=motor,
        )
    if _flange_spots(assembly):
        _add_flange_hub(assembly, motor)
    else:
        _add_coupling(assembly)


def _flange_spots(assembly: Assembly) -> list[complex]:
    """Return the positions of the screws in the motor's flange; empty if it has none."""
    *_, circle = assembly.mount.flange
    return [circle * motor_way(assembly) * 1j**k for k in range(4)] if circle else []


def _add_motor_body(assembly: Assembly) -> int:
    """Add the motor and its shaft, and return the index of the solid with the motor's threads."""
    mount = assembly.mount
    low, _ = assembly.motor_plate
    components = read_catalogue(assembly.robot.material).components
    size = next(each.size for each in components if each.name == MOTOR)
    piece = assembly.add_piece(MOTOR, size, "motor")
    spots = [motor_way(assembly) * z for z in mount.motor_screws] + _flange_spots(assembly)
    radius = assembly.screw_size.radius
    threads = tuple(
        Cavity(Round((spot,), radius), low - mount.into_motor, low, thread=True) for spot in spots
    )
    motor_radius, motor_length = mount.motor
    outline = SHAFT_AXIS.circle(motor_radius)
    body = assembly.add_solid(
        Solid(piece, CHASSIS, outline, low - motor_length, low, threads, density=0.0)
    )
    shaft_radius, shaft_length = mount.motor_shaft
    if shaft_length:
        shaft = SHAFT_AXIS.circle(shaft_radius)
        assembly.add_solid(Solid(piece, CHASSIS, shaft, low, low + shaft_length, density=0.0))
    return body


def _add_coupling(assembly: Assembly) -> None:
    """Add the coupling that joins the shaft to that of the motor."""
    shaft = 1e3 * assembly.build.shaft_radius
    motor_shaft, _ = assembly.mount.motor_shaft
    radius, length = assembly.mount.coupling
    bores = f"{2 * shaft:g} to {2 * motor_shaft:g} mm"
    size = f"{bores}, {2 * radius:g} x {length:g} mm, set screws"
    piece = assembly.add_piece("coupling", size, "motor")
    start = assembly.shaft_end - 0.5 * length
    assembly.add_ring(piece, SHAFT_AXIS, (radius, shaft), start, start + length, ALLOY)


def _add_flange_hub(assembly: Assembly, motor: int) -> None:
    """Add the hub on the motor's flange that drives the shaft, with its pin and screws.

    Args:
        assembly: Machine to add it to.
        motor: Index of the solid with the flange's threads.
    """
    size = assembly.screw_size
    shaft = 1e3 * assembly.build.shaft_radius
    flange, thickness, _ = assembly.mount.flange
    boss, length = assembly.mount.coupling
    low, _ = assembly.motor_plate
    top = low + thickness
    spots = _flange_spots(assembly)

    plate_size = f"flange {2 * flange:g} x {thickness:g} mm"
    boss_size = f"boss {2 * boss:g} x {length:g} mm"
    dimensions = f"{plate_size}, {boss_size}, bore {2 * shaft:g} mm"
    hub = assembly.add_piece("motor-hub", dimensions, "motor")
    holes = [SHAFT_AXIS.circle(shaft), *(Round((z,), size.clearance) for z in spots)]
    cavities = tuple(Cavity(hole, low, top) for hole in holes)
    outline = SHAFT_AXIS.circle(flange)
    assembly.add_solid(Solid(hub, CHASSIS, outline, low, top, cavities, ALLOY))
    assembly.add_ring(hub, SHAFT_AXIS, (boss, shaft), top, top + length, ALLOY)

    pin = assembly.add_piece("spring pin ISO 8752", f"3 x {2.0 * boss - 1.0:g} mm", "motor")
    middle = top + length - 6.0
    drilled = ("motor-hub", "shaft")
    # The pin is 0.5 mm shorter than the boss at either end.
    _add_spring_pin(assembly, pin, SHAFT_AXIS, motor_way(assembly), boss - 0.5, middle, drilled)
    screw_length = thickness + assembly.mount.into_motor
    for spot in spots:
        name = f"{assembly.build.screw} x {screw_length:g} mm"
        screw = assembly.add_piece("socket screw ISO 4762", name, "motor")
        assembly.add_screw(
            screw,
            Axis(CHASSIS, spot),
            seat=top,
            way=-1,
            radius=size.radius,
            length=screw_length,
            head=size.socket,
            into=motor,
        )
