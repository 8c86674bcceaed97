"""The pictures of :mod:`benchmarks.plants`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.plant_tables import ALLOWED, comparisons
from jansen_env.files import write_whole

COLOURS = {
    "agree": "#15803d", "chaotic": "#ca8a04", "falls at times": "#a21caf",
    "falls on both": "#6b7280", "other gait": "#0891b2", "differ": "#dc2626",
}  # fmt: skip


def draw(result: dict[str, Any], out: Path) -> None:
    """``walks.png``: speed and cost of transport on both; ``torque.png``: the fixed frame."""
    _walks(result, out / "walks.png")
    _torque(result, out / "torque.png")


def _walks(result: dict[str, Any], path: Path) -> None:
    compared = [c for c in comparisons(result) if not c.walk.slope and not c.walk.payload]
    frictions = sorted({c.walk.friction for c in compared})
    figure, axes = plt.subplots(
        2, len(frictions), figsize=(3.2 * len(frictions), 6.0), layout="constrained",
        sharex=True, sharey="row", squeeze=False,
    )  # fmt: skip
    for column, friction in enumerate(frictions):
        row = [c for c in compared if c.walk.friction == friction]
        for axis, name in zip(axes[:, column], ("distance", "cost_of_transport"), strict=True):
            speeds = [c.walk.speed for c in row]
            runs = [[_value(c, way, name) for way in c.ensemble if not way.fell] for c in row]
            walked = [(s, r) for s, r in zip(speeds, runs, strict=True) if r]
            axis.plot([s for s, _ in walked], [np.median(r) for _, r in walked],
                      color="#1d4ed8", lw=1.2, label="projection plant")  # fmt: skip
            axis.fill_between([s for s, _ in walked], [min(r) for _, r in walked],
                              [max(r) for _, r in walked], color="#1d4ed8", alpha=0.2)  # fmt: skip
            for c in row:
                for way, marker in zip(c.rigid, "ox", strict=True):
                    if not way.fell:
                        axis.plot(c.walk.speed, _value(c, way, name), marker, ms=6, mfc="none",
                                  color=COLOURS[c.verdict(ALLOWED)])  # fmt: skip
            if name == "cost_of_transport":
                axis.set_yscale("log")
            axis.grid(alpha=0.3)
        axes[0, column].set_title(f"friction {friction:g}", fontsize=10)
        axes[1, column].set_xlabel("crank speed, rad/s")
    axes[0, 0].set_ylabel("walking speed, m/s")
    axes[1, 0].set_ylabel("cost of transport")
    axes[0, 0].plot([], [], "ok", mfc="none", label="rigid-body plant")
    axes[0, 0].plot([], [], "xk", label="half its time step")
    for name, colour in COLOURS.items():
        axes[0, 0].plot([], [], "s", color=colour, label=name)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False)
    write_whole(path, lambda name: figure.savefig(name, dpi=110))
    plt.close(figure)


def _value(c: Any, way: Any, name: str) -> float:
    """Walking speed, m/s, for the distance; else the value itself."""
    value = float(getattr(way, name))
    return value / c.walk.measured if name == "distance" else value


def _torque(result: dict[str, Any], path: Path) -> None:
    curves = result["torques"]
    figure, axes = plt.subplots(
        2, len(curves), figsize=(3.6 * len(curves), 4.8), layout="constrained", squeeze=False,
        sharex=True, height_ratios=[2, 1],
    )  # fmt: skip
    for column, (speed, rows) in enumerate(curves.items()):
        angle, exact, rigid = np.array(rows).T
        turn = angle - 2.0 * np.pi
        top, bottom = axes[:, column]
        top.plot(turn, exact, color="#1d4ed8", lw=2.5, alpha=0.5, label="pinned plant")
        top.plot(turn, rigid, color="#111827", lw=0.8, label="rigid-body plant, frame held")
        bottom.plot(turn, 1e3 * (rigid - exact), color="#dc2626", lw=0.8)
        top.set_title(f"{float(speed):g} rad/s", fontsize=10)
        bottom.set_xlabel("crank angle, rad")
        top.grid(alpha=0.3)
        bottom.grid(alpha=0.3)
    axes[0, 0].set_ylabel("torque, N m")
    axes[1, 0].set_ylabel("difference, mN m")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False)
    write_whole(path, lambda name: figure.savefig(name, dpi=110))
    plt.close(figure)
