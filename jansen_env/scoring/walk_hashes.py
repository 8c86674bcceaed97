"""Published hashes of walks, which tell whether this machine computes the same bits.

``jansen-env verify`` compares them with walks of this machine. This command prints the walks of
this machine as JSON:

    python -m jansen_env.scoring.walk_hashes
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401  # registers the environments
from jansen_env.policies.policy import Memory
from jansen_env.policies.pretrained import load

PUBLISHED = Path(__file__).with_suffix(".json")
STEPS = 200  # number of control steps of a walk
ROBOTS = 4  # number of robots in a batch
LENGTH = 16  # number of hexadecimal digits of a hash


class Walk(NamedTuple):
    """A walk whose hash is published.

    Attributes:
        env_id: Id of the environment.
        arguments: Arguments of the environment.
        random: Whether the actions are random, rather than those of the environment's pretrained
            policy.
    """

    env_id: str
    arguments: dict[str, Any]
    random: bool = False


WALKS = {
    "walker": Walk("JansenWalker-v0", {}),
    "built": Walk("JansenWalkerBuilt-v0", {}),
    "rough": Walk("JansenWalkerRough-v0", {}),
    "hardcore": Walk("JansenWalkerHardcore-v0", {}),
    "goal": Walk("JansenGoal-v0", {}),
    "crank": Walk("JansenCrank-v0", {}),
    "strider on a slope": Walk(
        "JansenWalkerBuilt-v0", {"robot": "strider", "terrain": "slope:0.1"}
    ),
    "waves": Walk("JansenWalkerRough-v0", {"terrain": "waves"}),
    "waves with a load": Walk("JansenWalkerRough-v0", {"terrain": "waves", "payload": 2.0}),
    "walker, random actions": Walk("JansenWalker-v0", {}, random=True),
    "built, random actions": Walk("JansenWalkerBuilt-v0", {}, random=True),
    "rough, random actions": Walk("JansenWalkerRough-v0", {}, random=True),
    "hardcore, random actions": Walk("JansenWalkerHardcore-v0", {}, random=True),
    "goal, random actions": Walk("JansenGoal-v0", {}, random=True),
    "crank, random actions": Walk("JansenCrank-v0", {}, random=True),
}
"""Walks by name. Every environment walks under its pretrained policy and under random actions."""


class RandomPolicy:
    """Policy whose actions are uniformly random, and the same in every run.

    Args:
        seed: Seed of the actions.
    """

    def __init__(self, seed: int = 0) -> None:
        self.seed = seed

    def predict(
        self,
        observation: Any,
        state: Memory = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Memory]:
        """Return random actions for observations, and the generator of the next actions.

        Args:
            observation: Observations of n robots, shape (n, d), or of one robot, shape (d,).
            state: Generator that the previous call returned. None at first.
            episode_start: Has no effect.
            deterministic: Has no effect.

        Returns:
            The actions, shape (n, 1) or (1,), and the generator.
        """
        generator = np.random.default_rng(self.seed) if state is None else state
        shape = (*np.shape(observation)[:-1], 1)
        return generator.uniform(-1.0, 1.0, shape).astype(np.float32), generator


def hash_walk(walk: Walk, robots: int | None = None, steps: int = STEPS) -> str:
    """Return the hash of all observations, rewards and ends of episodes in a walk.

    Args:
        walk: The walk.
        robots: Number of robots of a batch. None for the environment of one robot.
        steps: Number of control steps.
    """
    env: Any = (
        gym.make(walk.env_id, **walk.arguments)
        if robots is None
        else gym.make_vec(walk.env_id, robots, **walk.arguments)
    )
    policy: Any = RandomPolicy() if walk.random else load(walk.env_id).on(env)
    digest = hashlib.sha256()
    state = None
    observation, _ = env.reset(seed=0)
    for _ in range(steps):
        actions, state = policy.predict(observation, state)
        observation, *results, _ = env.step(actions)
        for values in (observation, *results):
            digest.update(np.ascontiguousarray(values).tobytes())
        if robots is None and (results[1] or results[2]):
            observation, _ = env.reset()  # a batch resets its robots itself
    env.close()
    return digest.hexdigest()[:LENGTH]


def walk_hashes(name: str) -> list[str]:
    """Return the hashes that this machine computes for a walk: of one robot, and of a batch.

    Args:
        name: Name of the walk in :data:`WALKS`.
    """
    return [hash_walk(WALKS[name]), hash_walk(WALKS[name], ROBOTS)]


def published_hashes() -> dict[str, list[str]]:
    """Return the published hashes of each walk: of one robot, and of a batch."""
    hashes: dict[str, list[str]] = json.loads(PUBLISHED.read_text("utf-8"))
    return hashes


def main() -> None:
    """Print the hashes of this machine as JSON."""
    print(json.dumps({name: walk_hashes(name) for name in WALKS}, indent=2))


if __name__ == "__main__":
    main()
