"""Training with Stable-Baselines3: environments, and a run from start or checkpoint to its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, CallbackList, ProgressBarCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecEnv,
    VecEnvWrapper,
    VecMonitor,
)

from agents.callbacks import NormalizerUpdate, Saver
from agents.models import build_model, read_tensors, restore, save_model
from agents.rollout import make_env
from agents.vec_env import can_move_together, make_vec_env


def make_training_env(
    env_id: str,
    env_kwargs: dict[str, Any],
    count: int,
    reward_scale: float = 1.0,
    folder: Path | None = None,
    variants: Sequence[dict[str, Any]] = ({},),
) -> VecEnv:
    """``count`` environments side by side, logged to ``folder``/monitor, rewards scaled.

    The i-th one takes the arguments of ``variants`` number i, counted around, on top of the others.
    """
    if can_move_together(env_id, env_kwargs, variants):
        file = None
        if folder is not None:
            (folder / "monitor").mkdir(parents=True, exist_ok=True)
            number = len(list((folder / "monitor").iterdir()))  # a resumed run writes another file
            file = str(folder / "monitor" / str(number))
        together = make_vec_env(env_id, count, env_kwargs, variants)
        return ScaledReward(VecMonitor(together, file), reward_scale)
    if folder is not None:
        (folder / "monitor").mkdir(parents=True, exist_ok=True)

    def make(index: int) -> Callable[[], gym.Env[Any, Any]]:
        def build() -> gym.Env[Any, Any]:
            file = None if folder is None else str(folder / "monitor" / str(index))
            kwargs = {**env_kwargs, **variants[index % len(variants)]}
            env = Monitor(make_env(env_id, kwargs), file, override_existing=False)
            return gym.wrappers.TransformReward(env, lambda reward: reward_scale * float(reward))

        return build

    return DummyVecEnv([make(i) for i in range(count)])


class ScaledReward(VecEnvWrapper):
    """Rewards times a number; what monitors inside have seen is not scaled."""

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self.scale = scale

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, (self.scale * rewards).astype(np.float32), dones, infos


def train(
    algo: str,
    env_id: str,
    config: dict[str, Any],
    folder: Path,
    *,
    seed: int,
    eval_every: int,
    save_every: int,
    tensorboard: str | None,
    resume: Path | None,
    progress: bool = True,
) -> BaseAlgorithm:
    """Train until ``config["timesteps"]``, from the start or from the checkpoint ``resume``.

    Leaves final_model.zip and best_model.zip in ``folder`` and returns the final model.
    """
    env_kwargs = config.get("env_kwargs", {})
    venv = make_training_env(
        env_id,
        env_kwargs,
        config["n_envs"],
        config.get("reward_scale", 1.0),
        folder,
        config.get("training_variants", ({},)),
    )
    model = build_model(algo, config, venv, seed=seed, tensorboard_log=tensorboard)
    if resume is not None:
        tensors, done = read_tensors(resume)
        restore(model, tensors)
        model.num_timesteps = done
        venv.seed(seed + done)
        print(f"resuming from {resume} at {done} steps")
    remaining = config["timesteps"] - model.num_timesteps
    saver = Saver(folder, save_every, eval_every, env_id, env_kwargs, done=model.num_timesteps)
    callbacks: list[BaseCallback] = [NormalizerUpdate(), saver]
    if progress:
        callbacks.append(ProgressBarCallback())
    if remaining > 0:
        model.learn(
            remaining,
            callback=CallbackList(callbacks),
            reset_num_timesteps=False,
            tb_log_name=folder.name,
        )
        saver.evaluate()
    save_model(model, folder / "final_model.zip")
    venv.close()
    return model
