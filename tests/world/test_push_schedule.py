"""Pushes: what arrives is what was named, when it was named; the same for a robot alone or not."""

import numpy as np
import pytest

from jansen_env import Push
from jansen_env.world.push import Pushes

STEPS, STEP = 20, 1e-3  # of a control step, s
PERIOD = STEPS * STEP


def felt(pushes, control_steps, seeds, active=None):
    """Impulses (control_steps, n, steps, 2) that robots get from the start of an episode on."""
    n = len(seeds)
    active = np.ones(n, bool) if active is None else active
    impulses = np.zeros((control_steps, n, STEPS, 2))
    for k in range(control_steps):
        impulse = pushes.of_step(active, np.full(n, k), seeds)
        if impulse is not None:
            impulses[k] = impulse
    return impulses


def of_time_steps(impulses, robot):
    """Of one robot, (control_steps * steps, 2)."""
    return impulses[:, robot].reshape(-1, 2)


def begins(impulses):
    """How many pushes begin, and the first time step of each."""
    on = (impulses != 0.0).any(axis=1)
    return np.flatnonzero(on & ~np.append(False, on[:-1]))


def test_a_scheduled_push_is_a_half_sine_that_adds_up_to_its_impulse():
    pushes = Pushes(1, Push(0.0, duration=0.0875), STEPS, STEP)
    pushes.schedule(0, np.array([[0.0513, 1.5, -0.7]]), False)
    impulses = of_time_steps(felt(pushes, 10, np.array([3])), 0)
    assert impulses.sum(axis=0) == pytest.approx([1.5, -0.7], abs=1e-14)
    fine = np.linspace(0.0, 0.2, 200 * 1000 + 1)
    inside = (fine >= 0.0513) & (fine <= 0.0513 + 0.0875)
    force = np.pi / (2.0 * 0.0875) * np.sin(np.pi * (fine - 0.0513) / 0.0875) * inside
    middle = 0.5 * (force[1:] + force[:-1]) * np.diff(fine)
    shares = middle.reshape(200, 1000).sum(axis=1)
    np.testing.assert_allclose(impulses, shares[:, None] * [1.5, -0.7], atol=2e-6)


def test_scheduled_pushes_add_up_where_they_overlap_whatever_their_order():
    """A longer schedule keeps those of other robots; the strength is that of random pushes."""
    pushes, late, early = Pushes(3, None, STEPS, STEP), [0.31, 1.0, 0.5], [0.27, -0.4, 0.1]
    pushes.strength[:] = 0.25
    for robot, schedule in enumerate(([late], [early], [late, early])):
        pushes.schedule(robot, np.array(schedule), False)
    impulses = felt(pushes, 25, np.zeros(3, np.int64))
    np.testing.assert_allclose(impulses[:, 2], impulses[:, 0] + impulses[:, 1], atol=1e-16)
    assert impulses[:, 0].sum(axis=(0, 1)) == pytest.approx(late[1:])


def test_random_pushes_come_once_in_each_interval_and_end_in_it():
    push = Push((1.2, 0.4), duration=0.05, interval=0.5)
    pushes, seeds = Pushes(40, push, STEPS, STEP), np.arange(40)
    all_impulses = felt(pushes, 250, seeds)  # ten intervals
    starts, totals = [], []
    for robot in range(40):
        impulses = of_time_steps(all_impulses, robot)
        windows = impulses.reshape(10, -1, 2)
        totals.append(windows.sum(axis=1))
        # Two neighbours may follow one another without a pause.
        assert all(len(begins(window)) == 1 for window in windows)
        starts.append([begins(window)[0] * STEP for window in windows])
        for window in windows:
            on = np.flatnonzero(window.any(axis=1))
            assert 0.05 - STEP < (on[-1] - on[0] + 1) * STEP < 0.05 + 2.0 * STEP
    starts, totals = np.array(starts), np.array(totals).reshape(-1, 2)
    # Evenly: from the interval's begin up to where the push just fits, of either sign.
    assert starts.min() < 0.01 and 0.43 < starts.max() <= 0.45
    assert np.mean(starts) == pytest.approx(0.225, abs=4.0 * 0.45 / np.sqrt(12.0 * 400.0))
    for axis, largest in enumerate((1.2, 0.4)):
        assert np.abs(totals[:, axis]).max() <= largest
        assert np.abs(totals[:, axis]).max() > 0.97 * largest
        deviation = largest / np.sqrt(3.0)
        assert np.mean(totals[:, axis]) == pytest.approx(0.0, abs=4.0 * deviation / 20.0)
        assert np.std(totals[:, axis]) == pytest.approx(deviation, rel=0.1)
    drawn = np.column_stack([totals, starts.ravel(), np.roll(starts, 1, axis=0).ravel()])
    assert np.abs(np.corrcoef(drawn.T) - np.eye(4)).max() < 0.2


def test_nobody_is_pushed_between_pushes_nor_who_does_not_take_the_step():
    pushes = Pushes(2, None, STEPS, STEP)
    seeds, both = np.array([0, 1]), np.ones(2, bool)
    assert pushes.of_step(both, np.zeros(2, np.int64), seeds) is None  # there are none at all
    pushes.schedule(0, np.array([[0.5 * PERIOD, 1.0, 0.0]]), False)
    assert pushes.of_step(both, np.zeros(2, np.int64), seeds) is not None
    assert pushes.of_step(np.array([False, True]), np.zeros(2, np.int64), seeds) is None
    assert pushes.of_step(both, np.full(2, 20), seeds) is None  # it is over
    pushes.schedule(0, np.empty((0, 3)), True)
    assert pushes.of_step(both, np.zeros(2, np.int64), seeds) is None
    assert len(pushes.scheduled(0)) == 0
