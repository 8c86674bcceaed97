"""Steps per second of ``JansenWalker-v0`` beside Gymnasium's ``Walker2d-v5``.

    python -m benchmarks.env_speed [--rounds 7] [--steps 5000] [--json FILE] [--min-ratio X]

Both are made by ``gym.make`` with its defaults, wrappers included, and get random actions drawn
beforehand. Resets of episodes that end are part of the time. After one warm-up the environments
take turns, in the other order every round, so that a change of load meets both.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium as gym

import jansen_env

OURS, THEIRS = "JansenWalker-v0", "Walker2d-v5"
FEWEST_ROUNDS = 5
DURATION_NAMES = ("control_dt", "dt")  # what environments call the simulated time of one step
PACKAGES = ("gymnasium", "mujoco", "numba", "numpy", "pymunk")


class Runner:
    """One environment with its actions, stepped the same way in every round."""

    def __init__(self, env_id: str, steps: int, seed: int) -> None:
        self.env_id, self.seed = env_id, seed
        self.env: gym.Env[Any, Any] = gym.make(env_id)
        self.env.action_space.seed(seed)
        self.actions = [self.env.action_space.sample() for _ in range(steps)]
        self.resets = 0
        self.rates: list[float] = []  # steps/s of each round
        self.play()  # warm-up: compiles, loads, fills caches
        self.rates.clear()

    def play(self) -> None:
        """Time all actions, resetting whenever an episode ends."""
        env, resets = self.env, 0
        env.reset(seed=self.seed)
        start = time.perf_counter()
        for action in self.actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
                resets += 1
        self.rates.append(len(self.actions) / (time.perf_counter() - start))
        self.resets = resets

    def summary(self) -> dict[str, Any]:
        """What its rounds come to."""
        name = next(name for name in DURATION_NAMES if self.env.has_wrapper_attr(name))
        duration = float(self.env.get_wrapper_attr(name))
        middle = median(self.rates)
        return {
            "id": self.env_id,
            "steps_per_second": middle,
            "rounds": self.rates,
            "resets_per_round": self.resets,
            "step_duration": duration,
            "simulated_seconds_per_second": middle * duration,
        }


def measure(rounds: int, steps: int, seed: int = 0) -> dict[str, Any]:
    """Speeds of both environments, their ratio, and where it was measured; ready for JSON."""
    runners = [Runner(env_id, steps, seed) for env_id in (OURS, THEIRS)]
    for number in range(rounds):
        for runner in runners if number % 2 == 0 else reversed(runners):
            runner.play()
    ours, theirs = (runner.summary() for runner in runners)
    for runner in runners:
        runner.env.close()
    ratios = [a / b for a, b in zip(ours["rounds"], theirs["rounds"], strict=True)]
    simulated = "simulated_seconds_per_second"
    return {
        "environments": [ours, theirs],
        "steps_per_round": steps,
        "seed": seed,
        "ratio": ours["steps_per_second"] / theirs["steps_per_second"],
        "ratio_range": [min(ratios), max(ratios)],
        "simulated_ratio": ours[simulated] / theirs[simulated],
        "cpu": cpu_name(),
        "cpu_count": os.cpu_count(),
        "load_average": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "versions": {
            "jansen_env": jansen_env.__version__,
            "python": platform.python_version(),
            **{package: version(package) for package in PACKAGES},
        },
    }


def cpu_name() -> str:
    """The processor as the system names it."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def table(result: dict[str, Any]) -> str:
    """A result of :func:`measure` for reading."""
    versions = ", ".join(f"{name} {number}" for name, number in result["versions"].items())
    lines = [
        f"{result['cpu']}, {result['cpu_count']} CPUs, load average {result['load_average']}",
        f"{versions}\n",
        "environment        steps/s    lowest   highest  resets  ms/step  simulated s/s",
    ]
    for env in result["environments"]:
        lines.append(
            f"{env['id']:<16}{env['steps_per_second']:>10,.0f}{min(env['rounds']):>10,.0f}"
            f"{max(env['rounds']):>10,.0f}{env['resets_per_round']:>8}"
            f"{1e3 * env['step_duration']:>9g}{env['simulated_seconds_per_second']:>15,.1f}"
        )
    (low, high), rounds = result["ratio_range"], len(result["environments"][0]["rounds"])
    return "\n".join(lines) + (
        f"\n\nmedian of {rounds} rounds of {result['steps_per_round']} steps; ratio of the medians "
        f"{result['ratio']:.2f}, by round {low:.2f} to {high:.2f}; "
        f"in simulated time {result['simulated_ratio']:.2f}"
    )


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, and compare with ``--min-ratio``; the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=7, help=f"at least {FEWEST_ROUNDS} (7)")
    parser.add_argument("--steps", type=int, default=5000, help="of each round (5000)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result there")
    parser.add_argument("--min-ratio", type=float, metavar="X", help="exit 1 when slower than X")
    chosen = parser.parse_args(arguments)
    if chosen.rounds < FEWEST_ROUNDS or chosen.steps < 1:
        parser.error(f"--rounds must be at least {FEWEST_ROUNDS}, --steps at least 1")
    if chosen.json is not None and not chosen.json.parent.is_dir():
        parser.error(f"--json is {chosen.json}, but there is no folder {chosen.json.parent}")
    if importlib.util.find_spec("mujoco") is None:
        parser.exit(2, f'{THEIRS} needs MuJoCo: python -m pip install -e ".[bench]"\n')
    result = measure(chosen.rounds, chosen.steps)
    print(table(result))
    if chosen.json is not None:  # whole or not at all
        part = chosen.json.with_name(chosen.json.name + ".part")
        part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
        part.replace(chosen.json)
    if chosen.min_ratio is not None and result["ratio"] < chosen.min_ratio:
        print(f"the ratio {result['ratio']:.2f} is below {chosen.min_ratio:g}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
