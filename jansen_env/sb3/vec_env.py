"""Stable-Baselines3's ``VecEnv`` over robots that are simulated together."""

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

from jansen_env.checks import invalid, listed, positive_integer, robot_indices, whole_number
from jansen_env.envs import arguments
from jansen_env.envs.copies import WholeCopies, exclusive
from jansen_env.envs.vector import TaskVectorEnv
from jansen_env.scoring.benchmarks import can_be_batched, find_benchmark
from jansen_env.scoring.metrics import Env, Infos
from jansen_env.scoring.rollout import EnvKwargs, make_env
from jansen_env.world.settings import Each, Own

MONITOR = ("allow_early_resets", "reset_keywords", "info_keywords", "override_existing")
"""Names of ``monitor_kwargs``."""
BATCH_MONITOR = ("info_keywords", "override_existing")
"""Names of ``monitor_kwargs`` for environments that are simulated together."""


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

    The arguments before ``variants`` are those of Stable-Baselines3's own ``make_vec_env``. As
    there, the environments are monitored: the information of an episode's last step has its return,
    length and time under ``"episode"``, from which Stable-Baselines3 logs ``ep_rew_mean``.
    Environments that are simulated together have one ``VecMonitor`` (``BatchVecEnv`` is its
    ``unwrapped``), others a ``Monitor`` each, inside of ``wrapper_class``.

    Args:
        env_id: One of :data:`jansen_env.registration.IDS`.
        n_envs: Number of environments.
        seed: Seed of the starts and of the action space; environment i has ``seed`` + i. None for a
            random one.
        start_index: Index of the first environment, in the seed of the action space and in the
            names of monitor files.
        monitor_dir: Folder of files with the returns and lengths of episodes. Environments that are
            simulated together write one, ``monitor.csv`` (``5.monitor.csv`` with the
            ``start_index`` 5), others one each, ``0.monitor.csv`` ... None for no files.
        wrapper_class: Wrapper of each environment. Wrapped environments are simulated one by one.
        env_kwargs: Arguments of all environments.
        vec_env_cls: Class that holds the environments one by one, such as ``SubprocVecEnv``; None
            for one batch, or ``DummyVecEnv`` where they cannot be simulated together.
        vec_env_kwargs: Arguments of ``vec_env_cls``.
        monitor_kwargs: Arguments of ``Monitor``. Environments that are simulated together take
            ``info_keywords`` and ``override_existing``.
        wrapper_kwargs: Arguments of ``wrapper_class``.
        variants: Further arguments; environment i takes entry i modulo their number.
        info_keys: As of :class:`BatchVecEnv`; single environments give all of their information.
        kwargs: Further arguments of all environments.

    Raises:
        ValueError: If an argument is out of range, or has no effect or no meaning with the others.
    """
    find_benchmark(env_id)  # no other id is known here
    n_envs = positive_integer("n_envs", n_envs)
    start_index = whole_number("start_index", start_index)
    if seed is not None:
        seed = whole_number("seed", seed)
    if not variants:
        raise ValueError("variants is empty, must have at least one entry, such as {}")
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
    """Raise a ValueError for a name that is not allowed."""
    if unknown := [name for name in given if name not in allowed]:
        known = listed(allowed, unknown[0])
        raise ValueError(f"{invalid(argument, unknown[0], f'among {known}')}{remedy}")


def _batch(
    env_id: str, common: EnvKwargs, variants: Sequence[EnvKwargs], each: Sequence[EnvKwargs],
    info_keys: Sequence[str] | None,
) -> "BatchVecEnv":  # fmt: skip
    """Return environments with the arguments ``each`` as one batch."""
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
    """Return a batch that says what its episodes returned, in ``folder`` too."""
    _check_names("info_keywords", dict.fromkeys(info_keywords), venv.env.task.information.keys)
    monitored = VecMonitor(venv, info_keywords=tuple(info_keywords))
    monitored.reset_infos = venv.reset_infos  # VecEnvWrapper has its own, which stay empty
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)
        name = f"{start_index}.{Monitor.EXT}" if start_index else Monitor.EXT
        header: dict[str, float | str] = {"t_start": monitored.t_start, "env_id": env_id}
        monitored.results_writer = ResultsWriter(
            str(Path(folder) / name), header, tuple(info_keywords), override_existing
        )
    return monitored


class BatchVecEnv(WholeCopies, VecEnv):
    """Robots that are simulated together, as Stable-Baselines3 wants its environments.

    An episode that ends is followed by the next one's first observation in the same step. Its last
    step's information has all keys, ``terminal_observation`` and ``TimeLimit.truncated``.

    Args:
        env: the robots, with ``AutoresetMode.DISABLED``: episodes are started here.
        info_keys: of the other steps' information, such as ``"slip"``; None for all.

    Raises ValueError: an unknown key, or another autoreset mode.
    """

    def __init__(self, env: TaskVectorEnv[Any], info_keys: Sequence[str] | None = ()) -> None:
        if env.autoreset_mode != AutoresetMode.DISABLED:
            raise ValueError(f"autoreset_mode must be DISABLED, got {env.autoreset_mode}")
        self.env, self.info_keys = env, arguments.info_keys(info_keys, env.task.information.keys)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.metadata = dict(env.metadata)  # with the frames per second of films
        self._actions: NDArray[np.float32] = np.zeros((env.num_envs, 1), np.float32)

    @property
    def lock(self) -> Any:
        """Lock of the robots' task, which is held while they move or change."""
        return self.env.lock

    @exclusive
    def reset(self) -> NDArray[np.float32]:
        seeds, options = self._seeds, self._options
        self._reset_seeds()
        self._reset_options()
        observations, _ = self.env.reset_each(seeds, options)
        self.reset_infos[:] = map(self.env.task.information.single, range(self.num_envs))
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    @exclusive
    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], list[Infos]]:
        task = self.env.task
        terminated, truncated = self.env.advance(self._actions)
        rewards, dones = task.rewards.copy(), terminated | truncated
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
        """All that each robot's future depends on: its state, and the steps of its episode."""
        elapsed = self.env._elapsed.tolist()
        return [{**self.env.get_state(i), "elapsed": elapsed[i]} for i in range(self.num_envs)]

    @exclusive
    def set_states(self, states: Sequence[Infos]) -> None:
        """Let each robot go on from its state of :meth:`get_states`.

        Raises ValueError: another number of states, or an entry is missing or out of range.
        """
        if len(states) != self.num_envs:
            raise ValueError(f"states must have {self.num_envs} entries, got {len(states)}")
        elapsed = [whole_number("elapsed", state.get("elapsed")) for state in states]
        for i, state in enumerate(states):
            self.env.set_state(i, {k: v for k, v in state.items() if k != "elapsed"})
        self.env._elapsed[:] = elapsed

    def close(self) -> None:
        self.env.close()

    def _get_indices(self, indices: object) -> list[int]:
        """Return the positions of robots: all for None, one, or a list of different ones."""
        return robot_indices(indices, self.num_envs)

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        return self.env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[object]:
        values = self.env.get_attr(attr_name)
        return [values[i] for i in self._get_indices(indices)]

    @exclusive
    def set_attr(self, attr_name: str, value: object, indices: VecEnvIndices = None) -> None:
        """Change a parameter of robots; a new command counts from the next episode on."""
        robots, checked = self._get_indices(indices), self.env.task.checked
        for change in [checked(i, **{attr_name: value}) for i in robots]:
            change()  # all or nothing

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: object
    ) -> list[object]:
        """Call a method of each robot; ``get_wrapper_attr`` asks for an attribute."""
        if method_name == "get_wrapper_attr":
            return self.get_attr(method_args[0], indices)
        robots = self._get_indices(indices)
        return [self.env.call_one(i, method_name, *method_args, **kwargs) for i in robots]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        return [False for _ in self._get_indices(indices)]
