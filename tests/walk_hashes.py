"""Print hashes of walks, alone and in batches, under the shipped policies:

python tests/walk_hashes.py
"""

import hashlib
import json

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401 - which registers the environments
from jansen_env.policies.pretrained import load

STEPS, ROBOTS = 200, 4
WALKS = {
    "walker": ("JansenWalker-v0", {}),
    "built": ("JansenWalkerBuilt-v0", {}),
    "rough": ("JansenWalkerRough-v0", {}),
    "hardcore": ("JansenWalkerHardcore-v0", {}),
    "goal": ("JansenGoal-v0", {}),
    "crank": ("JansenCrank-v0", {}),
    "strider on a slope": ("JansenWalkerBuilt-v0", {"robot": "strider", "terrain": "slope:0.1"}),
    "waves": ("JansenWalkerRough-v0", {"terrain": "waves"}),
    "waves with a load": ("JansenWalkerRough-v0", {"terrain": "waves", "payload": 2.0}),
}


def walk(env, env_id):
    """Return the hash of all that an environment tells in a walk, of one robot or many."""
    digest, policy = hashlib.sha256(), load(env_id).on(env)
    seen, _ = env.reset(seed=0)
    for _ in range(STEPS):
        seen, *results, _ = env.step(policy.predict(seen)[0])
        for each in (seen, *results):
            digest.update(np.ascontiguousarray(each).tobytes())
        if isinstance(env, gym.Env) and (results[1] or results[2]):
            seen, _ = env.reset()  # a batch does that itself
    env.close()
    return digest.hexdigest()[:16]


def main():
    """Print as JSON: name of a walk to its hashes, alone and in a batch."""
    hashes = {}
    for name, (env_id, arguments) in WALKS.items():
        alone, batch = gym.make(env_id, **arguments), gym.make_vec(env_id, ROBOTS, **arguments)
        hashes[name] = [walk(alone, env_id), walk(batch, env_id)]
    print(json.dumps(hashes, indent=2))


if __name__ == "__main__":
    main()
