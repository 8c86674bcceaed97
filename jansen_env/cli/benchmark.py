"""Score policies by the benchmark protocol: ``jansen-env benchmark --policy pid --out pid.json``.

With result files as arguments, the command prints tables of their scores. It does not have the
flags of ``jansen-env evaluate``, because the protocol fixes the environments, commands and seeds.
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import Any, cast

import numpy as np

from jansen_env.checks import one_of
from jansen_env.cli.flags import Parser, path_flag
from jansen_env.cli.named_policies import label, load_named, policy_sha256
from jansen_env.cli.progress import progress
from jansen_env.files import check_writable
from jansen_env.policies import pretrained
from jansen_env.policies.policy import Policy
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.comparison import (
    NOTE,
    by_algorithm,
    group_rows,
    improvement_rows,
    metric_rows,
    score_rows,
)
from jansen_env.scoring.protocol import FLOORS, TRACKS, Track, run_track
from jansen_env.scoring.result_files import (
    Result,
    TrackResult,
    check_text,
    new_result,
    read_result,
    rounded,
    write_result,
)

PRETRAINED = "pretrained"
ALL = "all"  # stands for all tracks that --policy does not name


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = Parser(
        "jansen-env benchmark",
        "Score policies by the benchmark protocol, or compare result files.",
        "jansen-env benchmark --policy pretrained --out mine.json",
        "jansen-env benchmark results/pretrained.json results/pid.json",
    )
    add = parser.add_argument
    add("files", nargs="*", metavar="FILE", help="result files whose scores are printed")
    add(
        "--policy",
        action="append",
        default=[],
        metavar="[TRACK=]NAME",
        help=f"policy to run: {', '.join(FLOORS)}, a baseline, 'pretrained', the folder of a run, "
        "the file of a model or policy, or MODULE:FUNCTION; repeat the flag for tracks with other "
        "policies",
    )
    add(
        "--tracks",
        nargs="+",
        choices=TRACKS,
        metavar="TRACK",
        help=f"tracks to run, of {', '.join(TRACKS)}; default: all tracks that the policy can play",
    )
    add("--name", help="name of the algorithm in tables; default: the name of the policy")
    add("--out", type=path_flag, metavar="FILE", help="result file to write")
    add(
        "--reproduce",
        metavar="FILE",
        help="run the policies of a result file again, and compare the scores of each episode",
    )
    add("--all", action="store_true", help="print all metrics, and the scores by terrain level")
    args = parser.parse_args(arguments)
    args.parser = parser
    if not (args.files or args.policy or args.reproduce):
        parser.error("give --policy to run a policy, or result files to compare")
    if args.reproduce and (args.files or args.out or args.policy):
        parser.error("--reproduce cannot be combined with result files, --policy or --out")
    if args.policy and not args.out:
        parser.error("--policy must come with --out, the result file to write")
    return args


def main(arguments: list[str] | None = None) -> None:
    """Run policies, or print tables of result files.

    Args:
        arguments: Arguments of the command. None selects those of the process.

    Raises:
        SystemExit: With status 1 if ``--reproduce`` finds a difference.
    """
    args = parse(arguments)
    with args.parser.refusing():
        if args.reproduce:
            _reproduce(read_result(args.reproduce), args.tracks)
            return
        results = [read_result(file) for file in args.files]
        if args.policy:
            check_writable("--out", args.out.absolute().parent)
            named = policies_of_tracks(args.policy)
            name = check_text("--name", args.name or label(args.policy[-1].rpartition("=")[2]))
            result = new_result(name, run_tracks(named, args.tracks))
            print(f"{write_result(args.out, result)}\n")
            results.append(read_result(args.out))
        print(tables(results, args.all))


def policies_of_tracks(given: Sequence[str]) -> dict[str, str]:
    """Return the name of the policy for each track.

    Args:
        given: Values of ``--policy``: NAME for all tracks, or TRACK=NAME.

    Raises:
        ValueError: If a track is not known or has two policies.
    """
    named: dict[str, str] = {}
    for entry in given:
        track, equals, name = entry.partition("=")
        if not equals:
            track = ALL
            name = entry
        one_of("TRACK of --policy", track, [ALL, *TRACKS])
        if track in named:
            raise ValueError(f"--policy was given twice for {track!r}")
        named[track] = name
    default = {track: named[ALL] for track in TRACKS} if ALL in named else {}
    of_tracks = {track: name for track, name in named.items() if track != ALL}
    return {**default, **of_tracks}


def load_for_track(name: str, track: Track) -> tuple[str, Policy]:
    """Load a policy for the environment of a track.

    Args:
        name: Name of the policy. ``"pretrained"`` is the package's policy for the track.
        track: The track.

    Returns:
        The full name of the policy, and the policy.

    Raises:
        ValueError: If there is no such policy, or if it does not fit the environment.
    """
    if name == PRETRAINED and track.pretrained != pretrained.DEFAULT:
        name = f"{PRETRAINED}:{track.pretrained}"
    with closing(track.make_env()) as env:
        if name in FLOORS:
            return name, FLOORS[name](cast("Any", env.unwrapped))
        return name, load_named(name, env)


def run_tracks(
    named: Mapping[str, str], chosen: Sequence[str] | None = None
) -> dict[str, TrackResult]:
    """Run the policy of each track.

    Args:
        named: Name of the policy of each track.
        chosen: Names of the tracks. If None, tracks that their policy cannot play are left out.

    Raises:
        ValueError: If a policy does not fit a track in ``chosen``, or fits no track at all.
    """
    loaded: dict[str, tuple[str, Policy]] = {}
    refused: dict[str, str] = {}
    for track in chosen or named:
        if track not in named:
            raise ValueError(f"--policy must name a policy for every track, got none for {track!r}")
        try:
            loaded[track] = load_for_track(named[track], TRACKS[track])
            check_text("the name of the policy", label(loaded[track][0]))
        except ValueError as error:
            if chosen:
                raise
            refused[track] = str(error)
    if not loaded:
        raise ValueError(next(iter(refused.values())))
    for track, reason in refused.items():
        print(f"left out {track}: {reason}")
    results = {}
    total = sum(len(TRACKS[track].episodes.seed) for track in loaded)
    with progress("scoring", total) as advance:
        for track, (name, policy) in loaded.items():
            start = time.perf_counter()
            columns = rounded(run_track(policy, TRACKS[track], advance))
            seconds = time.perf_counter() - start
            digest = policy_sha256(name, TRACKS[track].env_id)
            results[track] = TrackResult(label(name), digest, columns)
            print(f"{track}: {len(columns['return'])} episodes in {seconds:.0f} s", flush=True)
    return results


def _reproduce(published: Result, chosen: Sequence[str] | None) -> None:
    """Run the policies of a result again, and print how many episodes have the same scores.

    A file may come from anyone, so only policies of the package are run.

    Raises:
        SystemExit: With status 1 if the scores of an episode differ that must be the same.
        ValueError: If a policy does not come with the package, or has changed since the result.
    """
    names = {name: track.policy for name, track in published.tracks.items()}
    for track, name in names.items():
        env_id = TRACKS[track].env_id
        known = [*FLOORS, *find_benchmark(env_id).baselines]
        if name not in known and name.partition(":")[0] != PRETRAINED:
            raise ValueError(
                f"--reproduce must get results of policies of the package, got {name!r}; run this "
                "policy with --policy"
            )
        needed = published.tracks[track].sha256
        if (digest := policy_sha256(name, env_id)) != needed:
            raise ValueError(
                f"the policy {name!r} must have the SHA-256 {needed}, got {digest} in this version "
                "of the package"
            )
    found = run_tracks(names, chosen or [*names])
    failed = False
    for track, result in found.items():
        columns = published.tracks[track].columns
        equal = np.all([result.columns[c] == columns[c] for c in columns], axis=0)
        for index, part in enumerate(TRACKS[track].parts):
            same = equal[TRACKS[track].episodes.part == index]
            failed |= part.exact and not same.all()
            note = "" if part.exact else " (may differ between machines)"
            where = track if part.name == track else f"{track}, {part.name}"
            print(f"{where}: {same.sum()} of {len(same)} episodes equal{note}")
    if failed:
        raise SystemExit(1)


def tables(results: Sequence[Result], all_metrics: bool = False) -> str:
    """Return tables of the scores of results, in Markdown.

    Args:
        results: The results.
        all_metrics: Whether to include all metrics of each track.
    """
    blocks = [markdown(score_rows(results)), NOTE]
    if len(grouped := by_algorithm(results)) == 2:
        blocks.append(markdown(improvement_rows(grouped)))
    if all_metrics:
        for name, track in TRACKS.items():
            rows = metric_rows(results, track)
            if len(rows) > 1:
                blocks += [f"## {name}", markdown(rows), markdown(group_rows(results, track))]
    return "\n\n".join(blocks)


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table of rows, the first of which is the head."""
    from tabulate import tabulate

    align = ("left", *["right"] * (len(rows[0]) - 1))
    return tabulate(rows[1:], rows[0], tablefmt="pipe", disable_numparse=True, colalign=align)
