"""C99 source code of a policy for a microcontroller; it allocates no memory and needs only math.h.

There are two templates: ``policy.c.in``, and ``firmware.c.in``, which also reads sensors and stops
the robot safely. Texts from the file of a policy appear in comments and identifiers only after
:func:`comment` and :func:`places` have removed everything that C could interpret as code.
"""

import re

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

import jansen_env
from jansen_env.arrays import Array
from jansen_env.checks import invalid, shown
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine import onboard_estimates, walk_reward
from jansen_env.engine.walk_reward import STEPS_PER_TURN
from jansen_env.policies.pretrained import Harmonics, PretrainedPolicy, arguments_of
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.world import onboard
from jansen_env.world.settings import Values, load_robot

TAKEN = ("main", "math", "stdio")  # names of other files, with which NAME.c or NAME.h would collide
PARTS = {"{}.h": "h", "{}.c": "c", "{}_main.c": "main.c"}  # part of the template by file name
FIRMWARE = {"{}.h": "h", "{}.c": "c"}
SENSED = {
    "cos_crank_angle": "cosf(j->crank_angle)", "sin_crank_angle": "sinf(j->crank_angle)",
    "crank_speed": "j->crank_speed", "sin_pitch": "j->sin_pitch", "cos_pitch": "j->cos_pitch",
    "pitch_rate": "j->last.pitch_rate", "acceleration_x": "j->last.acceleration_x",
    "acceleration_y": "j->last.acceleration_y", "crank_torque": "j->last.crank_torque",
    "crank_axis_x_velocity": "j->velocity", "lag": "j->lag", "mean_speed": "j->mean_speed",
    "speed_command": "j->command", "last_action": "j->action",
}  # fmt: skip
"""C expression of each observation that the firmware can measure or estimate."""
UNSAFE = re.compile(r"[^A-Za-z0-9 .,:;=+\-_()\[\]{}'/%^<>]")  # characters not allowed in comments
PER_LINE = 6  # numbers per line of an array


def comment(text: object, longest: int = 200) -> str:
    """Return text that is safe within a C comment.

    Characters that could end this comment or begin a new comment are replaced by underscores.

    Args:
        text: Text, or another object to convert to text.
        longest: Length at which the text is cut off.
    """
    return UNSAFE.sub("_", " ".join(str(text).split()))[:longest]


def check_name(name: str) -> str:
    """Return a name after checking that it is a C identifier and collides with no other file.

    Args:
        name: The name.

    Raises:
        ValueError: If the name is not allowed.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name, re.ASCII) or name in TAKEN:
        raise ValueError(
            f"name must be a letter and up to 62 letters, digits and _, and none of {list(TAKEN)}, "
            f"got {shown(name)}"
        )
    return name


def places(policy: PretrainedPolicy, name: str) -> list[str]:
    """Return the C names of the indices of the values in an observation.

    Args:
        policy: The policy.
        name: Name of the policy in C, with which the names begin.

    Raises:
        ValueError: If several values would have the same name.
    """
    words = [re.sub(r"[^A-Z0-9]+", "_", seen.upper()).strip("_") for seen in policy.observed]
    names = [f"{name.upper()}_OBS_{word or '_'}" for word in words]
    if twice := sorted({place for place in names if names.count(place) > 1}):
        raise ValueError(f"observations must have different names in C, got {twice} for several")
    return names


def sources(policy: PretrainedPolicy, name: str) -> dict[str, str]:
    """Return the C source files of a policy.

    The last file is a program that reads observations and prints actions.

    Args:
        policy: The policy.
        name: Name of the files and of the functions in C.

    Returns:
        The text of each file by its name.

    Raises:
        ValueError: If a name is not valid in C.
    """
    return _render("policy.c.in", PARTS, policy, name, {"places": places(policy, check_name(name))})


def firmware(policy: PretrainedPolicy, name: str) -> dict[str, str]:
    """Return the C source files of firmware that reads sensors, computes a torque and stops safely.

    Args:
        policy: The policy.
        name: Name of the policy in C; the files are called NAME_firmware.

    Returns:
        The text of the header and the source file by file name.

    Raises:
        ValueError: If the policy has an observation that no onboard sensor provides, if its torque
            rate is not limited, or if it walks backwards.
    """
    if unknown := [seen for seen in policy.observed if seen not in SENSED]:
        allowed = f"one of {[*SENSED]}, as in environments with observe='onboard'"
        raise invalid("an observation of the policy", unknown[0], allowed)
    arguments = {**arguments_of(policy.env_id), **policy.env_kwargs}
    slowest, fastest = np.broadcast_to(arguments["speed_command"], 2).tolist()
    for key, value in (("torque_rate", arguments["torque_rate"]), ("speed_command", slowest)):
        if value is None or value <= 0.0:
            raise ValueError(f"{key} of the policy must be above 0 for firmware, got {value}")
    robot = load_robot("robot", arguments["robot"])
    values = {
        "paths": onboard.toe_paths(robot),
        "onboard": onboard_estimates,
        "rewards": walk_reward,
        "mean_path": abs(advance_per_turn(robot)) / STEPS_PER_TURN,
        "gravity": GRAVITY,
        "sensed": SENSED,
        "slowest": slowest,
        "fastest": fastest,
        "rate": arguments["torque_rate"],
        "cells": robot.build.cells,
    }
    return _render("firmware.c.in", FIRMWARE, policy, check_name(f"{name}_firmware"), values)


def _render(
    template: str, files: dict[str, str], policy: PretrainedPolicy, name: str, values: Values
) -> dict[str, str]:
    """Render a template; return the text of each file by its name."""
    env = Environment(
        loader=PackageLoader("agents.export", ""),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    env.filters |= {"comment": comment, "single": _single, "real": _real, "array": _array}
    blocks = [block for block in policy.features if block.size]
    sizes = [block.size for block in blocks]
    values = values | {
        "name": name,
        "policy": policy,
        "version": jansen_env.__version__,
        # The kind of each block, the block, and the index of its first feature.
        "blocks": [(type(block).__name__, block, sum(sizes[:k])) for k, block in enumerate(blocks)],
        "harmonics": any(isinstance(block, Harmonics) for block in blocks),
        "limited": bool(np.isfinite(policy.limit)),
        "width": max(sum(sizes), *(len(layer.bias) for layer in policy.layers)),
    }
    made = env.get_template(template)
    return {file.format(name): made.render(values, part=part) for file, part in files.items()}


def _single(value: float) -> str:
    """Return a C constant of type float."""
    return f"{np.float32(value)!s}f"


def _real(value: float) -> str:
    """Return a C constant in the precision of the computation."""
    return f"R({float(value)!r})"


def _array(values: Array, name: str) -> str:
    """Return the C code of a constant array; its type is float if this represents it exactly."""
    flat = np.ravel(values)
    exact = np.array_equal(flat.astype(np.float32).astype(float), flat)
    texts = [_single(value) if exact else _real(value) for value in flat]
    lines = [", ".join(texts[i : i + PER_LINE]) for i in range(0, len(texts), PER_LINE)]
    kind = "float" if exact else "real"
    body = ",\n    ".join(lines)
    return f"static const {kind} {name}[{len(flat)}] = {{\n    {body}\n}};\n"
