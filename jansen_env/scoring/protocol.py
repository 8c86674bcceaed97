"""Benchmark protocol 1: its tracks, test seeds and episodes (``docs/benchmark.md``).

The protocol is frozen. A different set of episodes or a different score is another protocol, with
another number and other test seeds.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from jansen_env.arrays import Array, Ints
from jansen_env.policies.policy import Controlled, Policy, still
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import Env
from jansen_env.scoring.rollout import (
    Advance,
    EnvKwargs,
    Options,
    make_env,
    no_progress,
    run_episodes,
)
from jansen_env.scoring.walk_hashes import RandomPolicy, Walk, hash_walk
from jansen_env.terrain.generators import HIGHEST, MIXTURE

PROTOCOL = 1
# Test seeds are at least 2^31. The seeds of train.py's default configurations, of tuning, of the
# selection of models and of `jansen-env evaluate` are smaller.
LEAST_SEED = 2**31

Columns: TypeAlias = dict[str, Array]
"""Raw scores of the n episodes of a track by name of :data:`COLUMNS`, each with shape (n,)."""

COLUMNS = (
    "return",
    "success",
    "falls",
    "speed_error",
    "distance",
    "slip",
    "work",
    "unsupported",
    "load",
)
"""Raw scores of an episode.

The success and the fall are 0 or 1. The speed error is in m/s. The distance is in the commanded
direction, in m, and at least 0. The slip is in m. The work is that of the motor divided by the
weight, in m. The unsupported time is a fraction of the episode, and the load is the 99th percentile
of the ground load in weights.
"""


class TrackMetric(NamedTuple):
    """Number for a track: a weighted mean of a column, or the ratio of two such means.

    Attributes:
        heading: Heading in tables.
        column: Name of the column.
        per: Name of the column by whose mean the mean is divided. None for no ratio.
    """

    heading: str
    column: str
    per: str | None = None


METRICS = {
    "return": TrackMetric("return", "return"),
    "success": TrackMetric("success", "success"),
    "falls": TrackMetric("falls", "falls"),
    "speed_error": TrackMetric("speed error (m/s)", "speed_error"),
    "slip_per_metre": TrackMetric("slip (m/m)", "slip", "distance"),
    "cost_of_transport": TrackMetric("cost of transport", "work", "distance"),
    "unsupported": TrackMetric("unsupported time", "unsupported"),
    "load": TrackMetric("load (weights)", "load"),
}
"""Metrics of a track by name. The names are those of the walkers' benchmark."""


@dataclass(frozen=True)
class Part:
    """Episodes of a track in environments with the same arguments.

    Attributes:
        name: Name of the part, such as a kind of terrain.
        env_kwargs: Arguments of the environment in addition to those of the track.
        options: Options of every reset in addition to the command and the terrain level.
        commands: Commands, in m/s. None for those of the environment's benchmark.
        repeats: Number of episodes per command and level.
        levels: Terrain levels. Empty for terrain without levels.
        exact: Whether the episodes have the same bits on every machine.
    """

    name: str
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, float] = field(default_factory=dict)
    commands: tuple[float, ...] | None = None
    repeats: int = 1
    levels: tuple[int, ...] = ()
    exact: bool = True


class EpisodeTable(NamedTuple):
    """Episodes of a track, in order.

    Attributes:
        part: Index of each episode's part, shape (n,).
        command: Commands in m/s, shape (n,).
        level: Terrain levels, shape (n,). -1 for terrain without levels.
        seed: Seeds of the resets, shape (n,).
        stratum: Index of the group of similar episodes to which each episode belongs, shape (n,).
        weight: Weight of each episode in the mean of the track, shape (n,). The sum is 1.
    """

    part: Ints
    command: Array
    level: Ints
    seed: Ints
    stratum: Ints
    weight: Array


@dataclass(frozen=True)
class Track:
    """Track of the benchmark: episodes on which policies are scored.

    Attributes:
        name: Name of the track.
        env_id: Id of the environment.
        primary: Metric from which the score is computed.
        parts: Parts of the track, which have the same weight.
        env_kwargs: Arguments of the environment.
        pretrained: Name of the package's policy for this track.
    """

    name: str
    env_id: str
    primary: Literal["return", "success"]
    parts: tuple[Part, ...]
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    pretrained: str = "ppo"

    @cached_property
    def episodes(self) -> EpisodeTable:
        """The episodes of the track."""
        rows = [
            (index, command, level)
            for index, part in enumerate(self.parts)
            for level in part.levels or (-1,)
            for command in part.commands or find_benchmark(self.env_id).commands
            for _ in range(part.repeats)
        ]
        part, command, level = (np.array(column) for column in zip(*rows, strict=True))
        seeds = [episode_seed(self.name, index) for index in range(len(rows))]
        # Episodes of a level are similar. Without levels, those with the same part and command are.
        keys = [(level,) if level >= 0 else (index, command) for index, command, level in rows]
        numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
        stratum = np.array([numbers[key] for key in keys])
        weight = 1.0 / (len(self.parts) * np.bincount(part)[part])
        return EpisodeTable(part, command, level, np.array(seeds), stratum, weight)

    @property
    def seeds_sha256(self) -> str:
        """SHA-256 of the test seeds, written in decimal, one per line."""
        return hashlib.sha256("\n".join(map(str, self.episodes.seed)).encode()).hexdigest()

    @property
    def groups(self) -> dict[str, Ints]:
        """Indices of the episodes of each level, or part, or command, by its name."""
        episodes = self.episodes
        if episodes.level[0] >= 0:
            labels = np.array([f"level {level}" for level in episodes.level])
        elif len(self.parts) > 1:
            labels = np.array([self.parts[index].name for index in episodes.part])
        else:
            labels = np.array([f"{command:g} m/s" for command in episodes.command])
        return {str(label): np.flatnonzero(labels == label) for label in dict.fromkeys(labels)}

    def make_env(self, part: Part | None = None) -> Env:
        """Make the environment of the track, or that of one of its parts."""
        return make_env(self.env_id, self.arguments(part))

    def arguments(self, part: Part | None = None) -> EnvKwargs:
        """Return the arguments of the environment of the track, or of one of its parts."""
        return {**self.env_kwargs, **(part.env_kwargs if part else {})}


def episode_seed(track: str, index: int) -> int:
    """Return the seed of the reset of an episode, from 2^31 to 2^32 - 1.

    It consists of the first 32 bits of a SHA-256, of which the highest bit is set.

    Args:
        track: Name of the track.
        index: Index of the episode.
    """
    text = f"jansen_env protocol {PROTOCOL}, track {track}, episode {index}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big") | LEAST_SEED


_LEVELS = tuple(range(HIGHEST + 1))
_KINDS = tuple(Part(kind, {"terrain": kind}, repeats=3, levels=_LEVELS) for kind in MIXTURE)

TRACKS = {
    track.name: track
    for track in (
        Track("flat", "JansenWalkerBuilt-v0", "return", (Part("flat", repeats=20),)),
        Track("terrain", "JansenWalkerRough-v0", "success", _KINDS),
        Track("robust", "JansenWalkerHardcore-v0", "success", _KINDS),
        Track(
            "transfer",
            "JansenWalkerBuilt-v0",
            "return",
            (
                Part(
                    "rigid-body backend",
                    {"plant": "rigid_body"},
                    commands=(0.1, 0.3, 0.5),
                    repeats=2,
                    exact=False,
                ),
                Part("time step of 0.25 ms", {"time_step": 0.00025}, repeats=5),
                Part("feet half as stiff", options={"foot_stiffness_scale": 0.5}, repeats=5),
                Part("feet twice as stiff", options={"foot_stiffness_scale": 2.0}, repeats=5),
            ),
        ),
        Track("exploration", "JansenWalker-v0", "return", (Part("flat", repeats=20),)),
        Track(
            "onboard",
            "JansenWalkerBuilt-v0",
            "return",
            (Part("flat", commands=(0.05, 0.1, 0.2, 0.3), repeats=45),),
            env_kwargs={
                "robot": "economy",
                "observe": "onboard",
                "torque_rate": 60.0,
                "speed_command": [0.05, 0.3],
                "delay": [0.0, 0.02],
                "noise": {
                    "encoder": [0.001, 0.01],
                    "gyro": [0.01, 0.005],
                    "accelerometer": [0.2, 0.05],
                    "torque": [0.05, 0.05],
                },
            },
            pretrained="onboard",
        ),
    )
}
"""Tracks of the protocol by name."""


def random_policy(env: Controlled) -> RandomPolicy:
    """Return the policy whose actions are uniformly random."""
    return RandomPolicy(PROTOCOL)


FLOORS: dict[str, Callable[[Controlled], Policy]] = {"stand": still, "random": random_policy}
"""Functions that make the policies to which the score 0 belongs, by name."""

REFERENCE = Path(__file__).with_name("protocol_1.json")


class Scale(NamedTuple):
    """Linear scale of a track's normalised score.

    Attributes:
        zero: Value of the primary metric at the score 0.
        one: Value of the primary metric at the score 1.
    """

    zero: float
    one: float

    def normalise(self, values: Array) -> Array:
        """Return the normalised scores of values of the primary metric."""
        return (values - self.zero) / (self.one - self.zero)


@cache
def scales() -> dict[str, Scale]:
    """Return the frozen scale of each track by name.

    The score 0 is that of standing or of random actions, whichever is better. The score 1 is that
    of the pretrained policy that the package contained when the protocol was frozen.
    """
    values = json.loads(REFERENCE.read_text("utf-8"))
    return {
        name: Scale(max(track[floor] for floor in FLOORS), track["pretrained"])
        for name, track in values.items()
    }


@cache
def tracks_of_seeds() -> dict[int, str]:
    """Return the name of the track of each test seed."""
    return {int(seed): track.name for track in TRACKS.values() for seed in track.episodes.seed}


def check_training_seed(seed: int, count: int) -> None:
    """Check that training does not begin with a test episode.

    Args:
        seed: Seed of a training run. Environment i begins with the seed ``seed`` + i.
        count: Number of environments.

    Raises:
        ValueError: If one of the environments would begin with a test seed.
    """
    if seed + count <= LEAST_SEED:
        return
    for test, track in tracks_of_seeds().items():
        if seed <= test < seed + count:
            raise ValueError(
                f"seed must not lead to a test seed of the benchmark, got {seed}: environment "
                f"{test - seed} would begin with {test}, a test seed of the track {track!r}"
            )


def run_track(policy: Policy, track: Track, advance: Advance = no_progress) -> Columns:
    """Run the episodes of a track.

    Args:
        policy: The policy.
        track: The track.
        advance: Function that is called with the number of episodes that ran since its last call.

    Returns:
        The raw scores of the episodes.
    """
    metrics = find_benchmark(track.env_id).metrics
    episodes = track.episodes
    blocks: list[Columns] = []
    for index, part in enumerate(track.parts):
        (rows,) = np.nonzero(episodes.part == index)
        options: Options = {name: np.full(len(rows), v) for name, v in part.options.items()}
        if part.levels:
            options["terrain_level"] = episodes.level[rows]
        run = run_episodes(
            policy,
            track.env_id,
            track.arguments(part),
            episodes.command[rows],
            episodes.seed[rows],
            options=options,
            advance=advance,
        )
        block: Columns = {}
        with closing(track.make_env(part)) as env:
            for name, metric in METRICS.items():
                function = metrics[name].function
                block[metric.column] = np.asarray(function(run, env), float)
                normaliser = metrics[name].normaliser
                if metric.per is not None and normaliser is not None:
                    block[metric.per] = np.asarray(normaliser(run, env), float)
        blocks.append(block)
    return {name: np.concatenate([block[name] for block in blocks]) for name in COLUMNS}


def metric_value(columns: Columns, metric: TrackMetric, weights: Array) -> Array:
    """Return a metric of a track for one or several sets of weights.

    Args:
        columns: Raw scores of n episodes.
        metric: The metric.
        weights: Weights of the episodes, shape (..., n).

    Returns:
        The metric, shape (...). NaN for a ratio if the robot did not walk.
    """
    value = weights @ columns[metric.column]
    if metric.per is None:
        return np.asarray(value)
    per = weights @ columns[metric.per]
    return np.where(per > 1e-3, value / np.maximum(per, 1e-3), np.nan)


@cache
def plant_hashes() -> dict[str, str]:
    """Return the hash of a walk under random actions on each simulation backend of this machine."""
    steps = {"projection": 200, "rigid_body": 10}  # the second backend is slow
    return {
        plant: hash_walk(Walk("JansenWalkerBuilt-v0", {"plant": plant}, random=True), steps=count)
        for plant, count in steps.items()
    }
