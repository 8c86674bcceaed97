"""How much of the terrain can be walked at all? A search finds a way where the policy fails.

python examples/find_a_way.py [ENV] [LEVELS] [EPISODES] [COPIES]
    (JansenWalkerRough-v0, levels 4,7,9, 40 episodes each, 64 copies; 0 for no search)

The shipped policy walks each episode once, and ten times with a little noise, which tells how much
of it is luck. Where it does not succeed, copies of the robot walk
from the same start with noisy actions; every half second those behind go on from where those ahead
are. One that succeeds proves that this robot can walk this terrain with its torque.
"""

import sys

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401
from jansen_env.policies import pretrained
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import draw_episodes, run_episodes

defaults = ["JansenWalkerRough-v0", "4,7,9", "40", "64"]
ENV, levels, *numbers = sys.argv[1:] + defaults[len(sys.argv) - 1 :]
episodes, copies = (int(number) for number in numbers)
TRIES, HOLD, SEGMENT, SHARE = 3, 5, 25, 0.25  # of noise, control steps; the share that is kept
NOISE, REPEATS = 0.01, 10  # of the torque limit, standard deviation; runs with it
policy = pretrained.load(ENV)
env = gym.make(ENV)
success = find_benchmark(ENV).metrics["success"].function


def search(envs, seed, command, level, rng):
    """Return whether a copy succeeds: it does not fall, and covers 0.8 of the commanded way."""
    options = {"speed_command": np.full(copies, command), "terrain_level": np.full(copies, level)}
    observations, infos = envs.reset(seed=[int(seed)] * copies, options=options)
    steps = env.spec.max_episode_steps
    way = 0.8 * abs(command) * steps * envs.unwrapped.control_dt
    start, alive = infos["x_position"].copy(), np.ones(copies, bool)
    scale = np.linspace(0.0, 1.0, copies) ** 2  # of the noise: the first copy has none
    for step in range(1, steps + 1):
        if step % HOLD == 1:
            noise = rng.normal(0.0, 1.0, copies) * scale
        actions = policy.predict(observations)[0] + noise[:, None]
        observations, _, ended, _, infos = envs.step(np.clip(actions, -1, 1).astype(np.float32))
        ahead = (infos["x_position"] - start) * np.sign(command)
        alive &= ~ended
        if not alive.any():
            return False
        if step % SEGMENT == 0 and step < steps:
            order = np.argsort(np.where(alive, ahead, -np.inf))[::-1]
            best = order[: max(1, min(int(SHARE * copies), alive.sum()))]
            states = [envs.unwrapped.get_state(int(i)) for i in best]
            for k, i in enumerate(order[len(best) :]):
                observations[i] = envs.unwrapped.set_state(int(i), states[k % len(best)])
                alive[i] = True
    return bool((alive & (ahead >= way)).any())


class NoisyPolicy:
    """The policy with a little noise in its actions."""

    def predict(self, observations, *_):
        actions = policy.predict(observations)[0]
        actions += rng.normal(0.0, NOISE, actions.shape).astype(np.float32)
        return np.clip(actions, -1, 1), None


rng = np.random.default_rng(0)
envs = gym.make_vec(ENV, max(copies, 1), info_keys=("x_position",))
for level in (int(text) for text in levels.split(",")):
    commands, seeds = draw_episodes(env, episodes)
    options = {"terrain_level": np.full(episodes, level)}
    walked, *noisy = (
        success(run_episodes(walker, ENV, {}, commands, seeds, options=options), env)
        for walker in (policy, *[NoisyPolicy()] * REPEATS)
    )
    print(f"level {level}: policy {walked.mean():.2f}, with noise {np.mean(noisy):.2f}, "
          f"at least once in {REPEATS} {np.max(noisy, 0).mean():.2f}, "
          f"always {np.min(noisy, 0).mean():.2f}", flush=True)  # fmt: skip
    if copies == 0:
        continue
    failed = np.flatnonzero(walked < 1)
    ways = 0
    for i in failed:
        tries = (search(envs, seeds[i], commands[i], level, rng) for _ in range(TRIES))
        ways += any(tries)
    bound = 1 - (len(failed) - ways) / episodes
    print(f"level {level}: policy {walked.mean():.2f}, {ways} of {len(failed)} failures "
          f"have a way, so at least {bound:.2f} can be walked", flush=True)  # fmt: skip
