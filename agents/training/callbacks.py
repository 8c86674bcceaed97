"""Callbacks of a training run for checkpoints, evaluations, observation statistics and threads."""

import time
from pathlib import Path

import numpy as np
import torch
from gymnasium.spaces.utils import flatdim
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from typing_extensions import override

from agents.training import training_state
from agents.training.runs import BEST, best_score, read_evaluations, replay_path
from jansen_env.files import write_json
from jansen_env.plants.threads import count_threads
from jansen_env.sb3.run_config import Arguments, RunConfig
from jansen_env.sb3.trained import NormalizedObservation
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes

EPISODES = 8  # episodes per command and evaluation, multiplied by the variety of the benchmark
# First seed of the episodes that select the best model; no other part of the project uses these
# seeds.
SELECTION_SEED = 30_000
TIMES = {"seconds": time.perf_counter, "cpu_seconds": time.process_time}
"""Clocks that measure the duration of the training so far."""


class Saver(BaseCallback):
    """Callback that saves checkpoints, evaluates the policy regularly and keeps the best model.

    A checkpoint is saved at the beginning of a rollout, after all callbacks that change the model
    at this point.

    Args:
        folder: Folder of the run.
        config: Configuration of the run.
        save_every: Number of environment steps between checkpoints; 0 for no checkpoints.
        eval_every: Number of environment steps between evaluations; 0 for no evaluations.
        done: Number of steps for which the model has already been trained.
        state: State of the training after these steps, from which to resume. None for a new run.
    """

    def __init__(
        self,
        folder: Path,
        config: RunConfig,
        save_every: int,
        eval_every: int,
        done: int = 0,
        state: Arguments | None = None,
    ) -> None:
        super().__init__()
        self.folder = folder
        self.config = config
        self.save_every = save_every
        self.eval_every = eval_every
        self._state = state
        self.benchmark = find_benchmark(config.env)
        self.commands = np.repeat(self.benchmark.commands, EPISODES * self.benchmark.variety)
        # If the process was killed, the last evaluations may belong to steps that are now trained
        # again. The best model may come from one of these evaluations. The score to beat is
        # therefore the score that was saved with the model.
        before = read_evaluations(folder) if done else []
        self.history = [row for row in before if row["steps"] <= done]
        self.best = best_score(folder)
        # These depend only on the number of steps, so that a resumed run saves and evaluates at the
        # same steps.
        self._next_save, self._next_eval = (
            (done // every + 1) * every if every else 0 for every in (save_every, eval_every)
        )
        last = self.history[-1] if self.history else {}
        self._begun = {name: clock() - last.get(name, 0.0) for name, clock in TIMES.items()}
        self._replay_buffer = replay_path(folder, done)  # file of the last complete checkpoint

    @override
    def _on_rollout_start(self) -> None:
        if self._state is not None:
            # Stable-Baselines3 has sampled exploration noise since `restore_state`.
            training_state.restore_generators(self.model, self._state)
            self._state = None
        steps = self.model.num_timesteps
        if self.save_every and steps >= self._next_save:
            self._next_save += self.save_every
            self.save(self.folder / "checkpoints" / f"model_{steps}_steps.zip")

    @override
    def _on_step(self) -> bool:
        if self.eval_every and self.num_timesteps >= self._next_eval:
            self._next_eval += self.eval_every
            self.evaluate()
        return True

    def save(self, path: Path) -> None:
        """Save the replay buffer, and then the model with the state of the training.

        The previous replay buffer is kept as well. The last saved model therefore has its buffer
        even if the process is killed at any time.

        Args:
            path: File of the model.
        """
        file = replay_path(self.folder, self.model.num_timesteps)
        replay_buffer = getattr(self.model, "replay_buffer", None)  # off-policy algorithms have one
        if replay_buffer is not None:
            for old in {*self.folder.glob("replay_buffer*.npz")} - {file, self._replay_buffer}:
                old.unlink()
            training_state.save_replay_buffer(replay_buffer, file)
        notes = {"state": training_state.collect_state(self.model)}
        training_state.save_model(self.model, path, notes)
        self._replay_buffer = file

    def evaluate(self) -> None:
        """Evaluate the current policy, and save it if it is the best so far."""
        env_id = self.config.env
        env_kwargs = self.config.env_kwargs
        seeds = SELECTION_SEED + np.arange(len(self.commands))
        self.model.policy.set_training_mode(False)
        run = run_episodes(self.model.policy, env_id, env_kwargs, self.commands, seeds)
        env = make_env(env_id, env_kwargs)
        scored = point_estimates(self.benchmark.metrics, run, env)
        env.close()
        score = scored[self.benchmark.chosen_by] or 0.0
        for name, value in scored.items():
            self.logger.record(f"eval/{name}", value)
        times = {name: round(clock() - self._begun[name], 1) for name, clock in TIMES.items()}
        row = {"steps": self.num_timesteps, **times, **scored, "score": score}
        names = dict.fromkeys(("return", self.benchmark.chosen_by))
        text = ", ".join(f"{name} {scored[name]:.3g}" for name in names)
        better = score > self.best  # if scores are equal, the earlier model is kept
        if not self.history or {**self.history[-1], **times} != row:
            print(
                f"evaluation: {self.num_timesteps} steps, {times['seconds']:.0f} s, {text}"
                f"{' (the best so far)' * better}",
                flush=True,
            )
        if better:
            self.best = score
            # The score is in the same file, so that a killed process cannot separate the two.
            training_state.save_model(self.model, self.folder / BEST, row)
        self.history.append(row)
        write_json(self.folder / "evaluations.json", self.history)


class NormalizerUpdate(BaseCallback):
    """Callback that updates the observation normalizer of the policy between two rollouts.

    The normalizer must not change between a rollout and the following update of the policy, because
    the update compares with action probabilities from the rollout. The callback therefore applies
    the observations of a rollout just before the next rollout begins.
    """

    def __init__(self) -> None:
        super().__init__()
        self._observations: NDArray[np.float32] | None = None

    @override
    def _on_rollout_start(self) -> None:
        self._begun = self.model.num_timesteps
        if self._observations is None:
            return
        for module in self.model.policy.modules():
            if isinstance(module, NormalizedObservation):
                module.update(torch.as_tensor(self._observations, device=module.mean.device))
        self._observations = None

    @override
    def _on_rollout_end(self) -> None:
        # Copy the observations now. When the next rollout begins, Stable-Baselines3 has already
        # emptied the buffer.
        model = self.model
        if isinstance(model, OnPolicyAlgorithm):
            observations = model.rollout_buffer.observations
        elif not isinstance(model, OffPolicyAlgorithm):  # the policies of ARS have no normalizer
            return
        else:  # take the new part of the replay buffer
            buffer = model.replay_buffer
            assert buffer is not None
            count = min((model.num_timesteps - self._begun) // buffer.n_envs, buffer.size())
            observations = buffer.observations[np.arange(buffer.pos - count, buffer.pos)]
        size = flatdim(model.observation_space)
        self._observations = np.array(observations, np.float32).reshape(-1, size)

    @override
    def _on_step(self) -> bool:
        return True


class UpdateThreads(BaseCallback):
    """Callback that sets the number of torch threads: one for actions, more for updates.

    An update uses the number of threads that the simulation of the robots uses. Actions use a
    single thread, because more threads slow down small batches. With MKL, the number of threads
    does not change a single bit of an update.
    """

    @override
    def _on_rollout_start(self) -> None:
        torch.set_num_threads(1)

    @override
    def _on_rollout_end(self) -> None:
        torch.set_num_threads(count_threads(self.training_env.num_envs, None))

    @override
    def _on_training_end(self) -> None:
        torch.set_num_threads(1)

    @override
    def _on_step(self) -> bool:
        return True
