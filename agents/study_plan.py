"""A study: seeds, environments, algorithms and hyperparameters, and the runs they make."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from agents.command_line import MAX_STEPS
from agents.config import (
    HYPERPARAMETERS,
    KEYS,
    TO_RESUME,
    Check,
    check_config,
    integer,
    mapping,
    new_config,
    null,
    one_of,
)
from agents.plain_yaml import MAX_BYTES, read_yaml
from agents.tasks import DEFAULT, TASKS
from jansen_env.checks import shown
from jansen_env.files import write_text

PLAN = "study.yml"
MAX_RUNS = 10_000


def _names(table: Any) -> Check:
    one = one_of(table)
    return Check(
        f"a list of names, each {one.allowed} and once",
        lambda v: _distinct(v) and all(map(one.condition, v)),
    )


def _distinct(value: Any) -> bool:
    return isinstance(value, list) and value != [] and all(value.count(v) == 1 for v in value)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_-]*", value) is not None


seed = KEYS["seed"]
seeds = Check(
    f"a number of seeds from 1 to {MAX_RUNS}, or a list of them, each {seed.allowed} and once",
    lambda v: integer(1, MAX_RUNS).condition(v) or (_distinct(v) and all(map(seed.condition, v))),
)
variants = Check(
    "a mapping of names (letters, digits, - and _) to what each changes, such as {plain: {}}",
    lambda v: (
        isinstance(v, dict)
        and v != {}
        and all(_is_name(name) and isinstance(own, dict) for name, own in v.items())
    ),
)
steps = integer(0, MAX_STEPS)
STUDY: dict[str, Check] = {
    "seeds": seeds,
    "envs": _names(TASKS),
    "algos": _names(HYPERPARAMETERS),
    "timesteps": KEYS["timesteps"],
    "n_envs": KEYS["n_envs"],
    "env_kwargs": mapping,
    "config": Check("the name of a file", lambda v: isinstance(v, str) and v != ""),
    "eval_freq": steps | null,
    "save_freq": steps,
    "eval_episodes": integer(1, 100_000),
    "variants": variants,
}
CHANGES = ("timesteps", "n_envs", "reward_scale", "training_variants", "env_kwargs")
VARIANT: dict[str, Check] = {
    "env": KEYS["env"],
    "algo": KEYS["algo"],
    "config": STUDY["config"],
    **{name: KEYS[name] for name in (*CHANGES, "hyperparameters", "policy_kwargs")},
}
DEFAULTS: dict[str, Any] = {
    "seeds": 10,
    "envs": [DEFAULT],
    "algos": ["ppo"],
    "eval_freq": None,
    "save_freq": 100_000,
    "eval_episodes": 10,
}


@dataclass(frozen=True)
class Run:
    """One run of a study.

    Attributes:
        folder: where it keeps everything. group: its name; runs of one differ in their seeds alone.
        config: the training configuration, complete.
    """

    folder: Path
    group: str
    config: dict[str, Any]

    @property
    def name(self) -> str:
        """Group and seed."""
        return f"{self.group}/{self.folder.name}"


@dataclass(frozen=True)
class Study:
    """What is run, complete, as it stands in a study's folder.

    Attributes:
        seeds: of each group. groups: their configurations by name, without a seed.
        eval_freq, save_freq, eval_episodes: as of ``train.py``.
    """

    seeds: list[int]
    groups: dict[str, dict[str, Any]]
    eval_freq: int | None
    save_freq: int
    eval_episodes: int

    def runs(self, folder: Path) -> list[Run]:
        """The runs, the first seed of every group first."""
        return [
            Run(folder / group / f"seed_{number}", group, {**config, "seed": number})
            for number in self.seeds
            for group, config in self.groups.items()
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in study.yml."""
        return dict(vars(self))


def make_study(plan: dict[str, Any], source: str = "study") -> Study:
    """The study that a plan describes.

    Args:
        plan: keys of :data:`STUDY`, those of :data:`DEFAULTS` where they are missing. Each variant
            is run with each environment and algorithm, or with its own ``env`` or ``algo`` alone;
            its ``hyperparameters``, ``policy_kwargs`` and ``env_kwargs`` come on top of the
            configuration's, its other keys in their place. source: its name, for messages.

    Raises:
        ValueError: an unknown key, or a value that is not allowed; names ``source``.
    """
    try:
        mapping("study", plan)
        _check("", plan, STUDY)
        for name, variant in plan.get("variants", {}).items():
            _check(f" of variant {name}", variant, VARIANT)
        plan = {**DEFAULTS, **plan}
        given = plan["seeds"]
        numbers = list(range(given)) if isinstance(given, int) else given
        groups = dict(
            _group(plan, env_id, algo, name, variant)
            for name, variant in plan.get("variants", {"": {}}).items()
            for env_id in ([variant["env"]] if "env" in variant else plan["envs"])
            for algo in ([variant["algo"]] if "algo" in variant else plan["algos"])
        )
        if len(groups) * len(numbers) > MAX_RUNS:
            raise ValueError(f"{len(groups)} groups of {len(numbers)} seeds are more than "
                             f"{MAX_RUNS} runs, the most allowed")  # fmt: skip
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    return Study(
        numbers, groups, plan["eval_freq"], plan["save_freq"], plan["eval_episodes"]
    )  # fmt: skip


def _check(part: str, values: dict[str, Any], table: dict[str, Check]) -> None:
    for name, value in values.items():
        if name not in table:
            raise ValueError(f"{name!r} is no key{part}, must be in {sorted(table)}")
        table[name](f"{name}{part}", value)


def _group(
    plan: dict[str, Any], env_id: str, algo: str, name: str, variant: dict[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Name and configuration of one variant on one environment by one algorithm."""
    group = "_".join(part for part in (env_id, algo, name) if part)
    try:
        values = {key: variant.get(key, plan.get(key)) for key in CHANGES if key != "env_kwargs"}
        env_kwargs = {**plan.get("env_kwargs", {}), **variant.get("env_kwargs", {})}
        path = variant.get("config", plan.get("config"))
        config = new_config(path, algo, env_id, env_kwargs, **values)
        for key in ("hyperparameters", "policy_kwargs"):
            config[key] = {**config.get(key, {}), **variant.get(key, {})}
        check_config(config, required=TO_RESUME)
    except ValueError as error:
        raise ValueError(f"{group}: {error}") from error
    del config["seed"]
    return group, config


def read_plan(path: str | Path) -> dict[str, Any]:
    """The plan in a YAML file.

    Raises:
        ValueError: no such file, no YAML, or no mapping.
    """
    plan = read_yaml(path)
    mapping(str(path), plan)
    return dict(plan)


def read_study(folder: str | Path) -> Study:
    """The study of a folder.

    Raises:
        ValueError: there is none, or it is damaged.
    """
    path = Path(folder) / PLAN
    found = read_plan(path)
    try:
        if set(found) != set(Study.__dataclass_fields__):
            raise ValueError(f"has {sorted(found)}, must have {sorted(Study.__dataclass_fields__)}")
        study = Study(**found)
        if not isinstance(study.seeds, list):
            raise ValueError(f"seeds is {shown(study.seeds)}, must be a list")
        _check("", {k: v for k, v in found.items() if k != "groups"}, STUDY)
        mapping("groups", study.groups)
        for name, config in study.groups.items():
            if not _is_name(name):
                raise ValueError(f"group is {shown(name)}, must be of letters, digits, - and _")
            check_config(config, required=[key for key in TO_RESUME if key != "seed"])
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return study


def enter(folder: Path, study: Study) -> None:
    """Make a study's folder, or see that it is this study's.

    Raises:
        ValueError: it belongs to another study, names what differs; or the study is too large.
        OSError: it cannot be written to.
    """
    text = yaml.safe_dump(study.as_dict(), sort_keys=False)
    if len(text.encode()) > MAX_BYTES:
        raise ValueError(f"the study takes {len(text.encode())} bytes in {PLAN}, must be at most "
                         f"{MAX_BYTES}: fewer groups")  # fmt: skip
    if (folder / PLAN).is_file():
        found = _flat(read_study(folder).as_dict())
        asked = _flat(study.as_dict())
        differing = [
            f"{name} is {shown(asked.get(name))}, there {shown(found.get(name))}"
            for name in {**asked, **found}
            if asked.get(name) != found.get(name)
        ]
        if differing:
            raise ValueError(f"{folder} holds another study: {'; '.join(differing[:5])}; "
                             "take another name")  # fmt: skip
        return
    write_text(folder / PLAN, text)


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    """Nested mappings as one, with names such as ``groups.NAME.timesteps``."""
    if not isinstance(value, dict) or not value:
        return {name: value}
    found: dict[str, Any] = {}
    for key, part in value.items():
        found |= _flat(part, f"{name}.{key}" if name else key)
    return found
