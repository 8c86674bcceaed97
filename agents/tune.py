"""Tune the baselines for a robot: ``python -m agents.tune pid constant steady profile``.

- ``pid``: measure walking speeds at many crank speeds, and find the gains with the highest return.
- ``constant``: measure walking speeds at many constant torques.
- ``steady``: find the gains that hold the crank at a constant speed.
- ``profile``: search a crank-speed profile for each command with CMA-ES.
"""

import json
import math
from typing import Any, TypeAlias, cast

import cma
import numpy as np

from jansen_env import __version__
from jansen_env.arrays import Array
from jansen_env.checks import listed
from jansen_env.cli.flags import Parser, episode_count, path_flag
from jansen_env.cli.process import run
from jansen_env.cli.progress import progress
from jansen_env.files import check_writable, write_json
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import Controlled, TorquePolicy, columns
from jansen_env.robot import ROBOTS, named_robot
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import Episodes
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking import profile, tuned
from jansen_env.tasks.walking import walker_benchmark as walker

Entry: TypeAlias = dict[str, Any]
"""Entry of a file of tuned parameters, without the command that produced it."""

ENV = "JansenWalker-v0"  # harder environments use the parameters of their robot
CRANK_SPEEDS = np.round(np.concatenate([np.arange(0.2, 3.0, 0.1), np.arange(3.0, 8.1, 0.25)]), 3)
TORQUES = np.round(np.concatenate([np.arange(0.5, 6.0, 0.25), np.arange(6.0, 15.1, 0.5)]), 3)
PAPER = (10.0, 1.0, 1.0)  # gains kp, ki, kd of the PID in the paper
GAINS = (
    PAPER,
    *(
        (kp, ki, kd)
        for kp in (1.0, 2.0, 3.0, 5.0, 10.0)
        for ki in (0.5, 2.0)
        for kd in (0.2, 0.5, 1.0)
    ),
)
# A coarse measurement uses every fourth crank speed. It selects two sets of gains for the full
# measurement.
COARSE, FINALISTS = 4, 2
FIRST_SEED = 10_000  # no other part of the project uses these seeds
HORIZON = 10.0  # time limit of an episode, in s
CHATTER = 0.25  # largest mean change of the torque per step, as a fraction of the torque limit
HARMONICS = 4  # number of harmonics of a profile
SPREAD = 0.3  # initial standard deviation of the search for a profile, for scaled parameters
FALL = 200.0  # penalty for a fall in the search for a profile, in units of the return
GROUND = (0.4, 1.0)  # range of the friction coefficient in the search for a profile


def decades(robot: str) -> list[float]:
    """Return powers of ten by which gains and torques of a robot may differ from the paper's.

    For robots of the paper's size, the only factor is 1. For much smaller robots, there are two
    factors, the powers of ten just below and above the torque scale of the robot.

    Args:
        robot: Name of the robot.
    """
    exponent = math.log10(tuned.scale_of(named_robot(robot)).torque)
    low = math.floor(exponent)
    return [1.0] if low >= -1 else [10.0**low, 10.0 ** (low + 1)]


def walker_of(robot: str) -> Controlled:
    """Return an unwrapped walker environment.

    Args:
        robot: Name of the robot.
    """
    return cast("Controlled", make_env(ENV, {"robot": robot}).unwrapped)


def commands_of(robot: str) -> Array:
    """Return the commanded speeds of the benchmark, in m/s.

    For a smaller robot, they are scaled to the same Froude numbers.

    Args:
        robot: Name of the robot.
    """
    scale = tuned.scale_of(named_robot(robot))
    factor = 1.0 if scale.length > 0.5 else scale.speed
    return np.round(factor * np.array(find_benchmark(ENV).commands), 3)


def measure(
    name: str,
    settings: Array,
    episodes: int,
    robot: str = "paper",
    gains: tuple[float, ...] = PAPER,
) -> Entry:
    """Measure the walking speed, in m/s, at each crank speed or at each torque.

    Args:
        name: ``"pid"`` or ``"constant"``.
        settings: Crank speeds, in rad/s, for ``"pid"``; torques, in N m, for ``"constant"``.
        episodes: Number of episodes per setting.
        robot: Name of the robot.
        gains: Gains kp, ki and kd of the PID.
    """
    env = walker_of(robot)
    each = np.repeat(settings, episodes)
    commands, seeds = np.full(len(each), 0.3), FIRST_SEED + np.arange(len(each)) % episodes
    policy = (
        walker.walking_pid(lambda _: each, env, PID(*gains))
        if name == "pid"
        else walker.constant_torque(lambda _: each, env)
    )
    run = run_episodes(policy, ENV, {"robot": robot}, commands, seeds, at_once=len(each))
    speeds = (run["distance"] / HORIZON).reshape(-1, episodes)
    return {"settings": settings.tolist(), "speeds": speeds.round(4).tolist()}


def return_of(entry: Entry, robot: str, episodes: int) -> float:
    """Return the mean return of a PID over the commands.

    The episodes have other seeds than those of the measurement.

    Args:
        entry: Measurement of the PID.
        robot: Name of the robot.
        episodes: Number of episodes per command.
    """
    numbers = (np.array(entry[name]) for name in ("settings", "speeds"))
    setting, gains = tuned.nearest_setting(*numbers), PID(*entry["gains"])
    policy = walker.walking_pid(setting, walker_of(robot), gains)
    commands = np.repeat(commands_of(robot), episodes)
    seeds = FIRST_SEED + episodes + np.arange(len(commands)) % episodes
    return float(run_episodes(policy, ENV, {"robot": robot}, commands, seeds)["returns"].mean())


def measure_pid(robot: str, episodes: int) -> Entry:
    """Measure the walking speeds of a PID at :data:`CRANK_SPEEDS`.

    The robot of the paper has the gains of the paper. For any other robot, all :data:`GAINS` are
    measured coarsely. The :data:`FINALISTS` gains with the highest returns are then measured
    completely, and the best of them is kept.

    Args:
        robot: Name of the robot.
        episodes: Number of episodes per crank speed.
    """

    def tried(gains: tuple[float, ...], settings: Array, count: int) -> tuple[float, Entry]:
        entry = {"gains": [*gains], **measure("pid", settings, count, robot, gains)}
        mean = return_of(entry, robot, count)
        print(f"gains {gains}, {len(settings)} crank speeds: return {mean:.1f}", flush=True)
        return mean, entry

    multiples = (PAPER,) if robot == "paper" else GAINS
    every = list(
        dict.fromkeys(
            tuple(round(factor * gain, 12) for gain in each)
            for factor in decades(robot)
            for each in multiples
        )
    )
    if len(every) > FINALISTS:
        coarse = {gains: tried(gains, CRANK_SPEEDS[::COARSE], 2)[0] for gains in every}
        every = sorted(coarse, key=coarse.__getitem__)[-FINALISTS:]
    return max((tried(gains, CRANK_SPEEDS, episodes) for gains in every), key=lambda r: r[0])[1]


def measure_constant(robot: str, episodes: int) -> Entry:
    """Measure the walking speeds at constant torques.

    Args:
        robot: Name of the robot.
        episodes: Number of episodes per torque.
    """
    return measure("constant", np.round(decades(robot)[0] * TORQUES, 6), episodes, robot)


def find_steady(robot: str, episodes: int) -> Entry:
    """Find the stiffest gains at which the motor does not switch between its limits.

    The gains are those of the paper, divided by a power of ten. In walks at the fourth command of
    the benchmark (0.3 m/s for robots of the paper's size), the mean change of the torque per step
    must stay below :data:`CHATTER` times the torque limit of the motor.

    Args:
        robot: Name of the robot.
        episodes: Number of episodes.

    Raises:
        ValueError: If no gains satisfy the condition.
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
    """Return the loss of each candidate: the mean penalty for falls minus the mean return.

    Args:
        run: Episodes of all candidates, one candidate after the other.
        episodes: Number of episodes per candidate.

    Returns:
        The losses, shape (candidates,).
    """
    lost = FALL * run["fell"] - run["returns"]
    return np.asarray(lost.reshape(-1, episodes).mean(axis=1))


def search_profile(robot: str, episodes: int, generations: int = 30, population: int = 16) -> Entry:
    """Search a crank-speed profile for each command, first upwards and then downwards in speed.

    On the way up, each search begins with the parameters that the previous search found. The first
    search begins with the crank speed of the robot's PID, which is constant over a turn. On the
    way down, there are two searches per command. One begins with the parameters of the next faster
    command, and the other begins with the present parameters of the command. The best of the two
    results and the present parameters is kept.

    Args:
        robot: Name of the robot.
        episodes: Number of episodes per candidate.
        generations: Number of generations per search.
        population: Number of candidates per generation.
    """
    env, design = walker_of(robot), named_robot(robot)
    scale = tuned.scale_of(design, most_lag=1.0)
    units = np.ones(4 + 2 * HARMONICS)  # units of the scaled parameters that are searched
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
    """Tune the named baselines and write their parameters."""
    parser = Parser(
        "python -m agents.tune", "Make the baselines' data.", "python -m agents.tune pid constant"
    )
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
        write_json(path, {**kept, args.robot: entry})  # keeps the entries of other robots
        print(f"written: {path}")


if __name__ == "__main__":
    run("python -m agents.tune", main)
