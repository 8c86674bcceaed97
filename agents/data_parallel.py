"""Data-parallel PPO: one run by several workers, each with its share of the robots.

Each worker is Stable-Baselines3's own PPO, with its robots, its rollout buffer and its copy of the
policy. What depends on all robots is made common by ``torch.distributed``: gradients are averaged
before each optimiser step and clipped then, advantages are normalised over the workers'
minibatches together, observation statistics are those of all observations, steps are counted over
all workers. So N workers take the optimiser steps that one with all robots would take on the same
minibatches, to rounding: sums are taken in another order. Every worker computes these common
numbers from the same bits in the same order, so the copies of the policy stay equal bit for bit.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import torch
import torch.distributed as dist
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from stable_baselines3.common.utils import set_random_seed
from torch.distributed.distributed_c10d import Store
from torch.nn.utils import clip_grad_norm_, parameters_to_vector, vector_to_parameters

from agents.callbacks import NormalizerUpdate, StopOnSignal
from agents.normalizer import NormalizedObservation
from agents.runs import next_monitor
from agents.training_state import read_state
from jansen_env.plants.threads import ROBOTS_PER_THREAD


class WorkerLost(Exception):
    """Another worker has ended, or cannot be reached."""


class Worker:
    """One of the processes that train together; ``torch.distributed`` is initialised.

    Args:
        rank: its number, from 0. size: how many there are. Rank 0 leads: it alone evaluates, saves
            and prints.
        store: that they have in common. cores: of its machine that this worker may use.

    Attributes:
        leads: whether it is the leader. stop: takes signals, for all workers.
    """

    def __init__(self, rank: int, size: int, store: Store, cores: int = 1) -> None:
        self.rank, self.size, self.store, self.cores = rank, size, store, cores
        self.leads = rank == 0
        self.stop = StopTogether(self)
        self._axes = _axes(size)

    def threads(self, robots: int) -> int:
        """How many threads simulate so many robots."""
        return max(1, min(self.cores, robots // ROBOTS_PER_THREAD))

    def told(self, name: str, make: Callable[[], str]) -> str:
        """What the leader makes, known to all under a name that is used once."""
        with connected():
            if self.leads:
                self.store.set(name, make())
            return self.store.get(name).decode()

    def share(self, config: dict[str, Any]) -> dict[str, Any]:
        """This worker's part of a run's configuration: its robots, its part of each minibatch.

        Robot i of rank k is robot k n / N + i of the run's n, with that one's training variant.

        Raises:
            ValueError: as of :func:`check_config`.
        """
        check_config(config, self.size)
        share = {**config, "hyperparameters": dict(config["hyperparameters"])}
        share["n_envs"] = config["n_envs"] // self.size
        share["hyperparameters"]["batch_size"] = _batch_size(config) // self.size
        if variants := config.get("training_variants"):
            first = self.rank * share["n_envs"] % len(variants)
            share["training_variants"] = variants[first:] + variants[:first]
        return share

    def connect(self, model: PPO, seed: int) -> None:
        """Make a model, built from :meth:`share`, one of the run's.

        Environment i gets seed + k n / N + i. The generators of torch, numpy and Python, which
        explore and shuffle, are seeded with ``numpy.random.SeedSequence(seed, spawn_key=(k,))``.
        """
        environment: Any = model.get_env()
        environment.seed(seed + self.rank * model.n_envs)
        own = np.random.SeedSequence(seed, spawn_key=(self.rank,))
        set_random_seed(int(own.generate_state(1)[0]))
        self.align(model)
        model.rollout_buffer = CommonAdvantages(
            self, model.normalize_advantage, model.n_steps, model.observation_space,
            model.action_space, model.device, model.gae_lambda, model.gamma, model.n_envs,
        )  # fmt: skip
        step = AveragedGradients(self, model.max_grad_norm)
        model.policy.optimizer.register_step_pre_hook(step)
        if not self.leads:
            model.verbose = 0

    def align(self, model: PPO) -> None:
        """Give a model's policy the leader's parameters and statistics."""
        with connected():
            for tensor in model.policy.state_dict().values():
                dist.broadcast(tensor, 0)

    def updates(self) -> list[BaseCallback]:
        """Callbacks that must come before a run's other ones."""
        return [CommonUpdate(self), CommonNormalizer(self)]

    def progress(self) -> CommonProgress:
        """A bar of all workers' steps."""
        return CommonProgress(self)

    def next_monitor(self, folder: Path) -> Path:
        """:func:`agents.runs.next_monitor` of this worker: the leader's number, and its rank."""
        path = next_monitor(folder)
        first = self.highest(int(path.name.split(".")[0]) if self.leads else 0)
        return path.with_name(f"{first + self.rank}.monitor.csv")

    def read_states(self, model: BaseAlgorithm) -> dict[str, Any]:
        """:func:`agents.training_state.read_state` of all workers, for the leader to save.

        No worker goes on before the leader is here: what it noted before belongs to this state.
        """
        own = read_state(model)
        if not self.leads:
            with connected():
                self.store.set(f"state {self.rank}", json.dumps(own))
        self.highest(0)
        if not self.leads:
            return {}
        with connected():
            others = [json.loads(self.store.get(f"state {k}")) for k in range(1, self.size)]
        return {"workers": [own, *others]}

    def own_part(self, state: dict[str, Any]) -> dict[str, Any] | None:
        """This worker's part of :meth:`read_states`; None if it is of another number of workers."""
        states = state.get("workers")
        if not isinstance(states, list) or len(states) != self.size:
            return None
        own = states[self.rank]
        return own if isinstance(own, dict) else None

    def average(self, tensor: torch.Tensor) -> None:
        """Replace a tensor by its mean over the workers, the same bits on all.

        By sums along one axis after the other of a grid of the workers: 64 of them take 126
        messages in turn around gloo's ring, 12 this way.
        """
        with connected():
            for group in self._axes:
                dist.all_reduce(tensor, group=group)
        tensor /= self.size

    def gather(self, tensor: torch.Tensor) -> torch.Tensor:
        """(N, ...) the workers' tensors, by rank."""
        found = [torch.empty_like(tensor) for _ in range(self.size)]
        with connected():
            dist.all_gather(found, tensor)
        return torch.stack(found)

    def highest(self, number: int) -> int:
        """The highest of the workers' numbers."""
        tensor = torch.tensor(number)
        with connected():
            dist.all_reduce(tensor, dist.ReduceOp.MAX)
        return int(tensor)


def check_config(config: dict[str, Any], workers: int) -> None:
    """Check that so many workers can train by a configuration.

    Raises:
        ValueError: another algorithm than PPO, a number that cannot be shared out, or target_kl.
    """
    if config["algo"] != "ppo":
        raise ValueError(f"algo is {config['algo']!r}, must be 'ppo' with several workers")
    for name, value in (
        ("n_envs", config["n_envs"]),
        ("hyperparameters.batch_size", _batch_size(config)),
    ):
        if value % workers:
            raise ValueError(f"{name} is {value}, must be a multiple of the {workers} workers")
    if config["hyperparameters"].get("target_kl") is not None:
        raise ValueError("hyperparameters.target_kl must be null with several workers: each would "
                         "end its update by its own part of the data")  # fmt: skip


def _axes(size: int) -> list[dist.ProcessGroup | None]:
    """Groups of workers along each axis of a grid, an axis for each prime factor of their number.

    Sums along an axis are of the same terms in the same order, so all workers get the same bits.
    """
    axes: list[dist.ProcessGroup | None] = []
    stride = 1
    while stride < size:
        rest = size // stride
        factor = next(f for f in range(2, rest + 1) if rest % f == 0)
        if factor == size:
            return [None]  # all of them, the group that is there
        grid = np.arange(size).reshape(-1, factor, stride).swapaxes(1, 2).reshape(-1, factor)
        axes.append(dist.new_subgroups_by_enumeration(grid.tolist())[0])  # type: ignore[no-untyped-call]
        stride *= factor
    return axes


def _batch_size(config: dict[str, Any]) -> int:
    """A run's minibatch; Stable-Baselines3's own where the configuration has none."""
    return int(config["hyperparameters"].get("batch_size", 64))


@contextmanager
def connected() -> Iterator[None]:
    """Around a collective operation.

    Raises:
        WorkerLost: it failed.
    """
    try:
        yield
    except RuntimeError as error:  # torch.distributed's own kinds are of this one
        raise WorkerLost(" ".join(str(error).split())) from error


def moments(values: torch.Tensor) -> torch.Tensor:
    """(2, ...) mean and variance over the first axis, in double precision."""
    values = values.double()
    return torch.stack([values.mean(0), values.var(0, unbiased=False)])


def pooled(parts: torch.Tensor) -> torch.Tensor:
    """:func:`moments` (2, ...) of a whole from those of its N equal parts (N, 2, ...).

    Chan, Golub and LeVeque's formula, which for equal parts is the law of total variance.
    """
    means, variances = parts[:, 0], parts[:, 1]
    return torch.stack([means.mean(0), variances.mean(0) + means.var(0, unbiased=False)])


class AveragedGradients:
    """Before an optimiser step: the mean of all workers' gradients, clipped to a norm.

    Shares of a minibatch are equal, so this is the gradient of the mean loss over all of it.
    """

    def __init__(self, worker: Worker, max_norm: float) -> None:
        self.worker, self.max_norm = worker, max_norm

    def __call__(self, optimizer: torch.optim.Optimizer, *arguments: Any) -> None:
        parameters = [p for group in optimizer.param_groups for p in group["params"]]
        gradients = [p.grad for p in parameters if p.grad is not None]
        together = parameters_to_vector(gradients)
        self.worker.average(together)
        vector_to_parameters(together, gradients)
        clip_grad_norm_(parameters, self.max_norm)


class CommonAdvantages(RolloutBuffer):
    """A rollout buffer that normalises advantages over the workers' minibatches together.

    Args:
        worker: whose buffer it is. normalize: whether to. arguments: the rollout buffer's own.
    """

    def __init__(self, worker: Worker, normalize: bool, *arguments: Any) -> None:
        self.worker, self.normalize = worker, normalize
        super().__init__(*arguments)

    def get(self, batch_size: int | None = None) -> Generator[RolloutBufferSamples, None, None]:
        """The minibatches of an epoch, all of which the workers normalise in one exchange."""
        batches = list(super().get(batch_size))
        if not self.normalize:
            yield from batches
            return
        own = torch.stack([moments(batch.advantages) for batch in batches], dim=-1)
        means, variances = pooled(self.worker.gather(own))
        for batch, mean, variance in zip(batches, means, variances, strict=True):
            n = self.worker.size * len(batch.advantages)
            if n == 1:  # as Stable-Baselines3, which leaves it as it is
                yield batch
                continue
            deviation = torch.sqrt(variance * n / (n - 1)) + 1e-8
            yield batch._replace(advantages=((batch.advantages - mean) / deviation).float())


class CommonUpdate(BaseCallback):
    """Counts all workers' steps, agrees on signals, and leaves clipping and normalising to what
    knows all workers.

    The latter during updates only: a model saved between them is like one that one worker trained.
    It comes before callbacks that read the number of steps.
    """

    model: PPO

    def __init__(self, worker: Worker) -> None:
        super().__init__()
        self.worker = worker

    def _on_training_start(self) -> None:
        self._own = self.model.max_grad_norm, self.model.normalize_advantage

    def _on_step(self) -> bool:
        self.model.num_timesteps += (self.worker.size - 1) * self.training_env.num_envs
        return True

    def _on_rollout_end(self) -> None:  # the update follows
        self.model.max_grad_norm, self.model.normalize_advantage = np.inf, False

    def _on_rollout_start(self) -> None:
        self.model.max_grad_norm, self.model.normalize_advantage = self._own
        self.worker.stop.agree()

    _on_training_end = _on_rollout_start


class CommonNormalizer(NormalizerUpdate):
    """Updates the policy's normalizer with the last rollouts of all workers."""

    def __init__(self, worker: Worker) -> None:
        super().__init__()
        self.worker = worker

    def _update(self, normalizer: NormalizedObservation, observations: torch.Tensor) -> None:
        own = moments(observations)
        mean, variance = pooled(self.worker.gather(own))
        normalizer.merge(
            float(self.worker.size * len(observations)), mean.float(), variance.float()
        )


class StopTogether(StopOnSignal):
    """Takes signals for all workers: ``signal`` changes where they agree on it, before a rollout.

    Attributes:
        came: the number of the signal that came to this worker.
    """

    def __init__(self, worker: Worker) -> None:
        super().__init__()
        self.worker, self.came = worker, 0
        if not worker.leads:
            self.notice = b""

    def agree(self) -> None:
        """Let a signal that came to any worker count for all."""
        self.signal = self.worker.highest(self.came)

    def _take(self, number: int, frame: FrameType | None) -> None:
        agreed = self.signal
        super()._take(number, frame)
        self.came, self.signal = number, agreed


class CommonProgress(ProgressBarCallback):
    """A progress bar of all workers' steps."""

    def __init__(self, worker: Worker) -> None:
        super().__init__()
        self.worker = worker

    def _on_step(self) -> bool:
        self.pbar.update(self.worker.size * self.training_env.num_envs)
        return True
