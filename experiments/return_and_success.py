"""Does the return rank policies on rough ground as their success does?

Run the experiment as follows. It takes a few seconds, because it only reads the result files of the
benchmark.

    python experiments/return_and_success.py [--quick]

The script compares all policies whose result files contain the tracks ``terrain`` and ``robust``,
in pairs. All policies walked in the same episodes. The script writes
``docs/judging/return_and_success.json`` and the tables of docs/judging.md.
"""

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from pages import options, publish, table
from scipy.stats import spearmanr

from jansen_env.arrays import Array
from jansen_env.scoring.protocol import METRICS, TRACKS, Columns, metric_value
from jansen_env.scoring.result_files import read_result

DATA, PAGE = "judging/return_and_success.json", "judging.md"
RESULTS = Path(__file__).parents[1] / "results"
NAMES = ("terrain", "robust")  # tracks of which success is the primary metric
IDLE = ("random", "stand")  # these do not walk, so their order says nothing
ERRORS = 2.0  # number of standard errors by which the successes of a pair differ at least
COMPARABLE = 0.5  # largest difference of comparable loads, as a multiple of the weight


def significant(first: Array, second: Array, weights: Array) -> bool:
    """Return whether the successes of two policies differ by more than their statistical error.

    Args:
        first: Success of a policy in n episodes, shape (n,).
        second: Success of another policy in the same episodes, shape (n,).
        weights: Weights of the episodes, shape (n,). The sum is 1.
    """
    difference = first - second
    mean = weights @ difference
    error = np.sqrt(weights**2 @ (difference - mean) ** 2)
    return bool(abs(mean) > ERRORS * error)


def compare(track: str, files: list[Path]) -> dict[str, Any]:
    """Return the scores of all policies on a track, and the pairs that differ in success.

    Args:
        track: Name of the track.
        files: Result files.
    """
    weights = TRACKS[track].episodes.weight
    columns: dict[str, Columns] = {}
    for file in files:
        result = read_result(file)
        if track in result.tracks and result.name not in IDLE:
            columns[file.stem] = result.tracks[track].columns
    policies = {
        name: {
            metric: float(metric_value(values, METRICS[metric], weights))
            for metric in ("success", "return", "load")
        }
        for name, values in columns.items()
    }
    differ = [
        pair
        for pair in combinations(policies, 2)
        if significant(columns[pair[0]]["success"], columns[pair[1]]["success"], weights)
    ]
    return {"policies": policies, "differ": differ}


def ordered_alike(policies: dict[str, dict[str, float]], pair: tuple[str, str]) -> bool:
    """Return whether the policy of a pair with more success also has the higher return."""
    first, second = (policies[name] for name in pair)
    return (first["success"] > second["success"]) == (first["return"] > second["return"])


def comparable(policies: dict[str, dict[str, float]], pair: tuple[str, str]) -> bool:
    """Return whether the loads of a pair differ by at most :data:`COMPARABLE`.

    Args:
        policies: Scores of all policies by name.
        pair: Names of the two policies.
    """
    first, second = (policies[name]["load"] for name in pair)
    return abs(first - second) <= COMPARABLE


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: counts of pairs, and the pairs with different orders.

    Args:
        results: Scores and pairs by track.
    """
    head = [
        "track",
        "policies",
        "pairs that differ in success",
        "of these, ordered alike by return",
        "pairs with comparable loads",
        "of these, ordered alike",
        "rank correlation of return and success",
    ]
    rows = []
    exceptions = []
    for track, found in results.items():
        policies = found["policies"]
        success, returns = (
            [scores[metric] for scores in policies.values()] for metric in ("success", "return")
        )
        alike = [ordered_alike(policies, pair) for pair in found["differ"]]
        near = [pair for pair in found["differ"] if comparable(policies, pair)]
        alike_near = [ordered_alike(policies, pair) for pair in near]
        counts = [len(policies), len(alike), sum(alike), len(near), sum(alike_near)]
        correlation = spearmanr(success, returns).statistic
        rows.append([track, *(str(count) for count in counts), f"{correlation:.2f}"])
        for pair, same in zip(found["differ"], alike, strict=True):
            if not same:
                cells = [
                    "{success:.2f}, {return:.0f}, {load:.1f}".format(**policies[p]) for p in pair
                ]
                exceptions.append([track, pair[0], cells[0], pair[1], cells[1]])
    exception = ["exception on the track", "policy", "success, return, load"]
    exception += ["other policy", "its success, return, load"]
    return {PAGE: [table(head, rows), table(exception, exceptions, texts=5)]}


def main() -> None:
    """Compare, and write the data and the tables."""
    args = options(__doc__)
    files = sorted(RESULTS.glob("*.json"))
    results = {track: compare(track, files) for track in NAMES[: 1 if args.quick else None]}
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
