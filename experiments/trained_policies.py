"""Policies that experiments train with PPO on robots of their own, and tests of these policies."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jansen_env import Robot, evaluate
from jansen_env.registration import training_folder
from jansen_env.robot.robot_file import read_robot, write_robot

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from jansen_env.sb3.run_config import RunConfig

ENV = "JansenWalkerBuilt-v0"
STEPS = 655_360  # environment steps of a training: 80 rollouts of 256 x 32 steps
ROLLOUT = 16_384  # environment steps of a rollout of the recipe of train.py: 256 x 64 steps


def train_policy(folder: Path, robot: Robot, seed: int, command: str, quick: bool) -> Path:
    """Train a policy unless its file exists, and return the file.

    Args:
        folder: Folder of the run. Its name gets the ending ``_quick`` if ``quick`` is true, so that
            the experiment itself does not use this policy.
        robot: Robot on which the policy is trained.
        seed: Seed of the training.
        command: Command that started the experiment.
        quick: Whether to train for two rollouts only.

    Raises:
        ValueError: If the folder contains a run with another robot, or a finished run with another
            configuration.
    """
    from agents.training.config import new_config

    if quick:
        folder = folder.with_name(f"{folder.name}_quick")
    file = folder / "robot.json"
    if file.is_file() and read_robot(file) != robot:
        raise ValueError(
            f"{file} must be the robot of this run, got another robot: remove {folder}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_robot(file, robot)
    config = new_config(
        training_folder(ENV) / "quick.yml",
        env_kwargs={"robot": str(file)},
        seed=seed,
        timesteps=2 * 8 * 32 if quick else STEPS,
        n_envs=8 if quick else None,
    )
    return train_run(folder, config, command)


def train_recipe(
    folder: Path,
    command: str,
    env_kwargs: dict[str, Any] | None = None,
    seed: int = 0,
    steps: int | None = None,
) -> Path:
    """Train with the recipe of ``train.py`` unless the last model exists, and return its file.

    Args:
        folder: Folder of the run.
        command: Command that started the experiment.
        env_kwargs: Arguments of the environment. None for its defaults.
        seed: Seed of the training.
        steps: Number of environment steps. None for that of the recipe.

    Raises:
        ValueError: If the folder contains a finished run with another configuration.
    """
    from agents.training.config import new_config

    file = training_folder(ENV) / "ppo.yml"
    config = new_config(file, env_kwargs=env_kwargs, seed=seed, timesteps=steps)
    return train_run(folder, config, command)


def train_run(
    folder: Path,
    config: RunConfig,
    command: str,
    start: str | None = None,
    change: Callable[[BaseAlgorithm], None] | None = None,
) -> Path:
    """Train a configuration unless its last model exists, and return the file of this model.

    Args:
        folder: Folder of the run.
        config: Configuration of the run.
        command: Command that started the experiment.
        start: Pretrained policy with whose weights the training starts, such as
            ``pretrained:hiker``. None starts with random weights.
        change: Function that changes the model before the training.

    Raises:
        ValueError: If the folder contains a finished run with another configuration.
    """
    from agents.pack import start_from
    from agents.training.runs import FINAL, record_run
    from agents.training.train_model import prepare, train
    from jansen_env.cli.named_policies import shipped_file
    from jansen_env.sb3.run_config import load_config

    if not (folder / FINAL).is_file():
        record_run(folder, config, command)
        model = prepare(config)
        if start is not None:
            start_from(model, shipped_file(start, config.env) or start)
        if change is not None:
            change(model)
        train(model, config, folder, eval_every=0, save_every=0, progress=False)
    elif load_config(folder / "config.yml") != config:
        raise ValueError(
            f"{folder} must be a run with the present configuration, got another configuration: "
            "remove it"
        )
    return folder / FINAL


def score_policy(
    name: str,
    robot: Robot,
    commands: tuple[float, ...],
    episodes: int,
    seed: int,
    made_for: Robot | None = None,
) -> dict[str, Any]:
    """Return the scores of a policy on a robot, as :func:`jansen_env.evaluate` returns them.

    Args:
        name: Name of a baseline or of a pretrained policy, or the file of a policy.
        robot: Robot on which the policy is tested.
        commands: Commanded speeds, in m/s.
        episodes: Number of episodes per command.
        seed: Seed of the initial states.
        made_for: Robot for which a baseline is made. None for the robot of the test.
    """
    from jansen_env.cli.named_policies import load_named
    from jansen_env.scoring.rollout import make_env

    env = make_env(ENV, {"robot": made_for or robot})
    policy = load_named(name, env)
    env.close()
    scores = evaluate(
        {"policy": policy}, ENV, {"robot": robot}, commands=commands, episodes=episodes, seed=seed
    )
    return scores["policy"]


def score_by_command(
    name: str,
    robot: Robot,
    commands: tuple[float, ...],
    metrics: Iterable[str],
    episodes: int,
    seed: int,
) -> dict[str, dict[str, float | None]]:
    """Return the means of some metrics of a policy, by command and metric.

    Args:
        name: Name of a baseline or of a pretrained policy, or the file of a policy.
        robot: Robot on which the policy is tested.
        commands: Commanded speeds, in m/s.
        metrics: Names of the metrics.
        episodes: Number of episodes per command.
        seed: Seed of the initial states.
    """
    scores = score_policy(name, robot, commands, episodes, seed)["by_command"]
    return {
        str(command): {metric: scores[metric]["value"][k] for metric in metrics}
        for k, command in enumerate(commands)
    }
