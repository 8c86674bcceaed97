"""While another thread steps: copies and pickles are whole, and a forked child goes on."""

import copy
import gc
import os
import pickle
import signal
import threading
import time
import weakref

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.plants import threads
from jansen_env.plants.threads import forks
from jansen_env.sb3 import make_vec_env

ID = "JansenWalkerRough-v0"
ROBOTS = 32
PATIENCE = 20  # s for a child that takes a step


def single():
    return gym.make(ID, terminate_when_fallen=False).unwrapped


def many():
    """Robots on two threads, of which some start again in each step."""
    limits = [5 + i % 9 for i in range(ROBOTS)]
    envs = gym.make_vec(
        ID,
        ROBOTS,
        threads=2,
        max_episode_steps=limits,
        autoreset_mode="SameStep",
        terminate_when_fallen=False,
    )
    return envs.unwrapped


def for_stable_baselines3():
    variants = [{"max_episode_steps": 5 + i % 9} for i in range(ROBOTS)]
    return make_vec_env(ID, ROBOTS, variants=variants).unwrapped


KINDS = {"single": single, "many": many, "for Stable-Baselines3": for_stable_baselines3}


def actions(env):
    shape = env.action_space.shape
    batched = isinstance(env, gym.vector.VectorEnv) or not hasattr(env, "num_envs")
    return np.full(shape if batched else (env.num_envs, *shape), 0.4, np.float32)


def walk(env, steps):
    """Observations of some steps."""
    return [env.step(actions(env))[0] for _ in range(steps)]


class Walking:
    """A thread that steps an environment for as long as the block lasts, and all it observes."""

    def __init__(self, env):
        self.env = env
        self.seen = []
        self.on = True
        self.thread = threading.Thread(target=self.go_on)

    def go_on(self):
        while self.on:
            self.seen += walk(self.env, 1)

    def __enter__(self):
        self.thread.start()
        self.wait(3)
        return self

    def wait(self, steps):
        """Wait until as many steps were taken."""
        while len(self.seen) < steps:
            time.sleep(0.001)

    def __exit__(self, *_):
        self.on = False
        self.thread.join()


def begin(kind):
    """An environment whose next steps are always the same."""
    env = KINDS[kind]()
    env.seed(3) if kind == "for Stable-Baselines3" else env.reset(seed=3)
    if kind == "for Stable-Baselines3":
        env.reset()
    return env


def check_are_of(walked, parts):
    """Check that observations of some steps, with which copies went on, are part of a walk."""
    for part in parts:
        start = next(k for k, seen in enumerate(walked) if np.array_equal(seen, part[0]))
        assert np.array_equal(part, walked[start : start + len(part)])


def through_pickle(env):
    return pickle.loads(pickle.dumps(env))


@pytest.mark.slow
@pytest.mark.parametrize("duplicate", [copy.deepcopy, through_pickle], ids=["copy", "pickle"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_copy_goes_on_from_between_two_steps(kind, duplicate):
    """Copies continue bit for bit as the environment does, from whichever step they were made
    after.
    """
    env = begin(kind)
    with Walking(env) as walking:
        copies = []
        for _ in range(8):
            copies.append(duplicate(env))
            time.sleep(0.002)
        walking.wait(20)
    check_are_of(walking.seen + walk(env, 10), [walk(copied, 4) for copied in copies])


def child_of(work):
    """Fork; return what the child's exit status is after ``work``, None if it does not end."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            status = 0 if work() else 2
        finally:
            os._exit(status)
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


forking = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")


@pytest.mark.slow
@forking
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_a_child_goes_on_from_between_two_steps(kind, tmp_path):
    """A child steps at once, and observes what the parent does after the same number of steps."""
    env = begin(kind)
    with Walking(env) as walking:
        for k in range(6):
            file = tmp_path / f"{k}.npy"
            assert child_of(lambda file=file: np.save(file, walk(env, 4)) is None) == 0
            time.sleep(0.002)
        walking.wait(20)
    check_are_of(walking.seen + walk(env, 10), map(np.load, tmp_path.glob("*.npy")))


@forking
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_fork_waits_for_no_lock_for_ever(monkeypatch):
    """The thread that holds a lock may wait for the fork: the child gets another lock, the parent
    keeps it.
    """
    monkeypatch.setattr(threads, "FORK_PATIENCE", 0.05)
    env, other = single(), single()
    env.reset(seed=1), other.reset(seed=1)
    held, forked = threading.Event(), threading.Event()

    def hold():
        with env.task.lock:
            held.set()
            forked.wait(PATIENCE)

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait()
    lock = env.task.lock
    assert child_of(lambda: np.array_equal(walk(env, 2), walk(other, 2))) == 0
    forked.set()
    thread.join()
    assert env.task.lock is lock
    walk(env, 1)
    assert not forks._held and child_of(lambda: len(walk(env, 1)) == 1) == 0  # and again


@forking
def test_a_fork_within_a_step_does_not_wait_for_it():
    env = single()
    env.reset(seed=1)
    with env.task.lock:
        assert child_of(lambda: len(walk(env, 1)) == 1) == 0


def test_forks_let_go_of_environments():
    env = single()
    task = weakref.ref(env.task)
    assert task() in forks._living()
    del env
    gc.collect()
    assert task() is None


def test_attributes_that_refer_to_an_environment_refer_to_its_copy():
    env = gym.make("JansenCrank-v0").unwrapped
    env.reset(seed=0)
    env.itself = env
    env.call_me = env.get_state
    for copied in (copy.deepcopy(env), through_pickle(env)):
        assert copied.itself is copied and copied.call_me.__self__ is copied
        assert copied.task is not env.task and copied.task.lock is not env.task.lock
