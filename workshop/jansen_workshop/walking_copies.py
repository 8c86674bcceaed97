"""Walks of copies of a robot whose parameters are uncertain, and the quantities that they show.

The robot's own PID controller turns the crank at a constant speed, starting from rest, and stops it
at the end.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import gymnasium as gym
import numpy as np
from scipy.stats import qmc

from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.policies.pid import PID
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.scoring.metrics import MIN_DISTANCE, SETTLING
from jansen_env.scoring.rollout import Advance, make_env, no_progress
from jansen_env.tasks.walking.walker_benchmark import walking_pid
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv
from jansen_env.terrain.ground import Terrain, one_step

ENV = "JansenWalkerBuilt-v0"
WALKED = 8.0  # approximate measured time, in s
STOPPED = 2.0  # time with the crank stopped, in s
WITHIN = {
    "friction": (0.5, 1.0),  # friction between feet and ground
    "mass": (0.97, 1.03),  # factor on the masses of all links
    "lengths": (-3e-4, 3e-4),  # error of each length, independent of the others, in m
    "bearings": (0.5, 1.5),  # factor on the friction of the bearings
    "feet": (0.5, 1.5),  # factor on the stiffness of the feet
    "battery": (0.9, 1.1),  # factor on the voltage of the battery
    "start": (0.0, math.pi),  # crank angle, in rad; after half a turn the legs have swapped roles
}
"""Limits of the uniform distribution of each uncertain parameter."""
UNITS = {
    "speed": "m/s", "cost_of_transport": "1", "slip": "m/m", "mean_torque": "N m",
    "peak_torque": "N m", "electrical_power": "W", "duty_factor": "1", "foot_load": "N",
    "pitch_range": "rad", "heave": "m", "start_distance": "m", "stop_distance": "m",
    "falls": "fraction", "step_climbed": "m",
}  # fmt: skip
"""Predicted quantities and their units.

Torques are magnitudes. The peaks of torque and load are exceeded in 1 % of the control steps, which
last 20 ms. The load of a foot is averaged over a control step. The duty factor is the fraction of
these steps in which a foot carries load at any instant. The start consists of the first 2 s.
"""
STEPS = tuple(np.round(np.arange(0.02, 0.161, 0.02), 2).tolist())  # heights of steps to climb, in m
STEP_AT = 0.7  # position of the step, in m
BEYOND = 1.3  # position from which on the step counts as climbed, in m
FAR = 2.0  # distance that a robot which does not slip walks, in m
INFO = "x_position", "crank_angle", "crank_torque", "pitch", "fallen"
SLOWEST = 0.5  # lowest crank speed, in rad/s
FASTEST = 10.0  # highest crank speed, in rad/s
MOST_COPIES = 10_000
SPAN = 5.0, 95.0  # percentiles of the copies that limit the 90 % band


def draw_copies(
    robot: Robot, limits: Mapping[str, tuple[float, float]], copies: int
) -> tuple[list[Robot], dict[str, Array], Array]:
    """Sample copies of a robot.

    Args:
        robot: Robot to copy.
        limits: Limits of each uncertain parameter, as in :data:`WITHIN`.
        copies: Number of copies.

    Returns:
        The copies, the sampled values by name, each of shape (copies,), and the errors of the link
        lengths in m, shape (copies, lengths).
    """
    sizes = [name for name in lengths(robot) if name != "frame_angle"]
    names = [name for name in limits if name != "lengths"]
    least, most = np.array([limits[name] for name in [*names, *["lengths"] * len(sizes)]]).T
    samples = least + (most - least) * qmc.LatinHypercube(len(least), rng=0).random(copies)
    known = dict(zip(names, samples.T, strict=False))
    errors = samples[:, len(names) :]
    robots = [
        copy_of(
            robot,
            {name: float(known[name][i]) for name in names},
            dict(zip(sizes, errors[i].tolist(), strict=True)),
        )
        for i in range(copies)
    ]
    return robots, known, errors


def copy_of(robot: Robot, numbers: dict[str, float], errors: dict[str, float]) -> Robot:
    """Return a robot with one sample of the uncertain parameters.

    Args:
        robot: Robot to copy.
        numbers: Sampled values by name, as in :data:`WITHIN`. They may also contain a ``payload``,
            in kg, and a ``damping`` of the crank, in N m s/rad, which are added to those of the
            robot.
        errors: Error of each link length by name, in m.
    """
    known = lengths(robot)
    wrong = with_lengths(robot, {name: known[name] + error for name, error in errors.items()})
    voltage = numbers["battery"]
    motor = replace(
        wrong.motor,
        stall_torque=voltage * wrong.motor.stall_torque,
        no_load_speed=voltage * wrong.motor.no_load_speed,
        viscous_friction=wrong.motor.viscous_friction + numbers.get("damping", 0.0),
    )
    load = replace(wrong.payload, mass=wrong.payload.mass + numbers.get("payload", 0.0))
    feet = wrong.pad_compliance
    if not feet.rigid:
        feet = replace(
            feet,
            stiffness=numbers["feet"] * feet.stiffness,
            tangential_stiffness=numbers["feet"] * (feet.tangential_stiffness or 0.0),
        )
    return replace(
        wrong,
        motor=motor,
        pad_compliance=feet,
        payload=load,
        bodies=tuple(
            replace(b, mass=numbers["mass"] * b.mass, inertia=numbers["mass"] * b.inertia)
            for b in wrong.bodies
        ),
        bearing_friction=tuple(numbers["bearings"] * each for each in robot.bearing_friction),
    )


def walk(
    robots: list[Robot],
    known: dict[str, Array],
    speed: float,
    ground: Terrain,
    seconds: float,
    pid: PID,
    advance: Advance = no_progress,
) -> tuple[dict[str, Array], float]:
    """Simulate robots whose cranks turn for a time and then stop.

    Args:
        robots: Robots that walk, n in number.
        known: Sampled values by name, each of shape (n,). If they include a ``slope``, in rad, the
            terrain rises towards +x by this angle.
        speed: Crank speed, in rad/s.
        ground: Terrain on which all robots walk.
        seconds: Time for which the cranks turn, in s.
        pid: Gains of the controller.
        advance: Function that is called with the time, in s, that the robots have walked since its
            last call.

    Returns:
        Recorded quantities by name, each of shape (steps, n, ...), and the duration of a control
        step, in s.
    """
    single = cast(JansenWalkerEnv, make_env(ENV, {"robot": robots[0]}).unwrapped)
    dt = single.control_dt
    envs: Any = gym.make_vec(
        ENV,
        len(robots),
        robot=robots,
        terrain=ground,
        friction=known["friction"].tolist(),
        terminate_when_fallen=False,
        reset_noise_scale=0.0,
        max_episode_steps=-1,
    )
    now = speed
    policy = walking_pid(lambda command: np.full(len(command), now), single, pid)
    options = {"crank_angle": known["start"]}
    if "slope" in known:
        options["tilt"] = known["slope"]
    seen, _ = envs.reset(seed=0, options=options)
    height = single.task.columns["crank_axis_height"]
    rows = []
    memory = None
    for step in range(round((seconds + STOPPED) / dt)):
        now = speed if step < round(seconds / dt) else 0.0
        action, memory = policy.predict(seen, memory, np.full(len(robots), step == 0))
        seen, _, _, _, info = envs.step(action)
        rows.append(recorded(info, seen[:, height]))
        advance(dt)
    envs.close()
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}, dt


def recorded(info: dict[str, Any], height: Array) -> dict[str, Array]:
    """Return the quantities of a control step that are recorded.

    Args:
        info: Information of the step, of one robot or of n robots.
        height: Height of the crank axis above the ground, in m, shape () or (n,).
    """
    row = {name: info[name] for name in INFO}
    row |= {name: info["energy"][name] for name in ("motor_work", "electrical_work")}
    row["slip"] = info["slip"].sum(axis=-1)
    row["load"] = info["contact_force"][..., 1]
    row["height"] = height
    return row


def measured_time(speed: float, longest: float = WALKED) -> float:
    """Return the time for which a rollout is measured, in s.

    It is ``longest``, rounded down to a whole number of half turns of the crank, and at least one
    half turn.

    Args:
        speed: Crank speed, in rad/s.
        longest: Time that is rounded down, in s.
    """
    half_turn = math.pi / abs(speed)
    return half_turn * max(1, math.floor(longest / half_turn))


def measure(
    robots: list[Robot],
    known: dict[str, Array],
    speed: float,
    pid: PID,
    advance: Advance = no_progress,
) -> dict[str, Array]:
    """Measure quantities of robots that walk on level ground.

    Most quantities refer to whole half turns of the crank after the first 2 s.

    Args:
        robots: Robots that walk, n in number.
        known: Sampled values by name, each of shape (n,).
        speed: Crank speed, in rad/s.
        pid: Gains of the controller.
        advance: Function that is called with the time, in s, that the robots have walked since its
            last call.

    Returns:
        Quantities by name, each of shape (n,).

    Raises:
        ValueError: If a robot stands still, because work and slip are measured per metre.
    """
    time = measured_time(speed)
    run, dt = walk(robots, known, speed, Terrain.flat(), SETTLING + time, pid, advance)
    begin = round(SETTLING / dt)
    end = round((SETTLING + time) / dt)
    part = {name: values[begin:end] for name, values in run.items()}
    x = run["x_position"]
    way = x[end - 1] - x[begin - 1]
    check_walks(way, speed)
    weight = np.array([GRAVITY * robot.mass for robot in robots])
    return {
        **walking_quantities(part, way, time, weight),
        "start_distance": x[begin - 1],
        "stop_distance": x[-1] - x[end - 1],
        "falls": run["fallen"][-1].astype(float),
    }


def check_walks(way: Array, speed: float) -> None:
    """Check that robots walk.

    Args:
        way: Distances along x, in m, shape (n,).
        speed: Crank speed, in rad/s.

    Raises:
        ValueError: If a robot stands still, because work and slip are measured per metre.
    """
    if (still := np.abs(way) <= MIN_DISTANCE).any():
        raise ValueError(
            "every copy of the robot must walk, because work and slip are measured per metre, got "
            f"{still.sum()} of {len(way)} that stand still at a crank speed of {speed} rad/s"
        )


def walking_quantities(
    part: dict[str, Array], way: Array, time: float, weight: Array
) -> dict[str, Array]:
    """Return the quantities of robots that walk steadily, by name, each of shape () or (n,).

    Args:
        part: Recorded quantities by name, each of shape (steps, ...) or (steps, n, ...).
        way: Distance along x, in m, other than 0, shape () or (n,).
        time: Time for which the robots walked, in s.
        weight: Weights of the robots, in N, shape () or (n,).
    """
    torque = np.abs(part["crank_torque"])
    load = part["load"]
    return {
        "speed": way / time,
        "cost_of_transport": np.abs(part["motor_work"]).sum(axis=0) / (weight * np.abs(way)),
        "slip": part["slip"].sum(axis=0) / np.abs(way),
        "mean_torque": torque.mean(axis=0),
        "peak_torque": np.percentile(torque, 99, axis=0),
        "electrical_power": part["electrical_work"].sum(axis=0) / time,
        "duty_factor": (load > 0.0).mean(axis=(0, -1)),
        "foot_load": np.percentile(load, 99, axis=(0, -1)),
        "pitch_range": np.ptp(part["pitch"], axis=0),
        "heave": np.ptp(part["height"], axis=0),
    }


def climbing_time(robot: Robot, speed: float) -> float:
    """Return the time in which a robot that does not slip walks :data:`FAR`, in s.

    Args:
        robot: Robot that walks.
        speed: Crank speed, in rad/s.
    """
    return 2.0 * math.pi * FAR / abs(advance_per_turn(robot) * speed)


def climb(
    robots: list[Robot],
    known: dict[str, Array],
    speed: float,
    pid: PID,
    advance: Advance = no_progress,
) -> Array:
    """Return the height up to which each robot climbs all steps.

    Args:
        robots: Robots that climb, n in number.
        known: Sampled values by name, each of shape (n,).
        speed: Crank speed, in rad/s.
        pid: Gains of the controller.
        advance: Function that is called with the time, in s, that the robots have walked since its
            last call.

    Returns:
        Heights of :data:`STEPS` in m, shape (n,); 0 for a robot that does not climb the lowest.
    """
    seconds = climbing_time(robots[0], speed)
    climbed = []
    for height in STEPS:
        ground = one_step(math.copysign(STEP_AT, speed), height)
        run, _ = walk(robots, known, speed, ground, seconds, pid, advance)
        climbed.append(~run["fallen"][-1] & (np.abs(run["x_position"][-1]) > BEYOND))
    return np.append(0.0, STEPS)[np.cumprod(climbed, axis=0).sum(axis=0).astype(int)]
