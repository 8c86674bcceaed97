"""How much more return is possible than the pretrained policy achieves at each command?

Run the example as follows:

    python examples/headroom.py [ENV] [COMMANDS] [GENERATIONS] [STARTS]

The defaults are JansenWalkerBuilt-v0, all commands of its benchmark, 30 generations of 16
candidates, and 12 starts per candidate.

For each command separately, CMA-ES searches a torque that is added to the torque of the policy. It
consists of a constant, four even harmonics of the crank angle, and feedback of the crank speed,
pitch, pitch rate and lag. The best candidate is then compared with the policy on other starts. Its
return is achievable, so the highest possible return is at least as large. A reward is at most 1, so
the highest possible return is at most the number of steps.
"""

import sys

import cma
import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401
from jansen_env.policies import pretrained
from jansen_env.policies.policy import columns
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import make_envs, run_episodes

ENV = sys.argv[1] if len(sys.argv) > 1 else "JansenWalkerBuilt-v0"
grid = ",".join(map(str, find_benchmark(ENV).commands))
text, *numbers = sys.argv[2:] + [grid, "30", "12"][max(0, len(sys.argv) - 2) :]
GENERATIONS, STARTS = (int(number) for number in numbers)
POPULATION, SPREAD, HARMONICS, SEED, OTHERS = 16, 0.02, 4, 140_000, 48
SCALES = np.array([0.1, 1.0, 0.2, 1.0])  # scales of the feedback terms
policy, env = pretrained.load(ENV), gym.make(ENV)
COS, SIN, *FED = columns(
    env.unwrapped,
    "cos_crank_angle",
    "sin_crank_angle",
    "crank_speed",
    "sin_pitch",
    "pitch_rate",
    "lag",
)


class Corrected:
    """Policy with an additional torque: one row of 13 parameters per robot, shape (n, 13)."""

    def __init__(self, numbers):
        self.numbers = numbers

    def predict(self, seen, state=None, episode_start=None, deterministic=False):
        """Return the corrected actions and the unchanged state."""
        turn = ((seen[:, COS] + 1j * seen[:, SIN]) ** 2)[:, None] ** np.arange(1, HARMONICS + 1)
        terms = [np.ones((len(seen), 1)), turn.real, turn.imag, SCALES * seen[:, FED]]
        added = (self.numbers * np.concatenate(terms, axis=1)).sum(axis=1, keepdims=True)
        action = policy.predict(seen)[0] + added
        return np.clip(action, -1.0, 1.0).astype(np.float32), state


def returns(candidates, command, seeds, envs=None):
    """Return the mean return of each candidate over the initial states of the seeds."""
    n = len(candidates) * len(seeds)
    run = run_episodes(
        Corrected(np.repeat(candidates, len(seeds), axis=0)),
        ENV,
        {},
        np.full(n, command),
        np.tile(seeds, len(candidates)),
        at_once=n,
        envs=envs,
    )
    return run["returns"].reshape(len(candidates), -1).mean(axis=1)


print("| command | policy | searched | headroom (%) |\n| ---: | ---: | ---: | ---: |")
totals = []
with_envs = make_envs(ENV, {}, POPULATION * STARTS)
for command in (float(word) for word in text.split(",")):
    rng = np.random.default_rng(0)
    options = {
        "popsize": POPULATION,
        "verbose": -9,
        "seed": np.nan,
        "CMA_elitist": True,
        "randn": lambda *shape, rng=rng: rng.standard_normal(shape),
    }
    nothing = np.zeros(1 + 2 * HARMONICS + len(FED))
    search = cma.CMAEvolutionStrategy(nothing, SPREAD, options)
    search.inject([nothing], force=True)
    for _ in range(GENERATIONS):
        candidates = search.ask()
        search.tell(
            candidates, -returns(np.array(candidates), command, SEED + np.arange(STARTS), with_envs)
        )
    both = np.array([nothing, search.best.x])
    base, best = returns(both, command, SEED + STARTS + np.arange(OTHERS))
    totals.append((base, max(base, best)))
    print(f"| {command:g} | {base:.1f} | {best:.1f} | {100 * (best / base - 1):.1f} |", flush=True)
base, best = np.mean(totals, axis=0)
print(f"| all | {base:.1f} | {best:.1f} | {100 * (best / base - 1):.1f} |")
