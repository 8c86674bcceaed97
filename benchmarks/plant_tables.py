"""The tables of :mod:`benchmarks.plants`, in Markdown."""

from __future__ import annotations

from collections import Counter
from typing import Any

from benchmarks.plant_walks import Comparison, Walk, Way

ALLOWED = 0.05  # difference in distance and cost of transport up to which the plants agree
HEADS = ("distance", "cost of transport", "RMS torque", "heave", "slip")
COLUMNS = ("distance", "cost_of_transport", "rms_torque", "heave", "slip_per_metre")
UNITS = ("m", "1", "N m", "mm", "m/m")


def comparisons(result: dict[str, Any]) -> list[Comparison]:
    """Read back what :func:`benchmarks.plants.run` wrote."""
    return [
        Comparison(
            Walk(**entry["walk"]),
            *([Way(**way) for way in entry[name]] for name in ("ensemble", "others", "rigid")),
        )
        for entry in result["comparisons"]
    ]


def report(result: dict[str, Any]) -> str:
    """All tables and the count of verdicts."""
    compared = comparisons(result)
    verdicts = Counter(c.verdict(ALLOWED) for c in compared)
    count = ", ".join(f"{name}: {number}" for name, number in sorted(verdicts.items()))
    return "\n".join([
        "# Two plants, walk by walk", "",
        f"`python -m benchmarks.plants`, measured on: {result['cpu']}", "",
        "## The fixed frame", "", *fixed_table(result), "",
        "## Walks", "",
        "Projection plant (median of six runs) / rigid-body plant (time step / half of it). "
        "Spread: of the six runs' distances, which start within 1 mrad of one another or have half "
        "the time step. Other starts: distances on the projection plant from crank angles over "
        f"half a turn. Agree: distance and cost of transport within {100 * ALLOWED:.0f} %.", "",
        *walk_table(compared), "", f"{len(compared)} walks; {count}.", "",
        "## More iterations", "", *iteration_table(result), "",
    ])  # fmt: skip


def fixed_table(result: dict[str, Any]) -> list[str]:
    """How far apart the plants are with the chassis held."""
    lines = ["| | time step (ms) | difference | of | relative | joint gap (mm) |", "|---" * 6 + "|"]
    for row in result["fixed"]:
        share = row["difference"] / row["of"]
        lines.append(
            f"| {row['what']} | {1e3 * row['time_step']:g} | {row['difference']:.2g} | "
            f"{row['of']:.3g} | {share:.1e} | {1e3 * row['joint_gap']:.2g} |"
        )
    return lines


def walk_table(compared: list[Comparison]) -> list[str]:
    """A row per walk."""
    heads = [f"{name} ({unit})" for name, unit in zip(HEADS, UNITS, strict=True)]
    lines = [
        "| walk | " + " | ".join(heads) + " | joint gap (mm) | spread (%) | "
        "other starts (m) | verdict |",
        "|---" * 10 + "|",
    ]
    for c in compared:
        cells = [_cell(c, name) for name in COLUMNS]
        gap = 1e3 * max(way.joint_gap for way in c.rigid[:1])
        spread = "falls" if c.spread == float("inf") else f"{100 * c.spread:.1f}"
        others = sorted(way.distance for way in c.others if not way.fell)
        reach = f"{others[0]:.3g} to {others[-1]:.3g}" if others else "all fall"
        lines.append(
            f"| {c.walk.title} | {' | '.join(cells)} | {gap:.2g} | {spread} | {reach} | "
            f"{c.verdict(ALLOWED)} |"
        )
    return lines


def _cell(c: Comparison, name: str) -> str:
    scale = 1e3 if name == "heave" else 1.0
    values = [c.projection[name], *(getattr(way, name) for way in c.rigid)]
    one, *others = (f"{scale * value:.3g}" for value in values)
    return f"{one} / {' / '.join(others)}"


def iteration_table(result: dict[str, Any]) -> list[str]:
    """A steady walk with pymunk's solver iterating longer and longer."""
    study = result["iterated"]
    lines = [
        f"{Walk(**study['walk']).title}, {Walk(**study['walk']).measured:.2f} s.", "",
        "| iterations in every time step | distance (m) | cost of transport (1) | slip (m/m) |",
        "|---" * 4 + "|",
    ]  # fmt: skip
    for name, way in [*study["rigid"].items(), ("projection plant", study["projection"])]:
        lines.append(
            f"| {name} | {way['distance']:.3f} | {way['cost_of_transport']:.3f} | "
            f"{way['slip_per_metre']:.3f} |"
        )
    return lines
