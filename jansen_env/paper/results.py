"""All numbers that the claims and figures need, computed once."""

import math
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Array
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.paper import fixed_model, free_walk, toes
from jansen_env.robot import Bar, Robot, paper_robot

ANGLES = 360  # crank angles in a turn
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


class Results(NamedTuple):
    """Numbers that claims and figures share."""

    run: fixed_model.Run  # the PID's 10 s
    long: fixed_model.Run  # the same until it is periodic
    ripples: dict[float, free_walk.Ripple]  # of the crank's speed by constant torque, fixed base
    slender_ripple: free_walk.Ripple  # with slender links, at the middle torque
    walking_ripples: dict[float, free_walk.Ripple]  # walking, by constant torque
    forces: Array  # (samples, 8, 3) constraint moment and force on the right forepaw in `run`
    fixed_loads: free_walk.Loads  # of all legs over a turn at 1 rad/s
    walking_loads: dict[tuple[float, float], free_walk.Loads]  # by speed and friction
    mean_torque: float  # N m, over a turn at a constant 1 rad/s
    two_motors: fixed_model.Run  # the PID's 10 s with a motor on either side
    backwards: fixed_model.Run  # and with the reference turning the other way
    heaves: list[toes.Heave]  # by number of phases
    other_heaves: dict[str, float]  # of four legs, m, by the lengths that the print leaves open
    support: toes.DoubleSupport  # a slow walk's two toes
    slow: dict[float, free_walk.Walk]  # that walk by friction
    walks: list[free_walk.Walk]  # at SPEEDS
    no_slip: free_walk.Walk


def compute() -> Results:
    """Compute everything; 15 s."""
    robot = paper_robot()
    advance, run = fixed_model.tables_advance(robot), fixed_model.pid_run(robot)
    turn = toes.turn(ANGLES)
    torque = crank_torque(robot, turn).total  # at 1 rad/s
    others = {  # lengths that the print leaves open, taken the other way
        "L6 and L11 swapped": robot.with_bodies(rocker=robot.body("coupler"),
                                                coupler=robot.body("rocker")),
        "frame of hypot(l0, h0) = 0.32765 m": robot.with_bodies(frame=Bar(0.32765)),
    }  # fmt: skip
    return Results(
        run=run,
        long=fixed_model.simulate_pid(advance, duration=LONG),
        ripples={torque: _ripple(robot, torque) for torque in TORQUES},
        slender_ripple=_ripple(robot.with_slender_inertias(), TORQUES[2]),
        walking_ripples={torque: free_walk.walking_ripple(robot, torque)
                         for torque in WALKING_TORQUES},
        forces=_forces(run.angle[:-1], run.speed[:-1], run.torque).body[:, 0],
        fixed_loads=free_walk.largest_loads(_forces(turn, np.ones(ANGLES), torque)),
        walking_loads={(speed, mu): free_walk.largest_loads(
            free_walk.walking_forces(robot, speed, 3, mu)) for speed, mu in LOADS},
        mean_torque=float(torque.mean()),
        two_motors=fixed_model.pid_run(robot, motors=2),
        backwards=fixed_model.pid_run(robot, direction=-1.0),
        heaves=[toes.heave(phases) for phases in toes.PHASES],
        other_heaves={name: float(np.ptp(np.minimum(*toes.lowest_toes(other, toes.turn(2880)))))
                      for name, other in others.items()},
        support=toes.double_support(robot),
        slow={mu: free_walk.walk(robot, SLOW, 2, mu) for mu in FRICTIONS},
        walks=[free_walk.walk(robot, speed, round(WALK * speed / (2.0 * math.pi)))
               for speed in SPEEDS],
        no_slip=free_walk.walk(robot, NO_SLIP[0], 12, start=NO_SLIP[1]),
    )  # fmt: skip


def _ripple(robot: Robot, torque: float) -> free_walk.Ripple:
    """The second half of a run on a fixed base at a constant torque."""
    run = fixed_model.simulate(fixed_model.tables_advance(robot), lambda *_: torque, RIPPLE)
    return free_walk.Ripple.of(run.speed[len(run.speed) // 2 :])


def _forces(angle: Array, speed: Array, torque: Array) -> JointForces:
    """Joint forces (n,) of the paper's robot on a fixed base."""
    q, q_dot = fixed_model.crank_only(angle), fixed_model.crank_only(speed)
    return joint_forces(paper_robot(), q, q_dot, torque, fixed_base=True)
