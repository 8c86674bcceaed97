"""Effect of joint play on a steady walk, estimated by short walks on the rigid-body backend.

Only this backend can simulate play, and it is slow. A few copies of a robot therefore walk for a
short time, each with and without play from the same state.
"""

from typing import Any, NamedTuple, cast

import numpy as np
from tabulate import tabulate

from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.envs.vector import Observations
from jansen_env.plants.rigid.rigid_batch import PLAY_TIME_STEP
from jansen_env.policies.policy import Memory, Policy
from jansen_env.robot import Robot
from jansen_env.scoring.metrics import SETTLING
from jansen_env.scoring.rollout import Advance, make_env, no_progress
from jansen_env.tasks.walking.tuned import gains_of
from jansen_env.tasks.walking.walker_benchmark import walking_pid
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv
from jansen_workshop import walking_copies

COPIES = 4  # number of copies that walk with and without play
WALKED = 2.0  # approximate measured time, in s
AGAIN = 0.3  # time on the rigid-body backend before the measurement, in s
BACKEND: dict[str, Any] = {"plant": "rigid_body", "time_step": PLAY_TIME_STEP}
"""Arguments of the environments; all walks have the same time step, because slip depends on it."""


class Change(NamedTuple):
    """A quantity of the copies without and with play.

    Attributes:
        without: Value of each copy without play.
        with_play: Value of each copy with play.
    """

    without: list[float]
    with_play: list[float]


def simulated_time(speed: float) -> float:
    """Return the time that the copies walk on the rigid-body backend, in s.

    Args:
        speed: Crank speed, in rad/s.
    """
    return 2.0 * COPIES * (AGAIN + walking_copies.measured_time(speed, WALKED))


def changes_by_play(
    robot: Robot, speed: float, play: float, advance: Advance = no_progress
) -> dict[str, Change]:
    """Return the quantities of a steady walk without and with play, by name.

    Args:
        robot: The robot.
        speed: Crank speed, in rad/s.
        play: Radial clearance of every pin of the legs, in m.
        advance: Function that is called with the time, in s, that the copies have walked on the
            rigid-body backend since its last call.

    Raises:
        ValueError: If a copy stands still.
    """
    robots, known, _ = walking_copies.draw_copies(robot, walking_copies.WITHIN, COPIES)
    found: dict[str, Change] = {}
    for i, copy in enumerate(robots):
        arguments = {
            "robot": copy,
            "friction": float(known["friction"][i]),
            "terminate_when_fallen": False,
            "reset_noise_scale": 0.0,
        }
        before = _made(arguments)
        pid = walking_pid(
            lambda command: np.full(len(command), speed), before, gains_of(robot, "steady")
        )
        seen, _ = before.reset(seed=0, options={"crank_angle": float(known["start"][i])})
        seen, memory, _ = _walk(before, pid, seen, None, SETTLING)
        for column, clearance in enumerate((0.0, play)):
            after = _made({**arguments, **BACKEND, "joint_play": clearance})
            after.reset(seed=0)
            after.set_state(before.get_state())
            begun, carried, _ = _walk(after, pid, seen, memory, AGAIN, advance)
            measured = _measured(after, pid, begun, carried, speed, advance)
            for name, value in measured.items():
                found.setdefault(name, Change([], []))[column].append(float(value))
    return found


def _made(arguments: dict[str, Any]) -> JansenWalkerEnv:
    """Return the environment of a copy."""
    return cast(JansenWalkerEnv, make_env(walking_copies.ENV, arguments).unwrapped)


def _walk(
    env: JansenWalkerEnv,
    pid: Policy,
    seen: Observations,
    memory: Memory,
    seconds: float,
    advance: Advance = no_progress,
) -> tuple[Observations, Memory, list[dict[str, Array]]]:
    """Let a robot walk; return its last observation, the memory of the PID, and the records."""
    height = env.task.columns["crank_axis_height"]
    rows = []
    for _ in range(round(seconds / env.control_dt)):
        action, memory = pid.predict(seen[None], memory, np.array([memory is None]))
        seen, _, _, _, info = env.step(action[0])
        rows.append(walking_copies.recorded(info, seen[height]))
        advance(env.control_dt)
    return seen, memory, rows


def _measured(
    env: JansenWalkerEnv,
    pid: Policy,
    seen: Observations,
    memory: Memory,
    speed: float,
    advance: Advance,
) -> dict[str, Array]:
    """Return the quantities of a robot that goes on walking."""
    begun = float(env.task.world.x_position[0])
    _, _, rows = _walk(env, pid, seen, memory, walking_copies.measured_time(speed, WALKED), advance)
    seconds = len(rows) * env.control_dt  # a whole number of control steps
    part = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    way = float(part["x_position"][-1]) - begun
    walking_copies.check_walks(np.array([way]), speed)
    weight = np.array(GRAVITY * env.robot.mass)
    quantities = walking_copies.walking_quantities(part, np.array(way), seconds, weight)
    return {**quantities, "falls": part["fallen"][-1].astype(float)}


def table(changes: dict[str, Change], predicted: dict[str, Any]) -> str:
    """Return a Markdown table of the changes, next to the width of the predicted 90 % band.

    Args:
        changes: Result of :func:`changes_by_play`.
        predicted: Predictions of the same quantities, as returned by ``predict``.
    """
    rows = []
    for name, change in changes.items():
        differences = np.subtract(change.with_play, change.without)
        numbers = [
            np.mean(change.without),
            np.mean(differences),
            differences.min(),
            differences.max(),
            predicted[name]["high"] - predicted[name]["low"],
        ]
        unit = walking_copies.UNITS[name]
        rows.append([f"{name.replace('_', ' ')} ({unit})", *(f"{x:.3g}" for x in numbers)])
    heads = ("quantity", "without play", "change by play", "least", "most", "width of the band")
    return tabulate(rows, heads, "github", disable_numparse=True)
