"""Environments stepped the same way in every round, here or in a process of their own.

Only ``gym.make`` and ``gym.make_vec`` are used, so that this file measures any commit's tree:
``PYTHONPATH=TREE python benchmarks/probe.py COUNT STEPS`` prints the steps/s of so many robots in
plays of about STEPS steps of all together.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401 - registers the environments

OURS = "JansenWalker-v0"
FEWEST, MOST = 16, 5000  # vector steps of a play
LIMITS = 250, 750  # steps of an episode of a batch, differing by robot; 500 in the mean

START = """
import json, pathlib, sys, time
times = [time.perf_counter()]
import jansen_env
times.append(time.perf_counter())
where = pathlib.Path(jansen_env.__file__)
assert where.is_relative_to(sys.argv[1]), f"{where} was imported, must be in {sys.argv[1]}"
assert not {"torch", "stable_baselines3"} & set(sys.modules), "import brings what training needs"
import gymnasium
env = gymnasium.make("JansenWalker-v0")
times.append(time.perf_counter())
env.reset(seed=0)
times.append(time.perf_counter())
env.step(env.action_space.sample())
times.append(time.perf_counter())
print(json.dumps([b - a for a, b in zip(times, times[1:])]))
"""
"""Prints the seconds of each of :data:`STAGES`, of the package in the tree it is given."""
STAGES = ("import", "make", "reset", "step")


class Single:
    """One environment and the actions of a play: those of a policy in its first run, or random.

    ``resets``: of the last play, beyond the one it begins with.
    """

    def __init__(
        self, env_id: str, steps: int, policy: Callable[[Any], Any] | None = None, **arguments: Any
    ) -> None:
        self.env: gym.Env[Any, Any] = gym.make(env_id, **arguments)
        self.env.action_space.seed(0)
        self.resets = 0
        self.actions: list[Any] = []
        if policy is None:
            self.actions = [self.env.action_space.sample() for _ in range(steps)]
            return
        observation, _ = self.env.reset(seed=0)
        for _ in range(steps):
            self.actions.append(policy(observation))
            observation, _, terminated, truncated, _ = self.env.step(self.actions[-1])
            if terminated or truncated:
                observation, _ = self.env.reset()

    def play(self) -> float:
        """Take all actions from the same start, resetting when an episode ends; steps/s."""
        env, resets = self.env, 0
        env.reset(seed=0)
        start = time.perf_counter()
        for action in self.actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
                resets += 1
        spent = time.perf_counter() - start
        self.resets = resets
        return len(self.actions) / spent

    @property
    def step_duration(self) -> float:
        """Simulated time of a step, s: what a frame of the environment lasts."""
        return 1.0 / float(self.env.metadata["render_fps"])


class Many:
    """A vector environment, reset, and random actions; each play goes on where the last ended."""

    def __init__(self, venv: Any, count: int, space: Any, steps: int) -> None:
        self.venv, self.count = venv, count
        drawn = np.random.default_rng(0).uniform(
            space.low, space.high, (steps, count, *space.shape)
        )
        self.actions = list(drawn.astype(space.low.dtype))

    def play(self) -> float:
        """Take all actions; environment steps/s, in which a reset counts as a step."""
        start = time.perf_counter()
        for action in self.actions:
            self.venv.step(action)
        return self.count * len(self.actions) / (time.perf_counter() - start)


def robots(count: int, robot_steps: int, env_id: str = OURS, **arguments: Any) -> Many:
    """``gym.make_vec``'s robots, whose episodes end as evenly spread in time as in a long run."""
    first, last = LIMITS
    limits = [first + round((last - first) * (i + 0.5) / count) for i in range(count)]
    venv = gym.make_vec(env_id, num_envs=count, max_episode_steps=limits, **arguments)
    venv.reset(seed=0)
    space: Any = venv.single_action_space
    many = Many(venv, count, space, min(max(FEWEST, robot_steps // count), MOST))
    for number in range(first):
        venv.step(many.actions[number % len(many.actions)])
    return many


class Tree:
    """A checkout at ``path`` whose package runs in new processes, with its own cache."""

    def __init__(self, path: Path) -> None:
        self.path, self._folder = path.resolve(), tempfile.TemporaryDirectory()
        self._cache = self._folder.name

    def first(self) -> list[float]:
        """Seconds of each of :data:`STAGES` where nothing has been compiled."""
        self._cache = tempfile.mkdtemp(dir=self._folder.name)
        return self.later()

    def later(self) -> list[float]:
        """Seconds of each of :data:`STAGES`."""
        seconds: list[float] = self._answer(START, self.path)
        return seconds

    def rate(self, count: int, steps: int) -> float:
        """Steps/s of so many environments: the median of three plays after one to warm up."""
        return float(self._answer(Path(__file__).read_text(encoding="utf-8"), count, steps))

    def close(self) -> None:
        """Remove its cache."""
        self._folder.cleanup()

    def _answer(self, code: str, *arguments: object) -> Any:
        """Return the JSON that ``code`` prints last, in a process with these ``sys.argv[1:]``."""
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, arguments)], cwd=self.path,
            env={**os.environ, **self._variables()}, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            raise RuntimeError(f"a process of {self.path} failed:\n{done.stderr}")
        return json.loads(done.stdout.splitlines()[-1])

    def _variables(self) -> dict[str, str]:
        return {"PYTHONPATH": str(self.path), "NUMBA_CACHE_DIR": self._cache}


def main(count: int, steps: int) -> None:
    """Print the steps/s of so many environments: the median of three plays after one to warm up."""
    player = Single(OURS, steps) if count == 1 else robots(count, steps)
    player.play()
    print(median(player.play() for _ in range(3)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
