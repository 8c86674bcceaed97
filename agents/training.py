"""Training with Stable-Baselines3: a model on its environments, from start or checkpoint."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.monitor import ResultsWriter
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor, unwrap_vec_wrapper

from agents.callbacks import NormalizerUpdate, NoSaver, Saver, StopOnSignal
from agents.config import find_config
from agents.model_files import read_model, read_notes
from agents.models import build_model, restore
from agents.replay import load_replay_buffer
from agents.runs import FINAL, REPLAY, next_monitor, rewind_monitors
from agents.vec_env import make_vec_env

if TYPE_CHECKING:
    from agents.data_parallel import Worker


class ScaledReward(VecEnvWrapper):
    """Rewards times a number; what monitors inside have seen is not scaled."""

    def __init__(self, venv: Any, scale: float) -> None:
        super().__init__(venv)
        self.scale = scale

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, (self.scale * rewards).astype(np.float32), dones, infos


def prepare(
    config: dict[str, Any], resume: Path | None = None, worker: Worker | None = None
) -> BaseAlgorithm:
    """The model a configuration describes, on its environments. Writes nothing.

    Args:
        config: a training configuration with ``algo``, ``env`` and ``seed``. Environment i takes
            number i of its ``training_variants``, counted around, on top of the ``env_kwargs``.
        resume: a model's file, of which it takes parameters, optimiser and number of steps;
            :data:`agents.runs.REPLAY` in the run's folder fills its replay buffer.
        worker: of which the model is, where several train together.

    Raises:
        ValueError: something in the configuration or the files is wrong.
    """
    seed = config["seed"]
    if worker is not None:
        config = worker.share(config)
    venv = make_vec_env(
        config["env"],
        config["n_envs"],
        config.get("env_kwargs", {}),
        config.get("training_variants", ({},)),
        threads=None if worker is None else worker.threads(config["n_envs"]),
    )
    venv = ScaledReward(VecMonitor(venv), config.get("reward_scale", 1.0))
    model = build_model(config["algo"], config, venv, seed=seed)
    if resume is not None:
        tensors, model.num_timesteps = read_model(resume)
        restore(model, tensors)
        seed += model.num_timesteps
        venv.seed(seed)
        if isinstance(model, OffPolicyAlgorithm):
            _refill(model, find_config(resume).parent / REPLAY)
    if isinstance(model, PPO) and worker is not None:
        worker.connect(model, seed)
    return model


def _refill(model: OffPolicyAlgorithm, path: Path) -> None:
    """Fill the replay buffer from a file; without one, let it fill before training goes on."""
    if path.is_file():
        assert model.replay_buffer is not None
        load_replay_buffer(model.replay_buffer, path)
        return
    model.learning_starts += model.num_timesteps
    print(f"no replay buffer at {path}: it fills from empty, with random actions until step "
          f"{model.learning_starts}")  # fmt: skip


def train(
    model: BaseAlgorithm,
    config: dict[str, Any],
    folder: Path,
    *,
    eval_every: int,
    save_every: int,
    tensorboard: str | None = None,
    resume: Path | None = None,
    progress: bool = True,
    worker: Worker | None = None,
) -> None:
    """Train until ``config["timesteps"]``; leaves final_model.zip and best_model.zip in a folder.

    Args:
        model, config, resume, worker: as of :func:`prepare`. folder: the run's.
        eval_every, save_every: steps between evaluations and between checkpoints, 0 for none.
        tensorboard: folder of its log, None for none. progress: whether to show a bar.

    Raises:
        SystemExit: a signal came (status 130 for SIGINT, 143 for SIGTERM); a checkpoint is saved.
            Or the policy's actions are no longer finite.
    """
    venv: Any = model.get_env()
    leads = worker is None or worker.leads
    saver = (Saver if leads else NoSaver)(
        folder, save_every, eval_every, config["env"], config.get("env_kwargs", {}),
        done=model.num_timesteps,
    )  # fmt: skip
    saver.init_callback(model)
    if leads and resume is not None and (sizes := read_notes(resume).get("monitor")) is not None:
        rewind_monitors(folder, sizes)
    monitor: Any = unwrap_vec_wrapper(venv, VecMonitor)  # from now on it writes each episode
    header = {"t_start": monitor.t_start, "env_id": config["env"]}
    file = next_monitor(folder) if worker is None else worker.next_monitor(folder)
    monitor.results_writer = ResultsWriter(str(file), header)
    model.tensorboard_log = tensorboard if leads else None
    stop = StopOnSignal() if worker is None else worker.stop()
    updates: list[BaseCallback] = [NormalizerUpdate()] if worker is None else worker.updates()
    callbacks = [*updates, saver, stop]
    if progress and leads:
        callbacks.append(ProgressBarCallback() if worker is None else worker.progress())
    remaining = config["timesteps"] - model.num_timesteps
    if remaining > 0:
        try:
            with stop:
                model.learn(
                    remaining,
                    callback=callbacks,
                    reset_num_timesteps=False,
                    tb_log_name=folder.name,
                )
        except ValueError as error:
            if "to satisfy the constraint" not in str(error):  # torch's, of a policy that is NaN
                raise
            raise SystemExit(
                not leads
                or f"training diverged at {model.num_timesteps} steps: the policy's actions are no "
                "longer finite; a lower learning_rate may help"
            ) from error
        if stop.signal:
            saver.save_checkpoint()
            venv.close()
            if leads:
                print(f"stopped at {model.num_timesteps} steps; python train.py --resume "
                      f"{shlex.quote(str(folder))} goes on from there")  # fmt: skip
            raise SystemExit(128 + stop.signal if leads else 0)
        saver.evaluate()
    saver.save(folder / FINAL)
    venv.close()
