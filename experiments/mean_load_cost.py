"""Do policies land more gently if the reward averages the cost of the load?

Run the experiment as follows. It takes about 45 minutes on one core.

    python experiments/mean_load_cost.py [--seeds 3] [--quick]

By default, the reward of a control step contains the cost of the load in this step. With the
argument ``mean_load_cost``, it contains a mean of this cost over a quarter turn of the crank. The
recipe of ``train.py`` for JansenWalkerBuilt-v0 trains policies of several robots with both rewards,
each with several seeds. The runs are kept in ``logs/mean_load_cost`` and not trained again. Each
last model walks at several commands. The script writes ``docs/judging/mean_load_cost.json`` and a
table of docs/judging.md.
"""

from pathlib import Path
from typing import Any

from pages import mean_and_range, options, publish, table
from trained_policies import ROLLOUT, score_by_command, train_recipe

from jansen_env import ROBOTS

DATA, PAGE = "judging/mean_load_cost.json", "judging.md"
RUNS = Path("logs/mean_load_cost")
ROBOT_NAMES: tuple[str, ...] = ("built", "stroller", "hiker")
REWARDS: dict[str, dict[str, Any]] = {"control step": {}, "quarter turn": {"mean_load_cost": True}}
"""Arguments of the environments, by the duration over which the cost of the load is averaged."""
COMMANDS = (0.1, 0.3, 0.5, 0.8)  # m/s
EPISODES = 32  # per command
SEED = 7  # seed of the scored episodes
METRICS = {
    "load": 1,
    "unsupported": 2,
    "steady_slip_per_metre": 3,
    "steady_cost_of_transport": 2,
    "steady_speed_error": 3,
    "return": 0,
}
"""Metrics of the table, and the number of decimals."""


def train_and_score(
    robot: str, reward: str, seed: int, steps: int | None, episodes: int
) -> dict[str, dict[str, float | None]]:
    """Train a model, and return its metrics by command.

    Args:
        robot: Name of the robot.
        reward: Reward of the training, a key of :data:`REWARDS`.
        seed: Seed of the training.
        steps: Number of environment steps of the training. None for that of ``train.py``.
        episodes: Number of episodes per command.
    """
    name = f"{robot}_{reward.replace(' ', '_')}_{seed}"
    file = train_recipe(
        RUNS / (name if steps is None else f"{name}_{steps}"),
        "python experiments/mean_load_cost.py",
        {"robot": robot, **REWARDS[reward]},
        seed,
        steps,
    )
    return score_by_command(str(file), ROBOTS[robot](), COMMANDS, METRICS, episodes, SEED)


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page: means over the seeds, and their ranges.

    Args:
        results: Content of the data file.
    """
    head = [
        "robot",
        "cost of the load averaged over",
        "command (m/s)",
        "load (multiple of the weight)",
        "unsupported (fraction of time)",
        "slip per metre (m/m)",
        "cost of transport",
        "speed error (m/s)",
        "return (default reward)",
    ]
    rows = []
    for robot, rewards in results["runs"].items():
        for command in rewards["control step"][0]:
            for reward, runs in rewards.items():
                cells = [
                    mean_and_range([run[command][metric] for run in runs], decimals)
                    for metric, decimals in METRICS.items()
                ]
                rows.append([f"`{robot}`", f"a {reward}", command, *cells])
    return {PAGE: [table(head, rows, texts=2)]}


def main() -> None:
    """Train, measure, and write the data and the table."""
    args = options(__doc__, seeds=3)
    robots, seeds, steps, episodes = ROBOT_NAMES, args.seeds, None, EPISODES
    if args.quick:
        robots, seeds, steps, episodes = robots[:1], 1, ROLLOUT, 1
    runs = {
        robot: {
            reward: [train_and_score(robot, reward, seed, steps, episodes) for seed in range(seeds)]
            for reward in REWARDS
        }
        for robot in robots
    }
    results = {"episodes": episodes, "seed": SEED, "runs": runs}
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
