"""How gently can a robot walk on level ground, and how close do its controllers come to that?

Run the experiment as follows. It takes about 25 minutes on one core.

    python experiments/lowest_load.py [--generations 60] [--quick]

For each robot and command, CMA-ES searches for the crank-speed profile with the lowest ground load
and the shortest unsupported time. For each robot, PPO trains a policy whose reward contains the
load, but neither slip nor energy nor effort. The policies are kept in ``logs/lowest_load`` and not
trained again. The script compares their scores with those of the packaged profile and of the
packaged policy, and writes ``docs/judging/lowest_load.json`` and a table of docs/judging.md. A walk
that is found proves that the machine can walk with this load; it does not prove that no controller
does better.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import cma
import gymnasium as gym
import numpy as np
from pages import options, publish, rounded, table
from trained_policies import ROLLOUT, train_recipe

from jansen_env import evaluate
from jansen_env.arrays import Array
from jansen_env.policies import pretrained
from jansen_env.policies.policy import Controlled, Policy, TorquePolicy, columns
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.walking.profile import READ, load_profile, profile_torque

DATA, PAGE = "judging/lowest_load.json", "judging.md"
ENV = "JansenWalkerBuilt-v0"
POLICIES = {"built": "ppo", "stroller": "stroller", "hiker": None}
"""Name of the policy of each robot. ``hiker`` has no policy for level ground."""
COMMANDS = (0.1, 0.2, 0.3, 0.5)  # m/s
HARMONICS = 6  # number of harmonics of a profile
UNITS = np.array([1.0, 1.0, 1.0, 1.0, *[0.3] * (2 * HARMONICS)])
"""Changes of the parameters of a profile that are of comparable size."""
SPREAD = 0.3  # initial standard deviation of the search, in these units
POPULATION, STARTS = 16, 4  # candidates per generation; episodes per candidate
HORIZON = 10.0  # time limit of an episode, in s
SLACK = 0.01  # error of the mean speed that costs nothing, in m/s
SPEED_COST = 200.0  # cost per m/s of error beyond SLACK
FALL_COST = 20.0
UNSUPPORTED_COST = 4.0  # a tenth of the time in the air costs as much as 0.4 weights of load
FIRST_SEED = 40_000  # no other part of the project uses these seeds
SCORED_SEED = 7
RUNS = Path("logs/lowest_load")
FOR_THE_LOAD = {
    "mean_load_cost": True,
    "load_weight": 3.0,
    "slip_weight": 0.0,
    "energy_weight": 0.0,
    "effort_weight": 0.0,
}
"""Arguments with which the gentlest policies are trained."""
METRICS = {"unsupported": 2, "load": 1, "steady_cost_of_transport": 2, "return": 0}
"""Metrics of the table, and the number of decimals."""


def gentleness_cost(run: dict[str, Array]) -> Array:
    """Return the cost of each episode: its load and unsupported time, slow walks and falls."""
    error = np.abs(run["distance"] / HORIZON - run["command"])
    unsupported = run["unsupported"] * 0.02 / run["duration"]
    too_slow = SPEED_COST * np.maximum(error - SLACK, 0.0)
    return np.asarray(
        run["load"] + UNSUPPORTED_COST * unsupported + too_slow + FALL_COST * run["fell"]
    )


def profile_policy(numbers: Array) -> Callable[[Controlled], TorquePolicy]:
    """Return a function that makes a policy of profiles, one row of parameters per robot."""

    def policy(env: Controlled) -> TorquePolicy:
        read = columns(env, *READ)

        def torque(seen: Array, *_: Any) -> tuple[Array, None]:
            rows = np.broadcast_to(numbers, (len(seen), numbers.shape[-1]))
            return profile_torque(rows, np.asarray(seen), read), None

        return TorquePolicy(torque, env.torque_limit)

    return policy


def costs(candidates: Sequence[Array], command: float, robot: str, env: Controlled) -> list[float]:
    """Return the mean cost of each candidate over starts at crank angles over half a turn."""
    numbers = np.repeat(np.array(candidates) * UNITS, STARTS, axis=0)
    n = len(numbers)
    angles = np.pi * (np.arange(n) % STARTS) / STARTS
    seeds = FIRST_SEED + np.arange(n) % STARTS
    commands = np.full(n, command)
    policy = profile_policy(numbers)(env)
    options = {"crank_angle": angles}
    run = run_episodes(policy, ENV, {"robot": robot}, commands, seeds, options=options)
    return [float(cost) for cost in gentleness_cost(run).reshape(-1, STARTS).mean(axis=1)]


def search(command: float, generations: int, robot: str, env: Controlled) -> Array:
    """Return the parameters of the gentlest profile that the search finds at a command."""
    start = np.zeros(len(UNITS))
    packaged = load_profile(robot=robot).at(np.array([command]))[0]
    half = (len(packaged) - 4) // 2  # the packaged profile has fewer harmonics
    start[:4] = packaged[:4]
    start[4 : 4 + half] = packaged[4 : 4 + half]
    start[4 + HARMONICS : 4 + HARMONICS + half] = packaged[4 + half :]
    settings = {"seed": 1, "popsize": POPULATION, "verbose": -9, "maxiter": generations}
    strategy = cma.CMAEvolutionStrategy(start / UNITS, SPREAD, settings)
    while not strategy.stop():
        candidates = strategy.ask()
        strategy.tell(candidates, costs(candidates, command, robot, env))
    finalists = [np.array(strategy.mean), np.array(strategy.result.xbest), start / UNITS]
    best = finalists[int(np.argmin(costs(finalists, command, robot, env)))]
    cost = costs([best], command, robot, env)[0]
    print(f"{robot}, {command:g} m/s: {cost:.2f}", file=sys.stderr, flush=True)
    return np.asarray(best * UNITS)


def measure(
    robot: str, commands: Sequence[float], generations: int, steps: int | None, episodes: int
) -> dict[str, dict[str, dict[str, Any]]]:
    """Search and train, and score the gentlest controllers and the packaged ones.

    Args:
        robot: Name of the robot.
        commands: Commanded speeds, in m/s.
        generations: Number of generations of a search.
        steps: Number of environment steps of a training. None for that of ``train.py``.
        episodes: Number of scored episodes per command.

    Returns:
        Parameters of the profile ("numbers") and scores of each controller, by command.
    """
    from jansen_env.cli.named_policies import load_named

    made = gym.make(ENV, robot=robot)
    env = cast("Controlled", made.unwrapped)
    file = train_recipe(
        RUNS / (robot if steps is None else f"{robot}_{steps}"),
        "python experiments/lowest_load.py",
        {"robot": robot, **FOR_THE_LOAD},
        steps=steps,
    )
    gentle = load_named(str(file), made)
    results: dict[str, dict[str, dict[str, Any]]] = {}
    for command in commands:
        numbers = search(command, generations, robot, env)
        controllers: dict[str, Policy] = {
            "gentlest profile": profile_policy(numbers)(env),
            "gentlest policy": gentle,
            "packaged profile": load_profile(robot=robot).policy(env),
        }
        if (name := POLICIES[robot]) is not None:
            controllers["packaged policy"] = pretrained.load(ENV, name)
        found = evaluate(
            controllers,
            ENV,
            {"robot": robot},
            commands=(command,),
            episodes=episodes,
            seed=SCORED_SEED,
        )
        results[str(command)] = {
            name: {
                **{metric: found[name]["overall"][metric] for metric in (*METRICS, "falls")},
                "speed": float(np.mean(found[name]["raw"]["distance"]) / HORIZON),
            }
            for name in controllers
        }
        results[str(command)]["gentlest profile"]["numbers"] = numbers.tolist()
    return results


def tables(results: dict[str, dict[str, dict[str, dict[str, Any]]]]) -> dict[str, list[str]]:
    """Return the table of the page.

    Args:
        results: Scores by robot, command and controller.
    """
    head = [
        "robot",
        "controller",
        "command (m/s)",
        "mean speed (m/s)",
        "unsupported (fraction of time)",
        "load (multiple of the weight)",
        "cost of transport",
        "return",
    ]
    rows = [
        [
            f"`{robot}`",
            name,
            command,
            f"{scores['speed']:.2f}",
            *(rounded(scores[metric][0], digits) for metric, digits in METRICS.items()),
        ]
        for robot, by_command in results.items()
        for command, by_controller in by_command.items()
        for name, scores in by_controller.items()
    ]
    return {PAGE: [table(head, rows, texts=2)]}


def main() -> None:
    """Search, and write the data and the table."""
    args = options(__doc__, generations=60, episodes=64)
    robots = [*POLICIES]
    commands: tuple[float, ...] = COMMANDS
    generations, steps, episodes = args.generations, None, args.episodes
    if args.quick:
        robots, commands, generations, steps, episodes = robots[:1], COMMANDS[:1], 1, ROLLOUT, 1
    results = {robot: measure(robot, commands, generations, steps, episodes) for robot in robots}
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
