"""The walking task's own numbers, for any number of robots: what is observed, and what it is worth.

The single and the batched environment both count here, so that they agree bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jansen_env.checks import finite, within
from jansen_env.engine import task
from jansen_env.envs.rewards import RewardWeights
from jansen_env.plants.detector import surfaces
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

SPEED_COMMAND = (0.05, 0.8)  # m/s, the default range of commanded speeds
FASTEST_COMMAND = 2.0  # m/s, beyond it no command makes sense for this machine
REWARD_KEYS = ("reward/tracking", "reward/slip", "reward/energy", "reward/posture", "reward/fall")
# Entries of an observation before and after the toes' loads.
BEFORE_LOADS, AFTER_LOADS = 10, 2


def observation_space(toes: int) -> Any:
    """Of a robot with so many toes; its entries are listed in ``JansenWalkerEnv``."""
    high = [1, 1, np.inf, 1, 1, np.inf, np.inf, np.inf, np.inf, FASTEST_COMMAND]
    high += [np.inf] * toes + [1, np.inf]
    low = [-bound for bound in high]
    low[BEFORE_LOADS : BEFORE_LOADS + toes] = [0.0] * toes
    low[-1] = 0.0
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)


def draw_start(
    rng: np.random.Generator,
    command_range: tuple[float, float],
    noise: float,
    options: dict[str, Any] | None = None,
) -> tuple[float, float, float]:
    """How an episode starts: command (m/s), crank angle (rad) and crank speed (rad/s).

    Args:
        command_range: m/s, drawn from unless ``options`` has a ``speed_command``.
        noise: rad/s, the largest crank speed.
        options: of ``reset``: ``speed_command`` and ``crank_angle``.

    Raises:
        ValueError: an unknown option, or a value out of range.
    """
    # Drawn in any case, so that fixing one leaves the others as they were.
    crank_angle = rng.uniform(0.0, 2.0 * math.pi)
    command = rng.uniform(*command_range)
    crank_speed = noise * rng.uniform(-1.0, 1.0)
    if not options:
        return command, crank_angle, crank_speed
    unknown = {*options} - {"speed_command", "crank_angle"}
    if unknown:
        raise ValueError(
            f"reset options {sorted(unknown)} are unknown, allowed are 'speed_command' and "
            "'crank_angle'"
        )
    if "speed_command" in options:
        command = options["speed_command"]
        within("options['speed_command']", command, -FASTEST_COMMAND, FASTEST_COMMAND)
    if "crank_angle" in options:
        crank_angle = finite("options['crank_angle']", options["crank_angle"])
    return float(command), crank_angle, crank_speed


class WalkingTask:
    """What the task keeps of each robot between steps.

    Args:
        terrains: the ground of each robot. toes: of a robot. mass_times_gravity: (n,) weight, N.
        period: control period, s.

    Attributes:
        command: (n,) commanded speed, m/s. share: (n,) last action. farthest: (n,) m reached in the
            commanded direction. fallen: (n,) since the last reset. loads: (n, toes) of the weight.
        observation: (n, 12 + toes) the last ones. reward: (n,), terms: (n, 5) of the last step.
        speed: (n,) m/s, mean over the last step.
    """

    def __init__(
        self,
        terrains: Sequence[Terrain],
        toes: int,
        mass_times_gravity: Array,
        period: float,
        weights: RewardWeights,
    ) -> None:
        n = len(terrains)
        self.weight, self.period = np.array(mass_times_gravity, dtype=float), period
        self._weights = np.array(astuple(weights))
        self._surface, self._bounds, self._ground = surfaces(terrains)
        self.command, self.share, self.farthest = np.zeros((3, n))
        self.fallen = np.zeros(n, bool)
        self.loads = np.zeros((n, toes))
        self.observation = np.zeros((n, BEFORE_LOADS + toes + AFTER_LOADS), np.float32)
        self.reward, self.speed = np.zeros((2, n))
        self.terms = np.zeros((n, len(REWARD_KEYS)))

    def begin(self, rows: Ints | slice, command: Array, loads: Array) -> None:
        """Start episodes of some robots; ``loads`` (rows, toes) are those at rest, of the weight."""
        self.command[rows], self.loads[rows] = command, loads
        self.share[rows] = self.farthest[rows] = 0.0
        self.fallen[rows] = False

    def observe(self, states: Array) -> NDArray[np.float32]:
        """Fill and return :attr:`observation` for states (n, 8)."""
        task.observe(
            states, self.command, self.share, self.farthest, self.loads,
            self._surface, self._bounds, self._ground, self.observation,
        )  # fmt: skip
        return self.observation

    def judge(
        self, states: Array, x_before: Array, slip: Array, force: Array, work: Array, bumped: Flags
    ) -> Flags:
        """Reward a step, and observe what it led to.

        Args:
            states: (n, 8) after the step. x_before: (n,) m before it.
            slip: (n, toes) m. force: (n, toes, 2) N. work: (n,) the motor's, J.
            bumped: (n,) whether a joint other than a toe was pressed on the ground.

        Returns:
            (n,) whether the robot has fallen since the last reset.
        """
        task.judge(
            states, x_before, slip, force, work, bumped, self.command, self.farthest, self.fallen,
            self.loads, self.weight, self.period, self._weights, self.reward, self.terms, self.speed,
        )  # fmt: skip
        self.observe(states)
        return self.fallen
