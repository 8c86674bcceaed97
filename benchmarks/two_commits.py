"""Compare the speed of this checkout with that of an earlier commit, in one run.

Run the benchmark as follows. It writes ``two_commits.md``.

    python -m benchmarks.two_commits COMMIT [--rounds 5] [--out logs/two_commits]

The commit is checked out into a temporary folder, where its engine is built. Each version runs in
its own process, and the two processes take turns. Each figure is the shortest time of many short
stretches over all rounds, because a shared processor may be slow for seconds at a time. The table
shows the figures of both versions and their ratio.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
from tabulate import tabulate

from jansen_env.cli.flags import Parser, positive_int
from jansen_env.files import check_writable, write_text

ENVIRONMENTS = ("JansenWalkerBuilt-v0", "JansenWalkerRough-v0", "JansenWalkerHardcore-v0")
STRETCHES, STEPS = 200, 25  # stretches per round, and steps per stretch
ROBOTS = 256
ROOT = Path(__file__).parents[1]


def shortest(count: int, run: Callable[[], object]) -> float:
    """Call a function several times and return the shortest time, in s.

    Args:
        count: Number of calls.
        run: The function.
    """
    times = list[float]()
    for _ in range(count):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def measure() -> dict[str, float]:
    """Measure the times of steps and resets, in us, of the version of the package on the path."""
    import jansen_env  # noqa: F401 - registers the environments

    times = dict[str, float]()
    for name in ENVIRONMENTS:
        env = gym.make(name, terminate_when_fallen=False, disable_env_checker=True).unwrapped
        action = np.array([0.3], np.float32)
        env.reset(seed=0)

        def steps(env: gym.Env = env, action: np.ndarray = action) -> None:
            for _ in range(STEPS):
                env.step(action)

        times[f"{name}: step"] = 1e6 * shortest(STRETCHES, steps) / STEPS
        times[f"{name}: reset"] = 1e6 * shortest(STRETCHES, env.reset)
        envs = gym.make_vec(name, ROBOTS, threads=1, terminate_when_fallen=False)
        actions = np.full((ROBOTS, 1), 0.3, np.float32)
        envs.reset(seed=0)

        def batch(envs: gym.vector.VectorEnv = envs, actions: np.ndarray = actions) -> None:
            envs.step(actions)

        label = f"{name}: step of one of {ROBOTS}"
        times[label] = 1e6 * shortest(STRETCHES // 4, batch) / ROBOTS
        env.close()
        envs.close()
    return times


def run(folder: Path) -> dict[str, float]:
    """Return the result of :func:`measure` for the package in a folder.

    Args:
        folder: Folder that contains the package.
    """
    command = [sys.executable, str(Path(__file__)), "--measure"]
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    told: dict[str, float] = json.loads(done.stdout.strip().rpartition("\n")[2])
    return told


def main(arguments: list[str] | None = None) -> None:
    """Measure both versions and write the table."""
    parser = Parser(
        "python -m benchmarks.two_commits", __doc__, "python -m benchmarks.two_commits HEAD~1"
    )
    parser.add_argument("commit", help="a commit of this repository")
    parser.add_argument("--rounds", type=positive_int, default=5, help="default: 5")
    parser.add_argument("--out", type=Path, default=Path("logs/two_commits"))
    args = parser.parse_args(arguments)
    with parser.refusing():
        check_writable("--out", args.out)
    with tempfile.TemporaryDirectory() as scratch:
        earlier = Path(scratch, "earlier")
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(earlier), args.commit], check=True)
        try:
            rounds = list[tuple[dict[str, float], dict[str, float]]]()
            for number in range(args.rounds):
                if number % 2 == 0:
                    before = run(earlier)
                    rounds.append((before, run(ROOT)))
                else:
                    now = run(ROOT)
                    rounds.append((run(earlier), now))
        finally:
            subprocess.run([*git, "remove", "--force", str(earlier)], check=True)
    rows = list[list[str]]()
    for name in rounds[0][0]:
        old = min(pair[0][name] for pair in rounds)
        new = min(pair[1][name] for pair in rounds)
        rows.append([name, f"{old:.1f}", f"{new:.1f}", f"{old / new:.2f}"])
    head = ["", f"{args.commit} (µs)", "this checkout (µs)", "times as fast"]
    text = tabulate(rows, head, "github", disable_numparse=True)
    write_text(args.out / "two_commits.md", f"{text}\n")
    print(text)


if __name__ == "__main__":
    if sys.argv[1:] == ["--measure"]:
        print(json.dumps(measure()))
    else:
        main()
