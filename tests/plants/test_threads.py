"""Threads that share robots: errors arrive where they are called, and nothing is left behind."""

import threading
import time

import pytest

from jansen_env.plants.threads import Threads

ROBOTS = 64


@pytest.mark.parametrize("failing", [0, 1])
@pytest.mark.parametrize("meanwhile", [None, list])
def test_an_error_in_any_thread_arrives_and_the_others_end(failing, meanwhile):
    threads = Threads(ROBOTS, 2, object)
    ended = set()

    def move(thread, queues, most, memory):
        if thread == failing:
            raise ArithmeticError("lost")
        ended.add(thread)
        return False, True

    with pytest.raises(ArithmeticError, match="lost"):
        threads.move(ROBOTS, move, meanwhile)
    assert ended == {1 - failing}
    failing = None  # and they go on
    assert threads.move(ROBOTS, move, meanwhile) == (False, True)


def test_robots_move_whatever_happens_meanwhile():
    threads = Threads(ROBOTS, 2, object)
    ended = set()

    def move(thread, queues, most, memory):
        ended.add((thread, most))
        return False, False

    with pytest.raises(ZeroDivisionError):
        threads.move(ROBOTS, move, lambda: 1 / 0)
    assert {(0, ROBOTS), (1, ROBOTS)} < ended


def test_what_moves_meanwhile_does_not_wait_for_the_others():
    threads = Threads(ROBOTS, 2, object)
    done = threading.Event()

    def move(thread, queues, most, memory):
        return thread == 1 and not done.wait(10.0), False

    def meanwhile():
        threads.move(ROBOTS - 1, move, None)
        done.set()

    assert threads.move(ROBOTS, move, meanwhile) == (False, False)


def test_threads_end_with_their_robots():
    before = {*threading.enumerate()}
    threads = Threads(ROBOTS, 3, object)
    threads.move(ROBOTS, lambda *_: (False, False), None)
    started = {*threading.enumerate()} - before
    assert 1 <= len(started) <= 2
    del threads
    until = time.monotonic() + 10.0
    while {*threading.enumerate()} & started:
        assert time.monotonic() < until
        time.sleep(0.01)
