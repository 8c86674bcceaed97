"""Measure the baselines: ``python -m agents.tune`` writes ``agents/data/baselines.json``.

1. The walking speed at constant crank speeds under the paper's gains, and at constant torques.
2. A seeded random search for better PID gains, scored by the mean return over the commands.
3. The walking speed at constant crank speeds under the gains found.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.files import write_json
from agents.pid import DATA, ConstantTorque, Gains, PIDController, SpeedMap
from agents.rollout import run_episodes

Array = NDArray[np.float64]

ENV = "JansenWalker-v0"
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
COMMANDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
SEARCH = {"kp": (3.0, 300.0), "ki": (0.1, 300.0), "kd": (0.3, 30.0), "ramp": (0.1, 4.0)}
MEASURE_SEED, SEARCH_SEED = 10_000, 20_000  # apart from those of evaluation and training
HORIZON = 10.0  # s, the time limit of an episode


class _Fixed:
    """A map that answers every command with the one setting being measured."""

    def __init__(self, setting: Array) -> None:
        self.setting = setting

    def setting_for(self, command: Array) -> Array:
        return self.setting[: len(command)]


def measure(kind: str, settings: Array, gains: Gains, episodes: int) -> SpeedMap:
    """Walking speed (m/s) of each constant crank speed (``kind`` "pid") or torque ("constant")."""
    speeds = []
    for setting in settings:
        fixed: Any = _Fixed(np.full(episodes, setting))
        policy = PIDController(gains, fixed) if kind == "pid" else ConstantTorque(fixed)
        run = run_episodes(
            policy, ENV, {}, np.full(episodes, 0.3), MEASURE_SEED + np.arange(episodes)
        )
        speeds.append(run.distance / HORIZON)
    return SpeedMap(np.asarray(settings), np.array(speeds))


def search(speed_map: SpeedMap, trials: int, episodes: int) -> tuple[Gains, list[dict[str, Any]]]:
    """Random search over :data:`SEARCH`, log-uniform; the paper's gains are the first trial."""
    rng = np.random.default_rng(SEARCH_SEED)
    commands = np.repeat(COMMANDS, episodes)
    seeds = SEARCH_SEED + np.arange(len(commands))
    record: list[dict[str, Any]] = []
    for trial in range(trials):
        draw = {
            name: float(np.exp(rng.uniform(np.log(low), np.log(high))))
            for name, (low, high) in SEARCH.items()
        }
        gains = Gains(**draw) if trial else Gains()
        run = run_episodes(PIDController(gains, speed_map), ENV, {}, commands, seeds)
        record.append(
            {"gains": asdict(gains), "return": run.returns.mean(), "falls": run.fell.mean()}
        )
        print(f"trial {trial:3d}: return {run.returns.mean():7.1f}  falls {run.fell.mean():.2f}"
              f"  {gains}", flush=True)  # fmt: skip
    best = max(record, key=lambda row: row["return"])
    return Gains(**best["gains"]), record


def main() -> None:
    """Measure, search, measure again, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100, help="PID gains tried")
    parser.add_argument("--episodes", type=int, default=6, help="episodes per setting or command")
    parser.add_argument("--out", default=str(DATA), help="file to write")
    args = parser.parse_args()
    paper = Gains()
    print("walking speed at constant crank speed (paper's gains) and at constant torque ...")
    paper_map = measure("pid", CRANK_SPEEDS, paper, args.episodes)
    torque_map = measure("constant", TORQUES, paper, args.episodes)
    best, record = search(paper_map, args.trials, args.episodes)
    print(f"best: {best}; its walking speeds ...")
    best_map = measure("pid", CRANK_SPEEDS, best, args.episodes)

    def entry(measured: SpeedMap) -> dict[str, Any]:
        return {
            "settings": measured.settings.tolist(),
            "speeds": measured.speeds.round(4).tolist(),
        }

    command = f"python -m agents.tune --trials {args.trials} --episodes {args.episodes}"
    write_json(
        args.out,
        {
            "command": command,
            "pid": {"gains": asdict(best), **entry(best_map)},
            "pid-paper": {"gains": asdict(paper), **entry(paper_map)},
            "constant": entry(torque_map),
            "search": record,
        },
    )
    print(f"written: {args.out}")


if __name__ == "__main__":
    main()
