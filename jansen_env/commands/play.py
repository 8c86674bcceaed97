"""Walk a robot on a page, by hand or by command: ``jansen-env play``."""

from __future__ import annotations

import argparse
import asyncio
import errno
from ipaddress import IPv4Address

from jansen_env.commands.flags import Parser
from jansen_env.play.session import BY_HAND, ENVIRONMENTS, ROBOTS, TERRAINS, Session
from jansen_env.policies import pretrained
from jansen_env.terrain.generators import HIGHEST
from jansen_env.viewer.web.bench import write_bench

PORT = 8765


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    policies = sorted({name for env_id in ENVIRONMENTS for name in pretrained.names(env_id)})
    parser = Parser("jansen-env play", "Walk a robot on a page, by hand or by command.",
                    "jansen-env play --env JansenWalkerRough-v0 --level 4",
                    "jansen-env play --robot klann --terrain stairs")  # fmt: skip
    add = parser.add_argument
    add("--env", default=ENVIRONMENTS[0], choices=ENVIRONMENTS,
        help=f"environment id; default: {ENVIRONMENTS[0]}")  # fmt: skip
    add("--robot", choices=ROBOTS, help="default: the environment's")
    add("--terrain", choices=TERRAINS, help="default: the environment's")
    add("--level", type=int, default=0, help=f"of the terrain, 0 (default) to {HIGHEST}")
    add("--policy", default=pretrained.DEFAULT, choices=(*policies, BY_HAND),
        help="walks at your speed command; default: the environment's "
        f"{pretrained.DEFAULT}; {BY_HAND}: you turn the crank")  # fmt: skip
    add("--seed", type=int, default=0, help="another number, another start and ground")
    add("--host", type=IPv4Address, default="127.0.0.1", metavar="ADDRESS",
        help="where the page is served; default: 127.0.0.1, this machine alone; 0.0.0.0: the "
        "network, for those who have the link")  # fmt: skip
    add("--port", type=int, default=PORT,
        help=f"of the page; default: {PORT}, 0 for any that is free")  # fmt: skip
    add("--bench-file", metavar="PATH",
        help="write the bench, the page to design on, as one HTML file, and end")  # fmt: skip
    args = parser.parse_args(arguments)
    if not 0 <= args.port < 2**16:
        parser.error(f"--port is {args.port}, must be from 0 to {2**16 - 1}")
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> None:
    """Serve the page until the user ends the program."""
    args = parse(arguments)
    with args.parser.refusing():
        if args.bench_file:
            print(write_bench(args.bench_file))
            return
        session = Session(args.env, args.robot, args.terrain, args.level, args.policy, args.seed)
    from jansen_env.play.server import serve

    def tell(address: str) -> None:
        where = "on this machine" if args.host.is_loopback else "in this network"
        print(f"{address}\nOpen this in a browser {where}; Ctrl+C ends it.", flush=True)

    try:
        asyncio.run(serve(session, args.port, tell, str(args.host)))
    except OSError as error:
        name = "port" if error.errno in (errno.EADDRINUSE, errno.EACCES) else "host"
        args.parser.error(
            f"--{name} is {getattr(args, name)}, must be one that can be used: "
            f"{error.strerror or error}"
        )
