"""Policy files as Stable-Baselines3's models, to train on or to use where these are wanted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.pack import COPY
from agents.training.train_model import prepare
from jansen_env.baselines.policy import Policy
from jansen_env.checks import shown
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.sb3.run_config import TO_RESUME, check_config
from jansen_env.sb3.trained import untrained_policy


def load_sb3(env_id: str, name: str = pretrained.DEFAULT) -> BaseAlgorithm:
    """Load a policy that comes with the package as a model, see :func:`to_sb3`."""
    return to_sb3(pretrained.load(env_id, name))


def load_sb3_file(path: str | Path) -> BaseAlgorithm:
    """Load a policy's JSON file as a model, see :func:`to_sb3`; a ValueError names the file."""
    try:
        return to_sb3(pretrained.load_file(path))
    except ValueError as error:
        raise error if str(path) in str(error) else ValueError(f"{path}: {error}") from error


def to_sb3(packed: PretrainedPolicy) -> BaseAlgorithm:
    """Return a policy as the model that it was trained as, on the environments of its training; the
    optimiser starts again.

    Raises:
        ValueError: its training's configuration is not allowed, or of another environment.
    """
    model = prepare(_training_config(packed))
    _fill(model.policy, packed)
    return model


def to_policy(packed: PretrainedPolicy) -> Policy:
    """Return a policy as the one in PyTorch that it was packed of; errors are :func:`to_sb3`'s."""
    try:
        policy: Policy = untrained_policy(_training_config(packed))
    except (AssertionError, TypeError) as error:  # arguments that do not go together
        raise ValueError(str(error)) from error
    _fill(policy, packed)
    return policy


def _training_config(packed: PretrainedPolicy) -> dict[str, Any]:
    """Return the configuration that a policy was trained with."""
    training = packed.description.get("training")
    config: Any = training.get("config") if isinstance(training, dict) else None
    check_config(config, required=TO_RESUME)
    for name, own in (("env", packed.env_id), ("env_kwargs", packed.env_kwargs)):
        if (found := config.get(name, {})) != own:
            raise ValueError(f"training.config.{name} is {shown(found)}, must be {shown(own)}")
    return dict(config)


def _fill(policy: Any, packed: PretrainedPolicy) -> None:
    """Put the packed weights into a policy of Stable-Baselines3; ValueError: they do not fit."""
    state = {name: torch.from_numpy(array.copy()) for name, array in packed.tensors.items()}
    for name in policy.state_dict():
        if name.startswith(COPY):
            state[name] = state.get(name.replace(COPY, "critic.", 1), torch.empty(0))
    try:
        policy.load_state_dict(state)
    except RuntimeError as error:
        raise ValueError(f"the weights do not fit: {' '.join(str(error).split())}") from error
