"""Environments stepped the same way in every round, here or in a process of their own.

Only ``gym.make`` and ``gym.make_vec`` are used, so that this file measures any commit's tree:
``PYTHONPATH=TREE python benchmarks/probe.py STEPS`` answers each line of its input ("1", "16": so
many robots) with the steps/s of one play of about STEPS steps of all robots together.
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
    """One environment as ``gym.make`` makes it, and the actions of a play.

    Args:
        policy: observation to action, asked once, in the constructor; None for random actions.
        arguments: of the environment.

    Attributes:
        resets: of the last play, beyond the one it begins with.
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
    """A vector environment and random actions; each play goes on where the last one ended.

    Args:
        venv: Gymnasium's or envpool's, reset. space: of one environment's action. steps: of a play.
    """

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


def robots(count: int, robot_steps: int, **arguments: Any) -> Many:
    """``gym.make_vec``'s robots, whose episodes end as evenly spread in time as in a long run."""
    first, last = LIMITS
    limits = [first + round((last - first) * (i + 0.5) / count) for i in range(count)]
    venv = gym.make_vec(OURS, num_envs=count, max_episode_steps=limits, **arguments)
    venv.reset(seed=0)
    space: Any = venv.single_action_space
    many = Many(venv, count, space, min(max(FEWEST, robot_steps // count), MOST))
    for number in range(first):
        venv.step(many.actions[number % len(many.actions)])
    return many


def fresh(code: str, *arguments: str, folder: Path | None = None, **variables: str) -> str:
    """The last line that ``code`` prints in a new Python process.

    Args:
        arguments: its ``sys.argv[1:]``. folder: it runs in, first of where it looks for packages.
        variables: of the environment, on top of this process's.

    Raises:
        RuntimeError: the code failed.
    """
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=folder,
        env={**os.environ, **variables}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"a new process failed:\n{done.stderr}")
    return done.stdout.splitlines()[-1]


class Tree:
    """A checkout whose package runs in processes of its own, with a cache of its own.

    Args:
        path: of the checkout.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._folder = path.resolve(), tempfile.TemporaryDirectory()
        self._cache = self._folder.name
        self._worker: subprocess.Popen[str] | None = None

    def first(self) -> list[float]:
        """Seconds of each of :data:`STAGES` where nothing has been compiled."""
        self._cache = tempfile.mkdtemp(dir=self._folder.name)
        return self.later()

    def later(self) -> list[float]:
        """Seconds of each of :data:`STAGES`.

        Raises:
            RuntimeError: it failed, or another package than the tree's was found.
        """
        found = fresh(START, str(self.path), folder=self.path, **self._variables())
        seconds: list[float] = json.loads(found)
        return seconds

    def rate(self, count: int, steps: int) -> float:
        """Steps/s of so many environments, in plays of so many steps.

        Raises:
            RuntimeError: its process failed.
        """
        if self._worker is None:
            self._worker = subprocess.Popen(
                [sys.executable, __file__, str(steps)],
                env={**os.environ, **self._variables()},
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )  # fmt: skip
        assert self._worker.stdin is not None and self._worker.stdout is not None
        self._worker.stdin.write(f"{count}\n")
        self._worker.stdin.flush()
        answer = self._worker.stdout.readline()
        if not answer:
            raise RuntimeError(f"the environments of {self.path} failed, see above")
        return float(answer)

    def close(self) -> None:
        """End its process and remove its cache."""
        if self._worker is not None:
            self._worker.communicate()
        self._folder.cleanup()

    def _variables(self) -> dict[str, str]:
        return {"PYTHONPATH": str(self.path), "NUMBA_CACHE_DIR": self._cache}


def main(steps: int) -> None:
    """Answer each line of the input, a number of robots, with their steps/s."""
    players: dict[str, Single | Many] = {}
    for line in sys.stdin:
        name = line.strip()
        if name not in players:
            count = int(name)
            players[name] = Single(OURS, steps) if count == 1 else robots(count, steps)
        print(players[name].play(), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
