"""Training configurations: where they lie, and how they are read and checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from agents.command_line import MAX_STEPS
from agents.plain_yaml import read_yaml
from agents.tasks import DEFAULT, TASKS, check_env_kwargs
from jansen_env.checks import shown

CONFIGS = Path(__file__).parent / "configs"
MAX_UNITS, MAX_LAYERS = 1024, 8  # of a network
MAX_HARMONICS = 32  # of the crank angle


class Check(NamedTuple):
    """What a value must be: in words, and as a condition. ``a | b`` allows both."""

    allowed: str
    condition: Callable[[Any], bool]

    def __call__(self, name: str, value: Any) -> None:
        if not self.condition(value):
            raise ValueError(f"{name} is {shown(value)}, must be {self.allowed}")

    def __or__(self, other: Check) -> Check:
        return Check(
            f"{self.allowed}, or {other.allowed}",
            lambda value: self.condition(value) or other.condition(value),
        )


def is_number(value: Any) -> bool:
    """A finite number, and no bool."""
    return type(value) in (int, float) and math.isfinite(value)


def has_number(prefix: str) -> Callable[[Any], bool]:
    """Text that is ``prefix`` and a number above 0."""

    def condition(value: Any) -> bool:
        if isinstance(value, str) and value.startswith(prefix):
            with suppress(ValueError):
                return positive.condition(float(value.removeprefix(prefix)))
        return False

    return condition


def integer(low: int, high: int) -> Check:
    """A whole number within bounds."""
    return Check(
        f"a whole number from {low} to {high}", lambda v: type(v) is int and low <= v <= high
    )


def one_of(names: Collection[str]) -> Check:
    """One of some names."""
    return Check(f"one of {sorted(names)}", lambda v: isinstance(v, str) and v in names)


def is_layers(value: Any) -> bool:
    """The units of each layer of a network."""
    short = isinstance(value, list) and len(value) <= MAX_LAYERS
    return short and all(map(integer(1, MAX_UNITS).condition, value))


def layers_of(*networks: str) -> Check:
    """Layers of each of the named networks."""
    return Check(
        f"a mapping of {list(networks)} to such lists",
        lambda v: isinstance(v, dict) and {*v} == {*networks} and all(map(is_layers, v.values())),
    )


boolean = Check("True or False", lambda v: isinstance(v, bool))
null = Check("null", lambda v: v is None)
finite = Check("a finite number", is_number)
positive = Check("a number above 0", lambda v: is_number(v) and v > 0)
non_negative = Check("a number 0 or above", lambda v: is_number(v) and v >= 0)
fraction = Check("a number between 0 and 1", lambda v: is_number(v) and 0 <= v <= 1)
linear = Check("'linear_NUMBER'", has_number("linear_"))
auto = Check("'auto'", lambda v: v == "auto")
auto_number = Check("'auto_NUMBER'", has_number("auto_"))
layers = Check(f"a list of up to {MAX_LAYERS} layers of 1 to {MAX_UNITS} units", is_layers)
mapping = Check("a mapping, such as {}", lambda v: isinstance(v, dict))
mappings = Check(
    "a list of mappings, at least one",
    lambda v: isinstance(v, list) and v != [] and all(isinstance(one, dict) for one in v),
)

# Of the arguments in Stable-Baselines3 those that are plain data and not set by train.py itself:
# no classes, no files, no devices.
COMMON: dict[str, Check] = {
    "learning_rate": positive | linear,
    "n_steps": integer(1, 10**6),
    "batch_size": integer(2, 10**6),
    "gamma": fraction,
    "use_sde": boolean,
    "sde_sample_freq": integer(-1, 10**6),  # -1: once a rollout
    "stats_window_size": integer(1, 10**6),
    "verbose": integer(0, 2),
}
HYPERPARAMETERS: dict[str, dict[str, Check]] = {
    "ppo": {
        **COMMON,
        "n_epochs": integer(1, 1000),
        "gae_lambda": fraction,
        "clip_range": positive | linear,
        "clip_range_vf": positive | null,
        "normalize_advantage": boolean,
        "ent_coef": non_negative,
        "vf_coef": non_negative,
        "max_grad_norm": positive,
        "target_kl": positive | null,
    },
    "sac": {
        **COMMON,
        "buffer_size": integer(1, 10**8),
        "learning_starts": integer(0, MAX_STEPS),
        "train_freq": integer(1, 10**6),
        "gradient_steps": integer(-1, 10**5),  # -1: as many as steps were taken
        "ent_coef": positive | auto | auto_number,
        "target_entropy": finite | auto,
        "use_sde_at_warmup": boolean,
        "tau": fraction,
        "target_update_interval": integer(1, 10**6),
    },
}
POLICY: dict[str, Check] = {
    "activation": one_of(("tanh", "relu", "elu")),
    "normalize": boolean,
    "harmonics": integer(0, MAX_HARMONICS),
    "log_std_init": finite,
    "use_expln": boolean,
    "share_features_extractor": boolean,
}
POLICY_KWARGS: dict[str, dict[str, Check]] = {
    "ppo": {
        **POLICY,
        "net_arch": layers | layers_of("pi", "vf"),
        "ortho_init": boolean,
        "full_std": boolean,
        "squash_output": boolean,
    },
    "sac": {
        **POLICY,
        "net_arch": layers | layers_of("pi", "qf"),
        "clip_mean": non_negative,
        "n_critics": integer(1, 10),
    },
}
KEYS: dict[str, Check] = {
    "policy": one_of(("MlpPolicy",)),
    "timesteps": integer(1, MAX_STEPS),
    "n_envs": integer(1, 10_000),
    "reward_scale": positive,
    "fall_cost": non_negative,
    "env_kwargs": mapping,
    "training_variants": mappings,
    "hyperparameters": mapping,
    "policy_kwargs": mapping,
    "algo": one_of(HYPERPARAMETERS),
    "env": one_of(TASKS),
    "seed": integer(0, 2**32 - 1),
}
TO_TRAIN = ("policy", "timesteps", "n_envs", "hyperparameters")
TO_RESUME = (*TO_TRAIN, "algo", "env", "seed")
TO_LOAD = ("algo", "env", "policy")


def shipped_config(env_id: str, algo: str) -> Path:
    """The configuration for an environment and algorithm that comes with the package.

    Raises:
        ValueError: there is none.
    """
    path = CONFIGS / env_id / f"{algo}.yml"
    if not path.is_file():
        files = [p for p in CONFIGS.glob("*/*.yml") if p.stem in HYPERPARAMETERS]
        found = sorted(f"{p.parent.name}/{p.stem}" for p in files)
        raise ValueError(
            f"no configuration for {env_id}/{algo}, must be one of {found}, or a file of your own"
        )
    return path


def load_config(
    path: str | Path,
    algo: str | None = None,
    env_id: str | None = None,
    required: Collection[str] = TO_TRAIN,
) -> dict[str, Any]:
    """A training configuration from YAML; it can name no code, each name is looked up in a table.

    Keys: ``policy``, ``timesteps``, ``n_envs``, ``reward_scale`` and ``fall_cost`` (of the
    training reward: a factor, and what a fall takes off before it), ``env_kwargs`` (for training
    and evaluation), ``training_variants`` (mappings of further arguments, for training alone:
    environment i takes number i, counted around; ``max_episode_steps`` is one too),
    ``hyperparameters`` (the algorithm's arguments; ``learning_rate`` and ``clip_range`` may be
    "linear_X", falling from X to 0 over the run) and ``policy_kwargs`` (the policy's;
    ``activation`` is a name, ``normalize`` scales observations, and with it ``harmonics`` appends
    so many of the crank angle). The config.yml of a run also has ``algo``, ``env`` and ``seed``.

    Args:
        path: of the file, see :func:`agents.plain_yaml.parse_yaml`.
        algo, env_id, required: as of :func:`check_config`.

    Raises:
        ValueError: no such file, no YAML, or not allowed by :func:`check_config`; names the file.
    """
    config: dict[str, Any] = read_yaml(path)
    try:
        check_config(config, algo, env_id, required)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return config


def new_config(
    path: str | Path | None = None,
    algo: str | None = None,
    env_id: str | None = None,
    env_kwargs: dict[str, Any] | None = None,
    **values: Any,
) -> dict[str, Any]:
    """The whole configuration of a new run: a file's, with what is given in its place.

    Args:
        path: of the file; None for the one shipped for ``env_id`` and ``algo``.
        algo, env_id: None for the file's own, or else ppo and :data:`agents.tasks.DEFAULT`.
        env_kwargs: on top of the file's; they hold in training as well.
        values: further keys, such as ``timesteps``; None for the file's. ``seed`` is 0 without.

    Raises:
        ValueError: as of :func:`load_config`.
    """
    config = load_config(path, algo, env_id) if path else {}
    algo = algo or config.get("algo", "ppo")
    env_id = env_id or config.get("env", DEFAULT)
    if not path:
        config = load_config(shipped_config(env_id, algo), algo, env_id)
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
    """Arguments of all training environments, and the variants that they take in turn.

    Arguments that are the same in all variants are among the former: some of them, such as the
    reward's weights, cannot differ between the robots of a batch.
    """
    variants = config.get("training_variants", [{}])
    first, *others = variants
    common = {k: v for k, v in first.items() if all(k in one and one[k] == v for one in others)}
    rest = [{k: v for k, v in one.items() if k not in common} for one in variants]
    return {**config.get("env_kwargs", {}), **common}, rest


def check_config(
    config: Any,
    algo: str | None = None,
    env_id: str | None = None,
    required: Collection[str] = TO_TRAIN,
) -> None:
    """Check a configuration's names and values.

    Args:
        config: see :func:`load_config`. required: keys that it must have.
        algo, env_id: what it is for; None for its own ``algo`` and ``env``. Where it has none
            either, the arguments of algorithm, policy and environment stay unchecked.

    Raises:
        ValueError: an unknown or missing key, or a value that is not allowed.
    """
    mapping("configuration", config)
    missing = [name for name in required if name not in config]
    if missing:
        raise ValueError(f"configuration has no {missing}, must have {list(required)}")
    _check("", config, KEYS)
    algo, env_id = algo or config.get("algo"), env_id or config.get("env")
    if algo is not None:
        _check_algorithm(algo, config)
    if env_id is not None:
        _check_environment(env_id, config)


def _check_algorithm(algo: str, config: dict[str, Any]) -> None:
    """What only some algorithms have, and what goes together."""
    hyperparameters = config.get("hyperparameters", {})
    policy_kwargs = config.get("policy_kwargs", {})
    _check("hyperparameters", hyperparameters, HYPERPARAMETERS[algo])
    _check("policy_kwargs", policy_kwargs, POLICY_KWARGS[algo])
    if policy_kwargs.get("harmonics") and not policy_kwargs.get("normalize"):
        raise ValueError("harmonics is given, so normalize must be true, too")


def _check_environment(env_id: str, config: dict[str, Any]) -> None:
    """The arguments of an environment, in training too."""
    check_env_kwargs(env_id, config.get("env_kwargs", {}))
    for variant in config.get("training_variants", ()):
        check_env_kwargs(env_id, variant)


def _check(part: str, values: dict[str, Any], table: dict[str, Check]) -> None:
    """Each value by the table's check of its name."""
    for name, value in values.items():
        if name not in table:
            where = f" of {part}" if part else ""
            raise ValueError(f"{name!r} is no key{where}, must be in {sorted(table)}")
        table[name](f"{part}.{name}" if part else name, value)


def find_config(model: str | Path) -> Path:
    """The config.yml of the run a model belongs to: in its folder or the one above.

    Raises:
        ValueError: there is none.
    """
    folder = Path(model).resolve().parent
    for place in (folder, folder.parent):
        if (place / "config.yml").is_file():
            return place / "config.yml"
    raise ValueError(
        f"no config.yml beside {model}: it must say how the model is built, at least "
        f"{list(TO_LOAD)}, and hyperparameters' use_sde and policy_kwargs where they are not "
        "Stable-Baselines3's own"
    )
