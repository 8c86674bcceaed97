"""Parts of the built robot, loads of its pins and bars, speeds of its motors.

    python -m benchmarks.built_robot [--out docs/built_robot] [--plant rigid_body] [--quick]

Prints the bill of materials; writes ``loads.md`` and ``motors.md``, the latter alone on the
rigid-body plant.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks import measure, walks
from benchmarks.built_parts import parts_table
from benchmarks.measure import table
from benchmarks.walks import SETTLE, Walked, whole_half_turns
from jansen_env import MOTORS, Robot, Terrain, built_robot
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.plants.make import PLANTS, Plant, make_plant
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.trace import trace_forces
from jansen_env.robot import JANSEN
from jansen_env.robot import buildable as built
from jansen_env.robot.kinematics import turning

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
    plant: Plant, speed: float, duration: float, start: float = 0.0, **arguments: Any
) -> Walked:
    """Walk within the motor's torque limit; see :func:`benchmarks.walks.walk`."""
    limit = plant.robot.motor.torque_limit
    duration = whole_half_turns(speed, duration)
    return walks.walk(
        plant, speed, duration, start=start, limit=limit, windup_limit=limit, **arguments
    )


class Loads(NamedTuple):
    """The loads of a walk until its end or fall, N and N m."""

    mean: Array  # force in each of JANSEN.pins, of all legs
    largest: Array  # the same
    rods: Array  # largest compression of each of RODS
    normal: Array  # largest on a foot
    shear: Array  # largest on a foot
    constant: Array  # friction of the bearings on the crank, mean and largest, as modelled
    loaded: Array  # the same, in proportion to their loads
    rms_torque: Array
    peak_torque: Array
    fell: Array


def loads_of_walk(robot: Robot, speed: float, duration: float, start: float) -> Loads:
    """Walk on the projection plant, traced, with a fine time step."""
    plant, rows = ProjectionPlant(robot, Terrain.flat(), FINE_STEP), []
    plant.tracing = True
    found = walk(plant, speed, duration, start, watch=lambda _: rows.append(plant.trace.copy()))
    traced = np.concatenate(rows)
    forces = trace_forces(plant.tables, traced, FINE_STEP)
    size = forces.magnitude
    contact = np.abs(traced["impulses"][:, : plant.toes]) / FINE_STEP
    turned = turning(robot, traced["pose"][:, 3], JANSEN.bearings)
    constant = (turned @ np.array(robot.bearing_friction)).sum(axis=1)
    load = size[..., [pin_of(pair) for pair in JANSEN.bearings]]
    loaded = built.dry_torque(1.0) * (turned * load).sum(axis=(1, 2))
    return Loads(
        size.mean(axis=(0, 1)), size.max(axis=(0, 1)),
        np.array([largest_compression(forces, name) for name in RODS]),
        contact[..., 1].max(), contact[..., 0].max(),
        np.array([constant.mean(), constant.max()]), np.array([loaded.mean(), loaded.max()]),
        np.array(found.rms_torque), np.array(found.peak_torque), np.array(found.fell),
    )  # fmt: skip


def loads_of_walks(
    robot: Robot, speeds: tuple[float, ...], duration: float, number: int = STARTS
) -> dict[float, Loads]:
    """The loads at each crank speed; every field has the starts first."""
    found = {}
    for speed in speeds:
        each = [loads_of_walk(robot, speed, duration, angle) for angle in starts(number)]
        found[speed] = Loads(*(np.stack(field) for field in zip(*each, strict=True)))
    return found


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
                f"{sum(not w.fell for w in each)} of {number}",
            ))  # fmt: skip
    head = ("motor", "crank, asked (rad/s)", "reached (rad/s)", "speed (m/s)", "slip (m/m)",
            "RMS torque (N m)", "of its rating", "peak (N m)", "cost of transport", "electrical",
            "walk")  # fmt: skip
    return table(head, rows)


def heading(first: tuple[str, ...], loads: dict[float, Loads]) -> tuple[str, ...]:
    """A table's head: its first columns, and one for each crank speed."""
    return (*first, *(f"{speed:g} rad/s" for speed in loads))


def over_starts(values: Array, form: str, worst: Callable[[Array], float] = np.max) -> str:
    """Median over the starts, and the worst of them."""
    return f"{np.median(values):{form}} / {worst(values):{form}}"


def buckling_load(robot: Robot, name: str) -> float:
    """Return the load at which a rod buckles, N."""
    return built.buckling_load(robot.body(name).length, thickness=built.bar_thickness(name))


def safety(robot: Robot, found: Loads) -> Array:
    """(starts, rods) against buckling between the pins."""
    most = np.array([buckling_load(robot, name) for name in RODS])
    return np.asarray(most / np.maximum(found.rods, 1e-9))


def strength_table(robot: Robot, loads: dict[float, Loads]) -> str:
    """Return the table of permissible loads beside those of the walks."""
    millimetre = 1e-3 * robot.pad_compliance.stiffness
    lines: list[tuple[str, str, str, Callable[[Loads], Array], Callable[[Array], float]]] = [
        ("foot, load (N)", f"{built.FOOT_LOAD:.0f}", ".0f", lambda f: f.normal, np.max),
        ("foot, compression (mm)", f"{1e3 * built.FOOT_STRAIN * built.FOOT_RADIUS:.1f}", ".1f",
         lambda f: f.normal / millimetre, np.max),
        ("foot, shear (N)", f"{built.FOOT_SHEAR:.0f}", ".0f", lambda f: f.shear, np.max),
        ("rods, safety against buckling", f"{BUCKLING_FACTOR:g}", ".1f",
         lambda f: safety(robot, f).min(axis=1), np.min),
        ("pin's hole, yielding (N)", f"{built.yield_load():.0f}", ".0f",
         lambda f: f.largest.max(axis=1), np.max),
        ("motor, RMS torque (N m)", f"{RATED['ak80_6']:g}", ".1f", lambda f: f.rms_torque, np.max),
        ("motor, peak torque (N m)", f"{robot.motor.torque_limit:g}", ".1f",
         lambda f: f.peak_torque, np.max),
    ]  # fmt: skip
    rows = [
        (name, bears, *(over_starts(of(found), form, worst) for found in loads.values()))
        for name, bears, form, of, worst in lines
    ]
    upright = [
        f"{np.count_nonzero(found.fell == 0)} of {len(found.fell)}" for found in loads.values()
    ]
    return table(heading(("part", "bears"), loads), [*rows, ("walks without a fall", "", *upright)])


def pin_table(loads: dict[float, Loads]) -> str:
    """Mean and largest force in every pin at each crank speed."""
    rows = [
        (str(pin), *(f"{found.mean[:, i].mean():.0f} / {over_starts(found.largest[:, i], '.0f')}"
                     for found in loads.values()))
        for i, pin in enumerate(JANSEN.pins)
    ]  # fmt: skip
    return table(heading(("pin",), loads), rows)


def rod_table(robot: Robot, loads: dict[float, Loads]) -> str:
    """Largest compression of each rod, and its least safety against buckling."""
    rows = []
    for i, name in enumerate(RODS):
        cells = [f"{over_starts(found.rods[:, i], '.0f')} N, {safety(robot, found)[:, i].min():.1f}"
                 for found in loads.values()]  # fmt: skip
        rows.append((name, f"{buckling_load(robot, name):.0f}", *cells))
    return table(heading(("rod", "buckles at (N)"), loads), rows)


def largest_compression(forces: JointForces, name: str) -> float:
    """The largest push along a rod, N: the mean of its ends'."""
    body = JANSEN.names.index(name) + 1
    ends = [k for k, (b, _) in enumerate(JANSEN.corners) if b == body]
    axial = forces.link_loads()[..., ends, 0].mean(axis=-1)
    return float(max(0.0, -axial.min()))


def pin_of(pair: tuple[int, int]) -> int:
    """Which of :data:`JANSEN.pins` joins a pair of bodies."""
    return next(k for k, pin in enumerate(JANSEN.pins) if {pin.body, pin.other} == set(pair))


def friction_table(loads: dict[float, Loads]) -> str:
    """Dry friction of all bearings on the crank: as modelled, and in proportion to their loads."""
    rows = [
        (f"{speed:g}", *(f"{x[:, 0].mean():.3f} / {np.median(x[:, 1]):.2f}"
                         for x in (found.constant, found.loaded)),
         f"{np.median(found.rms_torque):.2f}")
        for speed, found in loads.items()
    ]  # fmt: skip
    head = ("crank (rad/s)", "as modelled, mean / largest (N m)", "by load, mean / largest (N m)",
            "motor, RMS (N m)")  # fmt: skip
    return table(head, rows)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/built_robot")
    parser.add_argument(
        "--plant", choices=sorted(PLANTS), default="projection", help="of motors.md"
    )
    found = measure.chosen(parser, arguments)
    speeds, loaded, duration = SPEEDS, LOADED, DURATION
    number = STARTS if found.plant == "projection" else 1  # the other is slow
    if found.quick:
        speeds, loaded, duration, number = SPEEDS[2:3], LOADED[1:2], 0.5, 1
    robot = built_robot()
    if found.plant == "projection":
        print(parts_table(robot), "\n")
        loads = loads_of_walks(robot, loaded, duration, number)
        measure.report(
            found.out / "loads.md",
            "# Loads of the built robot",
            f"`python -m benchmarks.built_robot`. {number} walks at each crank speed, about "
            f"{duration:g} s each on level ground, after {SETTLE:g} s, under the paper's PID; they "
            'start from crank angles evenly over half a turn. "Largest" is over all legs and '
            f"time steps ({1e3 * FINE_STEP:g} ms) of a walk; a / b: the median of the walks, and "
            "the worst.",
            "## What parts bear",
            strength_table(robot, loads),
            "## Pins\n\nForce: mean / largest, median / largest, worst, N, of all legs.",
            pin_table(loads),
            "## Rods\n\nLargest compression, median / worst, and the least safety against buckling "
            "(Euler, pinned ends).",
            rod_table(robot, loads),
            "## Friction of the bearings",
            "Of all of them, on the crank; by load: 0.11 x 3 mm x the pin's force.",
            friction_table(loads),
        )
    measure.report(
        found.out / ("motors.md" if found.plant == "projection" else f"motors_{found.plant}.md"),
        "# What motors walk with the built robot",
        f"`python -m benchmarks.built_robot --plant {found.plant}`. Medians over the first crank "
        f"angle, {number} evenly over half a turn; about {duration:g} s each, after {SETTLE:g} s, "
        "under the paper's PID within the motor's torque limit. Rating: the continuous torque "
        "(AK80-6: 6 N m; servos: a fifth of the stall torque). Cost of transport: |motor work| / "
        "(weight x distance), and energy drawn likewise.",
        motors_table(found.plant, speeds, duration, number),
    )


if __name__ == "__main__":
    main()
