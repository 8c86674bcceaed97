"""Compare walks of this machine with the published ones, bit for bit: ``jansen-env verify``."""

import argparse

from jansen_env.checks import invalid, listed
from jansen_env.cli.flags import Parser
from jansen_env.cli.progress import progress
from jansen_env.scoring.walk_hashes import ROBOTS, STEPS, WALKS, published_hashes, walk_hashes


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = Parser(
        "jansen-env verify",
        "Compare walks that this machine simulates with the published ones, bit for bit.",
        "jansen-env verify",
        "jansen-env verify --walk built --walk rough",
    )
    parser.add_argument(
        "--walk",
        action="append",
        metavar="NAME",
        help=f"one of the walks {', '.join(WALKS)}; repeat the flag for several walks; default: "
        "all walks",
    )
    args = parser.parse_args(arguments)
    for name in args.walk or ():
        if name not in WALKS:
            parser.error(str(invalid("--walk", name, f"one of {listed(WALKS, name)}")))
    return args


def main(arguments: list[str] | None = None) -> None:
    """Simulate walks, and print the hash of each walk next to the published one.

    Args:
        arguments: Arguments of the command. None selects those of the process.

    Raises:
        SystemExit: With status 1 if a hash differs from the published one.
    """
    names = list(dict.fromkeys(parse(arguments).walk or WALKS))
    published = published_hashes()
    equal = 0
    print(f"walks of {STEPS} steps, of one robot and of a batch of {ROBOTS}\n")
    print(f"{'walk':<26} {'robots':>6}  {'this machine':<16}  {'published':<16}")
    with progress("walking", len(names)) as advance:
        for name in names:
            found = walk_hashes(name)
            for robots, ours, theirs in zip((1, ROBOTS), found, published[name], strict=True):
                differs = "" if ours == theirs else "  DIFFERS"
                print(f"{name:<26} {robots:>6}  {ours}  {theirs}{differs}", flush=True)
            equal += found == published[name]
            advance(1.0)
    print(f"\n{equal} of {len(names)} walks equal bit for bit")
    if equal < len(names):
        raise SystemExit(1)
