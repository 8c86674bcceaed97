"""A small study, and commands in processes of their own."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml
from small_runs import same

from agents.studies import plan as study_plan
from agents.studies import run as study_run
from agents.studies.plan import make_study
from jansen_env.sb3.model_files import read_model

ROOT = Path(__file__).parents[1]
SMALL = {
    "seeds": 2,
    "envs": ["JansenCrank-v0"],
    "timesteps": 512,
    "n_envs": 4,
    "env_kwargs": {"max_episode_steps": 16},
    "eval_freq": 256,
    "save_freq": 128,
    "eval_episodes": 1,
    "variants": {
        name: {
            "hyperparameters": {"n_steps": 16, "batch_size": 64, "n_epochs": 1, **more},
            "policy_kwargs": {"net_arch": [8]},
        }
        for name, more in {"plain": {}, "quick": {"learning_rate": 0.01}}.items()
    },
}
"""Four runs of four rollouts each, of a second together."""


def command(plan, folder, *more):
    """The study of a plan as a command, in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "small.yml").write_text(yaml.safe_dump(plan))
    return ["-m", "agents.study", str(folder / "small.yml"), "--log-folder", str(folder), *more]


def start(arguments, **environment):
    """A command begun in a process of its own; it prints to a file, as an unread pipe fills up."""
    printed = tempfile.TemporaryFile("w+")  # noqa: SIM115
    process = subprocess.Popen(
        [sys.executable, *arguments], cwd=ROOT, env={**os.environ, **environment},
        stdout=printed, stderr=subprocess.STDOUT,
    )  # fmt: skip
    process.printed = printed
    return process


def output(process):
    """All that a command of :func:`start` has printed."""
    process.printed.seek(0)
    return process.printed.read()


def perform_here(plan, folder):
    """The study's runs, one after another in this process."""
    made = make_study(plan)
    study_plan.enter(folder, made)
    (folder / study_run.TOKEN).write_text("here")
    return made, [
        study_run.execute_run(
            study_run.RunRequest(run, made.eval_freq, made.save_freq, 1, 1, "python", "here")
        )
        for run in made.runs(folder)
    ]


def assert_same_results(folder, other):
    """Weights, optimisers and scores of all runs, bit for bit."""
    names = [path.relative_to(folder) for path in sorted(folder.glob("*/seed_*/*_model.zip"))]
    assert len(names) >= 2
    for name in names:
        assert same(read_model(folder / name), read_model(other / name)), name
    for path in folder.glob("*/seed_*/scores.json"):
        assert path.read_bytes() == (other / path.relative_to(folder)).read_bytes()


def wait_until(condition, driver=None, seconds=120.0):
    """What a condition gives once it holds, which is to be before a command ends."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert driver is None or driver.poll() is None, output(driver)
        assert time.monotonic() < end, "waited in vain" if driver is None else output(driver)
        time.sleep(0.02)
    return found


def running(pid):
    """Whether there is such a process, and it is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
