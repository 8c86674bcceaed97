"""Crank-speed profiles: ``python -m benchmarks.profiles`` searches those in ``benchmarks/data``.

The crank is asked for a speed that depends on where it stands, which is the same for both pairs of
legs, and gets a torque in proportion to what it lacks:

    n_ref(psi) = n exp(sum over k = 1 .. 4 of a_k cos 2 k psi + b_k sin 2 k psi)
    torque = gain (n_ref - crank speed) + bias

Eleven numbers for each command, found by the cross-entropy method (Rubinstein 1999) on what the
score table has, not on the reward: they are a mark for whatever is trained on the reward.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.policy import Array, TorquePolicy
from agents.walker_baselines import COMMAND, COS_CRANK, CRANK_SPEED, SIN_CRANK
from jansen_env.files import write_json

ENV = "JansenWalker-v0"
DATA = Path(__file__).parent / "data" / "profiles.json"
COMMANDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)  # m/s
HARMONICS = 4
FIRST_CRANK_SPEED, PER_SPEED = 0.6, 7.0  # rad/s, and rad/m: where the search starts
SPREAD = (0.25, 3.0, 1.5, *(0.25, 0.2, 0.12, 0.08) * 2)  # of n (a share), gain, bias, a and b
POPULATION, ELITE, GENERATIONS, EPISODES = 32, 8, 40, 4
STEPS = 500  # of an episode
# What costs 1: of the speed error m/s, slip per metre, cost of transport, RMS torque N m, falls.
PRICES = {"speed_error": 0.005, "slip": 0.1, "transport": 1.5, "torque": 6.0, "falls": 0.05}


def profile_torque(numbers: Array, observation: Array) -> Array:
    """Torques (n,), N m, for observations (n, d) with a profile's numbers (n, 11) each.

    A negative command walks the mirror image: crank angle pi - psi, speed and torque reversed.
    """
    sign = np.sign(observation[:, COMMAND])
    angle = np.arctan2(observation[:, SIN_CRANK], sign * observation[:, COS_CRANK])
    turns = 2.0 * np.arange(1, HARMONICS + 1) * angle[:, None]
    speed, gain, bias = numbers[:, :3].T
    a, b = numbers[:, 3 : 3 + HARMONICS], numbers[:, 3 + HARMONICS :]
    wanted = speed * np.exp((a * np.cos(turns) + b * np.sin(turns)).sum(axis=1))
    return sign * (gain * (wanted - sign * observation[:, CRANK_SPEED]) + bias)


def profile_policy(env: Any) -> TorquePolicy:
    """The profile of the command next to the commanded speed."""
    found = json.loads(DATA.read_text(encoding="utf-8"))["profiles"]
    commands, numbers = np.array([float(c) for c in found]), np.array(list(found.values()))

    def controller(observation: Array, *_: Any) -> tuple[Array, None]:
        distance = np.abs(np.abs(observation[:, COMMAND])[:, None] - commands)
        return profile_torque(numbers[distance.argmin(axis=1)], observation), None

    return TorquePolicy(controller, env.torque_limit)


def scores(numbers: Array, command: float, seeds: NDArray[np.int64]) -> dict[str, Array]:
    """What the score table has of profiles (m, 11), (m,) each, over an episode for each seed."""
    m, episodes = len(numbers), len(seeds)
    n = m * episodes
    env: Any = gym.make_vec(
        ENV, num_envs=n, autoreset_mode=AutoresetMode.DISABLED, terminate_when_fallen=False
    )
    observation, _ = env.reset(seed=seeds.tolist() * m, options={"speed_command": command})
    own, up = np.repeat(numbers, episodes, axis=0), np.ones(n, bool)
    distance, sums = np.zeros(n), np.zeros((3, n))
    for _ in range(STEPS):
        torque = np.clip(profile_torque(own, observation), -env.torque_limit, env.torque_limit)
        action = (torque / env.torque_limit).astype(np.float32)[:, None]
        observation, _, _, _, info = env.step(action)
        step = info["slip"].sum(axis=1), abs(info["energy"]["motor_work"]), torque**2
        sums += up * np.array(step)
        distance = np.where(up, info["x_position"], distance)
        up &= ~(info["fallen"] | info["diverged"])
    weight = env.get_attr("weight")[0]
    env.close()
    slip, work, square = sums.reshape(3, m, episodes)
    walked = np.maximum(distance.reshape(m, episodes).sum(axis=1), 0.02 * episodes)
    error = np.abs(distance / (STEPS * env.unwrapped.control_dt) - command)
    return {
        "speed_error": error.reshape(m, episodes).mean(axis=1),
        "slip": slip.sum(axis=1) / walked,
        "transport": work.sum(axis=1) / weight / walked,
        "torque": np.sqrt(square / STEPS).mean(axis=1),
        "falls": 1.0 - up.reshape(m, episodes).mean(axis=1),
    }


def search(command: float, generations: int = GENERATIONS, seed: int = 0) -> Array:
    """The eleven numbers for a command, m/s."""
    rng = np.random.default_rng(seed)
    first = FIRST_CRANK_SPEED + PER_SPEED * command
    mean = np.array([first, 6.0, 2.0 + 6.0 * command, *[0.0] * 2 * HARMONICS])
    spread = np.array(SPREAD) * np.array([first, *[1.0] * (len(mean) - 1)])
    least = 0.03 * spread
    low = np.array([0.1, 0.3, *[-np.inf] * (len(mean) - 2)])
    for generation in range(generations):
        tried = np.maximum(mean + spread * rng.normal(size=(POPULATION, len(mean))), low)
        tried[0] = mean
        seeds = 20_000 + EPISODES * generation + np.arange(EPISODES)
        found = scores(tried, command, seeds)
        cost = sum(found[name] / price for name, price in PRICES.items())
        best = tried[np.argsort(cost)[:ELITE]]
        mean = 0.2 * mean + 0.8 * best.mean(axis=0)
        spread = np.maximum(0.3 * spread + 0.7 * best.std(axis=0), least)
    return mean


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--commands", type=float, nargs="+", default=list(COMMANDS), metavar="M/S")
    parser.add_argument("--generations", type=int, default=GENERATIONS)
    parser.add_argument("--out", default=str(DATA), help="file to write")
    args = parser.parse_args(arguments)
    profiles = {}
    for command in args.commands:
        found = search(command, args.generations)
        profiles[f"{command:g}"] = found.round(4).tolist()
        held = scores(found[None], command, 40_000 + np.arange(20))
        shown = {name: round(float(value[0]), 4) for name, value in held.items()}
        print(f"{command:g} m/s:", shown, flush=True)
    made = {"command": "python -m benchmarks.profiles", "profiles": profiles}
    print(f"written: {write_json(args.out, made)}")


if __name__ == "__main__":
    main()
