"""All that the claims and figures need, computed once; independent parts side by side."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.inverse import crank_torque
from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.paper import model, readings, toes, walking
from jansen_env.robot import Robot, paper_robot

Array = NDArray[np.float64]

LONG = 80.0  # s: what is left of the start dies out with kp / ki = 10 s
RIPPLE = 40.0  # s, of a pinned run at constant torque
SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)  # rad/s, of the crank, walking
WALK = 75.0  # s, of each of these walks
SLOW = 0.25  # rad/s, of a crank so slow that inertia hardly counts
FRICTIONS = (0.2, 0.4, 0.55, 0.6, 0.8)
NO_SLIP = (4.0, 2.5)  # rad/s, and rad, where it starts: a walk that turns out not to slip
LOADS = tuple((speed, mu) for speed in (1.0, 3.5) for mu in (0.3, 0.5, 0.8))
"""Crank speeds (rad/s) and frictions of the walks whose joint forces are looked at."""
TORQUES = (0.5, 1.0, 1.562, 3.0, 6.0)  # N m, constant, chassis pinned
WALKING_TORQUES = (3.0, 4.0, 5.0, 6.0, 8.0)  # N m, constant, walking


@dataclass(frozen=True)
class Results:
    """What was computed.

    Attributes:
        run, dense: the PID's 10 s, on the compiled tables and on the dense projection.
        long: the PID's run until it is periodic.
        ripples, slender_ripple, walking_ripples: of the crank's speed by constant torque (N m):
            pinned, with slender links at the middle one of these torques, and walking.
        forces: (samples, 8, 3) constraint moment and force on the right forepaw in ``run``.
        pinned_loads: of all legs over a turn at 1 rad/s. walking_loads: by speed, friction.
        levels: torque by reading. reversed_valley: of the PID with the reference turning back.
        heaves: by number of phases. support: the slow walk's two toes. slow: it, by friction.
        walks: at :data:`SPEEDS`. no_slip: see :data:`NO_SLIP`.
    """

    run: model.Run
    dense: model.Run
    long: model.Run
    ripples: dict[float, walking.Ripple]
    slender_ripple: walking.Ripple
    walking_ripples: dict[float, walking.Ripple]
    forces: Array
    pinned_loads: walking.Loads
    walking_loads: dict[tuple[float, float], walking.Loads]
    levels: list[readings.Level]
    reversed_valley: tuple[float, float]
    heaves: list[toes.Heave]
    support: toes.DoubleSupport
    slow: dict[float, walking.Walk]
    walks: list[walking.Walk]
    no_slip: walking.Walk


def compute(workers: int = 2) -> Results:
    """Compute everything in ``workers`` processes; about half a minute on two cores."""
    first: dict[str, Callable[[], Any]] = {  # need nothing that has to be compiled; long ones first
        "dense": _dense,
        "heaves": _heaves,
        "levels": readings.torque_levels,
        "support": functools.partial(toes.double_support, paper_robot()),
        "pinned_loads": _pinned_loads,
    }
    then: dict[str, Callable[[], Any]] = {
        "walks": _walks,
        "slow": _slow,
        "walking_loads": _walking_loads,
        "walking_ripples": _walking_ripples,
        "forces": _forces,
        "run": functools.partial(_run, model.DURATION),
        "long": functools.partial(_run, LONG),
        "ripples": _ripples,
        "slender_ripple": _slender_ripple,
        "no_slip": _no_slip,
        "reversed_valley": readings.reversed_valley,
    }
    # Spawned, not forked: a process with threads (torch's, say) must not be forked.
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        futures = {name: pool.submit(part) for name, part in first.items()}
        _compile()
        futures.update({name: pool.submit(part) for name, part in then.items()})
        return Results(**{name: future.result() for name, future in futures.items()})


def _compile() -> None:
    """Compile the kernels here, if that is due: the processes then find them in the cache."""
    walking.walk(paper_robot(), 50.0, 1)
    _run(model.SAMPLING)


def _run(duration: float) -> model.Run:
    return model.simulate_pid(model.tables_advance(paper_robot()), duration=duration)


def _dense() -> model.Run:
    return model.simulate_pid(model.projection_advance(paper_robot()))


def _ripple(robot: Robot, torque: float) -> walking.Ripple:
    """The second half of a pinned run at a constant torque."""
    run = model.simulate(
        model.tables_advance(robot, time_step=1e-3), lambda *_: torque, duration=RIPPLE
    )
    late = run.speed[len(run.speed) // 2 :]
    return walking.Ripple(float(late.mean()), float(0.5 * np.ptp(late) / abs(late.mean())))


def _ripples() -> dict[float, walking.Ripple]:
    return {torque: _ripple(paper_robot(), torque) for torque in TORQUES}


def _slender_ripple() -> walking.Ripple:
    return _ripple(paper_robot().with_slender_inertias(), TORQUES[2])


def _walking_ripples() -> dict[float, walking.Ripple]:
    return {torque: walking.walking_ripple(paper_robot(), torque) for torque in WALKING_TORQUES}


def _forces() -> Array:
    return model.constraint_forces(paper_robot(), _run(model.DURATION))


def _pinned_loads() -> walking.Loads:
    robot, angle = paper_robot(), toes.turn(readings.ANGLES)
    q, q_dot = np.zeros((2, len(angle), 4))
    q[:, 3], q_dot[:, 3] = angle, 1.0
    torque = crank_torque(robot, angle).total
    return walking.largest_loads(joint_forces(robot, q, q_dot, torque, pinned=True))


def _walking_loads() -> dict[tuple[float, float], walking.Loads]:
    return {
        (speed, mu): walking.largest_loads(walking.walking_forces(paper_robot(), speed, 3, mu))
        for speed, mu in LOADS
    }


def _heaves() -> list[toes.Heave]:
    return [toes.heave(phases) for phases in toes.PHASES]


def _slow() -> dict[float, walking.Walk]:
    return {mu: walking.walk(paper_robot(), SLOW, 2, friction=mu) for mu in FRICTIONS}


def _walks() -> list[walking.Walk]:
    turns = [round(WALK * speed / (2.0 * math.pi)) for speed in SPEEDS]
    return [walking.walk(paper_robot(), s, n) for s, n in zip(SPEEDS, turns, strict=True)]


def _no_slip() -> walking.Walk:
    speed, start = NO_SLIP
    return walking.walk(paper_robot(), speed, 12, start=start)
