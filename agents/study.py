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

import torch
import yaml

from agents.training.config import SHIPPED, add_run_flags, new_config
from agents.training.runs import FINAL, last_state, locked, record_run
from agents.training.scores import score_run
from agents.training.train_model import prepare, train
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
from jansen_env.files import write_text
from jansen_env.files.plain_yaml import read_yaml
from jansen_env.plants.threads import available_cores
from jansen_env.registration import training_folder
from jansen_env.sb3.run_config import ALGORITHMS, Arguments, load_config, make_config
from jansen_env.scoring.benchmarks import DEFAULT

agents.need("distributed", "pandas", "ray", who="agents.study")
import ray
from ray import tune

from agents.study_report import SCORES, write_report

MOST_SEEDS = 10_000  # largest number of seeds in a study
PLAN = "study.yml"  # file in the folder of a study: the flags that define its runs
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


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line and, if a YAML file is named, the flags in this file.

    The flags of a run have the same names as in train.py. Flags on the command line take precedence
    over flags in the file.

    Args:
        arguments: Arguments to parse. None selects those of the process.
    """
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.file:
        with parser.refusing():
            flags = _flags_in(args.file)
        args = parser.parse_args(arguments, parser.parse_args(flags))
    args.parser = parser
    args.name = args.name or Path(args.file or "study").stem
    return args


def _parser() -> Parser:
    """Return the parser of the command."""
    parser = Parser(
        "python -m agents.study",
        "Train many runs and compare them over seeds.",
        "python -m agents.study --seeds 10",
        "python -m agents.study agents/studies/ten_seeds.yml --cores 2",
    )
    parser.allow_abbrev = False  # the keys of a file must not be abbreviated
    add_run_flags(parser)
    add = parser.add_argument
    add(
        "file",
        nargs="?",
        metavar="FILE",
        help="YAML file with flags; flags on the command line take precedence over this file",
    )
    add(
        "--seeds",
        type=whole(most=MOST_SEEDS),
        default=10,
        help="number of runs, each with its own seed, per group; default: 10",
    )
    add(
        "--first-seed",
        type=non_negative_int,
        default=0,
        help="lowest seed of the runs of a group; default: 0",
    )
    add(
        "--env",
        nargs="+",
        type=env_id,
        default=[DEFAULT],
        metavar="ID",
        help=f"ids of the environments; default: {DEFAULT}",
    )
    add(
        "--algo",
        nargs="+",
        choices=sorted(ALGORITHMS),
        default=["ppo"],
        help="training algorithms; default: ppo",
    )
    add(
        "--config",
        nargs="+",
        default=[SHIPPED],
        metavar="FILE",
        help="configuration files with the hyperparameters, folders that contain such a file "
        "named ALGO.yml, or 'shipped' for the file of the package; each configuration is a group "
        "of runs; with several configurations, 'shipped' is left out where the package has no "
        "file; default: shipped",
    )
    add("--name", help="name of the study; default: the name of FILE, or 'study' without a file")
    add(
        "--log-folder",
        type=path_flag,
        default="logs/studies",
        metavar="DIR",
        help="folder of all studies; a study is written to DIR/NAME; default: logs/studies",
    )
    add(
        "--cores",
        type=positive_int,
        default=1,
        help="number of CPU cores per run, used by its environments; default: 1",
    )
    add(
        "--workers",
        type=positive_int,
        help="number of simultaneous runs on this machine; default: as many as the cores allow",
    )
    add(
        "--address",
        help="address of the Ray cluster to join, or 'auto'; default: start a new cluster on this "
        "machine",
    )
    add("--report", action="store_true", help="only write the report on the finished runs")
    return parser


def _flags_in(file: str) -> list[str]:
    """Return the flags in a YAML file as words of a command line, beginning with the file.

    The name of the file comes first, so that a surplus value of a flag is not mistaken for it.

    Raises:
        ValueError: If the file is not a mapping.
    """
    words = [file]
    for name, value in instance(file, read_yaml(file), dict).items():
        values = value if isinstance(value, list) else [value]
        texts = (v if isinstance(v, str) else json.dumps(v) for v in values)
        words += [f"--{name.replace('_', '-')}", *texts]
    return words


def planned_runs(args: argparse.Namespace) -> list[Arguments]:
    """Return the name and the configuration of each run of a study.

    Args:
        args: Parsed flags.

    Raises:
        ValueError: If a configuration is missing or invalid.
    """
    several = len(args.config) > 1
    groups = {}
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
    # Always use one thread, because the result of a seed depends on the number of threads.
    torch.set_num_threads(1)
    run = parameters["run"]
    config = make_config(run["config"])
    folder = root / run["name"]
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
        message = f"--address must be HOST:PORT of a Ray cluster, got {address!r}: {error}"
        raise ValueError(message) from error


def check_folder(folder: Path, runs: list[Arguments], plan: str) -> None:
    """Check that a folder holds no other study and no runs with other configurations.

    Args:
        folder: Folder of the study.
        runs: Name and configuration of each run.
        plan: Text of the study's plan.

    Raises:
        ValueError: If the folder holds another study or such runs.
    """
    file = folder / PLAN
    if file.is_file() and file.read_text("utf-8") != plan:
        raise ValueError(f"{folder} contains another study; choose another --name")
    for run in runs:
        known = folder / run["name"] / "config.yml"
        if known.is_file() and load_config(known) != make_config(run["config"]):
            raise ValueError(f"{known} belongs to another configuration; choose another --name")


def start_ray(args: argparse.Namespace) -> None:
    """Start Ray on this machine, or join the cluster at ``args.address``.

    Args:
        args: Parsed flags.

    Raises:
        ValueError: If no cluster answers at the address.
    """
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
    runs = planned_runs(args)
    plan = {name: getattr(args, name) for name in PLANNED}
    text = yaml.safe_dump(plan, sort_keys=False)
    check_folder(folder, runs, text)
    missing = [run for run in runs if not (folder / run["name"] / SCORES).is_file()]
    if not missing:
        return True
    start_ray(args)
    write_text(folder / PLAN, text)
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
