"""Training configurations: those that are shipped, and a new run's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jansen_env.sb3.run_config import ALGORITHMS, TO_RESUME, check_config, load_config
from jansen_env.scoring.benchmarks import DEFAULT

CONFIGS = Path(__file__).parents[1] / "configs"


def shipped_config(env_id: str, algo: str) -> Path:
    """Return the configuration file for an environment and algorithm that comes with the package;
    a ValueError where there is none."""
    path = CONFIGS / env_id / f"{algo}.yml"
    if not path.is_file():
        files = [p for p in CONFIGS.glob("*/*.yml") if p.stem in ALGORITHMS]
        found = sorted(f"{p.parent.name}/{p.stem}" for p in files)
        raise ValueError(f"no configuration for {env_id}/{algo}, must be one of {found}, or a file")
    return path


def new_config(
    path: str | Path | None = None, algo: str | None = None, env_id: str | None = None,
    env_kwargs: dict[str, Any] | None = None, **values: Any,
) -> dict[str, Any]:  # fmt: skip
    """Return a new run's whole configuration: a file's, with what is given in its place; errors are
    :func:`load_config`'s.

    Args:
        path: of the file; None for the one shipped for ``env_id`` and ``algo``.
        algo, env_id: None for the file's own, or else ppo and the default environment.
        env_kwargs: on top of the file's, in training as well. values: further keys, such as
            ``timesteps``; None for the file's. ``seed`` is 0 without.
    """
    config = load_config(path, algo, env_id) if path else {}
    algo, env_id = algo or config.get("algo", "ppo"), env_id or config.get("env", DEFAULT)
    config = config or load_config(shipped_config(env_id, algo), algo, env_id)
    config = {"seed": 0, **config, **{k: v for k, v in values.items() if v is not None}}
    overrides = env_kwargs or {}
    config["env_kwargs"] = {**config.get("env_kwargs", {}), **overrides}
    if "training_variants" in config:
        config["training_variants"] = [
            {name: value for name, value in each.items() if name not in overrides}
            for each in config["training_variants"]
        ]
    config.update(algo=algo, env=env_id)
    check_config(config, required=TO_RESUME)  # again, with what was given in place
    return config


def training_envs(config: dict[str, Any]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the arguments of all training environments, and the variants that they take in turn.

    What all variants have alike is among the former: a batch has one set of reward weights.
    """
    variants = config.get("training_variants", [{}])
    first, *others = variants
    common = {k: v for k, v in first.items() if all(k in one and one[k] == v for one in others)}
    rest = [{k: v for k, v in one.items() if k not in common} for one in variants]
    return {**config.get("env_kwargs", {}), **common}, rest
