"""How each number of an observation is to be had, for who runs a policy on another computer.

Meanings of :class:`jansen_env.envs.walker.JansenWalkerEnv` and
:class:`jansen_env.envs.crank_env.JansenCrankEnv`; the formulas of what is worked out from step to
step are those of :func:`jansen_env.engine.walk_reward.keep_accounts`.
"""

from __future__ import annotations

import inspect
import math
import re
from typing import Any

from jansen_env.engine.walk_reward import FURTHEST_TARGET, LONGEST_MEAN, SHORTEST_MEAN
from jansen_env.world.broadcasting import scanned_places

CRANK = "crank angle relative to the chassis, counted the way a positive action turns it"
MEANINGS = {
    "cos_crank_angle": f"cosine of the {CRANK}",
    "sin_crank_angle": f"sine of the {CRANK}",
    "crank_speed": "rate of the crank angle relative to the chassis, counted alike",
    "sin_pitch": "sine of the chassis' pitch, positive where its +x end is raised",
    "cos_pitch": "cosine of the pitch",
    "pitch_rate": "rate of the pitch",
    "crank_axis_x_velocity": "velocity of the crank axis along x",
    "crank_axis_y_velocity": "velocity of the crank axis along y",
    "crank_axis_height": "height of the crank axis along y over the ground below it",
    "last_action": "action of the step before, share of the torque limit; 0 at an episode's start",
    "lag": "how far the target is ahead, worked out: see below",
    "mean_speed": "mean walking speed, worked out: see below",
    "mean_slip": "mean slip speed of all toes together, worked out: see below",
    "mean_power": "mean size of the motor's power, worked out: see below",
    "rms_torque": "root mean square of the crank torque, worked out: see below",
    "tracking_error": "reference minus crank angle, both counted on beyond a turn; the reference "
                      "starts at pi and turns at the commanded speed",
}  # fmt: skip
TRAINED_EXACT = "In training they were exact; a machine has to estimate v and s."
TRAINED_WITH_NOISE = """\
In training v and the crank's speed had the noise of the sensors (see jansen_env.Noise): |W| / T was
the size of M times that speed. M was exact. No sensor measures s: it was always 0, leave it so."""
RUNNING = ("lag", "mean_speed", "mean_slip", "mean_power", "rms_torque")


def meaning(name: str, env: Any) -> str:
    """What a number of this name is, for an unwrapped environment that shows it; "" if unknown."""
    if match := re.fullmatch(r"toe_load_(\d+)", name):
        toe = int(match[1])
        leg, side = env.robot.legs[toe], {"fore": "-x", "back": "+x"}
        ahead = round(math.degrees(_turns(env) * leg.phase) % 360.0, 3)
        return (
            f"normal force on toe {toe} / weight of robot and payload, mean over the last period; "
            f"of the leg on the {side[leg.side]} side whose crank pin is {ahead:g} degrees ahead"
        )
    if match := re.fullmatch(r"height_scan_(\d+)", name):
        x = scanned_places(env_argument(env, "height_scan"))[int(match[1])]
        return f"height of the crank axis over the ground {round(x, 6) + 0.0:+g} m from it along x"
    if name == "speed_command":
        turns = "tracking_error" in [entry.name for entry in env.observed]
        return "crank speed asked for" if turns else "walking speed asked for, negative backwards"
    return MEANINGS.get(name, "")


def _turns(env: Any) -> float:
    """1 where a positive action turns an unwrapped environment's crank counter-clockwise, or -1."""
    return float(env.task.world.rows["direction"][0]) if _walks(env) else 1.0


def _walks(env: Any) -> bool:
    return "sin_pitch" in [entry.name for entry in env.observed]


def frames(env: Any) -> str:
    """From where an unwrapped environment counts angles, and which way."""
    way = "counter-clockwise" if _turns(env) > 0.0 else "clockwise"
    crank = (
        "The crank angle is 0 where the crank pin of the first leg points along the chassis' +x, "
        f"and grows {way}, the way a positive action turns the crank. Each leg has its frame pivot "
        "on its own side of the crank axis, at -x or +x."
    )
    if not _walks(env):
        return f"Seen with +x to the right and y upwards. {crank}"
    return (
        "Seen with +x, where a positive action walks to, to the right and y upwards; on a floor "
        "with a `tilt` both lean with it, and the pitch is the angle to the floor, not to the "
        "horizon. The pitch is counter-clockwise, and 0 where the frame pivots of both sides are "
        f"level. {crank}"
    )


def env_argument(env: Any, name: str) -> Any:
    """An argument of an unwrapped environment, as it was given or by default."""
    given = env.spec.kwargs if env.spec is not None else {}
    default: Any = inspect.signature(type(env.task)).parameters[name].default
    return given.get(name, default)


def running_means(env: Any) -> str:
    """In Markdown how the numbers of :data:`RUNNING` are worked out, for an unwrapped environment
    of a walker; "" for others, which show none of them."""
    if not {*RUNNING} & {entry.name for entry in env.observed}:
        return ""
    path = float(env.task.rows["mean_path"][0])
    noisy = env.task.true_observation is not env.task.observation
    trained = TRAINED_WITH_NOISE if noisy else TRAINED_EXACT
    return f"""\
The robot's own computer works these out from step to step; all are 0 at an episode's start. With
the control period T = {env.control_dt:g} s, the speed c that was commanded in the period past, the
mean velocity v = (x - x of the step before) / T of the crank axis, the path s that all toes
together have slid on the ground while loaded, the motor's work W and the mean crank torque M, each
in the period past:

    lag        <- min(max(lag + (c - v) T, -{FURTHEST_TARGET:g} m), {FURTHEST_TARGET:g} m)
    tau         = min(max({path:.6g} m / |c|, {SHORTEST_MEAN:g} s), {LONGEST_MEAN:g} s)
    a           = 1 - exp(-T / tau)
    mean_speed <- mean_speed + a (v - mean_speed)
    mean_slip  <- mean_slip + a (s / T - mean_slip)
    mean_power <- mean_power + a (|W| / T - mean_power)
    rms_torque <- sqrt(rms_torque^2 + a (M^2 - rms_torque^2))

{path:.6g} m is what a quarter turn of the crank advances this robot. Source: `keep_accounts` in
jansen_env/engine/walk_reward.py, documented under Rewards of JansenWalkerEnv. {trained}
"""
