"""Training configurations: files in the package, configurations of new runs, and their flags."""

import argparse
from dataclasses import replace
from pathlib import Path

from jansen_env.checks import invalid
from jansen_env.cli.flags import (
    episode_count,
    mapping,
    non_negative_int,
    positive_int,
    whole,
)
from jansen_env.registration import IDS, training_folder
from jansen_env.sb3.run_config import MOST_ENVS, Arguments, RunConfig, load_config
from jansen_env.scoring.benchmarks import DEFAULT

SHIPPED = "shipped"  # stands for the configuration in the package, instead of a path


def shipped_configs() -> list[Path]:
    """Return the configuration files of all environments."""
    return sorted(file for env_id in IDS for file in training_folder(env_id).glob("*.yml"))


def shipped_config(env_id: str, algo: str) -> Path:
    """Return the configuration file of the package for an environment and an algorithm.

    Args:
        env_id: Id of the environment.
        algo: Name of the algorithm.

    Raises:
        ValueError: If there is no such file.
    """
    path = training_folder(env_id) / f"{algo}.yml"
    if not path.is_file():
        known = [f"{file.parent.name}/{file.stem}" for file in shipped_configs()]
        raise invalid("the configuration", f"{env_id}/{algo}", f"a file or one of {known}")
    return path


def new_config(
    path: str | Path | None = None,
    algo: str | None = None,
    env_id: str | None = None,
    env_kwargs: Arguments | None = None,
    **values: object,
) -> RunConfig:
    """Return the configuration of a new run: that of a file, with some entries replaced.

    Args:
        path: Configuration file, or folder that contains it as ALGO.yml. None or :data:`SHIPPED`
            selects the file in the package for ``env_id`` and ``algo``.
        algo: Name of the algorithm. None selects that of the file, or ppo without a file.
        env_id: Id of the environment. None selects that of the file, or the default environment
            without a file.
        env_kwargs: Arguments of the environment, merged into those of the file. They also replace
            the arguments of the training variants.
        **values: Further entries that replace those of the file, such as ``timesteps``. None keeps
            the entry of the file. ``hyperparameters`` and ``policy_kwargs`` are merged into those
            of the file.

    Raises:
        ValueError: If the file is missing or invalid, or a value is not allowed.
    """
    if path is None or str(path) == SHIPPED:
        algo = algo or "ppo"
        env_id = env_id or DEFAULT
        path = shipped_config(env_id, algo)
    elif Path(path).is_dir():
        path = Path(path) / f"{algo or 'ppo'}.yml"
    config = load_config(path, algo=algo, env=env_id)
    overrides = env_kwargs or {}
    variants = [
        {name: value for name, value in variant.items() if name not in overrides}
        for variant in config.training_variants
    ]
    replaced: Arguments = {name: value for name, value in values.items() if value is not None}
    for name in ("hyperparameters", "policy_kwargs"):
        replaced[name] = {**getattr(config, name), **replaced.get(name, {})}
    env_kwargs = {**config.env_kwargs, **overrides}
    return replace(config, env_kwargs=env_kwargs, training_variants=variants, **replaced)


def add_run_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of a training run, which have the same names as in RL Baselines3 Zoo.

    Args:
        parser: Parser to add the flags to.
    """
    add = parser.add_argument
    add(
        "-n",
        "--timesteps",
        type=positive_int,
        help="number of environment steps of a run; default: the number in the configuration",
    )
    add(
        "--n-envs",
        type=whole(most=MOST_ENVS),
        help="number of parallel environments of a run; default: the number in the configuration",
    )
    add(
        "--env-kwargs",
        type=mapping,
        metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'",
    )
    add(
        "--eval-freq",
        type=non_negative_int,
        help="number of steps between evaluations; 0 means no evaluations; default: an eighth of "
        "the steps of the run",
    )
    add(
        "--save-freq",
        type=non_negative_int,
        default=100_000,
        help="number of steps between checkpoints; 0 means no checkpoints; default: 100000",
    )
    add(
        "--eval-episodes",
        type=episode_count,
        default=10,
        help="number of episodes per command for the final scores; default: 10",
    )


def training_envs(config: RunConfig) -> tuple[Arguments, list[Arguments]]:
    """Return the arguments of the training environments.

    Arguments that are equal in all variants become common arguments, because a batch has a single
    set of reward weights.

    Args:
        config: Configuration of the run.

    Returns:
        The common arguments, and the variants, which the environments use in turn.
    """
    first, *others = config.training_variants
    common = {k: v for k, v in first.items() if all(k in each and each[k] == v for each in others)}
    rest = [{k: v for k, v in each.items() if k not in common} for each in config.training_variants]
    return {**config.env_kwargs, **common}, rest
