"""How much of the terrain is walkable? If the policy fails, a search looks for a way across.

Run the example as follows:

    python examples/find_a_way.py [ENV] [LEVELS] [EPISODES] [COPIES]

The defaults are JansenWalkerRough-v0, the levels 4,7,9, 40 episodes per level and 64 copies. With
0 copies, there is no search.

The pretrained policy walks each episode once. It also walks each episode ten times with a little
noise, which shows how much of its success is luck. If the policy fails, copies of the robot walk
from the same initial state with noisy actions. Every half second, the copies that are behind
continue from the states of the copies that are ahead. If a copy succeeds, the robot can cross this
terrain with the torque that it has.
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
# Searches per failed episode; control steps for which the noise is held; control steps between two
# selections; fraction of the copies that a selection keeps.
TRIES, HOLD, SEGMENT, SHARE = 3, 5, 25, 0.25
# Standard deviation of the policy's noise, as a fraction of the torque limit; walks with noise.
NOISE, REPEATS = 0.01, 10
policy = pretrained.load(ENV)
env = gym.make(ENV)
success = find_benchmark(ENV).metrics["success"].function


def search(envs, seed, command, level, rng):
    """Return whether a copy stays upright and covers at least 80 % of the commanded distance."""
    options = {"speed_command": np.full(copies, command), "terrain_level": np.full(copies, level)}
    observations, infos = envs.reset(seed=[int(seed)] * copies, options=options)
    steps = env.spec.max_episode_steps
    way = 0.8 * abs(command) * steps * envs.unwrapped.control_dt
    start, alive = infos["x_position"].copy(), np.ones(copies, bool)
    scale = np.linspace(0.0, 1.0, copies) ** 2  # scale of the noise; the first copy has none
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
    """Policy with a little noise in its actions."""

    def predict(self, observations, *_):
        """Return noisy actions and no state."""
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
    print(
        f"level {level}: policy {walked.mean():.2f}, with noise {np.mean(noisy):.2f}, "
        f"at least once in {REPEATS} {np.max(noisy, 0).mean():.2f}, "
        f"always {np.min(noisy, 0).mean():.2f}",
        flush=True,
    )
    if copies == 0:
        continue
    failed = np.flatnonzero(walked < 1)
    ways = 0
    for i in failed:
        tries = (search(envs, seeds[i], commands[i], level, rng) for _ in range(TRIES))
        ways += any(tries)
    bound = 1 - (len(failed) - ways) / episodes
    print(
        f"level {level}: policy {walked.mean():.2f}, {ways} of {len(failed)} failures "
        f"have a way, so at least {bound:.2f} can be walked",
        flush=True,
    )
