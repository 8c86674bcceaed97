"""What the ground carries: how much of a step a robot is unsupported, and how hard it lands.

The load is the total normal impulse of all contacts over a window of :data:`WINDOW`, divided by
that of the weight: 1 for a robot that stands. Impacts of rigid feet take no time, so that a force
exists only as a mean over a time. Windows follow each other from the reset on, whatever the control
period.
"""

from __future__ import annotations

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage

WINDOW = 0.02  # s
UNSUPPORTED = 0.1  # of the weight: a robot whose feet carry less than that is unsupported


@stage
def begin_ground_load(robot, loads):
    """Begin an episode, in which the toes carry ``loads`` (toes,), each divided by the weight."""
    load = 0.0
    for j in range(len(loads)):
        load += loads[j]
    robot.info.ground_load = load
    robot.info.unsupported = 0.0
    robot.ground_load.impulse, robot.ground_load.steps = 0.0, 0
    robot.ground_load.unevenness = 0.0


@stage
def account_for_load(time_step, robot, pressed):
    """Account for a control step.

    Args:
        time_step: Of the integration, s.
        robot: The robot's record; its information gets the largest load of the windows that ended
            in this step, and the share of time steps in which it was unsupported.
        pressed: Total normal impulses of the time steps, N s.
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
