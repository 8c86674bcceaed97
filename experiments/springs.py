"""Can a spring in each leg lower the torque of the crank?

Run the experiment as follows. It takes about three minutes on two cores.

    python experiments/springs.py [--episodes 32] [--policies 0] [--quick]

The script records the crank torque of three robots that walk at constant crank speed. It then
searches for the spring with which the peak torque is smallest, and for the one with which the RMS
torque is smallest. The robots walk with and without these springs at constant crank speed, from
several initial crank angles, and under a PID. With ``--policies N``, PPO also trains N policies on
each robot, with and without its springs. They are kept in ``logs/springs`` and not trained again.
The script writes the tables of docs/springs.md and, in the folder docs/springs, ``springs.json``,
``springs.png``, a robot file for each sprung robot, and ``robot.png``, a picture of one of them.
The scores of the policies are in ``policies.json``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
from pages import options, publish, table
from scipy.optimize import linprog
from trained_policies import ENV, score_policy, train_policy

from jansen_env import ROBOTS, Robot, Terrain, evaluate
from jansen_env.arrays import Array
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.robot import Spring
from jansen_env.robot.kinematics import advance_per_turn, joints_of_legs
from jansen_env.robot.linkage import FRAME
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.benchmarks import find_benchmark

DATA, PAGE = "springs/springs.json", "springs.md"
POLICIES = "springs/policies.json"
RUNS = Path("logs/springs")
NAMES: tuple[str, ...] = ("built", "stroller", "climber")
SPEED = 0.3  # m/s
COMMANDS = (0.1, 0.3, 0.5)  # m/s
STARTS: tuple[float, ...] = tuple(np.linspace(0.0, math.pi, 12, endpoint=False).tolist())
"""Initial crank angles of the walks at constant crank speed, in rad."""
WINDOW = 0.02  # time over which the search averages the torque, in s
WINDOWS = (0.01, WINDOW, 0.04)  # s
SETTLING, TURNS = 2, 6  # turns of the crank before the record and during it
ANGLES = 720  # crank angles at which springs are evaluated
MOST_FORCE = 60.0  # largest force of a spring, in N
LEAST_STIFFNESS = 1.0  # N/m
REST_LENGTHS = 21  # number of rest lengths that are tried for the smallest RMS torque
ROOM = 0.03  # smallest length of a spring, in m
ANCHORS = np.linspace(-0.4, 0.4, 9)  # x and y of the ends on the chassis, in m
METRICS = ("peak_torque", "rms_torque", "steady_cost_of_transport", "return")
"""Metrics of the walks under the PID."""
POLICY_METRICS = {
    "peak_torque": ("peak torque (N m)", 2),
    "rms_torque": ("RMS torque (N m)", 2),
    "steady_cost_of_transport": ("cost of transport", 3),
    "return": ("return", 0),
    "steady_speed_error": ("speed error (m/s)", 4),
    "load": ("load (weights)", 2),
}
"""Metrics under trained policies, with the headings and the decimals of their tables."""
LABELS = {"none": "no spring", "peak": "peak torque", "rms": "RMS torque"}
SEED = 11


class Record(NamedTuple):
    """Crank torque of a robot that walks at constant crank speed.

    Attributes:
        angle: Crank angle in the middle of each window, in rad, shape (n,).
        torque: Mean torque in each window, in N m, shape (n,).
        power: Mean of the positive part of the mechanical power, in W.
    """

    angle: Array
    torque: Array
    power: float


class Fit(NamedTuple):
    """Best spring with given ends.

    Attributes:
        torque: Peak or RMS torque with this spring, in N m.
        stiffness: Stiffness, in N/m.
        rest_length: Rest length, in m.
    """

    torque: float
    stiffness: float
    rest_length: float


def record(robot: Robot, start: float = 0.0, window: float = WINDOW) -> Record:
    """Return the torque of a robot that walks at :data:`SPEED` with a constant crank speed.

    Args:
        robot: The robot.
        start: Initial crank angle, in rad.
        window: Time over which the torque is averaged, in s.
    """
    rate = 2.0 * math.pi * SPEED / advance_per_turn(robot)
    plant = ProjectionPlant(robot, Terrain.flat(friction=0.8))
    state = plant.reset(crank_angle=start)
    state[7] = rate
    plant.state = state
    plant.prescribed_crank_speed = True
    period = 2.0 * math.pi / abs(rate)
    angles, torques = [], []
    for k in range(round((SETTLING + TURNS) * period / window)):
        begun = float(plant.state[3])
        result = plant.step(0.0, window)
        if k * window >= SETTLING * period:
            angles.append(begun + 0.5 * rate * window)
            torques.append(result.motor_work / (rate * window))
    torque = np.array(torques)
    power = float(np.maximum(torque * rate, 0.0).mean())
    return Record(np.array(angles), torque, power)


def record_all(robot: Robot, starts: Iterable[float], window: float) -> dict[str, Any]:
    """Return the window and, for each initial crank angle, the torques in N m and the power in W.

    Args:
        robot: The robot.
        starts: Initial crank angles, in rad.
        window: Time over which the torque is averaged, in s.
    """
    walks = [record(robot, start, window) for start in starts]
    return {
        "window": window,
        "peak": [round(float(np.abs(walk.torque).max()), 3) for walk in walks],
        "rms": [round(float(np.sqrt((walk.torque**2).mean())), 3) for walk in walks],
        "mean": [round(float(walk.torque.mean()), 3) for walk in walks],
        "power": [round(walk.power, 3) for walk in walks],
    }


def candidates(robot: Robot) -> Iterator[Spring]:
    """Yield springs without stiffness between all joints, and between joints and the chassis."""
    linkage = robot.linkage
    fixed = linkage.bodies[FRAME - 1][1]
    for start, end in itertools.combinations(linkage.joints, 2):
        shared = any({start, end} <= {*joints} for _, joints in linkage.bodies)
        if not shared and not {start, end} <= {*fixed}:
            yield Spring(start, end)
    for start in linkage.joints:
        if start not in fixed and start not in linkage.toes:
            for x, y in itertools.product(ANCHORS.tolist(), ANCHORS.tolist()):
                yield Spring(start, anchor=(x, y))


def lengths(robot: Robot, spring: Spring, places: Array) -> Array:
    """Return the length of a spring in every leg, in m, shape (legs, angles).

    Args:
        robot: The robot.
        spring: The spring.
        places: Positions of all joints, in m, shape (legs, angles, joints, 2).
    """
    index = robot.linkage.joints.index
    start = places[:, :, index(spring.start)]
    if spring.end:
        end = places[:, :, index(spring.end)]
    else:
        sides = np.array([1.0 if leg.side == "fore" else -1.0 for leg in robot.legs])
        x, y = spring.anchor
        end = np.stack([sides * x, np.full(len(sides), y)], axis=1)[:, None]
    return np.asarray(np.linalg.norm(start - end, axis=-1))


def slope(values: Array) -> Array:
    """Return the derivative of a periodic function with respect to the crank angle."""
    harmonics = np.fft.rfft(values)
    derivative = np.fft.irfft(1j * np.arange(len(harmonics)) * harmonics, len(values))
    return np.asarray(derivative)


class Effect(NamedTuple):
    """Effect of a spring with given ends on the recorded torque.

    With the stiffness k and the rest length L0, the energy of a spring is k (L - L0)^2 / 2. The
    spring therefore adds k square - k L0 linear to the torque.

    Attributes:
        torque: Torque without the spring, in N m, shape (n,).
        square: Sum over the legs of (L^2 / 2)', in m^2, shape (n,).
        linear: Sum over the legs of L', in m, shape (n,).
        shortest: Smallest length, in m.
        longest: Largest length, in m.
    """

    torque: Array
    square: Array
    linear: Array
    shortest: float
    longest: float


def effect_of(walk: Record, length: Array) -> Effect:
    """Return the effect of a spring from its length in each leg, in m, shape (legs, angles)."""
    turn = 2.0 * math.pi / ANGLES * np.arange(ANGLES + 1)
    square, linear = (
        np.interp(walk.angle % (2.0 * math.pi), turn, np.append(values, values[0]))
        for values in (slope(0.5 * (length * length).sum(axis=0)), slope(length.sum(axis=0)))
    )
    return Effect(walk.torque, square, linear, float(length.min()), float(length.max()))


def least_peak(effect: Effect) -> Fit | None:
    """Return the spring with the smallest peak torque.

    The function solves a linear program for k, k L0 and the peak. The spring must always pull, with
    at most :data:`MOST_FORCE`.
    """
    torque, square, linear, shortest, longest = effect
    one = np.ones(len(torque))
    upper = np.stack([square, -linear, -one], axis=1)  # torque with the spring <= peak
    lower = np.stack([-square, linear, -one], axis=1)
    limits = np.array([[-shortest, 1.0, 0.0], [longest, -1.0, 0.0]])
    rows = np.concatenate([upper, lower, limits])
    bounds = np.concatenate([-torque, torque, [0.0, MOST_FORCE]])
    solved = linprog((0.0, 0.0, 1.0), rows, bounds, bounds=[(0.0, None)] * 3)
    if solved.status != 0 or solved.x[0] < LEAST_STIFFNESS:
        return None
    stiffness, product, peak = solved.x.tolist()
    return Fit(peak, stiffness, product / stiffness)


def least_rms(effect: Effect) -> Fit | None:
    """Return the spring with the smallest RMS torque, by the best stiffness for each rest length.

    The limits are those of :func:`least_peak`.
    """
    torque, square, linear, shortest, longest = effect
    best: Fit | None = None
    for rest in np.linspace(0.0, shortest, REST_LENGTHS).tolist():
        unit = square - rest * linear
        stiffness = -float(torque @ unit) / max(float(unit @ unit), 1e-12)
        stiffness = min(stiffness, MOST_FORCE / max(longest - rest, 1e-9))
        rms = float(np.sqrt(((torque + stiffness * unit) ** 2).mean()))
        if stiffness >= LEAST_STIFFNESS and (best is None or rms < best.torque):
            best = Fit(rms, stiffness, rest)
    return best


GOALS = {"peak": least_peak, "rms": least_rms}
"""Functions that fit a spring with given ends, by the torque that they minimise."""


def search(robot: Robot, walk: Record, goal: str) -> Spring:
    """Return the spring with the smallest torque at constant crank speed.

    Args:
        robot: The robot.
        walk: Torque without springs.
        goal: Torque to minimise, a key of :data:`GOALS`.
    """
    angles: Array = 2.0 * math.pi / ANGLES * np.arange(ANGLES, dtype=float)
    places = joints_of_legs(robot, angles)
    least, best = math.inf, None
    for spring in candidates(robot):
        length = lengths(robot, spring, places)
        if length.min() < ROOM:
            continue
        fit = GOALS[goal](effect_of(walk, length))
        if fit is not None and fit.torque < least:
            least = fit.torque
            best = replace(
                spring,
                stiffness=round(fit.stiffness, 1),
                rest_length=round(fit.rest_length, 4),
            )
    if best is None:
        raise ValueError(f"no spring lowers the {goal} torque of this robot")
    return best


def walk_under_pid(robot: Robot, episodes: int) -> dict[str, list[float | None]]:
    """Return the means of :data:`METRICS` per command under the benchmark's PID."""
    env = gym.make(ENV, robot=robot)
    pid = find_benchmark(ENV).baselines["pid"](env.unwrapped)
    scores = evaluate(
        {"pid": pid}, ENV, {"robot": robot}, commands=COMMANDS, episodes=episodes, seed=SEED
    )
    by_command = scores["pid"]["by_command"]
    return _rounded(by_command, METRICS)


def _rounded(by_command: dict[str, Any], metrics: Iterable[str]) -> dict[str, list[float | None]]:
    """Return metrics per command with four decimals, or None where no episode has a value."""
    return {
        name: [None if value is None else round(value, 4) for value in by_command[name]["value"]]
        for name in metrics
    }


def measure(names: Iterable[str], starts: Sequence[float], episodes: int) -> dict[str, Any]:
    """Search for two springs for each robot, and measure the robot with and without them.

    Args:
        names: Names of the robots.
        starts: Initial crank angles of the walks at constant crank speed, in rad.
        episodes: Number of episodes per command under the PID.
    """
    results: dict[str, Any] = {}
    for name in names:
        bare = ROBOTS[name]()
        walk = record(bare)
        robots = {"none": bare}
        for goal in GOALS:
            robots[goal] = replace(bare, springs=(search(bare, walk, goal),))
        results[name] = {"angle": np.round(walk.angle, 4).tolist()}
        for kind, robot in robots.items():
            results[name][kind] = {
                "springs": [asdict(spring) for spring in robot.springs],
                "torque": np.round(record(robot).torque, 4).tolist(),
                "walks": [record_all(robot, starts, window) for window in WINDOWS],
                "pid": walk_under_pid(robot, episodes),
            }
    return results


def robots_of(results: dict[str, Any]) -> dict[tuple[str, str], Robot]:
    """Return each robot with each of its springs and without springs, by name and kind."""
    robots = {}
    for name, values in results.items():
        for kind in LABELS:
            springs = tuple(Spring(**spring) for spring in values[kind]["springs"])
            robots[name, kind] = replace(ROBOTS[name](), springs=springs)
    return robots


def score_policies(results: dict[str, Any], count: int, episodes: int, quick: bool) -> list[Any]:
    """Train policies on each robot with and without its springs, and test them on this robot.

    Args:
        results: Robots and their springs, as returned by :func:`measure`.
        count: Number of policies per robot, each with its own seed.
        episodes: Number of episodes per command and policy.
        quick: Whether to train for two rollouts only.

    Returns:
        Name of the robot, goal of its spring, seed, and metrics per command of each policy.
    """
    scores = []
    for seed in range(count):
        for (name, kind), robot in robots_of(results).items():
            command = f"python experiments/springs.py --policies {count}"
            file = train_policy(RUNS / f"{name}_{kind}_{seed}", robot, seed, command, quick)
            found = score_policy(str(file), robot, COMMANDS, episodes, SEED)["by_command"]
            metrics = _rounded(found, [*POLICY_METRICS, "falls"])
            scores.append({"robot": name, "kind": kind, "seed": seed, **metrics})
            print(f"seed {seed}, {name}, {kind}: return {metrics['return']}", flush=True)
    return scores


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page about the search and about the walks under the PID."""
    robots = results["robots"]
    torques = [spring_table(robots), window_table(robots)]
    return {PAGE: [*torques, *(pid_table(robots, metric) for metric in METRICS)]}


def spring_table(results: dict[str, Any]) -> str:
    """Return the table of the springs and of the torques at constant crank speed."""
    rows = []
    for name, values in results.items():
        for kind, label in LABELS.items():
            case = values[kind]
            cells = ["", "", ""]
            for spring in case["springs"]:
                x, y = spring["anchor"]
                end = spring["end"] or f"chassis ({x:.1f}, {y:.1f}) m"
                between = f"{spring['start']} and {end}"
                cells = [between, f"{spring['stiffness']:.0f}", f"{spring['rest_length']:.3f}"]
            walks = case["walks"][WINDOWS.index(WINDOW)]
            peaks = walks["peak"]
            peak = f"{np.mean(peaks):.2f} ({min(peaks):.2f} to {max(peaks):.2f})"
            numbers = [f"{np.mean(walks[key]):.2f}" for key in ("rms", "mean", "power")]
            rows.append([f"`{name}`", label, *cells, peak, *numbers])
    torques = ("peak torque, N m", "RMS torque, N m", "mean torque, N m")
    ends = ("ends", "stiffness, N/m", "rest length, m")
    return table(["robot", "spring for", *ends, *torques, "driving power, W"], rows, texts=3)


def window_table(results: dict[str, Any]) -> str:
    """Return the table of the torques at constant crank speed for each window.

    Args:
        results: Robots and their springs, as returned by :func:`measure`.
    """
    rows = [
        [
            f"`{name}`",
            label,
            *(
                f"{np.mean(walks[key]):.2f}"
                for key in ("peak", "rms")
                for walks in by[kind]["walks"]
            ),
        ]
        for name, by in results.items()
        for kind, label in LABELS.items()
    ]
    windows = [f"{1000.0 * window:.0f} ms" for window in WINDOWS]
    heads = [f"{torque}, {window}" for torque in ("peak", "RMS") for window in windows]
    return table(["torque (N m) with windows of", "spring for", *heads], rows, texts=2)


def pid_table(results: dict[str, Any], metric: str) -> str:
    """Return the table of one metric of the walks under the PID."""
    rows = [
        [
            f"`{name}`",
            label,
            *("none" if v is None else f"{v:.2f}" for v in by[kind]["pid"][metric]),
        ]
        for name, by in results.items()
        for kind, label in LABELS.items()
    ]
    return table(["robot", "spring for", *(f"{each} m/s" for each in COMMANDS)], rows, texts=2)


def policy_tables(policies: dict[str, Any]) -> list[str]:
    """Return the table of each metric of the trained policies: mean and deviation over seeds."""
    by_robot: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for scores in policies["scores"]:
        by_robot.setdefault((scores["robot"], scores["kind"]), []).append(scores)
    made = []
    for metric, (heading, decimals) in POLICY_METRICS.items():
        rows = []
        for (name, kind), seeds in by_robot.items():
            columns = zip(*(scores[metric] for scores in seeds), strict=True)
            cells = [mean_and_deviation(column, decimals) for column in columns]
            rows.append([f"`{name}`", LABELS[kind], str(len(seeds)), *cells])
        head = [f"{heading}, trained policies", "spring for", "policies"]
        made.append(table([*head, *(f"{speed} m/s" for speed in COMMANDS)], rows, texts=2))
    return made


def mean_and_deviation(values: Iterable[float | None], decimals: int) -> str:
    """Return the mean and the standard deviation over the seeds as text.

    Only seeds that have a value count. A single value has no deviation.
    """
    known = [value for value in values if value is not None]
    if not known:
        return "none"
    mean = f"{np.mean(known):.{decimals}f}"
    return mean if len(known) == 1 else f"{mean} ± {np.std(known, ddof=1):.{decimals}f}"


def draw(results: dict[str, Any], path: Path) -> None:
    """Draw the torques at constant crank speed over one turn of the crank."""
    size = (5.6, 2.6 * len(results))  # one column, so that phones show readable text
    figure, axes = plt.subplots(len(results), figsize=size, squeeze=False, layout="constrained")
    for axis, (name, values) in zip(axes.flat, results.items(), strict=True):
        angle = np.array(values["angle"]) % (2.0 * math.pi)
        for kind, label in LABELS.items():
            axis.plot(angle, values[kind]["torque"], ".", ms=2, label=label)
        axis.set(title=name, ylabel="crank torque (N m)", xlim=(0.0, 2.0 * math.pi))
        axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("crank angle (rad)")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(),
        loc="outside upper center",
        ncols=len(LABELS),
        title="spring for",
        markerscale=4,
    )
    figure.savefig(path, dpi=120)


def picture(robot: Robot, path: Path) -> None:
    """Write a picture of a standing robot."""
    env: gym.Env[Any, Any] = gym.make("JansenWalkerBuilt-v0", robot=robot, render_mode="rgb_array")
    env.reset(seed=0)
    image: Any = env.render()
    plt.imsave(path, image)
    env.close()


def main() -> None:
    """Measure, train, and write the tables, the data, the figures and the robot files."""
    args = options(__doc__, episodes=32, policies=0)
    names, starts, episodes, policies = NAMES, STARTS, args.episodes, args.policies
    if args.quick:
        names, starts, episodes, policies = NAMES[1:2], STARTS[:2], 2, 1
    results = {
        "commands": COMMANDS,
        "starts": starts,
        "episodes": episodes,
        "robots": measure(names, starts, episodes),
    }
    publish(args.out, DATA, results, tables(results))
    folder = (args.out / DATA).parent
    robots = robots_of(results["robots"])
    for (name, kind), robot in robots.items():
        if robot.springs:
            write_robot(folder / f"{name}_{kind}.json", robot)
    draw(results["robots"], folder / "springs.png")
    picture(robots["stroller", "rms"], folder / "robot.png")
    if policies:
        scores = score_policies(results["robots"], policies, episodes, args.quick)
        trained = {"commands": COMMANDS, "episodes": episodes, "scores": scores}
        publish(args.out, POLICIES, trained, {PAGE: policy_tables(trained)})


if __name__ == "__main__":
    main()
