"""Models: built from a configuration, which alone says how; files give them tensors, no code."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import LinearSchedule

from agents.training.config import ALGORITHMS, TO_LOAD, find_config, load_config
from agents.training.model_files import NOTES, STATE, read_model
from agents.training.normalizer import NormalizedObservation
from jansen_env.baselines.policy import Policy
from jansen_env.files import write_bytes
from jansen_env.scoring.rollout import make_env

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}


def build_model(algo: str, config: dict[str, Any], env: Any, **more: Any) -> BaseAlgorithm:
    """Build a new model of ``algo`` for ``env`` from a checked configuration."""
    arguments = dict(config["hyperparameters"])
    for name in ("learning_rate", "clip_range", "clip_range_vf"):
        if isinstance(value := arguments.get(name), str):
            arguments[name] = linear_schedule(value)
    return ALGORITHMS[algo](
        config["policy"], env, device="cpu", **arguments, **more,
        policy_kwargs=_policy_kwargs(config),
    )  # fmt: skip


def linear_schedule(text: str) -> LinearSchedule:
    """Return ``"linear_X"``: from X at the start to 0 at the end, and 0 past it, where a run's last
    rollout may end."""
    return LinearSchedule(float(text.removeprefix("linear_")), 0.0, end_fraction=1.0)


def _policy_kwargs(config: dict[str, Any]) -> dict[str, Any]:
    """Return ``policy_kwargs`` with names turned into classes."""
    arguments = dict(config.get("policy_kwargs", {}))
    if "activation" in arguments:
        arguments["activation_fn"] = ACTIVATIONS[arguments.pop("activation")]
    harmonics = arguments.pop("harmonics", 0)
    if arguments.pop("normalize", False):
        arguments["features_extractor_class"] = NormalizedObservation
        arguments["features_extractor_kwargs"] = {"harmonics": harmonics}
    return arguments


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
            (see :func:`agents.training.config.load_config`) or describes other weights.
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
        use_sde=config.get("hyperparameters", {}).get("use_sde", False), **_policy_kwargs(config),
    )  # fmt: skip
    policy.set_training_mode(False)
    env.close()
    return policy


def restore(model: BaseAlgorithm, tensors: dict[str, Any]) -> None:
    """Set all parameters of a model, its optimisers' too, as :func:`read_model` gives them; a
    ValueError where they are another model's."""
    parameters = dict(tensors)
    values = parameters.pop("pytorch_variables", None) or {}
    needed = model._get_torch_save_params()[1]
    if set(values) != set(needed):
        names = f"{sorted(values)}, must have {sorted(needed)}"
        raise ValueError(f"the saved model has the variables {names}")
    try:
        model.set_parameters(parameters, exact_match=True)
        for name, value in values.items():  # such as SAC's entropy coefficient
            variable = getattr(model, name)
            with torch.no_grad():
                variable.copy_(value.reshape(variable.shape))
    except Exception as error:  # torch and the optimisers raise most kinds for what does not fit
        reason = " ".join(str(error).split())
        raise ValueError(f"the saved model does not fit its configuration: {reason}") from error


def save_model(
    model: BaseAlgorithm, path: Path, notes: dict[str, Any] | None = None,
    state: dict[str, Any] | None = None,
) -> None:  # fmt: skip
    """Save by an atomic write, with ``notes`` and training ``state`` as JSON in the same file."""
    buffer = io.BytesIO()  # whole before the disk sees any of it
    model.save(buffer)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(NOTES, json.dumps(notes or {}))
        if state is not None:
            archive.writestr(STATE, json.dumps(state))
    write_bytes(path, buffer.getvalue())
