"""Search for a walking linkage: ``python -m agents.design cost``.

The plan is a YAML file, or the name of one that is shipped. Given again after it was stopped or
killed, the same command goes on where it was.
"""

from __future__ import annotations

import argparse
import multiprocessing
import shlex
import sys
from concurrent.futures import ProcessPoolExecutor, wait
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
import yaml
from tqdm import tqdm

from agents.design.design_plan import PLANS, Plan, make_plan, read_plan
from agents.design.design_report import REPORT, ROBOT, write_report
from agents.design.search import (
    JOURNAL,
    Measured,
    execute_search,
    load_policy,
    objectives_of,
    run_search,
)
from jansen_env.baselines.policy import Array
from jansen_env.commands.flags import Parser, mapping, positive_int
from jansen_env.cores import available_cores
from jansen_env.files import write_text
from jansen_env.plain_yaml import read_yaml
from jansen_env.robot.robot_file import read_robot, write_robot

PLAN = "plan.yml"


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    shipped = ", ".join(sorted(path.stem for path in PLANS.glob("*.yml")))
    parser = Parser("python -m agents.design", __doc__, "python -m agents.design cost",
                    "python -m agents.design cost --speed 0.5 --seeds 3 --name fast")  # fmt: skip
    add = parser.add_argument
    add("plan", nargs="?", metavar="PLAN", help=f"a file, or one of: {shipped}")
    add("--name", help="of the search; default: the plan's")
    add("--log-folder", default="logs/design", metavar="DIR", help="it goes to DIR/NAME")
    add("--seeds", type=positive_int, help="searches with seeds from 0; default: the plan's")
    add("--generations", type=positive_int, help="in place of the plan's")
    add("--speed", type=float, help="m/s, in place of the plan's")
    add("--variables", type=mapping, metavar="YAML",
        help="in place of the plan's, e.g. '{harmonics: 4}': the robot keeps its lengths"
        )  # fmt: skip
    add("--limits", type=mapping, metavar="YAML",
        help="beside the plan's, or in their place, e.g. '{lift: [0.1, null]}'")  # fmt: skip
    add("--workers", type=positive_int, help="searches at once; default: as the cores allow")
    add("--report", metavar="FOLDER", help="of a search: only write its report again")
    add("--all", action="store_true", help="print the whole report")
    args = parser.parse_args(arguments)
    args.error = parser.error
    if (args.plan is None) == (args.report is None):
        parser.error("a PLAN or --report FOLDER is needed, and one of them alone")
    return args


def main(arguments: list[str] | None = None) -> int:
    """Search, and report; returns the exit status."""
    args = parse(arguments)
    try:
        if args.report:
            folder = Path(args.report)
            report(make_plan(read_yaml(folder / PLAN)), folder, args.all)
            return 0
        plan = read_plan(args.plan)
        flags = "seeds", "generations", "speed", "variables"
        changes = {name: value for name in flags if (value := getattr(args, name)) is not None}
        limits = {**plan.limits, **(args.limits or {})}
        plan = make_plan({**asdict(plan), **changes, "limits": limits})
        folder = Path(args.log_folder) / (args.name or Path(args.plan).stem)
        enter(folder, plan)
        failed = search_all(plan, folder, args)
        report(plan, folder, args.all)
    except (OSError, ValueError) as error:
        args.error(" ".join(str(error).split()))
    except KeyboardInterrupt:
        print(f"\nstopped; the same command goes on: python -m agents.design "
              f"{shlex.join(sys.argv[1:] if arguments is None else arguments)}")  # fmt: skip
        return 130
    return int(failed)


def report(plan: Plan, folder: Path, everything: bool) -> None:
    """Write a search's report; print the start and the best design, or everything."""
    short, path = write_report(plan, folder, load_policy(plan)), folder / REPORT
    print(f"\n{path.read_text(encoding='utf-8') if everything else short}\n\nall: {path}")


def enter(folder: Path, plan: Plan) -> None:
    """Make a search's folder, or check that it is this one's, but for generations and seeds.

    Raises:
        ValueError: it holds another search; says what differs.
    """
    path, begin = folder / PLAN, folder / ROBOT
    robot = plan.space().base
    if path.is_file():
        there = make_plan(read_yaml(path))
        names = [f.name for f in fields(Plan)]
        other = [name for name in names if getattr(there, name) != getattr(plan, name)]
        differ = [name for name in other if name not in ("generations", "seeds")]
        if begin.exists() and read_robot(begin) != robot and "robot" not in differ:
            differ.append("robot")  # a file that has changed
        if differ:
            raise ValueError(f"{folder} holds another search: {differ} differ; take another name")
    write_robot(begin, robot)
    write_text(path, yaml.safe_dump(asdict(plan), sort_keys=False))


def search_all(plan: Plan, folder: Path, args: argparse.Namespace) -> bool:
    """Run all seeds; returns whether one has failed."""
    if plan.seeds == 1:
        run_search(plan, 0, folder / "seed_0", load_policy(plan), Shown(plan))
        return False
    workers = min(args.workers or available_cores(), plan.seeds)
    spawn = multiprocessing.get_context("spawn")  # a process with threads must not be forked
    with (
        tqdm(total=plan.seeds * plan.generations) as bar,
        ProcessPoolExecutor(workers, spawn) as pool,
    ):
        searches = {
            f"seed_{seed}": pool.submit(execute_search, plan, seed, folder / f"seed_{seed}")
            for seed in range(plan.seeds)
        }
        while wait(searches.values(), 1.0).not_done:
            bar.n = sum(path.read_bytes().count(b"\n") for path in folder.glob(f"*/{JOURNAL}"))
            bar.refresh()
    failed = {name: error for name, search in searches.items() if (error := search.exception())}
    for name, error in failed.items():
        print(f"{name}: {type(error).__name__}: {error}")
    return bool(failed)


class Shown:
    """A bar of the generations, with the best so far and how many of the last keep all limits."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._best = plan, np.inf
        self._bar = tqdm(total=plan.generations, unit="generation")

    def __call__(self, number: int, measured: Measured, violation: Array) -> None:
        """Take a generation."""
        fine = objectives_of(self._plan, measured)[violation == 0.0, 0]
        self._best = min(self._best, fine.min(initial=np.inf))
        name, sense = next(iter(self._plan.objectives.items()))
        way = 1.0 if sense == "min" else -1.0
        best = f"{way * self._best:.4g}" if np.isfinite(self._best) else "none yet"
        self._bar.n = number + 1
        kept = f"{len(fine)} of {len(violation)} keep all limits"
        self._bar.set_postfix_str(f"{kept}, best {name}: {best}")


if __name__ == "__main__":
    sys.exit(main())
