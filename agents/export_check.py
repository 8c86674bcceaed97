"""Whether an exported policy acts as the one in PyTorch does, observation by observation."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.export_c import example
from agents.policy import Policy
from agents.rollout import make_envs
from jansen_env.pretrained import PretrainedPolicy

Array = NDArray[np.float64]
Cases = NDArray[np.float32]  # observations (n, d)

ROBOTS = 20  # side by side
FAR = (0.0, 1.0 - 1e-6, 1.0, 1.0 + 1e-6, 10.0, 1e4)  # times the clip
NORMAL = 2.0  # deviations, of random observations
COMPILERS = ("cc", "gcc", "clang")
OPTIONS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic")


def make_cases(policy: PretrainedPolicy, count: int = 10_000) -> Cases:
    """Observations (n, d): half of them of a rollout on the policy's environment, a quarter random
    ones around their mean in training, a quarter at the clip of the scaling and beyond.

    Args:
        count: n, rounded to whole steps of :data:`ROBOTS`.
    """
    rng, steps = np.random.default_rng(0), max(4, count // ROBOTS)
    rollout = _rollout(policy, steps - 2 * (steps // 4))
    shape = (steps // 4 * ROBOTS, len(policy.observed))
    clip = max((getattr(block, "clip", 0.0) for block in policy.features), default=0.0) or 10.0
    mean, deviation = policy.scale
    spread = [
        NORMAL * rng.normal(size=shape),
        clip * rng.choice(FAR, size=shape) * rng.choice([-1.0, 1.0], size=shape),
    ]
    made = mean + deviation * np.concatenate(spread)
    for place, name in enumerate(policy.observed):
        partner = {"cos": "sin", "sin": "cos"}.get(name[:3], "") + name[3:]
        if name.startswith("cos_") and partner in policy.observed:  # a point of the circle
            angle = rng.uniform(-np.pi, np.pi, len(made))
            made[:, place] = np.cos(angle)
            made[:, policy.observed.index(partner)] = np.sin(angle)
    return np.concatenate([rollout, made.astype(np.float32)])


def _rollout(policy: PretrainedPolicy, steps: int) -> Cases:
    """What a policy observes on its environment."""
    envs = make_envs(policy.env_id, policy.env_kwargs, ROBOTS)
    seen, observations = envs.reset(seed=0)[0], []
    for _ in range(steps):
        observations.append(np.array(seen, np.float32))
        seen = envs.step(policy.predict(seen)[0])[0]
    envs.close()
    return np.concatenate(observations)


def actions_of(policy: Policy, cases: Cases) -> Array:
    """A policy's actions (n,)."""
    with np.errstate(over="ignore"):  # of what lies far beyond
        actions, _ = policy.predict(cases, deterministic=True)
    return np.asarray(actions, float)[:, 0]


def compiler() -> str | None:
    """The C compiler of this machine: that of the variable CC, or one of :data:`COMPILERS`."""
    names = (os.environ.get("CC", ""), *COMPILERS)
    return next((found for name in names if name and (found := shutil.which(name))), None)


def actions_of_c(
    sources: Mapping[str, str], name: str, cases: Cases, options: Sequence[str] = OPTIONS
) -> Array:
    """The actions (n,) of generated C, compiled here with its example program.

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
            [str(folder / "main")], input=as_text(cases), capture_output=True, text=True,
            check=True,
        ).stdout  # fmt: skip
    return np.array(answer.split(), float)


def as_text(cases: Cases) -> str:
    """Observations, one a line, as the example program reads them."""
    return "".join(" ".join(f"{number:.9g}" for number in seen) + "\n" for seen in cases.tolist())


def largest_difference(actions: Array, expected: Array) -> float:
    """Between actions; infinite where one is not finite."""
    difference = np.abs(actions - expected)
    return float(difference.max()) if np.isfinite(difference).all() else np.inf
