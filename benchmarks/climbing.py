"""Limits of climbing: success by obstacle, its size, speed and controller.

    python -m benchmarks.climbing [--episodes 24] [--env ID] [--policy RUN] [--quick]

All controllers and speeds meet the same grounds: where one of them succeeds, the machine can.
Writes ``climbing.md``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks import measure
from jansen_env import Terrain
from jansen_env.baselines.policy import Array, Bools, Policy
from jansen_env.commands.named_policies import label, load_named
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.walker_benchmark import ENOUGH, succeeded
from jansen_env.terrain.generators import HIGHEST, LEVELS, NamedGenerator
from jansen_env.terrain.ground import START, treads

SPEEDS = (0.2, 0.3, 0.45, 0.6)  # m/s
FRICTION = 0.8
EPISODES = 24  # of each case
AT_ONCE = 256  # robots
FIRST_SEED = 90_000  # apart from all others
WALKER = "JansenWalker-v0"
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


def ground(obstacle: str, size: float, seed: int) -> Terrain:
    """Return an obstacle of a size; place and draws differ by seed."""
    rng = np.random.default_rng([FIRST_SEED, seed])
    if obstacle != "one step":
        given = ((parameter(obstacle), size),)
        return NamedGenerator(obstacle.split()[0], given)(rng, 0)
    edge = START + rng.uniform(0.1, 0.5)
    step = treads(np.array([edge]), np.array([size]))
    return Terrain(np.concatenate([[[-1.0, 0.0]], step, [[step[-1, 0] + 1.0, size]]]).tolist())


def climb(
    policies: dict[str, Policy], obstacle: str, speeds: Sequence[float], episodes: int, env_id: str
) -> dict[str, Bools]:
    """Successes (sizes, speeds, episodes) by policy; episode k has one ground at all speeds."""
    grown, env = sizes(obstacle), make_env(env_id, {})
    shape = len(grown), len(speeds), episodes
    cases = [*np.ndindex(shape)]
    won: dict[str, list[Bools]] = {name: [] for name in policies}
    for begin in range(0, len(cases), AT_ONCE):
        some = cases[begin : begin + AT_ONCE]
        terrains = [ground(obstacle, float(grown[i]), k) for i, _, k in some]
        kwargs = {"friction": FRICTION, "terrain": terrains, "randomize": {}}
        commands = np.array([speeds[j] for _, j, _ in some])
        seeds = FIRST_SEED + np.array([k for *_, k in some])
        for name, policy in policies.items():
            run = run_episodes(policy, env_id, kwargs, commands, seeds)
            won[name].append(succeeded(run, env).astype(bool))
    env.close()
    return {name: np.concatenate(parts).reshape(shape) for name, parts in won.items()}


def by_any_policy(outcomes: dict[str, Bools]) -> Array:
    """(sizes,) share of the grounds on which some policy succeeded at some speed."""
    return np.asarray(np.stack([*outcomes.values()]).any(axis=(0, 2)).mean(axis=1))


def last(grown: Array, share: Array) -> str:
    """Return the size up to which a share (sizes,) is a half or more, as text."""
    below = np.flatnonzero(share < HALF)
    count = below[0] if len(below) else len(share)
    return "-" if count == 0 else f"{'' if len(below) else '>= '}{abs(grown[count - 1]):.3g}"


def best(values: Bools) -> Array:
    """Shares (sizes,) at the speed that has the largest in the mean."""
    shares = values.mean(axis=2)
    return np.asarray(shares[:, np.argmax(shares.mean(axis=0))])


def limit_table(results: dict[str, dict[str, Bools]]) -> str:
    """Return the sizes up to which policies succeed at their best speed, as Markdown."""
    rows = []
    for obstacle, outcomes in results.items():
        grown, unit = sizes(obstacle), UNITS.get(parameter(obstacle), "m")
        limits = [last(grown, best(won)) for won in outcomes.values()]
        name = f"{obstacle}, {parameter(obstacle)} ({unit})"
        rows.append((name, *limits, last(grown, by_any_policy(outcomes))))
    return measure.table(("obstacle", *next(iter(results.values())), "any, at any speed"), rows)


def walkable_table(results: dict[str, dict[str, Bools]]) -> str:
    """Return success by level, of any policy at any speed, as Markdown."""
    shares = {name: by_any_policy(won) for name, won in results.items() if name != "one step"}
    kinds = [[share for name, share in shares.items() if name.split()[0] == kind]
             for kind in LEVELS]  # fmt: skip
    if all(kinds):
        shares["mixed"] = np.mean([np.mean(alike, axis=0) for alike in kinds], axis=0)
    levels = (*range(HIGHEST + 1), *(f"({HIGHEST + 1 + i})" for i in range(BEYOND)))
    rows = [(name, *(f"{value:.2f}" for value in share)) for name, share in shares.items()]
    return measure.table(("level", *map(str, levels)), rows)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/terrain", episodes=EPISODES)
    parser.add_argument("--policy", action="append", default=[], metavar="NAME",
                        help="also a run's folder or model")  # fmt: skip
    parser.add_argument("--env", choices=ENVS, default=WALKER, help=f"({WALKER})")
    args = measure.parse(parser, arguments)
    env = make_env(args.env, {})
    with parser.refusing():
        policies = {label(n): load_named(n, env) for n in ("pid", "profile", *args.policy)}
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


if __name__ == "__main__":
    main()
