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

from jansen_env.files import write_bytes
from jansen_env.sb3.model_files import NOTES, STATE
from jansen_env.sb3.run_config import ALGORITHMS
from jansen_env.sb3.trained import policy_kwargs_of


def build_model(algo: str, config: dict[str, Any], env: Any, **more: Any) -> BaseAlgorithm:
    """Build a new model of ``algo`` for ``env`` from a checked configuration."""
    arguments = dict(config["hyperparameters"])
    for name in ("learning_rate", "clip_range", "clip_range_vf"):
        if isinstance(value := arguments.get(name), str):
            arguments[name] = linear_schedule(value)
    return ALGORITHMS[algo](
        config["policy"], env, device="cpu", **arguments, **more,
        policy_kwargs=policy_kwargs_of(config),
    )  # fmt: skip


def linear_schedule(text: str) -> LinearSchedule:
    """Return ``"linear_X"``: from X at the start to 0 at the end, and 0 past it, where a run's last
    rollout may end."""
    return LinearSchedule(float(text.removeprefix("linear_")), 0.0, end_fraction=1.0)


def restore(model: BaseAlgorithm, tensors: dict[str, Any]) -> None:
    """Set all parameters of a model, its optimisers' too, to the tensors of a file
    (:func:`jansen_env.sb3.model_files.read_model`); a ValueError where they are another model's."""
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
