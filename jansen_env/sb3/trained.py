"""Trained policies: built from a configuration; a model's file gives them tensors and no code."""

from __future__ import annotations

import json
import pickle
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import torch
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.save_util import load_from_zip_file

from jansen_env.checks import one_line, whole_number
from jansen_env.files import open_regular
from jansen_env.sb3.normalizer import NormalizedObservation
from jansen_env.sb3.run_config import ALGORITHMS, Arguments, RunConfig, find_config, load_config
from jansen_env.scoring.rollout import make_env

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}
MAX_BYTES = 2**28  # of a model's file unpacked; those of the shipped configurations have 0.2 MB
MAX_STEPS = 10**12  # of a model's training
NOTES = "notes.json"  # a member of a model's file beside Stable-Baselines3's own


class SavedModel(NamedTuple):
    """Content of a model's file: the state dicts of its modules and optimisers by name, tensors
    beside them such as SAC's entropy coefficient, time steps trained, and what was noted."""

    parameters: Arguments
    variables: Arguments
    steps: int
    notes: Arguments


def read_model(path: str | Path) -> SavedModel:
    """Read a zip file of Stable-Baselines3: tensors by ``torch.load(weights_only=True)`` and JSON.

    The pickles that Stable-Baselines3 writes beside them stay unread.

    Raises:
        ValueError: no such file, it is damaged or unpacks to more than :data:`MAX_BYTES`.
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > MAX_BYTES:
                raise ValueError(f"it unpacks to {size} bytes, must be {MAX_BYTES} at most")
            _, parameters, variables = load_from_zip_file(file, load_data=False, device="cpu")
            data = json.loads(archive.read("data"))
            steps = whole_number("num_timesteps", data["num_timesteps"], MAX_STEPS)
            notes = json.loads(archive.read(NOTES)) if NOTES in archive.namelist() else {}
            return SavedModel({**parameters}, {**(variables or {})}, steps, {**notes})
    except pickle.UnpicklingError:  # whose text advises to load without this safety
        raise ValueError(f"{path} is no Stable-Baselines3 model: it holds no tensors") from None
    except Exception as error:  # of a damaged file the parsers raise nearly every kind there is
        raise ValueError(f"{path} is no Stable-Baselines3 model: {one_line(error)}") from error


def load_policy(path: str | Path) -> BasePolicy:
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
            (see :class:`jansen_env.sb3.run_config.RunConfig`) or describes other weights.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "best_model.zip"
    if not path.is_file():
        raise ValueError(f"no model at {path}")
    source = find_config(path)
    config = load_config(source)
    try:
        policy = untrained_policy(config)
    except (AssertionError, TypeError, ValueError) as error:  # arguments that do not go together
        raise ValueError(f"{source}: {error}") from error
    weights = read_model(path).parameters.get("policy", {})
    try:
        policy.load_state_dict(weights)
    except Exception as error:  # torch raises most kinds for what does not fit
        raise ValueError(f"{path} does not fit {source}: {one_line(error)}") from error
    if not all(tensor.isfinite().all() for tensor in policy.state_dict().values()):
        raise ValueError(f"{path} has weights that are not finite")
    return policy


def untrained_policy(config: RunConfig) -> BasePolicy:
    """Build the policy of a configuration; where its arguments do not go together,
    Stable-Baselines3 raises an AssertionError, TypeError or ValueError."""
    env = make_env(config.env, config.env_kwargs)
    make: Any = ALGORITHMS[config.algo].policy_aliases[config.policy]
    policy: BasePolicy = make(
        env.observation_space, env.action_space, lambda _: 0.0,  # the learning rate, of no use here
        use_sde=config.hyperparameters.get("use_sde", False), **policy_kwargs_of(config),
    )  # fmt: skip
    policy.set_training_mode(False)
    env.close()
    return policy


def policy_kwargs_of(config: RunConfig) -> Arguments:
    """Return ``policy_kwargs`` with names turned into classes."""
    arguments = dict(config.policy_kwargs)
    if "activation" in arguments:
        arguments["activation_fn"] = ACTIVATIONS[arguments.pop("activation")]
    harmonics = arguments.pop("harmonics", 0)
    if arguments.pop("normalize", False):
        arguments["features_extractor_class"] = NormalizedObservation
        arguments["features_extractor_kwargs"] = {"harmonics": harmonics}
    return arguments
