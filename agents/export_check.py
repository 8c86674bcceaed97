"""Whether an exported policy acts as the one in PyTorch does, observation by observation."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.export_c import example
from agents.policy import Policy
from agents.rollout import make_envs
from jansen_env.pretrained import PretrainedPolicy

Array = NDArray[np.float64]

ROBOTS = 20  # side by side
STARTS = 0.02  # of the steps that are not a rollout's
FAR = (0.0, 1.0 - 1e-6, 1.0, 1.0 + 1e-6, 10.0, 1e4)  # times the clip
NORMAL = 2.0  # deviations, of random observations
COMPILERS = ("cc", "gcc", "clang")
OPTIONS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic")


class Cases(NamedTuple):
    """Observations (steps, robots, d) float32 of robots side by side, and whether an episode starts
    (steps, robots) with them."""

    observations: NDArray[np.float32]
    starts: NDArray[np.bool_]


def make_cases(policy: PretrainedPolicy, count: int = 10_000) -> Cases:
    """Observations: half of them of a rollout on the policy's environment, a quarter random ones
    around their mean in training, a quarter at the clip of the scaling and beyond.

    Args:
        count: how many, rounded to whole steps of :data:`ROBOTS`.
    """
    rng, steps = np.random.default_rng(0), max(4, count // ROBOTS)
    rollout, rollout_starts = _rollout(policy, steps - 2 * (steps // 4))
    shape = (steps // 4, ROBOTS, len(policy.observed))
    clip = max((getattr(block, "clip", 0.0) for block in policy.features), default=0.0) or 10.0
    mean, deviation = (np.ravel(each)[: shape[-1]] for each in policy.scale)
    spread = [
        NORMAL * rng.normal(size=shape),
        clip * rng.choice(FAR, size=shape) * rng.choice([-1.0, 1.0], size=shape),
    ]
    made = mean + deviation * np.concatenate(spread)
    for place, name in enumerate(policy.observed):
        partner = {"cos": "sin", "sin": "cos"}.get(name[:3], "") + name[3:]
        if name.startswith("cos_") and partner in policy.observed:  # a point of the circle
            angle = rng.uniform(-np.pi, np.pi, made.shape[:2])
            made[..., place], made[..., policy.observed.index(partner)] = (
                np.cos(angle),
                np.sin(angle),
            )
    starts = rng.random(made.shape[:2]) < STARTS
    starts[0] = True
    observations = np.concatenate([rollout, made.astype(np.float32)])
    return Cases(observations, np.concatenate([rollout_starts, starts]))


def _rollout(policy: PretrainedPolicy, steps: int) -> Cases:
    """What a policy observes on its environment."""
    envs = make_envs(policy.env_id, policy.env_kwargs, ROBOTS)
    seen, state = envs.reset(seed=0)[0], None
    starts = np.ones(ROBOTS, bool)
    observations, begun = [], []
    for _ in range(steps):
        observations.append(np.asarray(seen, np.float32).copy())
        begun.append(starts)
        actions, state = policy.predict(seen, state, starts)
        seen, _, terminated, truncated, _ = envs.step(actions)
        starts = terminated | truncated
    envs.close()
    return Cases(np.array(observations), np.array(begun))


def actions_of(policy: Policy, cases: Cases) -> Array:
    """A policy's actions (steps, robots)."""
    state, found = None, []
    with np.errstate(over="ignore"):  # of what lies far beyond
        for seen, starts in zip(*cases, strict=True):
            actions, state = policy.predict(seen, state, starts, True)
            found.append(np.asarray(actions, float)[:, 0])
    return np.array(found)


def compiler() -> str | None:
    """The C compiler of this machine: that of the variable CC, or one of :data:`COMPILERS`."""
    names = (os.environ.get("CC", ""), *COMPILERS)
    return next((found for name in names if name and (found := shutil.which(name))), None)


def actions_of_c(
    sources: Mapping[str, str], name: str, cases: Cases, options: Sequence[str] = OPTIONS
) -> Array:
    """The actions (steps, robots) of generated C, compiled here with its example program.

    Args:
        sources: texts by file name. name: of the policy. options: of the compiler.

    Raises:
        ValueError: there is no compiler, or it refuses the source.
    """
    command = compiler()
    if command is None:
        raise ValueError(f"no C compiler found, must be one of {list(COMPILERS)}, or CC's")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for file, text in {**sources, "main.c": example(name)}.items():
            (folder / file).write_text(text, encoding="ascii")
        build = [command, *options, "-o", "main", "main.c", f"{name}.c", "-lm"]
        made = subprocess.run(build, cwd=folder, capture_output=True, text=True, check=False)
        if made.returncode != 0:
            raise ValueError(f"{' '.join(build)} failed: {made.stderr.strip()}")
        answer = subprocess.run(
            [str(folder / "main")], input=_as_text(cases), capture_output=True, text=True,
            check=True,
        ).stdout  # fmt: skip
    steps, robots = cases.starts.shape
    return np.array(answer.split(), float).reshape(robots, steps).T


def _as_text(cases: Cases) -> str:
    """Observations robot by robot, as the example program reads them."""
    lines = []
    for robot in range(cases.starts.shape[1]):
        for seen, starts in zip(cases.observations[:, robot], cases.starts[:, robot], strict=True):
            if starts:
                lines.append("reset")
            lines.append(" ".join(f"{number:.9g}" for number in seen.tolist()))
    return "\n".join(lines) + "\n"


def largest_difference(actions: Array, expected: Array) -> float:
    """Between actions; infinite where one is not finite."""
    difference = np.abs(actions - expected)
    return float(difference.max()) if np.isfinite(difference).all() else np.inf
