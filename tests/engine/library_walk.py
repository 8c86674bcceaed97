"""Write walks for ``walk_library.c``, and print their hashes on this platform:

python tests/engine/library_walk.py FOLDER
"""

import struct
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401 - which registers the environments
from jansen_env.engine import episode
from jansen_env.engine.kernel import Slots, flat

STEPS = 500
WALKS = {
    "built": ("JansenWalkerBuilt-v0", {}),
    "hardcore": ("JansenWalkerHardcore-v0", {}),
    "onboard": ("JansenWalkerHardcore-v0", {"observe": "onboard", "links_collide": True}),
    "paper": ("JansenWalker-v0", {"command_interval": 1.0, "restitution": 0.3}),
}


class Memory:
    """Blocks of memory, and the places of arrays in them."""

    def __init__(self, records):
        self.blocks = [records]

    def place(self, array):
        """Return block and offset of an array, which may be a part of the records."""
        records = self.blocks[0]
        address = array.__array_interface__["data"][0]
        offset = address - records.__array_interface__["data"][0]
        if 0 <= offset < records.nbytes:
            return 0, offset
        self.blocks.append(array)
        return len(self.blocks) - 1, 0


def hash_of(parts, value=14695981039346656037):
    """FNV-1a of bytes, 64 bits."""
    for byte in b"".join(parts):
        value = (value ^ byte) * 1099511628211 % 2**64
    return value


def write_walk(path, env_id, arguments):
    """Write a walk from its start on; return its hash here."""
    env = gym.make(env_id, terminate_when_fallen=False, **arguments).unwrapped
    env.reset(seed=1)
    world = env.task.world
    plant, records = world.plant, world.records
    queues, rows = np.array([[0, 1], [1, 1]]), np.zeros(1, np.int64)
    given = (
        0,
        queues,
        1,
        rows,
        world._actions,
        plant._untraced,
        plant._threads._memory[0],
        plant._arrays.designs,
        records.motions,
        world._kernel_episodes,
        world._observing,
    )
    values = flat(given)
    slots = Slots(episode.control_step)
    slots.fill(values)
    memory = Memory(records.data)
    words = [(-1, int(word)) for word in slots.words]
    places = {}
    for parameter, value in zip(episode.control_step.parameters, values, strict=True):
        if parameter.ndim > 0:
            words[parameter.slot] = places[parameter.name] = memory.place(value)
    robots = records.robots
    results = [
        (*places["observation"], world._observing.observation.nbytes),
        *(
            (*memory.place(part), size)
            for part, size in (
                (records.states, 64),
                (robots["reward"], 8),
                (robots["terminated"], 1),
            )
        ),
    ]
    actions = 0.3 * np.sin(np.arange(STEPS) / 30.0)  # to and fro
    with open(path, "wb") as file:
        file.write(struct.pack("<q", len(memory.blocks)))
        for block in memory.blocks:
            content = np.ascontiguousarray(block).tobytes()
            file.write(struct.pack("<q", len(content)) + content)
        numbers = [len(words), *(part for word in words for part in word)]
        numbers += [places["queues"][0], places["actions"][0], len(results)]
        numbers += [part for result in results for part in result] + [STEPS]
        file.write(struct.pack(f"<{len(numbers)}q", *numbers) + actions.tobytes())
    digest = 14695981039346656037
    for action in actions:
        env.step(np.array([action]))
        assert abs(world.x_position[0]) < 4.0  # within the ground that the walk knows
        parts = [env.task.observation.tobytes(), records.states.tobytes()]
        parts += [robots["reward"].tobytes(), robots["terminated"].tobytes()]
        digest = hash_of(parts, digest)
    return f"{digest:016x}"


def main(folder):
    """Write all walks into a folder, and print name and hash of each."""
    for name, (env_id, arguments) in WALKS.items():
        print(name, write_walk(Path(folder, f"{name}.walk"), env_id, arguments))


if __name__ == "__main__":
    main(sys.argv[1])
