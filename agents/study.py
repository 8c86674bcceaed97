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
from dataclasses import replace
from pathlib import Path
from typing import Any

from agents.command_line import mapping, non_negative_int, positive_int
from agents.config import HYPERPARAMETERS
from agents.hyperparameter_search import read_space, search, search_report
from agents.study_backends import has_ray, run_locally, run_on_ray
from agents.study_plan import DEFAULTS, Study, enter, make_study, read_plan, read_study
from agents.study_progress import Progress
from agents.study_report import write_report
from agents.study_runs import TOKEN, Order, Outcome, is_finished
from agents.tasks import DEFAULT, TASKS
from jansen_env.cores import available_cores
from jansen_env.files import write_text

FLAGS = ("seeds", "envs", "algos", "timesteps", "n_envs", "env_kwargs", "config", "eval_freq",
         "save_freq", "eval_episodes")  # fmt: skip
"""Of the command line, what describes a study; named as in its file."""

DISTRIBUTED = ", which the extra 'distributed' installs: pip install \"jansen-env[distributed]\""


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Flags; those of a run are named as in train.py."""
    parser = argparse.ArgumentParser(description=__doc__)
    add, count, steps = parser.add_argument, positive_int, non_negative_int
    add("study", nargs="?", metavar="FILE", help="the study as YAML, in place of flags")
    add("--seeds", type=count, help=f"runs of each kind, with seeds from 0; default: "
        f"{DEFAULTS['seeds']}")  # fmt: skip
    add("--env", dest="envs", nargs="+", choices=sorted(TASKS),
        help=f"environment ids; default: {DEFAULT}")  # fmt: skip
    add("--algo", dest="algos", nargs="+", choices=sorted(HYPERPARAMETERS),
        help="algorithms; default: ppo")  # fmt: skip
    add("-n", "--timesteps", type=count, help="environment steps of a run")
    add("--n-envs", type=count, help="environments side by side in a run")
    add("--env-kwargs", type=mapping, metavar="YAML",
        help="arguments of the environments, e.g. '{friction: 0.5}'")  # fmt: skip
    add("--config", metavar="FILE", help="hyperparameters; default: agents/configs/ENV/ALGO.yml")
    add(
        "--eval-freq",
        type=steps,
        help="steps between evaluations; default: a 16th of the timesteps",
    )
    add("--save-freq", type=steps, help="steps between checkpoints; default: 100000")
    add("--eval-episodes", type=count, help="episodes per command of the scores; default: 10")
    add("--name", help="of the study; default: the file's, or else 'study'")
    add("--log-folder", default="logs/studies", metavar="DIR", help="the study goes to DIR/NAME")
    add("--cores", type=count, default=1, help="of each run, for its environments; default: 1")
    add("--local", action="store_true", help="processes of this machine, though Ray is installed")
    add("--workers", type=count, help="runs at once, without Ray; default: as the cores allow")
    add("--address", help="of the Ray cluster to join, or 'auto'; default: one of this machine's")
    add(
        "--tune",
        metavar="SPACE",
        help="search this space of hyperparameters (YAML) by Ray Tune's "
        "ASHA, which stops what is hopeless, in place of running seeds",
    )
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
    if args.tune and (args.local or not has_ray()):
        parser.error(f"--tune needs Ray{DISTRIBUTED}")
    if args.address and not has_ray():
        parser.error(f"--address needs Ray{DISTRIBUTED}")
    return args


def main(arguments: list[str] | None = None) -> int:
    """Run what is not finished, report; returns the exit status: 1 where runs have failed."""
    args = parse(arguments)
    if args.report:
        folder = Path(args.report)
        try:
            print(write_report(read_study(folder), folder))
        except ValueError as error:
            args.error(str(error))
        return 0
    given = sys.argv[1:] if arguments is None else arguments
    args.command = shlex.join(["python", "-m", "agents.study", *given])
    study, folder = _begin(args)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    try:
        outcomes = (_search if args.tune else _run)(study, folder, args)
        if not args.tune:
            print(f"\n{write_report(study, folder)}\n\n{folder}/report.md, report.json, runs.csv")
    except (ConnectionError, ValueError) as error:
        args.error(" ".join(str(error).split()))
    states = {outcome.state for outcome in outcomes.values()}
    if "stopped" in states:
        print("stopped; the same command goes on from the last checkpoints")
        return 130
    return int(not states <= {"finished", "stopped early"})


def _begin(args: argparse.Namespace) -> tuple[Study, Path]:
    """The study asked for and its folder, both known to be good."""
    name = args.name or (Path(args.study).stem if args.study else "study")
    folder = Path(args.log_folder).resolve() / name
    try:
        if args.study:
            study = make_study(read_plan(args.study), args.study)
        else:
            plan = {flag: getattr(args, flag) for flag in FLAGS}
            study = make_study({k: v for k, v in plan.items() if v is not None})
        for group, config in study.groups.items():
            _check_buildable(group, config)
        if args.tune:
            if len(study.groups) != 1:
                raise ValueError(
                    f"--tune takes one environment and algorithm, not {len(study.groups)}"
                )
            study = replace(study, seeds=study.seeds[:1])
            read_space(args.tune, study.runs(folder)[0].config)
        enter(folder, study)
    except (OSError, ValueError) as error:
        args.error(str(error))
    return study, folder


def _check_buildable(group: str, config: dict[str, Any]) -> None:
    """Build a group's model once.

    Raises:
        ValueError: its environments or its model cannot be made so.
    """
    from agents.training import prepare

    try:
        model = prepare({**config, "seed": 0})
    except ValueError as error:
        raise ValueError(f"{group}: {error}") from error
    env = model.get_env()
    assert env is not None
    env.close()


def _orders(study: Study, folder: Path, args: argparse.Namespace) -> list[Order]:
    """An order for each run of a study."""
    token = folder / TOKEN
    if not token.is_file():
        write_text(token, uuid.uuid4().hex)
    common = (study.eval_freq, study.save_freq, study.eval_episodes, args.cores, args.command)
    return [Order(run, *common, token.read_text(encoding="utf-8")) for run in study.runs(folder)]


def _run(study: Study, folder: Path, args: argparse.Namespace) -> dict[str, Outcome]:
    """Perform the runs that are not finished; how they ended."""
    every = _orders(study, folder, args)
    orders = [order for order in every if not is_finished(order.run.folder)]
    local = args.local or not has_ray()
    place = "local processes" if local else f"Ray at {args.address or 'this machine'}"
    print(f"{len(every)} runs, {len(every) - len(orders)} finished, {len(orders)} to do on {place} "
          f"-> {folder}", flush=True)  # fmt: skip
    if not orders:
        return {}
    with Progress([order.run for order in every]) as progress:
        if not local:
            return run_on_ray(orders, args.address, progress)
        workers = args.workers or max(1, available_cores() // args.cores)
        return run_locally(orders, min(workers, len(orders)), progress)


def _search(study: Study, folder: Path, args: argparse.Namespace) -> dict[str, Outcome]:
    """Search a space of hyperparameters around the study's one group; how the trials ended."""
    order = _orders(study, folder, args)[0]
    space = read_space(args.tune, order.run.config)
    print(f"{space['trials']} trials on Ray at {args.address or 'this machine'} -> {folder}")
    outcomes = search(order, space, args.address)
    print(f"\n{search_report(folder, space)}")
    return outcomes


if __name__ == "__main__":
    sys.exit(main())
