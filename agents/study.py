"""Train many runs on Ray Tune and compare them over seeds: ``python -m agents.study``."""

from __future__ import annotations

import os

# Before torch and Ray are loaded. More threads would change the run that a seed gives; Ray listens
# on all network interfaces, so it obeys only those who know its token.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_AUTH_MODE", "token")

import argparse
import json
import secrets
import socket
import sys
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
import yaml

from agents import need
from agents.training.config import add_run_flags, new_config
from agents.training.runs import FINAL, last_state, locked, read_evaluations, record_run
from agents.training.scores import score_run
from agents.training.train_model import prepare, train
from jansen_env.arrays import Array
from jansen_env.checks import instance
from jansen_env.commands.flags import Parser, env_id, non_negative_int, positive_int
from jansen_env.commands.plots import save
from jansen_env.files import write_text
from jansen_env.plain_yaml import read_yaml
from jansen_env.plants.threads import available_cores
from jansen_env.sb3.run_config import ALGORITHMS, Arguments, make_config
from jansen_env.scoring.benchmarks import DEFAULT
from jansen_env.scoring.metrics import CONFIDENCE, Interval, interval_text

need("distributed", "pandas", "ray", who="agents.study")
import pandas as pd
import ray
from matplotlib.figure import Figure
from ray import tune
from scipy.stats import bootstrap, trim_mean

PLAN = "study.yml"  # in a study's folder: the flags that say what its runs are
PLANNED = ("seeds", "first_seed", "env", "algo", "timesteps", "n_envs", "env_kwargs", "config",
           "eval_freq", "save_freq", "eval_episodes")  # fmt: skip
NOTES = """\
A run's score is the mean return of its best model over the commands. IQM is the interquartile mean,
that of the middle half of the runs (Agarwal et al., NeurIPS 2021); brackets are its 95 % BCa
bootstrap interval, over training runs. With few runs that covers less: some
75 % with 3 runs, 90 % with 10. Intervals over episodes are in each run's scores.json."""


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse flags; those of a run are named as in train.py. A YAML file may hold them, too."""
    parser = Parser("python -m agents.study", "Train many runs and compare them over seeds.",
                    "python -m agents.study --seeds 10",
                    "python -m agents.study agents/studies/ten_seeds.yml --cores 2")  # fmt: skip
    parser.allow_abbrev = False  # of a file's keys
    add_run_flags(parser)
    parser.set_defaults(save_freq=100_000, eval_episodes=10)
    add, count = parser.add_argument, positive_int
    add("file", nargs="?", metavar="FILE", help="YAML of flags; those given here come first")
    add("--seeds", type=count, default=10, help="runs of each kind; default: 10")
    add("--first-seed", type=non_negative_int, default=0, help="of these runs; default: 0")
    add("--env", nargs="+", type=env_id, default=[DEFAULT], metavar="ID",
        help=f"environment ids; default: {DEFAULT}")  # fmt: skip
    add("--algo", nargs="+", choices=sorted(ALGORITHMS), default=["ppo"],
        help="algorithms; default: ppo")  # fmt: skip
    add("--name", help="of the study; default: the file's, or else 'study'")
    add("--log-folder", default="logs/studies", metavar="DIR", help="the study goes to DIR/NAME")
    add("--cores", type=count, default=1, help="of each run, for its environments; default: 1")
    add("--workers", type=count, help="runs at once on this machine; default: as the cores allow")
    add("--address", help="of the Ray cluster to join, or 'auto'; default: a new one here")
    add("--report", action="store_true", help="train nothing, report the runs that are finished")
    args = parser.parse_args(arguments)
    if args.file:
        with parser.refusing():
            entries = instance(args.file, read_yaml(args.file), dict)
        words = [args.file]  # first, so that a value too many is no file
        for name, value in entries.items():
            values = value if isinstance(value, list) else [value]
            words += [f"--{name.replace('_', '-')}",
                      *(v if isinstance(v, str) else json.dumps(v) for v in values)]  # fmt: skip
        args = parser.parse_args(arguments, parser.parse_args(words))
    args.parser, args.name = parser, args.name or Path(args.file or "study").stem
    return args


def planned_runs(args: argparse.Namespace) -> list[Arguments]:
    """Return name and configuration of each run; a ValueError where there is none or it is bad."""
    groups = {
        f"{env}_{algo}": new_config(args.config, algo, env, args.env_kwargs,
                                    timesteps=args.timesteps, n_envs=args.n_envs)
        for env in args.env for algo in args.algo
    }  # fmt: skip
    return [
        {"name": f"{name}-seed_{seed}", "config": asdict(replace(config, seed=seed))}
        for seed in range(args.first_seed, args.first_seed + args.seeds)
        for name, config in groups.items()
    ]


def run_trial(parameters: dict[str, Arguments], plan: Arguments, root: Path) -> None:
    """Train and score one of :func:`planned_runs`, from its last checkpoint, as a trial.

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
                    model, config, folder, eval_every=plan["eval_freq"], resume=resume,
                    save_every=plan["save_freq"], tensorboard=str(folder / "tensorboard"),
                    progress=False,
                )  # fmt: skip
            except SystemExit as error:  # it diverged, or the disk is full
                raise RuntimeError(error.code) from error
        score_run(folder, config, plan["eval_episodes"])


def run_study(args: argparse.Namespace, folder: Path) -> bool:
    """Execute the runs of a study on Ray, or go on where that was stopped in the folder; return
    whether all have finished. A ValueError where the folder holds another study."""
    runs, plan = planned_runs(args), {name: getattr(args, name) for name in PLANNED}
    file, text = folder / PLAN, yaml.safe_dump(plan, sort_keys=False)
    if file.is_file() and file.read_text("utf-8") != text:
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
    write_text(file, text)
    trial = tune.with_parameters(run_trial, plan=plan, root=folder)
    trainable = tune.with_resources(trial, {"cpu": args.cores})
    if tune.Tuner.can_restore(str(folder)):
        tuner = tune.Tuner.restore(str(folder), trainable, resume_errored=True)
    else:
        tuner = tune.Tuner(
            trainable,
            param_space={"run": tune.grid_search(runs)},
            tune_config=tune.TuneConfig(trial_dirname_creator=lambda it: it.config["run"]["name"]),
            run_config=tune.RunConfig(
                name=folder.name, storage_path=str(folder.parent), verbose=1,
                failure_config=tune.FailureConfig(max_failures=3),  # of each run
            ),
        )  # fmt: skip
    return tuner.fit().num_terminated == len(runs)


def write_report(folder: Path) -> str:
    """Write report.md, runs.csv and figures of the runs that are finished in a study's folder;
    return the report's table. runs.csv has a row over all commands, and one for each command."""
    rows, curves = [], []
    for path in sorted(folder.glob("*-seed_*/scores.json")):
        group, _, seed = path.parent.name.rpartition("-seed_")
        key = {"group": group, "env": group.split("_")[0], "seed": int(seed)}
        *baselines, (_, run) = json.loads(path.read_text("utf-8")).items()
        for policy, score in [("run", run), *baselines]:
            commands, overall = score["by_command"], score["overall"]
            values = {name: [overall[name][0], *commands[name]["value"]] for name in overall}
            grid = [None, *commands["return"]["command"]]
            rows.append(pd.DataFrame({**key, "policy": policy, "command": grid, **values}))
        curves.append(pd.DataFrame(read_evaluations(path.parent)).assign(**key))
    if not rows:
        return "no run is finished"
    scores = pd.concat(rows, ignore_index=True)
    scores.to_csv(folder / "runs.csv", index=False)
    overall = scores[scores.command.isna()]
    table = groups_table(overall)
    parts = [f"# {folder.name}", table, NOTES.replace("\n", " ")]
    for env, of_env in pd.concat(curves).groupby("env"):
        plot(of_env, overall[overall.env == env], folder / f"{env}.png")
        parts.append(f"![Learning curves on {env}]({env}.png)")
    write_text(folder / "report.md", "\n\n".join(parts) + "\n")
    return table


def groups_table(overall: pd.DataFrame) -> str:
    """Return a Markdown table: of each group a row for its runs and one for each baseline."""
    rows = []
    for (group, policy), scores in overall.groupby(["group", "policy"], sort=False):
        returns = scores["return"].to_numpy()
        row = {"group": group, "policy": policy, "mean return": f"{returns.mean():.3g}"}
        if policy == "run":
            worst = scores.loc[scores["return"].idxmin()]
            row |= {"runs": len(returns), "IQM": interval_text(interquartile_mean(returns)),
                    "worst run": f"{worst['return']:.3g} (seed {worst.seed})"}  # fmt: skip
        rows.append(row)
    table = pd.DataFrame(rows, dtype=object).fillna("")
    return str(table.to_markdown(index=False, tablefmt="github", disable_numparse=True))


def interquartile_mean(returns: Array) -> Interval:
    """Return the mean of the middle half of runs (n,) with its BCa interval (Efron 1987); NaN for
    the interval of one run or of runs that are all alike."""
    mean = partial(trim_mean, proportiontocut=0.25)
    if len(returns) < 2:
        return float(mean(returns)), np.nan, np.nan
    low, high = bootstrap((returns,), mean, confidence_level=CONFIDENCE, rng=0).confidence_interval
    return float(mean(returns)), float(low), float(high)


def plot(curves: pd.DataFrame, scores: pd.DataFrame, path: Path) -> None:
    """Draw an environment's learning curves, IQM over runs, and the baselines' returns."""
    figure = Figure((7.0, 4.6), layout="constrained")
    axis = figure.subplots()
    curve = curves.pivot_table("return", "steps", "group", lambda x: trim_mean(x, 0.25))
    axis.plot(curve.index, curve, label=[*curve.columns])
    baselines = scores[scores.policy != "run"].groupby("policy", sort=False)["return"].first()
    for i, (name, value) in enumerate(baselines.items()):
        axis.axhline(value, linestyle="--", color=f"C{9 - i}", label=name)
    axis.set(xlabel="environment steps", ylabel="return, IQM over runs")
    axis.legend()
    save(figure, path)


def main(arguments: list[str] | None = None) -> int:
    """Run all that is not finished, report; returns the exit status: 1 where runs are missing."""
    args = parse(arguments)
    folder = Path(args.log_folder, args.name).resolve()
    with args.parser.refusing():
        finished = args.report or run_study(args, folder)
        print(f"{write_report(folder)}\n\n{folder}/report.md, runs.csv")
    return 0 if finished else 1


if __name__ == "__main__":
    sys.exit(main())
