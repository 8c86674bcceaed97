"""Training configurations: where they lie, and how they are read and checked."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, TypeAlias

from agents.command_line import MAX_STEPS
from agents.plain_yaml import read_yaml
from agents.tasks import TASKS, check_env_kwargs
from jansen_env.checks import finite, non_negative, positive, shown, within

CONFIGS = Path(__file__).parent / "configs"
MAX_UNITS, MAX_LAYERS = 1024, 8  # of a network

Check: TypeAlias = Callable[[str, Any], object]
"""Takes a value's name and the value; raises ValueError unless it is allowed."""


def check_that(allowed: str, condition: Callable[[Any], bool]) -> Check:
    """Values that meet a condition; ``allowed`` says which."""

    def check(name: str, value: Any) -> None:
        if not condition(value):
            raise ValueError(f"{name} is {shown(value)}, must be {allowed}")

    return check


def integer(low: int, high: int) -> Check:
    """A whole number within bounds."""
    return check_that(
        f"a whole number from {low} to {high}", lambda v: type(v) is int and low <= v <= high
    )


def one_of(names: Collection[str]) -> Check:
    """One of some names."""
    return check_that(f"one of {sorted(names)}", lambda v: isinstance(v, str) and v in names)


def text_or(pattern: str, allowed: str, other: Check) -> Check:
    """Text of a pattern, its group (if any) a positive number, or what another check allows."""

    def check(name: str, value: Any) -> None:
        try:
            match = re.fullmatch(pattern, value) if isinstance(value, str) else None
            if match is None:
                other(name, value)
            elif match.lastindex:
                positive(name, float(match[1]))
        except ValueError as error:
            raise ValueError(f"{error}, or {allowed}") from error

    return check


def optional(other: Check) -> Check:
    """Null, or what another check allows."""
    return lambda name, value: None if value is None else other(name, value)


def layers(*networks: str) -> Check:
    """Units of each layer, in one list or in one for each of the named networks."""

    def units(value: Any) -> bool:
        return (
            isinstance(value, list)
            and len(value) <= MAX_LAYERS
            and all(type(one) is int and 1 <= one <= MAX_UNITS for one in value)
        )

    def each(value: Any) -> bool:
        return (
            isinstance(value, dict)
            and set(value) == {*networks}
            and all(map(units, value.values()))
        )

    return check_that(
        f"a list of up to {MAX_LAYERS} layers of 1 to {MAX_UNITS} units, or a mapping of "
        f"{list(networks)} to such lists",
        lambda value: units(value) or each(value),
    )


def fraction(name: str, value: Any) -> None:
    """A number between 0 and 1."""
    within(name, value, 0, 1)


boolean = check_that("True or False", lambda v: isinstance(v, bool))
mapping = check_that("a mapping, such as {}", lambda v: isinstance(v, dict))
mappings = check_that(
    "a list of mappings, at least one",
    lambda v: isinstance(v, list) and v != [] and all(isinstance(one, dict) for one in v),
)
NUMBER = r"((?:[0-9]+\.?|[0-9]*\.[0-9]+)(?:[eE][-+]?[0-9]+)?)"
SCHEDULE = text_or(f"linear_{NUMBER}", "'linear_NUMBER'", positive)

# Of the arguments in Stable-Baselines3 those that are plain data and not set by train.py itself:
# no classes, no files, no devices.
COMMON: dict[str, Check] = {
    "learning_rate": SCHEDULE,
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
        "clip_range": SCHEDULE,
        "clip_range_vf": optional(positive),
        "normalize_advantage": boolean,
        "ent_coef": non_negative,
        "vf_coef": non_negative,
        "max_grad_norm": positive,
        "target_kl": optional(positive),
    },
    "sac": {
        **COMMON,
        "buffer_size": integer(1, 10**8),
        "learning_starts": integer(0, MAX_STEPS),
        "tau": fraction,
        "train_freq": integer(1, 10**6),
        "gradient_steps": integer(-1, 10**5),  # -1: as many as steps were taken
        "ent_coef": text_or(f"auto(?:_{NUMBER})?", "'auto' or 'auto_NUMBER'", positive),
        "target_update_interval": integer(1, 10**6),
        "target_entropy": text_or("auto", "'auto'", finite),
        "use_sde_at_warmup": boolean,
    },
}
POLICY: dict[str, Check] = {
    "activation": one_of(("tanh", "relu", "elu")),
    "normalize": boolean,
    "log_std_init": finite,
    "use_expln": boolean,
    "share_features_extractor": boolean,
}
POLICY_KWARGS: dict[str, dict[str, Check]] = {
    "ppo": {
        **POLICY,
        "net_arch": layers("pi", "vf"),
        "ortho_init": boolean,
        "full_std": boolean,
        "squash_output": boolean,
    },
    "sac": {
        **POLICY,
        "net_arch": layers("pi", "qf"),
        "clip_mean": non_negative,
        "n_critics": integer(1, 10),
    },
}
KEYS: dict[str, Check] = {
    "policy": one_of(("MlpPolicy",)),
    "timesteps": integer(1, MAX_STEPS),
    "n_envs": integer(1, 10_000),
    "reward_scale": positive,
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
        found = sorted(f"{p.parent.name}/{p.stem}" for p in CONFIGS.glob("*/*.yml"))
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

    Keys: ``policy``, ``timesteps``, ``n_envs``, ``reward_scale``, ``env_kwargs`` (for training and
    evaluation), ``training_variants`` (further arguments of the training environments, taken in
    turn; ``max_episode_steps`` is one too), ``hyperparameters`` (the algorithm's arguments;
    ``learning_rate`` and ``clip_range`` may be "linear_X", falling from X to 0 over the run) and
    ``policy_kwargs`` (the policy's; ``activation`` is a name, ``normalize`` scales observations).
    The config.yml of a run also has ``algo``, ``env`` and ``seed``.

    Numbers may be written ``2e2`` and ``5e-1``, see :func:`agents.plain_yaml.parse_yaml`.

    Args:
        path: of the file. algo, env_id, required: as of :func:`check_config`.

    Raises:
        ValueError: no such file, no YAML, an unknown or missing key, or a value that is not
            allowed; names the file.
    """
    config = read_yaml(path)
    try:
        check_config(config, algo, env_id, required)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    checked: dict[str, Any] = config
    return checked


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
        _check("hyperparameters", config.get("hyperparameters", {}), HYPERPARAMETERS[algo])
        _check("policy_kwargs", config.get("policy_kwargs", {}), POLICY_KWARGS[algo])
    if env_id is not None:
        for arguments in (config.get("env_kwargs", {}), *config.get("training_variants", ())):
            check_env_kwargs(env_id, arguments)


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
