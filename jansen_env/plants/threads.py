"""Threads that share the robots of a batch, and forks that wait for them."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from threading import Lock, RLock
from typing import Any, Protocol, TypeAlias
from weakref import WeakSet

import numpy as np

from jansen_env.arrays import Ints
from jansen_env.checks import positive_integer

ROBOTS_PER_THREAD = 16  # at least, or starting a thread takes longer than it saves
FIRST = 16  # robots that are moved while the other threads start
LAST = 4  # robots that the calling thread moves while the others come to an end
FORK_PATIENCE = 10.0  # s for which a fork waits for steps of other threads

Memory: TypeAlias = Any
"""Arrays that one thread alone uses."""
Move: TypeAlias = Callable[[int, Ints, int, Memory], tuple[bool, bool]]
"""Moves robots: a thread's number, all shares, the most robots, and memory; returns two flags."""


class Threads:
    """Number of threads that pays for some robots.

    Args:
        robots: how many. memory: makes the memory of one thread.
        threads: at most, a whole number above 0; None for as many as there are cores, or
            ``JANSEN_ENV_THREADS`` says, where that pays.
    """

    def __init__(self, robots: int, threads: int | None, memory: Callable[[], Memory]) -> None:
        self._robots, self._count = robots, count_threads(robots, threads)
        self._memory = [memory() for _ in range(self._count)]
        # The same arrays each time, which kernels know.
        self._shares = np.zeros((self._count + 1, 2), np.int64)
        self._alone, self._every = np.zeros((2, 2), np.int64), _alone(robots)
        self._others_move = False
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    def move(
        self, robots: int, move: Move, meanwhile: Callable[[], None] | None
    ) -> tuple[bool, bool]:
        """Share so many robots out, and call ``meanwhile``; whether any share set each flag.

        An error in any thread is raised here, after all have ended.
        """
        # What ``meanwhile`` moves would wait for the other threads to end.
        if meanwhile is None and (self._count == 1 or self._others_move):
            every = robots == self._robots
            self._alone[:] = self._every if every else _alone(robots)
            return move(0, self._alone, robots, self._memory[0])
        shares, count = self._shares, max(1, min(self._count, robots // ROBOTS_PER_THREAD))
        shares[:] = 0
        shares[:count], shares[-1] = _split(robots, count)

        def work(thread: int, most: int = robots) -> tuple[bool, bool]:
            return move(thread, shares, most, self._memory[thread])

        others = [self._threads().submit(work, thread) for thread in range(1, count)]
        first = False, False
        try:
            if meanwhile is not None:  # Python's lock would keep the other threads from starting
                first = work(0, FIRST)
                self._others_move = True
                meanwhile()
        finally:  # whatever happens here, nothing goes on in the background
            self._others_move = False
            try:
                last = work(0)
            finally:
                for other in others:
                    other.exception()  # waits; quicker than concurrent.futures.wait
        flags = [first, last, *(other.result() for other in others)]
        return any(far for far, _ in flags), any(diverged for _, diverged in flags)

    def _threads(self) -> ThreadPoolExecutor:
        """Return the other threads of this process: a forked one starts its own."""
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = os.getpid(), ThreadPoolExecutor(self._count - 1, "jansen")
        return self._pool[1]

    def close(self) -> None:
        """End the threads; a later :meth:`move` starts new ones."""
        if self._pool is not None and self._pool[0] == os.getpid():
            self._pool[1].shutdown(wait=False)
        self._pool = None


def _alone(robots: int) -> Ints:
    """Return the shares of one thread that moves so many robots."""
    return np.array([[0, robots], [robots, robots]])


def available_cores() -> int:
    """Processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def count_threads(robots: int, threads: int | None) -> int:
    """Return how many threads move so many robots."""
    if threads is not None:
        return min(positive_integer("threads", threads), robots)
    limit = os.environ.get("JANSEN_ENV_THREADS")
    if limit and not (limit.isdecimal() and int(limit)):
        raise ValueError(f"JANSEN_ENV_THREADS must be a whole number above 0, got {limit}")
    available = int(limit) if limit else available_cores()
    return max(1, min(available, robots // ROBOTS_PER_THREAD))


def _split(robots: int, threads: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Return the first and the end of each thread's robots, and of the last ones.

    A thread takes its own robots first, the same ones in each step: they are in its core's cache.
    Falling asleep until a thread ends takes as long as moving ten robots, so the calling thread
    keeps the last robots and ends after the others.
    """
    shared = robots - LAST if threads > 1 else robots
    bounds = [shared * thread // threads for thread in range(threads + 1)]
    return [*pairwise(bounds)], (shared, robots)


class Locked(Protocol):
    """Protocol of an object whose lock is held while it changes."""

    lock: Any


class Forks:
    """Forks of the process, which happen between steps.

    A child has one thread, the one that forked. A lock that another thread holds would never be
    released there, and what that thread was changing would stay half changed. So a fork waits until
    it holds the locks of all objects, for at most :data:`FORK_PATIENCE`. An object whose lock it
    does not get by then has a new lock in the child.
    """

    def __init__(self) -> None:
        self._objects: WeakSet[Locked] = WeakSet()
        self._held: list[Any] = []
        self._one_at_a_time = Lock()
        if hasattr(os, "register_at_fork"):  # not on Windows, where nothing forks
            os.register_at_fork(
                before=self._hold, after_in_parent=self._release, after_in_child=self._begin_child
            )

    def watch(self, locked: Locked) -> None:
        """Let forks wait for an object as long as it lives."""
        self._objects.add(locked)

    def _living(self) -> list[Locked]:
        while True:
            try:
                return list(self._objects)
            except RuntimeError:  # another thread has added one meanwhile
                continue

    def _hold(self) -> None:
        self._one_at_a_time.acquire()
        until = time.monotonic() + FORK_PATIENCE
        for locked in self._living():
            lock = locked.lock
            if lock.acquire(timeout=max(0.0, until - time.monotonic())):
                self._held.append(lock)

    def _release(self) -> None:
        while self._held:
            self._held.pop().release()
        self._one_at_a_time.release()

    def _begin_child(self) -> None:
        held = {id(lock) for lock in self._held}
        for locked in self._living():
            if id(locked.lock) not in held:
                locked.lock = RLock()
        self._release()


forks = Forks()
"""The forks of this process."""
