"""Machines that lack what most have."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

WALK = """
import gymnasium as gym, jansen_env
env = gym.make("JansenWalkerBuilt-v0", render_mode="rgb_array")
env.reset(seed=0)
print(env.step([0.3])[1], env.render().shape)
"""
EVALUATION = "--policy pid --episodes 1 --commands 0.3"
TRAINING = "-n 512 --n-envs 2 --eval-freq 0 --eval-episodes 1 --env JansenCrank-v0"
RUNS = {
    "walk": ["-c", WALK],
    "replay": ["-m", "jansen_env", "replay", "--steps", "20", "--out", "a walk.html"],
    "evaluate": ["-m", "jansen_env", "evaluate", *EVALUATION.split()],
    "train": [str(Path(__file__).parents[1] / "train.py"), *TRAINING.split()],
}
pytestmark = pytest.mark.skipif(os.name != "posix", reason="they are POSIX's")
UNSET = ("DISPLAY", "HOME", "LANG", "LC_ALL", "MPLBACKEND", "SDL_VIDEODRIVER", "TERM", "TZ", "USER")
BARE = {name: value for name, value in os.environ.items() if name not in UNSET}
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TERM": "dumb"}


@pytest.mark.slow
@pytest.mark.parametrize("arguments", RUNS.values(), ids=RUNS)
def test_it_runs_where_almost_everything_is_missing(arguments, tmp_path):
    """No home, name of the user, display, terminal, locale, time zone or input; files that nobody
    else may read; spaces in paths."""
    folder = tmp_path / "a folder"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text("import pwd; pwd.getpwuid = {}.__getitem__")
    paths = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *arguments],
        env={**BARE, **ASCII, "PYTHONPATH": paths},
        cwd=folder,
        capture_output=True,
        umask=0o077,
        preexec_fn=partial(os.close, 0),
    )
    assert done.returncode == 0, done.stderr.decode()
    assert not any(word in done.stderr for word in (b"Traceback", b"Warning")), done.stderr.decode()
