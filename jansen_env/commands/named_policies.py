"""Policies by the names and files that commands are given."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jansen_env.baselines.policy import Policy
from jansen_env.baselines.profile import load_profile
from jansen_env.checks import listed
from jansen_env.policies import pretrained
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import make_env

ALIASES = {"pid-paper": "pid", "pretrained": f"pretrained:{pretrained.DEFAULT}"}
SHIPPED = "pretrained:"  # before the name of a policy that comes with the package
SEARCHED = "profile:"  # before the file of a profile that a search has found


def default_policy(env_id: str) -> str:
    """Return the name of an environment's own policy, or else of its first baseline."""
    own = pretrained.names(env_id)
    return "pretrained" if own else next(iter(find_benchmark(env_id).baselines))


def load_named(name: str, env: Any) -> Policy:
    """Load a policy for ``env``: a baseline, ``"pretrained"`` or ``"pretrained:NAME"``, a searched
    profile ``"profile:FILE"``, or that of a run's folder or of the file of a model or policy; a
    ValueError where it does not fit."""
    env_id, own, path = env.spec.id, ALIASES.get(name, name), Path(name)
    baselines = find_benchmark(env_id).baselines
    if own in baselines:
        return baselines[own](env.unwrapped)
    if own.startswith(SHIPPED):
        path = pretrained.shipped(env_id, own.removeprefix(SHIPPED))
    elif own.startswith(SEARCHED):
        return load_profile(own.removeprefix(SEARCHED), "found").policy(env.unwrapped)
    elif not path.exists():
        raise ValueError(
            f"policy is {name!r}, no run's folder, model's zip file or policy's json file: must be "
            f"one of {listed([*baselines, 'pretrained'], name)}"
        )
    if path.suffix == ".json":
        packed = pretrained.load_file(path)
        try:
            return packed.on(env)
        except ValueError as error:
            raise ValueError(f"policy {name!r} does not fit {env_id}: {error}") from None
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # more would change the last bits of the actions
    from jansen_env.sb3 import load_policy  # only now: torch is slow to import

    policy: Any = load_policy(name)
    for space in ("observation_space", "action_space"):
        trained, needed = getattr(policy, space), getattr(env, space)
        if trained.shape != needed.shape:
            raise ValueError(f"policy {name!r} has an {space} of shape {trained.shape}, must be "
                             f"{needed.shape} for {env_id}")  # fmt: skip
    return policy


def model_file(name: str) -> Path | None:
    """Return the file of a policy; None for a baseline."""
    path = Path(name).resolve()
    if not path.exists():
        return None
    return path / "best_model.zip" if path.is_dir() else path


def label(name: str) -> str:
    """Return a policy's name in tables; a model or profile has that of its folder."""
    if name.startswith(SEARCHED):
        return "/".join(Path(name.removeprefix(SEARCHED)).resolve().parts[-3:-1])
    file = model_file(name)
    if file is None:
        return name
    stem = "" if file.stem == "best_model" else f" {file.stem}"
    return f"{file.parent.parent.name}/{file.parent.name}{stem}"


def labels(names: list[str]) -> list[str]:
    """Return :func:`label` of each policy, or the given names where two would share one; a
    ValueError where a policy is given twice."""
    policies = [model_file(name) or ALIASES.get(name, name) for name in names]
    for policy, name in zip(policies, names, strict=True):
        if (times := policies.count(policy)) > 1:
            raise ValueError(f"policy {name!r} is given {times} times, must be once")
    short = [label(name) for name in names]
    return [name if short.count(own) > 1 else own for name, own in zip(names, short, strict=True)]


def load_all(
    args: argparse.Namespace, commands: Sequence[float] = ()
) -> list[tuple[dict[str, Policy], dict[str, Any]]]:
    """Return for each plant the policies by label, and the environment's arguments.

    Raises:
        ValueError: a policy, an argument or one of the commands is not allowed.
    """
    names = dict(zip(labels(args.policy), args.policy, strict=True))
    loaded = []
    for plant in dict.fromkeys(getattr(args, "plant", ())) or [None]:
        env_kwargs = args.env_kwargs if plant is None else {**args.env_kwargs, "plant": plant}
        suffix = "" if plant is None else f" on {plant}"
        env = make_env(args.env, env_kwargs)
        policies = {own + suffix: load_named(name, env) for own, name in names.items()}
        for command in commands:
            env.reset(options={find_benchmark(args.env).option: command})
        env.close()
        loaded.append((policies, env_kwargs))
    return loaded
