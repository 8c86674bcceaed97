"""Cost of harder environments: new terrain at each reset, sensors, pushes, feet, motor.

    python -m benchmarks.world_costs [--rounds 7] [--out logs/world_costs] [--quick]

256 robots under random torques; worlds take turns in the same run. Writes ``worlds.md``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks import measure
from benchmarks.probe import OURS, robots
from jansen_env.terrain_generators import make_generator

COUNT = 256
FLAT = "flat"
LEVEL = 3  # of the ground whose exchange is measured
PAIRS = (
    ("one rough ground for all, for good", FLAT),
    ("another rough ground at each reset", "one rough ground for all, for good"),
    ("another rough ground at each reset", FLAT),
    ("with a height scan", FLAT),
    ("all parameters randomised", FLAT),
    ("JansenWalkerRough-v0", FLAT),
    ("JansenWalkerHardcore-v0", FLAT),
    ("JansenWalkerHardcore-v0", "the built robot, flat"),
)
"""Whose steps/s are divided by whose."""


def worlds() -> dict[str, dict[str, Any]]:
    """Arguments of each, by name."""
    draw = make_generator("rough")
    assert draw is not None
    scales = ("mass_scale", "inertia_scale", "damping_scale", "motor_strength")
    return {
        FLAT: {},
        "one rough ground for all, for good": {"terrain": draw(np.random.default_rng(0), LEVEL)},
        "another rough ground at each reset": {"terrain": "rough", "terrain_level": LEVEL},
        "with a height scan": {"height_scan": (0.5, 0.9, 15)},
        "all parameters randomised": {"randomize": {
            "friction": (0.4, 1.0), "restitution": (0.0, 0.3), "payload": (0.0, 0.5),
            "payload_x": (-0.1, 0.1), "payload_y": (-0.1, 0.1), "tilt": (-0.05, 0.05),
            "delay": (0.0, 0.04), **dict.fromkeys(scales, (0.9, 1.1)),
        }},
        "the built robot, flat": {"robot": "built"},
        "JansenWalkerRough-v0": {"env_id": "JansenWalkerRough-v0"},
        "JansenWalkerHardcore-v0": {"env_id": "JansenWalkerHardcore-v0"},
    }  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, write."""
    parser = measure.options(__doc__, "logs/world_costs", rounds=7)
    found = measure.chosen(parser, arguments)
    rounds = 1 if found.quick else found.rounds
    steps = 2_000 if found.quick else 60_000
    players = {
        name: robots(COUNT, steps, **{"env_id": OURS, **own}) for name, own in worlds().items()
    }
    rates = measure.take_turns({name: player.play for name, player in players.items()}, rounds)
    rows = [(name, *measure.spread(found)) for name, found in rates.items()]
    ratios = [(f"{one} / {other}", measure.ratio(rates[one], rates[other])) for one, other in PAIRS]
    text = "\n\n".join([
        measure.table((f"{COUNT} robots", "steps/s", "lowest", "highest"), rows),
        measure.table(("ratio", "steps/s (by round)"), ratios),
    ])  # fmt: skip
    measure.report(
        found.out / "worlds.md", "# Cost of harder environments", measure.conditions(rounds), text
    )


if __name__ == "__main__":
    main()
