"""Reproductions of Figs. 4 to 9 of the paper, and figures of mechanism, heave, slip and loads."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.files import write_whole
from jansen_env.paper import toes
from jansen_env.paper.claims import PRINTED_LEVEL
from jansen_env.paper.fixed_model import SETTLED
from jansen_env.paper.results import FRICTIONS, SLOW, Results
from jansen_env.robot import JANSEN, paper_robot
from jansen_env.robot.kinematics import O, P, T, toe_positions, world_joints

DPI = 130
NARROW = 5.6  # in, width of figures with several panels, so that phones show readable text
FLOOR = 1e-4  # slip per metre at which a walk without slip is drawn on a logarithmic axis, in m
LEG_COLORS = {"rf": "#c2410c", "lf": "#f59e0b", "rb": "#1d4ed8", "lb": "#38bdf8"}
LINK_COLORS = {
    f"link {body}": matplotlib.colormaps["turbo"](0.08 + 0.12 * (body - 1)) for body in range(1, 9)
}
SHOWN_LOADS = {(1.0, 0.3): "#a78bfa", (1.0, 0.8): "#5b21b6", (3.5, 0.8): "#c2410c"}
"""Colours of walks, by crank speed in rad/s and coefficient of friction."""
INK = "#1f2937"
MUTED = "#9ca3af"
ACCENT = "#7c3aed"
STYLE = Path(__file__).with_name("figures.mplstyle")


def draw(results: Results, folder: Path) -> list[Path]:
    """Draw all figures into a folder.

    Args:
        results: Results that the figures show.
        folder: Folder for the figures.

    Returns:
        Paths of the figures.
    """
    figures: dict[str, Callable[[Results], Figure]] = {
        "fig4_torque": torque,
        "fig5_toe_paths": toe_paths,
        "fig6_toe_x": toe_x,
        "fig7_toe_y": toe_y,
        "fig8_rotation": rotation,
        "fig9_translation": translation,
        "mechanism": mechanism,
        "heave": heave,
        "slip": slip,
        "joint_forces": joint_forces,
    }
    with matplotlib.style.context(["default", STYLE]):
        save: dict[str, Any] = {"dpi": DPI, "metadata": {"Software": None}}
        return [
            write_whole(folder / f"{name}.png", partial(make(results).savefig, **save))
            for name, make in figures.items()
        ]


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    """Return a new figure of a size in inches, and its axes."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def torque(r: Results) -> Figure:
    """Draw Fig. 4: the torque of the PID controller against time."""
    figure, axes = _figure(7.2, 3.4)
    axes.plot(r.run.time[:-1], r.run.torque, color=INK, label="PID (13), crank speed about 1 rad/s")
    axes.plot(
        r.two_motors.time[:-1],
        -r.two_motors.torque,
        color="#c2410c",
        lw=1.2,
        label="two motors, each one's, counted the other way round",
    )
    mean = r.mean_torque
    axes.axhline(mean, color=ACCENT, ls="--", lw=1.1)
    axes.axhline(PRINTED_LEVEL, color=MUTED, ls=":", lw=1.3)
    note = partial(axes.text, ha="right", fontsize=8.5)
    note(9.95, 2.35, f"mean friction at 1 rad/s: {mean:.2f} N m", color=ACCENT)
    note(10.0, PRINTED_LEVEL - 0.3, f"the paper's level, {PRINTED_LEVEL} N m", color="#6b7280")
    axes.axvspan(0.0, SETTLED, color="#f3f4f6", zorder=0)
    axes.set(title="Input torque (Fig. 4)", xlabel="time (s)", ylabel="torque (N m)", xlim=(0, 10))
    axes.legend(loc="center", bbox_to_anchor=(0.62, 0.47))
    return figure


def _toes(r: Results) -> Array:
    """Return the positions of the toes during the PID run, in m, shape (samples, toes, 2)."""
    return toe_positions(paper_robot(), r.run.angle)


def toe_paths(r: Results) -> Figure:
    """Draw Fig. 5: toe paths of the four legs."""
    figure, axes = _figure(7.2, 2.4)
    path = _toes(r)
    for i, (name, color) in enumerate(LEG_COLORS.items()):
        behind = name in ("lf", "lb")
        axes.plot(
            *path[:, i].T,
            color=color,
            lw=1.2 if behind else 3.0,
            label=name,
            zorder=3 if behind else 2,
            ls="--" if behind else "-",
        )
    axes.set(
        title="Toe paths, fixed base, crank axis at the origin (Fig. 5)",
        xlabel="x (m)",
        ylabel="y (m)",
        aspect="equal",
        ylim=(-0.66, -0.42),
    )
    axes.legend(ncols=4, loc="upper center")
    return figure


def _in_time(
    r: Results, values: Array, colors: Mapping[str, object], title: str, label: str
) -> tuple[Figure, Axes]:
    """Draw curves over the time of the PID run.

    Args:
        r: Results with the PID run.
        values: Values of the curves, shape (samples, curves).
        colors: Color of each curve by its name.
        title: Title of the figure.
        label: Label of the vertical axis.
    """
    figure, axes = _figure(7.2, 3.4 if len(colors) == 4 else 3.8)
    for column, (name, color) in zip(values.T, colors.items(), strict=True):
        axes.plot(r.run.time[: len(values)], column, color=color, label=name)
    axes.set(title=title, xlabel="time (s)", ylabel=label, xlim=(0, 10))
    if len(colors) == 4:
        axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.0))
        axes.margins(y=0.18)
    else:
        axes.legend(ncols=1, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure, axes


def toe_x(r: Results) -> Figure:
    """Draw Fig. 6: toe x against time."""
    return _in_time(r, _toes(r)[..., 0], LEG_COLORS, "Toe x (Fig. 6)", "x (m)")[0]


def toe_y(r: Results) -> Figure:
    """Draw Fig. 7: toe y against time."""
    title = f"Toe y (Fig. 7): the lowest toe moves by {r.heaves[1].level:.3f} m"
    figure, axes = _in_time(r, height := _toes(r)[..., 1], LEG_COLORS, title, "y (m)")
    lowest = height.min(axis=1)
    axes.plot(r.run.time, lowest, color=INK, lw=1.0, ls=":")
    for level in (lowest.min(), lowest.max()):
        axes.axhline(level, color=MUTED, lw=0.8)
    return figure


def rotation(r: Results) -> Figure:
    """Draw Fig. 8: the constraint moment on every link of the right forepaw."""
    title = "Constraint moment, right forepaw (Fig. 8)"
    return _in_time(r, r.forces[..., 0], LINK_COLORS, title, "moment (N m)")[0]


def translation(r: Results) -> Figure:
    """Draw Fig. 9: the norm of the constraint force on every link of the right forepaw."""
    force = np.hypot(r.forces[..., 1], r.forces[..., 2])
    title = "Norm of the constraint force, right forepaw (Fig. 9)"
    figure, axes = _in_time(r, force, LINK_COLORS, title, "force (N)")
    weight = paper_robot().bodies[6].mass * GRAVITY
    axes.annotate(
        "weight of a link (link 1 rests)",
        (3.4, weight),
        (2.0, 1.01),
        fontsize=8.5,
        color=INK,
        arrowprops={"arrowstyle": "-", "color": MUTED},
    )
    return figure


def _angle_axis(axes: Axes) -> None:
    """Make the horizontal axis one turn of the crank, with ticks at multiples of pi/2."""
    axes.set_xlabel("crank angle (rad)")
    labels = ["0", r"$\pi/2$", r"$\pi$", r"$3\pi/2$", r"$2\pi$"]
    axes.set_xticks(np.pi / 2.0 * np.arange(5), labels)
    axes.set_xlim(0.0, 2.0 * np.pi)


def mechanism(_: Results) -> Figure:
    """Draw the mechanism at eight crank angles, with the right pair of legs in front."""
    robot = paper_robot()
    figure = Figure(figsize=(NARROW, 7.2), layout="constrained")
    grid = figure.subplots(4, 2, sharex=True, sharey=True)
    path = toe_positions(robot, toes.turn(360))
    angles = ("0", "π/4", "π/2", "3π/4", "π", "5π/4", "3π/2", "7π/4")
    for k, (angle, axes) in enumerate(zip(angles, grid.flat, strict=True)):
        joints = world_joints(robot, np.array([0.0, 0.0, 0.0, k * np.pi / 4.0]))
        for leg in (0, 2):
            axes.plot(*path[:, leg].T, color="#e5e7eb", lw=1.2)
        for i in (1, 3, 0, 2):
            front = (name := robot.leg_names[i]).startswith("r")
            color = LEG_COLORS[name] if front else "#cbd5e1"
            for a, b in JANSEN.skeleton:
                width = 3.0 if (a, b) in ((P, O), (O, P)) else 1.6 if front else 1.0
                axes.plot(
                    *joints[i, [a, b]].T,
                    color=INK if (a, b) == (P, O) else color,
                    lw=width,
                    solid_capstyle="round",
                )
            if front:
                axes.plot(*joints[i, :T].T, "o", color=color, ms=2.2)
                axes.plot(*joints[i, T], "o", color=color, ms=5)
        axes.set(aspect="equal", xticks=(-0.5, 0.0, 0.5))
        axes.set_title(f"crank angle {angle}", fontsize=9.5, fontweight="normal")
        axes.set(xlabel="x (m)" if k > 5 else "", ylabel="" if k % 2 else "y (m)")
    return figure


def heave(r: Results) -> Figure:
    """Draw the heave by number of legs, and the reason why odd numbers of phases differ."""
    figure = Figure(figsize=(NARROW, 6.0), layout="constrained")
    panels = figure.subplot_mosaic([["legs", "legs"], ["six", "eight"]], height_ratios=(1.0, 0.9))
    left = panels["legs"]
    legs = np.array([h.legs for h in r.heaves])
    level = 1e3 * np.array([h.level for h in r.heaves])
    standing = 1e3 * np.array([h.standing for h in r.heaves])
    odd = (legs // 2) % 2 == 1
    left.semilogy(legs, level, color=MUTED, lw=1.0, zorder=1)
    left.semilogy(
        legs[odd], level[odd], "o", color="#c2410c", label="chassis level, odd number of pins"
    )
    left.semilogy(
        legs[~odd], level[~odd], "s", color="#1d4ed8", label="chassis level, even number of pins"
    )
    left.semilogy(legs, standing, "x--", color=INK, lw=0.9, ms=5, label="on a front and a rear toe")
    left.set(
        title="Heave by number of legs",
        xlabel="number of legs, two per crank pin",
        ylabel="heave, peak to peak (mm)",
        xticks=legs[1::2],
    )
    left.legend(loc="upper right")
    for axes, phases in ((panels["six"], 3), (panels["eight"], 4)):
        angle = toes.turn(720)
        fore, back = toes.lowest_toes(paper_robot(phases), angle)
        axes.plot(angle, 1e3 * fore, color=LEG_COLORS["rf"], lw=1.3, label="lowest front toe")
        axes.plot(angle, 1e3 * back, color=LEG_COLORS["rb"], lw=1.3, label="lowest rear toe")
        axes.plot(
            angle,
            1e3 * np.minimum(fore, back),
            color=INK,
            lw=2.4,
            alpha=0.75,
            label="lowest of all toes",
        )
        kind = "alternate" if phases % 2 else "coincide"
        axes.set(title=f"{2 * phases} legs: toes {kind}", ylim=(-622, -601))
        _angle_axis(axes)
    panels["six"].set_ylabel("height above the crank (mm)")
    panels["six"].legend(loc="upper center")
    return figure


def slip(r: Results) -> Figure:
    """Draw the speed at which two standing toes move apart, and the slip by friction and speed."""
    figure = Figure(figsize=(NARROW, 8.4), layout="constrained")
    left, middle, right = figure.subplots(3)
    support = r.support
    left.axhline(0.0, color=INK, lw=0.8)
    left.plot(support.angle, support.slip, color=INK, lw=1.8)
    for zero in support.zeros():
        left.plot(zero, 0.0, "o", color="#c2410c", ms=5)
    left.set(
        title="Speed at which two standing toes move apart", ylabel="speed (m per rad of the crank)"
    )
    _angle_axis(left)
    slow = [r.slow[mu].slip for mu in FRICTIONS]
    middle.axhline(support.per_turn, color="#c2410c", ls="--", lw=1.2, label="always on two toes")
    middle.axhline(0.5 * support.per_turn, color=MUTED, ls=":", lw=1.2, label="half of that")
    middle.plot(FRICTIONS, slow, "o-", color=INK, label=f"walk at {SLOW} rad/s")
    middle.set(
        title="Slip of a slow walk",
        xlabel="coefficient of friction",
        ylabel="slip (m per turn)",
        ylim=(0.0, 0.85),
    )
    middle.legend(loc="lower left")
    speed = np.array([w.speed for w in r.walks])
    ratio = np.array([np.nan if w.fell else w.slip_per_metre for w in r.walks])
    right.semilogy(speed, ratio, "o-", color=INK)
    for walk in r.walks:
        if walk.fell:
            right.axvspan(walk.speed - 0.25, walk.speed + 0.25, color="#fecaca", lw=0)
    right.set(
        title="Slip by crank speed, friction coefficient 0.8",
        xlabel="crank speed (rad/s)",
        ylabel="slip (m per m walked)",
    )
    right.plot([], [], lw=8, color="#fecaca", label="falls within 75 s")
    right.plot(r.no_slip.speed, FLOOR, "v", color="#059669", label="no slip, from another start")
    right.set_ylim(0.05 * FLOOR, 1.5)
    right.legend(loc="lower right", frameon=True, framealpha=1.0, edgecolor="none")
    return figure


def joint_forces(r: Results) -> Figure:
    """Draw the largest force of each link on each of its joints, on a fixed base and walking."""
    figure, axes = _figure(NARROW, 6.2)
    weight = paper_robot().mass * GRAVITY
    axes.axvline(weight, color=INK, lw=0.9, ls="--", label="weight of the robot")
    corners = [f"{body} at {joint}" for body, joint in JANSEN.holes]
    axes.plot(r.fixed_loads.bearing, corners, "s", color="#64748b", label="fixed base, 1 rad/s")
    for (speed, friction), color in SHOWN_LOADS.items():
        forces = r.walking_loads[speed, friction].bearing
        label = f"walking, {speed:g} rad/s, friction {friction}"
        axes.plot(forces, corners, "o", fillstyle="none", mew=1.6, color=color, label=label)
    axes.set(
        title="Largest force of each link on its joints",
        xlabel="force (N)",
        ylabel="link and joint",
        xlim=(0.0, None),
    )
    axes.invert_yaxis()
    figure.legend(loc="outside lower center", ncols=2)
    return figure
