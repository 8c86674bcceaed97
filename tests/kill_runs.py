"""Kill a small run with SIGKILL again and again, and compare it with one that was left alone."""

import argparse
import os
import random
import signal
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a process with threads must not fork

import torch
from small_runs import go_on, outcome, same, small_run

from agents.training import callbacks

WRITES = 15  # files that a run writes before it is killed within a write, at most


def start(settings, folder: Path, in_write=None) -> int:
    """Let a run go on in a process of its own, with what is loaded and compiled here; its id."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            if in_write is not None:
                kill_in_write(*in_write)
            go_on(settings, folder)
            status = 0
        finally:
            os._exit(status)
    return child


def kill_in_write(number: int, moment: str, part: float) -> None:
    """Have this process killed within its ``number``-th write."""
    move, left = os.replace, [number]

    def replace(source, target):
        left[0] -= 1
        if left[0] == 0:
            if moment == "part":
                os.truncate(source, int(part * os.path.getsize(source)))
            if moment == "moved":
                move(source, target)
            os.kill(os.getpid(), signal.SIGKILL)
        move(source, target)

    os.replace = replace


def main(folder: Path, algo: str, kills: int, seed: int) -> None:
    """Kill as often as asked, then let the run end; a run that ends before gives way to another."""
    torch.set_num_threads(1)
    callbacks.EPISODES = 1
    rng, settings = random.Random(seed), small_run(algo)
    whole = folder / "whole"
    whole.mkdir(parents=True)
    go_on(settings, whole)  # loads and compiles
    begun = time.monotonic()
    assert os.waitpid(start(settings, other := new(folder)), 0)[1] == 0
    longest = time.monotonic() - begun
    expected = outcome(whole)
    assert same(outcome(other), expected), "two runs that were left alone differ"
    killed, runs, run = 0, 1, new(folder)
    while killed < kills or not (run / "final_model.zip").exists():
        within = None
        if killed < kills and rng.random() < 0.5:
            moment = rng.choice(["part", "whole", "moved"])
            within = (rng.randint(1, WRITES), moment, rng.random())
        child = start(settings, run, within)
        if killed < kills and within is None:
            time.sleep(rng.uniform(0.0, longest))
            os.kill(child, signal.SIGKILL)
        status = os.waitpid(child, 0)[1]
        assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0, "it failed"
        killed += os.WIFSIGNALED(status)
        buffers = [*run.glob("replay_buffer*.npz"), *run.glob(".part-*.npz")]
        assert len(buffers) <= 2, f"there are {buffers}"
        if not os.WIFSIGNALED(status) and killed < kills:
            assert same(outcome(run), expected), f"after {killed} kills it differs"
            runs, run = runs + 1, new(folder)
    assert same(outcome(run), expected), "it differs"
    print(f"{killed} kills of {runs} runs, each as if it had not been killed")


def new(folder: Path) -> Path:
    run = folder / str(len(list(folder.iterdir())))
    run.mkdir()
    return run


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="a new one, for the runs")
    parser.add_argument("--algo", choices=("ppo", "sac"), default="ppo")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="another number, other moments")
    args = parser.parse_args()
    main(args.folder, args.algo, args.kills, args.seed)
