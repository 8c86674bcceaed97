"""Computation of all results that the claims and the figures of the paper need."""

import math
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Array
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.paper import fixed_model, free_walk, toes
from jansen_env.robot import Bar, Robot, paper_robot

ANGLES = 360  # number of crank angles per turn
LONG = 80.0  # duration of the long PID run, in s; the start dies out with kp / ki = 10 s
RIPPLE = 40.0  # duration of a run at constant torque with a fixed chassis, in s
SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)  # crank speeds of walks, in rad/s
WALK = 75.0  # duration of each of these walks, in s
SLOW = 0.25  # crank speed at which the effects of inertia are negligible, in rad/s
FRICTIONS = (0.2, 0.4, 0.525, 0.6, 0.8)  # coefficients of friction of the slow walks
NO_SLIP = (4.0, 2.5)  # crank speed (rad/s) and initial crank angle (rad) of a walk without slip
LOADS = tuple((speed, mu) for speed in (1.0, 3.5) for mu in (0.3, 0.5, 0.8))
"""Crank speed in rad/s and coefficient of friction of each walk whose joint forces are computed."""
TORQUES = (0.5, 1.0, 1.562, 3.0, 6.0)  # constant torques with a fixed chassis, in N m
WALKING_TORQUES = (3.0, 4.0, 5.0, 6.0, 8.0)  # constant torques of walks, in N m


class Results(NamedTuple):
    """Results that the claims and the figures share.

    Attributes:
        run: Run of 10 s with the PID controller.
        long: The same run, continued until it is periodic.
        ripples: Variation of the crank speed with a fixed chassis, by constant torque.
        slender_ripple: The same with slender links, at the middle torque.
        walking_ripples: Variation of the crank speed while walking, by constant torque.
        forces: Constraint moment (N m) and force (N) on each body of the right forepaw in ``run``,
            shape (samples, 8, 3).
        fixed_loads: Largest loads of all legs over a turn at 1 rad/s with a fixed chassis.
        walking_loads: Largest loads while walking, by crank speed and coefficient of friction.
        mean_torque: Mean torque over a turn at a constant 1 rad/s, in N m.
        two_motors: Run of 10 s with the PID controller and a motor on each side.
        backwards: Run of 10 s with the PID controller and a reference that turns the other way.
        heaves: Heave for each number of phases.
        other_heaves: Heave of four legs, in m, for other choices of the lengths that the paper does
            not specify clearly.
        support: The two standing toes of a slow walk.
        slow: The slow walk, by coefficient of friction.
        walks: Walks at :data:`SPEEDS`.
        no_slip: A walk without slip.
    """

    run: fixed_model.Run
    long: fixed_model.Run
    ripples: dict[float, free_walk.Ripple]
    slender_ripple: free_walk.Ripple
    walking_ripples: dict[float, free_walk.Ripple]
    forces: Array
    fixed_loads: free_walk.Loads
    walking_loads: dict[tuple[float, float], free_walk.Loads]
    mean_torque: float
    two_motors: fixed_model.Run
    backwards: fixed_model.Run
    heaves: list[toes.Heave]
    other_heaves: dict[str, float]
    support: toes.DoubleSupport
    slow: dict[float, free_walk.Walk]
    walks: list[free_walk.Walk]
    no_slip: free_walk.Walk


def compute() -> Results:
    """Compute all results, which takes about 15 s."""
    robot = paper_robot()
    advance = fixed_model.tables_advance(robot)
    run = fixed_model.pid_run(robot)
    turn = toes.turn(ANGLES)
    torque = crank_torque(robot, turn).total  # at 1 rad/s
    # Other choices of the lengths that the paper does not specify clearly.
    others = {
        "L6 and L11 swapped": robot.with_bodies(
            rocker=robot.body("coupler"), coupler=robot.body("rocker")
        ),
        "a frame of hypot(l0, h0) = 0.32765 m": robot.with_bodies(frame=Bar(0.32765)),
    }
    return Results(
        run=run,
        long=fixed_model.simulate_pid(advance, duration=LONG),
        ripples={torque: _ripple(robot, torque) for torque in TORQUES},
        slender_ripple=_ripple(robot.with_slender_inertias(), TORQUES[2]),
        walking_ripples={
            torque: free_walk.walking_ripple(robot, torque) for torque in WALKING_TORQUES
        },
        forces=_forces(run.angle[:-1], run.speed[:-1], run.torque).body[:, 0],
        fixed_loads=free_walk.largest_loads(_forces(turn, np.ones(ANGLES), torque)),
        walking_loads={
            (speed, mu): free_walk.largest_loads(free_walk.walking_forces(robot, speed, 3, mu))
            for speed, mu in LOADS
        },
        mean_torque=float(torque.mean()),
        two_motors=fixed_model.pid_run(robot, motors=2),
        backwards=fixed_model.pid_run(robot, direction=-1.0),
        heaves=[toes.heave(phases) for phases in toes.PHASES],
        other_heaves={
            name: float(np.ptp(np.minimum(*toes.lowest_toes(other, toes.turn(2880)))))
            for name, other in others.items()
        },
        support=toes.double_support(robot),
        slow={mu: free_walk.walk(robot, SLOW, 2, mu) for mu in FRICTIONS},
        walks=[
            free_walk.walk(robot, speed, round(WALK * speed / (2.0 * math.pi))) for speed in SPEEDS
        ],
        no_slip=free_walk.walk(robot, NO_SLIP[0], 12, start=NO_SLIP[1]),
    )


def _ripple(robot: Robot, torque: float) -> free_walk.Ripple:
    """Return the variation of the crank speed with a fixed chassis at a constant torque in N m.

    It is computed from the second half of the run.
    """
    run = fixed_model.simulate(fixed_model.tables_advance(robot), lambda *_: torque, RIPPLE)
    return free_walk.Ripple.of(run.speed[len(run.speed) // 2 :])


def _forces(angle: Array, speed: Array, torque: Array) -> JointForces:
    """Return the joint forces of the paper's robot with a fixed chassis at n instants.

    Args:
        angle: Crank angles, in rad, shape (n,).
        speed: Crank speeds, in rad/s, shape (n,).
        torque: Torques on the crank, in N m, shape (n,).
    """
    q = fixed_model.crank_only(angle)
    q_dot = fixed_model.crank_only(speed)
    return joint_forces(paper_robot(), q, q_dot, torque, fixed_base=True)
