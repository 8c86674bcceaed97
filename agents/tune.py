"""Make the baselines' data: ``python -m agents.tune [pid] [constant]``.

Walking speeds are measured on the robot ``--robot``, at many crank speeds and torques.
"""

import json
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np

from jansen_env.arrays import Array
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import Controlled
from jansen_env.checks import listed
from jansen_env.commands.flags import Parser, positive_int
from jansen_env.files import check_writable, write_json
from jansen_env.robot import ROBOTS
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking import walker_benchmark as walker

Measured: TypeAlias = dict[str, list[float] | list[list[float]]]

ENV = "JansenWalker-v0"  # harder worlds take the numbers of their robot
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
PAPER = (10.0, 1.0, 1.0)  # kp, ki, kd of the paper's PID
GAINS = (PAPER, *((kp, ki, kd) for kp in (1.0, 2.0, 3.0, 5.0, 10.0) for ki in (0.5, 2.0)
                  for kd in (0.2, 0.5, 1.0)))  # fmt: skip
MEASURED = ("pid", "constant")
FIRST_SEED = 10_000  # apart from all others
HORIZON = 10.0  # s, the time limit of an episode


def measure(
    name: str, settings: Array, episodes: int, robot: str = "paper",
    gains: tuple[float, ...] = PAPER,
) -> Measured:  # fmt: skip
    """Measure walking speeds, m/s, of each crank speed ("pid") or torque ("constant")."""
    kwargs = {"robot": robot}
    env = cast("Controlled", make_env(ENV, kwargs).unwrapped)
    each = np.repeat(settings, episodes)
    commands, seeds = np.full(len(each), 0.3), FIRST_SEED + np.arange(len(each)) % episodes
    policy = (walker.walking_pid(lambda _: each, env, PID(*gains)) if name == "pid"
              else walker.constant_torque(lambda _: each, env))  # fmt: skip
    run = run_episodes(policy, ENV, kwargs, commands, seeds, at_once=len(each))
    speeds = (run["distance"] / HORIZON).reshape(-1, episodes)
    return {"settings": settings.tolist(), "speeds": speeds.round(4).tolist()}


def measure_pid(episodes: int, robot: str) -> Measured:
    """Measure the PID at :data:`CRANK_SPEEDS` with the paper's gains, or on another robot with
    those :data:`GAINS` whose mean return over the benchmark's commands is best, on other starts."""
    kwargs = {"robot": robot}
    env = cast("Controlled", make_env(ENV, kwargs).unwrapped)
    commands = np.repeat(find_benchmark(ENV).commands, episodes)
    seeds = FIRST_SEED + episodes + np.arange(len(commands)) % episodes
    best, made = -np.inf, Measured()
    for gains in (PAPER,) if robot == "paper" else GAINS:
        measured = measure("pid", CRANK_SPEEDS, episodes, robot, gains)
        numbers = (np.array(measured[name]) for name in ("settings", "speeds"))
        policy = walker.walking_pid(walker.nearest_setting(*numbers), env, PID(*gains))
        mean = run_episodes(policy, ENV, kwargs, commands, seeds)["returns"].mean()
        print(f"gains {gains}: return {mean:.1f}", flush=True)
        if mean > best:
            best, made = mean, {"gains": list(gains), **measured}
    return made


def main(arguments: list[str] | None = None) -> None:
    """Measure the named baselines' numbers."""
    parser = Parser("python -m agents.tune", "Make the baselines' data.",
                    "python -m agents.tune pid constant")  # fmt: skip
    add = parser.add_argument
    add("baselines", nargs="*", metavar="NAME", help="of pid, constant; default: both")
    add("--robot", default="paper", choices=sorted(ROBOTS), help="which; default: %(default)s")
    add("--episodes", type=positive_int, default=6, help="per crank speed and torque measured")
    add("--out", type=Path, default=walker.DATA.parent, metavar="DIR", help="folder to write to")
    args = parser.parse_args(arguments)
    for name in args.baselines:
        if name not in MEASURED:
            parser.error(f"baseline is {name!r}, must be one of {listed(MEASURED, name)}")
    with parser.refusing():
        check_writable("--out", args.out)
    path = args.out / walker.DATA.name
    for name in args.baselines or MEASURED:
        made = (measure_pid(args.episodes, args.robot) if name == "pid"
                else measure(name, TORQUES, args.episodes, args.robot))  # fmt: skip
        command = f"python -m agents.tune {name} --robot {args.robot} --episodes {args.episodes}"
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        entry = {**kept.get(args.robot, {}), name: {"command": command, **made}}
        write_json(path, {**kept, args.robot: entry})  # other robots' numbers stay
        print(f"written: {path}")


if __name__ == "__main__":
    main()
