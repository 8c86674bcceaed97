"""Baselines of the walkers: a PID, constant torque, and a crank-speed profile.

They read the observation only. The crank speed (or torque) for a commanded speed is measured on
each robot (``python -m agents.tune``); so are the gains, but for the paper's on the paper's robot.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeAlias

import numpy as np

from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import (
    PAPER_PID,
    Array,
    Bools,
    Controlled,
    Memory,
    Policy,
    TorquePolicy,
    columns,
    pid_policy,
)
from jansen_env.robot import ROBOTS, Robot
from jansen_env.tasks.walking import profile
from jansen_env.world.argument_checks import Values

DATA = Path(__file__).parent / "data" / "baselines.json"

Setting: TypeAlias = Callable[[Array], Array]
"""Commands (n,), m/s, to crank speeds (n,), rad/s, or torques (n,), N m, that walk at them."""


def nearest_setting(settings: Array, speeds: Array) -> Setting:
    """The measured setting (m,) whose episodes' speeds (m, episodes) came closest to a command.

    A negative command turns the crank backwards: the machine is its own mirror image.
    """

    def setting(command: Array) -> Array:
        error = np.abs(speeds - np.abs(command)[:, None, None]).mean(axis=2)
        return np.sign(command) * settings[np.argmin(error, axis=1)]

    return setting


def walking_pid(crank_speed: Setting, env: Controlled, pid: PID = PAPER_PID) -> Policy:
    """The PID (13) behind a reference that turns with the crank speed for the commanded speed.

    It starts at the crank angle at which the episode starts (the paper's pi).
    """
    cos, sin, rate, command = columns(
        env, "cos_crank_angle", "sin_crank_angle", "crank_speed", "speed_command"
    )

    def reference(seen: Array, memory: Memory, starts: Bools) -> tuple[Array, Array, Memory]:
        angle = np.arctan2(seen[:, sin], seen[:, cos])
        last, target = memory or (angle, angle)  # unwrapped, rad
        last, target = np.where(starts, angle, last), np.where(starts, angle, target)
        unwrapped = last + ((angle - last + np.pi) % (2.0 * np.pi) - np.pi)
        speed = crank_speed(seen[:, command])
        after = (unwrapped, target + speed * env.control_dt)
        return target - unwrapped, speed - seen[:, rate], after

    return pid_policy(reference, env.torque_limit, env.control_dt, pid)


def constant_torque(torque: Setting, env: Controlled) -> Policy:
    """The paper's conclusion as a policy: one constant torque for each command."""
    (command,) = columns(env, "speed_command")
    return TorquePolicy(lambda seen, *_: (torque(seen[:, command]), None), env.torque_limit)


def tuned_for(robot: Robot, tuned: Iterable[str]) -> str:
    """Return the design among ``tuned`` that has a robot's links; "paper" where none has."""
    for name in tuned:
        design = ROBOTS[name]()
        if (design.linkage, design.bodies) == (robot.linkage, robot.bodies):
            return name
    return "paper"


def searched_profile(env: Controlled) -> Policy:
    """Return the profile found for an environment's robot."""
    profiles = json.loads(profile.DATA.read_text(encoding="utf-8"))
    return profile.load_profile(robot=tuned_for(env.robot, profiles)).policy(env)


def measured(name: str, robot: Robot) -> Values:
    """Return the numbers measured for "pid" or "constant" on a robot's design."""
    designs = json.loads(DATA.read_text(encoding="utf-8"))
    entry: Values = designs[tuned_for(robot, designs)][name]
    return entry


def measured_setting(name: str, robot: Robot) -> Setting:
    """Return the measured settings of "pid" or "constant" for a robot."""
    entry = measured(name, robot)
    return nearest_setting(np.array(entry["settings"]), np.array(entry["speeds"]))


BASELINES: dict[str, Callable[[Controlled], Policy]] = {
    "pid": lambda env: walking_pid(
        measured_setting("pid", env.robot), env, PID(*measured("pid", env.robot)["gains"])
    ),
    "constant": lambda env: constant_torque(measured_setting("constant", env.robot), env),
    "profile": searched_profile,
}
"""Each is made for an unwrapped environment."""
