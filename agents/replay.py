"""Record walks, and write a web page that replays them: ``python -m agents.replay``."""

from __future__ import annotations

import argparse
import re
from contextlib import closing
from pathlib import Path

from agents.command_line import mapping, non_negative_int, positive_int
from agents.evaluate import labels, load_named
from agents.video import play
from jansen_env.files import write_text
from jansen_env.scoring.benchmarks import DEFAULT, TASKS, find_task
from jansen_env.scoring.rollout import make_env
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import LONGEST_NAME, MOST_STEPS, Recording
from jansen_env.viewer.web.page import MOST_RECORDINGS, page


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line; what does not go together is refused."""
    named = "; ".join(f"{env_id}: {', '.join(task.baselines)}" for env_id, task in TASKS.items())
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--policy", action="append", default=[], metavar="NAME",
        help=f"a baseline ({named}), 'pretrained', a run's folder, or a file of a model or policy; "
        "repeat to compare two from the same start")  # fmt: skip
    add("--recording", action="append", default=[], metavar="FILE",
        help="a saved .npz to show, in place of a policy or beside one")  # fmt: skip
    add("--env", default=DEFAULT, choices=sorted(TASKS),
        help="environment id; default: %(default)s")  # fmt: skip
    add("--env-kwargs", default="{}", type=mapping, metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    add("--command", type=float, metavar="V",
        help="commanded speed; default: the middle of the task's grid")  # fmt: skip
    add("--seed", type=non_negative_int, default=0, help="seed of the start; default: 0")
    add("--steps", type=positive_int, default=MOST_STEPS,
        help="most steps of the episode; default: the environment's")  # fmt: skip
    add("--out", default="replay.html", metavar="FILE",
        help="the page, .html; recordings go beside it; default: replay.html")  # fmt: skip
    args = parser.parse_args(arguments)
    if "speed_command" in args.env_kwargs:
        parser.error("speed_command in --env-kwargs has no effect here, must be in --command")
    if not 1 <= (count := len(args.policy) + len(args.recording)) <= MOST_RECORDINGS:
        parser.error(f"--policy and --recording are given {count} times, must be once or twice")
    if Path(args.out).suffix != ".html":
        parser.error(f"--out is {args.out}, must end in .html")
    if args.steps > MOST_STEPS:
        parser.error(f"--steps is {args.steps}, must be at most {MOST_STEPS}")
    grid = find_task(args.env).commands
    if args.command is None:
        args.command = grid[(len(grid) - 1) // 2]
    args.error = parser.error
    return args


def record(name: str, label: str, args: argparse.Namespace) -> Recording:
    """An episode of a policy, with environment, command and start of the command line.

    Raises:
        ValueError: the policy, the command or an argument of the environment is not allowed.
    """
    with closing(Recorder(make_env(args.env, args.env_kwargs), label)) as env:
        for moment in play(load_named(name, env), env, args.command, args.seed):
            if moment.steps == args.steps:
                break
        return env.recording


def path_of(recording: Recording, out: Path) -> Path:
    """The file beside a page that a recording goes to, by its label."""
    return out.with_name(f"{out.stem}_{re.sub('[^A-Za-z0-9._-]', '_', recording.label)}.npz")


def main(arguments: list[str] | None = None) -> None:
    """Record, and write recordings and page."""
    args = parse(arguments)
    out = Path(args.out)
    try:
        named = zip(args.policy, labels(args.policy), strict=True)
        made = [record(name, label[-LONGEST_NAME:], args) for name, label in named]
        saved = [Recording.load(path) for path in args.recording]
        content = page(*made, *saved)  # or nothing is written
        paths = [path_of(one, out) for one in made]
        if len({*paths}) < len(paths):  # labels differ in other characters alone
            paths = [path.with_stem(f"{path.stem}_{i}") for i, path in enumerate(paths, start=1)]
        written = [one.save(path) for one, path in zip(made, paths, strict=True)]
        written.append(write_text(out, content))
    except (OSError, ValueError) as error:
        args.error(str(error))
    for path in written:
        print(f"written: {path} ({path.stat().st_size / 1000:.0f} kB)")


if __name__ == "__main__":
    main()
