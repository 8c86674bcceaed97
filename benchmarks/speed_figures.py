"""The picture of :mod:`benchmarks.speed`: a panel or two for each part that was measured."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from benchmarks.speed_batch import title
from benchmarks.speed_single import MUJOCO, OURS
from jansen_env.files import write_whole

BLUE, GREY, ORANGE = "#1d4ed8", "#6b7280", "#ca8a04"
COLUMNS = 3
LABELS = {"legs": "legs", "segments": "segments of the ground"}


def draw(result: dict[str, Any], path: Path) -> None:
    """All panels in one picture; none without a panel."""
    found = panels(result["parts"])
    if not found:
        return
    columns = min(COLUMNS, len(found))
    rows = -(-len(found) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(4.6 * columns, 3.4 * rows), layout="constrained", squeeze=False
    )
    for axis in axes.flat[len(found) :]:
        axis.remove()
    for axis, panel in zip(axes.flat, found, strict=False):
        panel(axis)
        axis.grid(alpha=0.3)
        axis.set_axisbelow(True)
    write_whole(path, lambda name: figure.savefig(name, dpi=110))
    plt.close(figure)


def panels(parts: dict[str, Any]) -> list[Callable[[Axes], None]]:
    """What draws each panel."""
    found: list[Callable[[Axes], None]] = []
    if "single" in parts:
        found += [partial(_single, parts["single"], simulated) for simulated in (False, True)]
    if "kernel" in parts:
        found += [partial(_sweep, parts["kernel"][name], name) for name in LABELS]
    if "batch" in parts:
        found.append(partial(_batch, parts["batch"]))
    if "ppo" in parts:
        found.append(partial(_ppo, parts["ppo"]))
    return found


def _spread(found: dict[str, Any], factor: float = 1.0) -> list[list[float]]:
    """How far the rounds reach below and above their median, as errorbar takes it."""
    middle = found.get("steps_per_second", found.get("seconds", 0.0))
    low, high = min(found["rounds"]), max(found["rounds"])
    return [[factor * (middle - low)], [factor * (high - middle)]]


def _single(result: dict[str, Any], simulated: bool, axis: Axes) -> None:
    for name, env in reversed(result["environments"].items()):
        factor = env["step_duration"] if simulated else 1.0
        axis.barh(
            name, factor * env["steps_per_second"], xerr=_spread(env, factor), height=0.6,
            color=BLUE if name.startswith(OURS) else GREY, ecolor="black",
        )  # fmt: skip
    axis.set_xlabel("simulated s / s" if simulated else "steps / s")
    axis.set_title("one environment", fontsize=10)


def _sweep(rows: list[dict[str, Any]], name: str, axis: Axes) -> None:
    for row in rows:
        axis.errorbar(row["count"], 1e6 * row["seconds"], _spread(row, 1e6), fmt="o", color=BLUE)
    axis.plot([r["count"] for r in rows], [1e6 * r["seconds"] for r in rows], color=BLUE, lw=1.0)
    if name == "segments":
        axis.set_xscale("log")
    axis.set_ylim(0.0, 1.3e6 * max(max(row["rounds"]) for row in rows))
    axis.set_xlabel(LABELS[name])
    axis.set_ylabel("us")
    axis.set_title("a control step of 20 ms", fontsize=10)


def _batch(result: dict[str, Any], axis: Axes) -> None:
    rows = result["batches"]
    axis.plot([row["count"] for row in rows], [row["steps_per_second"] for row in rows], "o-",
              color=BLUE, label=OURS)  # fmt: skip
    for row in rows:
        axis.errorbar(row["count"], row["steps_per_second"], _spread(row), color=BLUE)
    axis.plot(result["compared"], result["rough"]["steps_per_second"], "s", color=BLUE, mfc="none",
              label="rough ground")  # fmt: skip
    for peer, marker in zip(result["peers"], "_v^", strict=False):
        if peer["name"] == MUJOCO:
            axis.axhline(peer["steps_per_second"], color=GREY, ls="--", label=f"{MUJOCO}, one")
        else:
            axis.plot(peer["count"], peer["steps_per_second"], marker, color=ORANGE,
                      label=title(peer))  # fmt: skip
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xticks([row["count"] for row in rows], [str(row["count"]) for row in rows])
    axis.minorticks_off()
    axis.set_xlabel("environments at once")
    axis.set_ylabel("steps / s")
    axis.set_title("many robots", fontsize=10)
    axis.legend(fontsize=8)


def _ppo(result: dict[str, Any], axis: Axes) -> None:
    for name, run in reversed(result["trained"].items()):
        step = 1e6 / run["steps_per_second"]
        inside = run["environment_share"] * step
        axis.barh(name, inside, height=0.6, color=BLUE)
        axis.barh(name, step - inside, left=inside, height=0.6, color=GREY)
    axis.plot([], [], "s", color=BLUE, label="environments")
    axis.plot([], [], "s", color=GREY, label="policy and learning")
    axis.set_xlabel("us of training per step")
    axis.set_title("PPO", fontsize=10)
    axis.margins(y=0.4)
    axis.legend(fontsize=8)
