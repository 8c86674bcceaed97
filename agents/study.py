"""Train many runs on Ray Tune and compare them over seeds: ``python -m agents.study``."""

from __future__ import annotations

import os

# Before torch and Ray are loaded. More threads would change the run that a seed gives; Ray listens
# on all network interfaces, so it obeys only those who know its token.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_AUTH_MODE", "token")

import argparse
import re
import secrets
import socket
import sys
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
import yaml

from agents import need
from agents.training.config import add_run_flags, new_config
from agents.training.runs import FINAL, last_state, locked, record_run
from agents.training.scores import score_run
from agents.training.train_model import prepare, train
from jansen_env.checks import MAX_STEPS, shown
from jansen_env.commands.flags import Parser, env_id, positive_int
from jansen_env.cores import available_cores
from jansen_env.files import write_text
from jansen_env.plain_yaml import Rule, check_keys, named_errors, read_yaml
from jansen_env.sb3.run_config import ALGORITHMS, KEYS, Arguments, RunConfig, make_config
from jansen_env.scoring.benchmarks import DEFAULT

need("distributed", "pandas", "ray", who="agents.study")
import ray
from ray import tune

from agents.studies.study_report import write_report

PLAN = "study.yml"
RETRIES = 3  # of a run that fails, as where its process or machine is lost
RULES = {
    "seeds": Rule((int, list), 1, 10_000), "envs": Rule((list,)), "algos": Rule((list,)),
    "config": Rule((str,)), "eval_freq": Rule((int,), 0, MAX_STEPS),
    "save_freq": Rule((int,), 0, MAX_STEPS), "eval_episodes": Rule((int,), 1, 100_000),
    "variants": Rule((dict,)), **{key: KEYS[key] for key in ("timesteps", "n_envs", "env_kwargs")},
}  # fmt: skip
VARIANT = {**{name: rule for name, rule in KEYS.items() if name != "seed"},
           "config": RULES["config"]}  # fmt: skip


@dataclass(frozen=True)
class Study:
    """Each variant on each environment, by each algorithm, with each seed.

    A variant's ``hyperparameters``, ``policy_kwargs`` and ``env_kwargs`` come on top of the
    configuration's; its other entries, ``env`` and ``algo`` too, replace those of the study.

    Raises:
        ValueError: a value that is not allowed.
    """

    seeds: int | list[int] = 10
    envs: list[str] = field(default_factory=lambda: [DEFAULT])
    algos: list[str] = field(default_factory=lambda: ["ppo"])
    timesteps: int | None = None
    n_envs: int | None = None
    env_kwargs: Arguments = field(default_factory=dict)
    config: str | None = None
    eval_freq: int | None = None
    save_freq: int = 100_000
    eval_episodes: int = 10
    variants: dict[str, Arguments] = field(default_factory=lambda: {"": {}})

    def __post_init__(self) -> None:
        check_keys("", {k: v for k, v in vars(self).items() if v is not None}, RULES)
        for name in ("seeds", "envs", "algos"):
            values = getattr(self, name)
            if isinstance(values, list) and not 0 < len({*map(str, values)}) == len(values):
                raise ValueError(f"{name} is {shown(values)}, must be a list with each once")
        if not self.variants:
            raise ValueError("variants is {}, must have one variant or more")
        for name in self.variants:
            if not (isinstance(name, str) and re.fullmatch(r"[\w.-]*", name)):
                raise ValueError(
                    f"variants has the name {shown(name)}, must be a text of letters, digits, "
                    "'_', '.' and '-'"
                )
        self.runs()

    def groups(self) -> dict[str, RunConfig]:
        """Return the configurations that are run with all seeds, by name."""
        groups = {}
        for name, variant in self.variants.items():
            Rule((dict,)).check(f"variant {name}", variant)
            check_keys(f"variant {name}", variant, VARIANT)
            for env in [variant["env"]] if "env" in variant else self.envs:
                for algo in [variant["algo"]] if "algo" in variant else self.algos:
                    group = "_".join(part for part in (env, algo, name) if part)
                    values = {"timesteps": self.timesteps, "n_envs": self.n_envs, **variant}
                    values |= {"env": None, "algo": algo, "env_id": env}
                    values["env_kwargs"] = {**self.env_kwargs, **variant.get("env_kwargs", {})}
                    with named_errors(group):
                        groups[group] = new_config(values.pop("config", self.config), **values)
        return groups

    def runs(self) -> list[Arguments]:
        """Return the parameters of each trial, the first seed of all groups first."""
        seeds = range(self.seeds) if isinstance(self.seeds, int) else self.seeds
        groups = self.groups()
        return [
            {"name": f"{name}-seed_{seed}", "config": asdict(replace(config, seed=seed)),
             "eval_freq": self.eval_freq, "save_freq": self.save_freq,
             "eval_episodes": self.eval_episodes}
            for seed in seeds
            for name, config in groups.items()
        ]  # fmt: skip


def run_trial(parameters: dict[str, Arguments], root: Path) -> None:
    """Train and score the ``run`` of :meth:`Study.runs`, from its last checkpoint, as a trial.

    Its files go to ``root/NAME`` at once, as train.py's do to a run's folder. Of Ray's own
    checkpoints the last could be lost: one that it removes may be what its state still names.
    """
    torch.set_num_threads(1)  # whatever the cores: the run that a seed gives depends on the number
    run = parameters["run"]
    config, folder = make_config(run["config"]), root / run["name"]
    folder.mkdir(exist_ok=True)
    with locked(folder):
        resume = last_state(folder)
        if resume is None or resume.name != FINAL:
            model = prepare(config, resume)
            record_run(folder, config, "python -m agents.study")
            try:
                train(
                    model, config, folder, eval_every=run["eval_freq"], resume=resume,
                    save_every=run["save_freq"], tensorboard=str(folder / "tensorboard"),
                    progress=False,
                )  # fmt: skip
            except SystemExit as error:  # it diverged, or the disk is full
                raise RuntimeError(error.code) from error
        score_run(folder, config, run["eval_episodes"])


def make_study(entries: Any, source: str | Path) -> Study:
    """Return the study with these entries; a ValueError names its source."""
    with named_errors(source):
        Rule((dict,)).check("study", entries)
        check_keys("", entries, RULES)
        return Study(**entries)


def run_study(study: Study, folder: Path, args: argparse.Namespace) -> bool:
    """Execute the runs of a study on Ray, or go on where that was stopped in the folder; return
    whether all have finished. A ValueError where the folder holds another study."""
    plan, text = folder / PLAN, yaml.safe_dump(asdict(study), sort_keys=False)
    if plan.is_file() and plan.read_text("utf-8") != text:
        raise ValueError(f"{folder} holds another study, must be another --name")
    environment = {"OMP_NUM_THREADS": "1", "JANSEN_ENV_THREADS": str(args.cores)}
    if args.address is None:
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))  # of this cluster alone
        cpus = args.workers * args.cores if args.workers else available_cores()
        ray.init("local", num_cpus=cpus, include_dashboard=False, log_to_driver=False,
                 runtime_env={"env_vars": environment})  # fmt: skip
    else:
        if ":" in args.address and "/" not in args.address:  # Ray itself would try for minutes
            host, _, port = args.address.rpartition(":")
            socket.create_connection((host, int(port)), timeout=10.0).close()
        modules = [str(Path(__file__).parent)]
        ray.init(args.address, runtime_env={"env_vars": environment, "py_modules": modules})
    write_text(plan, text)
    run = tune.with_parameters(run_trial, root=folder)
    trainable = tune.with_resources(run, {"cpu": args.cores})
    if tune.Tuner.can_restore(str(folder)):
        tuner = tune.Tuner.restore(str(folder), trainable, resume_errored=True)
    else:
        tuner = tune.Tuner(
            trainable,
            param_space={"run": tune.grid_search(study.runs())},
            tune_config=tune.TuneConfig(
                trial_dirname_creator=lambda trial: trial.config["run"]["name"]
            ),
            run_config=tune.RunConfig(
                name=folder.name, storage_path=str(folder.parent), verbose=1,
                failure_config=tune.FailureConfig(max_failures=RETRIES),
            ),
        )  # fmt: skip
    results = tuner.fit()
    return results.num_terminated == len(study.runs())


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse flags; those of a run are named as in train.py. ``plan`` is the study."""
    parser = Parser("python -m agents.study", "Train many runs and compare them over seeds.",
                    "python -m agents.study --seeds 10",
                    "python -m agents.study agents/studies/ten_seeds.yml --cores 2")  # fmt: skip
    add_run_flags(parser)
    add, count = parser.add_argument, positive_int
    add("study", nargs="?", metavar="FILE", help="the study as YAML, in place of flags")
    add("--seeds", type=count, help="runs of each kind, with seeds from 0; default: 10")
    add("--env", dest="envs", nargs="+", type=env_id, metavar="ID",
        help=f"environment ids; default: {DEFAULT}")  # fmt: skip
    add("--algo", dest="algos", nargs="+", choices=sorted(ALGORITHMS),
        help="algorithms; default: ppo")  # fmt: skip
    add("--name", help="of the study; default: the file's, or else 'study'")
    add("--log-folder", default="logs/studies", metavar="DIR", help="the study goes to DIR/NAME")
    add("--cores", type=count, default=1, help="of each run, for its environments; default: 1")
    add("--workers", type=count, help="runs at once on this machine; default: as the cores allow")
    add("--address", help="of the Ray cluster to join, or 'auto'; default: a new one here")
    add("--report", metavar="FOLDER", help="of a study: only make table and figures of it again")
    args = parser.parse_args(arguments)
    args.error = parser.error
    given = {key: value for key in RULES if (value := getattr(args, key, None)) is not None}
    if (source := args.study or args.report) and given:
        parser.error(f"{source} says what the study is; not allowed beside it: {', '.join(given)}")
    args.given, args.name = given, args.name or (Path(args.study).stem if args.study else "study")
    return args


def main(arguments: list[str] | None = None) -> int:
    """Run all that is not finished, report; returns the exit status: 1 where runs are missing."""
    args = parse(arguments)
    folder = Path(args.report or Path(args.log_folder) / args.name).resolve()
    source = folder / PLAN if args.report else args.study
    try:
        entries = read_yaml(source) if source else args.given
        study = make_study(entries, source or "study")
        finished = args.report or run_study(study, folder, args)
        print(f"{write_report(folder)}\n\n{folder}/report.md, runs.csv, commands.csv")
    except (OSError, ValueError) as error:
        args.error(" ".join(str(error).split()))
    return 0 if finished else 1


if __name__ == "__main__":
    sys.exit(main())
