"""Limits of climbing: success by obstacle, its size, speed and controller.

    python -m benchmarks.climbing [--episodes 24] [--env ID] [--policy RUN] [--quick]

All controllers and speeds meet the same grounds: where one of them succeeds, the machine can.
Writes ``climbing.md``, and for the paper's robot ``levels.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from benchmarks import measure
from benchmarks.measure import WALKER
from jansen_env import Terrain
from jansen_env.baselines.policy import Array, Bools, Policy
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.walker_benchmark import ENOUGH, succeeded
from jansen_env.terrain import shapes
from jansen_env.terrain.generators import HIGHEST, LEVELS, NamedGenerator, at_level

SPEEDS = (0.2, 0.3, 0.45, 0.6)  # m/s
FRICTION = 0.8
EPISODES = 24  # of each case
AT_ONCE = 256  # robots
FIRST_SEED = 90_000  # apart from all others
ENVS = (WALKER, "JansenWalkerBuilt-v0", "JansenWalkerRough-v0")  # the last with a look ahead
HALF = 0.5  # of the walks: up to which size the machine is said to climb
BEYOND = 2  # sizes beyond the highest level
UNITS = {"angle": "rad"}  # the others are in m

OBSTACLES = (
    "one step", "stairs up", "stairs down", "steps", "stumps", "rough", "waves", "slope up",
    "slope down", "ramps",
)  # fmt: skip
"""Generators by name, and a single step up."""


def parameter(obstacle: str) -> str:
    """Name of the parameter that grows."""
    return "height" if obstacle == "one step" else next(iter(LEVELS[obstacle.split()[0]]))


def sizes(obstacle: str) -> Array:
    """Sizes (m or rad) of levels 0 to 9 and beyond them, evenly; below 0: down."""
    if obstacle == "one step":
        return np.linspace(0.015, 0.18, HIGHEST + BEYOND + 1)
    low, high = LEVELS[obstacle.split()[0]][parameter(obstacle)]
    grown: Array = np.linspace(low, high, HIGHEST + 1)
    grown = np.append(grown, high + (high - low) * np.arange(1, BEYOND + 1) / HIGHEST)
    return -grown if obstacle.endswith("down") else grown


def ground(obstacle: str, size: float, seed: int, start: float = shapes.START) -> Terrain:
    """Return an obstacle of a size; place and draws differ by seed; start: m, of a single step."""
    rng = np.random.default_rng([FIRST_SEED, seed])
    if obstacle != "one step":
        given = ((parameter(obstacle), size),)
        return NamedGenerator(obstacle.split()[0], given)(rng, 0)
    edge = start + rng.uniform(0.1, 0.5)
    step = shapes.treads(np.array([edge]), np.array([size]))
    return Terrain.of(np.concatenate([[[-1.0, 0.0]], step, [[step[-1, 0] + 1.0, size]]]))


class Walked(NamedTuple):
    """Outcomes of walks, arrays of one shape: stayed up, succeeded."""

    up: Bools
    succeeded: Bools


Found: TypeAlias = dict[str, Walked]
"""Outcomes (sizes, speeds, episodes) by policy."""


def walk(
    policy: Policy,
    cases: Sequence[tuple[Terrain, float, int]],
    env_id: str = WALKER,
    **more: object,
) -> Walked:
    """One walk of each case (terrain, speed command, seed), (n,); ``more``: arguments."""
    parts = []
    for begin in range(0, len(cases), AT_ONCE):
        terrains, speeds, seeds = zip(*cases[begin : begin + AT_ONCE], strict=True)
        kwargs: dict[str, object] = {
            "friction": FRICTION,
            "terrain": list(terrains),
            "randomize": {},
            **more,
        }
        run = run_episodes(policy, env_id, kwargs, np.array(speeds), np.array(seeds))
        won = succeeded(run, make_env(env_id, {})).astype(bool)
        parts.append(Walked(~run["fell"].astype(bool), won))
    return Walked(*map(np.concatenate, zip(*parts, strict=True)))


def climb(
    policies: dict[str, Policy], obstacle: str, speeds: Sequence[float], episodes: int,
    env_id: str = WALKER,
) -> Found:  # fmt: skip
    """Walks over all sizes of an obstacle; episode k has the same ground at all speeds."""
    grown = sizes(obstacle)
    cases = [
        (ground(obstacle, size, k), speed, FIRST_SEED + k)
        for size in grown.tolist()
        for speed in speeds
        for k in range(episodes)
    ]
    shape = len(grown), len(speeds), episodes
    return {
        name: Walked(*(values.reshape(shape) for values in walk(policy, cases, env_id)))
        for name, policy in policies.items()
    }


def by_any_policy(outcomes: Found) -> Array:
    """(sizes,) share of the grounds on which some policy succeeded at some speed."""
    every = np.stack([walked.succeeded for walked in outcomes.values()])
    return np.asarray(every.any(axis=(0, 2)).mean(axis=1))


def last(grown: Array, share: Array) -> str:
    """Return the size up to which a share (sizes,) is a half or more, as text."""
    below = np.flatnonzero(share < HALF)
    count = below[0] if len(below) else len(share)
    return "-" if count == 0 else f"{'' if len(below) else '>= '}{abs(grown[count - 1]):.3g}"


def best(values: Bools) -> Array:
    """Shares (sizes,) at the speed that has the largest in the mean."""
    shares = values.mean(axis=2)
    return np.asarray(shares[:, np.argmax(shares.mean(axis=0))])


def limit_table(results: dict[str, Found]) -> str:
    """Return the sizes up to which policies succeed at their best speed, as Markdown."""
    rows = []
    for obstacle, outcomes in results.items():
        grown, unit = sizes(obstacle), UNITS.get(parameter(obstacle), "m")
        limits = [last(grown, best(walked.succeeded)) for walked in outcomes.values()]
        label = f"{obstacle}, {parameter(obstacle)} ({unit})"
        rows.append((label, *limits, last(grown, by_any_policy(outcomes))))
    return measure.table(("obstacle", *next(iter(results.values())), "any, at any speed"), rows)


def walkable_table(results: dict[str, Found]) -> str:
    """Return success by level, of any policy at any speed, as Markdown."""
    by_kind: dict[str, list[Array]] = {name: [] for name in LEVELS}
    rows = []
    for obstacle, outcomes in results.items():
        if obstacle == "one step":
            continue
        share = by_any_policy(outcomes)
        by_kind[obstacle.split()[0]].append(share)
        rows.append((obstacle, *(f"{value:.2f}" for value in share)))
    if all(by_kind.values()):
        mixed = np.mean([np.mean(shares, axis=0) for shares in by_kind.values()], axis=0)
        rows.append(("mixed", *(f"{value:.2f}" for value in mixed)))
    levels = (*range(HIGHEST + 1), *(f"({HIGHEST + 1 + i})" for i in range(BEYOND)))
    return measure.table(("level", *map(str, levels)), rows)


def level_table() -> str:
    """Return sizes of the levels as Markdown."""
    rows = []
    for name, parameters in LEVELS.items():
        for key, (low, high) in parameters.items():
            label = f'`"{name}"`, `{key}` ({UNITS.get(key, "m")})'
            if low == high:
                rows.append((label, f"{low:g}", *[""] * HIGHEST))
            else:
                each = (f"{at_level(name, level)[key]:.3g}" for level in range(HIGHEST + 1))
                rows.append((label, *each))
    return measure.table(("level", *map(str, range(HIGHEST + 1))), rows)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/terrain", episodes=EPISODES)
    args, policies = measure.parse_with_policies(parser, arguments, ENVS)
    count, speeds = (2, SPEEDS[-1:]) if args.quick else (args.episodes, SPEEDS)
    results = {
        obstacle: climb(policies, obstacle, speeds, count, args.env)
        for obstacle in (OBSTACLES[:1] if args.quick else OBSTACLES)
    }
    more = "".join(f" --policy {name}" for name in args.policy)
    command = f"python -m benchmarks.climbing --env {args.env} --episodes {count}{more}"
    shown = ", ".join(f"{speed:g}" for speed in speeds)
    measure.report(
        args.out / "climbing.md",
        "# Limits of climbing",
        f"`{command}`: {count} walks of 10 s of each policy over each size at {shown} m/s, "
        f"friction {FRICTION:g}; a success does not fall and gets {ENOUGH:g} of the commanded "
        "distance. All meet the same grounds. The sizes are those of the levels 0 to 9 and two "
        "beyond.",
        "The largest size at which at least half of the walks succeed, each policy at its best "
        "speed; last, at which on half of the grounds some policy succeeds at some speed.",
        limit_table(results),
        "By level: the share of the grounds on which some policy succeeds at some speed. Mixed: "
        "the mean of the seven kinds.",
        walkable_table(results),
    )
    if args.env != WALKER:
        return
    measure.report(args.out / "levels.md", "# Levels", "`python -m benchmarks.climbing`: values "
                   "of `jansen_env.terrain.generators.LEVELS`.", level_table())  # fmt: skip


if __name__ == "__main__":
    main()
