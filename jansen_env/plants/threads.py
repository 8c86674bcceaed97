"""Threads that share the robots of a batch, and forks of the process that wait for them."""

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

ROBOTS_PER_THREAD = 16  # with fewer robots, starting a thread takes longer than it saves
FIRST = 16  # number of robots that the calling thread moves while the other threads start
LAST = 4  # number of robots that the calling thread moves while the other threads finish
FORK_PATIENCE = 10.0  # longest time for which a fork waits for steps of other threads, in s

Memory: TypeAlias = Any
"""Arrays that only one thread uses."""
Move: TypeAlias = Callable[[int, Ints, int, Memory], tuple[bool, bool]]
"""Function that moves robots and returns two flags.

Its arguments are the number of the thread, the queues of all threads, the largest number of robots
to move, and the memory of the thread. The flags tell whether any robot has moved far, and whether
any robot has diverged.
"""


class Threads:
    """Threads among which the robots of a batch are distributed.

    Args:
        robots: Number of robots.
        threads: Largest number of threads, a whole number above 0. If None, it is the number of
            cores, or the value of the environment variable ``JANSEN_ENV_THREADS``, but not more
            than are useful for this number of robots.
        memory: Function that allocates the memory of one thread.
    """

    def __init__(self, robots: int, threads: int | None, memory: Callable[[], Memory]) -> None:
        self._robots = robots
        self._count = count_threads(robots, threads)
        self._memory = [memory() for _ in range(self._count)]
        # Kernels get the same arrays in every call, because they remember their arguments.
        self._queues = np.zeros((self._count + 1, 2), np.int64)
        self._alone = np.zeros((2, 2), np.int64)
        self._every = _alone(robots)
        self._others_move = False
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    def move(
        self, robots: int, move: Move, meanwhile: Callable[[], None] | None
    ) -> tuple[bool, bool]:
        """Distribute robots among the threads, and call ``meanwhile`` while they move.

        If an error occurs in a thread, it is raised here after all threads have finished.

        Args:
            robots: Number of robots to move.
            move: Function that moves the robots of one thread.
            meanwhile: Function that is called while the other threads move robots. None for no such
                function.

        Returns:
            Two flags: whether any robot has moved far, and whether any robot has diverged.
        """
        # Robots that ``meanwhile`` moves are moved on this thread alone. Otherwise they would wait
        # until the other threads have finished.
        if meanwhile is None and (self._count == 1 or self._others_move):
            every = robots == self._robots
            self._alone[:] = self._every if every else _alone(robots)
            return move(0, self._alone, robots, self._memory[0])
        queues = self._queues
        count = max(1, min(self._count, robots // ROBOTS_PER_THREAD))
        queues[:] = 0
        queues[:count], queues[-1] = _split(robots, count)

        def work(thread: int, most: int = robots) -> tuple[bool, bool]:
            return move(thread, queues, most, self._memory[thread])

        others = [self._threads().submit(work, thread) for thread in range(1, count)]
        first = False, False
        try:
            if meanwhile is not None:
                # While ``meanwhile`` runs, Python's global lock would keep the other threads from
                # starting. ``move`` releases the lock, so that they can start beforehand.
                first = work(0, FIRST)
                self._others_move = True
                meanwhile()
        finally:  # whatever happens here, no thread keeps running in the background
            self._others_move = False
            try:
                last = work(0)
            finally:
                for other in others:
                    other.exception()  # waits for the thread; faster than concurrent.futures.wait
        flags = [first, last, *(other.result() for other in others)]
        return any(far for far, _ in flags), any(diverged for _, diverged in flags)

    def _threads(self) -> ThreadPoolExecutor:
        """Return the other threads of this process. A forked process starts its own threads."""
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = os.getpid(), ThreadPoolExecutor(self._count - 1, "jansen")
        return self._pool[1]

    def close(self) -> None:
        """End the threads. A later call of :meth:`move` starts new ones."""
        if self._pool is not None and self._pool[0] == os.getpid():
            self._pool[1].shutdown(wait=False)
        self._pool = None


def _alone(robots: int) -> Ints:
    """Return the queues of a single thread that moves all robots."""
    return np.array([[0, robots], [robots, robots]])


def available_cores() -> int:
    """Return the number of CPU cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def count_threads(robots: int, threads: int | None) -> int:
    """Return the number of threads for a number of robots.

    Args:
        robots: Number of robots.
        threads: Largest number of threads. If None, it is the value of the environment variable
            ``JANSEN_ENV_THREADS`` or, if that is not set, the number of available cores.

    Raises:
        ValueError: If ``threads`` or ``JANSEN_ENV_THREADS`` is not a whole number above 0.
    """
    if threads is not None:
        return min(positive_integer("threads", threads), robots)
    limit = os.environ.get("JANSEN_ENV_THREADS")
    if limit and not (limit.isdecimal() and int(limit)):
        raise ValueError(f"JANSEN_ENV_THREADS must be a whole number above 0, got {limit}")
    available = int(limit) if limit else available_cores()
    return max(1, min(available, robots // ROBOTS_PER_THREAD))


def _split(robots: int, threads: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Return the first and the end index of each thread's robots, and of the last robots.

    A thread moves its own robots first. They are the same in each step, because their data is in
    the cache of its core. Waiting for a thread to finish takes as long as moving ten robots.
    Therefore the calling thread keeps the last robots to itself and finishes after the others.
    """
    shared = robots - LAST if threads > 1 else robots
    bounds = [shared * thread // threads for thread in range(threads + 1)]
    return [*pairwise(bounds)], (shared, robots)


class Locked(Protocol):
    """Protocol of an object whose lock is held while it changes."""

    lock: Any


class Forks:
    """Guard that lets the process fork only between steps.

    A child process has only the thread that forked. A lock that another thread holds would never be
    released in the child, and the data that this thread was changing would stay half changed.
    Therefore a fork waits until it holds the locks of all objects, for at most
    :data:`FORK_PATIENCE`. If it does not get the lock of an object in that time, the object gets a
    new lock in the child.
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
        """Make forks wait for an object as long as the object exists.

        Args:
            locked: Object whose lock is held while it changes.
        """
        self._objects.add(locked)

    def _living(self) -> list[Locked]:
        """Return the watched objects that still exist."""
        while True:
            try:
                return list(self._objects)
            except RuntimeError:  # another thread has added an object in the meantime
                continue

    def _hold(self) -> None:
        """Acquire the locks of all objects before a fork."""
        self._one_at_a_time.acquire()
        until = time.monotonic() + FORK_PATIENCE
        for locked in self._living():
            lock = locked.lock
            if lock.acquire(timeout=max(0.0, until - time.monotonic())):
                self._held.append(lock)

    def _release(self) -> None:
        """Release the locks after a fork."""
        while self._held:
            self._held.pop().release()
        self._one_at_a_time.release()

    def _begin_child(self) -> None:
        """Release the locks in the child, and replace those that could not be acquired."""
        held = {id(lock) for lock in self._held}
        for locked in self._living():
            if id(locked.lock) not in held:
                locked.lock = RLock()
        self._release()


forks = Forks()
"""Guard of the forks of this process."""
