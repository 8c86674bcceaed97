"""Threads that share the robots of a batch."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from jansen_env.checks import positive_integer
from jansen_env.cores import available_cores

ROBOTS_PER_THREAD = 16  # at least, or starting a thread takes longer than it saves
FEWEST_AT_A_TIME = 4  # robots, moved by a thread before it takes the next ones

Share = Callable[[int, int, Any], tuple[bool, bool]]
"""Moves the robots from one index to another with a thread's memory; returns two flags."""


class Threads:
    """Number of threads that pays for some robots.

    Args:
        robots: how many. memory: makes the memory of one thread.
        threads: at most, a whole number above 0; None for as many as there are cores, or numba's
            own limit ``NUMBA_NUM_THREADS``, where that pays.
    """

    def __init__(self, robots: int, threads: int | None, memory: Callable[[], Any]) -> None:
        self._robots = robots
        self._count = count_threads(robots, threads)
        self._shares = _shares(robots, self._count)
        self._memory = [memory() for _ in range(self._count)]
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    @property
    def memory(self) -> Any:
        """Memory of one thread."""
        return self._memory[0]

    def move(
        self, robots: int, share: Share, meanwhile: Callable[[], None] | None
    ) -> tuple[bool, bool]:
        """Share so many robots out, and call ``meanwhile``; whether any share set each flag."""
        threads = max(1, min(self._count, robots // ROBOTS_PER_THREAD))
        shares = iter(self._shares if robots == self._robots else _shares(robots, threads))

        def work(after_one: Callable[[], None] | None = None) -> tuple[bool, bool]:
            one = other = False
            for first, last in shares:  # each thread takes the next one
                # Not a thread's own: what ``after_one`` places moves on the same threads meanwhile.
                memory = self._memory.pop()
                try:
                    found = share(first, last, memory)
                finally:
                    self._memory.append(memory)
                one, other = one or found[0], other or found[1]
                if after_one is not None:
                    after_one()
                    after_one = None
            if after_one is not None:
                after_one()
            return one, other

        waiting = [self._executor().submit(work) for _ in range(threads - 1)]
        try:
            # Not before the first robots: Python's lock would keep the other threads from starting.
            outcomes = [work(meanwhile)]
        finally:  # whatever happens here, nothing goes on in the background
            outcomes_of_others = [future.result() for future in waiting]
        outcomes += outcomes_of_others
        return any(one for one, _ in outcomes), any(other for _, other in outcomes)

    def close(self) -> None:
        """End the threads; a later :meth:`move` starts new ones."""
        if self._pool is not None and self._pool[0] == os.getpid():
            self._pool[1].shutdown()
        self._pool = None

    def _executor(self) -> ThreadPoolExecutor:
        """Return the threads of this process: a forked one starts its own."""
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = os.getpid(), ThreadPoolExecutor(self._count - 1, "jansen")
        return self._pool[1]


def count_threads(robots: int, threads: int | None) -> int:
    """Return how many threads move so many robots."""
    if threads is not None:
        return min(positive_integer("threads", threads), robots)
    limit = os.environ.get("NUMBA_NUM_THREADS", "")
    available = int(limit) if limit.isdecimal() else available_cores()
    return max(1, min(available, robots // ROBOTS_PER_THREAD))


def _shares(robots: int, threads: int) -> list[tuple[int, int]]:
    """Return the ranges of robots that threads take: ever fewer, so that all end together."""
    shares, first = [], 0
    while first < robots:
        size = max(FEWEST_AT_A_TIME, (robots - first) // (2 * threads)) if threads > 1 else robots
        shares.append((first, min(first + size, robots)))
        first += size
    return shares
