"""Marks: what is allowed at each command, and by how much a policy misses it."""

from __future__ import annotations

import math

import numpy as np
from stable_baselines3.common.logger import configure

from agents import callbacks, marks
from agents.config import new_config
from agents.metrics import summarise
from agents.rollout import make_env, run_episodes
from agents.runs import read_evaluations, score
from agents.tasks import WALKER, Mark, Task
from agents.training import prepare

TASK = Task((0.1, 0.2), "m/s", {}, WALKER.metrics, {}, (
    Mark("falls", 0.0), Mark("slip_per_metre", 1.0, "profile"),
    Mark("slip_per_metre", 0.1, "pid", up_to=0.1), Mark("torque_change", 1.0),
))  # fmt: skip
COMMANDS = np.array([0.1, 0.2])
BASELINES = {
    "profile": {"slip_per_metre": np.array([0.2, math.nan])},
    "pid": {"slip_per_metre": np.array([0.5, 0.4])},
}


def test_limits_are_numbers_or_multiples_of_a_baseline():
    most = marks.limits(TASK, COMMANDS, BASELINES)
    expected = [[0.0, 0.0], [0.2, math.nan], [0.05, math.nan], [1.0, 1.0]]
    np.testing.assert_allclose(most, expected)


def test_what_is_missed_counts_by_its_share_and_at_most_once():
    most = marks.limits(TASK, COMMANDS, BASELINES)
    policy = {
        "falls": np.array([0.02, 0.5]),
        "slip_per_metre": np.array([0.06, 9.0]),
        "torque_change": np.array([0.9, math.nan]),
    }
    found = marks.shortfalls(TASK, policy, most)
    np.testing.assert_allclose(found, [[0.2, 1.0], [0.0, 0.0], [0.2, 0.0], [0.0, 1.0]])


def test_the_baseline_that_sets_the_marks_meets_its_own():
    env = make_env("JansenWalker-v0", {})
    policy = WALKER.baselines["profile"](env.unwrapped)
    run = run_episodes(policy, "JansenWalker-v0", {}, np.repeat([0.05, 0.4], 2), np.arange(4))
    own = marks.at_commands(WALKER, run, env)
    most = marks.limits(WALKER, np.array([0.05, 0.4]), {"profile": own, "pid": own})
    found = marks.shortfalls(WALKER, own, most)
    relative = [mark.baseline == "profile" for mark in WALKER.marks]
    assert not found[relative].any()
    summary = summarise(WALKER.metrics, run, env)
    for name, values in own.items():
        np.testing.assert_allclose(values, marks.from_summary(summary)[name])
    scores = {name: {**summary, "raw": run} for name in ("profile", "pid", "run")}
    text = marks.describe(WALKER, scores, "run")
    missed = int((found > 0.0).sum())
    assert f"{13 - missed} of 13 marks met" in text and text.count("at most") == missed
    env.close()


def test_an_evaluation_is_worth_its_return_less_what_it_misses(tmp_path, monkeypatch):
    monkeypatch.setattr(callbacks, "EPISODES", 1)
    monkeypatch.setattr(callbacks.Saver, "_shortfall", lambda *given: 2.0)
    model = prepare(new_config(n_envs=4, timesteps=512))
    saver = callbacks.Saver(tmp_path, 0, 0, "JansenWalker-v0", {"max_episode_steps": 5})
    model.set_logger(configure(format_strings=[]))
    saver.init_callback(model)
    saver.evaluate()
    [row] = read_evaluations(tmp_path)
    assert row["score"] == row["return"] - 2.0 * callbacks.SHORTFALL_PRICE == saver.best
    assert score({"return": 3.0}) == 3.0
