"""Load on the ground: how long a robot is unsupported, and how hard it lands.

The load is the sum of the normal impulses of all contacts over a window of :data:`WINDOW`, divided
by the impulse of the weight over the same time. A standing robot has a load of 1. An impact of a
rigid foot takes no time, so its force is defined only as a mean over some time. The windows follow
each other without a gap from the reset on, and they do not depend on the control period.
"""

from __future__ import annotations

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage

WINDOW = 0.02
"""Duration of a window, in s."""
UNSUPPORTED = 0.1
"""Fraction of its weight below which the load on the ground makes a robot count as unsupported."""


@stage
def begin_ground_load(robot, loads):
    """Reset the account of the load at the beginning of an episode.

    Args:
        robot: The robot's record.
        loads: Normal force on each toe divided by the weight, shape (toes,). The sum over all toes
            is the first load.
    """
    load = 0.0
    for j in range(len(loads)):
        load += loads[j]
    robot.info.ground_load = load
    robot.info.unsupported = 0.0
    robot.ground_load.impulse, robot.ground_load.steps = 0.0, 0
    robot.ground_load.unevenness = 0.0


@stage
def account_for_load(time_step, robot, pressed):
    """Update the load and the unsupported fraction after a control step.

    The function changes three values of the robot's record:

    - ``info.ground_load`` becomes the largest load of the windows that ended in this step.
    - ``info.unsupported`` becomes the fraction of time steps in which the robot was unsupported.
    - ``ground_load.unevenness`` becomes the mean of (load - 1)^2 over the windows that ended.

    The load and the unevenness do not change if no window ended.

    Args:
        time_step: Time step of the integration, in s.
        robot: The robot's record, changed in place.
        pressed: Sum of the normal impulses of all contacts in each time step, in N s, shape
            (steps,).
    """
    ground, info = robot.ground_load, robot.info
    window = max(1, int(mathematics.nearest(WINDOW / time_step)))
    full = robot.weight * window * time_step
    least = UNSUPPORTED * robot.weight * time_step
    unsupported, ended = 0, 0
    largest, squares = 0.0, 0.0
    for k in range(len(pressed)):
        if pressed[k] < least:
            unsupported += 1
        ground.impulse += pressed[k]
        ground.steps += 1
        if ground.steps >= window:
            load = ground.impulse / full
            largest = max(largest, load)
            squares += (load - 1.0) ** 2
            ended += 1
            ground.impulse, ground.steps = 0.0, 0
    info.unsupported = unsupported / len(pressed)
    if ended > 0:
        info.ground_load = largest
        ground.unevenness = squares / ended
