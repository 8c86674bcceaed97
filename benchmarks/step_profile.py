"""Where the time of a step goes.

    python -m benchmarks.step_profile [--rounds 7] [--out FILE]

Parts are timed one level at a time, from outside, and the levels take turns, so that no timer
measures another one. A part's own time is its time less that of the parts in it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401 - registers the environments
from benchmarks.rounds import FEWEST_ROUNDS, machine
from jansen_env.engine import tables
from jansen_env.engine.jit import compiled
from jansen_env.envs.walker import JansenWalkerEnv
from jansen_env.files import write_text

STEPS = 1000  # of a round: two episodes
READS = 20_000  # of the tables, at a time


def walk(env: Any, actions: list[Any]) -> float:
    """Seconds a step, over two episodes."""
    env.reset(seed=0)
    spent = 0.0
    for number, action in enumerate(actions):
        start = time.perf_counter()
        _, _, terminated, truncated, _ = env.step(action)
        spent += time.perf_counter() - start
        if terminated or truncated:
            env.reset(seed=number)
    return spent / len(actions)


def timed(owner: Any, name: str, run: Callable[[], float]) -> float:
    """Seconds a step spent in a method while ``run`` runs, which walks :data:`STEPS` steps."""
    method, spent = getattr(owner, name), 0.0

    def around(*args: Any, **kwargs: Any) -> Any:
        nonlocal spent
        start = time.perf_counter()
        try:
            return method(*args, **kwargs)
        finally:
            spent += time.perf_counter() - start

    setattr(owner, name, around)
    try:
        run()
    finally:
        delattr(owner, name)
    return spent / STEPS


@compiled
def read_tables(count, body, pads, layout, sums, place):  # type: ignore[no-untyped-def]
    """What a time step with one pad near the ground reads, ``count`` times."""
    total = 0.0
    for k in range(count):
        psi = 1e-4 * k
        tables.read_body(body, psi, sums)
        row, t = tables.read_pad(pads, int(layout[0, 0]), psi, place)
        tables.read_pad_motion(pads, int(layout[0, 0]), row, t, place)
        total += sums[0, 0] + place[0, 0]
    return total


def seconds_reading(batch: Any) -> float:
    """Seconds that a time step spends reading the tables."""
    arguments = (*batch.model, np.zeros((3, 6)), np.zeros((3, 3)))
    read_tables(1, *arguments)
    start = time.perf_counter()
    read_tables(READS, *arguments)
    return (time.perf_counter() - start) / READS


def measure(rounds: int) -> dict[str, float]:
    """Microseconds a step, by part."""
    env = gym.make("JansenWalker-v0")
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(STEPS)]
    inner = env.unwrapped
    assert isinstance(inner, JansenWalkerEnv)
    plant: Any = inner.plant
    batch = plant._batch
    detector = batch.detector

    def run() -> float:
        return walk(env, actions)

    levels: dict[str, Callable[[], float]] = {
        "gym.make": run,
        "environment": lambda: timed(inner, "step", run),
        "plant": lambda: timed(plant, "step", run),
        "batch": lambda: timed(batch, "step", run),
        "look": lambda: timed(detector, "look", run),
        "pymunk": lambda: timed(detector, "_ask", run),
        "advance": lambda: timed(batch, "_advance", run),
        "task": lambda: timed(inner._task, "judge", run),
        "info": lambda: timed(inner, "_info", run),
        "tables": lambda: round(inner.control_dt / plant.time_step) * seconds_reading(batch),
    }
    run()
    spent: dict[str, list[float]] = {name: [] for name in levels}
    for number in range(rounds):
        for name in levels if number % 2 == 0 else reversed(levels):
            spent[name].append(levels[name]())
    env.close()
    return {name: 1e6 * median(values) for name, values in spent.items()}


def table(found: dict[str, float]) -> str:
    """The parts' own times as Markdown."""
    rows = {
        "Gymnasium's wrappers": found["gym.make"] - found["environment"],
        "environment: action, Python": found["environment"]
        - found["plant"] - found["task"] - found["info"],
        "environment: observation and reward (compiled)": found["task"],
        "environment: information": found["info"],
        "plant and batch: Python": found["plant"] - found["look"] - found["advance"],
        "ground: pads placed, planes found (compiled)": found["look"] - found["pymunk"],
        "ground: pymunk": found["pymunk"],
        "time steps: reading the tables": found["tables"],
        "time steps: dynamics and contacts": found["advance"] - found["tables"],
    }  # fmt: skip
    total = found["gym.make"]
    lines = ["| part of a step | us | share |", "| --- | ---: | ---: |"]
    lines += [f"| {name} | {own:.1f} | {own / total:.0%} |" for name, own in rows.items()]
    return "\n".join([*lines, f"| all | {total:.1f} | 100% |"])


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=7, help=f"at least {FEWEST_ROUNDS} (7)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the table there")
    chosen = parser.parse_args(arguments)
    if chosen.rounds < FEWEST_ROUNDS:
        parser.error(f"--rounds is {chosen.rounds}, must be at least {FEWEST_ROUNDS}")
    where = machine()
    text = f"{where['cpu']}, {where['cores']} cores; medians of {chosen.rounds} rounds.\n\n"
    text += table(measure(chosen.rounds)) + "\n"
    print(text, end="")
    if chosen.out is not None:
        write_text(chosen.out, text)


if __name__ == "__main__":
    main()
