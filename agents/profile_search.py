"""The search for crank-speed profiles: CMA-ES (Hansen 2016) on the task's own mean return.

One command of the grid after another, outwards from the first one; each on episodes whose commands
lie around it, with the neighbours' numbers held, so that what counts is the profile as it is
interpolated. All candidates of a generation walk the same episodes, side by side in one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cma
import numpy as np

from agents.policy import Array, TorquePolicy
from agents.profile import Profile, profile_torque
from agents.trials import Outcome, Trials

COMMANDS = (0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)  # m/s
FRICTION = (0.4, 1.0)
FIRST = 0.1  # m/s, from which the search goes outwards
START = (1.3, 7.0, 2.0, 1.5)  # n0, kp, tau0 and g there; no harmonics
HARMONICS = 4
AT_REST = 0.09  # m/s: n0 is taken to a new command in proportion to its distance from -AT_REST
SPREAD = (0.2, 0.25, 1.0, 0.7)  # of log n0, log kp, tau0 and g in a first guess ...
SHAPE_SPREAD = 0.2  # ... and of a_k and b_k, by the root of k
HIGH_GAIN, LOW_GAIN = 30.0, 1.0  # N m s/rad, bounds of kp ...
FEEDBACK = 4.0  # 1/m, ... and of g
# What a fall costs, in returns, beside the rest of its episode, and 1 m/s of drift.
FALL, DRIFT = 50.0, 1000.0


class Sweep(NamedTuple):
    """Once through the grid; ``step_size`` is CMA-ES's sigma, 1 for a first guess."""

    generations: int
    episodes: int
    step_size: float
    candidates: int = 12


SWEEPS = (Sweep(30, 12, 0.8), Sweep(20, 24, 0.3))


def encode(numbers: Array) -> Array:
    """What is searched: the logarithms of n0 and kp, the others as they are."""
    return np.concatenate([np.log(numbers[:2]), numbers[2:]])


def decode(searched: Any) -> Array:
    """Numbers (..., 4 + 2 K) from what :func:`encode` makes of them."""
    values = np.asarray(searched, float)
    return np.concatenate([np.exp(values[..., :2]), values[..., 2:]], axis=-1)


def spread(harmonics: int) -> Array:
    """Standard deviations (4 + 2 K,) of a first guess, of what is searched."""
    shape = SHAPE_SPREAD / np.sqrt(np.arange(1, harmonics + 1))
    return np.concatenate([SPREAD, shape, shape])


def bounds(size: int) -> list[Array]:
    """Lowest and highest values of what is searched."""
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[[1, 3]], high[[1, 3]] = (np.log(LOW_GAIN), 0.0), (np.log(HIGH_GAIN), FEEDBACK)
    return [low, high]


def worth(out: Outcome) -> Array:
    """What is maximised of each episode."""
    return out.returns - FALL * out.fell - DRIFT * np.abs(out.drift)


def triangular(share: Array, left: float, middle: float, right: float) -> Array:
    """Quantiles of the triangular distribution: how much a knot counts between its neighbours."""
    width = right - left
    below = left + np.sqrt(share * width * (middle - left))
    above = right - np.sqrt((1.0 - share) * width * (right - middle))
    return np.where(share * width < middle - left, below, above)


def improve(
    found: dict[float, Array],
    command: float,
    sweep: Sweep,
    rng: np.random.Generator,
    progress: Callable[[Outcome], None],
) -> Array:
    """Better numbers for a command of the grid.

    Args:
        found: numbers by command, m/s; ``command`` among them, the others are held.
    """
    knots, place = sorted(found), sorted(found).index(command)
    left, right = knots[max(place - 1, 0)], knots[min(place + 1, len(knots) - 1)]
    held = np.array([found[knot] for knot in knots])
    held[place] = 0.0
    m, n = sweep.candidates, sweep.episodes
    trials = Trials(np.tile(np.linspace(*FRICTION, n), m))
    start = encode(found[command])
    search = cma.CMAEvolutionStrategy(
        start, sweep.step_size,
        {"bounds": bounds(len(start)), "CMA_stds": spread(len(start) // 2 - 2), "popsize": m, "verbose": -9, "seed": np.nan,
         "randn": lambda *shape: rng.standard_normal(shape)},
    )  # fmt: skip
    for _ in range(sweep.generations):
        # Commands and starts are stratified, each in an order of its own.
        shares = (np.array([rng.permutation(n), rng.permutation(n)]) + rng.random((2, n))) / n
        commands = triangular(shares[0], left, command, right)
        own = np.interp(commands, knots, np.eye(len(knots))[place])[:, None]
        asked = search.ask()
        numbers = Profile(np.array(knots), held).at(commands) + own * decode(asked)[:, None]
        robots = numbers.reshape(m * n, -1)
        policy = TorquePolicy(
            lambda seen, *_, robots=robots: (profile_torque(robots, seen), None),
            trials.torque_limit,
        )
        seeds = np.tile(rng.integers(2**31) + np.arange(n), m)
        out = trials.run(policy, np.tile(commands, m), seeds, np.tile(2.0 * np.pi * shares[1], m))
        search.tell(asked, -worth(out).reshape(m, n).mean(axis=1))
        progress(out)
    trials.close()
    return decode(search.result.xfavorite)


def search_profile(
    commands: tuple[float, ...] = COMMANDS,
    sweeps: tuple[Sweep, ...] = SWEEPS,
    harmonics: int = HARMONICS,
    seed: int = 0,
    progress: Callable[[float, Outcome], None] = lambda *_: None,
    save: Callable[[Profile], None] = lambda _: None,
) -> Profile:
    """The profile at a grid of commands, m/s; :data:`FIRST` must be among them.

    Args:
        progress: is told each generation's command and episodes. save: gets what there is so far.

    Raises:
        ValueError: the commands are out of range.
    """
    if FIRST not in commands:
        raise ValueError(f"commands is {commands}, must have {FIRST} among them")
    rng = np.random.default_rng(seed)
    found: dict[float, Array] = {}
    order = sorted(commands, key=lambda command: (command < FIRST, abs(command - FIRST)))
    for sweep in sweeps:
        for command in order:
            if command not in found:
                found[command] = taken_to(command, found, harmonics)
            found[command] = improve(
                found, command, sweep, rng, lambda out, command=command: progress(command, out)
            )
            knots = sorted(found)
            save(Profile(np.array(knots), np.array([found[knot] for knot in knots])))
    knots = sorted(found)
    return Profile(np.array(knots), np.array([found[knot] for knot in knots]))


def taken_to(command: float, found: dict[float, Array], harmonics: int) -> Array:
    """A first guess: the numbers of the nearest command, the crank faster or slower."""
    if not found:
        return np.concatenate([START, np.zeros(2 * harmonics)])
    nearest = min(found, key=lambda other: abs(other - command))
    numbers = found[nearest].copy()
    numbers[0] *= (command + AT_REST) / (nearest + AT_REST)
    return numbers
