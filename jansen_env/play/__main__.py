"""Walk a robot by hand, in a window or on a page of this machine: ``python -m jansen_env.play``."""

from __future__ import annotations

import argparse
from importlib.util import find_spec

from jansen_env.play.session import BY_HAND, ENVIRONMENTS, ROBOTS, TERRAINS, Session
from jansen_env.policies import pretrained
from jansen_env.terrain.generators import HIGHEST

PORT = 8765
NEEDED = {True: "websockets", False: "pygame_gui"}  # on a page, in a window


def parser() -> argparse.ArgumentParser:
    """The command line."""
    policies = sorted({name for env_id in ENVIRONMENTS for name in pretrained.names(env_id)})
    found = argparse.ArgumentParser(prog="python -m jansen_env.play", description=__doc__)
    add = found.add_argument
    add("--env", default=ENVIRONMENTS[0], choices=ENVIRONMENTS,
        help=f"environment id; default: {ENVIRONMENTS[0]}")  # fmt: skip
    add("--robot", choices=ROBOTS, help="default: the environment's")
    add("--terrain", choices=TERRAINS, help="default: the environment's")
    add("--level", type=int, default=0, help=f"of the terrain, 0 (default) to {HIGHEST}")
    add("--policy", choices=policies,
        help="let this policy walk at your command; default: your input is the torque")  # fmt: skip
    add("--seed", type=int, default=0, help="another number, another start and ground")
    add("--web", action="store_true", help="serve a page on 127.0.0.1 in place of a window")
    add("--port", type=int, help=f"of the page; default: {PORT}, 0 for any that is free")
    return found


def main(arguments: list[str] | None = None) -> None:
    """Play until the user closes the window, or ends the program."""
    command_line = parser()
    args = command_line.parse_args(arguments)
    if args.port is not None and not args.web:
        command_line.error("--port is given without --web, must be with it")
    if args.port is not None and not 0 <= args.port < 2**16:
        command_line.error(f"--port is {args.port}, must be from 0 to {2**16 - 1}")
    if find_spec(missing := NEEDED[args.web]) is None:
        raise SystemExit(
            f"this needs {missing}, which the extra 'play' installs: "
            'python -m pip install "jansen-env[play]", or in a checkout -e ".[play]"'
        )
    try:
        session = Session(
            args.env, args.robot, args.terrain, args.level, args.policy or BY_HAND, args.seed
        )
    except ValueError as error:
        command_line.error(str(error))
    if args.web:
        import asyncio

        from jansen_env.play.server import serve

        def tell(address: str) -> None:
            print(f"{address}\nOpen this in a browser on this machine; Ctrl+C ends it.", flush=True)

        port = PORT if args.port is None else args.port
        try:
            asyncio.run(serve(session, port, tell))
        except OSError as error:
            command_line.error(f"--port is {port}, must be one that can be used: {error.strerror}")
    else:
        from jansen_env.play.window import play

        try:
            play(session)
        except RuntimeError as error:
            raise SystemExit(f"{error}; --web needs no display") from None


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
