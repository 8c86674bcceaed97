"""RLlib trains one policy with several processes."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

if find_spec("ray") is None:  # not imported: it reads how it is to authenticate when it is
    pytest.skip("Ray is not installed; the extra 'distributed' brings it", allow_module_level=True)
pytest.importorskip("tree", reason="dm-tree is not installed; the extra 'distributed' brings it")

EXAMPLE = Path(__file__).parents[2] / "examples" / "rllib_ppo.py"
STEPS = 5_000
SMALL = ["--env", "JansenCrank-v0", "--steps", str(STEPS), "--envs", "6", "--runners", "2",
         "--learners", "2"]  # fmt: skip


@pytest.mark.slow
def test_the_example_trains_and_scores(tmp_path: Path) -> None:
    environment = {
        **os.environ, "SDL_VIDEODRIVER": "dummy", "RAY_AUTH_MODE": "token",
        "RAY_USAGE_STATS_ENABLED": "0",
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, EXAMPLE, *SMALL], cwd=tmp_path, env=environment, text=True,
        capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    *iterations, last = done.stdout.splitlines()
    steps = [
        int(n.replace(",", "")) for n in re.findall(r"([\d,]+) steps, ", "\n".join(iterations))
    ]
    assert steps[0] < STEPS <= steps[-1] and steps == sorted(set(steps))
    assert re.match(r"ppo: return -?\d+, pid: return \d+$", last)
