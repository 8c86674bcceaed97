"""Rollouts saved by the walking page, which are simulated again from the input of each step."""

import json
from contextlib import closing
from dataclasses import fields
from pathlib import Path

import numpy as np

from jansen_env.checks import entries, instance, named_errors, shown
from jansen_env.files import read_bounded
from jansen_env.robot import Robot
from jansen_env.robot.robot_file import robot_from_json
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import MOST_RECORDED, Recording
from jansen_env.viewer.web.page import check_size
from jansen_env.world.observations import Noise
from jansen_env.world.settings import Values

FORMAT = "jansen_env walk 1"
MAX_BYTES = 2**24  # largest size of a file
# Entries of a robot in a robot file. A page stores additional entries.
OF_ROBOT = {"format", "is", *(field.name for field in fields(Robot))}


def walk_again(path: str | Path) -> Recording:
    """Simulate a rollout that ``walk.html`` has saved to a file.

    The result is bit-identical to the rollout on the page.

    Args:
        path: Path of the file.

    Raises:
        ValueError: If the file is missing, is not a saved rollout, is too large for a page, or
            contains values that the environment rejects.
    """
    kinds = AttributeError, KeyError, RecursionError, TypeError
    with named_errors(f"{path} is not a saved rollout", *kinds):
        content = json.loads(read_bounded(path, MAX_BYTES))
        if (kind := instance("it", content, dict).get("format")) != FORMAT:
            raise ValueError(f"its format must be {FORMAT!r}, got {shown(kind)}")
        return _simulated(content)


def _simulated(content: Values) -> Recording:
    """Simulate and record a rollout from the content of its file."""
    start = content["start"]
    steps = entries("steps", content["steps"], "a list")
    if not 0 < len(steps) <= MOST_RECORDED:
        raise ValueError(f"it must have 1 to {MOST_RECORDED} steps, got {len(steps)}")
    parts = {name: value for name, value in content["robot"].items() if name in OF_ROBOT}
    robot = robot_from_json(parts)
    check_size([(robot, len(steps))])  # do not simulate what a page would reject
    noisy = any("noise_level" in step.get("changes", ()) for step in (start, *steps))
    env = JansenWalkerEnv(
        robot=robot,
        terrain=content["ground"],
        reset_noise_scale=0.0,
        terminate_when_fallen=False,
        noise=Noise() if noisy else None,
    )
    with closing(Recorder(env, instance("label", content["label"], str))) as recorder:
        env.reset(seed=0)
        env.set_parameters(**{**({"noise_level": 0.0} if noisy else {}), **start["changes"]})
        options = {"crank_angle": start["crank_angle"], "speed_command": start["command"]}
        recorder.reset(seed=start.get("seed", 0), options=options)
        for step in steps:
            env.set_parameters(command=step["command"], **step.get("changes", {}))
            for impulse in step.get("pushes", ()):
                env.push(impulse)
            recorder.step(np.array([step["action"]], dtype=float))
        return recorder.recording
