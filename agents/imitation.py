"""Imitation: before reinforcement a policy learns what torque a baseline would give.

Dataset aggregation (Ross, Gordon and Bagnell 2011): the learner acts, so that it comes to the
states to which its own errors lead, and the baseline says at each of them what it would have done.
After that the critic learns alone for a while what the policy earns: its first errors would undo
what was learned.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from torch import nn

from agents.config import training_envs
from agents.normalizer import NormalizedObservation
from agents.observing import observing, own_observations
from agents.policy import Policy
from agents.rollout import make_env
from agents.tasks import find_task, vector_env
from agents.vec_env import make_vec_env

if TYPE_CHECKING:
    from agents.data_parallel import Worker

ROBOTS, STEPS = 256, 500  # of a round
ROUNDS = 5  # in the first the baseline acts, in the others the learner
NOISE = 0.1  # standard deviation of what is added to actions, to see what lies beside the path
KEPT = 2  # every second step: the next one is much like it
EPOCHS, BATCH, LEARNING_RATE = 8, 2048, 2e-3  # of a round's learning; the rate falls to 0
RESET_SEED = 60_000  # of the robots, apart from all others, as is what a run's seed adds


def imitate(model: PPO, config: dict[str, Any]) -> float:
    """Let a model's policy learn the baseline ``config["imitate"]``; its critic stays as it was.

    The observation statistics become those of what was seen. Random numbers come from generators of
    their own, seeded with the configuration's seed: a run's other numbers are what they would be.
    The robots are moved in one batch, by the projection plant, whichever plant is trained on.

    Args:
        model: with a Gaussian policy. config: of its training.

    Returns:
        Root mean square difference from the baseline's torque in the last minibatch, as a share of
        its limit.
    """
    env_id, (kwargs, variants) = config["env"], training_envs(config)
    alone = vector_env(env_id).TASK.ONE_ALONE  # so many robots one by one would take hours
    kwargs = {name: value for name, value in kwargs.items() if name not in alone}
    env = make_env(env_id, kwargs)
    teacher = find_task(env_id).baselines[config["imitate"]](env.unwrapped)
    env.close()
    rng, shuffle = np.random.default_rng(config["seed"]), torch.Generator()
    shuffle.manual_seed(config["seed"])
    policy: Any = model.policy
    optimizer = torch.optim.Adam(_actor(policy))
    observations, actions, loss = [], [], torch.tensor(0.0)
    with closing(observing(make_vec_env(env_id, ROBOTS, kwargs, variants), config)) as venv:
        venv.seed(RESET_SEED + config["seed"])
        for number in range(ROUNDS):
            seen, given = _walk(venv, teacher, None if number == 0 else policy, rng)
            observations.append(seen)
            actions.append(given)
            x, y = torch.cat(observations), torch.cat(actions)
            _set_statistics(policy, x)
            for epoch in range(EPOCHS):
                done = (number + epoch / EPOCHS) / ROUNDS
                for group in optimizer.param_groups:
                    group["lr"] = LEARNING_RATE * (1.0 - done)
                order = torch.randperm(len(x), generator=shuffle)
                for rows in torch.split(order, BATCH):
                    loss = (policy.get_distribution(x[rows]).mode() - y[rows]).square().mean()
                    optimizer.zero_grad()
                    loss.backward()
                    optimizer.step()
    return float(loss.detach().sqrt())


def _walk(
    venv: Any, teacher: Policy, learner: Any, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Observations (n, d) on a round's way, and what the teacher would do (n, 1).

    Args:
        learner: who acts; None for the teacher.
    """
    observations, actions = [], []
    seen, starts, state = venv.reset(), np.ones(ROBOTS, bool), None
    for step in range(STEPS):
        wanted, state = teacher.predict(own_observations(venv, seen), state, starts, True)
        if step % KEPT == 0:
            observations.append(torch.as_tensor(seen))
            actions.append(torch.as_tensor(wanted))
        acted = wanted if learner is None else learner.predict(seen, deterministic=True)[0]
        noise = NOISE * rng.standard_normal(acted.shape)
        seen, _, starts, _ = venv.step(np.clip(acted + noise, -1.0, 1.0).astype(np.float32))
    return torch.cat(observations), torch.cat(actions)


def _actor(policy: Any) -> list[nn.Parameter]:
    """What the mean action depends on, and the critic does not."""
    return [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]


def _set_statistics(policy: Any, observations: torch.Tensor) -> None:
    """Let the policy's normaliser know these observations (n, d) and no others."""
    for module in policy.modules():
        if isinstance(module, NormalizedObservation):
            module.count.zero_()
            module.update(observations)


class Imitation(BaseCallback):
    """Imitates before training starts; workers do so each for itself, with the same result.

    Args:
        config: of the training. worker: of which the model is, where several train together.
        after: what to do then.
    """

    model: PPO

    def __init__(
        self, config: dict[str, Any], worker: Worker | None, after: Callable[[], None]
    ) -> None:
        super().__init__()
        self.config, self.worker, self.after = config, worker, after

    def _on_training_start(self) -> None:
        error = imitate(self.model, self.config)
        if self.worker is not None:
            self.worker.align(self.model)
        if self.worker is None or self.worker.leads:
            teacher = self.config["imitate"]
            print(f"imitated {teacher}: actions differ by {error:.3f} (RMS)", flush=True)
        self.after()

    def _on_step(self) -> bool:
        return True


class CriticFirst(BaseCallback):
    """Keeps the actor, its noise too, as it is for a run's first steps.

    Observation statistics, of which the actor's and the critic's are one, go on.

    Args:
        steps: of the run.
    """

    def __init__(self, steps: int) -> None:
        super().__init__()
        self.steps = steps

    def _on_rollout_end(self) -> None:
        self._let_learn(self.model.num_timesteps > self.steps)

    def _on_training_end(self) -> None:
        self._let_learn(True)  # whoever goes on with the model

    def _let_learn(self, learns: bool) -> None:
        policy: Any = self.model.policy
        for parameter in (*_actor(policy), policy.log_std):
            parameter.requires_grad_(learns)
            if not learns:
                parameter.grad = None  # an optimiser leaves alone what has none

    def _on_step(self) -> bool:
        return True
