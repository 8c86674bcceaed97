"""Robots that move together beside single ones: the same, bit for bit."""

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from jansen_env import Push, Terrain

ROUGH = Terrain.rough(np.random.default_rng(3), height=0.03, spacing=0.1, length=10.0, start=0.2)

WORLD = {
    "terrain": "mixed",
    "terrain_level": (0, 9),
    "randomize": {
        "friction": (0.4, 1.0),
        "payload": (0.0, 0.5),
        "payload_x": (-0.1, 0.1),
        "mass_scale": (0.9, 1.1),
        "damping_scale": (0.5, 2.0),
        "motor_strength": (0.8, 1.2),
        "tilt": (-0.05, 0.05),
        "delay": (0.0, 0.03),
    },
}
"""Ground and robot drawn at each reset."""
DISTURBED = {"height_scan": (0.4, 0.8, 5), "noise": {}, "push": Push((1.3, 0.5), 0.05, 0.2)}


def together(count, mode=AutoresetMode.NEXT_STEP, limit=None, **arguments):
    arguments |= {"autoreset_mode": mode, "max_episode_steps": limit}
    return gym.make_vec("JansenWalker-v0", count, **arguments)


def side_by_side(count, mode=AutoresetMode.NEXT_STEP, limit=None, each=None, **arguments):
    """Gymnasium's vector environment of single ones; ``each`` has further arguments of each."""

    def make(index):
        more = {} if each is None else each[index]
        return lambda: gym.make("JansenWalker-v0", max_episode_steps=limit, **arguments, **more)

    return gym.vector.SyncVectorEnv([make(i) for i in range(count)], autoreset_mode=mode)


def walk(env, steps=40):
    """(steps, ...) observations of one robot or many under one torque."""
    action = np.full(env.action_space.shape, 0.3, np.float32)
    return np.array([env.step(action)[0] for _ in range(steps)])


def rollout(policy, envs, steps, seed=0):
    """(n,) returns and motor work, J, of episodes side by side, which go on, and the last infos."""
    observation, _ = envs.reset(seed=seed)
    n = len(observation)
    memory = None
    on = np.ones(n, bool)
    returns = np.zeros(n)
    work = np.zeros(n)
    for k in range(steps):
        action, memory = policy.predict(observation, memory, np.full(n, k == 0))
        observation, reward, terminated, truncated, infos = envs.step(action)
        returns += on * reward
        work += on * np.abs(infos["energy"]["motor_work"])
        on &= ~(terminated | truncated)
    return returns, work, on, infos


def same(a, b, place="it"):
    """Check that nested values have the same types and bits; an assertion names the place."""
    assert type(a) is type(b), place
    if isinstance(a, dict):
        assert a.keys() == b.keys(), place
        return all(same(value, b[key], f"{place}.{key}") for key, value in a.items())
    if isinstance(a, np.ndarray) and a.dtype == object:
        return all(same(x, y, place) for x, y in zip(a, b, strict=True))
    assert np.array_equal(a, b) and getattr(a, "dtype", 0) == getattr(b, "dtype", 0), place
    return True


def compare(ours, theirs, steps, seed=7, scale=1.0):
    """Both walk alike, bit for bit; returns how many episodes ended."""
    rng = np.random.default_rng(seed)
    ends = 0
    a, info_a = ours.reset(seed=seed)
    b, info_b = theirs.reset(seed=seed)
    assert np.array_equal(a, b)
    same(info_a, info_b)
    for _ in range(steps):
        action = rng.uniform(-scale, scale, (ours.num_envs, 1)).astype(np.float32)
        *a, info_a = ours.step(action)
        *b, info_b = theirs.step(action)
        for x, y in zip(a, b, strict=True):
            assert np.array_equal(x, y) and x.dtype == y.dtype
        same(info_a, info_b)
        ends += int((a[2] | a[3]).sum())
    ours.close()
    theirs.close()
    return ends
