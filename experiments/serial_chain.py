"""Does a policy that was trained on a serial-chain model of the legs walk on the closed linkage?

Run the experiment as follows. It takes about half an hour on one core.

    python experiments/serial_chain.py --policies 10 [--seeds 10] [--quick]

Controllers that were made for the closed linkage of the robot ``built`` are tested on simplified
models of this linkage. For each seed, CMA-ES searches for a crank-speed profile on the closed
linkage and on two models, and each profile is tested on all of them. With ``--policies N``, PPO
also trains N policies on each of them. These are kept in ``logs/serial_chain`` and not trained
again. The script writes the tables of docs/serial_chain.md and, in the folder docs/serial_chain,
``serial_chain.json``. The scores of the policies are in ``policies.json``.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from pages import options, publish, table
from scipy.stats import t as student
from trained_policies import ENV, score_policy, train_policy

from jansen_env import ROBOTS, Payload, Robot
from jansen_env.arrays import Array
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.policies.policy import columns
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.tasks.walking.profile import READ, profile_torque

DATA, PAGE = "serial_chain/serial_chain.json", "serial_chain.md"
POLICIES = "serial_chain/policies.json"
RUNS = Path("logs/serial_chain")
COMMAND = "python experiments/serial_chain.py"
COMMANDS = (0.1, 0.3, 0.5, 0.7)  # m/s
SEED = 100  # seed of the episodes in which policies are compared
PROFILE_COMMAND = 0.3  # command for which profiles are searched, in m/s
POPULATION, GENERATIONS = 20, 12  # candidates per generation; number of generations
SEARCH_STEPS, EPISODE_STEPS = 200, 500  # control steps of a search and of a test
GAIN = 3.0  # gain of the crank speed with which the search begins, in N m s/rad
PROFILE_EPISODES = 32  # episodes in which a profile is tested
MASSLESS = 1e-9  # mass of a link that a model leaves out, in kg
CONTROLLERS = ("pretrained", "pretrained:robust", "profile", "pid")
"""Controllers that were trained or tuned on the closed linkage."""
TURN = np.linspace(0.0, 2.0 * math.pi, 256, endpoint=False)

CLOSED, TWO_LINK, LUMPED = "closed linkage", "two-link legs", "lumped legs"
METRICS = {
    "return": 0,
    "steady_speed_error": 3,
    "steady_slip_per_metre": 3,
    "steady_cost_of_transport": 3,
    "load": 2,
    "falls": 3,
}
"""Metrics, and the number of decimals in the tables."""

CONTROLLER_METRICS = {
    "return": 0,
    "steady_speed_error": 3,
    "steady_slip_per_metre": 2,
    "steady_cost_of_transport": 2,
}
"""Metrics of the controllers that were made for the closed linkage."""

Means = dict[str, dict[str, list[dict[str, Any]]]]
"""Metrics of every seed, by the model of the training and the model of the test."""


def without_links(robot: Robot, kept: Collection[str]) -> Robot:
    """Return a robot in which all links except the frame and some others have no inertia.

    The toes keep their paths. The mass of the links that are left out is added to the chassis, at
    their mean centre of mass and with their mean moment of inertia over a turn of the crank. Only
    pins between two links that are kept have friction.

    Args:
        robot: The robot.
        kept: Names of the links that keep their inertia.
    """
    names = robot.linkage.names
    kept = {"frame", *kept}
    out = {
        name: replace(link, mass=MASSLESS, inertia=0.0)
        for name, link in zip(names, robot.bodies, strict=True)
        if name not in kept
    }
    friction = tuple(
        torque if {names[a - 1], names[b - 1]} <= kept else 0.0
        for (a, b), torque in zip(robot.linkage.bearings, robot.bearing_friction, strict=True)
    )
    light = replace(robot.with_bodies(**out), bearing_friction=friction)
    full, bare = (body_sums(compile_robot(each), TURN) for each in (robot, light))
    mass = robot.mass - light.mass
    x, y = ((full.c - bare.c).mean(axis=0) / mass).tolist()
    inertia = float((full.I - bare.I).mean()) - mass * (x * x + y * y)
    return replace(light, payload=Payload(mass, inertia, (x, y)))


def with_flywheel(robot: Robot, closed: Robot) -> Robot:
    """Return a robot whose cranks have the mean inertia of the closed linkage at the crank.

    Args:
        robot: Robot whose legs have no inertia.
        closed: Robot with the closed linkage.
    """
    inertia = float(body_sums(compile_robot(closed), TURN).k.mean())
    inertia -= float(body_sums(compile_robot(robot), TURN).k.mean())
    crank = replace(robot.body("crank"), inertia=inertia / len(robot.legs))
    return robot.with_bodies(crank=crank)


def models() -> dict[str, Robot]:
    """Return the closed linkage and its two simplifications."""
    closed = ROBOTS["built"]()
    return {
        CLOSED: closed,
        TWO_LINK: without_links(closed, ("rocker", "foot")),
        LUMPED: with_flywheel(without_links(closed, ()), closed),
    }


def half_steps() -> dict[str, Robot]:
    """Return models that change only one property, on which only the controllers walk."""
    closed = ROBOTS["built"]()
    frictionless = (0.0,) * len(closed.bearing_friction)
    return {
        "closed linkage, pins without friction": replace(closed, bearing_friction=frictionless),
        "two-link legs with a flywheel": with_flywheel(models()[TWO_LINK], closed),
    }


def crank_inertia(robot: Robot) -> tuple[float, float]:
    """Return the smallest and the largest inertia at the crank over a turn, in kg m^2."""
    k = body_sums(compile_robot(robot), TURN).k
    return float(k.min()), float(k.max())


def search_profile(robot: Robot, seed: int, generations: int = GENERATIONS) -> Array:
    """Search for a crank-speed profile by CMA-ES, and return its parameters.

    Args:
        robot: Model on which the profile is searched.
        seed: Seed of the search and of the initial states.
        generations: Number of generations.
    """
    import cma

    env, read = _profile_env(robot, POPULATION, SEARCH_STEPS)
    turning = 2.0 * math.pi * PROFILE_COMMAND / advance_per_turn(robot)

    def parameters(points: Array) -> Array:
        numbers = np.array(points)
        numbers[:, 0] = turning * np.exp(numbers[:, 0])
        numbers[:, 1] = GAIN * np.exp(numbers[:, 1])
        return numbers

    search = cma.CMAEvolutionStrategy(
        np.zeros(8), 0.4, {"popsize": POPULATION, "seed": seed + 1, "verbose": -9}
    )
    for generation in range(generations):
        points = np.array(search.ask())
        seeds = [1000 * (seed + 1) + generation] * POPULATION  # the same start for all candidates
        returns = _profile_returns(env, parameters(points), read, seeds, SEARCH_STEPS)
        search.tell(points, -returns)
    env.close()
    return parameters(search.mean[None])[0]


def _profile_env(robot: Robot, count: int, steps: int) -> tuple[Any, list[int]]:
    """Return environments at the command of the profiles, and the columns that a profile reads."""
    arguments: dict[str, Any] = {
        "robot": robot,
        "speed_command": PROFILE_COMMAND,
        "max_episode_steps": steps,
    }
    env: Any = gym.make_vec(ENV, count, vectorization_mode="vector_entry_point", **arguments)
    single: Any = gym.make(ENV, robot=robot).unwrapped
    return env, list(columns(single, *READ))


def _profile_returns(
    env: Any, numbers: Array, read: list[int], seeds: Sequence[int], steps: int
) -> Array:
    """Return the return of an episode of each profile.

    Args:
        env: Environments.
        numbers: Parameters of the profile of each environment.
        read: Indices of the observations that a profile reads.
        seeds: Seed of the initial state of each environment.
        steps: Number of steps of an episode.
    """
    observations, _ = env.reset(seed=[*seeds])
    returns = np.zeros(len(numbers))
    alive = np.ones(len(numbers), bool)
    for _ in range(steps):
        torques = profile_torque(numbers, observations.astype(float), read)
        actions = np.clip(torques / env.unwrapped.torque_limit, -1.0, 1.0)
        observations, rewards, terminated, _, _ = env.step(actions[:, None].astype(np.float32))
        returns += np.where(alive, rewards, 0.0)
        alive &= ~terminated
    return returns


def score_profile(numbers: Array, robot: Robot, episodes: int) -> float:
    """Return the mean return of a profile on a model, over episodes of 10 s.

    Args:
        numbers: Parameters of the profile.
        robot: The model.
        episodes: Number of episodes, each of which has a different initial state.
    """
    env, read = _profile_env(robot, episodes, EPISODE_STEPS)
    repeated = np.tile(numbers, (episodes, 1))
    seeds = range(10**6, 10**6 + episodes)
    returns = _profile_returns(env, repeated, read, seeds, EPISODE_STEPS)
    env.close()
    return float(returns.mean())


def score(name: str, robot: Robot, episodes: int) -> dict[str, float | None]:
    """Return the metrics of a policy on a model, averaged over commands and episodes.

    A baseline is made for the closed linkage, and does not know the model on which it walks.

    Args:
        name: Name of a baseline or of a pretrained policy, or the file of a policy.
        robot: The model.
        episodes: Number of episodes per command.
    """
    closed = models()[CLOSED]
    found = score_policy(name, robot, COMMANDS, episodes, SEED, made_for=closed)["overall"]
    return {metric: found[metric][0] for metric in METRICS}


def score_policies(robots: dict[str, Robot], count: int, episodes: int, quick: bool) -> Means:
    """Train policies on each model, test each of them on all models, and return the metrics.

    Args:
        robots: Models by name.
        count: Number of policies per model, each with its own seed.
        episodes: Number of episodes per command and policy.
        quick: Whether to train for two rollouts only.
    """
    scores: Means = {name: {other: [] for other in robots} for name in robots}
    for seed in range(count):
        for name, robot in robots.items():
            folder = RUNS / f"{name.replace(' ', '_')}_{seed}"
            file = train_policy(folder, robot, seed, COMMAND, quick)
            for other, there in robots.items():
                scores[name][other].append(score(str(file), there, episodes))
            returns = [scores[name][other][-1]["return"] for other in robots]
            print(f"seed {seed}, {name}: {returns}", flush=True)
    return scores


def mean_and_half_width(values: Sequence[float | None]) -> tuple[float, float]:
    """Return the mean of the values of all seeds and half the width of its 95 % interval.

    A metric of steady walking is None if the robot fell in the first 2 s of every episode.
    """
    known = [value for value in values if value is not None]
    count = len(known)
    if count < 2:
        return (known or [math.nan])[0], math.nan
    error = float(np.std(known, ddof=1)) / math.sqrt(count)
    return float(np.mean(known)), float(student.ppf(0.975, count - 1)) * error


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: the models, the controllers, and the searched profiles."""
    properties = [
        [name, f"{values['moving_mass']:.2f}", *(f"{k:.4f}" for k in values["crank_inertia"])]
        for name, values in results["models"].items()
    ]
    made = [
        table(
            ["model", "moving mass (kg)", "smallest inertia at the crank (kg m²)", "largest"],
            properties,
        )
    ]
    rows = [
        [controller, *(f"{values[metric]:.{decimals}f}" for values in by_model.values())]
        for metric, decimals in CONTROLLER_METRICS.items()
        for controller, by_model in results["controllers"].items()
    ]
    count = len(results["controllers"])
    for k, metric in enumerate(CONTROLLER_METRICS):
        head = f"controller of the {CLOSED}: {metric.replace('_', ' ')}"
        made.append(table([head, *results["models"]], rows[k * count : (k + 1) * count]))
    profiles = results["profiles"] if results["seeds"] else {}
    rows = [
        [name, *("{:.1f} ± {:.1f}".format(*mean_and_half_width(values)) for values in by.values())]
        for name, by in profiles.items()
    ]
    if rows:
        made.append(table(["return of profiles that were searched on", *profiles], rows))
    return {PAGE: made}


def policy_tables(policies: dict[str, Any]) -> list[str]:
    """Return the tables of the policies that were trained on the models.

    Args:
        policies: Content of the data file :data:`POLICIES`.
    """
    means: Means = policies["scores"]
    names = [*means]
    made: list[str] = []
    differences = []
    closed = [values["return"] for values in means[CLOSED][CLOSED]]
    for name in names[1:]:
        own, there = (
            [values["return"] for values in means[name][model]] for model in (name, CLOSED)
        )
        back = [values["return"] for values in means[CLOSED][name]]
        lost = [a - b for a, b in zip(there, closed, strict=True)]
        columns = [mean_and_half_width(values) for values in (own, there, lost, back)]
        cells = [f"{mean:.1f} ± {half_width:.1f}" for mean, half_width in columns]
        differences.append([name, *cells])
    heads = (
        "return on this model",
        "return on the closed linkage",
        "minus policies of the closed linkage there",
        "policies of the closed linkage on this model",
    )
    made.append(table(["trained on", *heads], differences))
    for metric, decimals in METRICS.items():
        rows = []
        for name in names:
            found = (
                mean_and_half_width([values[metric] for values in means[name][model]])
                for model in names
            )
            rows.append([name, *(f"{a:.{decimals}f} ± {b:.{decimals}f}" for a, b in found)])
        made.append(table([metric.replace("_", " "), *names], rows))
    return made


def main() -> None:
    """Train, measure, and write the data and the tables."""
    args = options(__doc__, seeds=10, policies=0)
    seeds = range(1 if args.quick else args.seeds)
    episodes = 1 if args.quick else 10
    robots = models()
    all_models = {**robots, **half_steps()}
    controllers = {
        name: {other: score(name, robot, episodes) for other, robot in all_models.items()}
        for name in CONTROLLERS
    }
    profiles: dict[str, dict[str, list[float]]]
    profiles = {name: {other: [] for other in robots} for name in robots}
    for seed in seeds:
        for name, robot in robots.items():
            numbers = search_profile(robot, seed, 1 if args.quick else GENERATIONS)
            for other, there in robots.items():
                profiles[name][other].append(score_profile(numbers, there, PROFILE_EPISODES))
    properties = {
        name: {
            "moving_mass": len(robot.legs)
            * sum(
                link.mass
                for body, link in zip(robot.linkage.names, robot.bodies, strict=True)
                if body != "frame"
            ),
            "crank_inertia": crank_inertia(robot),
        }
        for name, robot in all_models.items()
    }
    results = {
        "commands": COMMANDS,
        "episodes": episodes,
        "seeds": len(seeds),
        "models": properties,
        "controllers": controllers,
        "profiles": profiles,
    }
    publish(args.out, DATA, results, tables(results))
    policies = 1 if args.quick else args.policies
    if policies:
        trained = {
            "commands": COMMANDS,
            "episodes": episodes,
            "policies": policies,
            "scores": score_policies(robots, policies, episodes, args.quick),
        }
        publish(args.out, POLICIES, trained, {PAGE: policy_tables(trained)})


if __name__ == "__main__":
    main()
