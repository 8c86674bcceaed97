"""Configurations of models and their training: read from YAML, each name looked up in a table."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin

from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm

from jansen_env.checks import MAX_STEPS, shown
from jansen_env.plain_yaml import HUGE, TINY, Rule, check_keys, read_yaml
from jansen_env.scoring.benchmarks import BENCHMARKS, check_env_kwargs

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC}
MAX_UNITS, MAX_LAYERS = 1024, 8  # of a network


KEYS = {
    "policy": Rule(words=("MlpPolicy",)), "timesteps": Rule((int,), 1, MAX_STEPS),
    "n_envs": Rule((int,), 1, 10_000), "reward_scale": Rule((float,), TINY),
    "fall_cost": Rule((float,), 0), "env_kwargs": Rule((dict,)),
    "training_variants": Rule((list,)), "hyperparameters": Rule((dict,)),
    "policy_kwargs": Rule((dict,)), "algo": Rule(words=tuple(ALGORITHMS)),
    "env": Rule(words=tuple(BENCHMARKS)), "seed": Rule((int,), 0, 2**32 - 1),
}  # fmt: skip
TO_TRAIN = ("policy", "timesteps", "n_envs", "hyperparameters")
TO_RESUME = (*TO_TRAIN, "algo", "env", "seed")
TO_LOAD = ("algo", "env", "policy")

LIMITS: dict[str, tuple[float, float]] = {
    "n_steps": (1, 10**6), "batch_size": (2, 10**6), "sde_sample_freq": (-1, 10**6),
    "stats_window_size": (1, 10**6), "verbose": (0, 2), "n_epochs": (1, 1000),
    "buffer_size": (1, 10**8), "learning_starts": (0, MAX_STEPS), "train_freq": (1, 10**6),
    "gradient_steps": (-1, 10**5), "target_update_interval": (1, 10**6), "n_critics": (1, 10),
    "gamma": (0, 1), "gae_lambda": (0, 1), "tau": (0, 1),
    "ent_coef": (0, HUGE), "vf_coef": (0, HUGE), "clip_mean": (0, HUGE),
    "log_std_init": (-HUGE, HUGE), "target_entropy": (-HUGE, HUGE),
}  # fmt: skip
"""Ranges of Stable-Baselines3's numbers; those not named range from TINY to HUGE."""
SET_HERE = ("seed", "_init_setup_model", "optimize_memory_usage", "normalize_images")
OWN = {"activation": Rule(words=("tanh", "relu", "elu")), "normalize": Rule((bool,)),
       "harmonics": Rule((int,), 0, 32)}  # fmt: skip
"""Rules of ``policy_kwargs``, beside those of the policy's class."""


def _rules(function: Callable[..., Any], *without: str) -> dict[str, Rule]:
    """Return a rule for each argument that is a number or a bool: no classes, files, devices."""
    rules = {}
    for name, parameter in inspect.signature(function).parameters.items():
        types = get_args(parameter.annotation) or (parameter.annotation,)
        plain = tuple(t for t in types if t in (bool, int, float, NoneType))
        if {bool, int, float} & {*plain} and name not in (*SET_HERE, *without):
            words = ("auto",) if str in types else ()
            prefix = "auto_" if words and name == "ent_coef" else ""
            if any(get_origin(t) is Callable for t in types):
                prefix = "linear_"
            rules[name] = Rule(plain, *LIMITS.get(name, (TINY, HUGE)), words, prefix)
    return rules


@cache
def rules(algo: str) -> dict[str, dict[str, Rule]]:
    """Return the rules of an algorithm's ``hyperparameters`` and ``policy_kwargs`` by name."""
    library = ALGORITHMS[algo]
    policy = _rules(library.policy_aliases["MlpPolicy"].__init__, "use_sde", "lr_schedule")
    return {"hyperparameters": _rules(library.__init__), "policy_kwargs": {**policy, **OWN}}


def load_config(
    path: str | Path, algo: str | None = None, env_id: str | None = None,
    required: Collection[str] = TO_TRAIN,
) -> dict[str, Any]:  # fmt: skip
    """Read a training configuration from YAML; each name in it is looked up in a table.

    Keys: ``policy``, ``timesteps``, ``n_envs``, ``reward_scale`` and ``fall_cost`` (of the
    training reward: a factor, and what a fall takes off before it), ``env_kwargs`` (for training
    and evaluation), ``training_variants`` (mappings of further arguments, for training alone:
    environment i takes number i, counted around; ``max_episode_steps`` is one too),
    ``hyperparameters`` (the algorithm's arguments; ``learning_rate`` and ``clip_range`` may be
    "linear_X", falling from X to 0 over the run) and ``policy_kwargs`` (the policy's;
    ``activation`` is a name, ``normalize`` scales observations, and with it ``harmonics`` appends
    so many of the crank angle). The config.yml of a run also has ``algo``, ``env`` and ``seed``.

    Args:
        path: of the file. required: keys that it must have.
        algo, env_id: what it is for; None for its own ``algo`` and ``env``. Where it has none
            either, the arguments of algorithm, policy and environment stay unchecked.

    Raises:
        ValueError: no such file, no YAML, an unknown or missing key, or a value that is not
            allowed; names the file.
    """
    config: dict[str, Any] = read_yaml(path)
    try:
        check_config(config, algo, env_id, required)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return config


def check_config(
    config: Any, algo: str | None = None, env_id: str | None = None,
    required: Collection[str] = TO_TRAIN,
) -> None:  # fmt: skip
    """Check a configuration's names and values; arguments and errors are :func:`load_config`'s."""
    Rule((dict,)).check("configuration", config)
    missing = [name for name in required if name not in config]
    if missing:
        raise ValueError(f"configuration has no {missing}, must have {list(required)}")
    check_keys("", config, KEYS)
    variants = config.get("training_variants", [{}])
    if not variants or not all(isinstance(variant, dict) for variant in variants):
        raise ValueError(f"training_variants is {shown(variants)}, must be a list of mappings")
    algo, env_id = algo or config.get("algo"), env_id or config.get("env")
    if algo is not None:
        policy_kwargs = dict(config.get("policy_kwargs", {}))
        if "net_arch" in policy_kwargs:
            _check_layers(policy_kwargs.pop("net_arch"), ["pi", "vf" if algo == "ppo" else "qf"])
        check_keys("policy_kwargs", policy_kwargs, rules(algo)["policy_kwargs"])
        hyperparameters = config.get("hyperparameters", {})
        check_keys("hyperparameters", hyperparameters, rules(algo)["hyperparameters"])
        if policy_kwargs.get("harmonics") and not policy_kwargs.get("normalize"):
            raise ValueError("harmonics is given, so normalize must be true, too")
    if env_id is not None:
        for arguments in (config.get("env_kwargs", {}), *variants):
            check_env_kwargs(env_id, arguments)


def _check_layers(value: Any, networks: list[str]) -> None:
    """Check the units of each layer of all networks together, or of each."""
    several = isinstance(value, dict) and {*value} == {*networks}
    for layers in value.values() if several else [value]:
        fits = isinstance(layers, list) and len(layers) <= MAX_LAYERS
        if not fits or not all(type(units) is int and 1 <= units <= MAX_UNITS for units in layers):
            raise ValueError(
                f"policy_kwargs.net_arch is {shown(value)}, must be a list of up to {MAX_LAYERS} "
                f"layers of 1 to {MAX_UNITS} units, or a mapping of {networks} to such lists"
            )


def find_config(model: str | Path) -> Path:
    """Return the config.yml in a model's folder or the one above; a ValueError without one."""
    folder = Path(model).resolve().parent
    for place in (folder, folder.parent):
        if (place / "config.yml").is_file():
            return place / "config.yml"
    raise ValueError(
        f"no config.yml beside {model}. Write what the model was trained by and on into "
        f"{folder / 'config.yml'}:\n\n    algo: ppo\n    env: JansenWalkerBuilt-v0\n"
        "    policy: MlpPolicy\n\nand policy_kwargs, if any, such as {net_arch: [128, 128]}"
    )
