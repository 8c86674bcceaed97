"""What happens while a model trains: checkpoints, evaluations, the observations' scale."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from agents.models import save_model
from agents.normalizer import NormalizedObservation
from agents.rollout import make_env, run_episodes
from agents.scores import values
from agents.tasks import find_task
from jansen_env.files import write_json

SELECTION_SEED = 30_000  # of the episodes that choose the best model, apart from all others


class Saver(BaseCallback):
    """Saves checkpoints, and evaluates now and then to keep the best model.

    Args:
        folder: the run's. save_every, eval_every: environment steps; 0 for never.
        env_id, env_kwargs, episodes: of the evaluation, and its episodes per command.
        done: steps trained before this run began.
    """

    def __init__(
        self,
        folder: Path,
        save_every: int,
        eval_every: int,
        env_id: str,
        env_kwargs: dict[str, Any],
        episodes: int = 4,
        done: int = 0,
    ) -> None:
        super().__init__()
        self.folder, self.save_every, self.eval_every = folder, save_every, eval_every
        self.env_id, self.env_kwargs = env_id, env_kwargs
        self.task = find_task(env_id)
        self.commands = np.repeat(self.task.commands, episodes)
        self.history: list[dict[str, Any]] = []
        history = folder / "evaluations.json"
        if history.is_file():
            self.history = json.loads(history.read_text(encoding="utf-8"))
            # After a kill the checkpoint may be older than the last evaluation.
            self.history = [row for row in self.history if row["steps"] <= done]
        self.best = max((row["return"] for row in self.history), default=-np.inf)

    def _on_training_start(self) -> None:
        self._next_save = self.num_timesteps + self.save_every
        self._next_eval = self.num_timesteps + self.eval_every
        trained = self.history[-1].get("seconds", 0.0) if self.history else 0.0
        self._begun = time.perf_counter() - trained

    def _on_step(self) -> bool:
        if self.save_every and self.num_timesteps >= self._next_save:
            self._next_save += self.save_every
            name = f"model_{self.num_timesteps}_steps.zip"
            save_model(self.model, self.folder / "checkpoints" / name)
        if self.eval_every and self.num_timesteps >= self._next_eval:
            self._next_eval += self.eval_every
            self.evaluate()
        return True

    def evaluate(self) -> None:
        """Score the present policy; keep it if it is the best so far."""
        seeds = SELECTION_SEED + np.arange(len(self.commands))
        self.model.policy.set_training_mode(False)
        run = run_episodes(self.model.policy, self.env_id, self.env_kwargs, self.commands, seeds)
        env = make_env(self.env_id, self.env_kwargs)
        scored = values(self.task, run, env)
        env.close()
        for name, value in scored.items():
            self.logger.record(f"eval/{name}", value)
        row: dict[str, Any] = {
            "steps": float(self.num_timesteps),
            "seconds": round(time.perf_counter() - self._begun, 1),  # of training, this included
            **scored,
        }
        if row["return"] > self.best:
            self.best = row["return"]
            save_model(self.model, self.folder / "best_model.zip")
        self.history.append(row)
        write_json(self.folder / "evaluations.json", self.history)


class NormalizerUpdate(BaseCallback):
    """Lets the policy's normalizer see the last rollout before the next one begins.

    Within a rollout and the update on it the normalizer stands still.
    """

    def _on_rollout_start(self) -> None:
        extractors = [
            m for m in self.model.policy.modules() if isinstance(m, NormalizedObservation)
        ]
        if not extractors:
            return
        if isinstance(self.model, OnPolicyAlgorithm):
            buffer = self.model.rollout_buffer
            seen = buffer.observations.reshape(-1, extractors[0].mean.shape[0])
            if not buffer.full:
                seen = np.asarray(self.model._last_obs)  # before the first rollout
        else:
            seen = np.asarray(self.model._last_obs)
        for extractor in extractors:
            extractor.update(torch.as_tensor(seen, dtype=torch.float32))

    def _on_step(self) -> bool:
        return True
