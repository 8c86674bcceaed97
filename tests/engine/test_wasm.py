"""The engine as WebAssembly gives the same bits in Node.js as the library does here."""

import gzip
import json
import shutil
import subprocess
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.engine import kernel
from jansen_env.policies.pretrained import load, names

HERE = Path(__file__).parent
ENVS = ("JansenWalker-v0", "JansenWalkerBuilt-v0", "JansenWalkerHardcore-v0", "JansenGoal-v0",
        "JansenCrank-v0")  # fmt: skip
STEPS = 40
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed"),
]


@pytest.fixture(scope="module")
def library():
    """The path of the engine as WebAssembly."""
    return kernel.built_library("wasm")


def ranges_of(arrays):
    """Memory of arrays, which may overlap: {first address: bytes}."""
    ranges = {}
    for array in sorted(arrays, key=lambda array: array.ctypes.data):
        begin, end = array.ctypes.data, array.ctypes.data + array.nbytes
        last = max(ranges, default=None)
        if last is not None and begin < last + ranges[last]:
            ranges[last] = max(ranges[last], end - last)
        else:
            ranges[begin] = array.nbytes
    return ranges


class Calls:
    """Calls of kernels: arguments, results, and memory before and after."""

    def __init__(self):
        self.calls, self.data = [], bytearray()

    def keep(self, ranges):
        """Keep what is in memory; returns where, for each range."""
        places = []
        for address, size in ranges.items():
            places.append(len(self.data))
            self.data += (kernel.ctypes.c_char * size).from_address(address).raw
        return places

    def call(self, made, *arguments):
        """In the place of Kernel.__call__."""
        pointers, arguments = [], kernel.flat(arguments)
        ranges = ranges_of([array for array in arguments if isinstance(array, np.ndarray)])
        firsts = sorted(ranges)
        filled = kernel.Slots(made)
        filled.fill(arguments)
        slots = filled.words
        for parameter in made.parameters:
            if parameter.ndim:
                number = np.searchsorted(firsts, slots[parameter.slot], "right") - 1
                offset = slots[parameter.slot] - firsts[number]
                pointers.append([parameter.slot, int(number), int(offset)])
        words = [str(word) for word in slots]
        ranges = {first: ranges[first] for first in firsts}
        before = self.keep(ranges)
        result = made.entry(filled.address)
        self.calls.append(
            {
                "symbol": made.symbol, "words": words, "pointers": pointers,
                "sizes": [*ranges.values()], "before": before, "after": self.keep(ranges),
                "result": None if result is None else float(result),
            }
        )  # fmt: skip
        return result


def test_it_is_small_and_imports_nothing(library):
    assert len(gzip.compress(library.read_bytes())) < 120_000
    script = "new WebAssembly.Instance(new WebAssembly.Module(fs.readFileSync(process.argv[1])))"
    subprocess.run(["node", "-e", script, library], check=True)


@pytest.mark.parametrize("env_id", ENVS)
def test_every_call_of_a_walk_has_the_same_result(env_id, library, monkeypatch, tmp_path):
    calls = Calls()
    monkeypatch.setattr(
        kernel.Kernel, "__call__", lambda made, *arguments: calls.call(made, *arguments)
    )
    with gym.make(env_id) as env:
        policy = load(env_id).on(env) if names(env_id) else None
        observation, _ = env.reset(seed=1)
        for _ in range(STEPS):
            action = policy.predict(observation)[0] if policy else np.float32([0.3])
            observation, *_ = env.step(action)
    assert len({call["symbol"] for call in calls.calls}) > 5
    (tmp_path / "calls.json").write_text(json.dumps(calls.calls))
    (tmp_path / "data").write_bytes(calls.data)
    command = ["node", HERE / "replay.mjs", library, tmp_path / "calls.json", tmp_path / "data"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert int(done.stdout) == len(calls.calls)
