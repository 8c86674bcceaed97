"""Parts of the built robot, loads of its pins and bars, speeds of its motors.

    python -m benchmarks.built_robot [--out docs/built_robot] [--plant rigid_body] [--quick]

Prints the bill of materials; writes ``loads.md`` and ``motors.md``, the latter alone on the
rigid-body plant.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import measure, walks
from benchmarks.measure import table
from benchmarks.walks import SETTLE, Walked, whole_half_turns
from jansen_env import MOTORS, Robot, Terrain, built_robot
from jansen_env.drawings.materials import bill_of_materials
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.plants.base import StepResult
from jansen_env.plants.plant import PLANTS, Plant, ProjectionPlant, make_plant
from jansen_env.plants.trace import trace_forces
from jansen_env.robot import JANSEN
from jansen_env.robot import buildable as built

Array = NDArray[np.float64]

SPEEDS: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)  # of the crank, rad/s
LOADED: tuple[float, ...] = (1.0, 2.0, 2.5, 3.0, 4.0)  # rad/s, of the walks whose loads are shown
DURATION = 6.0  # s
FINE_STEP = 2.5e-4  # s, that resolves touchdowns
STARTS = 10  # crank angles, over half a turn: after that the legs have swapped
BUCKLING_FACTOR = 3.0  # of safety that a rod shall have
RATED = {"ak80_6": 6.0, "mx_106": 8.4 / 5.0, "xm540_w270": 10.6 / 5.0}  # N m, continuous
RODS = ("upper_rod", "rocker", "lower_rod", "coupler")


def starts(number: int) -> list[float]:
    """Crank angles to start from, rad."""
    return [math.pi * k / number for k in range(number)]


def walk(
    plant: Plant,
    speed: float,
    duration: float,
    start: float = 0.0,
    watch: Callable[[StepResult], None] | None = None,
) -> Walked:
    """Walk within the motor's torque limit; see :func:`benchmarks.walks.walk`."""
    limit = plant.robot.motor.torque_limit
    duration = whole_half_turns(speed, duration)
    return walks.walk(
        plant, speed, duration, start=start, limit=limit, windup_limit=limit, watch=watch
    )


class Loads(NamedTuple):
    """The loads of a walk until its end or fall, N and N m."""

    mean: Array  # force in each of JANSEN.pins, of all legs
    largest: Array  # the same
    rods: Array  # largest compression of each of RODS
    normal: Array  # largest on a foot
    shear: Array  # largest on a foot
    rms_torque: Array
    peak_torque: Array
    fell: Array


def loads_of_walk(robot: Robot, speed: float, duration: float, start: float) -> Loads:
    """Walk on the projection plant, traced, with a fine time step."""
    plant, rows = ProjectionPlant(robot, Terrain.flat(), FINE_STEP), []
    plant.tracing = True
    walked = walk(plant, speed, duration, start, watch=lambda _: rows.append(plant.trace.copy()))
    traced = np.concatenate(rows)
    forces = trace_forces(plant.tables, traced, FINE_STEP)
    size = forces.magnitude
    contact = np.abs(traced["impulses"][:, : plant.toes]) / FINE_STEP
    return Loads(
        size.mean(axis=(0, 1)), size.max(axis=(0, 1)),
        np.array([largest_compression(forces, name) for name in RODS]),
        contact[..., 1].max(), contact[..., 0].max(),
        np.array(walked.rms_torque), np.array(walked.peak_torque), np.array(walked.fell),
    )  # fmt: skip


def loads_of_walks(
    robot: Robot, speeds: tuple[float, ...], duration: float, number: int = STARTS
) -> dict[float, Loads]:
    """The loads at each crank speed; every field has the starts first."""
    by_speed = {}
    for speed in speeds:
        each = [loads_of_walk(robot, speed, duration, angle) for angle in starts(number)]
        by_speed[speed] = Loads(*(np.stack(field) for field in zip(*each, strict=True)))
    return by_speed


def motors_table(plant: str, speeds: tuple[float, ...], duration: float, number: int) -> str:
    """Each motor at each crank speed: medians over the starts."""
    rows = []
    for name, motor in MOTORS.items():
        robot = replace(built_robot(), motor=motor)
        for speed in speeds:
            each = [
                walk(make_plant(plant, robot, Terrain.flat()), speed, duration, start)
                for start in starts(number)
            ]
            mid = Walked(*np.median(each, axis=0))
            rated = f"{100.0 * mid.rms_torque / RATED[name]:.0f} %" if name in RATED else ""
            rows.append((
                name, f"{speed:g}", f"{mid.crank_speed:.2f}", f"{mid.speed:.3f}",
                f"{mid.slip:.2f}", f"{mid.rms_torque:.2f}", rated, f"{mid.peak_torque:.1f}",
                f"{mid.cost_of_transport:.2f}", f"{mid.electrical:.2f}",
                str(sum(w.fell for w in each)),
            ))  # fmt: skip
    head = ("motor", "crank, asked (rad/s)", "reached (rad/s)", "speed (m/s)", "slip (m/m)",
            "RMS torque (N m)", "of its rating", "peak (N m)", "cost of transport", "electrical",
            "falls")  # fmt: skip
    return table(head, rows)


def buckling_load(robot: Robot, name: str) -> float:
    """Return the load at which a rod buckles, N."""
    return built.buckling_load(robot.body(name).length, thickness=built.bar_thickness(name))


def safety(robot: Robot, load: Loads) -> Array:
    """(starts, rods) against buckling between the pins."""
    most = np.array([buckling_load(robot, name) for name in RODS])
    return np.asarray(most / np.maximum(load.rods, 1e-9))


def strength_table(robot: Robot, loads: dict[float, Loads]) -> str:
    """Permissible loads beside the largest of all walks at each crank speed."""
    millimetre = 1e-3 * robot.pad_compliance.stiffness
    lines: list[tuple[str, str, str, Callable[[Loads], float]]] = [
        ("foot, load (N)", f"{built.FOOT_LOAD:.0f}", ".0f", lambda f: f.normal.max()),
        ("foot, compression (mm)", f"{1e3 * built.FOOT_STRAIN * built.FOOT_RADIUS:.1f}", ".1f",
         lambda f: f.normal.max() / millimetre),
        ("foot, shear (N)", f"{built.FOOT_SHEAR:.0f}", ".0f", lambda f: f.shear.max()),
        ("rods, least safety against buckling", f"{BUCKLING_FACTOR:g}", ".1f",
         lambda f: safety(robot, f).min()),
        ("pin's hole, yielding (N)", f"{built.yield_load():.0f}", ".0f",
         lambda f: f.largest.max()),
        ("motor, RMS torque (N m)", f"{RATED['ak80_6']:g}", ".1f", lambda f: f.rms_torque.max()),
        ("motor, peak torque (N m)", f"{robot.motor.torque_limit:g}", ".1f",
         lambda f: f.peak_torque.max()),
    ]  # fmt: skip
    rows = [(name, bears, *(format(of(load), form) for load in loads.values()))
            for name, bears, form, of in lines]  # fmt: skip
    falls = [f"{np.count_nonzero(load.fell)}" for load in loads.values()]
    speeds = [f"{speed:g} rad/s" for speed in loads]
    return table(("part", "bears", *speeds), [*rows, ("falls", "", *falls)])


def pin_table(loads: dict[float, Loads]) -> str:
    """Largest force in every pin at each crank speed, N."""
    rows = [(str(pin), *(f"{load.largest[:, i].max():.0f}" for load in loads.values()))
            for i, pin in enumerate(JANSEN.pins)]  # fmt: skip
    return table(("pin", *(f"{speed:g} rad/s" for speed in loads)), rows)


def parts_table(robot: Robot) -> str:
    """The bill of materials."""
    parts = bill_of_materials(robot)
    head = ("part", "material", "dimensions", "number", "each (g)", "all (g)", "price class")
    rows = [(p.name, p.material, p.dimensions, p.number, f"{1e3 * p.each:.1f}",
             f"{1e3 * p.mass:.0f}", p.price) for p in parts]  # fmt: skip
    total = ("all", "", "", "", "", f"{1e3 * sum(p.mass for p in parts):.0f}", "")
    return table(head, [*rows, total])


def largest_compression(forces: JointForces, name: str) -> float:
    """The largest push along a rod, N: the mean of its ends'."""
    body = JANSEN.names.index(name) + 1
    ends = [k for k, (b, _) in enumerate(JANSEN.corners) if b == body]
    axial = forces.link_loads()[..., ends, 0].mean(axis=-1)
    return float(max(0.0, -axial.min()))


def pin_of(pair: tuple[int, int]) -> int:
    """Return the index in :data:`JANSEN.pins` of the pin that joins a pair of bodies."""
    return next(k for k, pin in enumerate(JANSEN.pins) if {pin.body, pin.other} == set(pair))


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/built_robot")
    parser.add_argument(
        "--plant", choices=sorted(PLANTS), default="projection", help="of motors.md"
    )
    args = measure.parse(parser, arguments)
    speeds, loaded, duration = SPEEDS, LOADED, DURATION
    number = STARTS if args.plant == "projection" else 1  # the other is slow
    if args.quick:
        speeds, loaded, duration, number = SPEEDS[2:3], LOADED[1:2], 0.5, 1
    robot = built_robot()
    if args.plant == "projection":
        print(parts_table(robot), "\n")
        loads = loads_of_walks(robot, loaded, duration, number)
        measure.report(
            args.out / "loads.md",
            "# Loads of the built robot",
            f"`python -m benchmarks.built_robot`. {number} walks at each crank speed, about "
            f"{duration:g} s each on level ground, after {SETTLE:g} s, under the paper's PID, from "
            "crank angles evenly over half a turn. The largest values of all walks, legs and time "
            f"steps ({1e3 * FINE_STEP:g} ms).",
            "## What parts bear",
            strength_table(robot, loads),
            "## Pins\n\nLargest force, N.",
            pin_table(loads),
        )
    measure.report(
        args.out / ("motors.md" if args.plant == "projection" else f"motors_{args.plant}.md"),
        "# What motors walk with the built robot",
        f"`python -m benchmarks.built_robot --plant {args.plant}`. Medians over the first crank "
        f"angle, {number} evenly over half a turn; about {duration:g} s each, after {SETTLE:g} s, "
        "under the paper's PID within the motor's torque limit. Rating: the continuous torque "
        "(AK80-6: 6 N m; servos: a fifth of the stall torque). Cost of transport: |motor work| / "
        "(weight x distance), and energy drawn likewise.",
        motors_table(args.plant, speeds, duration, number),
    )


if __name__ == "__main__":
    main()
