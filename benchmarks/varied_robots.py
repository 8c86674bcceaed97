"""Robots of other lengths: compiled, placed and walked, beside as many of one design."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks import measure
from jansen_env import ROBOTS, Robot
from jansen_env.dynamics import reduced

COUNT = 256  # robots
WALK_SPEED = 2.5  # rad/s, of a crank
BARS, VARIED = ("frame", "upper_rod", "rocker", "lower_rod", "coupler"), 0.03


class Walk:
    """Ten seconds of robots at a crank speed, from a reset on; of other designs in each play."""

    def __init__(self, count: int, steps: int, exchange: bool) -> None:
        self.envs: Any = gym.make_vec(
            "JansenWalkerBuilt-v0",
            count,
            info_keys=(),
            autoreset_mode="Disabled",
            terminate_when_fallen=False,
        )
        self.envs.reset(seed=0)
        self.count, self.steps, self.exchange = count, steps, exchange
        self.reset_s = self.walk_s = 0.0
        self._rng = np.random.default_rng(0)

    def play(self) -> float:
        """Reset and walk; designs/s."""
        options = {"robot": varied_robots(self.count, self._rng)} if self.exchange else None
        reduced._compile.cache_clear()  # it knows those that were drawn last
        column = [one.name for one in self.envs.observed].index("crank_speed")
        start = time.perf_counter()
        observations, _ = self.envs.reset(seed=1, options=options)
        reset = time.perf_counter()
        for _ in range(self.steps):
            torque = 0.1 + 0.25 * (WALK_SPEED - observations[:, column : column + 1])
            observations, *_ = self.envs.step(np.clip(torque, -1.0, 1.0))
        end = time.perf_counter()
        self.reset_s, self.walk_s = reset - start, end - reset
        return self.count / (end - start)


def varied_robots(count: int, rng: np.random.Generator) -> list[Robot]:
    """The built robot with other lengths of its bars, such as turn all the way round."""
    robot, robots = ROBOTS["built"](), list[Robot]()
    while len(robots) < count:
        bars = {
            name: replace(robot.body(name), length=robot.body(name).length * scale)
            for name, scale in zip(
                BARS, rng.uniform(1 - VARIED, 1 + VARIED, len(BARS)), strict=True
            )
        }
        with suppress(ValueError):
            varied = robot.with_bodies(**bars)
            reduced.compile_robot(varied)
            robots.append(varied)
    return robots


def designs(rounds: int, quick: bool) -> str:
    """Robots of other lengths at every reset beside as many that stay as they are."""
    count, steps = (8, 20) if quick else (COUNT, 500)
    players = {
        "each another design": Walk(count, steps, True),
        "one design": Walk(count, steps, False),
    }
    rates = measure.take_turns({name: player.play for name, player in players.items()}, rounds)
    rows = [
        (name, *measure.spread(rates[name], ".1f"), f"{1e3 * player.reset_s / count:.2f}",
         f"{1e3 * player.walk_s / count:.2f}")
        for name, player in players.items()
    ]  # fmt: skip
    head = (f"{count} robots, 10 s", "designs/s", "lowest", "highest", "ms to reset", "ms to walk")
    own, same = (rates[name] for name in players)
    return f"## Designs\n\n{measure.table(head, rows)}\n\n" + measure.table(
        ("ratio", "designs/s (by round)"), [("another design / one", measure.ratio(own, same))]
    )
