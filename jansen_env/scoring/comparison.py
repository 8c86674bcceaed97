"""Normalised scores of algorithms on the benchmark, with intervals over runs and episodes.

The estimates follow Agarwal et al., "Deep reinforcement learning at the edge of the statistical
precipice", NeurIPS 2021. The following command prints the values of the frozen scale:

    python -m jansen_env.scoring.comparison results/{stand,random,pretrained}.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from jansen_env.arrays import Array, Ints
from jansen_env.scoring.metrics import CONFIDENCE, ENDS, RESAMPLES, Interval, interval_text
from jansen_env.scoring.protocol import FLOORS, METRICS, TRACKS, Track, metric_value, scales
from jansen_env.scoring.result_files import Result, TrackResult, read_result

Runs: TypeAlias = Sequence[TrackResult]
"""Results of the training runs of one algorithm on one track."""

NOTE = (
    f"Brackets are {CONFIDENCE:.0%} bootstrap intervals over training runs and episodes. The score "
    "of a track is the interquartile mean over training runs."
)


class Comparison(NamedTuple):
    """Scores of an algorithm.

    Attributes:
        runs: Largest number of training runs on a track.
        tracks: Normalised score of each track with its interval, by name.
        mean: Mean of the tracks with its interval. None if a track is missing.
        worst: Score of the worst track with its interval. None if a track is missing.
    """

    runs: int
    tracks: dict[str, Interval]
    mean: Interval | None
    worst: Interval | None


def by_algorithm(results: Iterable[Result]) -> dict[str, list[Result]]:
    """Return the results of each algorithm by its name."""
    grouped: dict[str, list[Result]] = {}
    for result in results:
        grouped.setdefault(result.name, []).append(result)
    return grouped


def runs_on(results: Iterable[Result], track: str) -> list[TrackResult]:
    """Return the results of an algorithm on a track.

    Args:
        results: Results of the algorithm.
        track: Name of the track.
    """
    return [result.tracks[track] for result in results if track in result.tracks]


def resampled_weights(track: Track, rng: np.random.Generator) -> Array:
    """Return bootstrap weights of a track's episodes, shape (RESAMPLES + 1, n).

    Episodes are resampled within their strata. All runs have the same test episodes, so they share
    the weights. The first row contains the weights without resampling.

    Args:
        track: The track.
        rng: Random number generator.
    """
    episodes = track.episodes
    weights = np.tile(episodes.weight, (RESAMPLES + 1, 1))
    for stratum in np.unique(episodes.stratum):
        (rows,) = np.nonzero(episodes.stratum == stratum)
        weights[1:, rows] *= rng.multinomial(len(rows), np.ones(len(rows)) / len(rows), RESAMPLES)
    return weights


def resampled_runs(count: int, rng: np.random.Generator) -> Ints:
    """Return bootstrap indices of runs, shape (RESAMPLES + 1, count).

    The first row contains each run once.
    """
    indices = rng.integers(count, size=(RESAMPLES + 1, count))
    indices[0] = np.arange(count)
    return indices


def resampled_scores(runs: Runs, track: Track, rng: np.random.Generator) -> Array:
    """Return the normalised score of a track for each resample, shape (RESAMPLES + 1,).

    The score is the interquartile mean over the runs.

    Args:
        runs: Results of the runs.
        track: The track.
        rng: Random number generator.
    """
    from scipy.stats import trim_mean  # imported here, because the import takes long

    weights = resampled_weights(track, rng)
    metric = METRICS[track.primary]
    values = np.stack([metric_value(run.columns, metric, weights) for run in runs], axis=1)
    chosen = np.take_along_axis(values, resampled_runs(len(runs), rng), axis=1)
    return scales()[track.name].normalise(trim_mean(chosen, 0.25, axis=1))


def compare(results: Sequence[Result]) -> Comparison:
    """Return the scores of an algorithm.

    Args:
        results: Result of each training run of the algorithm.
    """
    rng = np.random.default_rng(0)
    counts = [0]
    scores = {}
    for name, track in TRACKS.items():
        if runs := runs_on(results, name):
            counts.append(len(runs))
            scores[name] = resampled_scores(runs, track, rng)
    every = np.stack([*scores.values()])
    complete = len(scores) == len(TRACKS)
    return Comparison(
        max(counts),
        {name: interval(values) for name, values in scores.items()},
        interval(every.mean(axis=0)) if complete else None,
        interval(every.min(axis=0)) if complete else None,
    )


def interval(resamples: Array) -> Interval:
    """Return the first of the values, and the interval that contains 95 % of the others."""
    low, high = np.percentile(resamples[1:], ENDS)
    return float(resamples[0]), float(low), float(high)


def probability_of_improvement(ours: Runs, others: Runs, track: Track) -> Interval:
    """Return the probability that one algorithm scores higher than another on the same episode.

    The episodes are paired, because all runs have the same test episodes. An episode in which both
    score the same counts one half.

    Args:
        ours: Results of the runs of the first algorithm.
        others: Results of the runs of the second algorithm.
        track: The track.
    """
    rng = np.random.default_rng(0)
    first = np.stack([run.columns[track.primary] for run in ours])[:, None]
    second = np.stack([run.columns[track.primary] for run in others])[None]
    wins = (first > second) + 0.5 * (first == second)  # shape (ours, others, episodes)
    weighted = wins @ resampled_weights(track, rng).T  # shape (ours, others, resamples)
    counts = [
        np.stack([np.mean(resampled_runs(count, rng) == run, axis=1) for run in range(count)])
        for count in (len(ours), len(others))
    ]
    return interval(np.einsum("ijr,ir,jr->r", weighted, *counts))


def score_rows(results: Iterable[Result]) -> list[list[str]]:
    """Return the cells of a table with the normalised scores of each algorithm.

    Args:
        results: The results.

    Returns:
        The rows of the table, best mean first. The first row is its head.
    """
    compared = {name: compare(runs) for name, runs in by_algorithm(results).items()}

    def rank(name: str) -> tuple[float, float]:
        mean = compared[name].mean
        tracks = compared[name].tracks.values()
        return (-mean[0] if mean else np.inf, -max(value for value, *_ in tracks))

    head = ["algorithm", "runs", *TRACKS, "mean", "worst"]
    rows = [
        [
            name,
            str(compared[name].runs),
            *(_score(compared[name].tracks.get(track)) for track in TRACKS),
            _score(compared[name].mean),
            _score(compared[name].worst),
        ]
        for name in sorted(compared, key=rank)
    ]
    return [head, *rows]


def _score(value: Interval | None) -> str:
    """Return a normalised score with its interval as text."""
    return (
        "-" if value is None else "{:.2f} [{:.2f}, {:.2f}]".format(*value).replace("-0.00", "0.00")
    )


def metric_rows(results: Iterable[Result], track: Track) -> list[list[str]]:
    """Return the cells of a table with the metrics of each algorithm on a track.

    The metrics are means over the runs.

    Args:
        results: The results.
        track: The track.

    Returns:
        The rows of the table. The first row is its head.
    """
    rows = [["algorithm", *(metric.heading for metric in METRICS.values())]]
    for name, of_algorithm in by_algorithm(results).items():
        if runs := runs_on(of_algorithm, track.name):
            weights = track.episodes.weight
            values = [
                float(np.mean([metric_value(run.columns, metric, weights) for run in runs]))
                for metric in METRICS.values()
            ]
            rows.append([name, *(interval_text([value]) for value in values)])
    return rows


def group_rows(results: Iterable[Result], track: Track) -> list[list[str]]:
    """Return the cells of a table with the primary metric for each group of episodes.

    The groups are terrain levels, or parts of the track, or commands. The metric is a mean over the
    runs.

    Args:
        results: The results.
        track: The track.

    Returns:
        The rows of the table. The first row is its head.
    """
    rows = [[f"{track.primary} of", *track.groups]]
    for name, of_algorithm in by_algorithm(results).items():
        if runs := runs_on(of_algorithm, track.name):
            values = np.mean([run.columns[track.primary] for run in runs], axis=0)
            means = [float(values[rows].mean()) for rows in track.groups.values()]
            rows.append([name, *(interval_text([mean]) for mean in means)])
    return rows


def improvement_rows(results: Mapping[str, Sequence[Result]]) -> list[list[str]]:
    """Return the cells of a table with the probability of improvement on each common track.

    Args:
        results: Results of exactly two algorithms by name.

    Returns:
        The rows of the table. The first row is its head.
    """
    (first, ours), (second, others) = results.items()
    rows = [["track", f"P({first} > {second})"]]
    for name, track in TRACKS.items():
        ours_here = runs_on(ours, name)
        others_here = runs_on(others, name)
        if ours_here and others_here:
            rows.append([name, _score(probability_of_improvement(ours_here, others_here, track))])
    return rows


def reference_values(results: Iterable[Result]) -> dict[str, dict[str, float]]:
    """Return the content of ``protocol_1.json``: the primary metric of the reference policies.

    Args:
        results: Results of the policies ``stand``, ``random`` and ``pretrained``.

    Returns:
        The value of each policy by its name, for each track.
    """
    runs = {result.name: result.tracks for result in results}
    return {
        name: {
            policy: float(
                metric_value(
                    runs[policy][name].columns, METRICS[track.primary], track.episodes.weight
                ).round(4)
            )
            for policy in (*FLOORS, "pretrained")
        }
        for name, track in TRACKS.items()
    }


def main() -> None:
    """Print :func:`reference_values` of the result files on the command line as JSON."""
    print(json.dumps(reference_values(map(read_result, sys.argv[1:])), indent=1))


if __name__ == "__main__":
    main()
