"""Models: built from a configuration, restored from a file's tensors, saved with notes."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import LinearSchedule

from jansen_env.checks import one_line
from jansen_env.files import write_bytes
from jansen_env.sb3.run_config import ALGORITHMS, Arguments, RunConfig
from jansen_env.sb3.trained import NOTES, SavedModel, policy_kwargs_of


def build_model(config: RunConfig, env: Any) -> BaseAlgorithm:
    """Build the new model of a configuration for an environment."""
    arguments = dict(config.hyperparameters)
    for name in ("learning_rate", "clip_range", "clip_range_vf"):
        if isinstance(value := arguments.get(name), str):
            arguments[name] = linear_schedule(value)
    return ALGORITHMS[config.algo](
        config.policy, env, device="cpu", seed=config.seed, **arguments,
        policy_kwargs=policy_kwargs_of(config),
    )  # fmt: skip


def linear_schedule(text: str) -> LinearSchedule:
    """Return ``"linear_X"``: from X at the start to 0 at the end, and 0 past it, where a run's last
    rollout may end."""
    return LinearSchedule(float(text.removeprefix("linear_")), 0.0, end_fraction=1.0)


def restore(model: BaseAlgorithm, saved: SavedModel) -> None:
    """Set all parameters of a model, its optimisers' too; a ValueError where they do not fit."""
    try:
        model.set_parameters(saved.parameters, exact_match=True)
        for name in model._get_torch_save_params()[1]:  # such as SAC's entropy coefficient
            variable = getattr(model, name)
            variable.data.copy_(saved.variables[name].reshape(variable.shape))
        model.num_timesteps = saved.steps
    except Exception as error:  # torch and the optimisers raise most kinds for what does not fit
        raise ValueError(
            f"the saved model does not fit its configuration: {one_line(error)}"
        ) from error


def save_model(model: BaseAlgorithm, path: Path, notes: Arguments) -> None:
    """Save as Stable-Baselines3 does, with ``notes`` as JSON in the same file; atomic."""
    buffer = io.BytesIO()
    model.save(buffer)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(NOTES, json.dumps(notes))
    write_bytes(path, buffer.getvalue())
