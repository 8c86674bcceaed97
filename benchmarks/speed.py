"""Measure the speed of the environments and compare it with other environments.

Run the benchmark as follows. It writes ``speed.md``.

    python -m benchmarks.speed [--only PART ...] [--rounds 7] [--out logs/speed] [--quick]

There are three parts: ``one`` measures single environments, ``many`` measures batches, and
``worlds`` measures batches of harder environments.
"""

import importlib.util
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import distributions
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias, cast

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from tabulate import tabulate

import jansen_env
from jansen_env import ROBOTS, Robot, Terrain, paper_robot
from jansen_env.cli.flags import Parser, path_flag, whole
from jansen_env.cli.process import run
from jansen_env.files import check_writable, write_text
from jansen_env.plants.threads import available_cores
from jansen_env.terrain.generators import make_generator

PACKAGES = "box2d", "envpool", "gymnasium", "mujoco", "numpy", "pymunk"
OURS, MUJOCO, BOX2D = "JansenWalker-v0", "Walker2d-v5", "BipedalWalker-v3"
REAL = "motor, bearings, feet"
SEGMENTS = 100  # number of segments of the rough ground, each 20 cm long
# Number of robots in the comparisons, and terrain level of the rough ground.
AT_ONCE, LEVEL = 256, 3
COUNTS = (1, 4, 16, 64, AT_ONCE, 1024, 4096, 16_384)
ROUNDS = 7
FEWEST, MOST = 16, 5000  # smallest and largest number of vector steps per round
# Shortest and longest time limit of the robots in a batch, in control steps; the mean is 500.
LIMITS = 250, 750
SCALES = ("mass_scale", "inertia_scale", "damping_scale", "motor_strength")
RANDOMISED: dict[str, tuple[float, float]] = {
    "friction": (0.4, 1.0), "restitution": (0.0, 0.3), "payload": (0.0, 0.5),
    "payload_x": (-0.1, 0.1), "payload_y": (-0.1, 0.1), "tilt": (-0.05, 0.05),
    "delay": (0.0, 0.04), **dict.fromkeys(SCALES, (0.9, 1.1)),
}  # fmt: skip

Play: TypeAlias = Callable[[], float]
"""Function that takes all actions of a round and returns the rate in environment steps per second.

A reset of a robot in a batch counts as a step."""


def single(env_id: str, steps: int, **arguments: Any) -> Play:
    """Return a function that takes random actions in a single environment; see :data:`Play`.

    Every round begins with the same initial state.

    Args:
        env_id: Id of the environment.
        steps: Number of steps per round.
        **arguments: Arguments of the environment.
    """
    env = gym.make(env_id, **arguments)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(steps)]

    def play() -> float:
        env.reset(seed=0)
        start = time.perf_counter()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return steps / (time.perf_counter() - start)

    return play


def many(venv: Any, count: int, space: Box, steps: int, first: int = 0) -> Play:
    """Return a function that takes random actions in a vector environment; see :data:`Play`.

    Each round continues where the previous round ended.

    Args:
        venv: Vector environment that has been reset.
        count: Number of environments in it.
        space: Action space of one environment.
        steps: Number of vector steps per round.
        first: Number of vector steps to take before the first round.
    """
    shape = steps, count, *space.shape
    drawn = np.random.default_rng(0).uniform(space.low, space.high, shape)
    actions = list(drawn.astype(space.low.dtype))
    for number in range(first):
        venv.step(actions[number % steps])

    def play() -> float:
        start = time.perf_counter()
        for action in actions:
            venv.step(action)
        return count * steps / (time.perf_counter() - start)

    return play


def robots(count: int, robot_steps: int, env_id: str = OURS, **arguments: Any) -> Play:
    """Return a function that takes random actions in a batch of robots; see :data:`Play`.

    ``gym.make_vec`` makes the batch. The time limits differ between the robots, so that the ends of
    the episodes are spread evenly over time, as in a long run.

    Args:
        count: Number of robots.
        robot_steps: Number of steps per round, summed over all robots.
        env_id: Id of the environment.
        **arguments: Arguments of the environment.
    """
    first, last = LIMITS
    limits = [first + round((last - first) * (i + 0.5) / count) for i in range(count)]
    venv = gym.make_vec(env_id, num_envs=count, max_episode_steps=limits, **arguments)
    venv.reset(seed=0)
    steps = min(max(FEWEST, robot_steps // count), MOST)
    return many(venv, count, cast(Box, venv.single_action_space), steps, first)


def envpool(count: int, threads: int, steps: int) -> Play:
    """Return a function that takes random actions in envpool's ``Walker2d-v5``; see :data:`Play`.

    The episodes last about 25 steps.

    Args:
        count: Number of environments.
        threads: Number of threads.
        steps: Number of vector steps per round.
    """
    from envpool import make_gymnasium

    venv = make_gymnasium(MUJOCO, num_envs=count, num_threads=threads, seed=0)
    venv.reset()
    return many(venv, count, venv.action_space, steps)


def rough_ground() -> Terrain:
    """Return rough ground around x = 0 with slopes of at most 10 %."""
    length = 0.2 * (SEGMENTS - 2.5)
    return Terrain.rough(np.random.default_rng(0), 0.02, 0.2, length, -0.5 * length)


def real_robot() -> Robot:
    """Return the paper's links with the motor, dry bearings and compliant feet of ``built``."""
    built = ROBOTS["built"]()
    names = ("motor", "bearing_friction", "pad_compliance")
    return replace(paper_robot(), **{name: getattr(built, name) for name in names})


def one_environment(quick: bool) -> dict[str, Play]:
    """Return the contestants of the comparison of ``gym.make`` with other environments.

    The rates include wrappers and resets. The actions are random.

    Args:
        quick: Whether to take only a few steps.
    """
    steps = 200 if quick else 5000
    return {
        MUJOCO: single(MUJOCO, steps),
        f"{OURS}, flat": single(OURS, steps),
        f"{OURS}, rough": single(OURS, steps, terrain=rough_ground()),
        f"{OURS}, {REAL}": single(OURS, steps, robot=real_robot()),
        BOX2D: single(BOX2D, steps),
    }


def many_environments(quick: bool) -> dict[str, Play]:
    """Return the contestants of the comparison of ``gym.make_vec`` with other environments.

    The others are a single environment and, if envpool is installed, a batch of environments.

    Args:
        quick: Whether to take only a few steps.
    """
    counts, count, steps = ((1, 2, 4), 4, 100) if quick else (COUNTS, AT_ONCE, 60_000)
    plays = {f"1, {MUJOCO}": single(MUJOCO, 200 if quick else 5000)}
    compared: list[tuple[int, str, dict[str, Any]]] = [
        *((n, "flat", {}) for n in counts),
        (count, "rough", {"terrain": rough_ground()}),
        (count, REAL, {"robot": real_robot()}),
        (count, "no information requested", {"info_keys": ()}),
        (count, "the same on one thread", {"info_keys": (), "threads": 1}),
    ]
    plays |= {f"{n}, {name}": robots(n, steps, **given) for n, name, given in compared}
    for threads in sorted({1, available_cores()}) if importlib.util.find_spec("envpool") else ():
        name = f"{count}, envpool {MUJOCO}, {threads} thread{'s' * (threads > 1)}"
        plays[name] = envpool(count, threads, 16 if quick else 100)
    return plays


def harder_environments(quick: bool) -> dict[str, Play]:
    """Return the contestants of the comparison of harder environments with flat ground.

    All batches have the same number of robots.

    Args:
        quick: Whether to take only a few steps.
    """
    draw = make_generator("rough")
    assert draw is not None
    hardcore, rough = "JansenWalkerHardcore-v0", "JansenWalkerRough-v0"
    presets: dict[str, dict[str, Any]] = {
        "flat": {},
        "one rough ground for all episodes": {"terrain": draw(np.random.default_rng(0), LEVEL)},
        "a new rough ground at each reset": {"terrain": "rough", "terrain_level": LEVEL},
        "with a height scan": {"height_scan": (0.5, 0.9, 15)},
        "all parameters randomised": {"randomize": RANDOMISED},
        "the built robot, flat": {"robot": "built"},
        rough: {"env_id": rough},
        hardcore: {"env_id": hardcore},
    }
    steps = 2_000 if quick else 60_000
    return {f"{AT_ONCE}, {n}": robots(AT_ONCE, steps, **given) for n, given in presets.items()}


PARTS = {"one": one_environment, "many": many_environments, "worlds": harder_environments}


def take_turns(plays: dict[str, Play], rounds: int) -> dict[str, list[float]]:
    """Measure all contestants in turns, after a warm-up.

    Every second round has the reverse order.

    Args:
        plays: Contestants by name.
        rounds: Number of rounds.

    Returns:
        Rates of each contestant, in steps per second, one per round.
    """
    rates: dict[str, list[float]] = {name: [] for name in plays}
    for play in plays.values():
        play()
    for number in range(rounds):
        for name in list(plays) if number % 2 == 0 else reversed(list(plays)):
            rates[name].append(plays[name]())
    return rates


def rate_table(rates: Mapping[str, Sequence[float]]) -> str:
    """Return a table of the median, lowest and highest rate of each contestant.

    The last column is the median divided by the median of the first contestant.

    Args:
        rates: Rates by contestant.
    """
    middle = {name: median(series) for name, series in rates.items()}
    first = next(iter(middle))
    rows = [
        (
            name,
            *(f"{rate:,.0f}" for rate in (middle[name], min(series), max(series))),
            f"{middle[name] / middle[first]:.2f}",
        )
        for name, series in rates.items()
    ]
    head = ("", "steps/s", "lowest", "highest", f"/ {first}")
    align = ("left", *["right"] * 4)
    return tabulate(rows, head, tablefmt="pipe", disable_numparse=True, colalign=align)


def machine() -> str:
    """Return a description of the processor, its cores, the load and the versions of packages."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    parts = [next(iter(names), platform.machine()), f"{available_cores()} cores"]
    if hasattr(os, "getloadavg"):
        parts.append(f"load average {os.getloadavg()[0]:.2f} at the start")
    versions = {"jansen_env": jansen_env.__version__, "Python": platform.python_version()}
    installed = {each.name.lower(): each.version for each in distributions()}
    versions |= {name: installed[name] for name in PACKAGES if name in installed}
    return f"{', '.join(parts)}; {', '.join(f'{n} {number}' for n, number in versions.items())}."


def main(arguments: list[str] | None = None) -> None:
    """Measure the speeds and write the tables."""
    parser = Parser(
        "python -m benchmarks.speed", __doc__, "python -m benchmarks.speed --quick --out logs/tried"
    )
    add = parser.add_argument
    add(
        "--only",
        nargs="+",
        choices=PARTS,
        default=list(PARTS),
        metavar="PART",
        help=f"of {', '.join(PARTS)}; all without it",
    )
    add("--rounds", type=whole(most=1000), default=ROUNDS, metavar="N", help=f"({ROUNDS})")
    add(
        "--out",
        type=path_flag,
        default=Path("logs/speed"),
        metavar="DIR",
        help="folder for the table (logs/speed)",
    )
    add("--quick", action="store_true", help="try the program; proves nothing")
    args = parser.parse_args(arguments)
    with parser.refusing():
        check_writable("--out", args.out)
    rounds = 1 if args.quick else args.rounds
    parts = ["# Speed", f"{machine()} Medians of {rounds} rounds in turns."]
    for name in [name for name in PARTS if name in args.only]:
        print(f"{name} ...", file=sys.stderr, flush=True)
        title = PARTS[name].__name__.replace("_", " ").capitalize()
        parts += [f"## {title}", rate_table(take_turns(PARTS[name](args.quick), rounds))]
    text = "\n\n".join(parts) + "\n"
    write_text(args.out / "speed.md", text)
    print(text)


if __name__ == "__main__":
    run("python -m benchmarks.speed", main)
