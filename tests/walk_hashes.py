"""Compare walks bit for bit between versions of Python, in virtual environments of their own:

    python tests/walk_hashes.py python3.10 python3.11 python3.12 python3.13

Without arguments it prints the hashes of this Python's walks.
"""

import hashlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
STEPS = 100


def hash_of_walk(env_id, **arguments):
    """Return the hash of all observations and rewards of a walk under random torques."""
    import gymnasium as gym
    import numpy as np

    rng, digest = np.random.default_rng(0), hashlib.sha256()
    env = gym.make(env_id, disable_env_checker=True, **arguments)
    env.reset(seed=0)
    for _ in range(STEPS):
        observation, reward, *_, info = env.step(rng.uniform(-0.2, 0.8, 1).astype(np.float32))
        digest.update(observation.tobytes() + np.float64(reward).tobytes())
        digest.update(json.dumps(info["energy"]).encode())
    return digest.hexdigest()


def hashes():
    """Return the hashes of walks in all environments, of all robots, on both plants."""
    import gymnasium as gym

    from jansen_env import ROBOTS

    found = {env_id: hash_of_walk(env_id) for env_id in gym.registry if "Jansen" in env_id}
    for name in ROBOTS:
        found[name] = hash_of_walk("JansenWalker-v0", robot=name, randomize={"lengths": 0.02})
    loaded = {"robot": "klann", "payload": 2.0, "plant": "rigid_body"}
    return {**found, "rigid body": hash_of_walk("JansenWalker-v0", **loaded)}


def hashes_of(python, folder):
    """Return those of another Python, which installs this checkout into a folder."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    own = next(folder.glob("[bS]*/python*"))
    install = "-m", "pip", "install", "--quiet", "-c", "constraints.txt", "-e", "."
    subprocess.run([own, *install], cwd=ROOT, check=True)
    result = subprocess.run([own, __file__], cwd=folder, check=True, stdout=subprocess.PIPE)
    return json.loads(result.stdout)


def main():
    """Print the hashes of this Python's walks, or compare those of several Pythons."""
    pythons = sys.argv[1:]
    if not pythons:
        print(json.dumps(hashes()))
        return
    found = {}
    for python in pythons:
        with tempfile.TemporaryDirectory() as folder:
            found[python] = hashes_of(python, Path(folder))
    first, *others = found.values()
    differ = sorted({name for other in others for name in first if other[name] != first[name]})
    for name in differ:
        print(name, {python: own[name][:8] for python, own in found.items()})
    print(f"{len(first)} walks of {', '.join(pythons)}: {len(differ)} differ")
    sys.exit(bool(differ))


if __name__ == "__main__":
    main()
