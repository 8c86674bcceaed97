"""Show a policy in a window, or film it without a display: ``jansen-env enjoy``."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from itertools import chain
from pathlib import Path

from jansen_env.baselines.policy import Policy
from jansen_env.commands.film import (
    FRAME_TIME,
    Progress,
    check_suffix,
    film,
    play,
    save_video,
    stack,
)
from jansen_env.commands.flags import parse_policies, policy_parser, positive_int
from jansen_env.commands.named_policies import default_policy, label, load_all
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import Env
from jansen_env.scoring.rollout import make_env

INVISIBLE = ("dummy", "offscreen")  # SDL's drivers of invisible windows


def display() -> bool:
    """Return whether the environment variables name a visible display."""
    if os.environ.get("SDL_VIDEODRIVER") in INVISIBLE:
        return False
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def episode(
    policy: Policy, env: Env, args: argparse.Namespace, number: int, title: str | None = None
) -> Iterator[Progress]:
    """Play one episode with its command; print its outcome."""
    command = args.command[number % len(args.command)]
    for moment in play(policy, env, command, args.seed + number):
        yield moment
        if moment.steps == args.steps or env.get_wrapper_attr("window_closed"):
            break
    how = "failed" if moment.failed else "ended"
    seconds = moment.steps * env.get_wrapper_attr("control_dt")
    unit = find_benchmark(args.env).command_unit
    print(f"{title + ': ' if title else ''}command {command:g} {unit}: return "
          f"{moment.returned:.1f}, {how} after {seconds:.2f} s")  # fmt: skip


def episodes(policy: Policy, env: Env, args: argparse.Namespace) -> Iterator[Progress]:
    """Play episodes one after another until the window, if any, is closed."""
    for number in range(args.episodes):
        if not env.get_wrapper_attr("window_closed"):
            yield from episode(policy, env, args, number)


def show(policy: Policy, env: Env, args: argparse.Namespace) -> bool:
    """Play in a window until it is closed; return False at once if there is no display."""
    moments = episodes(policy, env, args)
    next(moments)
    if env.get_wrapper_attr("window_closed"):
        return False
    print(f"{label(args.policy[0])} on {args.env} in a window; close it to end", flush=True)
    for _ in moments:
        pass
    return True


def record(policies: dict[str, Policy], args: argparse.Namespace, path: Path) -> None:
    """Film the episodes; policies, by title, one above the other from the same starts."""
    with ExitStack() as made:
        shown: list[tuple[Env, Policy, str | None]] = [
            (made.enter_context(closing(make_env(args.env, args.env_kwargs,
                                                 render_mode="rgb_array"))),
             policy, title if len(policies) > 1 else None)
            for title, policy in policies.items()
        ]  # fmt: skip
        dt = shown[0][0].get_wrapper_attr("control_dt")
        every = max(1, round(FRAME_TIME[path.suffix] / dt))
        films = (
            stack([film(env, episode(policy, env, args, number, title), every, title)
                   for env, policy, title in shown])
            for number in range(args.episodes)
        )  # fmt: skip
        save_video(chain.from_iterable(films), path, every * dt)
    print(f"written: {path}")


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = policy_parser(
        "jansen-env enjoy",
        "Show a policy in a window, or film policies one above the other.",
        "jansen-env enjoy --env JansenWalkerRough-v0",
        "jansen-env enjoy --policy pretrained --policy pid --video both.mp4",
    )
    add = parser.add_argument
    add("--command", type=float, nargs="+", metavar="V",
        help="speed or goal of each episode in turn; default: the grid's middle")  # fmt: skip
    add("--episodes", type=positive_int, help="number of episodes; default: one for each command")
    add("--steps", type=positive_int, help="most steps of an episode; default: the environment's")
    add("--video", metavar="FILE", help="write a .gif or .mp4, in place of a window")
    args = parse_policies(parser, arguments, "--command")
    args.command = args.command or [find_benchmark(args.env).middle]
    args.episodes = args.episodes or len(args.command)
    args.policy = args.policy or [default_policy(args.env)]
    return args


def prepare(args: argparse.Namespace) -> dict[str, Policy]:
    """Return the policies by title; a ValueError names an argument that is not allowed."""
    if args.video is not None:
        check_suffix(args.video)
    ((policies, _),) = load_all(args, args.command)
    return policies


def main(arguments: list[str] | None = None) -> None:
    """Show a policy, or film it."""
    args = parse(arguments)
    with args.parser.refusing():
        policies = prepare(args)
    title, *others = policies
    if args.video is None and not others and display():
        with closing(make_env(args.env, args.env_kwargs, render_mode="human")) as env:
            if show(policies[title], env, args):
                return
    path = Path(args.video or f"{args.env}_{re.sub('[/ :]', '_', '_'.join(policies))}.mp4")
    why = "" if args.video or others else "no display to open a window on: "
    print(f"{why}filming {' and '.join(policies)} on {args.env} to {path} ...", flush=True)
    with args.parser.refusing():
        record(policies, args, path)
