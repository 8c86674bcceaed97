"""Create single robots, batches and Stable-Baselines3 environments with full type annotations.

Run the example as follows:

    python examples/typed_walk.py [STEPS]

STEPS is the number of control steps of 20 ms, 300 by default. The example calls the constructors of
the environments directly, so that type checkers know their arguments.
"""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from jansen_env import Robot, Terrain, built_robot
from jansen_env.sb3 import make_vec_env
from jansen_env.tasks.walking import JansenWalkerEnv, JansenWalkerVectorEnv
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import Recording


def walk(robot: Robot, terrain: Terrain, steps: int) -> Recording:
    """Walk with a constant torque and return the recording."""
    env = Recorder(JansenWalkerEnv(robot=robot, terrain=terrain, friction=0.7, speed_command=0.3))
    env.reset(seed=0)
    for _ in range(steps):
        *_, terminated, truncated, _ = env.step(np.full(1, 0.3, np.float32))
        if terminated or truncated:
            break
    return env.recording


def slide(frictions: NDArray[np.float64], steps: int) -> float:
    """Simulate robots with different friction; return how far the first one slid, in m."""
    envs = JansenWalkerVectorEnv(len(frictions), friction=frictions, info_keys=("slip",))
    envs.reset(seed=0)
    slid = 0.0
    torques = np.full((len(frictions), 1), 0.3, np.float32)
    for _ in range(steps):
        infos: dict[str, Any] = envs.step(torques)[-1]
        slid += float(infos["slip"][0].sum())
    return slid


steps = int(sys.argv[1]) if len(sys.argv) > 1 else 300
recording = walk(built_robot(), Terrain.slope(0.05), steps)
print(f"{recording.energy_of('motor_work').sum():.1f} J in {recording.steps} steps")
print(f"{slide(np.linspace(0.2, 1.0, 8), steps):.2f} m slid")
venv: VecEnv = make_vec_env("JansenWalkerBuilt-v0", 8, payload=0.5, speed_command=(0.1, 0.3))
print(f"{venv.num_envs} robots for Stable-Baselines3")
