"""Batched rollouts: episodes of many walkers, with friction, command and start of each.

For searches, which try many candidates on many starts in one batch, and for scores after the start:
:func:`jansen_env.scoring.rollout.run_episodes` scores whole episodes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from jansen_env.baselines.policy import Array, Bools, Policy
from jansen_env.scoring.metrics import SETTLING

ENV = "JansenWalker-v0"
DURATION = 10.0  # s, of an episode


class Outcome(NamedTuple):
    """Of each episode (n,), until it fell, if it did.

    Attributes:
        returns: sum of rewards. fell: whether it fell or diverged.
        drift: mean speed after the first ``SETTLING`` s less the command, m/s; a robot that fell
            stays there.
        distance: m, towards the command. slip: of all toes, m. work: of the motor, without its
            sign, over the robot's weight, m. square: mean square of the torque, (N m)^2.
        change: mean of \\|change of the torque\\| from step to step, N m.
    """

    returns: Array
    fell: Bools
    drift: Array
    distance: Array
    slip: Array
    work: Array
    square: Array
    change: Array


class BatchedRollout:
    """A batch of walkers.

    Args:
        friction: (n,) of each one's ground. terrain: one for all, or a list of one for each.
        env_id: whose robots walk, on the flat.
    """

    def __init__(self, friction: Array, terrain: Any = "flat", env_id: str = ENV) -> None:
        envs: Any = gym.make_vec(
            env_id, num_envs=len(friction), autoreset_mode=AutoresetMode.DISABLED,
            terminate_when_fallen=False, friction=np.asarray(friction, float), terrain=terrain,
            info_keys=("fallen", "diverged", "x_position", "slip", "energy", "crank_torque"),
        )  # fmt: skip
        self.envs = envs
        self.control_dt: float = envs.control_dt
        self.weight = np.array(envs.get_attr("weight"))

    def close(self) -> None:
        """Let go of the robots."""
        self.envs.close()

    def run(
        self, policy: Policy, commands: Array, seeds: NDArray[np.int64], angles: Array | None = None
    ) -> Outcome:
        """One episode of each robot.

        Args:
            policy: acts. commands: (n,) m/s. seeds: (n,) of the resets.
            angles: (n,) of the crank at the start, rad; None for those the seeds draw.
        """
        envs, n, dt = self.envs, len(commands), self.control_dt
        options: dict[str, Any] = {"speed_command": commands}
        if angles is not None:
            options["crank_angle"] = angles
        observation, _ = envs.reset(seed=seeds.tolist(), options=options)
        up, starts, state = np.ones(n, bool), np.ones(n, bool), None
        position, settled, torque = np.zeros(n), np.zeros(n), np.zeros(n)
        sums = np.zeros((6, n))
        steps, start = round(DURATION / dt), round(SETTLING / dt)
        for step in range(steps):
            actions, state = policy.predict(observation, state, starts, True)
            starts = np.zeros(n, bool)
            observation, reward, _, _, info = envs.step(actions)
            before, torque = torque, info["crank_torque"]
            work, slip = np.abs(info["energy"]["motor_work"]), info["slip"].sum(axis=1)
            change = np.abs(torque - before)
            sums += up * np.array([reward, slip, work, torque**2, change, np.ones(n)])
            position = np.where(up, info["x_position"], position)
            up &= ~(info["fallen"] | info["diverged"])
            if step + 1 == start:
                settled = position
        returns, slip, work, square, change, walked = sums
        return Outcome(
            returns, ~up, (position - settled) / ((steps - start) * dt) - commands,
            np.maximum(np.sign(commands) * position, 0.0), slip, work / self.weight,
            square / walked, change / walked,
        )  # fmt: skip
