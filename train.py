"""Train a policy, compare it with the baselines and plot the scores: ``python train.py``."""

import agents  # isort: skip  # first, because it reports a missing extra

agents.set_openmp()  # must be called before torch is loaded

import argparse
import shlex
import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.pack import start_from
from agents.training.config import add_run_flags, new_config
from agents.training.runs import FINAL, last_state, locked, new_run_folder, record_run
from agents.training.scores import outcome, score_run
from agents.training.train_model import prepare, train
from jansen_env.checks import one_line
from jansen_env.cli.flags import Parser, imported_env_id, non_negative_int, path_flag
from jansen_env.cli.named_policies import shipped_file
from jansen_env.cli.process import run
from jansen_env.files import check_writable
from jansen_env.sb3.run_config import ALGORITHMS, RunConfig, load_config
from jansen_env.scoring.benchmarks import DEFAULT, find_benchmark


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line; the flags have the same names as in RL Baselines3 Zoo.

    Args:
        arguments: Arguments to parse. None selects those of the process.
    """
    parser = Parser(
        "train.py",
        "Train a policy, compare it with the baselines, and plot the scores.",
        "python train.py --env JansenWalkerRough-v0 --seed 1",
        "python train.py --resume logs/ppo/JansenWalkerBuilt-v0_1",
    )
    add_run_flags(parser)
    add = parser.add_argument
    add(
        "--algo",
        choices=sorted(ALGORITHMS),
        help="training algorithm; default: the algorithm in the file of --config, or ppo",
    )
    add(
        "--config",
        metavar="FILE",
        help="configuration file with the hyperparameters, or a folder that contains such a file "
        "named ALGO.yml; default: the file of the package for the environment and the algorithm",
    )
    add(
        "--env",
        type=imported_env_id,
        metavar="ID",
        help="id of the environment, or MODULE:ID to import the module that registers it; "
        f"default: the environment in the file of --config, or {DEFAULT}",
    )
    add(
        "--seed",
        type=non_negative_int,
        help="seed of the networks and the environments; default: the seed in the file of "
        "--config, or 0",
    )
    add(
        "--log-folder",
        type=path_flag,
        default="logs",
        metavar="DIR",
        help="folder of all runs; a run is written to DIR/ALGO/ENV_N; default: logs",
    )
    add(
        "--tensorboard-log",
        metavar="DIR",
        help="folder of the TensorBoard log; '' writes no log; default: tensorboard in the folder "
        "of the run",
    )
    add(
        "--start",
        metavar="MODEL",
        help="policy whose weights the training starts from: the folder of a run, the zip file of "
        "a model, the JSON file of a policy, 'pretrained' or 'pretrained:NAME'",
    )
    add(
        "--device",
        type=torch_device,
        default="cpu",
        metavar="NAME",
        help="PyTorch device of the networks, such as cuda; a GPU is faster only for large "
        "networks, and only on the CPU does the same seed give the same run; default: cpu",
    )
    add("--resume", metavar="RUN", help="folder of a run to continue from its last checkpoint")
    add("--no-progress", action="store_true", help="do not show a progress bar")
    return parser.parse_args(arguments)


def torch_device(text: str) -> str:
    """Return the name of a PyTorch device after checking that it is available.

    Args:
        text: Name of the device.

    Raises:
        ArgumentTypeError: If PyTorch cannot use the device.
    """
    try:
        torch.zeros((), device=text).item()
    except (AssertionError, RuntimeError) as error:
        message = f"must be cpu or another device of PyTorch, got {text!r}: {one_line(error)}"
        raise argparse.ArgumentTypeError(message) from None
    return text


def main(arguments: list[str] | None = None) -> Path:
    """Train a policy, score it and plot the scores.

    Args:
        arguments: Arguments of the command. None selects those of the process.

    Returns:
        Folder of the run.

    Raises:
        SystemExit: If an argument or a file is invalid.
    """
    args = parse(arguments)
    words = sys.argv[1:] if arguments is None else arguments
    torch.set_num_threads(1)
    with ExitStack() as stack:
        try:
            config = _configure(args)
            resume = None
            if args.resume:
                folder = Path(args.resume)
                stack.enter_context(locked(folder))
                resume = last_state(folder)
            model = prepare(config, resume, args.device)  # nothing is written before this succeeds
            if args.start:
                start_from(model, shipped_file(args.start, config.env) or args.start)
            if args.tensorboard_log:
                check_writable("--tensorboard-log", Path(args.tensorboard_log))
            if not args.resume:
                folder = new_run_folder(args.log_folder, config.algo, config.env)
                stack.enter_context(locked(folder))
            command = shlex.join(["python", "train.py", *words])
            _run(args, config, model, folder, resume, command)
        except (OSError, ValueError) as error:
            raise SystemExit(f"train.py: error: {error}") from error
    return folder


def _run(
    args: argparse.Namespace,
    config: RunConfig,
    model: BaseAlgorithm,
    folder: Path,
    resume: Path | None,
    command: str,
) -> None:
    """Train the model unless the run is finished, then score its best model and print a summary."""
    start = time.perf_counter()
    target = config.timesteps
    if args.resume and resume is None:
        print(f"there is no checkpoint in {folder} yet: the run starts from its beginning")
    if resume is not None and resume.name == FINAL and model.num_timesteps >= target:
        print(f"{folder} is finished after {model.num_timesteps} steps; the run has {target}")
    else:
        record_run(folder, config, command)
        if resume is not None:
            print(f"resuming from {resume} at {model.num_timesteps} steps")
        print(
            f"training: {config.algo.upper()} on {config.env}, {target} steps -> {folder}",
            flush=True,
        )
        tensorboard = args.tensorboard_log
        train(
            model,
            config,
            folder,
            eval_every=args.eval_freq,
            save_every=args.save_freq,
            tensorboard=str(folder / "tensorboard") if tensorboard is None else tensorboard or None,
            resume=resume,
            progress=not args.no_progress and sys.stderr.isatty(),
        )
    baselines = ", ".join(find_benchmark(config.env).baselines)
    seconds = time.perf_counter() - start
    print(f"scoring: the best model against {baselines}, after {seconds:.0f} s", flush=True)
    print(f"\n{outcome(folder, config, score_run(folder, config, args.eval_episodes))}")


def _configure(args: argparse.Namespace) -> RunConfig:
    """Return the configuration of the run, or raise ValueError if a file is missing or invalid."""
    if args.resume:
        fixed = ("algo", "n_envs", "seed", "env_kwargs", "config", "start")
        flags = [f"--{name.replace('_', '-')}" for name in fixed if getattr(args, name) is not None]
        if flags:
            raise ValueError(
                f"--resume cannot be combined with {', '.join(flags)}, because the config.yml of "
                "the run determines their values"
            )
        config = load_config(Path(args.resume) / "config.yml")
        if args.env not in (None, config.env):
            raise ValueError(
                f"--env must be {config.env}, the environment of the run, got {args.env}"
            )
        return replace(config, timesteps=args.timesteps or config.timesteps)
    return new_config(
        args.config,
        args.algo,
        args.env,
        args.env_kwargs,
        timesteps=args.timesteps,
        n_envs=args.n_envs,
        seed=args.seed,
    )


if __name__ == "__main__":
    run("train.py", main)
