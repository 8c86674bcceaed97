"""Scores of policies side by side, and policies by name: a baseline, a run's folder, a model."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from agents.metrics import summarise
from agents.policy import Policy
from agents.rollout import make_env, run_episodes
from agents.tasks import find_task

FIRST_SEED = 40_000  # of the episodes scored: training, tuning and selection use others
ALIASES = {"pid-paper": "pid"}


def load_named(name: str, env: Any) -> Policy:
    """A policy for ``env`` by a baseline's name, or from a run's folder or model file.

    Raises:
        ValueError: neither, or a model that was trained on other observations or actions.
    """
    task = find_task(env.spec.id)
    if ALIASES.get(name, name) in task.baselines:
        return task.load_baseline(ALIASES.get(name, name), env.unwrapped)
    if not Path(name).exists():
        raise ValueError(
            f"policy is {name!r}, must be one of {task.baselines}, a run's folder or a model's "
            "zip file"
        )
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # more would change the last bits of the actions
    from agents.models import load_policy  # only now: torch is slow to import

    policy: Any = load_policy(name)
    for space in ("observation_space", "action_space"):
        trained, needed = getattr(policy, space), getattr(env, space)
        if trained.shape != needed.shape:
            raise ValueError(
                f"policy {name!r} has an {space} of shape {trained.shape}, must be {needed.shape} "
                f"for {env.spec.id}"
            )
    loaded: Policy = policy
    return loaded


def label(name: str) -> str:
    """How a policy is called in tables: a model by its run's folder."""
    path = Path(name)
    if not path.exists():  # a baseline
        return name
    folder = path if path.is_dir() else path.parent
    stem = "" if path.is_dir() or path.stem == "best_model" else f" {path.stem}"
    return f"{folder.parent.name}/{folder.name}{stem}"


def labels(names: list[str]) -> list[str]:
    """:func:`label` of each policy, and where two would share one, the names as they are given.

    Raises:
        ValueError: a policy is given twice.
    """
    files = [_model_file(name) for name in names]
    for file, name in zip(files, names, strict=True):
        if files.count(file) > 1:
            raise ValueError(f"policy {name!r} is given {files.count(file)} times, must be once")
    short = [label(name) for name in names]
    return [name if short.count(own) > 1 else own for name, own in zip(names, short, strict=True)]


def _model_file(name: str) -> Path:
    """The file that a policy is in; of a baseline its name."""
    path = Path(name)
    if not path.exists():
        return Path(ALIASES.get(name, name))
    return (path / "best_model.zip" if path.is_dir() else path).resolve()


def evaluate(
    policies: dict[str, Policy],
    env_id: str,
    env_kwargs: dict[str, Any],
    commands: tuple[float, ...] | None = None,
    episodes: int = 10,
    seed: int = 0,
) -> dict[str, dict[str, Any]]:
    """Scores of each policy on the same episodes, all with starts of their own.

    Args:
        policies: by name. env_id, env_kwargs: of the environment.
        commands: commanded speeds; None for the task's own grid.
        episodes: per command. seed: another number, other starts.

    Returns:
        For each policy :func:`agents.metrics.summarise` and its episodes under ``"raw"``.

    Raises:
        ValueError: no task is known for ``env_id``, or an argument out of range.
    """
    task = find_task(env_id)
    command = np.repeat(task.commands if commands is None else commands, episodes)
    seeds = FIRST_SEED + seed * len(command) + np.arange(len(command))
    env = make_env(env_id, env_kwargs)
    scores = {}
    for name, policy in policies.items():
        run = run_episodes(policy, env_id, env_kwargs, command, seeds)
        raw = {key: values.tolist() for key, values in run.items()}
        scores[name] = {**summarise(task.metrics, run, env, seed), "raw": raw}
    env.close()
    return scores
