"""Predict measurements on a real machine, with their uncertainty: ``jansen-workshop predict``.

Many copies of a robot walk at the same time. The parameters that are not known exactly for the real
machine differ from copy to copy, by Latin hypercube sampling. The robot's own PID controller turns
the crank at a constant speed, starting from rest, and stops it at the end.
"""

import argparse
import json
import math
from collections.abc import Mapping
from dataclasses import astuple, replace
from typing import Any, cast

import gymnasium as gym
import numpy as np
from scipy.stats import qmc
from tabulate import tabulate

from jansen_env import __version__
from jansen_env.arrays import Array
from jansen_env.checks import within
from jansen_env.cli.flags import robot_parser, whole
from jansen_env.cli.progress import progress
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.files import check_writable, write_text
from jansen_env.plants.base import LARGEST_PLAY
from jansen_env.policies.pid import PID
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.scoring.metrics import MIN_DISTANCE, SETTLING
from jansen_env.scoring.rollout import Advance, make_env, no_progress
from jansen_env.tasks.walking.tuned import gains_of
from jansen_env.tasks.walking.walker_benchmark import walking_pid
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv
from jansen_env.terrain.ground import Terrain, one_step
from jansen_env.world.settings import load_robot

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
last 20 ms. The duty factor is the fraction of these steps in which a foot carries load. The start
consists of the first 2 s.
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


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    """Parse the command line; the result also has the ``parser``."""
    parser = robot_parser(
        "jansen-workshop predict",
        __doc__,
        "FILE",
        "nothing is written",
        "jansen-workshop predict built",
        "jansen-workshop predict economy --speeds 1 2 --out economy.json",
    )
    parser.add_argument(
        "--speeds",
        type=float,
        nargs="+",
        default=[1.0, 2.0, 4.0],
        metavar="RAD_PER_S",
        help="crank speeds in rad/s; default: 1 2 4",
    )
    parser.add_argument(
        "--copies",
        type=whole(most=MOST_COPIES),
        default=256,
        help=f"number of simulated copies of the machine, at most {MOST_COPIES}; default: 256",
    )
    parser.add_argument(
        "--joint-play",
        type=float,
        default=0.0,
        metavar="M",
        help="radial clearance of the pins in m, whose effect a few slow walks estimate; it does "
        "not widen the predicted bands; default: 0, which estimates nothing",
    )
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> None:
    """Predict the quantities, print a table of them, and write them as JSON.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    from jansen_workshop import play_effect  # which imports this module

    args = _parse(arguments)
    changes = {}
    with args.parser.refusing():
        robot = _checked_robot(args)
        seconds = sum(simulated_time(robot, speed) for speed in args.speeds)
        with progress(f"{args.copies} copies of {args.robot} walk", seconds) as advance:
            predictions = {
                f"{speed:g}": predict(robot, speed, args.copies, advance) for speed in args.speeds
            }
        if args.joint_play:
            seconds = sum(map(play_effect.simulated_time, args.speeds))
            walkers = f"{play_effect.COPIES} copies walk with and without play"
            with progress(walkers, seconds) as advance:
                changes = {
                    f"{speed:g}": play_effect.changes_by_play(
                        robot, speed, args.joint_play, advance
                    )
                    for speed in args.speeds
                }
        gains = gains_of(robot, "steady")
        if args.out is not None:
            content = {
                "format": "jansen_env predictions 1",
                "robot": args.robot,
                "version": __version__,
                "copies": args.copies,
                "gains": [*astuple(gains)],
                "within": WITHIN,
                "crank_speed": predictions,
            }
            if changes:
                by_name = {
                    speed: {name: change._asdict() for name, change in by.items()}
                    for speed, by in changes.items()
                }
                content["joint_play"] = {"play": args.joint_play, "crank_speed": by_name}
            write_text(args.out, json.dumps(content, indent=1) + "\n")
    kp, ki, kd = astuple(gains)
    print(f"{args.robot}, PID of {kp:.3g} N m/rad, {ki:.3g} N m/(rad s), {kd:.3g} N m s/rad")
    for speed, quantities in predictions.items():
        print(f"\ncrank at {speed} rad/s\n\n{table(quantities)}")
        if speed in changes:
            print(f"\njoint play of {args.joint_play} m, crank at {speed} rad/s\n")
            print(play_effect.table(changes[speed], quantities))


def _checked_robot(args: argparse.Namespace) -> Robot:
    """Return the robot after checking all arguments, before the long computation.

    Raises:
        ValueError: If an argument is not allowed.
    """
    robot = load_robot("ROBOT", args.robot)
    if advance_per_turn(robot) == 0.0:
        raise ValueError(f"ROBOT must advance as its crank turns, got {args.robot}")
    if args.out is not None:
        check_writable("--out's folder", args.out.parent)
    for speed in args.speeds:
        within("--speeds", abs(speed), SLOWEST, FASTEST)
    within("--joint-play", args.joint_play, 0.0, LARGEST_PLAY)
    return robot


def table(quantities: dict[str, Any]) -> str:
    """Return a Markdown table of predictions.

    Args:
        quantities: Predictions by quantity, as returned by :func:`predict`.
    """
    rows = []
    for name, row in quantities.items():
        most = max(row["sources"], key=row["sources"].get, default="")
        source = f"{most}, {100 * row['sources'][most]:.0f} %" if most else ""
        numbers = [f"{row[key]:.3g}" for key in ("median", "low", "high")]
        rows.append([f"{name.replace('_', ' ')} ({UNITS[name]})", *numbers, source])
    heads = ("quantity", "median", "5 %", "95 %", "largest source")
    return tabulate(rows, heads, "github", disable_numparse=True)


def simulated_time(robot: Robot, speed: float) -> float:
    """Return the time that each copy walks in :func:`predict`, in s.

    Args:
        robot: Robot that walks.
        speed: Crank speed, in rad/s.
    """
    times = [SETTLING + measured_time(speed), *[climbing_time(robot, speed)] * len(STEPS)]
    return sum(times) + STOPPED * len(times)


def predict(
    robot: Robot, speed: float, copies: int, advance: Advance = no_progress
) -> dict[str, Any]:
    """Predict all quantities in :data:`UNITS` at a crank speed.

    Args:
        robot: Robot whose copies walk.
        speed: Crank speed, in rad/s.
        copies: Number of copies.
        advance: Function that is called with the time, in s, that the copies have walked since its
            last call.

    Returns:
        For each quantity a dictionary with the keys "median", "low", "high" and "sources". 90 % of
        the copies lie between ``low`` and ``high``. ``sources`` has the fraction of the variance
        that a linear regression attributes to each uncertain parameter. The remainder to 1 is not
        linear, because walking is chaotic.

    Raises:
        ValueError: If copies of the robot stand still.
    """
    robots, known, errors = draw_copies(robot, WITHIN, copies)
    pid = gains_of(robot, "steady")  # gains of the nominal robot; a copied robot matches no design
    measured = measure(robots, known, speed, pid, advance)
    measured["step_climbed"] = climb(robots, known, speed, pid, advance)
    inputs = {name: values[:, None] for name, values in known.items() if name != "start"}
    turn = 2.0 * known["start"]
    inputs |= {"lengths": errors, "start": np.stack([np.cos(turn), np.sin(turn)], axis=1)}
    return {name: summary(measured[name], inputs) for name in UNITS}


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
    if (still := np.abs(way) <= MIN_DISTANCE).any():
        raise ValueError(
            f"all {len(way)} copies of the robot must walk, because work and slip are per metre, "
            f"got {still.sum()} that stand still at a crank speed of {speed} rad/s"
        )
    weight = np.array([GRAVITY * robot.mass for robot in robots])
    return {
        **walking_quantities(part, way, time, weight),
        "start_distance": x[begin - 1],
        "stop_distance": x[-1] - x[end - 1],
        "falls": run["fallen"][-1].astype(float),
    }


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


def summary(values: Array, inputs: dict[str, Array]) -> dict[str, Any]:
    """Return the median, the 90 % band, and the sources of the variance of a quantity.

    The fraction of the variance of all groups together is the adjusted R^2: the fraction that the
    same number of random columns would explain is subtracted. A small fraction can be negative.
    The sources are empty if there are fewer copies than the regression needs.

    Args:
        values: Values of the quantity, shape (copies,).
        inputs: Groups of inputs by name, each of shape (copies, columns).
    """
    low, high = np.percentile(values, SPAN).tolist()
    median = float(np.median(values))
    if set(np.unique(values)) <= {0.0, 1.0}:  # report events by their frequency
        median = low = high = float(values.mean())
    return {"median": median, "low": low, "high": high, "sources": _sources(values, inputs)}


def _sources(values: Array, inputs: dict[str, Array]) -> dict[str, float]:
    """Return the fraction of the variance of a quantity that each group of inputs explains.

    Args:
        values: Values of the quantity, shape (copies,).
        inputs: Groups of inputs by name, each of shape (copies, columns).
    """
    columns = np.concatenate([*inputs.values()], axis=1)
    spread = values - values.mean()
    free = len(values) - 1 - columns.shape[1]  # remaining degrees of freedom
    if free <= 0 or values.std() <= 1e-9 * max(1.0, abs(values.mean())):
        return {}
    columns = (columns - columns.mean(axis=0)) / columns.std(axis=0)
    slopes = np.linalg.lstsq(columns, spread, rcond=None)[0]
    explained = slopes * (spread @ columns) / (spread @ spread)  # their sum is R^2
    explained -= (1.0 - explained.sum()) / free  # subtract the part that chance explains
    ends = np.cumsum([part.shape[1] for part in inputs.values()])
    parts = [float(part.sum()) for part in np.split(explained, ends[:-1])]
    return {name: round(part, 3) for name, part in zip(inputs, parts, strict=True)}
