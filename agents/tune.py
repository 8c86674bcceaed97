"""Tune the baselines for a robot: ``python -m agents.tune pid constant steady profile``.

- ``pid``: measure walking speeds at many crank speeds, and find the gains with the highest return.
- ``constant``: measure walking speeds at many constant torques.
- ``steady``: find the gains that hold the crank at a constant speed.
- ``profile``: search for a crank-speed profile at each command with CMA-ES.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any, TypeAlias, cast

import cma
import numpy as np

from jansen_env import __version__
from jansen_env.arrays import Array
from jansen_env.checks import invalid, listed
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
COARSE = 4  # a coarse measurement uses every fourth crank speed
FINALISTS = 2  # number of sets of gains that coarse measurements select for the full measurement
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
    commands = np.full(len(each), 0.3)
    seeds = FIRST_SEED + np.arange(len(each)) % episodes
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
    setting = tuned.nearest_setting(*numbers)
    policy = walker.walking_pid(setting, walker_of(robot), PID(*entry["gains"]))
    commands = np.repeat(commands_of(robot), episodes)
    seeds = FIRST_SEED + episodes + np.arange(len(commands)) % episodes
    return float(run_episodes(policy, ENV, {"robot": robot}, commands, seeds)["returns"].mean())


def measure_pid(robot: str, episodes: int) -> Entry:
    """Measure the walking speeds of a PID at :data:`CRANK_SPEEDS`.

    The robot of the paper has the gains of the paper. For any other robot, all :data:`GAINS` are
    measured coarsely. The :data:`FINALISTS` gains with the highest returns are then measured
    completely, and the best of them is the result.

    Args:
        robot: Name of the robot.
        episodes: Number of episodes per crank speed.
    """
    multiples = (PAPER,) if robot == "paper" else GAINS
    every = list(
        dict.fromkeys(
            tuple(round(factor * gain, 12) for gain in each)
            for factor in decades(robot)
            for each in multiples
        )
    )
    if len(every) > FINALISTS:
        coarse = {
            gains: measure_gains(gains, CRANK_SPEEDS[::COARSE], 2, robot)[0] for gains in every
        }
        every = sorted(coarse, key=coarse.__getitem__)[-FINALISTS:]
    results = [measure_gains(gains, CRANK_SPEEDS, episodes, robot) for gains in every]
    _, entry = max(results, key=lambda result: result[0])
    return entry


def measure_gains(
    gains: tuple[float, ...], crank_speeds: Array, episodes: int, robot: str
) -> tuple[float, Entry]:
    """Measure the walking speeds of a PID with given gains, and print its return.

    Args:
        gains: Gains kp, ki and kd of the PID.
        crank_speeds: Crank speeds, in rad/s.
        episodes: Number of episodes per crank speed.
        robot: Name of the robot.

    Returns:
        The mean return over the commands, and the measurement.
    """
    entry = {"gains": [*gains], **measure("pid", crank_speeds, episodes, robot, gains)}
    mean = return_of(entry, robot, episodes)
    print(f"gains {gains}, {len(crank_speeds)} crank speeds: return {mean:.1f}", flush=True)
    return mean, entry


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
        relative = change / env.torque_limit
        print(
            f"gains {gains}: the torque changes by {relative:.3f} of its limit in a step",
            flush=True,
        )
        if relative < CHATTER:
            return {"gains": gains, "torque_change": round(relative, 4)}
    raise ValueError(
        "--robot must be a robot whose motor does not switch between its limits under some of the "
        f"gains, got {robot}"
    )


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


class ProfileSearch:
    """Search for the parameters of a profile at one command, with CMA-ES on noisy losses.

    Args:
        robot: Name of the robot.
        episodes: Number of episodes per candidate.
        generations: Number of generations per search.
        population: Number of candidates per generation.

    Attributes:
        units: Units of the scaled parameters that are searched, shape (4 + 2 * HARMONICS,).
    """

    def __init__(self, robot: str, episodes: int, generations: int, population: int) -> None:
        scale = tuned.scale_of(named_robot(robot), most_lag=1.0)
        speed = 1.0 / scale.time
        gain = 5.0 * scale.torque * scale.time
        feedback = 1.0 / scale.length
        self.units = np.array([speed, gain, scale.torque, feedback] + [0.3] * 2 * HARMONICS)
        self._robot = robot
        self._episodes = episodes
        self._generations = generations
        self._population = population
        self._env = walker_of(robot)
        self._read = columns(self._env, *profile.READ)
        self._rng = np.random.default_rng(0)

    def losses(self, candidates: list[Array], command: float) -> Array:
        """Let candidates walk from random crank angles and return their losses.

        Args:
            candidates: Scaled parameters of each candidate.
            command: Commanded speed, in m/s.

        Returns:
            The losses, shape (candidates,); see :func:`objective`.
        """
        episodes = self._episodes
        numbers = np.repeat(np.array(candidates) * self.units, episodes, axis=0)
        n = len(numbers)
        policy = TorquePolicy(
            lambda seen, *_: (profile.profile_torque(numbers, np.asarray(seen), self._read), None),
            self._env.torque_limit,
        )
        angles = np.pi * (np.arange(n) % episodes + self._rng.random()) / episodes
        friction = np.resize(np.linspace(*GROUND, episodes), n)
        run = run_episodes(
            policy,
            ENV,
            {"robot": self._robot},
            np.full(n, command),
            FIRST_SEED + np.arange(n) % episodes,
            at_once=n,
            options={"crank_angle": angles, "friction": friction},
        )
        return objective(run, episodes)

    def search(self, start: Array, command: float, spread: float) -> Array:
        """Return the best scaled parameters that a search finds.

        Args:
            start: Scaled parameters at which the search begins.
            command: Commanded speed, in m/s.
            spread: Initial standard deviation.
        """
        limits = {
            "seed": 1,
            "popsize": self._population,
            "verbose": -9,
            "maxiter": self._generations,
        }
        strategy = cma.CMAEvolutionStrategy(start, spread, limits)
        while not strategy.stop():
            candidates = strategy.ask()
            strategy.tell(candidates, self.losses(candidates, command).tolist())
        print(f"{command:g} m/s: {-self.losses([strategy.mean], command)[0]:.1f}", flush=True)
        # The losses are noisy, so the mean is better than the candidate with the smallest loss.
        return np.array(strategy.mean)

    def best(self, candidates: list[Array], command: float) -> Array:
        """Return the candidate with the smallest loss in four measurements.

        Args:
            candidates: Scaled parameters of each candidate.
            command: Commanded speed, in m/s.
        """
        total = sum(self.losses(candidates, command) for _ in range(4))
        return candidates[int(np.argmin(total))]


def search_profile(robot: str, episodes: int, generations: int = 30, population: int = 16) -> Entry:
    """Search for a crank-speed profile at each command, first upwards and then downwards in speed.

    On the way up, each search begins with the parameters that the previous search found. The first
    search begins with the crank speed of the robot's PID, which is constant over a turn. On the
    way down, there are two searches per command. One begins with the parameters of the next faster
    command, and the other begins with the present parameters of the command. The best of the two
    results and the present parameters is the result.

    Args:
        robot: Name of the robot.
        episodes: Number of episodes per candidate.
        generations: Number of generations per search.
        population: Number of candidates per generation.
    """
    searches = ProfileSearch(robot, episodes, generations, population)
    commands = commands_of(robot)
    found = _search_upwards(searches, robot, commands)
    _search_downwards(searches, commands, found)
    return {
        "versions": {"jansen_env": __version__, "cma": cma.__version__},
        "columns": list(profile.NUMBERS),
        "commands": commands.tolist(),
        "numbers": [(each * searches.units).tolist() for each in found],
    }


def _search_upwards(searches: ProfileSearch, robot: str, commands: Array) -> list[Array]:
    """Return the parameters found for each command, searched from the slowest command on."""
    crank_speed = tuned.setting_of("pid", named_robot(robot))
    start = np.zeros(len(searches.units))
    start[1] = 1.0  # the gain kp
    start[3] = 0.5  # the feedback g
    found: list[Array] = []
    for command in commands:
        start[0] = float(crank_speed(np.array([command]))[0]) / searches.units[0]
        found.append(searches.search(start, command, SPREAD))
        start = found[-1].copy()
    return found


def _search_downwards(searches: ProfileSearch, commands: Array, found: list[Array]) -> None:
    """Improve the parameters of each command, from the second fastest command on."""
    for i in reversed(range(len(commands) - 1)):
        faster = found[i + 1].copy()
        faster[0] *= commands[i] / commands[i + 1]
        candidates = [
            found[i],
            searches.search(faster, commands[i], SPREAD),
            searches.search(found[i], commands[i], SPREAD / 3.0),
        ]
        found[i] = searches.best(candidates, commands[i])


MEASURED = {
    "pid": measure_pid,
    "constant": measure_constant,
    "steady": find_steady,
    "profile": search_profile,
}


def main(arguments: list[str] | None = None) -> None:
    """Tune the named baselines and write their parameters.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = _parse(arguments)
    for name in args.baselines or MEASURED:
        with progress(f"{name} of {args.robot}", None):
            entry = MEASURED[name](args.robot, args.episodes)
        command = f"python -m agents.tune {name} --robot {args.robot} --episodes {args.episodes}"
        path = args.out / (profile.DATA if name == "profile" else tuned.DATA).name
        write_entry(path, args.robot, name, {"command": command, **entry})
        print(f"written: {path}")


def write_entry(path: Path, robot: str, name: str, entry: Entry) -> None:
    """Write the parameters of a baseline to a file, and keep those of other robots.

    Args:
        path: File of tuned parameters; it is created if it does not exist.
        robot: Name of the robot.
        name: Name of the baseline.
        entry: Parameters of the baseline.
    """
    entries = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if name == "profile":  # this file has no other baselines
        entries[robot] = entry
    else:
        entries[robot] = {**entries.get(robot, {}), name: entry}
    write_json(path, entries)


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    """Parse and check the command line."""
    parser = Parser(
        "python -m agents.tune",
        "Tune the baselines for a robot.",
        "python -m agents.tune pid constant",
    )
    add = parser.add_argument
    add(
        "baselines",
        nargs="*",
        metavar="NAME",
        help="baselines to tune, of pid, constant, steady and profile; default: all",
    )
    add(
        "--robot",
        default="paper",
        metavar="NAME",
        help=f"robot: one of {', '.join(ROBOTS)}, or one of these with a number of legs, such as "
        "built:12; default: paper",
    )
    add(
        "--episodes",
        type=episode_count,
        default=6,
        help="number of episodes per crank speed, torque or candidate; default: 6",
    )
    add(
        "--out", type=path_flag, default=tuned.DATA.parent, metavar="DIR", help="folder to write to"
    )
    args = parser.parse_args(arguments)
    for name in args.baselines:
        if name not in MEASURED:
            parser.error(str(invalid("baseline", name, f"one of {listed(MEASURED, name)}")))
    with parser.refusing():
        named_robot(args.robot, "--robot")
        check_writable("--out", args.out)
    return args


if __name__ == "__main__":
    run("python -m agents.tune", main)
