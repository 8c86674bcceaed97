"""Signals and readers that go away, in processes of their own."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from agents.training import callbacks
from agents.training.process import HANGUP

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(not HANGUP, reason="Windows has no SIGHUP")
def test_nohup_is_respected():
    """Who has begun it with SIGHUP ignored wants it to go on when the terminal is closed."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with callbacks.StopOnSignal() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
        assert not stop.signal
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("buffered", ["", pytest.param("1", marks=pytest.mark.slow)])
def test_a_reader_that_goes_away_does_not_end_the_run(buffered, tmp_path):
    command = [
        sys.executable, "train.py", "--log-folder", str(tmp_path), "-n", "8", "--n-envs", "1",
        "--env", "JansenCrank-v0", "--config", str(tmp_path / "short.yml"), "--eval-freq", "0",
        "--eval-episodes", "1", "--tensorboard-log", "", "--no-progress",
    ]  # fmt: skip
    (tmp_path / "short.yml").write_text(
        "policy: MlpPolicy\ntimesteps: 8\nn_envs: 1\n"
        "hyperparameters: {n_steps: 8, batch_size: 8}\npolicy_kwargs: {net_arch: [4]}\n"
    )
    with subprocess.Popen(
        command, cwd=ROOT, env={**os.environ, "PYTHONUNBUFFERED": buffered},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as run:  # fmt: skip
        run.stdout.close()
        assert run.stderr.read() == "" and run.wait(120) == 0
    assert (tmp_path / "ppo" / "JansenCrank-v0_1" / "scores.json").is_file()


def test_second_signal_ends_at_once():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a background
    try:
        _send_one_signal()
    finally:
        signal.signal(signal.SIGINT, before)


def _send_one_signal():
    with callbacks.StopOnSignal() as stop:
        assert not stop.signal
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.signal == signal.SIGINT
        assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL
    assert signal.getsignal(signal.SIGINT) != signal.SIG_DFL
