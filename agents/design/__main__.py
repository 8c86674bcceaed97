"""Search for a walking linkage: ``python -m agents.design cost``.

The plan is a YAML file, or the name of a plan that comes with the package. If a search was stopped
or killed, repeat the same command: the search continues where it stopped.
"""

import argparse
import shlex
import sys
from dataclasses import asdict
from pathlib import Path

import yaml
from tqdm import tqdm

from agents.design.design_plan import PLANS, SearchPlan, make_plan, read_plan
from agents.design.design_report import REPORT, ROBOT, write_report
from agents.design.search import Journal, best_of, run_search
from jansen_env.cli.flags import Parser, mapping, path_flag, positive_int
from jansen_env.cli.process import run
from jansen_env.files import write_text
from jansen_env.files.plain_yaml import read_yaml
from jansen_env.robot.robot_file import read_robot, write_robot

PLAN = "plan.yml"


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line.

    Args:
        arguments: Arguments to parse. None selects those of the process.
    """
    shipped = ", ".join(sorted(path.stem for path in PLANS.glob("*.yml")))
    parser = Parser(
        "python -m agents.design",
        __doc__,
        "python -m agents.design cost",
        "python -m agents.design cost --speed 0.5 --seeds 3 --name fast",
    )
    add = parser.add_argument
    add("plan", metavar="PLAN", help=f"file of a plan, or one of: {shipped}")
    add("--name", help="name of the search; default: the name of the plan")
    add(
        "--log-folder",
        type=path_flag,
        default="logs/design",
        metavar="DIR",
        help="folder of all searches; a search is written to DIR/NAME; default: logs/design",
    )
    add(
        "--seeds",
        type=positive_int,
        help="number of searches, with seeds from 0; default: the number in the plan",
    )
    add(
        "--generations",
        type=positive_int,
        help="number of generations; default: the number in the plan",
    )
    add("--speed", type=float, help="commanded speed in m/s; default: the speed in the plan")
    add(
        "--variables",
        type=mapping,
        metavar="YAML",
        help="what the search varies; replaces the variables of the plan; '{harmonics: 4}', for "
        "example, varies the profile but not the link lengths",
    )
    add(
        "--limits",
        type=mapping,
        metavar="YAML",
        help="limits of measures, such as '{lift: [0.1, null]}'; they are added to the limits of "
        "the plan, or replace limits of the same measures",
    )
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> int:
    """Run the search and write its report; return the exit status.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = parse(arguments)
    with args.parser.refusing():
        plan = read_plan(args.plan)
        flags = "seeds", "generations", "speed", "variables"
        changes = {name: value for name in flags if (value := getattr(args, name)) is not None}
        limits = {**plan.limits, **(args.limits or {})}
        plan = make_plan({**asdict(plan), **changes, "limits": limits})
        folder = Path(args.log_folder) / (args.name or Path(args.plan).stem)
        enter(folder, plan)
        try:
            short = write_report(plan, folder, search_all(plan, folder))
        except KeyboardInterrupt:
            print(
                "\nstopped; to continue, repeat the command: python -m agents.design "
                f"{shlex.join(sys.argv[1:] if arguments is None else arguments)}"
            )
            return 130
    print(f"\n{short}\n\ncomplete report: {folder / REPORT}")
    return 0


def enter(folder: Path, plan: SearchPlan) -> None:
    """Create the folder of a search, or check that an existing folder belongs to this search.

    The number of generations and the number of seeds may differ from those of the existing search.

    Args:
        folder: Folder of the search.
        plan: Plan of the search.

    Raises:
        ValueError: If the folder holds another search. The message names the entries that differ.
    """
    path = folder / PLAN
    begin = folder / ROBOT
    robot = plan.space().base
    entries = asdict(plan)
    if path.is_file():
        there = asdict(make_plan(read_yaml(path)))
        may_differ = {"generations", "seeds"}
        differ = [name for name in entries if there[name] != entries[name]]
        # The name of the robot may be the same although its file has changed.
        if begin.exists() and read_robot(begin) != robot:
            differ.append("robot")
        if differ := sorted({*differ} - may_differ):
            raise ValueError(
                f"{folder} contains another search, with a different {', '.join(differ)}; choose "
                "another --name"
            )
    write_robot(begin, robot)
    write_text(path, yaml.safe_dump(entries, sort_keys=False))


def search_all(plan: SearchPlan, folder: Path) -> dict[str, Journal]:
    """Run the search for every seed and show a progress bar that counts generations.

    Args:
        plan: Plan of the search.
        folder: Folder of the search. The search with seed N writes into the subfolder ``seed_N``.

    Returns:
        The journal of each seed, keyed by ``seed_N``.
    """
    name = next(iter(plan.objectives))

    def show(journal: Journal) -> None:
        """Advance the progress bar by a generation and show the best candidate so far."""
        allowed = journal["violation"] == 0.0
        value = f"{journal[name][best_of(plan, journal)]:.4g}" if allowed.any() else "none yet"
        bar.set_postfix_str(
            f"{allowed[-plan.population :].sum()} of {plan.population} keep all limits, "
            f"best {name}: {value}"
        )
        bar.update()

    with tqdm(total=plan.seeds * plan.generations, unit="generation") as bar:
        return {
            f"seed_{seed}": run_search(plan, seed, folder / f"seed_{seed}", show)
            for seed in range(plan.seeds)
        }


if __name__ == "__main__":
    run("python -m agents.design", main)
