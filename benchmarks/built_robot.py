"""What the built robot is made of, what its pins and bars carry, what its motors can walk.

    python -m benchmarks.built_robot [--out docs/built_robot] [--plant rigid_body] [--quick]

On the projection plant, or the rigid-body plant (motors alone), under the paper's PID on level
ground of friction 0.8. Prints the bill of materials; writes ``loads.md`` and ``motors.md``.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import measure
from benchmarks.measure import fallen, table
from jansen_env import MOTORS, Robot, Terrain, built, built_robot
from jansen_env.control import PID
from jansen_env.dynamics.joint_forces import CORNERS, PINS, JointForces
from jansen_env.gravity import GRAVITY
from jansen_env.kinematics import coordinates
from jansen_env.plants.base import Plant
from jansen_env.plants.make import PLANTS, make_plant
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.trace import trace_forces
from jansen_env.robot import BEARINGS, BODIES, BODIES_PER_LEG, Bar

Array = NDArray[np.float64]

SPEEDS: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)  # of the crank, rad/s
LOADED: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0)  # rad/s, of the walks whose loads are shown
DURATION, SETTLE = 12.0, 2.0  # s, measured and before that
CONTROL_DT = 0.02  # s
FINE_STEP = 2.5e-4  # s, that resolves touchdowns
RODS = ("upper_rod", "rocker", "lower_rod", "coupler")
MATERIALS = {"flat bar": "EN AW-6060 T66 flat bar", "plate": "EN AW-6060 T66 sheet, laser cut"}


class Part(NamedTuple):
    """A line of the bill of materials.

    Attributes:
        each: kg. price: class: A below 10 EUR, B 10 to 100 EUR, C above (for all of them).
    """

    name: str
    material: str
    dimensions: str
    number: int
    each: float
    price: str

    @property
    def mass(self) -> float:
        """Of all of them, kg."""
        return self.number * self.each


def bill_of_materials(robot: Robot) -> list[Part]:
    """All parts of the built robot; their masses add up to the robot's."""
    legs, parts, ends = len(robot.legs), [], 0
    for name in ("frame", "crank", *RODS):
        link, width = getattr(robot, name), built.FRAME_WIDTH if name == "frame" else built.WIDTH
        size = f"{1e3 * width:g} x {1e3 * built.BAR_THICKNESS:g} mm, {1e3 * link.length:.1f} mm"
        bare = built.flat_bar(link.length, width, 0.0).mass
        parts.append(Part(name, MATERIALS["flat bar"], f"{size} between pins", legs, bare, "A"))
        ends += 2 * legs
    for name in ("upper_triangle", "foot"):
        sides = getattr(robot, name).sides
        pins = " / ".join(f"{1e3 * side:.1f}" for side in sides)
        size = f"{1e3 * built.PLATE_THICKNESS:g} mm, pins' triangle {pins} mm"
        bare = built.triangular_plate(sides, 0.0).mass
        parts.append(Part(name, MATERIALS["plate"], size, legs, bare, "B"))
        ends += 3 * legs
    ends -= legs  # the toes
    pin = "M6 shoulder screw, nut, washers; iglidur J200 bush, 6 mm"
    foot = "natural rubber, 40 Shore A (KIPP K0566)"
    return [
        *parts,
        Part("pin and bush, a link's share", pin, "half a joint", ends, built.PIN_SHARE, "B"),
        Part("foot", foot, "buffer 20 x 15 mm, rounded to 10 mm", legs, built.PIN_SHARE, "B"),
        Part("gearmotor", "T-Motor AK80-6", "98 x 38.5 mm", 1, built.MOTOR_MASS, "C"),
        Part("battery, controller, cables", "LiPo 6S", "in two halves, at P", 1,
             built.MOTOR_MASS, "C"),
    ]  # fmt: skip


def parts_table(robot: Robot) -> str:
    """The bill of materials."""
    parts = bill_of_materials(robot)
    head = ("part", "material", "dimensions", "number", "each (g)", "all (g)", "price class")
    rows = [(p.name, p.material, p.dimensions, p.number, f"{1e3 * p.each:.1f}",
             f"{1e3 * p.mass:.0f}", p.price) for p in parts]  # fmt: skip
    total = ("all", "", "", "", "", f"{1e3 * sum(p.mass for p in parts):.0f}", "")
    return table(head, [*rows, total])


class Walked(NamedTuple):
    """What came out of a walk; of one that fell, until then.

    Attributes:
        speed: m/s. crank_speed: mean, rad/s. rms_torque, peak_torque: of the motor, N m. slip: m a
            metre. mechanical, electrical: cost of transport. fell: whether it did.
        forces: in the joints, of every time step, where asked for; angles: (steps,) of the crank,
            rad.
    """

    speed: float
    crank_speed: float
    rms_torque: float
    peak_torque: float
    slip: float
    mechanical: float
    electrical: float
    fell: bool
    forces: JointForces | None = None
    angles: Array | None = None


def walk(plant: Plant, speed: float, duration: float, trace: bool = False) -> Walked:
    """Walk under the paper's PID, at a crank speed (rad/s), for so long (s) after settling.

    To be exact, for the nearest whole number of the crank's half turns.
    """
    half_turn = math.pi / speed
    duration = max(1, round(duration / half_turn)) * half_turn
    plant.reset()
    pid, reference, integral, motor = PID(), 0.0, np.zeros(()), plant.robot.motor
    work = drawn = slip = square = peak = 0.0
    x = crank = 0.0
    rows, fell, k = [], False, 0
    settle, steps = round(SETTLE / CONTROL_DT), round((SETTLE + duration) / CONTROL_DT)
    if isinstance(plant, ProjectionPlant):
        plant.tracing = trace
    for k in range(steps):
        angle, rate = plant.state[[3, 7]].tolist()
        if k == settle:
            work = drawn = slip = square = peak = 0.0
            x, crank = plant.x, angle
        asked, integral = pid.torque(
            reference - angle, speed - rate, integral, CONTROL_DT, motor.torque_limit
        )
        reference += speed * CONTROL_DT
        asked = np.clip(asked, -motor.torque_limit, motor.torque_limit)
        used = float(motor.torque(asked, rate))
        result = plant.step(float(asked), CONTROL_DT)
        work, drawn = work + abs(result.motor_work), drawn + result.electrical_work
        slip, square, peak = slip + float(result.slip.sum()), square + used**2, max(peak, abs(used))
        if isinstance(plant, ProjectionPlant) and trace and k >= settle:
            rows.append(plant.trace.copy())
        fell = fallen(plant, result)
        if fell:
            break
    count = max(1, k + 1 - settle)
    way = plant.x - x
    carried = plant.robot.mass * GRAVITY * max(abs(way), 1e-9)
    found = Walked(
        way / (count * CONTROL_DT), (float(plant.state[3]) - crank) / (count * CONTROL_DT),
        math.sqrt(square / count), peak, slip / max(abs(way), 1e-9), work / carried,
        drawn / carried, fell,
    )  # fmt: skip
    if isinstance(plant, ProjectionPlant) and rows:
        traced = np.concatenate(rows)
        forces = trace_forces(plant.tables, traced, plant.time_step)
        return found._replace(forces=forces, angles=traced["pose"][:, 3])
    return found


def motors_table(plant: str, speeds: tuple[float, ...], duration: float) -> str:
    """Each motor at each crank speed."""
    rows = []
    for name, motor in MOTORS.items():
        robot = replace(built_robot(), motor=motor)
        for speed in speeds:
            found = walk(make_plant(plant, robot, Terrain.flat()), speed, duration)
            rows.append((
                name, f"{speed:g}", f"{found.crank_speed:.2f}", f"{found.speed:.3f}",
                f"{found.slip:.2f}", f"{found.rms_torque:.2f}", f"{found.peak_torque:.1f}",
                f"{found.mechanical:.2f}", f"{found.electrical:.2f}",
                "falls" if found.fell else "walks",
            ))  # fmt: skip
    head = ("motor", "crank, asked (rad/s)", "reached (rad/s)", "speed (m/s)", "slip (m/m)",
            "RMS torque (N m)", "peak (N m)", "cost of transport", "electrical", "")  # fmt: skip
    return table(head, rows)


def pin_table(forces: dict[float, JointForces]) -> str:
    """Mean and largest force in every pin at each crank speed."""
    head = ("pin", *(f"{speed:g} rad/s" for speed in forces))
    rows = []
    for i, pin in enumerate(PINS):
        sizes = [found.magnitude[..., i] for found in forces.values()]
        rows.append((str(pin), *(f"{size.mean():.0f} / {size.max():.0f}" for size in sizes)))
    return table(head, rows)


def rod_table(robot: Robot, forces: dict[float, JointForces]) -> str:
    """Largest compression of each rod, and its safety against buckling between the pins."""
    head = ("rod", "buckles at (N)", *(f"{speed:g} rad/s" for speed in forces))
    rows = []
    for name in RODS:
        link: Bar = getattr(robot, name)
        most = built.buckling_load(link.length)
        cells = []
        for found in forces.values():
            pushed = largest_compression(found, name)
            cells.append(f"{pushed:.0f} N, {most / max(pushed, 1e-9):.1f}")
        rows.append((name, f"{most:.0f}", *cells))
    return table(head, rows)


def largest_compression(forces: JointForces, name: str) -> float:
    """The largest push along a rod, N: the mean of its ends'."""
    body = BODIES.index(name) + 1
    ends = [k for k, (b, _) in enumerate(CORNERS) if b == body]
    axial = forces.link_loads()[..., ends, 0].mean(axis=-1)
    return float(max(0.0, -axial.min()))


def turning(robot: Robot, angles: Array) -> Array:
    """(n, legs, bearings) how fast each bearing turns per crank speed, at crank angles (n,)."""
    step, rates = 1e-6, []
    for leg in robot.legs:
        ahead, behind = (
            coordinates(robot, leg.side, angles + leg.phase + way).reshape(-1, BODIES_PER_LEG, 3)
            for way in (step, -step)
        )
        change = (ahead - behind)[..., 0]
        rates.append(((change + math.pi) % (2.0 * math.pi) - math.pi) / (2.0 * step))
    slope = np.stack(rates, axis=1)
    first, second = np.array(BEARINGS).T - 1
    return np.asarray(np.abs(slope[..., second] - slope[..., first]))


def pin_of(pair: tuple[int, int]) -> int:
    """Which of :data:`PINS` joins a pair of bodies."""
    return next(k for k, pin in enumerate(PINS) if {pin.body, pin.other} == set(pair))


def friction_table(robot: Robot, walks: dict[float, Walked]) -> str:
    """Dry friction of all bearings on the crank: as modelled, and in proportion to their loads."""
    places = [pin_of(pair) for pair in BEARINGS]
    rows = []
    for speed, found in walks.items():
        assert found.forces is not None and found.angles is not None
        turned = turning(robot, found.angles)
        constant = (turned @ np.array(robot.bearing_friction)).sum(axis=1)
        load = found.forces.magnitude[..., places]
        loaded = built.dry_torque(1.0) * (turned * load).sum(axis=(1, 2))
        rows.append((
            f"{speed:g}", f"{constant.mean():.3f} / {constant.max():.3f}",
            f"{loaded.mean():.3f} / {loaded.max():.2f}", f"{found.rms_torque:.2f}",
        ))  # fmt: skip
    head = ("crank (rad/s)", "as modelled, mean / largest (N m)", "by load, mean / largest (N m)",
            "motor, RMS (N m)")  # fmt: skip
    return table(head, rows)


def loads_of_walks(robot: Robot, speeds: tuple[float, ...], duration: float) -> dict[float, Walked]:
    """Traced walks at crank speeds, on the projection plant with a fine time step."""
    return {
        speed: walk(ProjectionPlant(robot, Terrain.flat(), FINE_STEP), speed, duration, trace=True)
        for speed in speeds
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/built_robot")
    parser.add_argument(
        "--plant", choices=sorted(PLANTS), default="projection", help="of motors.md"
    )
    found = measure.chosen(parser, arguments)
    speeds, loaded, duration = SPEEDS, LOADED, DURATION
    if found.quick:
        speeds, loaded, duration = SPEEDS[2:3], LOADED[1:2], 0.5
    robot = built_robot()
    command = "`python -m benchmarks.built_robot`."
    if found.plant == "projection":
        print(parts_table(robot), "\n")
        walks = loads_of_walks(robot, loaded, duration)
        forces = {s: walked.forces for s, walked in walks.items() if walked.forces is not None}
        measure.report(
            found.out / "loads.md",
            "# Loads of the built robot",
            f"{command} About {duration:g} s each on level ground.",
            "## Pins\n\nForce, mean / largest, N, of all legs.",
            pin_table(forces),
            "## Rods\n\nLargest compression, and safety against buckling (Euler, pinned ends).",
            rod_table(robot, forces),
            "## Friction of the bearings",
            "Of all of them, on the crank; by load: 0.11 x 3 mm x the pin's force.",
            friction_table(robot, walks),
        )
    measure.report(
        found.out / ("motors.md" if found.plant == "projection" else f"motors_{found.plant}.md"),
        "# What motors walk with the built robot",
        f"`python -m benchmarks.built_robot --plant {found.plant}`. About {duration:g} s each, "
        f"after {SETTLE:g} s, under the paper's PID within the motor's torque limit. "
        "Cost of transport: |motor work| / (weight x distance), and energy drawn likewise.",
        motors_table(found.plant, speeds, duration),
    )


if __name__ == "__main__":
    main()
