"""RLlib trains one policy with several processes."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

if find_spec("ray") is None:  # not imported: it reads how it is to authenticate when it is
    pytest.skip("Ray is not installed; the group 'distributed' brings it", allow_module_level=True)
pytest.importorskip("tree", reason="dm-tree is not installed; the group 'distributed' brings it")

EXAMPLE = Path(__file__).parents[2] / "examples" / "rllib_ppo.py"
STEPS = 5_000
LONGEST = 600.0  # s, after which the processes of the learners wait for one another for ever
SMALL = f"--env JansenCrank-v0 --steps {STEPS} --envs 12 --runners 1 --learners 2".split()


@pytest.mark.slow
def test_the_example_trains_and_scores(tmp_path: Path) -> None:
    ray = {"RAY_AUTH_MODE": "token", "RAY_USAGE_STATS_ENABLED": "0"}
    environment = {**os.environ, "SDL_VIDEODRIVER": "dummy", **ray}
    command = [sys.executable, EXAMPLE, *SMALL]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, text=True, capture_output=True, timeout=LONGEST
    )
    assert done.returncode == 0, done.stderr
    iterations, _, last = done.stdout.strip().rpartition("\n")
    steps = [int(n.replace(",", "")) for n in re.findall(r"([\d,]+) steps, ", iterations)]
    assert steps[0] < STEPS <= steps[-1] and steps == sorted(set(steps))
    assert re.match(r"ppo: return -?\d+, pid: return \d+$", last)
