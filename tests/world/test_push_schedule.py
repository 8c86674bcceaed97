"""Pushes: what arrives is what was named, when it was named."""

import numpy as np
import pytest

from jansen_env import Push
from jansen_env.engine.episode import look_up_pushes
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.world.push import MOST_PUSHES, add_push, push_settings

STEPS = 20  # time steps of a control step
STEP = 1e-3  # s
PERIOD = STEPS * STEP


def felt(push, schedules, control_steps, first=0, strength=1.0):
    """Impulses (control_steps, n, STEPS, 2) that robots get from control step ``first`` on.

    ``schedules``: pushes of each robot; robot i has the seed i, and random pushes if ``push`` has.
    """
    room = max(map(len, schedules))
    records = RobotRecords(len(schedules), 4, 4, pushes=room)
    settings = push_settings(push, STEP)
    robots = records.robots
    robots["seed"] = np.arange(len(schedules))
    robots["random_pushes"] = True
    robots["parameters"]["push_strength"] = strength
    impulses = np.zeros((control_steps, len(schedules), STEPS, 2))
    for i, schedule in enumerate(schedules):
        robots["scheduled"][i] = len(schedule)
        records.schedule[i, : len(schedule)] = np.reshape(schedule, (-1, 3))
        for k in range(control_steps):
            robots["elapsed"][i] = first + k
            one = slice(i, i + 1)
            pushed = look_up_pushes(robots[one], records.schedule[one], settings, impulses[k, i])
            assert pushed == impulses[k, i].any()
    return impulses


def of_time_steps(impulses, robot):
    """Of one robot, (control_steps * steps, 2)."""
    return impulses[:, robot].reshape(-1, 2)


def begins(impulses):
    """How many pushes begin, and the first time step of each."""
    on = (impulses != 0.0).any(axis=1)
    return np.flatnonzero(on & ~np.append(False, on[:-1]))


def test_a_scheduled_push_is_a_half_sine_that_adds_up_to_its_impulse():
    push = Push(0.0, duration=0.0875)
    impulses = of_time_steps(felt(push, [[(0.0513, 1.5, -0.7)]], 10), 0)
    assert impulses.sum(axis=0) == pytest.approx([1.5, -0.7], abs=1e-14)
    fine = np.linspace(0.0, 0.2, 200 * 1000 + 1)
    inside = (fine >= 0.0513) & (fine <= 0.0513 + 0.0875)
    force = np.pi / (2.0 * 0.0875) * np.sin(np.pi * (fine - 0.0513) / 0.0875) * inside
    middle = 0.5 * (force[1:] + force[:-1]) * np.diff(fine)
    shares = middle.reshape(200, 1000).sum(axis=1)
    np.testing.assert_allclose(impulses, shares[:, None] * [1.5, -0.7], atol=2e-6)


def test_scheduled_pushes_add_up_where_they_overlap_whatever_their_order():
    """The strength is that of random pushes."""
    late, early = (0.31, 1.0, 0.5), (0.27, -0.4, 0.1)
    impulses = felt(None, [[late], [early], [late, early]], 25, strength=0.25)
    np.testing.assert_allclose(impulses[:, 2], impulses[:, 0] + impulses[:, 1], atol=1e-16)
    assert impulses[:, 0].sum(axis=(0, 1)) == pytest.approx(late[1:])


def test_random_pushes_come_once_in_each_interval_and_end_in_it():
    push = Push((1.2, 0.4), duration=0.05, interval=0.5)
    all_impulses = felt(push, [[]] * 40, 250)  # ten intervals
    starts = []
    totals = []
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
    starts = np.array(starts)
    totals = np.array(totals).reshape(-1, 2)
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


def test_nobody_is_pushed_between_pushes():
    schedules = [[(0.5 * PERIOD, 1.0, 0.0)], []]
    assert felt(None, schedules, 1)[0, 0].any() and not felt(None, schedules, 30)[:, 1].any()
    assert not felt(None, schedules, 1, first=20).any()  # it is over


def test_a_longer_schedule_keeps_those_of_other_robots():
    records = RobotRecords(2, 4, 4, pushes=1)
    records.schedule[1, 0] = (0.1, 2.0, 3.0)
    records.states[:] = np.arange(16.0).reshape(2, 8)
    assert not records.make_room(1) and records.make_room(5)
    assert records.schedule.shape == (2, 5, 3)
    assert records.schedule[1].tolist() == [[0.1, 2.0, 3.0], *[[0.0] * 3] * 4]
    assert records.states.tolist() == np.arange(16.0).reshape(2, 8).tolist()


def test_a_new_push_replaces_those_that_are_over():
    """The rest keeps its order. A push is over at the end of its duration."""
    settings = push_settings(Push(0.0, duration=0.5), STEP)
    schedule = np.array([[0.0, 1.0, 2.0], [3.0, 3.0, 4.0], [0.5, 5.0, 6.0], [0.625, 7.0, 8.0]])
    new = np.array([1.0, 9.0, 10.0])
    expected = [schedule[1], schedule[3], new]
    np.testing.assert_array_equal(add_push(schedule, new, settings), expected)


def test_a_full_schedule_takes_a_push_once_another_one_is_over():
    settings = push_settings(Push(0.0, duration=0.5), STEP)
    schedule = np.tile([1.0, 0.1, 0.0], (MOST_PUSHES, 1))
    with pytest.raises(ValueError, match=f"at most {MOST_PUSHES} pushes that are not over"):
        add_push(schedule, np.array([1.25, 0.1, 0.0]), settings)
    schedule[3, 0] = 0.5
    assert len(add_push(schedule, np.array([1.25, 0.1, 0.0]), settings)) == MOST_PUSHES
