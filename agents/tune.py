"""Measure how fast the baselines walk: ``python -m agents.tune``, for ``agents/data``.

The walking speed at constant crank speeds (the PID with the paper's gains) and at constant torques.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from agents.command_line import positive_int
from agents.policy import Array
from agents.rollout import make_env, run_episodes
from agents.walker_baselines import DATA, POLICIES
from jansen_env.files import write_json

ENV = "JansenWalker-v0"
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
FIRST_SEED = 10_000  # apart from all others
HORIZON = 10.0  # s, the time limit of an episode


def measure(name: str, settings: Array, episodes: int) -> dict[str, Any]:
    """Walking speeds (m/s) of each crank speed ("pid") or torque ("constant"), as in the file."""
    env = make_env(ENV, {}).unwrapped
    each = np.repeat(settings, episodes)
    policy = POLICIES[name](lambda _: each, env)
    commands, seeds = np.full(len(each), 0.3), FIRST_SEED + np.arange(len(each)) % episodes
    run = run_episodes(policy, ENV, {}, commands, seeds, at_once=len(each))
    speeds = (run["distance"] / HORIZON).reshape(-1, episodes)
    return {"settings": settings.tolist(), "speeds": speeds.round(4).tolist()}


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=positive_int, default=6, help="episodes per setting")
    parser.add_argument("--out", default=str(DATA), help="file to write")
    args = parser.parse_args(arguments)
    measured = {
        "command": f"python -m agents.tune --episodes {args.episodes}",
        "pid": measure("pid", CRANK_SPEEDS, args.episodes),
        "constant": measure("constant", TORQUES, args.episodes),
    }
    print(f"written: {write_json(args.out, measured)}")


if __name__ == "__main__":
    main()
