"""RLlib trains one policy with several processes, one of which is killed."""

import os
import re
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest

if find_spec("ray") is None:  # not imported: it reads how it is to authenticate when it is
    pytest.skip("Ray is not installed; the extra 'distributed' brings it", allow_module_level=True)
pytest.importorskip("tree", reason="dm-tree is not installed; the extra 'distributed' brings it")

EXAMPLE = Path(__file__).parents[2] / "examples" / "rllib_ppo.py"
STEPS = 18_000
SMALL = ["--env", "JansenCrank-v0", "--steps", str(STEPS), "--envs", "6", "--runners", "2",
         "--learners", "2"]  # fmt: skip


def env_runners(driver: int) -> set[int]:
    """Return the process ids of a driver's env runners."""
    found = set()
    for process in psutil.Process(driver).children(recursive=True):
        try:
            if "::SingleAgentEnvRunner" in " ".join(process.cmdline()):
                found.add(process.pid)
        except psutil.Error:  # it has just ended
            pass
    return found


@pytest.mark.slow
def test_training_survives_a_killed_env_runner(tmp_path: Path) -> None:
    """Kill -9 of one of two after the first iteration: training ends as planned, with a new one."""
    environment = {
        **os.environ, "SDL_VIDEODRIVER": "dummy", "RAY_AUTH_MODE": "token",
        "RAY_USAGE_STATS_ENABLED": "0",
    }  # fmt: skip
    errors = tmp_path / "errors.txt"
    with errors.open("w") as file, subprocess.Popen(
        [sys.executable, EXAMPLE, *SMALL], cwd=tmp_path, env=environment, text=True,
        stdout=subprocess.PIPE, stderr=file,
    ) as driver:  # fmt: skip
        assert driver.stdout is not None
        steps, before, after, last = [], set[int](), set[int](), ""
        for line in driver.stdout:
            if found := re.match(r"([\d,]+) steps, ", line):
                steps.append(int(found[1].replace(",", "")))
                after |= env_runners(driver.pid)
                if not before:
                    before = set(after)
                    os.kill(min(before), signal.SIGKILL)
            last = line
    assert driver.returncode == 0, errors.read_text()
    assert steps[0] < STEPS <= steps[-1] and steps == sorted(set(steps))
    assert len(before) == 2 and len(after) == 3, (before, after)
    assert re.match(r"ppo: return -?\d+, pid: return \d+$", last)
