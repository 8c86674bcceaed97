"""Train many runs and compare them over seeds: ``python -m agents.study --seeds 10``."""

from __future__ import annotations

import os

# Before torch is loaded, as in train.py: the number of threads changes the run that a seed gives.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import shlex
import signal
import sys
import uuid
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from agents import need
from agents.command_line import add_run_flags
from agents.studies.backends import Watch, has_ray, run_locally, run_on_ray
from agents.studies.plan import STUDY, Run, Study, enter, make_study, read_study
from agents.studies.run import STATUS, TOKEN, RunRequest, RunResult, is_finished, run_state
from agents.studies.study_report import write_report
from agents.training.runs import read_evaluations
from agents.training.train_model import prepare
from jansen_env.commands.flags import Parser, env_id, positive_int
from jansen_env.cores import available_cores
from jansen_env.files import write_text
from jansen_env.plain_yaml import read_yaml
from jansen_env.sb3.run_config import ALGORITHMS
from jansen_env.scoring.benchmarks import DEFAULT

FLAGS = tuple(STUDY)[:-1]  # those that describe a study, named as in its file, without variants


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse flags; those of a run are named as in train.py."""
    parser = Parser("python -m agents.study", "Train many runs and compare them over seeds.",
                    "python -m agents.study --seeds 10",
                    "python -m agents.study agents/studies/ten_seeds.yml --cores 2")  # fmt: skip
    add_run_flags(parser)
    add, count = parser.add_argument, positive_int
    add("study", nargs="?", metavar="FILE", help="the study as YAML, in place of flags")
    add("--seeds", type=count, help="runs of each kind, with seeds from 0; default: 10")
    add("--env", dest="envs", nargs="+", type=env_id, metavar="ID",
        help=f"environment ids; default: {DEFAULT}")  # fmt: skip
    add("--algo", dest="algos", nargs="+", choices=sorted(ALGORITHMS),
        help="algorithms; default: ppo")  # fmt: skip
    add("--name", help="of the study; default: the file's, or else 'study'")
    add("--log-folder", default="logs/studies", metavar="DIR", help="the study goes to DIR/NAME")
    add("--cores", type=count, default=1, help="of each run, for its environments; default: 1")
    add("--local", action="store_true", help="processes of this machine, though Ray is installed")
    add("--workers", type=count, help="runs at once, without Ray; default: as the cores allow")
    add("--address", help="of the Ray cluster to join, or 'auto'; default: one of this machine's")
    add("--report", metavar="FOLDER", help="of a study: only make table and figures of it again")
    args = parser.parse_args(arguments)
    args.error = parser.error
    given = [name for name in FLAGS if getattr(args, name) is not None]
    if args.study and given:
        parser.error(f"{args.study} says what the study is; not allowed beside it: "
                     f"{', '.join(given)}")  # fmt: skip
    if args.report and (args.study or given):
        parser.error("--report takes a study as it stands in its folder, and nothing else")
    if args.local and args.address:
        parser.error("--local and --address exclude each other")
    if args.address:
        need("distributed", "ray", who="--address")
    return args


def main(arguments: list[str] | None = None) -> int:
    """Run all that is not finished, report; returns the exit status: 1 where runs have failed."""
    args = parse(arguments)
    given = sys.argv[1:] if arguments is None else arguments
    try:
        if args.report:
            print(write_report(read_study(args.report), Path(args.report)))
            return 0
        study, folder = _begin(args)
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
        results = _run(study, folder, args, shlex.join(["python", "-m", "agents.study", *given]))
        print(f"\n{write_report(study, folder)}\n\n{folder}/report.md, report.json, runs.csv")
    except (OSError, ValueError) as error:
        args.error(" ".join(str(error).split()))
    states = {result.state for result in results.values()}
    if "stopped" in states:
        print("stopped; the same command goes on from the last checkpoints")
        return 130
    return int(not states <= {"finished"})


def _begin(args: argparse.Namespace) -> tuple[Study, Path]:
    """Return the study asked for and its folder, after each group's model was built once."""
    name = args.name or (Path(args.study).stem if args.study else "study")
    folder = Path(args.log_folder).resolve() / name
    plan = {flag: value for flag in FLAGS if (value := getattr(args, flag)) is not None}
    study = make_study(read_yaml(args.study), args.study) if args.study else make_study(plan)
    for group, config in study.groups.items():
        try:
            env: Any = prepare({**config, "seed": 0}).get_env()
        except ValueError as error:
            raise ValueError(f"{group}: {error}") from error
        env.close()
    enter(folder, study)
    return study, folder


def _run(
    study: Study, folder: Path, args: argparse.Namespace, command: str
) -> dict[str, RunResult]:
    """Execute the runs that are not finished; returns their results by name."""
    if not (token := folder / TOKEN).is_file():
        write_text(token, uuid.uuid4().hex)
    common = (*study[2:], args.cores, command, token.read_text(encoding="utf-8"))
    runs = study.runs(folder)
    left = [run for run in runs if not is_finished(run.folder)]
    for run in left:
        (run.folder / STATUS).unlink(missing_ok=True)  # an earlier driver's
    local = args.local or not has_ray()
    place = "local processes" if local else f"Ray at {args.address or 'this machine'}"
    print(f"{len(runs)} runs, {len(runs) - len(left)} finished, {len(left)} to do on {place} "
          f"-> {folder}", flush=True)  # fmt: skip
    if not left:
        return {}
    requests = [RunRequest(run, *common) for run in left]
    with study_progress(runs) as progress:
        if not local:
            return run_on_ray(requests, args.address, progress)
        workers = args.workers or max(1, available_cores() // args.cores)
        return run_locally(requests, min(workers, len(left)), progress)


@contextmanager
def study_progress(runs: Sequence[Run], console: Console | None = None) -> Iterator[Watch]:
    """Give the function that shows how many runs are in which state, and the steps evaluated."""
    console, before = console or Console(), ""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    bars = Progress(*columns, TimeRemainingColumn(), console=console,
                    disable=not console.is_terminal, speed_estimate_period=7200.0)  # fmt: skip
    task = bars.add_task("", total=sum(run.config["timesteps"] for run in runs))

    def watch(results: dict[str, RunResult]) -> None:
        nonlocal before
        states = [results[r.name].state if r.name in results else run_state(r) for r in runs]
        counts = sorted(Counter(states).items())
        line = ", ".join(f"{count} {state}" for state, count in counts)
        bars.update(task, completed=sum(map(_steps, runs)), description=line)
        if line != before and not console.is_terminal:
            console.print(line, highlight=False, soft_wrap=True)
        before = line

    with bars:
        yield watch


def _steps(run: Run) -> int:
    """Return the steps of a run's last evaluation."""
    if is_finished(run.folder):
        return int(run.config["timesteps"])
    with suppress(ValueError, IndexError):  # a damaged file is the report's to name
        return int(read_evaluations(run.folder)[-1]["steps"])
    return 0


if __name__ == "__main__":
    sys.exit(main())
