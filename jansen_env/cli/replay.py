"""Record episodes, and write a web page that replays them: ``jansen-env replay``."""

import argparse
import re
from contextlib import closing
from pathlib import Path

from jansen_env.cli.enjoy import play, watched
from jansen_env.cli.flags import parse_policies, path_flag, policy_parser, positive_int
from jansen_env.cli.named_policies import default_policy, labels, load_named
from jansen_env.cli.progress import progress
from jansen_env.files import write_text
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import Advance, make_env, no_progress
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import MOST_RECORDED, Recording
from jansen_env.viewer.saved_walk import walk_again
from jansen_env.viewer.web.page import MOST_RECORDINGS, page


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = policy_parser(
        "jansen-env replay",
        __doc__,
        "jansen-env replay",
        "jansen-env replay --policy pretrained --policy pid --command 0.4 --out both.html",
    )
    add = parser.add_argument
    add(
        "--recording",
        action="append",
        default=[],
        metavar="FILE",
        help="saved recording (.npz), or rollout that the walking page has saved (.json), to show "
        "instead of a policy or next to one",
    )
    add(
        "--command",
        type=float,
        metavar="V",
        help="commanded speed or goal; default: the middle of the benchmark's grid",
    )
    add(
        "--steps",
        type=positive_int,
        default=MOST_RECORDED,
        help="largest number of steps of the episode; default: the time limit of the environment",
    )
    add(
        "--out",
        type=path_flag,
        default="replay.html",
        metavar="FILE",
        help="page to write (.html); the recordings are written to the same folder; default: "
        "replay.html",
    )
    args = parse_policies(parser, arguments, "--command")
    args.policy = args.policy or [default_policy(args.env)] * (not args.recording)
    if not 1 <= (count := len(args.policy) + len(args.recording)) <= MOST_RECORDINGS:
        parser.error(f"--policy and --recording must be given once or twice in all, got {count}")
    if args.out.suffix != ".html":
        parser.error(f"--out must end in .html, got {args.out}")
    if args.steps > MOST_RECORDED:
        parser.error(f"--steps must be at most {MOST_RECORDED}, got {args.steps}")
    if args.command is None:
        args.command = find_benchmark(args.env).middle
    return args


def record(
    name: str, label: str, args: argparse.Namespace, advance: Advance = no_progress
) -> Recording:
    """Record an episode of a policy.

    Args:
        name: Name or file of the policy; see
            :func:`jansen_env.cli.named_policies.load_named`.
        label: Label of the recording.
        args: Parsed command line.
        advance: Function that is called with the fraction of the episode done since its last call.

    Raises:
        ValueError: If the policy or an argument is not allowed.
    """
    with closing(Recorder(make_env(args.env, args.env_kwargs), label)) as env:
        moments = play(load_named(name, env), env, args.command, args.seed)
        most = min(args.steps, env.get_wrapper_attr("spec").max_episode_steps or MOST_RECORDED)
        for moment in watched(moments, most, advance):
            if moment.steps == args.steps:
                break
        return env.recording


def load(path: str) -> Recording:
    """Return the recording in a file, or that of a rollout saved by the walking page.

    Args:
        path: Path of a recording, or of a saved rollout if it ends in ``.json``.
    """
    return walk_again(path) if path.endswith(".json") else Recording.load(path)


def main(arguments: list[str] | None = None) -> None:
    """Record episodes, and write the recordings and the page.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = parse(arguments)
    out = args.out
    with args.parser.refusing():
        named = zip(args.policy, labels(args.policy), strict=True)
        with progress("recording", len(args.policy)) as advance:
            made = [record(name, label, args, advance) for name, label in named]
        content = page(*made, *map(load, args.recording))  # made before anything is written
        names = [re.sub("[^A-Za-z0-9._-]", "_", recording.label) for recording in made]
        if len({*names}) < len(names):  # labels differ only in replaced characters
            names = [f"{name}_{i}" for i, name in enumerate(names, start=1)]
        files = [out.with_name(f"{out.stem}_{name}.npz") for name in names]
        for file in files:
            if file.resolve() in [Path(path).resolve() for path in args.recording]:
                raise ValueError(f"--out must not overwrite a --recording, got {file} for both")
        written = [recording.save(file) for recording, file in zip(made, files, strict=True)]
        written.append(write_text(out, content))
    for path in written:
        print(f"written: {path} ({path.stat().st_size / 1000:.0f} kB)")
