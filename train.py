"""Train a policy, score it against the baselines, draw the figures: ``python train.py``."""

from __future__ import annotations

import os

import agents  # noqa: F401  # first: says what to install where the extra is missing

# Before torch is loaded: these networks are small, more threads cost more than they bring, and the
# number of threads changes the rounding of a sum, and so the run that a seed gives.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import shlex
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.command_line import mapping, non_negative_int, positive_int
from agents.config import ALGORITHMS, TO_RESUME, load_config, new_config
from agents.process import outlive_readers
from agents.runs import (
    FINAL,
    best_score,
    last_state,
    locked,
    new_run_folder,
    read_evaluations,
    record_run,
)
from agents.scoring import outcome, score_run
from agents.tasks import DEFAULT, TASKS, find_task
from agents.training import prepare, train

if TYPE_CHECKING:
    from agents.data_parallel import Worker


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Flags, named as in RL Baselines3 Zoo."""
    parser = argparse.ArgumentParser(description=__doc__)
    add, count, steps = parser.add_argument, positive_int, non_negative_int
    add("--algo", choices=sorted(ALGORITHMS), help="algorithm; default: --config's, or else ppo")
    add("--env", choices=sorted(TASKS),
        help=f"environment id; default: --config's, or else {DEFAULT}")  # fmt: skip
    add("-n", "--timesteps", type=count, help="environment steps, in place of the configuration's")
    add("--n-envs", type=count, help="environments side by side, in place of the configuration's")
    add("--seed", type=steps, help="of networks and environments; default: --config's, or else 0")
    add("--eval-freq", type=steps,
        help="steps between evaluations, 0 for none; default: a 16th of the timesteps")  # fmt: skip
    add("--save-freq", type=steps, default=100_000, help="steps between checkpoints, 0 for none")
    add("--eval-episodes", type=count, default=10, help="episodes per command of the final table")
    add("--log-folder", default="logs", metavar="DIR", help="runs go to DIR/ALGO/ENV_N")
    add("--tensorboard-log", metavar="DIR", help="default: the run's folder; '' for none")
    add("--env-kwargs", type=mapping, metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    add("--config", metavar="FILE", help="hyperparameters; default: agents/configs/ENV/ALGO.yml")
    add("--resume", metavar="RUN", help="run folder to go on with from the last model saved")
    add("--workers", type=count, default=1, metavar="N",
        help="processes that train together by PPO, each with its share of robots")  # fmt: skip
    add("--address", help="Ray cluster to place the workers on, or 'auto'; default: this machine")
    add("--cores", type=count, default=1, metavar="C", help="of each worker on a Ray cluster")
    add("--no-progress", action="store_true", help="no progress bar")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> Path:
    """Train, score, draw; returns the run's folder."""
    args = parse(arguments)
    given = sys.argv[1:] if arguments is None else arguments
    several = args.workers > 1 or args.address or int(os.environ.get("WORLD_SIZE", "1")) > 1
    try:
        config = _configure(args)
        if several:  # only then is torch.distributed used
            from agents import launch
            from agents.data_parallel import check_config

            workers = launch.count_workers(args.workers)
            check_config(config, workers)
            if args.address:
                from agents.ray_workers import check_ray, run_on_ray

                check_ray()
                args.log_folder = str(Path(args.log_folder).resolve())  # actors run elsewhere
    except ValueError as error:
        raise SystemExit(f"train.py: error: {error}") from error
    work = partial(run, args, config, shlex.join(["python", "train.py", *given]))
    if not several:
        return work()
    if launch.torchrun_size():
        return launch.join_torchrun(work)
    if args.address:
        return run_on_ray(args.address, workers, args.cores, work)
    return launch.run_here(workers, work)


def run(
    args: argparse.Namespace, config: dict[str, Any], command: str, worker: Worker | None = None
) -> Path:
    """:func:`main` after the configuration is known; what each of several workers does."""
    torch.set_num_threads(1)
    leads, resume = worker is None or worker.leads, None
    told = (lambda name, make: make()) if worker is None else worker.told
    with ExitStack() as stack:

        def enter(folder: Path) -> Path:
            stack.enter_context(locked(folder))
            return folder

        try:
            if args.resume:
                folder = Path(told("folder", lambda: str(enter(Path(args.resume)))))
                found = told("model", lambda: str(last_state(folder) or ""))
                resume = Path(found) if found else None
            model = prepare(config, resume, worker)  # nothing is written before this is good
            if not args.resume:
                folder = Path(told("folder", lambda: str(enter(_new_folder(args, config)))))
        except ValueError as error:
            of = "" if worker is None or leads else f" worker {worker.rank}:"
            raise SystemExit(f"train.py: error:{of} {error}") from error
        try:
            _run(args, config, model, folder, resume, command, worker)
        except SystemExit as error:
            if leads or isinstance(error.code, str):
                raise
            # All have stopped on a signal: the leader's status is the run's, once it has saved.
        except OSError as error:
            raise SystemExit(f"train.py: error: {error}") from error
    return folder


def _new_folder(args: argparse.Namespace, config: dict[str, Any]) -> Path:
    """A new run's folder, created."""
    try:
        return new_run_folder(args.log_folder, config["algo"], config["env"])
    except OSError as error:
        raise ValueError(f"--log-folder cannot be written to: {error}") from error


def _run(
    args: argparse.Namespace,
    config: dict[str, Any],
    model: BaseAlgorithm,
    folder: Path,
    resume: Path | None,
    command: str,
    worker: Worker | None,
) -> None:
    """Train and score in a run's folder."""
    start = time.perf_counter()
    leads = worker is None or worker.leads
    say: Callable[..., None] = print if leads else lambda *text, **more: None
    algo, env_id, target = config["algo"], config["env"], config["timesteps"]
    if args.resume and resume is None:
        say(f"no checkpoint in {folder} yet: the run starts from its beginning")
    if resume is not None and resume.name == FINAL and model.num_timesteps >= target:
        say(f"{folder} is finished: {model.num_timesteps} steps trained, {target} asked for")
    else:
        if leads:
            record_run(folder, config, command)
        if resume is not None:
            say(f"resuming from {resume} at {model.num_timesteps} steps")
        say(f"{algo.upper()} on {env_id}, {target} steps -> {folder}", flush=True)
        tensorboard = args.tensorboard_log
        train(
            model, config, folder, eval_every=args.eval_freq, save_every=args.save_freq,
            tensorboard=str(folder / "tensorboard") if tensorboard is None else tensorboard or None,
            resume=resume, progress=not args.no_progress and sys.stderr.isatty(), worker=worker,
        )  # fmt: skip
    if not leads:
        return
    trained = time.perf_counter()
    baselines = ", ".join(find_task(env_id).baselines)
    say(f"trained in {trained - start:.0f} s; scoring against {baselines} ...", flush=True)
    say(outcome(folder, env_id, score_run(folder, config, args.eval_episodes)))
    say(f"scored in {time.perf_counter() - trained:.0f} s")


def _configure(args: argparse.Namespace) -> dict[str, Any]:
    """The run's configuration, with algorithm, environment and seed.

    Raises:
        ValueError: a file is missing, or something in it is wrong.
    """
    if args.resume:
        fixed = ("algo", "env", "n_envs", "seed", "env_kwargs", "config")
        given = [f"--{name.replace('_', '-')}" for name in fixed if getattr(args, name) is not None]
        if given:
            raise SystemExit(f"--resume takes these from the run's config.yml: {', '.join(given)}")
        config = load_config(Path(args.resume) / "config.yml", required=TO_RESUME)
        config["timesteps"] = args.timesteps or config["timesteps"]
        best_score(Path(args.resume))  # what is damaged shows before anything is written
        read_evaluations(Path(args.resume))
        return config
    return new_config(
        args.config, args.algo, args.env, args.env_kwargs,
        timesteps=args.timesteps, n_envs=args.n_envs, seed=args.seed,
    )  # fmt: skip


if __name__ == "__main__":
    outlive_readers()
    try:
        main()
    except KeyboardInterrupt:  # before training or after it
        raise SystemExit(130) from None
