"""The pictures of :mod:`benchmarks.convergence`, one for each setting that was varied."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from jansen_env.files import write_whole

COLOURS = ("#1d4ed8", "#ca8a04")  # of the grounds
MARKERS = {"distance": "o", "slip": "s", "work": "^"}
NOTHING = 1e-7  # m; an error below that is drawn there


def draw(result: dict[str, Any], out: Path) -> None:
    """``time_step.png`` and ``detection_interval.png``."""
    for study in result["studies"]:
        figure, axes = plt.subplots(2, 3, figsize=(13.0, 6.8), layout="constrained")
        _error(study, axes[0, 0])
        for axis, name in zip(axes[0, 1:], study["grounds"], strict=True):
            _changes(study, name, axis)
        _quantity(study, "audit", 1.0, "energy left over / motor work", axes[1, 0])
        _quantity(study, "penetration", 1e3, "deepest toe in the ground, mm", axes[1, 1])
        _cost(study, axes[1, 2])
        values = [1e3 * row["value"] for row in next(iter(study["grounds"].values()))]
        for axis in axes.flat:
            axis.axvline(1e3 * study["default"], color="#6b7280", ls="--", lw=1.0, zorder=0)
            axis.set_xscale("log")
            axis.set_xticks(values, [f"{value:g}" for value in values])
            axis.minorticks_off()
            axis.set_xlabel(f"{study['what'].replace('_', ' ')}, ms")
            axis.grid(alpha=0.3)
        path = out / f"{study['what']}.png"
        write_whole(path, lambda name, figure=figure: figure.savefig(name, dpi=110))  # type: ignore[misc]
        plt.close(figure)


def _rows(study: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """A ground's rows, without the reference itself, which has no error."""
    return [row for row in study["grounds"][name] if row["value"] != study["finest"]]


def _error(study: dict[str, Any], axis: Axes) -> None:
    for name, colour in zip(study["grounds"], COLOURS, strict=False):
        rows = _rows(study, name)
        value = np.array([1e3 * row["value"] for row in rows])
        low, middle, high = (
            1e3 * np.maximum([row["error"][key] for row in rows], NOTHING)
            for key in ("low", "median", "high")
        )
        axis.plot(value, middle, "o-", color=colour, label=name)
        axis.fill_between(value, low, high, color=colour, alpha=0.15)
        if "time_step_error" in study:
            error = 1e3 * study["time_step_error"][name]
            axis.axhline(error, color=colour, ls=":", label="the time step's own")
        elif colour == COLOURS[0]:
            axis.plot(value, middle[-1] * value / value[-1], color="black", lw=0.8, label="order 1")
    axis.set_yscale("log")
    axis.set_ylabel("mm")
    axis.set_title("error of the position after 1 s, 8 of 10 starts", fontsize=10)
    axis.legend(fontsize=8)


def _changes(study: dict[str, Any], name: str, axis: Axes) -> None:
    rows = _rows(study, name)
    for number, (quantity, marker) in enumerate(MARKERS.items()):
        shift = 1.06 ** (number - 1)  # so that they do not hide one another
        axis.errorbar(
            [1e3 * shift * row["value"] for row in rows],
            [100.0 * row["changes"][quantity]["mean"] for row in rows],
            [100.0 * row["changes"][quantity]["standard_error"] for row in rows],
            fmt=marker, ms=4, label=quantity,
        )  # fmt: skip
    axis.axhline(0.0, color="black", lw=0.8)
    axis.set_ylabel("change, %, with standard error")
    axis.set_title(f"means of a walk: {name}", fontsize=10)
    axis.legend(fontsize=8, loc="lower left")


def _quantity(study: dict[str, Any], key: str, factor: float, label: str, axis: Axes) -> None:
    for (name, rows), colour in zip(study["grounds"].items(), COLOURS, strict=False):
        value = [1e3 * row["value"] for row in rows]
        axis.plot(value, [factor * row[key]["median"] for row in rows], "o-", color=colour,
                  label=name)  # fmt: skip
        axis.plot(value, [factor * row[key]["worst"] for row in rows], "x", color=colour)
    axis.plot([], [], "x", color="black", label="worst start")
    axis.set_yscale("log")
    axis.set_title(label, fontsize=10)
    axis.legend(fontsize=8)


def _cost(study: dict[str, Any], axis: Axes) -> None:
    cost = {1e3 * float(value): 1e6 * seconds for value, seconds in study["cost"].items()}
    axis.plot(list(cost), list(cost.values()), "o-", color="#111827")
    axis.set_ylim(0.0, 1.1 * max(cost.values()))
    axis.set_title("cost of 20 ms of a walk, us", fontsize=10)
