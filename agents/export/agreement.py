"""Agreement of an exported policy with the one in PyTorch, observation by observation."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.pack import random_observations
from jansen_env.baselines.policy import Policy
from jansen_env.policies.network import Normalized
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.scoring.rollout import make_envs

Array = NDArray[np.float64]
Cases = NDArray[np.float32]  # observations (n, d)

ROBOTS = 20  # side by side
FAR = (0.0, 1.0 - 1e-6, 1.0, 1.0 + 1e-6, 10.0, 1e4)  # times the clip
COMPILERS = ("cc", "gcc", "clang")
OPTIONS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic")


def make_cases(policy: PretrainedPolicy, count: int = 10_000) -> Cases:
    """Return observations (n, d): half of them of a rollout on the policy's environment, a quarter
    random ones around their mean in training, a quarter at the clip of the scaling and beyond.

    ``count`` is n, rounded to whole steps of :data:`ROBOTS`.
    """
    rng, steps = np.random.default_rng(0), max(4, count // ROBOTS)
    quarter = (steps // 4 * ROBOTS, len(policy.observed))
    clip = max((b.clip for b in policy.features if isinstance(b, Normalized)), default=10.0)
    far = clip * rng.choice(FAR, size=quarter) * rng.choice([-1.0, 1.0], size=quarter)
    near = 2.0 * rng.normal(size=quarter)
    made = random_observations(policy, np.concatenate([near, far]), rng)
    envs = make_envs(policy.env_id, policy.env_kwargs, ROBOTS)
    seen, walked = envs.reset(seed=0)[0], []
    for _ in range(steps - 2 * (steps // 4)):
        walked.append(np.array(seen, np.float32))
        seen = envs.step(policy.predict(seen)[0])[0]
    envs.close()
    return np.concatenate([*walked, made])


def actions_of(policy: Policy, cases: Cases) -> Array:
    """Return a policy's actions (n,)."""
    with np.errstate(over="ignore"):  # of what lies far beyond
        actions, _ = policy.predict(cases, deterministic=True)
    return np.asarray(actions, float)[:, 0]


def compiler() -> str | None:
    """Return the C compiler of this machine: the variable CC's, or one of :data:`COMPILERS`."""
    names = (os.environ.get("CC", ""), *COMPILERS)
    return next((found for name in names if name and (found := shutil.which(name))), None)


def actions_of_c(
    sources: Mapping[str, str], name: str, cases: Cases, options: Sequence[str] = OPTIONS
) -> Array:
    """Return the actions (n,) of generated C, ``sources`` by file name, main.c among them.

    Raises:
        ValueError: there is no compiler, or it refuses the source.
    """
    command = compiler()
    if command is None:
        raise ValueError(f"no C compiler found, must be one of {list(COMPILERS)}, or CC's")
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            (Path(folder) / file).write_text(text, encoding="ascii")
        build = [command, *options, "-o", "main", "main.c", f"{name}.c", "-lm"]
        made = subprocess.run(build, cwd=folder, capture_output=True, text=True, check=False)
        if made.returncode != 0:
            raise ValueError(f"{' '.join(build)} failed: {made.stderr.strip()}")
        program, numbers = str(Path(folder) / "main"), as_text(cases)
        answer = subprocess.run(program, input=numbers, capture_output=True, text=True, check=True)
    return np.array(answer.stdout.split(), float)


def as_text(cases: Cases) -> str:
    """Return observations, one a line, as the example program reads them."""
    return "".join(" ".join(f"{number:.9g}" for number in seen) + "\n" for seen in cases.tolist())


def largest_difference(actions: Array, expected: Array) -> float:
    """Return the largest difference between actions; infinite where one is not finite."""
    difference = np.abs(actions - expected)
    return float(difference.max()) if np.isfinite(difference).all() else np.inf
