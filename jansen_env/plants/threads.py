"""Threads that share the robots of a batch."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Ints
from jansen_env.checks import positive_integer

ROBOTS_PER_THREAD = 16  # at least, or starting a thread takes longer than it saves
FIRST = 16  # robots that are moved while the other threads start
LAST = 4  # robots that the calling thread moves while the others come to an end

Memory: TypeAlias = tuple[NDArray[Any], ...]
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
        raise ValueError(f"JANSEN_ENV_THREADS is {limit}, must be a whole number above 0")
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
