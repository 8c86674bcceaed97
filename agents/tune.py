"""Measure the baselines' numbers of robots: ``python -m agents.tune pid constant steady profile``.

``pid``: walking speeds at many crank speeds, and the gains that return most. ``steady``: the gains
that hold the crank at a constant speed. ``constant``: walking
speeds at many torques. ``profile``: a crank-speed profile for each command, by CMA-ES.
"""

import json
import math
from typing import Any, TypeAlias, cast

import cma
import numpy as np

from jansen_env import __version__
from jansen_env.arrays import Array
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import Controlled, TorquePolicy, columns
from jansen_env.checks import listed
from jansen_env.commands.flags import Parser, episode_count, path_flag
from jansen_env.commands.progress import progress
from jansen_env.files import check_writable, write_json
from jansen_env.process import run
from jansen_env.robot import ROBOTS, named_robot
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import Episodes
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking import profile, tuned
from jansen_env.tasks.walking import walker_benchmark as walker

Entry: TypeAlias = dict[str, Any]
"""Of a file of tuned numbers, without the command."""

ENV = "JansenWalker-v0"  # harder worlds take the numbers of their robot
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
PAPER = (10.0, 1.0, 1.0)  # kp, ki, kd of the paper's PID
GAINS = (PAPER, *((kp, ki, kd) for kp in (1.0, 2.0, 3.0, 5.0, 10.0) for ki in (0.5, 2.0)
                  for kd in (0.2, 0.5, 1.0)))  # fmt: skip
COARSE, FINALISTS = 4, 2  # every fourth crank speed first, and gains that are measured in full
FIRST_SEED = 10_000  # apart from all others
HORIZON = 10.0  # s, the time limit of an episode
CHATTER = 0.25  # of the torque limit, in a step
HARMONICS = 4  # of a profile
SPREAD = 0.3  # standard deviation with which the search for a profile begins, of scaled numbers
FALL = 200.0  # return that a fall costs in the search for a profile
GROUND = (0.4, 1.0)  # friction in the search for a profile


def decades(robot: str) -> list[float]:
    """Return the powers of ten by which a robot's gains and torques are below the paper's.

    1 for robots of the paper's size; the two about the robot's scale for much smaller ones.
    """
    exponent = math.log10(tuned.scale_of(named_robot(robot)).torque)
    low = math.floor(exponent)
    return [1.0] if low >= -1 else [10.0**low, 10.0 ** (low + 1)]


def walker_of(robot: str) -> Controlled:
    """Return an unwrapped walker with a robot."""
    return cast("Controlled", make_env(ENV, {"robot": robot}).unwrapped)


def commands_of(robot: str) -> Array:
    """Return the benchmark's commands, m/s, for a smaller robot at the same Froude numbers."""
    scale = tuned.scale_of(named_robot(robot))
    factor = 1.0 if scale.length > 0.5 else scale.speed
    return np.round(factor * np.array(find_benchmark(ENV).commands), 3)


def measure(
    name: str, settings: Array, episodes: int, robot: str = "paper",
    gains: tuple[float, ...] = PAPER,
) -> Entry:  # fmt: skip
    """Measure walking speeds, m/s, of each crank speed ("pid") or torque ("constant")."""
    env = walker_of(robot)
    each = np.repeat(settings, episodes)
    commands, seeds = np.full(len(each), 0.3), FIRST_SEED + np.arange(len(each)) % episodes
    policy = (walker.walking_pid(lambda _: each, env, PID(*gains)) if name == "pid"
              else walker.constant_torque(lambda _: each, env))  # fmt: skip
    run = run_episodes(policy, ENV, {"robot": robot}, commands, seeds, at_once=len(each))
    speeds = (run["distance"] / HORIZON).reshape(-1, episodes)
    return {"settings": settings.tolist(), "speeds": speeds.round(4).tolist()}


def return_of(entry: Entry, robot: str, episodes: int) -> float:
    """Return the mean return of a PID over the commands, on starts other than those measured."""
    numbers = (np.array(entry[name]) for name in ("settings", "speeds"))
    setting, gains = tuned.nearest_setting(*numbers), PID(*entry["gains"])
    policy = walker.walking_pid(setting, walker_of(robot), gains)
    commands = np.repeat(commands_of(robot), episodes)
    seeds = FIRST_SEED + episodes + np.arange(len(commands)) % episodes
    return float(run_episodes(policy, ENV, {"robot": robot}, commands, seeds)["returns"].mean())


def measure_pid(robot: str, episodes: int) -> Entry:
    """Measure the PID at :data:`CRANK_SPEEDS` with the paper's gains on the paper's robot.

    On another robot every one of :data:`GAINS` is measured coarsely, and the :data:`FINALISTS` that
    return most in full; the one that returns most is kept.
    """

    def tried(gains: tuple[float, ...], settings: Array, count: int) -> tuple[float, Entry]:
        entry = {"gains": [*gains], **measure("pid", settings, count, robot, gains)}
        mean = return_of(entry, robot, count)
        print(f"gains {gains}, {len(settings)} crank speeds: return {mean:.1f}", flush=True)
        return mean, entry

    multiples = (PAPER,) if robot == "paper" else GAINS
    every = list(dict.fromkeys(
        tuple(round(factor * gain, 12) for gain in each)
        for factor in decades(robot) for each in multiples
    ))  # fmt: skip
    if len(every) > FINALISTS:
        coarse = {gains: tried(gains, CRANK_SPEEDS[::COARSE], 2)[0] for gains in every}
        every = sorted(coarse, key=coarse.__getitem__)[-FINALISTS:]
    return max((tried(gains, CRANK_SPEEDS, episodes) for gains in every), key=lambda r: r[0])[1]


def measure_constant(robot: str, episodes: int) -> Entry:
    """Measure constant torques."""
    return measure("constant", np.round(decades(robot)[0] * TORQUES, 6), episodes, robot)


def find_steady(robot: str, episodes: int) -> Entry:
    """Find the stiffest gains at which the motor does not switch between its limits.

    They are the paper's, times a power of ten. The mean change of the torque in a step must stay
    below :data:`CHATTER` of the motor's limit, in walks at a third of the fastest command.
    """
    env = walker_of(robot)
    command = commands_of(robot)[3]
    setting = tuned.setting_of("pid", named_robot(robot))
    for power in range(5):
        gains = [round(gain / 10.0**power, 12) for gain in PAPER]
        policy = walker.walking_pid(setting, env, PID(*gains))
        seeds = FIRST_SEED + np.arange(episodes)
        run = run_episodes(policy, ENV, {"robot": robot}, np.full(episodes, command), seeds)
        change = float((run["torque_change"] * env.control_dt / run["duration"]).mean())
        share = change / env.torque_limit
        print(
            f"gains {gains}: the torque changes by {share:.3f} of its limit in a step", flush=True
        )
        if share < CHATTER:
            return {"gains": gains, "torque_change": round(share, 4)}
    raise ValueError(f"--robot {robot} has no gains at which its motor does not switch")


def objective(run: Episodes, episodes: int) -> Array:
    """Return the loss of each candidate, shape (candidates,): minus the return, plus the falls."""
    lost = FALL * run["fell"] - run["returns"]
    return np.asarray(lost.reshape(-1, episodes).mean(axis=1))


def search_profile(robot: str, episodes: int, generations: int = 30, population: int = 16) -> Entry:
    """Search a profile for each command, upwards and then downwards through the commands.

    On the way up, each search begins with the numbers that the search before it found. The first
    search begins with the crank speed of the robot's PID, which is constant over the turn. On the
    way down, one search begins with the numbers of the next faster command, and another search
    begins with the command's own numbers. The best of these two results and of the command's own
    numbers is kept.
    """
    env, design = walker_of(robot), named_robot(robot)
    scale = tuned.scale_of(design, most_lag=1.0)
    units = np.ones(4 + 2 * HARMONICS)  # of the scaled numbers that are searched
    units[:4] = 1.0 / scale.time, 5.0 * scale.torque * scale.time, scale.torque, 1.0 / scale.length
    units[4:] = 0.3
    read, setting = columns(env, *profile.READ), tuned.setting_of("pid", design)
    commands = commands_of(robot)

    def losses(candidates: list[Array], command: float) -> Array:
        numbers = np.repeat(np.array(candidates) * units, episodes, axis=0)
        n = len(numbers)
        policy = TorquePolicy(
            lambda seen, *_: (profile.profile_torque(numbers, np.asarray(seen), read), None),
            env.torque_limit,
        )
        angles = np.pi * (np.arange(n) % episodes + rng.random()) / episodes
        grip = np.resize(np.linspace(*GROUND, episodes), n)
        options = {"crank_angle": angles, "friction": grip}
        seeds = FIRST_SEED + np.arange(n) % episodes
        run = run_episodes(
            policy,
            ENV,
            {"robot": robot},
            np.full(n, command),
            seeds,
            at_once=n,
            options=options,
        )
        return objective(run, episodes)

    def search(start: Array, command: float, spread: float) -> Array:
        limits = {"seed": 1, "popsize": population, "verbose": -9, "maxiter": generations}
        strategy = cma.CMAEvolutionStrategy(start, spread, limits)
        while not strategy.stop():
            candidates = strategy.ask()
            strategy.tell(candidates, losses(candidates, command).tolist())
        print(f"{command:g} m/s: {-losses([strategy.mean], command)[0]:.1f}", flush=True)
        # The losses are noisy, so the mean is better than the candidate with the smallest loss.
        return np.array(strategy.mean)

    rng = np.random.default_rng(0)
    start = np.zeros(len(units))
    start[1], start[3] = 1.0, 0.5
    found: list[Array] = []
    for command in commands:
        start[0] = float(setting(np.array([command]))[0]) / units[0]
        found.append(search(start, command, SPREAD))
        start = found[-1].copy()
    for i in reversed(range(len(commands) - 1)):
        faster = found[i + 1].copy()
        faster[0] *= commands[i] / commands[i + 1]
        again = search(faster, commands[i], SPREAD), search(found[i], commands[i], SPREAD / 3.0)
        tried = [found[i], *again]
        many = sum(losses(tried, commands[i]) for _ in range(4))
        found[i] = tried[int(np.argmin(many))]
    return {
        "versions": {"jansen_env": __version__, "cma": cma.__version__},
        "columns": list(profile.NUMBERS),
        "commands": commands.tolist(),
        "numbers": [(each * units).tolist() for each in found],
    }


MEASURED = {
    "pid": measure_pid,
    "constant": measure_constant,
    "steady": find_steady,
    "profile": search_profile,
}


def main(arguments: list[str] | None = None) -> None:
    """Measure the named baselines' numbers."""
    parser = Parser("python -m agents.tune", "Make the baselines' data.",
                    "python -m agents.tune pid constant")  # fmt: skip
    add = parser.add_argument
    add(
        "baselines",
        nargs="*",
        metavar="NAME",
        help="of pid, constant, steady, profile; default: all",
    )
    add(
        "--robot",
        default="paper",
        metavar="NAME",
        help=f"one of {', '.join(ROBOTS)}, or one of these with a number of legs, such as built:12",
    )
    add("--episodes", type=episode_count, default=6, help="per crank speed, torque or candidate")
    add(
        "--out", type=path_flag, default=tuned.DATA.parent, metavar="DIR", help="folder to write to"
    )
    args = parser.parse_args(arguments)
    for name in args.baselines:
        if name not in MEASURED:
            parser.error(f"baseline is {name!r}, must be one of {listed(MEASURED, name)}")
    with parser.refusing():
        named_robot(args.robot, "--robot")
        check_writable("--out", args.out)
    for name in args.baselines or MEASURED:
        with progress(f"{name} of {args.robot}", None):
            made = MEASURED[name](args.robot, args.episodes)
        command = f"python -m agents.tune {name} --robot {args.robot} --episodes {args.episodes}"
        path = args.out / (profile.DATA if name == "profile" else tuned.DATA).name
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        entry = {"command": command, **made}
        if name != "profile":
            entry = {**kept.get(args.robot, {}), name: entry}
        write_json(path, {**kept, args.robot: entry})  # other robots' numbers stay
        print(f"written: {path}")


if __name__ == "__main__":
    run("python -m agents.tune", main)
