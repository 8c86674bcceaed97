"""Training configurations: where they lie, and how they are read and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

CONFIGS = Path(__file__).parent / "configs"


def shipped_config(env_id: str, algo: str) -> Path:
    """The configuration for an environment and algorithm that comes with the package.

    Raises:
        ValueError: there is none.
    """
    path = CONFIGS / env_id / f"{algo}.yml"
    if not path.is_file():
        found = sorted(f"{p.parent.name}/{p.stem}" for p in CONFIGS.glob("*/*.yml"))
        raise ValueError(
            f"no configuration for {env_id}/{algo}, must be one of {found}, or a file of your own"
        )
    return path


def load_config(path: str | Path) -> dict[str, Any]:
    """A training configuration from YAML, read without running code.

    Keys: ``policy``, ``timesteps``, ``n_envs``, ``reward_scale``, ``env_kwargs`` (for training and
    evaluation), ``training_variants`` (further arguments of the training environments, taken in
    turn; ``max_episode_steps`` is one too), ``hyperparameters`` (the algorithm's arguments;
    ``learning_rate`` and ``clip_range`` may be "linear_X", falling from X to 0 over the run) and
    ``policy_kwargs`` (the policy's; ``activation`` is a name, ``normalize`` scales observations).

    Raises:
        ValueError: the file is no mapping, or has unknown or missing keys.
    """
    text = Path(path).read_text(encoding="utf-8")
    config = yaml.safe_load(text)
    required = {"policy", "timesteps", "n_envs", "hyperparameters"}
    allowed = required | {
        "policy_kwargs", "reward_scale", "env_kwargs", "training_variants", "algo", "env", "seed",
    }  # fmt: skip
    if not isinstance(config, dict) or not required <= set(config) <= allowed:
        found = sorted(config) if isinstance(config, dict) else type(config).__name__
        raise ValueError(
            f"{path} has {found}, must be a mapping with {sorted(required)} and optionally "
            f"{sorted(allowed - required)}"
        )
    return config


def find_config(model: str | Path) -> Path:
    """The config.yml of the run a model belongs to: in its folder or the one above.

    Raises:
        ValueError: there is none.
    """
    folder = Path(model).resolve().parent
    for place in (folder, folder.parent):
        if (place / "config.yml").is_file():
            return place / "config.yml"
    raise ValueError(f"no config.yml beside {model}: it says how the model is built")
