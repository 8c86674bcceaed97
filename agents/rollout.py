"""Running a policy: episodes side by side, one prediction for all of them at each step."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COMMANDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)  # m/s, the grid on which policies are scored


class Policy(Protocol):
    """What is scored: anything with Stable-Baselines3's ``predict``."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions for a batch of observations, and the state to pass back."""
        ...


@dataclass
class Episodes:
    """Totals of n episodes, each (n,).

    Attributes:
        command: m/s. returns: sum of rewards. distance: x travelled, m. duration: s.
        slip: of all toes, m. work: sum of |motor work| over the steps, J.
        fell: whether the episode ended in a fall. peak_torque, rms_torque: N m.
    """

    command: Array
    returns: Array
    distance: Array
    duration: Array
    slip: Array
    work: Array
    fell: NDArray[np.bool_]
    peak_torque: Array
    rms_torque: Array

    @classmethod
    def none_yet(cls, command: Array) -> Episodes:
        """Episodes of the given commands (n,) with all totals at zero."""
        zero = {
            f.name: np.zeros(len(command), bool if f.name == "fell" else float) for f in fields(cls)
        }
        return cls(**{**zero, "command": command})


def make_env(env_id: str, env_kwargs: dict[str, Any], **more: Any) -> gym.Env[Any, Any]:
    """``gym.make`` with the environments of jansen_env registered."""
    import jansen_env  # noqa: F401

    return gym.make(env_id, **{**env_kwargs, **more})


def run_episodes(
    policy: Policy,
    env_id: str,
    env_kwargs: dict[str, Any],
    commands: Array,
    seeds: NDArray[np.int64],
    at_once: int = 64,
) -> Episodes:
    """Run one episode for each pair of command and seed, up to ``at_once`` side by side.

    Args:
        policy: acts deterministically.
        env_id, env_kwargs: of the environment.
        commands: (n,) speed commands, m/s. seeds: (n,) of each episode's reset.
    """
    n = len(commands)
    result = Episodes.none_yet(np.asarray(commands, dtype=float))
    pool = [make_env(env_id, env_kwargs) for _ in range(min(at_once, n))]
    for begin in range(0, n, at_once):
        _run_batch(policy, pool, result, seeds, np.arange(begin, min(begin + at_once, n)))
    for env in pool:
        env.close()
    result.rms_torque = np.sqrt(result.rms_torque / np.maximum(result.duration, 1e-12))
    return result


def _run_batch(
    policy: Policy,
    pool: list[gym.Env[Any, Any]],
    result: Episodes,
    seeds: NDArray[np.int64],
    episodes: NDArray[np.int64],
) -> None:
    observations = np.stack(
        [
            env.reset(seed=int(seeds[e]), options={"speed_command": float(result.command[e])})[0]
            for env, e in zip(pool, episodes, strict=False)
        ]
    )
    alive = np.ones(len(episodes), bool)
    start, state = np.ones(len(episodes), bool), None
    while alive.any():
        actions, state = policy.predict(observations, state, start, True)
        start = np.zeros(len(episodes), bool)
        for i in np.flatnonzero(alive):
            e, env = episodes[i], pool[i]
            observations[i], reward, terminated, truncated, info = env.step(actions[i])
            dt = float(env.unwrapped.control_dt)  # type: ignore[attr-defined]
            torque = info["crank_torque"]
            result.returns[e] += float(reward)
            result.duration[e] += dt
            result.slip[e] += info["slip"].sum()
            result.work[e] += abs(info["energy"]["motor_work"])
            result.peak_torque[e] = max(result.peak_torque[e], abs(torque))
            result.rms_torque[e] += torque**2 * dt  # the root of the mean is taken at the end
            if terminated or truncated:
                alive[i] = False
                result.distance[e] = info["x_position"]
                result.fell[e] = info["fallen"]
