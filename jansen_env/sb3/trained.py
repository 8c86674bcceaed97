"""Trained policies: built from a configuration, which alone says how; files give them tensors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from jansen_env.baselines.policy import Policy
from jansen_env.sb3.model_files import read_model
from jansen_env.sb3.normalizer import NormalizedObservation
from jansen_env.sb3.run_config import ALGORITHMS, TO_LOAD, find_config, load_config
from jansen_env.scoring.rollout import make_env

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}


def load_policy(path: str | Path) -> Policy:
    """Load a trained policy from a run's folder or a model's zip file, without running its code.

    A model that Stable-Baselines3 trained elsewhere takes a config.yml beside it that says how the
    policy is built; policy_kwargs and use_sde may be left out where they are the library's own::

        algo: ppo
        env: JansenWalker-v0
        policy: MlpPolicy
        hyperparameters: {use_sde: true}
        policy_kwargs: {net_arch: [128, 128], activation: relu}

    Raises:
        ValueError: no such model or a damaged one, or no config.yml, or one that is not allowed
            (see :func:`jansen_env.sb3.run_config.load_config`) or describes other weights.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "best_model.zip"
    if not path.is_file():
        raise ValueError(f"no model at {path}")
    source = find_config(path)
    config = load_config(source, required=TO_LOAD)
    try:
        policy = untrained_policy(config)
    except (AssertionError, TypeError, ValueError) as error:  # arguments that do not go together
        raise ValueError(f"{source}: {error}") from error
    weights = read_model(path, ("policy",))[0].get("policy")
    try:
        policy.load_state_dict(weights)
    except Exception as error:  # torch raises most kinds for what does not fit
        raise ValueError(f"{path} does not fit {source}: {' '.join(str(error).split())}") from error
    trained: Policy = policy
    return trained


def untrained_policy(config: dict[str, Any]) -> Any:
    """Build the policy of a checked configuration; where its arguments do not go together,
    Stable-Baselines3 raises an AssertionError, TypeError or ValueError."""
    env: Any = make_env(config["env"], config.get("env_kwargs", {}))
    policy: Any = ALGORITHMS[config["algo"]].policy_aliases[config["policy"]](
        env.observation_space, env.action_space, lambda _: 0.0,  # the learning rate, of no use here
        use_sde=config.get("hyperparameters", {}).get("use_sde", False), **policy_kwargs_of(config),
    )  # fmt: skip
    policy.set_training_mode(False)
    env.close()
    return policy


def policy_kwargs_of(config: dict[str, Any]) -> dict[str, Any]:
    """Return ``policy_kwargs`` with names turned into classes."""
    arguments = dict(config.get("policy_kwargs", {}))
    if "activation" in arguments:
        arguments["activation_fn"] = ACTIVATIONS[arguments.pop("activation")]
    harmonics = arguments.pop("harmonics", 0)
    if arguments.pop("normalize", False):
        arguments["features_extractor_class"] = NormalizedObservation
        arguments["features_extractor_kwargs"] = {"harmonics": harmonics}
    return arguments
