"""Many robots at once: ``gym.make_vec("JansenWalker-v0")`` beside envpool's ``Walker2d-v5``.

Random actions drawn beforehand. Every round begins with a reset of all, which is not measured; the
robots then stand at evenly spread places of their episodes, so that time limits end as many of them
as in a long run, and what ends, falls included, starts again within the time measured. A step that
resets an environment counts as a step, here and at envpool.
"""

from __future__ import annotations

import sys
import time
from statistics import median
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.rounds import Goal, cores, fresh, ratio, table, take_turns
from benchmarks.speed_single import (
    MUJOCO,
    OURS,
    QUICK_STEPS,
    SEGMENTS,
    STEPS,
    Runner,
    rough_ground,
)

ENVPOOL_RUNS = sys.platform == "linux" and sys.version_info >= (3, 11)
NEEDS = ("mujoco", "envpool") if ENVPOOL_RUNS else ("mujoco",)
COUNTS, QUICK_COUNTS = (1, 4, 16, 64, 256, 1024, 4096), (1, 4)
COMPARED, QUICK_COMPARED = 256, 4  # robots, at which peers and rough ground are measured
ROBOT_STEPS, QUICK_ROBOT_STEPS = 60_000, 100  # of all robots together in a round, about
FEWEST_STEPS, MOST_STEPS = 16, 5000  # vector steps of a round
PEER_EPISODE = 100  # vector steps of envpool's rounds; its episodes last some 25
MEMORY_COUNTS, QUICK_MEMORY_COUNTS = (256, 1024, 4096), (16,)

MEMORY = """
import os
import gymnasium as gym
import jansen_env

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

def walking(count):
    venv = gym.make_vec("{env_id}", num_envs=count)
    venv.reset(seed=0)
    for _ in range(10):
        venv.step(venv.action_space.sample())
    return venv

first = walking(1)
before = resident()
venv = walking({count})
print((resident() - before) / {count})
"""


class VectorRunner:
    """A vector environment with its actions, stepped the same way in every round.

    Args:
        venv: Gymnasium's or envpool's, reset once already. steps: of a round.
        space: of one environment's action.
        limit: steps after which its episodes end, to begin at evenly spread places of them; None
            to begin all of them at the start.
    """

    def __init__(
        self, venv: Any, count: int, space: gym.spaces.Box, steps: int, limit: int | None = None
    ) -> None:
        self.venv, self.count, self.limit = venv, count, limit
        shape = (steps, count, *space.shape)
        drawn = np.random.default_rng(0).uniform(space.low, space.high, shape)
        self.actions = list(drawn.astype(space.low.dtype))

    def play(self) -> float:
        """Take all actions from a fresh start; environment steps/s."""
        venv = self.venv
        venv.reset()
        if self.limit is not None:
            venv.unwrapped.elapsed[:] = np.arange(self.count) * self.limit // self.count
        start = time.perf_counter()
        for action in self.actions:
            venv.step(action)
        return len(self.actions) * self.count / (time.perf_counter() - start)


def ours(count: int, robot_steps: int = ROBOT_STEPS, **arguments: Any) -> VectorRunner:
    """So many robots, as ``gym.make_vec`` makes them by default."""
    venv = gym.make_vec(OURS, num_envs=count, **arguments)
    venv.reset(seed=0)
    space: Any = venv.single_action_space
    steps = min(max(FEWEST_STEPS, robot_steps // count), MOST_STEPS)
    return VectorRunner(venv, count, space, steps, gym.spec(OURS).max_episode_steps)


def theirs(count: int, threads: int, episode: int = PEER_EPISODE) -> VectorRunner:
    """envpool's ``Walker2d-v5`` on so many threads."""
    from envpool import make_gymnasium

    venv = make_gymnasium(MUJOCO, num_envs=count, num_threads=threads, seed=0)
    return VectorRunner(venv, count, venv.action_space, episode)


def measure(rounds: int, quick: bool) -> dict[str, Any]:
    """Rates by number of robots, and the peers' in the same rounds; ready for JSON."""
    robot_steps = QUICK_ROBOT_STEPS if quick else ROBOT_STEPS
    peer_episode = 16 if quick else PEER_EPISODE
    compared = QUICK_COMPARED if quick else COMPARED
    counts = QUICK_COUNTS if quick else COUNTS
    batches = {count: ours(count, robot_steps) for count in counts}
    rough = ours(compared, robot_steps, terrain=rough_ground(SEGMENTS))
    single = Runner(MUJOCO, QUICK_STEPS if quick else STEPS)
    runners: dict[str, Runner | VectorRunner] = {str(n): batch for n, batch in batches.items()}
    runners |= {"rough": rough, MUJOCO: single}
    threads = sorted({1, cores()}) if ENVPOOL_RUNS else []
    runners |= {f"envpool {n}": theirs(compared, n, peer_episode) for n in threads}
    rates = take_turns({name: runner.play for name, runner in runners.items()}, rounds)
    kind = type(rough.venv.unwrapped).__name__
    for runner in (*batches.values(), rough):
        runner.venv.close()
    single.env.close()
    peers = [MUJOCO, *(f"envpool {n}" for n in threads)]
    return {
        "vector_environment": kind,
        "compared": compared,
        "batches": [
            {"count": n, "steps_per_second": median(rates[str(n)]), "rounds": rates[str(n)]}
            for n in counts
        ],
        "rough": {"steps_per_second": median(rates["rough"]), "rounds": rates["rough"]},
        "peers": [
            {
                "name": peer,
                "threads": 1 if peer == MUJOCO else int(peer.split()[1]),
                "count": 1 if peer == MUJOCO else compared,
                "steps_per_second": median(rates[peer]),
                "rounds": rates[peer],
                **ratio(rates[str(compared)], rates[peer]),
            }
            for peer in peers
        ],
        "memory": memory(QUICK_MEMORY_COUNTS if quick else MEMORY_COUNTS),
    }


def memory(counts: tuple[int, ...]) -> list[dict[str, float]]:
    """Bytes that each of so many robots adds to a fresh process; empty where that is not told."""
    if sys.platform != "linux":
        return []
    return [
        {"count": n, "bytes": float(fresh(MEMORY.format(env_id=OURS, count=n))[0])} for n in counts
    ]


def report(result: dict[str, Any]) -> str:
    """The result as tables."""

    def row(name: str, count: int, found: dict[str, Any]) -> tuple[str, ...]:
        rates = found["steps_per_second"], min(found["rounds"]), max(found["rounds"])
        return (name, str(count), *(f"{rate:,.0f}" for rate in rates))

    compared, peers = result["compared"], result["peers"]
    rows = [row("flat", batch["count"], batch) for batch in result["batches"]]
    rows.append(row("rough", compared, result["rough"]))
    rows += [row(title(peer), peer["count"], peer) for peer in peers]
    ratios = [
        (
            f"{compared} robots / {title(peer)}", f"{peer['ratio']:.2f}",
            f"{peer['range'][0]:.2f} to {peer['range'][1]:.2f}",
        )
        for peer in peers
    ]  # fmt: skip
    parts = [
        f"{OURS} as `gym.make_vec` makes it: `{result['vector_environment']}`.",
        table(("environments", "at once", "steps/s", "lowest", "highest"), rows),
        table(("ratio", "steps/s", "by round"), ratios),
    ]
    if result["memory"]:
        sizes = [(str(m["count"]), f"{m['bytes'] / 1024.0:.1f}") for m in result["memory"]]
        parts.append(table(("robots", "memory of each, KiB"), sizes))
    return "\n\n".join(parts)


def title(peer: dict[str, Any]) -> str:
    """How a peer is called."""
    if peer["name"] == MUJOCO:
        return MUJOCO
    threads = peer["threads"]
    return f"envpool {MUJOCO}, {threads} thread{'s' if threads > 1 else ''}"


def goals(result: dict[str, Any]) -> list[Goal]:
    """Where the ratios should be; envpool on all cores."""
    found = [Goal(f"{result['compared']} robots, steps/s over {MUJOCO}'s",
                  result["peers"][0]["ratio"], "at least", 12.0)]  # fmt: skip
    if len(result["peers"]) > 1:
        most = max(result["peers"][1:], key=lambda peer: int(peer["threads"]))
        found.append(Goal(f"{result['compared']} robots, steps/s over {title(most)}",
                          most["ratio"], "at least", 5.0))  # fmt: skip
    return found
