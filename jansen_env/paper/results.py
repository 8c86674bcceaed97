"""All that the claims and figures need, computed once; independent parts side by side."""

from __future__ import annotations

import functools
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.inverse import crank_torque
from jansen_env.joint_forces import joint_forces
from jansen_env.paper import model, readings, toes, walking
from jansen_env.robot import paper_robot

Array = NDArray[np.float64]

LONG = 80.0  # s: what is left of the start dies out with kp / ki = 10 s
SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # rad/s, of the crank, walking
TURNS = 6  # of each of these walks
SLOW = 0.25  # rad/s, of a crank so slow that inertia hardly counts
FRICTIONS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.8)
LOADS_SPEEDS = (1.0, 3.5)  # rad/s, of the walks whose joint forces are looked at
WALKING_TORQUE = 5.0  # N m, of the walk at constant torque


@dataclass(frozen=True)
class Results:
    """What was computed.

    Attributes:
        run, dense: the PID's 10 s, on the compiled tables and on the dense projection.
        long: the PID's run until it is periodic. constant, constant_slender: a constant torque
            equal to the mean friction torque at 1 rad/s, on the paper's robot and on slender links.
        constant_walk: (n,) crank speeds of a walk at constant torque, rad/s.
        forces: (samples, 8, 3) constraint moment and force on the right forepaw in ``run``.
        pinned_loads: of all legs over a turn at a constant 1 rad/s. walking_loads: by crank speed.
        levels: torque by reading. reversed_valley: of the PID with the reference turning back.
        heaves: by number of phases. support: the slow walk's two toes.
        slow: a slow walk by coefficient of friction. walks: at :data:`SPEEDS`.
    """

    run: model.Run
    dense: model.Run
    long: model.Run
    constant: model.Run
    constant_slender: model.Run
    constant_walk: Array
    forces: Array
    pinned_loads: walking.Loads
    walking_loads: dict[float, walking.Loads]
    levels: list[readings.Level]
    reversed_valley: tuple[float, float]
    heaves: list[toes.Heave]
    support: toes.DoubleSupport
    slow: dict[float, walking.Walk]
    walks: list[walking.Walk]


def compute(workers: int = 2) -> Results:
    """Compute everything in ``workers`` processes; about half a minute on two cores."""
    parts: dict[str, Callable[[], Any]] = {  # long ones first
        "dense": _dense,
        "heaves": _heaves,
        "slow": _slow,
        "walks": _walks,
        "levels": readings.torque_levels,
        "support": functools.partial(toes.double_support, paper_robot()),
        "walking_loads": _walking_loads,
        "forces": _forces,
        "constant_walk": functools.partial(
            walking.constant_torque_speeds, paper_robot(), WALKING_TORQUE
        ),
        "run": functools.partial(_run, model.DURATION),
        "long": functools.partial(_run, LONG),
        "constant": _constant,
        "constant_slender": functools.partial(_constant, slender=True),
        "pinned_loads": _pinned_loads,
        "reversed_valley": readings.reversed_valley,
    }
    # Spawned, not forked: a process with threads (torch's, say) must not be forked.
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        futures = {name: pool.submit(part) for name, part in parts.items()}
        return Results(**{name: future.result() for name, future in futures.items()})


def _run(duration: float) -> model.Run:
    return model.simulate_pid(model.tables_advance(paper_robot()), duration=duration)


def _dense() -> model.Run:
    return model.simulate_pid(model.projection_advance(paper_robot()))


def _constant(slender: bool = False) -> model.Run:
    robot = paper_robot()
    torque = float(crank_torque(robot, toes.turn(readings.ANGLES)).friction.mean())
    if slender:
        robot = robot.with_slender_inertias()
    advance = model.tables_advance(robot, time_step=1e-3)
    return model.simulate(advance, lambda *_: torque, duration=LONG)


def _forces() -> Array:
    return model.constraint_forces(paper_robot(), _run(model.DURATION))


def _pinned_loads() -> walking.Loads:
    robot, angle = paper_robot(), toes.turn(readings.ANGLES)
    q, q_dot = np.zeros((2, len(angle), 4))
    q[:, 3], q_dot[:, 3] = angle, 1.0
    torque = crank_torque(robot, angle).total
    return walking.largest_loads(joint_forces(robot, q, q_dot, torque, pinned=True))


def _walking_loads() -> dict[float, walking.Loads]:
    return {
        speed: walking.largest_loads(walking.walking_forces(paper_robot(), speed, 4))
        for speed in LOADS_SPEEDS
    }


def _heaves() -> list[toes.Heave]:
    return [toes.heave(phases) for phases in toes.PHASES]


def _slow() -> dict[float, walking.Walk]:
    return {mu: walking.walk(paper_robot(), SLOW, 2, friction=mu) for mu in FRICTIONS}


def _walks() -> list[walking.Walk]:
    return [walking.walk(paper_robot(), speed, TURNS) for speed in SPEEDS]
