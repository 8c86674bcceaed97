"""Training with Stable-Baselines3: a model on its environments, from start or checkpoint."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor

from agents.training.callbacks import NormalizerUpdate, Saver, StopOnSignal
from agents.training.config import training_envs
from agents.training.models import build_model, restore
from agents.training.replay_buffers import load_replay_buffer
from agents.training.runs import FINAL, replay_path
from agents.training.training_state import GeneratorsRestored, restore_state
from jansen_env.sb3 import make_vec_env
from jansen_env.sb3.model_files import read_model, read_training_state
from jansen_env.sb3.run_config import find_config

EVALUATIONS = 16  # of a run, if nothing else is said


class TrainingReward(VecEnvWrapper):
    """Rewards less ``fall_cost`` where an episode ends before its time limit, times ``scale``."""

    def __init__(self, venv: Any, scale: float, fall_cost: float) -> None:
        super().__init__(venv)
        self.scale, self.fall_cost = scale, fall_cost

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = self.venv.step_wait()
        fallen = dones & ~np.array([info.get("TimeLimit.truncated", False) for info in infos])
        rewards = self.scale * (rewards - self.fall_cost * fallen)
        return observations, rewards.astype(np.float32), dones, infos


def prepare(config: dict[str, Any], resume: Path | None = None) -> BaseAlgorithm:
    """Build the model that a configuration describes, on its environments; writes nothing.

    Args:
        config: a training configuration with ``algo``, ``env`` and ``seed``. resume: a model's
            file, of which it takes all that training has come to.

    Raises:
        ValueError: something in the configuration or the files is wrong.
    """
    kwargs, variants = training_envs(config)
    venv = make_vec_env(config["env"], config["n_envs"], env_kwargs=kwargs, variants=variants)
    scale, fall_cost = config.get("reward_scale", 1.0), config.get("fall_cost", 0.0)
    venv = TrainingReward(VecMonitor(venv), scale, fall_cost)
    model = build_model(config["algo"], config, venv, seed=config["seed"])
    if resume is not None:
        tensors, model.num_timesteps = read_model(resume)
        restore(model, tensors)
        if isinstance(model, OffPolicyAlgorithm):
            _refill(model, find_config(resume).parent)
        restore_state(model, read_training_state(resume))
        if config.get("env_kwargs", {}).get("plant") == "rigid_body":
            print("plant='rigid_body': what pymunk's solver had cached is lost, so the run goes on "
                  "nearly, but not exactly, as it would have")  # fmt: skip
    return model


def _refill(model: OffPolicyAlgorithm, folder: Path) -> None:
    """Fill the replay buffer from a run's; without one, let it fill before training goes on."""
    path = replay_path(folder, model.num_timesteps)
    if path.is_file() and model.replay_buffer is not None:
        load_replay_buffer(model.replay_buffer, path)
        return
    model.learning_starts += model.num_timesteps
    print(f"no replay buffer in {folder}: it fills from empty, with random actions until step "
          f"{model.learning_starts}")  # fmt: skip


@contextmanager
def _failures_explained(model: BaseAlgorithm, go_on: str) -> Iterator[None]:
    """Turn a full disk and a policy that is NaN into a SystemExit that says so."""
    try:
        yield
    except OSError as error:
        raise SystemExit(
            f"training stopped at {model.num_timesteps} steps: {error}; {go_on}"
        ) from error
    except ValueError as error:
        if "to satisfy the constraint" not in str(error):  # torch's, of a policy that is NaN
            raise
        raise SystemExit(
            f"training diverged at {model.num_timesteps} steps: the policy's actions are no "
            "longer finite; a lower learning_rate may help"
        ) from error


def train(
    model: BaseAlgorithm,
    config: dict[str, Any],
    folder: Path,
    *,
    eval_every: int | None,
    save_every: int,
    tensorboard: str | None = None,
    resume: Path | None = None,
    progress: bool = True,
    more_callbacks: Sequence[BaseCallback] = (),
) -> None:
    """Train until ``config["timesteps"]``; leaves final_model.zip and best_model.zip in a folder.

    Args:
        model, config, resume: as of :func:`prepare`. folder: the run's.
        eval_every, save_every: steps between evaluations and between checkpoints, 0 for none;
            ``eval_every`` is None for :data:`EVALUATIONS` in all.
        tensorboard: folder of its log, None for none. progress: whether to show a bar.
        more_callbacks: of Stable-Baselines3, called after an evaluation at the same step.

    Raises:
        SystemExit: a signal came (status 128 + its number, 130 for SIGINT); a checkpoint is saved.
            Or the policy's actions are no longer finite, or a file cannot be written: what was
            saved before stays good.
    """
    venv: Any = model.get_env()
    stop, steps = StopOnSignal(), config["timesteps"]
    if eval_every is None:
        eval_every = max(1, steps // EVALUATIONS)
    saver = Saver(
        folder, save_every, eval_every, config["env"], config.get("env_kwargs", {}),
        done=model.num_timesteps, stop=stop,
    )  # fmt: skip
    saver.init_callback(model)
    model.tensorboard_log = tensorboard
    callbacks: list[BaseCallback] = [NormalizerUpdate(), saver, *more_callbacks]
    if resume is not None:
        callbacks.insert(0, GeneratorsRestored(read_training_state(resume)))
    if progress:
        callbacks.append(ProgressBarCallback())
    go_on = f"python train.py --resume {shlex.quote(str(folder))} goes on from the last checkpoint"
    with _failures_explained(model, go_on), closing(venv):
        if (remaining := steps - model.num_timesteps) > 0:
            with stop:
                model.learn(remaining, callback=callbacks, reset_num_timesteps=False,
                            tb_log_name=folder.name)  # fmt: skip
            if saver.ended:
                print(f"stopped, saved as {saver.last}; {go_on}")
                raise SystemExit(128 + stop.signal)
            saver.evaluate()
        saver.save(folder / FINAL)
    if stop.signal:  # in the last rollout
        raise SystemExit(128 + stop.signal)
