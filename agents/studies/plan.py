"""A study: seeds, environments, algorithms and hyperparameters, and the runs they make."""

from __future__ import annotations

import re
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

import yaml

from agents.training.config import new_config
from jansen_env.checks import MAX_STEPS, shown
from jansen_env.files import write_text
from jansen_env.plain_yaml import MAX_BYTES, Rule, check_keys, read_yaml
from jansen_env.sb3.run_config import KEYS, TO_RESUME, check_config
from jansen_env.scoring.benchmarks import DEFAULT

PLAN = "study.yml"
MAX_RUNS = 10_000
PARTS = ("hyperparameters", "policy_kwargs")
CHANGES = ("timesteps", "n_envs", "reward_scale", "training_variants")
STUDY: dict[str, Rule] = {
    "seeds": Rule((int, list), 1, MAX_RUNS), "envs": Rule((list,)), "algos": Rule((list,)),
    **{name: KEYS[name] for name in ("timesteps", "n_envs", "env_kwargs")},
    "config": Rule((str,)), "eval_freq": Rule((int, NoneType), 0, MAX_STEPS),
    "save_freq": Rule((int,), 0, MAX_STEPS), "eval_episodes": Rule((int,), 1, 100_000),
    "variants": Rule((dict,)),
}  # fmt: skip
VARIANT: dict[str, Rule] = {
    "config": STUDY["config"],
    **{name: KEYS[name] for name in ("env", "algo", "env_kwargs", *CHANGES, *PARTS)},
}
DEFAULTS: dict[str, Any] = {
    "seeds": 10, "envs": [DEFAULT], "algos": ["ppo"], "eval_freq": None, "save_freq": 100_000,
    "eval_episodes": 10, "variants": {"": {}},
}  # fmt: skip


class Run(NamedTuple):
    """One run of a study: its folder, its group's name, and its training configuration."""

    folder: Path
    group: str
    config: dict[str, Any]

    @property
    def name(self) -> str:
        """Group and seed."""
        return f"{self.group}/{self.folder.name}"


class Study(NamedTuple):
    """A study, complete: ``groups`` are configurations by name, each run with all seeds."""

    seeds: list[int]
    groups: dict[str, dict[str, Any]]
    eval_freq: int | None
    save_freq: int
    eval_episodes: int

    def runs(self, folder: Path) -> list[Run]:
        """Return the runs, the first seed of every group first."""
        return [
            Run(folder / group / f"seed_{number}", group, {**config, "seed": number})
            for number in self.seeds
            for group, config in self.groups.items()
        ]


def make_study(plan: dict[str, Any], source: str = "study") -> Study:
    """Make the study that a plan with keys of :data:`STUDY` describes.

    Each variant is run with each environment and algorithm, or with its own ``env`` or ``algo``
    alone; its ``hyperparameters``, ``policy_kwargs`` and ``env_kwargs`` come on top of the
    configuration's, its other keys in their place.

    Raises:
        ValueError: an unknown key, or a value that is not allowed; names ``source``.
    """
    try:
        Rule((dict,)).check("study", plan)
        check_keys("", plan, STUDY)
        plan = {**DEFAULTS, **plan}
        seeds = plan["seeds"] if isinstance(plan["seeds"], list) else [*range(plan["seeds"])]
        for name, values in (("seeds", seeds), ("envs", plan["envs"]), ("algos", plan["algos"])):
            _check_list(name, values)
        for name, variant in plan["variants"].items():
            if name:
                _check_name("variant", name)
            Rule((dict,)).check(f"variant {name}", variant)
            check_keys(f"variant {name}", variant, VARIANT)
        groups = dict(
            _group(plan, env_id, algo, name, variant)
            for name, variant in plan["variants"].items()
            for env_id in ([variant["env"]] if "env" in variant else plan["envs"])
            for algo in ([variant["algo"]] if "algo" in variant else plan["algos"])
        )
        if not 1 <= len(groups) * len(seeds) <= MAX_RUNS:
            size = f"{len(groups)} groups of {len(seeds)} seeds"
            raise ValueError(f"{size} must be 1 to {MAX_RUNS} runs")
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    return Study(seeds, groups, plan["eval_freq"], plan["save_freq"], plan["eval_episodes"])


def _check_list(name: str, values: list[Any]) -> None:
    if not values or any(values.count(value) > 1 for value in values):
        raise ValueError(f"{name} is {shown(values)}, must be a list with each once")
    for value in values:
        KEYS[name.removesuffix("s")].check(name, value)


def _check_name(what: str, name: str) -> None:
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_-]*", str(name)):
        raise ValueError(f"{what} is {shown(name)}, must be of letters, digits, - and _")


def _group(
    plan: dict[str, Any], env_id: str, algo: str, name: str, variant: dict[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Return name and configuration of one variant on one environment by one algorithm."""
    group = "_".join(part for part in (env_id, algo, name) if part)
    try:
        values = {key: variant.get(key, plan.get(key)) for key in CHANGES}
        env_kwargs = {**plan.get("env_kwargs", {}), **variant.get("env_kwargs", {})}
        path = variant.get("config", plan.get("config"))
        config = new_config(path, algo, env_id, env_kwargs, **values)
        for key in PARTS:
            config[key] = {**config.get(key, {}), **variant.get(key, {})}
        check_config(config, required=TO_RESUME)
    except ValueError as error:
        raise ValueError(f"{group}: {error}") from error
    del config["seed"]
    return group, config


def read_study(folder: str | Path) -> Study:
    """Read the study of a folder; a ValueError where it has none, or the file is damaged."""
    path = Path(folder) / PLAN
    found = read_yaml(path)
    try:
        if not isinstance(found, dict) or {*found} != {*Study._fields}:
            raise ValueError(f"is {shown(found)}, must be a mapping with {[*Study._fields]}")
        groups = found.pop("groups")
        KEYS["env_kwargs"].check("groups", groups)
        check_keys("", found, {**STUDY, "seeds": Rule((list,))})
        _check_list("seeds", found["seeds"])
        for name, config in groups.items():
            _check_name("group", name)
            check_config(config, required=[key for key in TO_RESUME if key != "seed"])
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Study(groups=groups, **found)


def enter(folder: Path, study: Study) -> None:
    """Make a study's folder, or check that it is this study's; a ValueError names what differs."""
    text = yaml.safe_dump(study._asdict(), sort_keys=False)
    if len(text.encode()) > MAX_BYTES:
        raise ValueError(f"the study takes {len(text.encode())} bytes in {PLAN}, must be at most "
                         f"{MAX_BYTES}: fewer groups")  # fmt: skip
    if not (folder / PLAN).is_file():
        write_text(folder / PLAN, text)
        return
    found, requested = _flat(read_study(folder)._asdict()), _flat(study._asdict())
    differing = [
        f"{name} is {shown(requested.get(name))}, there {shown(found.get(name))}"
        for name in {**requested, **found}
        if requested.get(name) != found.get(name)
    ]
    if differing:
        raise ValueError(f"{folder} holds another study: {'; '.join(differing[:5])}; "
                         "take another name")  # fmt: skip


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    """Return nested mappings as one, with names such as ``groups.NAME.timesteps``."""
    if not isinstance(value, dict) or not value:
        return {name.removeprefix("."): value}
    parts = [_flat(part, f"{name}.{key}") for key, part in value.items()]
    return {key: part for found in parts for key, part in found.items()}
