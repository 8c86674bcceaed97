"""What happens while a model trains: checkpoints, evaluations, observation statistics, signals."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import torch
from gymnasium.spaces.utils import flatdim
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from agents.metrics import point_estimates
from agents.models import save_model
from agents.normalizer import NormalizedObservation
from agents.replay import save_replay_buffer
from agents.rollout import make_env, run_episodes
from agents.runs import BEST, REPLAY, best_return, monitor_sizes, read_evaluations
from agents.tasks import find_task
from jansen_env.files import write_json

EPISODES = 4  # per command, of each evaluation
SELECTION_SEED = 30_000  # of the episodes that choose the best model, apart from all others


class Saver(BaseCallback):
    """Saves checkpoints, and evaluates now and then to keep the best model.

    Unlike Stable-Baselines3's callbacks it writes atomically, all that resuming needs, and
    evaluates on the task's grid of commands.

    Args:
        folder: the run's. save_every, eval_every: environment steps; 0 for never.
        env_id, env_kwargs: of the evaluation. done: steps trained before this run began.
    """

    def __init__(
        self,
        folder: Path,
        save_every: int,
        eval_every: int,
        env_id: str,
        env_kwargs: dict[str, Any],
        done: int = 0,
    ) -> None:
        super().__init__()
        self.folder, self.save_every, self.eval_every = folder, save_every, eval_every
        self.env_id, self.env_kwargs = env_id, env_kwargs
        self.task = find_task(env_id)
        self.commands = np.repeat(self.task.commands, EPISODES)
        # After a kill the last evaluations may be of steps that are now trained again. The best
        # model may be of one of them, so the return to beat is not the history's but the file's.
        self.history = [row for row in read_evaluations(folder) if row["steps"] <= done]
        self.best = best_return(folder)

    def _on_training_start(self) -> None:
        self._next_save = self.num_timesteps + self.save_every
        self._next_eval = self.num_timesteps + self.eval_every
        trained = self.history[-1].get("seconds", 0.0) if self.history else 0.0
        self._begun = time.perf_counter() - trained

    def _on_step(self) -> bool:
        if self.save_every and self.num_timesteps >= self._next_save:
            self._next_save += self.save_every
            self.save_checkpoint()
        if self.eval_every and self.num_timesteps >= self._next_eval:
            self._next_eval += self.eval_every
            self.evaluate()
        return True

    def save_checkpoint(self) -> None:
        """Save all that is needed to go on from here."""
        self.save(self.folder / "checkpoints" / f"model_{self.model.num_timesteps}_steps.zip")

    def save(self, path: Path) -> None:
        """Save the model, what belongs to its steps of the monitors, and the replay buffer."""
        save_model(self.model, path, {"monitor": monitor_sizes(self.folder)})
        replay_buffer = getattr(self.model, "replay_buffer", None)  # of an off-policy algorithm
        if replay_buffer is not None:
            save_replay_buffer(replay_buffer, self.folder / REPLAY)

    def evaluate(self) -> None:
        """Score the present policy; keep it if it is the best so far."""
        seeds = SELECTION_SEED + np.arange(len(self.commands))
        self.model.policy.set_training_mode(False)
        run = run_episodes(self.model.policy, self.env_id, self.env_kwargs, self.commands, seeds)
        env = make_env(self.env_id, self.env_kwargs)
        scored = point_estimates(self.task.metrics, run, env)
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
            # Its return in the same file: no kill can part the two.
            save_model(self.model, self.folder / BEST, row)
        self.history.append(row)
        write_json(self.folder / "evaluations.json", self.history)


class NoSaver(Saver):
    """Of a worker that does not lead: writes nothing."""

    def save(self, path: Path) -> None:
        """Leave saving to the worker that leads."""

    def evaluate(self) -> None:
        """Leave evaluating to it, too."""


class NormalizerUpdate(BaseCallback):
    """Updates the policy's normalizer with the last rollout before the next one begins.

    Within a rollout and the update on it the normalizer stands still: the update compares with
    probabilities that the rollout's policy gave.
    """

    def __init__(self) -> None:
        super().__init__()
        self._observations: NDArray[np.float32] | None = None

    def _on_rollout_start(self) -> None:
        self._begun = self.model.num_timesteps
        if self._observations is None:
            return
        for module in self.model.policy.modules():
            if isinstance(module, NormalizedObservation):
                self._update(module, torch.as_tensor(self._observations))
        self._observations = None

    def _update(self, normalizer: NormalizedObservation, observations: torch.Tensor) -> None:
        normalizer.update(observations)

    def _on_rollout_end(self) -> None:
        # Now, not when the next rollout begins: Stable-Baselines3 has emptied the buffer by then.
        model: Any = self.model
        if isinstance(model, OnPolicyAlgorithm):
            observations = model.rollout_buffer.observations
        else:  # of the replay buffer, what is new in it
            buffer = model.replay_buffer
            rows = min((model.num_timesteps - self._begun) // buffer.n_envs, buffer.size())
            observations = buffer.observations[np.arange(buffer.pos - rows, buffer.pos)]
        size = flatdim(model.observation_space)
        self._observations = np.array(observations, np.float32).reshape(-1, size)

    def _on_step(self) -> bool:
        return True


class StopOnSignal(BaseCallback):
    """Ends training at the next step after SIGINT (Ctrl-C) or SIGTERM; a second one kills at once.

    By the next step an update in progress has come to its end, so model and optimiser are complete.
    As a context manager it takes these signals, and gives them back.

    Attributes:
        signal: the number of the signal that came, 0 for none. notice: what is said then.
    """

    notice = b"\nstopping after this step; once more to end at once\n"

    def __init__(self) -> None:
        super().__init__()
        self.signal = 0
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> StopOnSignal:
        if threading.current_thread() is threading.main_thread():  # no other may take signals
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) != signal.SIG_IGN:  # as in the background of a shell
                    self._handlers[number] = signal.signal(number, self._take)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        for taken in self._handlers:
            signal.signal(taken, signal.SIG_DFL)
        # To standard error, but not by print: the signal may have come in the midst of one.
        os.write(2, self.notice)

    def _on_step(self) -> bool:
        return not self.signal
