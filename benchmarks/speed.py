"""How fast it is, beside what else there is.

    python -m benchmarks.speed [--rounds 7] [--out logs/speed] [--quick] [--only PART ...]

Five parts: ``single`` environments, the ``kernel`` of the time step, a ``batch`` of robots,
training by ``ppo``, and ``startup``. Whatever is compared takes turns in one run. Writes
``speed.json``, ``speed.md`` and ``speed.png``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks import speed_batch, speed_kernel, speed_ppo, speed_single, speed_startup
from benchmarks.rounds import FEWEST_ROUNDS, Goal, goal_table, machine, missing
from jansen_env.files import write_json, write_text

ROUNDS, QUICK_ROUNDS = 7, 2


class Part(NamedTuple):
    """A part of the measurement.

    Attributes:
        title: of its section. needs: modules it imports beyond the package's own.
        measure: (rounds, quick) to a result ready for JSON.
        report: the result to Markdown. goals: the result to what it should be.
    """

    title: str
    needs: tuple[str, ...]
    measure: Callable[[int, bool], dict[str, Any]]
    report: Callable[[dict[str, Any]], str]
    goals: Callable[[dict[str, Any]], list[Goal]]


PARTS = {
    name: Part(title, module.NEEDS, module.measure, module.report, module.goals)
    for name, title, module in (
        ("single", "One environment", speed_single),
        ("kernel", "The time step", speed_kernel),
        ("batch", "Many robots", speed_batch),
        ("ppo", "Training", speed_ppo),
        ("startup", "Starting", speed_startup),
    )
}


def run(names: list[str], rounds: int, quick: bool) -> dict[str, Any]:
    """Measure these parts; ready for JSON."""
    result: dict[str, Any] = {"machine": machine(), "rounds": rounds, "quick": quick, "parts": {}}
    for name in names:
        print(f"{PARTS[name].title.lower()} ...", file=sys.stderr, flush=True)
        result["parts"][name] = PARTS[name].measure(rounds, quick)
    result["goals"] = [goal._asdict() for goal in goals(result)]
    return result


def goals(result: dict[str, Any]) -> list[Goal]:
    """The goals of all parts measured."""
    return [goal for name, found in result["parts"].items() for goal in PARTS[name].goals(found)]


def report(result: dict[str, Any]) -> str:
    """A result as Markdown."""
    found = result["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    head = (
        f"# Speed\n\n{found['cpu']}, {found['cores']} cores, load average {found['load_average']} "
        f"at the start; {versions}. Medians of {result['rounds']} interleaved rounds"
        + (", shortened to try the program." if result["quick"] else ".")
    )
    sections = [
        f"## {PARTS[name].title}\n\n{PARTS[name].report(part)}"
        for name, part in result["parts"].items()
    ]
    return "\n\n".join([head, *sections, f"## Goals\n\n{goal_table(goals(result))}"]) + "\n"


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, metavar="N",
                        help=f"at least {FEWEST_ROUNDS} ({ROUNDS})")  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("logs/speed"), metavar="DIR",
                        help="where it all goes (logs/speed)")  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="short, to try it; proves nothing")
    parser.add_argument("--only", nargs="+", choices=PARTS, metavar="PART",
                        help=f"of {', '.join(PARTS)}; all without it")  # fmt: skip
    chosen = parser.parse_args(arguments)
    rounds, fewest = chosen.rounds, 1 if chosen.quick else FEWEST_ROUNDS
    if rounds is None:
        rounds = QUICK_ROUNDS if chosen.quick else ROUNDS
    if rounds < fewest:
        parser.error(f"--rounds is {rounds}, must be at least {fewest}")
    if chosen.out.exists() and not chosen.out.is_dir():
        parser.error(f"--out is {chosen.out}, which is no folder")
    names = [name for name in PARTS if chosen.only is None or name in chosen.only]
    lacking = missing(["matplotlib", *(need for name in names for need in PARTS[name].needs)])
    if lacking:
        parser.exit(2, lacking)
    result = run(names, rounds, chosen.quick)
    write_json(chosen.out / "speed.json", result)
    text = report(result)
    write_text(chosen.out / "speed.md", text)
    from benchmarks import speed_figures

    speed_figures.draw(result, chosen.out / "speed.png")
    print(text)


if __name__ == "__main__":
    main()
