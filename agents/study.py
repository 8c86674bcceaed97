"""Train many runs on Ray Tune and compare them over seeds: ``python -m agents.study``."""

import os

import agents

# Set these variables before torch and Ray are loaded. Ray listens on all network interfaces, so it
# must accept commands only from clients that know its token.
agents.set_openmp()
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_AUTH_MODE", "token")

import argparse
import json
import secrets
import socket
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
import yaml

from agents.training.config import SHIPPED, add_run_flags, new_config
from agents.training.runs import FINAL, last_state, locked, read_evaluations, record_run
from agents.training.scores import score_run
from agents.training.train_model import prepare, train
from jansen_env.arrays import Array
from jansen_env.checks import instance
from jansen_env.cli import process
from jansen_env.cli.flags import (
    Parser,
    env_id,
    non_negative_int,
    path_flag,
    positive_int,
    whole,
)
from jansen_env.cli.plots import save
from jansen_env.files import write_text
from jansen_env.files.plain_yaml import read_yaml
from jansen_env.plants.threads import available_cores
from jansen_env.registration import training_folder
from jansen_env.sb3.run_config import ALGORITHMS, Arguments, load_config, make_config
from jansen_env.scoring.benchmarks import DEFAULT
from jansen_env.scoring.metrics import CONFIDENCE, Interval, interval_text

agents.need("distributed", "pandas", "ray", who="agents.study")
import pandas as pd
import ray
from matplotlib import ticker
from matplotlib.figure import Figure
from ray import tune
from scipy.stats import bootstrap, trim_mean
from tabulate import tabulate

MOST_SEEDS = 10_000  # largest number of seeds in a study
PLAN = "study.yml"  # file in the folder of a study: the flags that define its runs
SCORES = "scores.json"  # file in the folder of a run: written last, when the run is finished
PLANNED = (
    "seeds",
    "first_seed",
    "env",
    "algo",
    "timesteps",
    "n_envs",
    "env_kwargs",
    "config",
    "eval_freq",
    "save_freq",
    "eval_episodes",
)
KEYS, POINTS = ["group", "env", "seed", "policy"], ["steps", "cpu_seconds", "return"]
NOTES = """\
A run's score is the mean return of its best model over the commands. IQM is the interquartile mean,
that of the middle half of the runs (Agarwal et al., NeurIPS 2021); brackets are its 95 % bootstrap
interval, over training runs, drawn within each environment. With few runs that covers less: some
75 % with 3 runs, 90 % with 10. Intervals over episodes are in each run's scores.json. Core s: of
the run's processor time."""


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line and, if a YAML file is named, the flags in this file.

    The flags of a run have the same names as in train.py. Flags on the command line take precedence
    over flags in the file.

    Args:
        arguments: Arguments to parse. None selects those of the process.
    """
    parser = Parser(
        "python -m agents.study",
        "Train many runs and compare them over seeds.",
        "python -m agents.study --seeds 10",
        "python -m agents.study agents/studies/ten_seeds.yml --cores 2",
    )
    parser.allow_abbrev = False  # the keys of a file must not be abbreviated
    add_run_flags(parser)
    add, count = parser.add_argument, positive_int
    add("file", nargs="?", metavar="FILE", help="YAML of flags; those given here come first")
    add("--seeds", type=whole(most=MOST_SEEDS), default=10, help="runs of each kind; default: 10")
    add("--first-seed", type=non_negative_int, default=0, help="of these runs; default: 0")
    add(
        "--env",
        nargs="+",
        type=env_id,
        default=[DEFAULT],
        metavar="ID",
        help=f"environment ids; default: {DEFAULT}",
    )
    add("--algo", nargs="+", choices=sorted(ALGORITHMS), default=["ppo"], help="default: ppo")
    add(
        "--config",
        nargs="+",
        default=[SHIPPED],
        metavar="FILE",
        help="hyperparameters: a file, a folder of ALGO.yml, or 'shipped', the default; of several "
        "each is a group, 'shipped' where there is one",
    )
    add("--name", help="of the study; default: the file's, or else 'study'")
    add(
        "--log-folder",
        type=path_flag,
        default="logs/studies",
        metavar="DIR",
        help="the study goes to DIR/NAME",
    )
    add("--cores", type=count, default=1, help="of each run, for its environments; default: 1")
    add("--workers", type=count, help="runs at once on this machine; default: as the cores allow")
    add("--address", help="of the Ray cluster to join, or 'auto'; default: a new one here")
    add("--report", action="store_true", help="train nothing, report the runs that are finished")
    args = parser.parse_args(arguments)
    if args.file:
        with parser.refusing():
            entries = instance(args.file, read_yaml(args.file), dict)
        words = [args.file]  # first, so that a surplus value is not taken for the file
        for name, value in entries.items():
            values = value if isinstance(value, list) else [value]
            texts = (v if isinstance(v, str) else json.dumps(v) for v in values)
            words += [f"--{name.replace('_', '-')}", *texts]
        args = parser.parse_args(arguments, parser.parse_args(words))
    args.parser, args.name = parser, args.name or Path(args.file or "study").stem
    return args


def planned_runs(args: argparse.Namespace) -> list[Arguments]:
    """Return the name and the configuration of each run of a study.

    Args:
        args: Parsed flags.

    Raises:
        ValueError: If a configuration is missing or invalid.
    """
    several, groups = len(args.config) > 1, {}
    for env, algo, source in product(args.env, args.algo, args.config):
        if several and source == SHIPPED and not (training_folder(env) / f"{algo}.yml").is_file():
            continue
        name = f"{env}_{algo}" + f"_{Path(source).stem}" * several
        groups[name] = new_config(
            source, algo, env, args.env_kwargs, timesteps=args.timesteps, n_envs=args.n_envs
        )
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    return [
        {"name": f"{name}-seed_{seed}", "config": asdict(replace(config, seed=seed))}
        for seed in seeds
        for name, config in groups.items()
    ]


def run_trial(parameters: dict[str, Arguments], plan: Arguments, root: Path) -> None:
    """Train and score one run in the folder ``root/NAME``, starting from its last checkpoint.

    The checkpoints are not those of Ray, because Ray may remove a checkpoint to which its state
    still refers.

    Args:
        parameters: Parameters of the trial. The entry ``run`` is one of :func:`planned_runs`.
        plan: Flags that define the runs of the study.
        root: Folder of the study.

    Raises:
        RuntimeError: If training diverges or a file cannot be written.
    """
    # Always use one thread, whatever the number of cores: the result of a seed depends on it.
    torch.set_num_threads(1)
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
                    model,
                    config,
                    folder,
                    eval_every=plan["eval_freq"],
                    resume=resume,
                    save_every=plan["save_freq"],
                    tensorboard=str(folder / "tensorboard"),
                    progress=False,
                )
            except SystemExit as error:  # training diverged, or the disk is full
                raise RuntimeError(error.code) from error
        score_run(folder, config, plan["eval_episodes"])


def check_address(address: str) -> None:
    """Check that a Ray cluster answers at an address.

    Ray itself would keep trying for minutes. Addresses with a scheme, such as ``ray://``, and
    names, such as ``auto``, are not checked.

    Args:
        address: Address of a cluster.

    Raises:
        ValueError: If no cluster answers.
    """
    if ":" not in address or "/" in address:
        return
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=10.0).close()
    except (OSError, OverflowError, ValueError) as error:
        message = f"--address must be HOST:PORT of a Ray cluster, is {address!r}: {error}"
        raise ValueError(message) from error


def run_study(args: argparse.Namespace, folder: Path) -> bool:
    """Execute the unfinished runs of a study on Ray.

    A run is finished if its folder contains scores.

    Args:
        args: Parsed flags.
        folder: Folder of the study.

    Returns:
        Whether all runs have finished.

    Raises:
        ValueError: If the folder holds another study or runs with other configurations.
    """
    runs, plan = planned_runs(args), {name: getattr(args, name) for name in PLANNED}
    file, text = folder / PLAN, yaml.safe_dump(plan, sort_keys=False)
    if file.is_file() and file.read_text("utf-8") != text:
        raise ValueError(f"{folder} holds another study, must be another --name")
    for run in runs:
        known = folder / run["name"] / "config.yml"
        if known.is_file() and load_config(known) != make_config(run["config"]):
            raise ValueError(f"{known} belongs to another configuration; choose another --name")
    if not (missing := [run for run in runs if not (folder / run["name"] / SCORES).is_file()]):
        return True
    threads = {"OMP_NUM_THREADS": "1", "JANSEN_ENV_THREADS": str(args.cores)}
    threads |= {name: os.environ[name] for name in agents.WAITING if name in os.environ}
    if args.address is None:
        # The token is valid for this cluster only.
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
        cpus = args.workers * args.cores if args.workers else available_cores()
        ray.init(
            "local",
            num_cpus=cpus,
            include_dashboard=False,
            log_to_driver=False,
            runtime_env={"env_vars": threads},
        )
    else:
        check_address(args.address)
        modules = [str(Path(__file__).parent)]
        ray.init(args.address, runtime_env={"env_vars": threads, "py_modules": modules})
    write_text(file, text)
    results = tune.run(
        tune.with_parameters(run_trial, plan=plan, root=folder),
        name=folder.name,
        storage_path=str(folder.parent),
        config={"run": tune.grid_search(missing)},
        resources_per_trial={"cpu": args.cores},
        max_failures=3,  # per run
        trial_dirname_creator=lambda trial: trial.config["run"]["name"],
        raise_on_failed_trial=False,
        verbose=1,
    )
    return all(trial.status == "TERMINATED" for trial in results.trials)


def write_report(folder: Path) -> str:
    """Write report.md, runs.csv, returns.csv and figures (see ``docs/studies.md``).

    The report covers the finished runs. If there are none, it is made from an existing returns.csv.

    Args:
        folder: Folder of the study.

    Returns:
        The table of the report.

    Raises:
        ValueError: If there is neither a finished run nor a file returns.csv.
    """
    rows, curves, path = [], [], folder / "returns.csv"
    for file in sorted(folder.glob(f"*-seed_*/{SCORES}")):
        group, _, seed = file.parent.name.rpartition("-seed_")
        if not seed.isdecimal():  # the folder was not made by this program
            continue
        key = {"group": group, "env": group.split("_")[0], "seed": int(seed)}
        *baselines, (_, run) = json.loads(file.read_text("utf-8")).items()
        for policy, score in [("run", run), *baselines]:
            commands, overall = score["by_command"], score["overall"]
            values = {name: [overall[name][0], *commands[name]["value"]] for name in overall}
            grid = [None, *commands["return"]["command"]]
            rows.append(pd.DataFrame({**key, "policy": policy, "command": grid, **values}))
        evaluations = pd.DataFrame(read_evaluations(file.parent))
        curves.append(evaluations.reindex(columns=POINTS).assign(**key, policy="run"))
    if rows:
        scores = pd.concat(rows, ignore_index=True)
        scores.to_csv(folder / "runs.csv", index=False)
        returns = pd.concat([scores[[*KEYS, "command", "return"]], *curves]).round(3)
        # The baselines are the same for all runs.
        returns.loc[returns.policy != "run", ["group", "seed"]] = None
        returns["threshold"] = returns.env.map(threshold_of)
        columns = [*KEYS, "command", *POINTS, "threshold"]
        returns[columns].drop_duplicates().to_csv(path, index=False)
    if not path.is_file():
        raise ValueError(f"{folder} has no run that is finished")
    returns = pd.read_csv(path)
    if "threshold" not in returns:  # written by an earlier version
        returns["threshold"] = returns.env.map(threshold_of)
    table = groups_table(returns)
    parts = [f"# {folder.name}", table, NOTES.replace("\n", " ")]
    for env, of_env in returns.groupby("env"):
        plot(of_env, folder / f"{env}.png")
        parts.append(f"![Learning curves and performance profile on {env}]({env}.png)")
    write_text(folder / "report.md", "\n\n".join(parts) + "\n")
    return table


def threshold_of(env_id: str) -> float | None:
    """Return the reward threshold of an environment; None if it has none.

    Args:
        env_id: Id of the environment.
    """
    return gym.spec(env_id).reward_threshold


def groups_table(returns: pd.DataFrame) -> str:
    """Return a Markdown table with one row per group of runs and one row per baseline.

    If the study has several environments, further rows combine the groups that differ only in the
    environment. Their returns are divided by the reward thresholds, and only seeds that are
    finished in all environments count.

    Args:
        returns: Contents of returns.csv, with a column ``threshold``.
    """
    rows, overall = [], returns[returns.command.isna() & returns.steps.isna()]
    runs = overall[overall.policy == "run"]
    if runs.env.nunique() > 1:
        shares = runs["return"] / runs.threshold
        kinds = runs.group.str.partition("_")[2] + ", / threshold"
        alike = runs.assign(**{"group": kinds, "return": shares})
        in_all = alike.groupby(["group", "seed"]).env.transform("nunique") == runs.env.nunique()
        runs = pd.concat([runs, alike[in_all]])
    for group, scores in runs.groupby("group", sort=False):
        strata = [of_env for _, of_env in scores.groupby("env")["return"]]
        values = scores.set_index("seed")["return"]
        steps, seconds = returns[returns.group == group].groupby("seed")[POINTS[:2]].max().mean()
        rows.append(
            {
                "group": group,
                "runs": len(values),
                "steps": f"{steps:,.0f}".replace("nan", ""),
                "core s": f"{seconds:.0f}".replace("nan", ""),
                "IQM": interval_text(interquartile_mean(*strata)),
                "mean return": f"{values.mean():.3g}",
                "worst run": f"{values.min():.3g} (seed {values.idxmin():.0f})",
            }
        )
    for (env, policy), scores in overall[overall.policy != "run"].groupby(["env", "policy"]):
        rows.append({"group": f"{env}: {policy}", "mean return": f"{scores['return'].mean():.3g}"})
    return tabulate(rows, "keys", "github", disable_numparse=True)


def interquartile_mean(*strata: Array) -> Interval:
    """Return the mean of the middle half of all runs and its bootstrap percentile interval.

    The bootstrap resamples runs within each environment. The interval is NaN if an environment has
    a single run.

    Args:
        *strata: Returns of the runs on each environment, shape (n,) each.
    """

    def mean(*samples: Array, axis: int = -1) -> Array:
        return np.asarray(trim_mean(np.concatenate(samples, axis=axis), 0.25, axis=axis))

    low = high = np.nan
    if min(map(len, strata)) > 1:
        drawn = bootstrap(strata, mean, confidence_level=CONFIDENCE, method="percentile", rng=0)
        low, high = drawn.confidence_interval
    return float(mean(*strata)), float(low), float(high)


def plot(returns: pd.DataFrame, path: Path) -> None:
    """Draw the learning curves and the performance profile of an environment.

    The learning curves are drawn against steps and against core-seconds. The performance profile is
    the fraction of pairs of a run and a command whose return is above each value.

    Args:
        returns: Rows of returns.csv for this environment.
        path: Image file to write.
    """
    figure = Figure((15.0, 4.6), layout="constrained")
    by_steps, by_time, profile = figure.subplots(1, 3)
    is_run = returns.policy == "run"
    groups = returns[is_run].group.drop_duplicates()
    names = groups.str.partition("_")[2]
    kinds = names.str.partition("_")  # the algorithm, and the configuration if there are several
    (colours, _), (styles, _) = pd.factorize(kinds[0]), pd.factorize(kinds[2])
    for group, name, colour, style in zip(groups, names, colours, styles, strict=True):
        runs = returns[is_run & (returns.group == group)]
        look = {"color": f"C{colour}", "linestyle": ("-", ":", "-.")[style % 3]}
        curves = runs.pivot_table(POINTS[1:], "steps", "seed").dropna()  # steps that all runs share
        if len(curves):
            values = curves["return"]
            low, high = values.min(axis=1), values.max(axis=1)
            for axis, x in ((by_steps, low.index), (by_time, curves["cpu_seconds"].mean(axis=1))):
                axis.plot(x, trim_mean(values, 0.25, axis=1), label=name, **look)
                axis.fill_between(x, low, high, color=look["color"], alpha=0.15)
        profile.ecdf(runs["return"][runs.command.notna()], complementary=True, **look)
    baselines = returns[~is_run & returns.command.isna()].groupby("policy")["return"].first()
    for i, (name, value) in enumerate(baselines.items()):
        for axis in (by_steps, by_time):
            axis.axhline(value, linestyle="--", color=f"C{9 - i}", label=name)
    by_steps.set(xscale="log", xlabel="environment steps", ylabel="return: IQM, band: all runs")
    by_steps.xaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 3.0)))
    by_steps.xaxis.set_major_formatter(ticker.EngFormatter())
    by_steps.xaxis.set_minor_locator(ticker.NullLocator())
    by_time.set(xlabel="s of one core, evaluations included")
    profile.set(xlabel="return at a command", ylabel="share of runs and commands above")
    figure.legend(*by_steps.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    save(figure, path)


def main(arguments: list[str] | None = None) -> int:
    """Execute the unfinished runs and write the report; return the exit status.

    Args:
        arguments: Arguments of the command. None selects those of the process.

    Returns:
        0 if all runs have finished, else 1.
    """
    args = parse(arguments)
    folder = Path(args.log_folder, args.name).resolve()
    with args.parser.refusing():
        finished = args.report or run_study(args, folder)
        print(f"{write_report(folder)}\n\n{folder}/report.md, runs.csv, returns.csv")
    return 0 if finished else 1


if __name__ == "__main__":
    process.run("python -m agents.study", main)
