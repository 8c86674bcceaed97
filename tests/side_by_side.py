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


def random_walk(env, steps=60, seed=0):
    """Drive one robot with random actions.

    Args:
        env: The environment, whose reset is called where an episode ends.
        steps: Number of steps.
        seed: Seed of the actions.

    Returns:
        (steps, n + 1) observations and rewards, and the ``info`` of each step.
    """
    rng = np.random.default_rng(seed)
    rows = []
    infos = []
    for _ in range(steps):
        observation, reward, *ends, info = env.step(rng.uniform(-0.4, 0.8, 1).astype(np.float32))
        rows.append(np.append(observation, reward))
        infos.append(info)
        if any(ends):
            env.reset()
    return np.array(rows), infos


def compare(ours, theirs, steps, seed=7, actions=(-1.0, 1.0)):
    """Check that two vector environments of Gymnasium's move alike, bit for bit, and close them.

    Args:
        ours: The batch.
        theirs: Single environments that take turns.
        steps: Number of steps.
        seed: Seed of the resets and of the actions.
        actions: Range from which actions are sampled.

    Returns:
        How many episodes ended with a fall, and how many at the time limit.
    """
    rng = np.random.default_rng(seed)
    falls = limits = 0
    a, info_a = ours.reset(seed=seed)
    b, info_b = theirs.reset(seed=seed)
    assert np.array_equal(a, b)
    same(info_a, info_b)
    for _ in range(steps):
        action = rng.uniform(*actions, (ours.num_envs, 1)).astype(np.float32)
        *a, info_a = ours.step(action)
        *b, info_b = theirs.step(action)
        for x, y in zip(a, b, strict=True):
            assert np.array_equal(x, y) and x.dtype == y.dtype
        same(info_a, info_b)
        falls += int(a[2].sum())
        limits += int((a[3] & ~a[2]).sum())
    ours.close()
    theirs.close()
    return falls, limits


def compare_for_sb3(ours, theirs, steps, seed=7, actions=(-1.0, 1.0)):
    """Check that two ``VecEnv`` of Stable-Baselines3 move alike, as :func:`compare` does.

    Stable-Baselines3 rounds its own rewards to float32. It notes ``TimeLimit.truncated`` in each
    step, and its single environments have no monitor here, which would note ``episode``.
    """
    rng = np.random.default_rng(seed)
    falls = limits = 0
    ours.seed(seed)
    theirs.seed(seed)
    assert np.array_equal(ours.reset(), theirs.reset())
    for _ in range(steps):
        action = rng.uniform(*actions, (ours.num_envs, 1)).astype(np.float32)
        *a, infos_a = ours.step(action)
        *b, infos_b = theirs.step(action)
        a[1] = a[1].astype(np.float32)
        for x, y in zip(a, b, strict=True):
            assert np.array_equal(x, y) and x.dtype == y.dtype
        for ended, info_a, info_b in zip(a[2], infos_a, infos_b, strict=True):
            if ended:
                del info_a["episode"]
                limits += info_b["TimeLimit.truncated"]
                falls += not info_b["TimeLimit.truncated"]
            else:
                del info_b["TimeLimit.truncated"]
            same(info_a, info_b)
        for info_a, info_b in zip(ours.reset_infos, theirs.reset_infos, strict=True):
            same(info_a, info_b)
    ours.close()
    theirs.close()
    return falls, limits
