"""Which obstacles can the paper's robot climb?

Run the experiment as follows. It takes about two minutes on one core.

    python experiments/climbing.py [--episodes 12] [--quick]

The robot walks under two controllers over obstacles of ten kinds and twelve sizes, at four speeds.
Both controllers start from the same initial states and walk over the same terrain. The script
writes ``docs/terrain/climbing.json`` and the tables of docs/terrain/climbing.md.
"""

import sys
from typing import Any, cast

import gymnasium as gym
import numpy as np
from pages import options, publish, table

from jansen_env import Terrain
from jansen_env.arrays import Array
from jansen_env.engine.ground_lines import START
from jansen_env.policies.policy import Controlled, Policy
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.walking.walker_benchmark import BASELINES
from jansen_env.terrain.generators import HIGHEST, LEVELS, MIXTURE, NamedGenerator
from jansen_env.terrain.ground import one_step

DATA, PAGE = "terrain/climbing.json", "terrain/climbing.md"
ENV = "JansenWalker-v0"
CONTROLLERS = ("pid", "profile")
SPEEDS: tuple[float, ...] = (0.2, 0.3, 0.45, 0.6)  # m/s
FRICTION = 0.8
FIRST_SEED = 90_000  # no other part of the project uses these seeds
ENOUGH = 0.5  # fraction of the walks that must succeed for a size to count as climbed
BEYOND = 2  # number of sizes beyond the highest level
ONE_STEP = (0.015, 0.18)  # heights of a single step, in m
OBSTACLES: tuple[str, ...] = (
    "one step",
    "stairs up",
    "stairs down",
    "steps",
    "stumps",
    "rough",
    "waves",
    "slope up",
    "slope down",
    "ramps",
)
"""Kinds of generated terrain, two of them in both directions, and a single step up."""


def parameter(obstacle: str) -> str:
    """Return the name of the parameter that is the size of an obstacle."""
    return "height" if obstacle == "one step" else next(iter(LEVELS[obstacle.split()[0]]))


def sizes(obstacle: str) -> Array:
    """Return the sizes at levels 0 to 9 and at two further levels, in m or rad."""
    if obstacle == "one step":
        return np.linspace(*ONE_STEP, HIGHEST + 1 + BEYOND)
    low, high = LEVELS[obstacle.split()[0]][parameter(obstacle)]
    top = low + (high - low) * (HIGHEST + BEYOND) / HIGHEST
    return np.linspace(low, top, HIGHEST + 1 + BEYOND)


def ground(obstacle: str, size: float, seed: int) -> Terrain:
    """Return an obstacle, whose position and other random values depend on a seed."""
    rng = np.random.default_rng([FIRST_SEED, seed])
    if obstacle == "one step":
        edge = START + rng.uniform(0.1, 0.5)
        return one_step(edge, size)
    signed = -size if obstacle.endswith("down") else size
    return NamedGenerator(obstacle.split()[0], ((parameter(obstacle), signed),))(rng, 0)


def climb(policy: Policy, obstacle: str, speeds: tuple[float, ...], episodes: int) -> Array:
    """Let the robot walk under a controller over all sizes of an obstacle at all speeds.

    Args:
        policy: The controller.
        obstacle: Name of the obstacle.
        speeds: Commanded speeds, in m/s.
        episodes: Number of walks for each size and speed.

    Returns:
        Whether each walk succeeded (1 or 0), shape (sizes, speeds, episodes).
    """
    won = []
    for size in sizes(obstacle):
        terrains = [ground(obstacle, float(size), k) for k in range(episodes)] * len(speeds)
        run = run_episodes(
            policy,
            ENV,
            {"friction": FRICTION, "terrain": terrains},
            np.repeat(speeds, episodes),
            FIRST_SEED + np.tile(np.arange(episodes), len(speeds)),
        )
        won.append(run["success"].reshape(len(speeds), episodes))
    return np.array(won)


def best_speed(won: Array) -> Array:
    """Return the fraction of successful walks for each size, at the speed with the highest mean."""
    fractions = won.mean(axis=2)
    return np.asarray(fractions[:, fractions.mean(axis=0).argmax()])


def any_speed(outcomes: list[Array]) -> Array:
    """Return the fraction of terrains on which any controller succeeds at any speed, by size."""
    return np.asarray(np.stack(outcomes).max(axis=(0, 2)).mean(axis=1))


def limit(obstacle: str, fractions: Array) -> str:
    """Return the size up to which :data:`ENOUGH` walks succeed, as text."""
    failed = np.flatnonzero(fractions < ENOUGH)
    count = failed[0] if len(failed) else len(fractions)
    if count == 0:
        return "-"
    return ("" if len(failed) else ">= ") + f"{sizes(obstacle)[count - 1]:.3g}"


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: limits by obstacle, and success on all kinds by level."""
    rows = []
    by_kind: dict[str, list[Array]] = {}
    for obstacle, by_controller in results["won"].items():
        outcomes = [np.array(won) for won in by_controller.values()]
        unit = "rad" if parameter(obstacle) == "angle" else "m"
        together = any_speed(outcomes)
        fractions = [*map(best_speed, outcomes), together]
        name = f"{obstacle}, {parameter(obstacle)} ({unit})"
        rows.append([name, *(limit(obstacle, values) for values in fractions)])
        if obstacle != "one step":
            by_kind.setdefault(obstacle.split()[0], []).append(together)
    made = [table(["obstacle", *CONTROLLERS, "any, at any speed"], rows)]
    if len(by_kind) == len(MIXTURE):
        mixed = np.mean([np.mean(kind, axis=0) for kind in by_kind.values()], axis=0)
        levels = [str(level) for level in range(HIGHEST + 1)]
        cells = [f"{value:.2f}" for value in mixed[: HIGHEST + 1]]
        made.append(table(["level", *levels], [["all kinds", *cells]]))
    return {PAGE: made}


def main() -> None:
    """Measure, and write the data and the tables."""
    args = options(__doc__, episodes=12)
    obstacles, speeds, episodes = OBSTACLES, SPEEDS, args.episodes
    if args.quick:
        obstacles, speeds, episodes = OBSTACLES[:1], SPEEDS[-1:], 2
    env = cast("Controlled", gym.make(ENV).unwrapped)
    won: dict[str, dict[str, Any]] = {}
    for obstacle in obstacles:
        won[obstacle] = {
            name: climb(BASELINES[name](env), obstacle, speeds, episodes).astype(int).tolist()
            for name in CONTROLLERS
        }
        print(obstacle, file=sys.stderr, flush=True)
    results = {"speeds": speeds, "episodes": episodes, "won": won}
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
