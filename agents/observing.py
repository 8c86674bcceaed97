"""What a policy sees beside the environment's observation, in training and in use.

``history`` in a configuration puts earlier observations behind the present one
(:class:`jansen_env.history.History`). ``privileged_critic`` lets the critic alone know what was
drawn for the episode and, where sensors are noisy, what they should say; this comes last. A critic
is of no use after training, so it may know what no sensor tells (Pinto et al. 2017, asymmetric
actor-critic).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, unwrap_vec_wrapper

from agents.policy import Policy
from jansen_env.history import History


class ObservingVecEnv(VecEnvWrapper):
    """Environments whose observations are all that a policy sees.

    Args:
        venv: the environments. history: of their observations. privileged: whether
            :func:`knowledge` comes behind it.

    Attributes:
        history: as given. own_space: of the environments' observations, which come first.
        memory: (n, steps, d) what the history remembers.
    """

    def __init__(self, venv: VecEnv, history: History, privileged: bool) -> None:
        self.history, self.own_space = history, venv.observation_space
        self.memory: NDArray[Any] | None = None
        self._privileged = privileged
        known = knowledge(tasks_of(venv)) if privileged else np.zeros((venv.num_envs, 0))
        self._known = known
        space = seen_space(venv.observation_space, history, known.shape[1])
        super().__init__(venv, observation_space=space)

    def reset(self) -> NDArray[np.float32]:
        """As the environments'."""
        self.memory = None
        return self._see(self.venv.reset(), np.ones(self.num_envs, bool))

    def step_wait(self) -> Any:
        """As the environments'; an episode's last observation, too, is as it would be seen."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for i in np.flatnonzero(dones).tolist():
            assert self.memory is not None
            last = np.asarray(infos[i]["terminal_observation"])[None]
            seen, _ = self.history.extend(self.memory[[i]], last, np.zeros(1, bool))
            known = self._known[i].copy()
            if self._privileged and "true_observation" in infos[i]:
                known[-last.size :] = infos[i]["true_observation"]
            infos[i]["terminal_observation"] = np.append(seen[0], known)
        return self._see(observations, dones), rewards, dones, infos

    def restore(self, memory: NDArray[Any], seen: NDArray[Any]) -> None:
        """Go on from a memory (n, steps, d) and what was seen last (n, ...)."""
        self.memory = memory
        self._known = seen[:, seen.shape[1] - self._known.shape[1] :]

    def _see(self, observations: Any, starts: NDArray[np.bool_]) -> NDArray[np.float32]:
        seen, self.memory = self.history.extend(self.memory, observations, starts)
        if self._privileged:
            self._known = knowledge(tasks_of(self.venv))
            seen = np.concatenate([seen, self._known], axis=1)
        return seen


def tasks_of(venv: VecEnv) -> list[Any]:
    """The tasks behind environments: one of all of them, or one for each."""
    inner: Any = venv.unwrapped
    return [env.unwrapped.task for env in getattr(inner, "envs", None) or [inner.env]]


def knowledge(tasks: Sequence[Any]) -> NDArray[np.float32]:
    """(n, p) what no sensor tells: the episodes' parameters and, behind noise, the observations."""
    known = [
        np.concatenate([task.parameters, task.true_observation], axis=1)
        if task.true_observation is not task.observation
        else task.parameters
        for task in tasks
    ]
    return np.concatenate(known).astype(np.float32)


def seen_space(own: Any, history: History, known: int) -> spaces.Box:
    """Return the space of observations of ``own`` with a history and ``known`` numbers behind them.

    Raises:
        ValueError: they are too much to remember.
    """
    history.check_size(own.shape[0])
    low, high = (np.tile(bound, history.length) for bound in (own.low, own.high))
    return spaces.Box(
        np.append(low, np.full(known, -np.inf)).astype(np.float32),
        np.append(high, np.full(known, np.inf)).astype(np.float32),
    )


def observing(venv: VecEnv, config: dict[str, Any]) -> VecEnv:
    """Environments whose observations are what a configuration's policy sees."""
    history, privileged = what_is_seen(config)
    if history.length == 1 and not privileged:
        return venv
    return ObservingVecEnv(venv, history, privileged)


def what_is_seen(config: dict[str, Any]) -> tuple[History, bool]:
    """The history of a configuration, and whether its critic knows the parameters."""
    return History(**config.get("history", {})), config.get("privileged_critic", False)


def own_space(env: Any) -> Any:
    """The space of an environment's own observations, whatever of it a policy sees."""
    wrapper: Any = unwrap_vec_wrapper(env, ObservingVecEnv) if isinstance(env, VecEnv) else None
    return env.observation_space if wrapper is None else wrapper.own_space


def own_observations(venv: VecEnv, seen: NDArray[Any]) -> NDArray[Any]:
    """The environments' own part of what is seen (n, ...)."""
    wrapper: Any = unwrap_vec_wrapper(venv, ObservingVecEnv)
    return seen if wrapper is None else seen[:, : wrapper.own_space.shape[0]]


class ObservingPolicy:
    """A policy that sees more than the environment's observation, as one that is given just this.

    It remembers by the state that ``predict`` returns, as recurrent policies do: without it every
    observation is an episode's first.

    Args:
        policy: sees a history, and perhaps what only its critic uses. history: what it sees.
        space: of the environment's observations.

    Attributes:
        policy, history: as given; the policy's other attributes are this one's, too.
    """

    def __init__(self, policy: Any, history: History, space: Any) -> None:
        self.policy, self.history, self.observation_space = policy, history, space

    def __getattr__(self, name: str) -> Any:
        return getattr(self.policy, name)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,), and the state to pass back."""
        batch = np.atleast_2d(observation)
        starts = np.asarray(False if episode_start is None else episode_start, bool)
        seen, state = self.history.extend(state, batch, np.broadcast_to(starts, len(batch)))
        unknown = self.policy.observation_space.shape[0] - seen.shape[1]  # of no use to the actor
        seen = np.pad(seen, ((0, 0), (0, unknown)))
        actions, _ = self.policy.predict(seen, deterministic=deterministic)
        return (actions if np.ndim(observation) > 1 else actions[0]), state


def observing_policy(model: Any) -> Policy:
    """A model's policy as one of its environments' own observations."""
    wrapper: Any = unwrap_vec_wrapper(model.get_env(), ObservingVecEnv)
    if wrapper is None:
        found: Policy = model.policy
        return found
    return ObservingPolicy(model.policy, wrapper.history, wrapper.own_space)


class AsymmetricPolicy(ActorCriticPolicy):
    """PPO's policy, whose actor may see less than its critic.

    Args:
        actor_inputs: how many of what is seen, from the first on, the actor sees; None for all.
            Others go to the critic alone, and :class:`agents.normalizer.NormalizedObservation`
            must be the features extractor.
        arguments, more: the policy's own.
    """

    def __init__(self, *arguments: Any, actor_inputs: int | None = None, **more: Any) -> None:
        self.actor_inputs = actor_inputs
        if actor_inputs is not None:
            more["share_features_extractor"] = False
        super().__init__(*arguments, **more)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        """What a file of the policy alone keeps beside its weights."""
        return {**super()._get_constructor_parameters(), "actor_inputs": self.actor_inputs}

    def make_features_extractor(self) -> BaseFeaturesExtractor:
        """The actor's first, then the critic's."""
        made = getattr(self, "features_extractor", None)
        if self.actor_inputs is None or made is not None:
            return super().make_features_extractor()
        extractor: Any = self.features_extractor_class
        kwargs = {**self.features_extractor_kwargs, "size": self.actor_inputs}
        made = extractor(self.observation_space, **kwargs)
        return made

    def _build_mlp_extractor(self) -> None:
        """Both networks, each on its own features."""
        super()._build_mlp_extractor()
        if self.actor_inputs is not None:
            inputs = self.vf_features_extractor.features_dim
            critic = MlpExtractor(inputs, self.net_arch, self.activation_fn, self.device)
            self.mlp_extractor.value_net = critic.value_net
