"""Do the two plants agree? ``python -m benchmarks.plants [--out DIR] [--jobs N] [--quick]``

Runs the projection plant and the rigid-body plant side by side, with the time step halved on both:
the fixed frame, walks on level ground at many crank speeds and frictions, slopes and loads, and
what becomes of a steady walk when pymunk's solver iterates longer. Writes ``plants.json``,
``plants.md`` and the pictures.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks import plant_figures, plant_fixed, plant_tables
from benchmarks.plant_walks import Comparison, Walk, Way, compare, make, measure
from benchmarks.rounds import cpu_name
from jansen_env.files import write_json, write_text

SPEEDS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)  # rad/s
FRICTIONS = (0.1, 0.3, 0.6, 1.0)
SLOPES = (-0.15, -0.05, 0.05, 0.15)  # rad
PAYLOADS = (1.0, 5.0)  # kg
HARDER = 4.0  # rad/s, at which slopes and loads are walked
ITERATED = Walk(6.0, 0.3, duration=3.0)
ITERATIONS = (60, 200, 600, 2000)
"""A walk that is steady on the projection plant, and pymunk's iterations in every time step."""
SERVO_SPEEDS = (1.0, 3.0, 6.0)  # rad/s


def walks(quick: bool) -> list[Walk]:
    """Those compared; a few short ones to try the program."""
    if quick:
        return [Walk(speed, 0.3, duration=1.0) for speed in (1.0, 4.0)]
    level = [Walk(speed, friction) for friction in FRICTIONS for speed in SPEEDS]
    slopes = [Walk(HARDER, slope=slope) for slope in SLOPES]
    return level + slopes + [Walk(HARDER, payload=load) for load in PAYLOADS]


def iterated(iterations: int, walk: Walk) -> Way:
    """A walk with so many of pymunk's iterations in every time step, landing or not."""
    plant = make(walk, "rigid_body", iterations=iterations, landing_iterations=iterations)
    return measure(walk, plant)


def run(quick: bool, jobs: int) -> dict[str, Any]:
    """All of it; ready for JSON."""
    chosen = walks(quick)
    steps = plant_fixed.STEPS
    speeds = SERVO_SPEEDS[-1:] if quick else SERVO_SPEEDS
    walk = ITERATED if not quick else Walk(6.0, 0.3, duration=0.5)
    with ProcessPoolExecutor(jobs) as pool:
        compared = [pool.submit(compare, walk) for walk in chosen]
        swings = [pool.submit(plant_fixed.free_swing, step) for step in steps]
        servos = [pool.submit(plant_fixed.constant_speed, w, h) for w in speeds for h in steps]
        iterating = [pool.submit(iterated, n, walk) for n in ITERATIONS[: 2 if quick else None]]
        for number, future in enumerate(compared, 1):
            print(f"{number}/{len(compared)} {future.result().walk.title}", file=sys.stderr)
        fixed = [s.result() for s in swings] + [s.result()[0] for s in servos]
        return {
            "cpu": cpu_name(),
            "comparisons": [_plain(future.result()) for future in compared],
            "fixed": [f._asdict() for f in fixed],
            "torques": {str(w): servos[2 * i].result()[1][::10].tolist()
                        for i, w in enumerate(speeds)},
            "iterated": {
                "walk": vars(walk),
                "projection": measure(walk, make(walk, "projection"))._asdict(),
                "rigid": {str(n): f.result()._asdict()
                          for n, f in zip(ITERATIONS, iterating, strict=False)},
            },
        }  # fmt: skip


def _plain(comparison: Comparison) -> dict[str, Any]:
    return {
        "walk": vars(comparison.walk),
        "ensemble": [way._asdict() for way in comparison.ensemble],
        "others": [way._asdict() for way in comparison.others],
        "rigid": [way._asdict() for way in comparison.rigid],
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("logs/plants"), metavar="DIR",
                        help="where it all goes (logs/plants)")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side (2)")
    parser.add_argument("--quick", action="store_true", help="a few short walks, to try it")
    chosen = parser.parse_args(arguments)
    if chosen.jobs < 1:
        parser.error(f"--jobs is {chosen.jobs}, must be at least 1")
    result = run(chosen.quick, chosen.jobs)
    write_json(chosen.out / "plants.json", result)
    text = plant_tables.report(result)
    write_text(chosen.out / "plants.md", text)
    plant_figures.draw(result, chosen.out)
    print(text)


if __name__ == "__main__":
    main()
