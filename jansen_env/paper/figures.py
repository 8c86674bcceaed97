"""The paper's Figs. 4 to 9 reproduced."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jansen_env.files import write_whole
from jansen_env.gravity import GRAVITY
from jansen_env.paper.claims import PRINTED_LEVEL
from jansen_env.paper.fixed_model import SETTLED
from jansen_env.paper.results import Results
from jansen_env.robot import paper_robot
from jansen_env.robot.kinematics import toe_positions

Array = NDArray[np.float64]

DPI = 130
LEG_COLORS = {"rf": "#c2410c", "lf": "#f59e0b", "rb": "#1d4ed8", "lb": "#38bdf8"}
LINK_COLORS = {f"link {body}": matplotlib.colormaps["turbo"](0.08 + 0.12 * (body - 1))
               for body in range(1, 9)}  # fmt: skip
INK, MUTED, ACCENT = "#1f2937", "#9ca3af", "#7c3aed"
STYLE: dict[str, object] = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK, "axes.grid": True, "axes.labelcolor": INK, "axes.spines.right": False,
    "axes.spines.top": False, "axes.titlelocation": "left", "axes.titlesize": 11,
    "axes.titleweight": "bold", "figure.facecolor": "white", "font.size": 9.5,
    "grid.color": "#e5e7eb", "legend.frameon": False, "legend.fontsize": 8.5,
    "lines.linewidth": 1.6, "xtick.color": INK, "ytick.color": INK,
}  # fmt: skip


def draw(results: Results, folder: Path) -> list[Path]:
    """Draw all figures into ``folder``; returns their paths."""
    figures: dict[str, Callable[[Results], Figure]] = {
        "fig4_torque": torque, "fig5_toe_paths": toe_paths, "fig6_toe_x": toe_x,
        "fig7_toe_y": toe_y, "fig8_rotation": rotation, "fig9_translation": translation,
    }  # fmt: skip
    with matplotlib.style.context(["default", STYLE]):
        return [
            write_whole(
                folder / f"{name}.png",
                partial(make(results).savefig, dpi=DPI, metadata={"Software": None}),
            )
            for name, make in figures.items()
        ]


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def torque(r: Results) -> Figure:
    """Fig. 4: the PID's torque against time."""
    figure, axes = _figure(7.2, 3.4)
    axes.plot(r.run.time[:-1], r.run.torque, color=INK, label="PID (13), crank speed about 1 rad/s")
    axes.plot(r.two_motors.time[:-1], -r.two_motors.torque, color="#c2410c", lw=1.2,
              label="two motors, each one's, counted the other way round")  # fmt: skip
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
    return toe_positions(paper_robot(), r.run.angle)


def toe_paths(r: Results) -> Figure:
    """Fig. 5: toe paths of the four legs."""
    figure, axes = _figure(7.2, 2.4)
    path = _toes(r)
    for i, (name, color) in enumerate(LEG_COLORS.items()):
        behind = name in ("lf", "lb")
        axes.plot(*path[:, i].T, color=color, lw=1.2 if behind else 3.0, label=name,
                  zorder=3 if behind else 2, ls="--" if behind else "-")  # fmt: skip
    axes.set(title="Toe paths, fixed base, crank axis at the origin (Fig. 5)",
             xlabel="x (m)", ylabel="y (m)", aspect="equal", ylim=(-0.66, -0.42))  # fmt: skip
    axes.legend(ncols=4, loc="upper center")
    return figure


def _in_time(
    r: Results, values: Array, colors: Mapping[str, object], title: str, label: str
) -> tuple[Figure, Axes]:
    """A curve for each column of ``values``, named and coloured, over the PID's run."""
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
    """Fig. 6: toe x against time."""
    return _in_time(r, _toes(r)[..., 0], LEG_COLORS, "Toe x (Fig. 6)", "x (m)")[0]


def toe_y(r: Results) -> Figure:
    """Fig. 7: toe y against time."""
    title = f"Toe y (Fig. 7): the lowest toe moves by {r.heaves[1].level:.3f} m"
    figure, axes = _in_time(r, height := _toes(r)[..., 1], LEG_COLORS, title, "y (m)")
    lowest = height.min(axis=1)
    axes.plot(r.run.time, lowest, color=INK, lw=1.0, ls=":")
    for level in (lowest.min(), lowest.max()):
        axes.axhline(level, color=MUTED, lw=0.8)
    return figure


def rotation(r: Results) -> Figure:
    """Fig. 8: constraint moment on every link of the right forepaw."""
    title = "Constraint moment, right forepaw (Fig. 8)"
    return _in_time(r, r.forces[..., 0], LINK_COLORS, title, "moment (N m)")[0]


def translation(r: Results) -> Figure:
    """Fig. 9: norm of the constraint force on every link of the right forepaw."""
    force = np.hypot(r.forces[..., 1], r.forces[..., 2])
    title = "Norm of the constraint force, right forepaw (Fig. 9)"
    figure, axes = _in_time(r, force, LINK_COLORS, title, "force (N)")
    weight = paper_robot().bodies[6].mass * GRAVITY
    axes.annotate(
        "weight of a link (link 1 rests)", (3.4, weight), (2.0, 1.01), fontsize=8.5, color=INK,
        arrowprops={"arrowstyle": "-", "color": MUTED},
    )  # fmt: skip
    return figure
