"""Configurations of training runs, read from YAML; every name in them is looked up in a table."""

import inspect
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, TypeAlias, get_args, get_origin

from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from typing_extensions import override

from jansen_env.checks import MAX_STEPS, invalid, named_errors, one_of, shown
from jansen_env.files.plain_yaml import HUGE, TINY, Rule, check_keys, read_yaml
from jansen_env.registration import IDS
from jansen_env.scoring.benchmarks import DEFAULT, check_env_kwargs
from jansen_env.scoring.protocol import check_training_seed

Arguments: TypeAlias = dict[str, Any]
"""Arguments by name, for environments, algorithms and networks."""

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC, "td3": TD3}
with suppress(ImportError):  # the extra "train" installs sb3_contrib
    from sb3_contrib import ARS, TQC, CrossQ, RecurrentPPO

    class CountingARS(ARS):
        """ARS that counts the step of each robot once.

        The original counts a step of all robots once per robot.
        """

        @override
        def _trigger_callback(
            self, _locals: Any, _globals: Any, callback: BaseCallback, n_envs: int
        ) -> None:
            super()._trigger_callback(_locals, _globals, callback, 1)

    ALGORITHMS |= {"tqc": TQC, "crossq": CrossQ, "ars": CountingARS, "ppo_lstm": RecurrentPPO}
POLICIES = ("MlpPolicy", "MlpLstmPolicy")  # kinds of policies; each algorithm has one of them
MOST_ENVS = 10_000  # largest number of environments of a run
MAX_UNITS = 1024  # largest number of units per layer of a network
MAX_LAYERS = 8  # largest number of layers of a network
KEYS = {
    "algo": Rule(words=tuple(ALGORITHMS)), "env": Rule(words=IDS),
    "policy": Rule((str,)), "timesteps": Rule((int,), 1, MAX_STEPS),
    "n_envs": Rule((int,), 1, MOST_ENVS), "seed": Rule((int,), 0, 2**32 - 1),
    "reward_scale": Rule((float,), TINY), "fall_cost": Rule((float,), 0),
    "env_kwargs": Rule((dict,)), "training_variants": Rule((list,)),
    "hyperparameters": Rule((dict,)), "policy_kwargs": Rule((dict,)),
}  # fmt: skip
LIMITS: dict[str, tuple[float, float]] = {
    "n_steps": (1, 10**6), "batch_size": (2, 10**6), "sde_sample_freq": (-1, 10**6),
    "stats_window_size": (1, 10**6), "verbose": (0, 2), "n_epochs": (1, 1000),
    "buffer_size": (1, 10**8), "learning_starts": (0, MAX_STEPS), "train_freq": (1, 10**6),
    "gradient_steps": (-1, 10**5), "target_update_interval": (1, 10**6), "n_critics": (1, 10),
    "gamma": (0, 1), "gae_lambda": (0, 1), "tau": (0, 1),
    "ent_coef": (0, HUGE), "vf_coef": (0, HUGE), "clip_mean": (0, HUGE),
    "log_std_init": (-HUGE, HUGE), "target_entropy": (-HUGE, HUGE), "policy_delay": (1, 1000),
    "n_delta": (1, 10_000), "n_top": (1, 10_000), "n_eval_episodes": (1, 10_000),
    "alive_bonus_offset": (-HUGE, HUGE), "n_quantiles": (1, 1000),
    "top_quantiles_to_drop_per_net": (0, 1000), "renorm_warmup_steps": (0, MAX_STEPS),
    "lstm_hidden_size": (1, MAX_UNITS), "n_lstm_layers": (1, MAX_LAYERS),
}  # fmt: skip
"""Ranges of the numeric arguments of Stable-Baselines3.

Arguments that are not in this table range from TINY to HUGE.
"""
# Arguments of Stable-Baselines3 that hyperparameters and policy_kwargs must not contain.
SET_HERE = ("seed", "_init_setup_model", "optimize_memory_usage", "normalize_images")
NETWORK = {
    "activation": Rule(words=("tanh", "relu", "elu")),
    "normalize": Rule((bool,)),
    "harmonics": Rule((int,), 0, 32),
    "half_turn": Rule((bool,)),
}
"""Rules of ``policy_kwargs``, in addition to the arguments of the policy's class."""


@dataclass(frozen=True)
class RunConfig:
    """Configuration of a training run, with the entries of its config.yml.

    Attributes:
        algo: Name of the algorithm.
        env: Id of the environment.
        policy: Name of the kind of policy.
        timesteps: Total number of environment steps.
        n_envs: Number of environments that run side by side.
        seed: Seed of the networks and the environments. Environment i begins with ``seed`` + i,
            which must not be a test seed of the benchmark.
        reward_scale: Factor by which the training reward is multiplied.
        fall_cost: Cost of a fall, which is subtracted from the training reward before it is scaled.
        env_kwargs: Arguments of the environment, for training and evaluation.
        training_variants: Further arguments of the environment, for training alone. Environment i
            uses variant i modulo the number of variants. ``max_episode_steps`` is also allowed.
        hyperparameters: Arguments of the algorithm. ``learning_rate``, ``clip_range`` and
            ``delta_std`` may be "linear_X", which decreases from X to 0 over the run.
            ``action_noise`` is the standard deviation of Gaussian noise.
        policy_kwargs: Arguments of the policy. ``activation`` is a name. ``normalize`` scales the
            observations. With ``normalize``, ``harmonics`` appends this number of harmonics of the
            crank angle, and ``half_turn`` makes all features repeat after half a turn of the crank,
            if the robot repeats, too.

    Raises:
        ValueError: If a value is not allowed.
    """

    algo: str = "ppo"
    env: str = DEFAULT
    policy: str = "MlpPolicy"
    timesteps: int = 1_000_000
    n_envs: int = 16
    seed: int = 0
    reward_scale: float = 1.0
    fall_cost: float = 0.0
    env_kwargs: Arguments = field(default_factory=dict)
    training_variants: list[Arguments] = field(default_factory=lambda: [{}])
    hyperparameters: Arguments = field(default_factory=dict)
    policy_kwargs: Arguments = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_keys("", vars(self), KEYS)
        check_training_seed(self.seed, self.n_envs)
        one_of("policy", self.policy, [*({*POLICIES} & {*ALGORITHMS[self.algo].policy_aliases})])
        variants = self.training_variants
        if not variants or not all(isinstance(variant, dict) for variant in variants):
            raise ValueError(f"training_variants must be a list of mappings, got {shown(variants)}")
        network = dict(self.policy_kwargs)
        if "net_arch" in network:
            _check_layers(network.pop("net_arch"), ["pi", "vf" if "ppo" in self.algo else "qf"])
        known = rules(self.algo, self.policy)
        check_keys("policy_kwargs", network, known["policy_kwargs"])
        check_keys("hyperparameters", self.hyperparameters, known["hyperparameters"])
        for name in ("harmonics", "half_turn"):
            if network.get(name) and not network.get("normalize"):
                raise invalid("normalize", network.get("normalize", False), f"true with {name}")
        for arguments in (self.env_kwargs, *variants):
            check_env_kwargs(self.env, arguments)


def load_config(path: str | Path, **values: str | None) -> RunConfig:
    """Read the configuration of a run from a YAML file.

    Args:
        path: Path of the file.
        values: Entries such as ``algo`` and ``env`` that replace those of the file. Entries that
            are None have no effect.

    Raises:
        ValueError: If there is no such file, if it is not YAML, if a key is unknown, or if a value
            is not allowed. The message names the file.
    """
    entries = read_yaml(path)
    with named_errors(path):
        return make_config(entries, **values)


def make_config(entries: Any, **values: str | None) -> RunConfig:
    """Return the configuration with these entries.

    Args:
        entries: Entries of a configuration file.
        values: Entries that replace those of ``entries``. Entries that are None have no effect.

    Raises:
        ValueError: If a key is unknown or a value is not allowed.
    """
    Rule((dict,)).check("configuration", entries)
    entries = {**entries, **{name: value for name, value in values.items() if value is not None}}
    known = rules(*_kind(entries))
    for name in entries.keys() - KEYS.keys():
        for part, table in known.items():
            if name in table or (part, name) == ("policy_kwargs", "net_arch"):
                raise ValueError(
                    f"{name!r} must be a key of {part}, as in {part}: {{{name}: ...}}, got it "
                    "among the keys of the file"
                )
    check_keys("", entries, KEYS)
    return RunConfig(**entries)


def _kind(entries: Arguments) -> tuple[str, str]:
    """Return the algorithm and the kind of policy of a configuration.

    If the two are unknown or incompatible, return those of PPO.
    """
    algo = entries.get("algo", "ppo")
    policy = entries.get("policy", "MlpPolicy")
    known = isinstance(algo, str) and algo in ALGORITHMS and policy in POLICIES
    return (
        (algo, policy)
        if known and policy in ALGORITHMS[algo].policy_aliases
        else ("ppo", "MlpPolicy")
    )


def _rules(function: Callable[..., object], *without: str) -> dict[str, Rule]:
    """Return a rule for each argument of a function that is a number or a bool.

    Arguments that are classes, files or devices get no rule.

    Args:
        function: The function.
        without: Names of arguments that get no rule.
    """
    rules = {}
    for name, parameter in inspect.signature(function).parameters.items():
        types = get_args(parameter.annotation) or (parameter.annotation,)
        plain = tuple(t for t in types if t in (bool, int, float, NoneType))
        if {bool, int, float} & {*plain} and name not in (*SET_HERE, *without):
            words = ("auto",) if str in types else ()
            prefix = "auto_" if words and name == "ent_coef" else ""
            if any((get_origin(t) or t) is Callable for t in types):
                prefix = "linear_"
            rules[name] = Rule(plain, *LIMITS.get(name, (TINY, HUGE)), words, prefix)
    return rules


@cache
def rules(algo: str, policy: str) -> dict[str, dict[str, Rule]]:
    """Return the rules of ``hyperparameters`` and ``policy_kwargs``, by name.

    Args:
        algo: Name of the algorithm.
        policy: Name of the kind of policy.
    """
    library = ALGORITHMS[algo]
    make = library.policy_aliases[policy].__init__
    of_policy = _rules(make, "use_sde", "lr_schedule")
    hyperparameters = _rules(library.__init__)
    if "action_noise" in inspect.signature(library.__init__).parameters:
        hyperparameters["action_noise"] = Rule((float,), TINY)
    extracts = "features_extractor_class" in inspect.signature(make).parameters  # False for ARS
    network = NETWORK if extracts else {"activation": NETWORK["activation"]}
    return {"hyperparameters": hyperparameters, "policy_kwargs": {**of_policy, **network}}


def _check_layers(value: Any, networks: list[str]) -> None:
    """Check the units of the layers of ``net_arch``.

    Args:
        value: Units of each layer, or a mapping from each network to such a list.
        networks: Names of the networks.

    Raises:
        ValueError: If ``value`` has another form, or too many layers or units.
    """
    several = isinstance(value, dict) and {*value} == {*networks}
    for layers in value.values() if several else [value]:
        fits = isinstance(layers, list) and len(layers) <= MAX_LAYERS
        if not fits or not all(type(units) is int and 1 <= units <= MAX_UNITS for units in layers):
            raise ValueError(
                f"policy_kwargs.net_arch must be a list of up to {MAX_LAYERS} layers of 1 to "
                f"{MAX_UNITS} units, or a mapping of {networks} to such lists, got {shown(value)}"
            )


def find_config(model: str | Path) -> Path:
    """Return the path of the config.yml of a model.

    Args:
        model: Path of the model. The file is in its folder or in the folder above.

    Raises:
        ValueError: If there is no such file.
    """
    folder = Path(model).resolve().parent
    for place in (folder, folder.parent):
        if (place / "config.yml").is_file():
            return place / "config.yml"
    raise ValueError(
        f"there is no config.yml beside {model}; write {folder / 'config.yml'} with the algorithm, "
        "the environment and the kind of policy with which the model was trained:\n\n"
        "    algo: ppo\n    env: JansenWalkerBuilt-v0\n    policy: MlpPolicy\n\n"
        "and add the policy_kwargs of the training, if any, such as {net_arch: [128, 128]}"
    )
