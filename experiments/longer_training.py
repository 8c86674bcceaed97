"""Does longer training lead to walks that hop more?

Run the experiment as follows. It takes about half an hour on one core.

    python experiments/longer_training.py [--seeds 3] [--quick]

The recipe of ``train.py`` for JansenWalkerBuilt-v0 trains for two numbers of environment steps,
with several seeds. The runs are kept in ``logs/longer_training`` and not trained again. Each last
model walks at four commands. The script writes ``docs/judging/longer_training.json`` and a table of
docs/judging.md.
"""

from pathlib import Path
from typing import Any

from pages import mean_and_range, options, publish, table
from trained_policies import ROLLOUT, score_by_command, train_recipe

from jansen_env import ROBOTS

DATA, PAGE = "judging/longer_training.json", "judging.md"
RUNS = Path("logs/longer_training")
STEPS: tuple[int, ...] = (2_408_448, 7_000_000)  # the first number is that of train.py
COMMANDS = (0.1, 0.2, 0.3, 0.5)  # m/s
EPISODES = 32  # per command
SEED = 7  # seed of the scored episodes
METRICS = {
    "return": 0,
    "unsupported": 2,
    "load": 1,
    "steady_slip_per_metre": 3,
    "steady_cost_of_transport": 2,
}
"""Metrics of the table, and the number of decimals."""


def train_and_score(steps: int, seed: int, episodes: int) -> dict[str, dict[str, float | None]]:
    """Train a model, and return its metrics by command.

    Args:
        steps: Number of environment steps.
        seed: Seed of the training.
        episodes: Number of episodes per command.
    """
    file = train_recipe(
        RUNS / f"{steps}_{seed}", "python experiments/longer_training.py", seed=seed, steps=steps
    )
    return score_by_command(str(file), ROBOTS["built"](), COMMANDS, METRICS, episodes, SEED)


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page: means over the seeds, and their ranges.

    Args:
        results: Scores of each run by number of steps.
    """
    head = [
        "steps",
        "command (m/s)",
        "return",
        "unsupported (fraction of time)",
        "load (multiple of the weight)",
        "slip per metre (m/m)",
        "cost of transport",
    ]
    rows = []
    for steps, runs in results["runs"].items():
        for command in runs[0]:
            cells = [
                mean_and_range([run[command][metric] for run in runs], decimals)
                for metric, decimals in METRICS.items()
            ]
            rows.append([f"{int(steps):,}", command, *cells])
    return {PAGE: [table(head, rows)]}


def main() -> None:
    """Train, measure, and write the data and the table."""
    args = options(__doc__, seeds=3)
    steps, seeds, episodes = STEPS, args.seeds, EPISODES
    if args.quick:
        steps, seeds, episodes = (ROLLOUT,), 1, 1
    runs = {
        str(count): [train_and_score(count, seed, episodes) for seed in range(seeds)]
        for count in steps
    }
    results = {"runs": runs}
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
