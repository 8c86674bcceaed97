"""Callbacks of a training run: checkpoints, evaluations, observation statistics, signals."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import torch
from gymnasium.spaces.utils import flatdim
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from agents.training.models import save_model
from agents.training.process import HANGUP, SIGNALS
from agents.training.replay_buffers import save_replay_buffer
from agents.training.runs import BEST, best_score, read_evaluations, replay_path
from agents.training.training_state import read_state
from jansen_env.files import write_json
from jansen_env.sb3.normalizer import NormalizedObservation
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes

EPISODES = 16  # per command, of each evaluation, times the benchmark's variety
SELECTION_SEED = 30_000  # of the episodes that choose the best model, apart from all others


class Saver(BaseCallback):
    """Save checkpoints, and evaluate now and then to keep the best model.

    A checkpoint is taken where a rollout begins, behind all callbacks that change the model there.

    Args:
        folder: the run's. save_every, eval_every: environment steps; 0 for never.
        env_id, env_kwargs: of the evaluation. done: steps trained before this run began.
        stop: when to save and end before the time; then ``ended`` is set.
    """

    def __init__(
        self, folder: Path, save_every: int, eval_every: int, env_id: str,
        env_kwargs: dict[str, Any], done: int = 0, stop: StopOnSignal | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        self.folder, self.save_every, self.eval_every = folder, save_every, eval_every
        self.env_id, self.env_kwargs = env_id, env_kwargs
        self.stop, self.ended = stop, False
        self.last: Path | None = None
        self.benchmark = find_benchmark(env_id)
        self.commands = np.repeat(self.benchmark.commands, EPISODES * self.benchmark.variety)
        # After a kill the last evaluations may be of steps that are now trained again. The best
        # model may be of one of them, so what is to beat is not the history's but the file's.
        before = read_evaluations(folder) if done else []  # else the run begins again
        self.history = [row for row in before if row["steps"] <= done]
        self.best = best_score(folder)
        # By the steps alone, so that a resumed run saves and evaluates where it would have anyway.
        self._next_save, self._next_eval = (
            (done // every + 1) * every if every else 0 for every in (save_every, eval_every)
        )
        seconds = self.history[-1].get("seconds", 0.0) if self.history else 0.0
        self._begun = time.perf_counter() - seconds
        self._replay_buffer = replay_path(folder, done)  # of the last complete checkpoint

    def _on_rollout_start(self) -> None:
        due = self.save_every and self.model.num_timesteps >= self._next_save
        self.ended = self.stop is not None and self.stop.signal != 0
        if due:
            self._next_save += self.save_every
        if due or self.ended:
            steps = self.model.num_timesteps
            self.save(self.folder / "checkpoints" / f"model_{steps}_steps.zip")

    def _on_step(self) -> bool:
        if self.ended:
            return False
        if self.eval_every and self.num_timesteps >= self._next_eval:
            self._next_eval += self.eval_every
            self.evaluate()
        return True

    def save(self, path: Path) -> None:
        """Save the replay buffer, then the model with its state.

        Whenever a kill comes, the last model has its buffer: this one and the one before stay.
        """
        file = replay_path(self.folder, self.model.num_timesteps)
        replay_buffer = getattr(self.model, "replay_buffer", None)  # of an off-policy algorithm
        if replay_buffer is not None:
            for old in {*self.folder.glob("replay_buffer*.npz")} - {file, self._replay_buffer}:
                old.unlink()
            save_replay_buffer(replay_buffer, file)
        save_model(self.model, path, state=read_state(self.model))
        self.last, self._replay_buffer = path, file

    def evaluate(self) -> None:
        """Score the present policy; keep it if it is the best so far."""
        seeds = SELECTION_SEED + np.arange(len(self.commands))
        self.model.policy.set_training_mode(False)
        run = run_episodes(self.model.policy, self.env_id, self.env_kwargs, self.commands, seeds)
        env = make_env(self.env_id, self.env_kwargs)
        scored = point_estimates(self.benchmark.metrics, run, env)
        scored["score"] = scored[self.benchmark.chosen_by] or 0.0
        env.close()
        for name, value in scored.items():
            self.logger.record(f"eval/{name}", value)
        seconds = round(time.perf_counter() - self._begun, 1)  # of training so far
        row: dict[str, Any] = {"steps": float(self.num_timesteps), "seconds": seconds, **scored}
        names = dict.fromkeys(("return", self.benchmark.chosen_by))
        found = ", ".join(f"{name} {scored[name]:.3g}" for name in names)
        better = row["score"] > self.best  # of equal ones the first is kept
        best = " (the best so far)" * better
        text = f"evaluation: {self.num_timesteps} steps, {seconds:.0f} s, {found}{best}"
        if not self.history or scored.items() - self.history[-1].items():  # else the same policy
            print(text, flush=True)
        if better:
            self.best = row["score"]
            # Its score in the same file: no kill can part the two.
            save_model(self.model, self.folder / BEST, row)
        self.history.append(row)
        write_json(self.folder / "evaluations.json", self.history)


class NormalizerUpdate(BaseCallback):
    """Update the policy's normalizer with the last rollout before the next one begins: the update
    compares with probabilities that the rollout's policy gave."""

    def __init__(self) -> None:
        super().__init__()
        self._observations: NDArray[np.float32] | None = None

    def _on_rollout_start(self) -> None:
        self._begun = self.model.num_timesteps
        if self._observations is None:
            return
        for module in self.model.policy.modules():
            if isinstance(module, NormalizedObservation):
                module.update(torch.as_tensor(self._observations))
        self._observations = None

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


class StopOnSignal:
    """Take SIGINT (Ctrl-C), SIGTERM and SIGHUP while open, for :class:`Saver` to end training where
    the next rollout begins; a second Ctrl-C kills at once. ``signal``: which has come, 0 for none.
    """

    def __init__(self) -> None:
        self.signal = 0
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> StopOnSignal:
        if threading.current_thread() is threading.main_thread():  # no other may take signals
            for number in SIGNALS:
                if signal.getsignal(number) != signal.SIG_IGN:  # by nohup, in a background
                    self._handlers[number] = signal.signal(number, self._take)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        for taken in self._handlers:  # a closed terminal may send two, by its shell and the kernel
            signal.signal(taken, signal.SIG_IGN if taken in HANGUP else signal.SIG_DFL)
        # To standard error, but not by print: the signal may have come in the midst of one.
        with suppress(OSError):  # its terminal may be gone
            os.write(2, b"\nstopping after this rollout; once more to end at once\n")
