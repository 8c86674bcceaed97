"""Write the page on which robots walk, and open it: ``jansen-env play``."""

import argparse
import re
import tempfile
import webbrowser
from pathlib import Path
from urllib.parse import urlencode

from jansen_env.checks import one_of, whole_number
from jansen_env.cli.flags import Parser, path_flag
from jansen_env.policies import pretrained
from jansen_env.robot import ROBOTS, Robot, named_robot
from jansen_env.robot.robot_file import read_robot
from jansen_env.robot.soundness import check_loaded
from jansen_env.terrain.generators import GENERATORS, HIGHEST
from jansen_env.viewer.web.bench import write_bench
from jansen_env.viewer.web.walk import write_walk
from jansen_env.viewer.web.walk_data import (
    CONTROLLERS,
    ENVIRONMENTS,
    MOST_SEED,
    check_page_robot,
    controller_name,
    page_policies,
)

FLAT = "flat"


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    policies = sorted({name for env_id in ENVIRONMENTS for name in page_policies(env_id)})
    parser = Parser(
        "jansen-env play",
        "Write the page on which robots walk, and open it.",
        "jansen-env play --env JansenWalkerRough-v0 --level 4",
        "jansen-env play --robot klann --policy hand --terrain stairs",
    )
    add = parser.add_argument
    add(
        "--env",
        default=ENVIRONMENTS[0],
        choices=ENVIRONMENTS,
        help="environment whose robot, terrain and policy the page shows at first; default: "
        f"{ENVIRONMENTS[0]}",
    )
    add(
        "--robot",
        metavar="NAME|FILE",
        help=f"one of {', '.join(sorted(ROBOTS))}, one of these with a number of legs, such as "
        "built:12, or a robot file; default: the robot of the environment",
    )
    add(
        "--terrain",
        choices=(FLAT, *GENERATORS),
        help="kind of terrain; default: the terrain of the environment",
    )
    add(
        "--level",
        type=int,
        default=0,
        help=f"level of the terrain, from 0 to {HIGHEST}; default: 0",
    )
    add(
        "--policy",
        choices=(*policies, *CONTROLLERS),
        help="policy that follows your speed command, or 'hand' to turn the crank yourself; "
        f"default: the policy {pretrained.DEFAULT} of the environment or, with --robot, a policy "
        "for the robot, or else a constant crank speed",
    )
    add(
        "--seed",
        type=int,
        default=0,
        help="seed of the initial state and of generated terrain; default: 0",
    )
    add(
        "--out",
        type=path_flag,
        metavar="FOLDER",
        help="folder to which the pages are written; default: a temporary folder",
    )
    add("--bench", action="store_true", help="open the bench, the page for designing legs")
    add("--no-open", action="store_true", help="do not open a browser")
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def robot_of(name: str | None) -> tuple[str | None, dict[str, Robot]]:
    """Return the name of a robot on the page, and all robots of the page by name.

    The robots are the built-in designs and, if ``name`` is not one of these, the robot it selects.

    Args:
        name: Name of a robot, or path of a robot file. None selects the robot of the environment.

    Raises:
        ValueError: If ``name`` is neither a name nor a robot file, or if the robot cannot walk.
    """
    robots = {known: make() for known, make in ROBOTS.items()}
    if name is None or name in robots:
        return name, robots
    robot = read_robot(name) if Path(name).suffix == ".json" else named_robot(name, "--robot")
    word = re.sub(r"[^\w-]+", "_", Path(name).stem)
    while word in robots:
        word += "_"
    robots[word] = check_loaded("--robot", check_page_robot(robot))
    return word, robots


def start_of(args: argparse.Namespace, robot: str | None = None) -> dict[str, object]:
    """Return the initial choices on the page.

    Args:
        args: Parsed command line.
        robot: Name of the robot on the page. None selects the robot of the environment.

    Raises:
        ValueError: If a choice is out of range, or if two choices are incompatible.
    """
    defaults = pretrained.arguments_of(args.env)
    terrain = args.terrain or defaults["terrain"]
    if terrain == FLAT and args.level:
        raise ValueError(f"--level must be 0 on flat ground, got {args.level}")
    name = args.policy or (None if args.robot else pretrained.DEFAULT)
    if name not in (None, *CONTROLLERS):
        policy = one_of("--policy", name, page_policies(args.env))
        defaults |= pretrained.load(args.env, policy).env_kwargs
        name = controller_name(args.env, policy)
    start: dict[str, object] = {
        "robot": robot or defaults["robot"],
        "terrain": terrain,
        "level": whole_number("--level", args.level, HIGHEST),
        "seed": whole_number("--seed", args.seed, MOST_SEED),
    }
    return start if name is None else {**start, "control": name}


def main(arguments: list[str] | None = None) -> None:
    """Write the walking page and the bench, and open one of them.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = parse(arguments)
    with args.parser.refusing():
        name, robots = robot_of(args.robot)
        start = start_of(args, name)
        folder = Path(args.out or tempfile.mkdtemp(prefix="jansen_env-")).absolute()
        walk = write_walk(folder / "walk.html", urlencode(start), robots=robots)
        pages = walk, write_bench(folder / "bench.html", robots)
    print(*pages, sep="\n")
    if not args.no_open:
        webbrowser.open(pages[args.bench].as_uri())
