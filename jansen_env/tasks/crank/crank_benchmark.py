"""Benchmark and baselines of ``JansenCrank-v0``.

The baselines are the PID controller of the paper, a constant torque, and inverse dynamics. They
read only the observation, and are made for an unwrapped environment.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from jansen_env.arrays import Array, Bools
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import (
    PAPER_PID,
    Controlled,
    Policy,
    TorquePolicy,
    columns,
    pid_policy,
)
from jansen_env.scoring.metrics import TORQUE, Aggregate, Benchmark, Metric, mean_of
from jansen_env.tasks.walking.tuned import gains_of
from jansen_env.world.world import LOST

# Together with the friction of the joints, 1.6 N m s/rad, this feedback damps the crank
# (0.73 kg m^2) nearly critically.
FEEDBACK = PID(kp=5.0, ki=0.0, kd=2.0)


def paper_pid(env: Controlled) -> Policy:
    """Return the PID controller (13) with the gains of the robot.

    It follows the reference of the environment, whose tracking error is part of the observation.

    Args:
        env: Unwrapped environment.
    """
    rate, lacking, command = columns(env, "crank_speed", "tracking_error", "speed_command")

    def reference(seen: Array, memory: None, starts: Bools) -> tuple[Array, Array, None]:
        return seen[:, lacking], seen[:, command] - seen[:, rate], None

    return pid_policy(reference, env.torque_limit, env.control_dt, gains_of(env.robot, "steady"))


def constant_torque(env: Controlled) -> Policy:
    """Return a policy with one constant torque for each commanded speed.

    The power of this torque equals the mean friction power of the joints over a turn of the crank
    at the commanded speed.

    Args:
        env: Unwrapped environment.
    """
    (command,) = columns(env, "speed_command")
    turn = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    friction = float(crank_torque(env.robot, turn).friction.mean())  # N m s / rad
    return TorquePolicy(lambda seen, *_: (friction * seen[:, command], None), env.torque_limit)


def inverse_dynamics(env: Controlled, feedback: PID | None = None) -> Policy:
    """Return a policy that computes the torque by inverse dynamics with feedback (computed torque).

    The torque is what the commanded speed requires at the present crank angle, plus kp e + kd
    de/dt.

    Args:
        env: Unwrapped environment.
        feedback: Gains kp and kd of the feedback. None for :data:`FEEDBACK`, multiplied by the
            ratio of the robot's own PID gains to those of the paper.
    """
    share = gains_of(env.robot, "steady").kp / PAPER_PID.kp
    own = PID(share * FEEDBACK.kp, share * FEEDBACK.ki, share * FEEDBACK.kd)
    gains = own if feedback is None else feedback
    read = columns(
        env, "cos_crank_angle", "sin_crank_angle", "crank_speed", "tracking_error", "speed_command"
    )

    def controller(seen: Array, memory: None, starts: Bools) -> tuple[Array, None]:
        cos, sin, speed, error, command = (seen[:, column] for column in read)
        needed = crank_torque(env.robot, np.arctan2(sin, cos), command).total
        return needed + gains.kp * error + gains.kd * (command - speed), None

    return TorquePolicy(controller, env.torque_limit)


BASELINES: dict[str, Callable[[Controlled], Policy]] = {
    "pid": paper_pid,
    "constant": constant_torque,
    "inverse": inverse_dynamics,
}
"""Functions that make a baseline for an unwrapped environment, by name."""

CRANK = Benchmark(
    commands=(1.0,),
    option="speed_command",
    command_unit="rad/s",
    aggregates={
        "rms_error": Aggregate("rms", lambda info: info["tracking_error"]),
        "peak_error": Aggregate("peak", lambda info: info["tracking_error"]),
        "work": Aggregate("sum", lambda info: info["energy"]["motor_work"]),
        "success": Aggregate("last", lambda info: info["is_success"]),
        "lost": Aggregate("last", lambda info: np.abs(info["tracking_error"]) > LOST),
        **TORQUE,
    },
    metrics={
        "return": Metric("return", "", mean_of("returns")),
        "rms_error": Metric("RMS tracking error", "rad", mean_of("rms_error")),
        "peak_error": Metric("peak tracking error", "rad", mean_of("peak_error")),
        # All controllers overcome the same friction, so their RMS torques differ only in the last
        # digits.
        "rms_torque": Metric("RMS torque", "N m", mean_of("rms_torque"), digits=4),
        "peak_torque": Metric("peak torque", "N m", mean_of("peak_torque")),
        "power": Metric("mean motor power", "W", lambda run, _: run["work"] / run["duration"]),
        "success": Metric("success", "fraction", mean_of("success"), axis="fraction"),
        "lost": Metric("lost", "fraction", mean_of("lost"), axis=""),
    },
    baselines=BASELINES,
)
