"""Measure the baselines: ``python -m agents.tune`` writes ``agents/data/baselines.json``.

1. The walking speed at constant crank speeds under the paper's gains, and at constant torques.
2. A seeded random search for better PID gains, scored by the mean return over the commands.
3. For the best few of them and the paper's: the walking speed at constant crank speeds under those
   very gains, and the return with that map on fresh episodes. The best of these is "tuned".
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.pid import Gains
from agents.rollout import run_episodes
from agents.tasks import WALKER, Episodes
from agents.walker_baselines import DATA, SpeedMap, walking_pid, walking_torque
from jansen_env.files import write_json

Array = NDArray[np.float64]

ENV = "JansenWalker-v0"
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
FINALISTS = 6  # gains of the search that are measured again
SEARCH = {"kp": (3.0, 300.0), "ki": (0.1, 300.0), "kd": (0.3, 30.0), "ramp": (0.1, 4.0)}
MEASURE_SEED, SEARCH_SEED, FINAL_SEED = (
    10_000,
    20_000,
    25_000,
)  # apart from all others
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
        fixed = _Fixed(np.full(episodes, setting))
        policy = walking_pid(gains, fixed) if kind == "pid" else walking_torque(fixed)
        run = run_episodes(
            policy, ENV, {}, np.full(episodes, 0.3), MEASURE_SEED + np.arange(episodes)
        )
        speeds.append(run["distance"] / HORIZON)
    return SpeedMap(np.asarray(settings), np.array(speeds))


def search(speed_map: SpeedMap, trials: int, episodes: int) -> list[dict[str, Any]]:
    """Random search over :data:`SEARCH`, log-uniform; the paper's gains are the first trial."""
    rng = np.random.default_rng(SEARCH_SEED)
    record: list[dict[str, Any]] = []
    for trial in range(trials):
        draw = {
            name: float(np.exp(rng.uniform(np.log(low), np.log(high))))
            for name, (low, high) in SEARCH.items()
        }
        gains = Gains(**draw) if trial else Gains()
        run = score(gains, speed_map, episodes, SEARCH_SEED)
        record.append(
            {"gains": asdict(gains), "return": run["returns"].mean(), "falls": run["fell"].mean()}
        )
        print(f"trial {trial:3d}: return {run['returns'].mean():7.1f}  "
              f"falls {run['fell'].mean():.2f}  {gains}", flush=True)  # fmt: skip
    return record


def score(gains: Gains, speed_map: SpeedMap, episodes: int, seed: int) -> Episodes:
    """Episodes over the grid of commands."""
    commands = np.repeat(WALKER.commands, episodes)
    seeds = seed + np.arange(len(commands))
    return run_episodes(walking_pid(gains, speed_map), ENV, {}, commands, seeds)


def choose(
    record: list[dict[str, Any]], paper_map: SpeedMap, episodes: int
) -> tuple[Gains, SpeedMap, list[dict[str, Any]]]:
    """The best gains with their own map on fresh episodes, that map, and how the finalists did."""
    ranked = sorted(record, key=lambda row: -row["return"])[:FINALISTS]
    candidates = [Gains(), *(Gains(**row["gains"]) for row in ranked)]
    best: tuple[float, Gains, SpeedMap] | None = None
    finals = []
    for gains in candidates:
        own = paper_map if gains == Gains() else measure("pid", CRANK_SPEEDS, gains, episodes)
        value = float(score(gains, own, 2 * episodes, FINAL_SEED)["returns"].mean())
        finals.append({"gains": asdict(gains), "return": value})
        print(f"finalist: return {value:7.1f}  {gains}", flush=True)
        if best is None or value > best[0]:
            best = (value, gains, own)
    assert best is not None
    return best[1], best[2], finals


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
    record = search(paper_map, args.trials, args.episodes)
    best, best_map, finals = choose(record, paper_map, args.episodes)

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
            "finals": finals,
        },
    )
    print(f"written: {args.out}")


if __name__ == "__main__":
    main()
