"""The search for crank-speed profiles: CMA-ES (Hansen 2016) on the task's own mean return.

One command of the grid after another, on episodes whose commands lie around it, with the
neighbours' numbers held, so that what counts is the profile as it is interpolated. All candidates
of a generation walk the same episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import cma
import numpy as np
from numpy.typing import ArrayLike

from jansen_env.baselines.policy import Array, TorquePolicy, columns
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import Episodes
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.profile import READ, Profile, profile_torque

Numbers = TypeVar("Numbers")
ENV = "JansenWalker-v0"
COMMANDS = (0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8)  # m/s
HARMONICS = 4
FRICTION = (0.4, 1.0)
# Slow and fast walking are two gaits whose numbers do not blend. Below BORDER, m/s, and above, the
# search begins at one command each, with what longer searches from no harmonics had found there.
BORDER = 0.375
FIRST = {
    0.1: (0.95, 5.0, 3.0, 1.0, -0.45, -0.1, 0.0, 0.0, -0.4, 0.4, 0.0, 0.2),
    0.5: (3.7, 4.2, 4.2, 1.9, -0.3, 0.0, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0),
}
REST = 0.085  # m/s: n0 of other commands in proportion to their distance from -REST, at first
SPREAD = (0.2, 0.25, 1.0, 0.7)  # of log n0, log kp, tau0 and g in the search's first generation ...
SHAPE_SPREAD = 0.2  # ... and of a_k and b_k, by the root of k
GAINS, FEEDBACKS = (1.0, 30.0), (0.0, 4.0)  # bounds of kp and g
# What is taken off an episode's return for a fall, and for 1 m/s of drift.
FALL, DRIFT = 200.0, 2000.0


Progress = Callable[[float, Episodes], None]
"""Gets each generation's command and episodes."""


class Sweep(NamedTuple):
    """Once through the grid; ``step_size`` is CMA-ES's sigma, 1 for a first guess."""

    generations: int
    episodes: int
    step_size: float
    candidates: int = 12


SWEEPS = (Sweep(30, 12, 0.5), Sweep(25, 16, 0.3), Sweep(12, 24, 0.15))


def encode(numbers: Array) -> Array:
    """Return the search variables (4 + 2 K,): log(n0), log(kp) and the other numbers unchanged."""
    return np.concatenate([np.log(numbers[:2]), numbers[2:]])


def decode(searched: ArrayLike) -> Array:
    """Return numbers (..., 4 + 2 K) from search variables of :func:`encode`."""
    values = np.asarray(searched, float)
    return np.concatenate([np.exp(values[..., :2]), values[..., 2:]], axis=-1)


def make_search(start: Array, sweep: Sweep, rng: np.random.Generator) -> cma.CMAEvolutionStrategy:
    """Return CMA-ES around numbers (4 + 2 K,), with its random numbers from ``rng``."""
    size, harmonics = len(start), len(start) // 2 - 2
    shape = SHAPE_SPREAD / np.sqrt(np.arange(1, harmonics + 1))
    low, high = np.full((2, size), [[-np.inf], [np.inf]])
    low[[1, 3]], high[[1, 3]] = np.transpose([np.log(GAINS), FEEDBACKS])
    options = {
        "CMA_stds": np.concatenate([SPREAD, shape, shape]), "bounds": [low, high],
        "popsize": sweep.candidates, "randn": lambda *shape: rng.standard_normal(shape),
        "seed": np.nan,  # leave numpy's global generator alone
        "verbose": -9,
    }  # fmt: skip
    return cma.CMAEvolutionStrategy(encode(start), sweep.step_size, options)


def worth(run: Episodes, env: Any) -> Array:
    """Return the objective of each episode (n,): return less costs of falls and speed error."""
    drift = find_benchmark(env.spec.id).metrics["steady_speed_error"].function(run, env)
    return run["returns"] - FALL * run["fell"] - DRIFT * drift


def triangular(share: Array, left: float, middle: float, right: float) -> Array:
    """Return quantiles of the triangular distribution: how much a knot counts between others."""
    width = right - left
    below = left + np.sqrt(share * width * (middle - left))
    above = right - np.sqrt((1.0 - share) * width * (right - middle))
    return np.where(share * width < middle - left, below, above)


def improve(
    numbers_at: dict[float, Array], command: float, sweep: Sweep, rng: np.random.Generator,
    progress: Progress = lambda *_: None, env_id: str = ENV, **env_kwargs: object,
) -> Array:  # fmt: skip
    """Return better numbers for a command of the grid; ``numbers_at`` has the numbers of each, of
    which the others are held."""
    knots = sorted(numbers_at)
    place, m, n = knots.index(command), sweep.candidates, sweep.episodes
    left, right = knots[max(place - 1, 0)], knots[min(place + 1, len(knots) - 1)]
    held = np.array([numbers_at[knot] for knot in knots])
    held[place] = 0.0
    rest = Profile(np.array(knots), held)
    search = make_search(numbers_at[command], sweep, rng)
    env = make_env(env_id, env_kwargs)
    for _ in range(sweep.generations):
        # Commands and starts are stratified, each in an order of its own.
        orders = np.array([rng.permutation(n), rng.permutation(n)])
        shares = (orders + rng.random((2, n))) / n
        commands, angles = triangular(shares[0], left, command, right), 2.0 * np.pi * shares[1]
        weight = np.interp(commands, knots, np.eye(len(knots))[place])[:, None]
        asked = search.ask()
        numbers = rest.at(commands) + weight * decode(asked)[:, None]
        policy = profiles(numbers.reshape(m * n, -1), env)
        starts = commands, rng.integers(2**31) + np.arange(n), np.linspace(*FRICTION, n), angles
        command_of, seeds, friction, angle = (np.tile(each, m) for each in starts)
        run = run_episodes(policy, env_id, env_kwargs, command_of, seeds, at_once=m * n,
                           options={"friction": friction, "crank_angle": angle})  # fmt: skip
        search.tell(asked, -worth(run, env).reshape(m, n).mean(axis=1))
        progress(command, run)
    env.close()
    return decode(search.result.xfavorite)


def profiles(numbers: Array, env: Any) -> TorquePolicy:
    """Return a policy for n walkers, each with its own row of numbers (n, 4 + 2 K)."""
    read = columns(env, *READ)
    return TorquePolicy(lambda seen, *_: (profile_torque(numbers, seen, read), None),
                        env.unwrapped.torque_limit)  # fmt: skip


def same_gait(command: float, numbers_at: Mapping[float, Numbers]) -> dict[float, Numbers]:
    """Return of numbers by command those of the gait that a command is walked in."""
    return {v: numbers for v, numbers in numbers_at.items() if (v < BORDER) == (command < BORDER)}


def first_guess(command: float, numbers_at: Mapping[float, Array], harmonics: int) -> Array:
    """Return the numbers of the nearest command of its gait, with a faster or slower crank."""
    known: dict[float, ArrayLike] = {**same_gait(command, numbers_at)}
    known = known or {**same_gait(command, FIRST)}
    nearest = min(known, key=lambda other: abs(other - command))
    start = np.array(known[nearest])
    shape = np.zeros((2, harmonics))
    kept = min(harmonics, len(start) // 2 - 2)
    shape[:, :kept] = start[4:].reshape(2, -1)[:, :kept]
    start[0] *= (command + REST) / (nearest + REST)
    return np.concatenate([start[:4], shape.ravel()])


def search_profile(
    commands: Sequence[float], sweeps: Sequence[Sweep], harmonics: int = HARMONICS, seed: int = 0,
    progress: Progress = lambda *_: None, env_id: str = ENV,
) -> Iterator[Profile]:  # fmt: skip
    """Give the profile at a grid of commands, m/s, above 0, after each sweep.

    Args:
        harmonics: K. seed: the same one, the same profile. progress: see :data:`Progress`.
        env_id: whose robot walks.
    """
    rng = np.random.default_rng(seed)
    numbers_at: dict[float, Array] = {}
    begin = {command < BORDER: command for command in FIRST}
    order = sorted(commands, key=lambda c: (c > BORDER, abs(c - begin[c < BORDER])))
    for sweep in sweeps:
        for command in order:
            if command not in numbers_at:
                numbers_at[command] = first_guess(command, numbers_at, harmonics)
            # At first without the other gait, whose commands would spoil those in between.
            held = numbers_at if len(numbers_at) == len(order) else same_gait(command, numbers_at)

            numbers_at[command] = improve(held, command, sweep, rng, progress, env_id)
        knots = sorted(numbers_at)
        yield Profile(np.array(knots), np.array([numbers_at[knot] for knot in knots]))
