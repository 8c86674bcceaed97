"""One environment: ``JansenWalker-v0`` beside ``Walker2d-v5`` and ``BipedalWalker-v3``.

All are made by ``gym.make`` with its defaults, wrappers included, and get random actions drawn
beforehand. Resets of episodes that end are part of the time.
"""

from __future__ import annotations

import time
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.rounds import Goal, ratio, table, take_turns
from jansen_env import Terrain

NEEDS = ("mujoco", "Box2D")
OURS, MUJOCO, BOX2D = "JansenWalker-v0", "Walker2d-v5", "BipedalWalker-v3"
FLAT, ROUGH = f"{OURS}, flat", f"{OURS}, rough"
STEPS, QUICK_STEPS = 5000, 200  # of each round
SEGMENTS = 100  # of the rough ground
SPACING, STEEPNESS = 0.2, 0.1  # m between its vertices; heights are +- so much of the spacing


def rough_ground(
    segments: int, spacing: float = SPACING, seed: int = 0, **arguments: Any
) -> Terrain:
    """Rough ground of so many segments around x = 0, as steep whatever the spacing (m).

    Raises:
        ValueError: fewer than five segments, which is no rough ground.
    """
    vertices = segments - 3  # without the two before and the two after them
    if vertices < 2:
        raise ValueError(f"segments is {segments}, must be at least 5")
    length, rng = (vertices + 0.5) * spacing, np.random.default_rng(seed)
    return Terrain.rough(rng, STEEPNESS * spacing, spacing, length, -0.5 * length, **arguments)


class Runner:
    """One environment with its actions, stepped the same way in every round."""

    def __init__(self, env_id: str, steps: int, seed: int = 0, **arguments: Any) -> None:
        self.seed, self.resets = seed, 0
        self.env: gym.Env[Any, Any] = gym.make(env_id, **arguments)
        self.env.action_space.seed(seed)
        self.actions = [self.env.action_space.sample() for _ in range(steps)]

    def play(self) -> float:
        """Take all actions, resetting whenever an episode ends; steps/s."""
        env, resets = self.env, 0
        env.reset(seed=self.seed)
        start = time.perf_counter()
        for action in self.actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
                resets += 1
        spent = time.perf_counter() - start
        self.resets = resets
        return len(self.actions) / spent

    @property
    def step_duration(self) -> float:
        """Simulated time of a step, s: what a picture of the environment lasts."""
        return 1.0 / float(self.env.metadata["render_fps"])


def measure(rounds: int, quick: bool) -> dict[str, Any]:
    """Rates of all environments and their ratios; ready for JSON."""
    steps = QUICK_STEPS if quick else STEPS
    runners = {
        FLAT: Runner(OURS, steps),
        ROUGH: Runner(OURS, steps, terrain=rough_ground(SEGMENTS)),
        MUJOCO: Runner(MUJOCO, steps),
        BOX2D: Runner(BOX2D, steps),
    }
    rates = take_turns({name: runner.play for name, runner in runners.items()}, rounds)
    environments = {
        name: {
            "steps_per_second": median(rates[name]),
            "rounds": rates[name],
            "resets_per_round": runner.resets,
            "step_duration": runner.step_duration,
            "simulated_seconds_per_second": median(rates[name]) * runner.step_duration,
        }
        for name, runner in runners.items()
    }
    for runner in runners.values():
        runner.env.close()
    return {
        "steps_per_round": steps,
        "environments": environments,
        "ratios": {
            ours: {peer: _ratios(runners, rates, ours, peer) for peer in (MUJOCO, BOX2D)}
            for ours in (FLAT, ROUGH)
        },
    }


def _ratios(
    runners: dict[str, Runner], rates: dict[str, list[float]], ours: str, peer: str
) -> dict[str, Any]:
    found = ratio(rates[ours], rates[peer])
    simulated = runners[ours].step_duration / runners[peer].step_duration
    return {**found, "simulated_ratio": simulated * found["ratio"]}


def report(result: dict[str, Any]) -> str:
    """The result as tables."""
    environments = [
        (
            name, f"{env['steps_per_second']:,.0f}", f"{min(env['rounds']):,.0f}",
            f"{max(env['rounds']):,.0f}", str(env["resets_per_round"]),
            f"{1e3 * env['step_duration']:g}", f"{env['simulated_seconds_per_second']:,.0f}",
        )
        for name, env in result["environments"].items()
    ]  # fmt: skip
    ratios = [
        (
            f"{ours} / {peer}", f"{found['ratio']:.2f}",
            f"{found['range'][0]:.2f} to {found['range'][1]:.2f}",
            f"{found['simulated_ratio']:.2f}",
        )
        for ours, peers in result["ratios"].items()
        for peer, found in peers.items()
    ]  # fmt: skip
    head = ("environment", "steps/s", "lowest", "highest", "resets", "ms/step", "simulated s/s")
    return "\n\n".join(
        [
            table(head, environments),
            table(("ratio", "steps/s", "by round", "simulated s/s"), ratios),
        ]
    )


def goals(result: dict[str, Any]) -> list[Goal]:
    """Where the ratios should be."""
    flat = result["ratios"][FLAT]
    return [
        Goal(f"steps/s over {MUJOCO}'s", flat[MUJOCO]["ratio"], "at least", 2.5),
        Goal(f"simulated s/s over {MUJOCO}'s", flat[MUJOCO]["simulated_ratio"], "at least", 6.0),
        Goal(f"steps/s over {BOX2D}'s", flat[BOX2D]["ratio"], "above", 1.0),
        Goal(f"simulated s/s over {BOX2D}'s", flat[BOX2D]["simulated_ratio"], "above", 1.0),
    ]
