"""A ``VecEnv`` of Stable-Baselines3 whose robots are simulated together."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor, ResultsWriter
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices
from typing_extensions import override

from jansen_env.checks import invalid, listed, positive_integer, robot_indices, whole_number
from jansen_env.envs import arguments
from jansen_env.envs.copies import WholeCopies, exclusive
from jansen_env.envs.vector import TaskVectorEnv
from jansen_env.scoring.benchmarks import can_be_batched, find_benchmark
from jansen_env.scoring.metrics import Env, Infos
from jansen_env.scoring.rollout import EnvKwargs, make_env
from jansen_env.world.settings import Each, Own

MONITOR = ("allow_early_resets", "reset_keywords", "info_keywords", "override_existing")
"""Allowed names in ``monitor_kwargs``."""
BATCH_MONITOR = ("info_keywords", "override_existing")
"""Allowed names in ``monitor_kwargs`` for environments that are simulated together."""


def make_vec_env(
    env_id: str,
    n_envs: int = 1,
    seed: int | None = None,
    start_index: int = 0,
    monitor_dir: str | Path | None = None,
    wrapper_class: Callable[..., Env] | None = None,
    env_kwargs: EnvKwargs | None = None,
    vec_env_cls: Callable[..., VecEnv] | None = None,
    vec_env_kwargs: EnvKwargs | None = None,
    monitor_kwargs: EnvKwargs | None = None,
    wrapper_kwargs: EnvKwargs | None = None,
    *,
    variants: Sequence[EnvKwargs] = ({},),
    info_keys: Sequence[str] | None = (),
    **kwargs: object,
) -> VecEnv:
    """Make environments for Stable-Baselines3, simulated together where that is possible.

    The arguments before ``variants`` are those of ``make_vec_env`` of Stable-Baselines3. As with
    that function, the environments are monitored: at the last step of an episode, the information
    contains its return, length and time under ``"episode"``, from which Stable-Baselines3 logs
    ``ep_rew_mean``. Environments that are simulated together have one ``VecMonitor``, whose
    ``unwrapped`` is a ``BatchVecEnv``. Other environments have a ``Monitor`` each, inside
    ``wrapper_class``.

    Args:
        env_id: One of :data:`jansen_env.registration.IDS`.
        n_envs: Number of environments.
        seed: Seed of the initial states and of the action space. Environment i uses ``seed`` + i.
            None for random seeds.
        start_index: Index of the first environment, which is added to the seed of the action space
            and appears in the names of monitor files.
        monitor_dir: Folder for files with the returns and lengths of episodes. Environments that
            are simulated together write one file, ``monitor.csv`` (``5.monitor.csv`` if
            ``start_index`` is 5). Other environments write one file each, ``0.monitor.csv`` and so
            on. None for no files.
        wrapper_class: Wrapper of each environment. Wrapped environments are simulated one by one.
        env_kwargs: Arguments of all environments.
        vec_env_cls: Class that holds environments that are simulated one by one, such as
            ``SubprocVecEnv``. None for one batch, or for ``DummyVecEnv`` if the environments cannot
            be simulated together.
        vec_env_kwargs: Arguments of ``vec_env_cls``.
        monitor_kwargs: Arguments of ``Monitor``. Environments that are simulated together accept
            only ``info_keywords`` and ``override_existing``.
        wrapper_kwargs: Arguments of ``wrapper_class``.
        variants: Further arguments of the environments. Environment i uses entry i modulo the
            number of entries.
        info_keys: Keys of the information, see :class:`BatchVecEnv`. Environments that are
            simulated one by one always return their complete information.
        kwargs: Further arguments of all environments.

    Raises:
        ValueError: If an argument is out of range, or has no effect or no meaning with the other
            arguments.
    """
    find_benchmark(env_id)  # raises an error if the id is unknown
    n_envs = positive_integer("n_envs", n_envs)
    start_index = whole_number("start_index", start_index)
    if seed is not None:
        seed = whole_number("seed", seed)
    if not variants:
        raise ValueError("variants must have at least one entry, such as {}, got none")
    if vec_env_kwargs and vec_env_cls is None:
        raise ValueError("vec_env_kwargs must come with vec_env_cls, got vec_env_kwargs alone")
    if wrapper_kwargs and wrapper_class is None:
        raise ValueError("wrapper_kwargs must come with wrapper_class, got wrapper_kwargs alone")
    monitor = dict(monitor_kwargs or {})
    common = {**(env_kwargs or {}), **kwargs}
    each = [{**common, **variants[i % len(variants)]} for i in range(n_envs)]
    single = wrapper_class is not None or vec_env_cls is not None
    venv: VecEnv
    if not single and can_be_batched(env_id, common, variants):
        _check_names("monitor_kwargs", monitor, BATCH_MONITOR, "; give vec_env_cls=DummyVecEnv")
        batch = _batch(env_id, common, variants, each, info_keys)
        venv = _monitored(batch, env_id, monitor_dir, start_index, **monitor)
    else:
        _check_names("monitor_kwargs", monitor, MONITOR)

        def make_single(rank: int, arguments: EnvKwargs) -> Env:
            file = None if monitor_dir is None else str(Path(monitor_dir) / str(rank))
            env = Monitor(make_env(env_id, arguments), file, **monitor)
            return wrapper_class(env, **(wrapper_kwargs or {})) if wrapper_class else env

        makers: list[Callable[[], Env]] = [
            partial(make_single, start_index + i, each[i]) for i in range(n_envs)
        ]
        venv = (vec_env_cls or DummyVecEnv)(makers, **(vec_env_kwargs or {}))
    if seed is not None:
        venv.seed(seed)
        venv.action_space.seed(seed + start_index)
    return venv


def _check_names(argument: str, given: EnvKwargs, allowed: Sequence[str], remedy: str = "") -> None:
    """Check that all names are allowed.

    Args:
        argument: Name of the argument, for the error message.
        given: Mapping whose names are checked.
        allowed: Allowed names.
        remedy: Text at the end of the error message.

    Raises:
        ValueError: If a name is not allowed.
    """
    if unknown := [name for name in given if name not in allowed]:
        known = listed(allowed, unknown[0])
        raise ValueError(f"{invalid(argument, unknown[0], f'among {known}')}{remedy}")


def _batch(
    env_id: str,
    common: EnvKwargs,
    variants: Sequence[EnvKwargs],
    each: Sequence[EnvKwargs],
    info_keys: Sequence[str] | None,
) -> "BatchVecEnv":
    """Return one batch of environments.

    Args:
        env_id: Id of the environments.
        common: Arguments of all environments.
        variants: Arguments that may differ between environments.
        each: All arguments of each environment.
        info_keys: Keys of the information, see :class:`BatchVecEnv`.
    """
    varied = {name for variant in variants for name in variant}
    own: dict[str, object] = dict.fromkeys(varied, Own.VALUE)
    own["max_episode_steps"] = gym.spec(env_id).max_episode_steps
    values = {name: Each(given.get(name, own[name]) for given in each) for name in varied}
    envs = gym.make_vec(
        env_id, len(each), autoreset_mode=AutoresetMode.DISABLED, **{**common, **values}
    )
    return BatchVecEnv(cast("TaskVectorEnv[Any]", envs.unwrapped), info_keys)


def _monitored(
    venv: "BatchVecEnv",
    env_id: str,
    folder: str | Path | None,
    start_index: int,
    info_keywords: tuple[str, ...] = (),
    override_existing: bool = True,
) -> VecMonitor:
    """Return a batch whose information contains the return of each finished episode.

    Args:
        venv: The batch.
        env_id: Id of the environments.
        folder: Folder of the monitor file. None for no file.
        start_index: Index of the first environment.
        info_keywords: Keys of the information that are also recorded.
        override_existing: Whether to overwrite an existing monitor file.
    """
    _check_names("info_keywords", dict.fromkeys(info_keywords), venv.env.task.information.keys)
    monitored = VecMonitor(venv, info_keywords=tuple(info_keywords))
    monitored.reset_infos = venv.reset_infos  # the list of VecEnvWrapper stays empty
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)
        name = f"{start_index}.{Monitor.EXT}" if start_index else Monitor.EXT
        header: dict[str, float | str] = {"t_start": monitored.t_start, "env_id": env_id}
        monitored.results_writer = ResultsWriter(
            str(Path(folder) / name), header, tuple(info_keywords), override_existing
        )
    return monitored


class BatchVecEnv(WholeCopies, VecEnv):
    """Robots that are simulated together, as a ``VecEnv`` of Stable-Baselines3.

    When an episode ends, the same step returns the first observation of the next episode. The
    information of the last step of an episode contains all keys, ``terminal_observation`` and
    ``TimeLimit.truncated``.

    Args:
        env: The robots, with ``AutoresetMode.DISABLED``, because this class starts the episodes.
        info_keys: Keys of the information of all other steps, such as ``"slip"``. None for all
            keys.

    Raises:
        ValueError: If a key is unknown, or if ``env`` has another autoreset mode.
    """

    def __init__(self, env: TaskVectorEnv[Any], info_keys: Sequence[str] | None = ()) -> None:
        if env.autoreset_mode != AutoresetMode.DISABLED:
            raise ValueError(f"autoreset_mode must be DISABLED, got {env.autoreset_mode}")
        self.env = env
        self.info_keys = arguments.info_keys(info_keys, env.task.information.keys)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.metadata = dict(env.metadata)  # a copy with the frames per second of videos
        self._actions: NDArray[np.float32] = np.zeros((env.num_envs, 1), np.float32)

    @property
    @override
    def lock(self) -> Any:
        """Lock of the robots' task, which is held while they move or change."""
        return self.env.lock

    @exclusive
    @override
    def reset(self) -> NDArray[np.float32]:
        """Start new episodes of all robots, and return their observations, shape (n, d)."""
        seeds = self._seeds
        options = self._options
        self._reset_seeds()
        self._reset_options()
        observations, _ = self.env.reset_each(seeds, options)
        self.reset_infos[:] = map(self.env.task.information.single, range(self.num_envs))
        return observations

    @override
    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions for :meth:`step_wait`.

        Args:
            actions: Torques as fractions of the torque limit, shape (n, 1).
        """
        self._actions = actions

    @exclusive
    @override
    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], list[Infos]]:
        """Simulate one control step, and start a new episode of each robot whose episode is over.

        Returns:
            The observations, the rewards, whether each episode is over, and the information of each
                robot.
        """
        task = self.env.task
        terminated, truncated = self.env.advance(self._actions)
        rewards = task.rewards.copy()
        dones = terminated | truncated
        infos: list[Infos] = [{} for _ in range(self.num_envs)]
        if self.info_keys is None or self.info_keys:
            for i in np.flatnonzero(~dones).tolist():
                info = task.information.single(i)
                infos[i] = {key: info[key] for key in self.info_keys or info}
        for i in np.flatnonzero(dones).tolist():
            infos[i] = task.information.single(i)
            infos[i]["terminal_observation"] = task.observation[i].copy()
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
        if dones.any():
            self.env.restart(np.flatnonzero(dones))
            for i in np.flatnonzero(dones).tolist():
                self.reset_infos[i] = task.information.single(i)
        return task.observation.copy(), rewards, dones, infos

    @exclusive
    def get_states(self) -> list[Infos]:
        """Return the state of each robot, from which :meth:`set_states` continues its episode.

        A state also contains the number of steps of the present episode.
        """
        elapsed = self.env._elapsed.tolist()
        return [{**self.env.get_state(i), "elapsed": elapsed[i]} for i in range(self.num_envs)]

    @exclusive
    def set_states(self, states: Sequence[Infos]) -> None:
        """Restore each robot to a state saved by :meth:`get_states`.

        Args:
            states: State of each robot.

        Raises:
            ValueError: If the number of states is not the number of robots, or if an entry is
                missing or out of range.
        """
        if len(states) != self.num_envs:
            raise ValueError(f"states must have {self.num_envs} entries, got {len(states)}")
        elapsed = [whole_number("elapsed", state.get("elapsed")) for state in states]
        for i, state in enumerate(states):
            self.env.set_state(i, {k: v for k, v in state.items() if k != "elapsed"})
        self.env._elapsed[:] = elapsed

    @override
    def close(self) -> None:
        """Close the robots' environment."""
        self.env.close()

    @override
    def _get_indices(self, indices: object) -> list[int]:
        """Return indices of robots.

        Args:
            indices: None for all robots, the index of one robot, or a list of different indices.
        """
        return robot_indices(indices, self.num_envs)

    @override
    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture of each robot, shape (H, W, 3), or None without a ``render_mode``."""
        return self.env.render() or [None] * self.num_envs

    @override
    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[object]:
        """Return an attribute of each selected robot.

        Args:
            attr_name: Name of the attribute.
            indices: Indices of the robots. None for all robots.
        """
        values = self.env.get_attr(attr_name)
        return [values[i] for i in self._get_indices(indices)]

    @exclusive
    @override
    def set_attr(self, attr_name: str, value: object, indices: VecEnvIndices = None) -> None:
        """Change a parameter of robots. A new speed command applies from the next episode on.

        If the value is not allowed, no robot changes.

        Args:
            attr_name: Name of the parameter.
            value: New value.
            indices: Indices of the robots. None for all robots.
        """
        robots = self._get_indices(indices)
        checked = self.env.task.checked
        for change in [checked(i, **{attr_name: value}) for i in robots]:
            change()  # only after the value has been checked for all robots

    @override
    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: object
    ) -> list[object]:
        """Call a method of each robot; the method ``get_wrapper_attr`` returns an attribute.

        Args:
            method_name: Name of the method.
            method_args: Positional arguments of the method.
            indices: Indices of the robots. None for all robots.
            kwargs: Keyword arguments of the method.
        """
        if method_name == "get_wrapper_attr":
            return self.get_attr(method_args[0], indices)
        robots = self._get_indices(indices)
        return [self.env.call_one(i, method_name, *method_args, **kwargs) for i in robots]

    @override
    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return False for each selected robot, because none is wrapped.

        Args:
            wrapper_class: Class of the wrapper.
            indices: Indices of the robots. None for all robots.
        """
        return [False for _ in self._get_indices(indices)]
