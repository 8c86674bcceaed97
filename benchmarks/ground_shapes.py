"""Compare the time of a control step on pymunk shapes and on the same ground as a height line.

Single environments walk in turns. The table lists the shortest round of each environment, in
process time.
"""

from __future__ import annotations

import argparse
import time

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401  registers the environments
from jansen_env.terrain import Shapes, Terrain
from jansen_env.terrain.generators import make_generator

STEPS = 200
RESETS = 20


def make_grounds() -> dict[str, Terrain]:
    """Return height lines by name: level ground, and ground that is rough at the starting point."""
    terrain = make_generator("rough")
    assert terrain is not None
    points = terrain(np.random.default_rng(5), 3).points
    return {
        "level": Terrain.flat(),
        "rough, level 3": Terrain(tuple((x - 1.7, y) for x, y in points)),
    }


def play(env: gym.Env[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Measure the time of a reset and the time of a control step.

    Args:
        env: Environment to measure.

    Returns:
        Both times, in us.
    """
    action = np.array([0.5], np.float32)
    begin = time.process_time()
    for seed in range(RESETS):
        env.reset(seed=seed)
    middle = time.process_time()
    for _ in range(STEPS):
        env.step(action)
    end = time.process_time()
    return 1e6 * (middle - begin) / RESETS, 1e6 * (end - middle) / STEPS


def main() -> None:
    """Measure the times and print them as a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ground_shapes", description=__doc__)
    parser.add_argument("--rounds", type=int, default=30, help="turns of each; default: 30")
    rounds = parser.parse_args().rounds
    print("| ground | path | reset, us | control step, us |\n| --- | --- | ---: | ---: |")
    for name, line in make_grounds().items():
        paths = {"height line": line, "shapes": Shapes.under(line)}
        envs = {
            path: gym.make("JansenWalker-v0", terrain=ground, terminate_when_fallen=False)
            for path, ground in paths.items()
        }
        times = {path: [play(env) for _ in range(rounds)] for path, env in envs.items()}
        for path, rows in times.items():
            reset, step = np.min(rows, axis=0)
            print(f"| {name} | {path} | {reset:.0f} | {step:.0f} |")


if __name__ == "__main__":
    main()
