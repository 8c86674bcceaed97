"""A search for hyperparameters that stops what is hopeless early: ASHA of Ray Tune.

Li et al., "A System for Massively Parallel Hyperparameter Tuning", MLSys 2020. A trial is a run as
any other, in its own folder; its returns at evaluations during training say whether it goes on.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import wait
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from tabulate import tabulate

from agents.config import (
    KEYS,
    TO_RESUME,
    Check,
    check_config,
    integer,
    is_number,
    load_config,
    mapping,
)
from agents.plain_yaml import read_yaml
from agents.runs import read_evaluations
from agents.study_backends import RETRIES, TICK, new_pool, ray_cluster
from agents.study_plan import Run
from agents.study_progress import Progress
from agents.study_runs import Order, Outcome, is_finished, perform, read_status
from jansen_env.checks import shown
from jansen_env.files import write_json, write_text

SPACE, BEST_CONFIG = "space.yml", "best.yml"
EARLY = "stopped_early.txt"
MAX_TRIALS = 10_000
DIGITS = 4  # significant ones of numbers that are drawn


def _bounds(value: Any, kind: Any = is_number) -> bool:
    pair = isinstance(value, list) and len(value) == 2 and all(map(kind, value))
    return pair and value[0] < value[1]


RANGES: dict[str, Check] = {
    "choice": Check("a list of values, at least one", lambda v: isinstance(v, list) and v != []),
    "uniform": Check("[LOW, HIGH], numbers", _bounds),
    "loguniform": Check("[LOW, HIGH], numbers above 0", lambda v: _bounds(v) and v[0] > 0),
    "int": Check(
        "[LOW, HIGH], whole numbers", lambda v: _bounds(v, lambda number: type(number) is int)
    ),
}
"""Of a parameter; the ends of "int" belong to it. "loguniform" is uniform in the logarithm."""
WAYS: dict[str, Check] = {
    "trials": integer(1, MAX_TRIALS),
    "reduction_factor": integer(2, 100),
    "grace_steps": KEYS["timesteps"],
}
DEFAULTS = {"trials": 16, "reduction_factor": 4}
NESTED = ("hyperparameters", "policy_kwargs")
SEARCHED = ("n_envs", "reward_scale", *NESTED)


def read_space(path: str | Path, config: dict[str, Any]) -> dict[str, Any]:
    """What is searched, and how, from YAML.

    Keys: ``trials``, how many; ``reduction_factor`` eta: of each eta trials one goes on past each
    rung; ``grace_steps``, the first rung, with eta times as many steps to each next one (without:
    timesteps / eta^2); and parameters, by name: ``n_envs``, ``reward_scale``, and in
    ``hyperparameters`` and ``policy_kwargs`` theirs. A parameter is a mapping of one of
    :data:`RANGES` to its values, and may have ``schedule: linear``: falling to 0 over the run.

    Args:
        path: of the file. config: the configuration whose values these take the place of.

    Raises:
        ValueError: no such file, no YAML, an unknown key or a value that is not allowed.
    """
    space = read_yaml(path)
    try:
        mapping("space", space)
        allowed = sorted({*WAYS, *SEARCHED})
        for name, value in space.items():
            if name not in allowed:
                raise ValueError(f"{name!r} is no key, must be in {allowed}")
            if name in WAYS:
                WAYS[name](name, value)
        found = _parameters(space)
        if not found:
            raise ValueError(f"there is nothing to search, must have some of {list(SEARCHED)}")
        for (part, name), parameter in found.items():
            for value in _extremes(f"{part}.{name}" if part else name, parameter):
                check_config(with_values(config, {(part, name): value}), required=TO_RESUME)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    first = max(1, config["timesteps"] // space.get("reduction_factor", 4) ** 2)
    return {**DEFAULTS, "grace_steps": first, **space}


def _parameters(space: dict[str, Any]) -> dict[tuple[str, str], Any]:
    """The parameters of a space, by part of the configuration and name."""
    found: dict[tuple[str, str], Any] = {}
    for name in SEARCHED:
        if name in NESTED and name in space:
            mapping(name, space[name])
            found |= {(name, own): value for own, value in space[name].items()}
        elif name in space:
            found["", name] = space[name]
    return found


def _extremes(name: str, parameter: Any) -> list[Any]:
    """The values at the ends of a parameter's range.

    Raises:
        ValueError: it is none.
    """
    mapping(name, parameter)
    kinds = [key for key in parameter if key != "schedule"]
    if len(kinds) != 1 or kinds[0] not in RANGES:
        raise ValueError(f"{name} is {shown(parameter)}, must have one of {list(RANGES)}")
    if parameter.get("schedule", "linear") != "linear":
        raise ValueError(f"schedule of {name} is {shown(parameter['schedule'])}, must be 'linear'")
    RANGES[kinds[0]](f"{kinds[0]} of {name}", parameter[kinds[0]])
    return [_scheduled(value, parameter) for value in parameter[kinds[0]]]


def _scheduled(value: Any, parameter: dict[str, Any]) -> Any:
    if isinstance(value, float):
        value = float(f"{value:.{DIGITS}g}")
    return f"linear_{value!r}" if "schedule" in parameter else value


def with_values(config: dict[str, Any], values: dict[tuple[str, str], Any]) -> dict[str, Any]:
    """A configuration with some values in place of its own; they are named by part and key."""
    config = {**config, **{part: dict(config.get(part, {})) for part in NESTED}}
    for (part, name), value in values.items():
        (config[part] if part else config)[name] = value
    return config


def search(order: Order, space: dict[str, Any], address: str | None) -> dict[str, Outcome]:
    """Run a search in the folder of a study; what has been run there before is taken as it is.

    Trials are drawn anew by the same generator each time: trial i always has the same values. What
    was stopped early stays so.

    Args:
        order: the run that trials differ from; they go beside it. space: as of
            :func:`read_space`. address: as of :func:`agents.study_backends.run_on_ray`.

    Returns:
        How each trial ended, by its name.

    Raises:
        ValueError: another search was begun in this folder.
    """
    folder = order.run.folder.parent.parent
    _enter(folder, space)
    parameters = _parameters(space)
    with ray_cluster(address):
        from ray import tune
        from ray.tune.schedulers import ASHAScheduler
        from ray.tune.search import BasicVariantGenerator

        os.environ["TUNE_DISABLE_AUTO_CALLBACK_LOGGERS"] = "1"
        watch = _watch(order, parameters)
        tuner = tune.Tuner(
            tune.with_resources(
                tune.with_parameters(_trial, order=order, parameters=parameters),
                {"cpu": order.cores},
            ),
            param_space={
                f"{part}.{name}": _domain(tune, parameter)
                for (part, name), parameter in parameters.items()
            },
            tune_config=tune.TuneConfig(
                metric="return", mode="max", num_samples=space["trials"],
                search_alg=BasicVariantGenerator(random_state=order.run.config["seed"]),
                scheduler=ASHAScheduler(
                    time_attr="steps", max_t=order.run.config["timesteps"],
                    grace_period=min(space["grace_steps"], order.run.config["timesteps"]),
                    reduction_factor=space["reduction_factor"], stop_last_trials=False,
                ),
            ),
            run_config=tune.RunConfig(
                name="tune", storage_path=str(folder), verbose=0, callbacks=[watch],
                failure_config=tune.FailureConfig(max_failures=RETRIES),
            ),
        )  # fmt: skip
        with watch.progress:
            tuner.fit()
    return watch.outcomes


def _enter(folder: Path, space: dict[str, Any]) -> None:
    """Keep the space in the folder; raises ValueError where there is another."""
    if (folder / SPACE).is_file():
        found = read_yaml(folder / SPACE)
        if found != space:
            differing = sorted(k for k in {**found, **space} if found.get(k) != space.get(k))
            raise ValueError(f"{folder} holds another search, with other {differing}; take "
                             "another name")  # fmt: skip
    write_text(folder / SPACE, yaml.safe_dump(space, sort_keys=False))


def _domain(tune: Any, parameter: dict[str, Any]) -> Any:
    """A parameter's range as Tune has it."""
    ((kind, values),) = ((k, v) for k, v in parameter.items() if k != "schedule")
    if kind == "choice":
        return tune.choice(values)
    if kind == "int":
        return tune.randint(values[0], values[1] + 1)
    return getattr(tune, kind)(*values)


def _trial_run(
    order: Order, parameters: dict[tuple[str, str], Any], trial_id: str, drawn: dict[str, Any]
) -> Run:
    """The run of a trial: folder and configuration."""
    values: dict[tuple[str, str], Any] = {}
    for (part, name), parameter in parameters.items():
        value = drawn[f"{part}.{name}"]
        value = value.item() if hasattr(value, "item") else value
        values[part, name] = _scheduled(value, parameter)
    folder = order.run.folder.parent / f"trial_{trial_id.rsplit('_', 1)[-1]}"
    return Run(folder, order.run.group, with_values(order.run.config, values))


def _trial(drawn: dict[str, Any], order: Order, parameters: dict[tuple[str, str], Any]) -> None:
    """What Tune runs: a run in a process of its own, and its evaluations reported as they come."""
    from ray import tune

    run = _trial_run(order, parameters, tune.get_context().get_trial_id(), drawn)
    reported = 0

    def report() -> None:
        nonlocal reported
        for row in read_evaluations(run.folder)[reported:]:
            reported += 1
            tune.report({"return": row["return"], "steps": int(row["steps"])})

    report()
    if trial_state(run.folder) in ("finished", "stopped early"):
        return
    with new_pool() as pool:
        future = pool.submit(perform, replace(order, run=run))
        while wait([future], TICK).not_done:
            report()
        outcome = future.result()
    if outcome.state == "finished":
        report()


def _watch(order: Order, parameters: dict[tuple[str, str], Any]) -> Any:
    """Tune's callback that shows the trials, and keeps which runs they are."""
    from ray import tune

    class Watch(tune.Callback):
        def __init__(self) -> None:
            self.runs: dict[str, Run] = {}
            self.outcomes: dict[str, Outcome] = {}
            self.progress = Progress([])

        def __getstate__(self) -> dict[str, Any]:
            return {}  # Tune writes its callbacks down; nothing is restored from there

        def on_step_end(self, iteration: int, trials: list[Any], **info: Any) -> None:
            for trial in trials:
                if trial.trial_id not in self.runs:
                    run = _trial_run(order, parameters, trial.trial_id, trial.config)
                    self.runs[trial.trial_id] = run
                    self.progress.add(run)
            self.progress(self.outcomes)

        def on_trial_complete(
            self, iteration: int, trials: list[Any], trial: Any, **info: Any
        ) -> None:
            run = _trial_run(order, parameters, trial.trial_id, trial.config)
            state = trial_state(run.folder)
            if state in ("starting", "training", "scoring"):  # ended by the scheduler
                write_text(run.folder / EARLY, "by ASHA\n")
                state = "stopped early"
            self.outcomes[run.name] = Outcome(state)

    return Watch()


def trial_state(folder: Path) -> str:
    """As of a run; or "stopped early"."""
    if is_finished(folder):
        return "finished"
    if (folder / EARLY).is_file():
        return "stopped early"
    return str(read_status(folder).get("state", "waiting"))


def search_report(folder: Path, space: dict[str, Any]) -> str:
    """Write best.yml, search.json and search.md of the trials in a study's folder; the table.

    Raises:
        ValueError: a trial's files are damaged.
    """
    parameters = _parameters(space)
    rows = []
    for path in sorted(folder.glob("*/trial_*/config.yml")):
        config = load_config(path, required=TO_RESUME)
        evaluations = read_evaluations(path.parent)
        best = max(evaluations, key=lambda row: row["return"], default=None)
        rows.append({
            "trial": str(path.parent.relative_to(folder)), "state": trial_state(path.parent),
            "steps": evaluations[-1]["steps"] if evaluations else 0,
            "return": best and best["return"],
            **{name: (config[part] if part else config)[name] for part, name in parameters},
        })  # fmt: skip
    rows.sort(key=lambda row: -math.inf if row["return"] is None else row["return"], reverse=True)
    write_json(folder / "search.json", rows)
    text = tabulate(rows, "keys", tablefmt="github", missingval="-")
    if rows and rows[0]["return"] is not None:
        config = load_config(folder / rows[0]["trial"] / "config.yml", required=TO_RESUME)
        del config["seed"]
        write_text(folder / BEST_CONFIG, yaml.safe_dump(config, sort_keys=False))
        text += f"\n\nbest, for train.py --config and other seeds: {folder / BEST_CONFIG}"
    write_text(folder / "search.md", f"# {folder.name}\n\n{text}\n")
    return text
