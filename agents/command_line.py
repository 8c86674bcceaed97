"""Command-line arguments shared by the scripts that train."""

from __future__ import annotations

import argparse

from jansen_env.commands.flags import mapping, non_negative_int, positive_int


def add_run_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of a training run, named as in RL Baselines3 Zoo; all are None by default."""
    add = parser.add_argument
    add("-n", "--timesteps", type=positive_int,
        help="environment steps of a run, in place of the configuration's")  # fmt: skip
    add("--n-envs", type=positive_int, help="parallel environments of a run, in place of its")
    add("--env-kwargs", type=mapping, metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    add("--config", metavar="FILE", help="hyperparameters; default: the one of ENV and ALGO")
    add("--eval-freq", type=non_negative_int,
        help="steps between evaluations, 0 for none; default: a 16th of the timesteps"
        )  # fmt: skip
    add("--save-freq", type=non_negative_int,
        help="steps between checkpoints, 0 for none; default: 100000")  # fmt: skip
    add("--eval-episodes", type=positive_int,
        help="episodes per command of the scores; default: 10")  # fmt: skip
