"""All that the claims and figures need, computed once; independent parts side by side."""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.inverse import crank_torque
from jansen_env.dynamics.joint_forces import joint_forces
from jansen_env.paper import fixed_model, free_walk, interpretations, toes
from jansen_env.robot import Robot, paper_robot

Array = NDArray[np.float64]

LONG = 80.0  # s: what is left of the start dies out with kp / ki = 10 s
RIPPLE = 40.0  # s, of a fixed-base run at constant torque
SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)  # rad/s, of the crank, walking
WALK = 75.0  # s, of each of these walks
SLOW = 0.25  # rad/s, of a crank so slow that inertia hardly counts
FRICTIONS = (0.2, 0.4, 0.525, 0.6, 0.8)
NO_SLIP = (4.0, 2.5)  # rad/s, and rad, where it starts: a walk that turns out not to slip
LOADS = tuple((speed, mu) for speed in (1.0, 3.5) for mu in (0.3, 0.5, 0.8))
"""Crank speeds (rad/s) and frictions of the walks whose joint forces are computed."""
TORQUES = (0.5, 1.0, 1.562, 3.0, 6.0)  # N m, constant, fixed base
WALKING_TORQUES = (3.0, 4.0, 5.0, 6.0, 8.0)  # N m, constant, walking


@dataclass(frozen=True)
class Results:
    """Numbers that claims and figures share."""

    run: fixed_model.Run  # the PID's 10 s
    long: fixed_model.Run  # the same until it is periodic
    ripples: dict[float, free_walk.Ripple]  # of the crank's speed by constant torque, fixed base
    slender_ripple: free_walk.Ripple  # with slender links, at the middle torque
    walking_ripples: dict[float, free_walk.Ripple]  # walking, by constant torque
    forces: Array  # (samples, 8, 3) constraint moment and force on the right forepaw in `run`
    fixed_loads: free_walk.Loads  # of all legs over a turn at 1 rad/s
    walking_loads: dict[tuple[float, float], free_walk.Loads]  # by speed and friction
    levels: list[interpretations.Level]
    pid_levels: list[interpretations.PIDLevel]
    reversed_valley: tuple[float, float]
    heaves: list[toes.Heave]  # by number of phases
    other_heaves: dict[str, float]  # of four legs, m, by the lengths that the print leaves open
    support: toes.DoubleSupport  # a slow walk's two toes
    slow: dict[float, free_walk.Walk]  # that walk by friction
    walks: list[free_walk.Walk]  # at SPEEDS
    no_slip: free_walk.Walk


def compute(workers: int = 2) -> Results:
    """Compute everything in ``workers`` processes; about half a minute on two cores."""
    robot = paper_robot()
    # Compiled here, so that the processes find it in the cache.
    free_walk.walk(robot, 50.0, 1)
    _run(fixed_model.SAMPLING)
    # Spawned, not forked: a process with threads (torch's, say) must not be forked.
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        submit = pool.submit
        jobs: dict[str, Any] = {  # long ones first
            "walks": [submit(_walk, speed) for speed in SPEEDS],
            "slow": {mu: submit(free_walk.walk, robot, SLOW, 2, mu) for mu in FRICTIONS},
            "heaves": [submit(toes.heave, phases) for phases in toes.PHASES],
            "other_heaves": {
                name: submit(toes.level_heave, other)
                for name, other in interpretations.other_lengths().items()
            },
            "levels": submit(interpretations.torque_levels),
            "pid_levels": submit(interpretations.pid_levels),
            "support": submit(toes.double_support, robot),
            "walking_loads": {at: submit(_walking_loads, *at) for at in LOADS},
            "walking_ripples": {
                torque: submit(free_walk.walking_ripple, robot, torque)
                for torque in WALKING_TORQUES
            },
            "fixed_loads": submit(_fixed_loads),
            "run": submit(_run, fixed_model.DURATION),
            "long": submit(_run, LONG),
            "ripples": {torque: submit(_ripple, robot, torque) for torque in TORQUES},
            "slender_ripple": submit(_ripple, robot.with_slender_inertias(), TORQUES[2]),
            "no_slip": submit(free_walk.walk, robot, NO_SLIP[0], 12, start=NO_SLIP[1]),
            "reversed_valley": submit(interpretations.reversed_valley),
        }
        found = {name: _finished(job) for name, job in jobs.items()}
    return Results(**found, forces=fixed_model.constraint_forces(robot, found["run"]))


def _finished(job: Any) -> Any:
    """Return the result of a job, or of each in a list or dictionary of jobs."""
    if isinstance(job, dict):
        return {key: one.result() for key, one in job.items()}
    return [one.result() for one in job] if isinstance(job, list) else job.result()


def _run(duration: float) -> fixed_model.Run:
    return fixed_model.simulate_pid(fixed_model.tables_advance(paper_robot()), duration=duration)


def _ripple(robot: Robot, torque: float) -> free_walk.Ripple:
    """The second half of a run on a fixed base at a constant torque."""
    run = fixed_model.simulate(
        fixed_model.tables_advance(robot), lambda *_: torque, duration=RIPPLE
    )
    return free_walk.Ripple.of(run.speed[len(run.speed) // 2 :])


def _walk(speed: float) -> free_walk.Walk:
    return free_walk.walk(paper_robot(), speed, round(WALK * speed / (2.0 * math.pi)))


def _fixed_loads() -> free_walk.Loads:
    robot, angle = paper_robot(), toes.turn(interpretations.ANGLES)
    q, q_dot = fixed_model.crank_only(angle), fixed_model.crank_only(np.ones(len(angle)))
    torque = crank_torque(robot, angle).total
    return free_walk.largest_loads(joint_forces(robot, q, q_dot, torque, fixed_base=True))


def _walking_loads(speed: float, friction: float) -> free_walk.Loads:
    return free_walk.largest_loads(free_walk.walking_forces(paper_robot(), speed, 3, friction))
