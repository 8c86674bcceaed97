"""Training configurations: those that are shipped, and a new run's; its flags."""

import argparse
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import gymnasium as gym

from jansen_env.commands.flags import (
    episode_count,
    mapping,
    non_negative_int,
    positive_int,
    whole,
)
from jansen_env.registration import IDS
from jansen_env.sb3.run_config import MOST_ENVS, Arguments, RunConfig, load_config
from jansen_env.scoring.benchmarks import DEFAULT

SHIPPED = "shipped"  # in place of a configuration's path


def training_folder(env_id: str) -> Path:
    """Return the folder of an environment's training configurations, beside its module."""
    module = str(gym.spec(env_id).entry_point).partition(":")[0]
    return Path(str(import_module(module).__file__)).parent / "training" / env_id


def shipped_configs() -> list[Path]:
    """Return the configuration files of all environments."""
    return sorted(file for env_id in IDS for file in training_folder(env_id).glob("*.yml"))


def shipped_config(env_id: str, algo: str) -> Path:
    """Return an environment's configuration file for an algorithm; ValueError: there is none."""
    path = training_folder(env_id) / f"{algo}.yml"
    if not path.is_file():
        known = [f"{file.parent.name}/{file.stem}" for file in shipped_configs()]
        raise ValueError(f"no configuration for {env_id}/{algo}, must be one of {known}, or a file")
    return path


def new_config(
    path: str | Path | None = None, algo: str | None = None, env_id: str | None = None,
    env_kwargs: Arguments | None = None, **values: object,
) -> RunConfig:  # fmt: skip
    """Return a new run's configuration: a file's, with what is given in its place.

    Args:
        path: of the file, or of a folder that has it as ALGO.yml; None or :data:`SHIPPED` for the
            one shipped for ``env_id`` and ``algo``.
        algo, env_id: None for the file's own, or else ppo and the default environment.
        env_kwargs: on top of the file's, in training as well. values: further entries, such as
            ``timesteps``; None for the file's. ``hyperparameters`` and ``policy_kwargs`` come on
            top of its own.

    Raises ValueError: the file is missing or invalid, or a value is not allowed.
    """
    if path is None or str(path) == SHIPPED:
        algo, env_id = algo or "ppo", env_id or DEFAULT
        path = shipped_config(env_id, algo)
    elif Path(path).is_dir():
        path = Path(path) / f"{algo or 'ppo'}.yml"
    config, overrides = load_config(path, algo=algo, env=env_id), env_kwargs or {}
    variants = [
        {name: value for name, value in variant.items() if name not in overrides}
        for variant in config.training_variants
    ]
    given: Arguments = {name: value for name, value in values.items() if value is not None}
    for name in ("hyperparameters", "policy_kwargs"):
        given[name] = {**getattr(config, name), **given.get(name, {})}
    env_kwargs = {**config.env_kwargs, **overrides}
    return replace(config, env_kwargs=env_kwargs, training_variants=variants, **given)


def add_run_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of a training run, named as in RL Baselines3 Zoo."""
    add = parser.add_argument
    add("-n", "--timesteps", type=positive_int,
        help="environment steps of a run, in place of the configuration's")  # fmt: skip
    add(
        "--n-envs",
        type=whole(most=MOST_ENVS),
        help="parallel environments of a run, in place of its",
    )
    add("--env-kwargs", type=mapping, metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    add("--eval-freq", type=non_negative_int,
        help="steps between evaluations, 0 for none; default: an 8th of the timesteps")  # fmt: skip
    add("--save-freq", type=non_negative_int, default=100_000,
        help="steps between checkpoints, 0 for none; default: 100000")  # fmt: skip
    add("--eval-episodes", type=episode_count, default=10,
        help="episodes per command of the scores; default: 10")  # fmt: skip


def training_envs(config: RunConfig) -> tuple[Arguments, list[Arguments]]:
    """Return the arguments of all training environments, and the variants that they take in turn.

    What all variants have alike is among the former: a batch has one set of reward weights.
    """
    first, *others = config.training_variants
    common = {k: v for k, v in first.items() if all(k in each and each[k] == v for each in others)}
    rest = [{k: v for k, v in each.items() if k not in common} for each in config.training_variants]
    return {**config.env_kwargs, **common}, rest
