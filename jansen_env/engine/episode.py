"""Episodes of robots: parameters, the beginning of an episode, control steps and observations.

A control step of one robot consists of these parts, in this order:

1. The impulses of the pushes on its chassis are computed: scheduled pushes are looked up, and
   random pushes are sampled (:func:`_begin_step`).
2. Its action is clipped, limited in its rate of change, and delayed (:func:`_begin_step`).
3. The robot moves (:func:`jansen_env.engine.integrator.take_steps`).
4. The errors of the sensors are sampled, and the accounts of the step are updated. The compiled
   task samples the next command, computes the reward, and decides whether the episode is over
   (:func:`_finish_step`).
5. The observation is filled: readings, to which the errors of the sensors are added, and onboard
   estimates (:func:`_observe`).

If the task is written in NumPy, the kernel ends after part 4. It computes a reward only if the task
extends the compiled task. The methods of the task itself follow, and then :func:`observe`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.ground_load import account_for_load, begin_ground_load
from jansen_env.engine.integrator import has_moved, split, take_steps
from jansen_env.engine.kernel import (
    Floats1,
    Floats2,
    Ints1,
    Ints2,
    Singles1,
    Singles2,
    Singles4,
    fetch_add,
    kernel,
    stage,
)
from jansen_env.engine.onboard_estimates import (
    VELOCITY,
    begin_onboard,
    estimate_onboard,
    read_onboard,
)
from jansen_env.engine.pushes import Settings as PushSettings
from jansen_env.engine.pushes import fill_pushes
from jansen_env.engine.readings import account, inform, read
from jansen_env.engine.records import (
    Designs,
    FloatRows2,
    FloatRows3,
    Machines,
    Motions,
    Robots,
    Scratch,
    World,
)
from jansen_env.engine.sensors import add_errors, sample_errors
from jansen_env.engine.walk_reward import Settings as WalkSettings
from jansen_env.engine.walk_reward import (
    Walks,
    begin_walk,
    judge_walk,
    measure_walk,
    observe_walk,
    sample_command,
)

BOUND = 1.1
"""Factor by which values between tabulated crank angles exceed the tabulated values at most."""


class Episodes(NamedTuple):
    """Episodes of n robots: parts of their records, and settings that they share.

    Attributes:
        walks: Records of the walking task, shape (n,); without rows if the task does not use the
            compiled one.
        loads: Normal force on each toe divided by the weight, shape (n, toes).
        torques: Commanded torques, latest first, in N m, shape (n, torques).
        schedule: Scheduled pushes, shape (n, pushes, 3): start in s, and impulse in x and y in N s.
        push: Settings of the pushes, shape (1,).
        weights: Settings of the walking task's reward, shape (1,).
    """

    walks: Walks
    loads: FloatRows2
    torques: FloatRows2
    schedule: FloatRows3
    push: PushSettings
    weights: WalkSettings


class Observing(NamedTuple):
    """Observations of n robots, with d values each, and the data from which they are computed.

    The arrays from ``deviation`` on describe noise, see :mod:`jansen_env.engine.sensors`. They have
    no rows if there is no noise.

    Attributes:
        observation: Observations, shape (n, d).
        scan: Positions, relative to the crank axis, at which the height of the ground is read, in
            m.
        columns: Column of each reading in the order of :func:`jansen_env.engine.readings.read`; -1
            for a reading that is not observed.
        task_columns: Columns of the speed command, the lag and the means, shape (6,).
        onboard_columns: Columns of the onboard sensors, see
            :mod:`jansen_env.engine.onboard_estimates`, shape (10,).
        paths: Paths of the toes, in m, shape (n, SAMPLES + 1, toes, 2); without rows if onboard
            sensors are not observed.
        deviation: Standard deviations of noise and bias, shape (d, 2).
        speeds: Columns of the velocity in x and of the crank speed, shape (2,); -1 for none.
        angles: Columns of the cosine and sine of an angle, shape (d, 2); -1 for other readings.
        low: Lower limits of the observation, shape (d,).
        high: Upper limits of the observation, shape (d,).
        known: Seed of the episode to which each row of ``bias`` belongs, shape (n,).
        bias: Bias of each reading, shape (n, d).
        error: Error of each reading in this step, shape (n, d).
        mean_error: Errors of the mean velocity in m/s and of the mean crank speed in rad/s over the
            last step, shape (n, 2).
        truth: Observations without noise, shape (n, d).
    """

    observation: Singles2
    scan: Floats1
    columns: Ints1
    task_columns: Ints1
    onboard_columns: Ints1
    paths: Singles4
    deviation: Floats2
    speeds: Ints1
    angles: Ints2
    low: Singles1
    high: Singles1
    known: Ints1
    bias: Floats2
    error: Floats2
    mean_error: Floats2
    truth: Singles2


@kernel(nogil=True)
def control_step(
    thread: int,
    queues: Ints2,
    most: int,
    rows: Ints1,
    actions: Floats2,
    trace: Floats2,
    scratch: Scratch,
    designs: Designs,
    motions: Motions,
    episodes: Episodes,
    observing: Observing,
) -> None:
    """Advance robots by one control step.

    The thread first advances the robots of its own queue, and then robots of other threads' queues.

    Args:
        thread: Number of the thread, see :func:`jansen_env.engine.integrator.advance`.
        queues: Robots of each thread, shape (threads + 1, 2), see
            :func:`jansen_env.engine.integrator.advance`.
        most: Largest number of robots to move in this call.
        rows: Indices of the robots, shape (k,).
        actions: Actions, shape (n, 1), finite for each robot that moves.
        trace: Trace of the time steps of robot 0; without rows if there is none.
        scratch: Memory of the thread.
        designs: Tables of the designs, and grounds.
        motions: Records of the robots, changed in place.
        episodes: Other parts of the same records, changed in place.
        observing: Observations, changed in place.
    """
    world = designs.world[0]
    work = split(scratch)
    far, diverged = False, False
    taken = 0
    known = len(queues) if thread == 0 else len(queues) - 1
    for offset in range(known):
        queue = queues[(thread + offset) % known]
        while taken < most:
            k = fetch_add(queue)
            if k >= queue[1]:
                break
            r = rows[k]
            robot = motions.robots[r]
            pushed = _begin_step(r, actions[r, 0], robot, episodes, scratch.pushes[0])
            torques, whole = episodes.torques[r], robot.delay[0]
            pushes = scratch.pushes[: int(pushed)]
            commanded = torques[whole], torques[whole + 1], robot.delay[1], pushes
            traced = trace if r == 0 else trace[:0]
            take_steps(r, world.steps, commanded, traced, work, scratch, designs, motions)
            pressed = scratch.pressed
            _finish_step(r, world, designs.surface, pressed, motions, episodes, observing)
            far = far or has_moved(robot)
            diverged = diverged or robot.diverged
            taken += 1
    scratch.flags[0], scratch.flags[1] = far, diverged


@kernel
def begin_step(
    row: int, action: float, pushes: Floats2, robots: Robots, episodes: Episodes
) -> bool:
    """Begin a control step of a robot that Python moves, see :func:`control_step`.

    Such a robot consists of pymunk's rigid bodies, or walks on pymunk's shapes.

    Args:
        row: Index of the robot.
        action: Action of the robot, finite.
        pushes: Output, impulses on the chassis in N s, shape (steps, 2).
        robots: Records of the robots, changed in place.
        episodes: Other parts of the same records, changed in place.

    Returns:
        Whether any push acts in this control step.
    """
    return _begin_step(row, action, robots[row], episodes, pushes)


@kernel
def look_up_pushes(
    robots: Robots, schedule: FloatRows3, settings: PushSettings, pushes: Floats2
) -> bool:
    """Compute the pushes on robot 0 in its next control step.

    Args:
        robots: Records of the robots.
        schedule: Scheduled pushes, see :class:`Episodes`.
        settings: Settings of the pushes, shape (1,).
        pushes: Output, impulses on the chassis in N s, shape (steps, 2).

    Returns:
        Whether any push acts in this control step.
    """
    return fill_pushes(robots[0], schedule[0], settings[0], pushes)


@kernel
def finish_step(
    row: int,
    world_row: World,
    surface: Floats2,
    pressed: Floats1,
    motions: Motions,
    episodes: Episodes,
    observing: Observing,
) -> None:
    """Finish a control step of a robot that Python has moved, see :func:`control_step`.

    Args:
        row: Index of the robot.
        world_row: Data that the robots have in common, shape (1,).
        surface: Vertices of all height lines, in m, shape (vertices, 2).
        pressed: Sum of the normal impulses on the robot in each time step, in N s, shape (steps,).
        motions: Records of the robots, changed in place.
        episodes: Other parts of the same records, changed in place.
        observing: Observations, changed in place.
    """
    _finish_step(row, world_row[0], surface, pressed, motions, episodes, observing)


@kernel
def observe(
    rows: Ints1,
    moved: bool,
    world_row: World,
    surface: Floats2,
    motions: Motions,
    episodes: Episodes,
    observing: Observing,
) -> None:
    """Observe robots, either after a control step or in their present state.

    Args:
        rows: Indices of the robots, shape (k,).
        moved: Whether the robots have just completed a control step.
        world_row: Data that the robots have in common, shape (1,).
        surface: Vertices of all height lines, in m, shape (vertices, 2).
        motions: Records of the robots, changed in place.
        episodes: Other parts of the same records, changed in place.
        observing: Observations, changed in place.
    """
    for r in rows:
        robot, world = motions.robots[r], world_row[0]
        if world.noisy and not moved:
            _sample_errors(r, robot, observing)
        inform(robot)
        _observe(r, moved, world, robot, surface, episodes, observing)


@kernel
def begin_episode(
    rows: Ints1, world_row: World, machines: Machines, motions: Motions, episodes: Episodes
) -> None:
    """Begin an episode of robots in their initial states, and clear all data of the last episode.

    The sums of the robots must be those of a look ahead by one time step (the argument ``ahead`` of
    :func:`jansen_env.engine.integrator.advance`). The record of the task must already contain what
    was sampled for the episode.

    Args:
        rows: Indices of the robots, shape (k,).
        world_row: Data that the robots have in common, shape (1,).
        machines: Properties of each robot before parameters are applied, shape (n,).
        motions: Records of the robots, changed in place.
        episodes: Other parts of the same records, changed in place.
    """
    world = world_row[0]
    for r in rows:
        robot, torques, loads = motions.robots[r], episodes.torques[r], episodes.loads[r]
        info = robot.info
        info.crank_torque = 0.0
        info.links_in_ground = 0
        info.diverged = False
        info.x_velocity = robot.state[4]
        robot.action = robot.action_before = 0.0
        robot.x_before = robot.state[0]
        robot.elapsed = 0
        robot.diverged = False
        for k in range(len(torques)):
            torques[k] = 0.0
        for j in range(len(loads)):
            loads[j] = motions.contact_force[r, j, 1] / robot.weight
        begin_ground_load(robot, loads)
        steps = int(mathematics.nearest(robot.parameters.delay / world.time_step))
        robot.delay[0], robot.delay[1] = steps // world.steps, steps % world.steps
        robot.reward, robot.terminated = 0.0, False
        begin_onboard(robot)
        if world.is_walk:
            begin_walk(robot, episodes.walks[r], machines[r].advance)


@kernel
def apply_parameters(
    rows: Ints1,
    gravity_x: float,
    gravity_y: float,
    gravity: float,
    torque_rate: float,
    world: World,
    machines: Machines,
    robots: Robots,
) -> None:
    """Apply the parameters of robots: compute the values that the kernels use from them.

    Args:
        rows: Indices of the robots, shape (k,).
        gravity_x: Gravity in x before tilt and scale, in m/s^2.
        gravity_y: Gravity in y before tilt and scale, in m/s^2.
        gravity: Gravity with which weights are computed, in m/s^2.
        torque_rate: Highest rate of change of the commanded torque, in N m/s; infinite if there is
            no limit.
        world: Data that the robots have in common, shape (1,).
        machines: Properties of each robot before parameters are applied, shape (n,).
        robots: Records of the robots, changed in place.
    """
    for r in rows:
        robot, machine, values = robots[r], machines[r], robots[r].parameters
        properties = robot.properties
        prescribed = properties.prescribed_speed
        robot.properties = machine.nominal
        properties.prescribed_speed = prescribed
        properties.friction, properties.restitution = values.friction, values.restitution
        properties.load_mass = values.payload
        properties.load_x, properties.load_y = values.payload_x, values.payload_y
        properties.mass_scale = values.mass_scale
        properties.inertia_scale = values.inertia_scale
        properties.damping_scale = values.damping_scale
        for i in range(2):
            properties.stiffness[i] *= values.foot_stiffness_scale
            properties.pad_damping[i] *= values.foot_damping_scale
        strength = values.motor_strength
        properties.stall_torque *= strength
        properties.torque_slope *= strength
        properties.most_torque *= strength
        properties.winding /= strength  # This keeps the no-load speed.
        properties.rotor_pitch *= values.rotor_inertia_scale
        properties.rotor_coupling *= values.rotor_inertia_scale
        properties.rotor_crank *= values.rotor_inertia_scale
        mass = values.mass_scale * machine.links_mass + values.payload
        properties.mass = mass
        scale = values.mass_scale
        properties.pitch_arm = BOUND * (scale * machine.centre[0] / mass + machine.pad[0])
        properties.crank_arm = BOUND * (scale * machine.centre[1] / mass + machine.pad[1])
        load = math.sqrt(
            properties.load_x * properties.load_x + properties.load_y * properties.load_y
        )
        properties.pitch_arm += properties.load_mass * load / mass
        x, y = values.gravity_scale * gravity_x, values.gravity_scale * gravity_y
        cos, sin = mathematics.cos(values.tilt), mathematics.sin(values.tilt)
        properties.gravity_x, properties.gravity_y = cos * x + sin * y, cos * y - sin * x
        robot.status.pad_radius = properties.pad_radius
        robot.weight = gravity * mass * values.gravity_scale
        robot.direction = 1.0 if properties.fixed_chassis else math.copysign(1.0, machine.advance)
        robot.full_torque = robot.direction * machine.torque_limit * strength
        robot.most_change = torque_rate * world[0].period / machine.torque_limit


@stage
def _begin_step(r, action, robot, episodes, pushes):
    """Compute the pushes in this control step, and command the torque of an action.

    Args:
        r: Index of the robot.
        action: The action, finite; the function clips it.
        robot: The robot's record, changed in place.
        episodes: Other parts of the same record, changed in place.
        pushes: Output, impulses on the chassis in N s, shape (steps, 2).

    Returns:
        Whether any push acts in this control step.
    """
    pushed = fill_pushes(robot, episodes.schedule[r], episodes.push[0], pushes)
    last, torques = robot.action, episodes.torques[r]
    taken = min(1.0, max(-1.0, action))
    if robot.most_change < math.inf:
        change = robot.most_change * min(1.0, max(-1.0, taken - last))
        taken = min(1.0, max(-1.0, last + change))
    robot.action_before = last
    robot.action = taken
    robot.elapsed += 1
    for k in range(len(torques) - 1, 0, -1):
        torques[k] = torques[k - 1]
    torques[0] = taken * robot.full_torque
    robot.info.crank_torque = torques[robot.delay[0]]
    return pushed


@stage
def _finish_step(r, world, surface, pressed, motions, episodes, observing):
    """Update the accounts of robot ``r`` after a control step.

    If the task is, or extends, the compiled task, the step is also rewarded. If the whole control
    step is compiled, the robot is also observed.
    """
    robot = motions.robots[r]
    if world.noisy:
        _sample_errors(r, robot, observing)
    x_before = robot.x_before
    slip, force = motions.slip[r], motions.contact_force[r]
    slipped = account(world.period, robot, slip, force, episodes.loads[r])
    if not robot.properties.fixed_chassis:
        account_for_load(world.time_step, robot, pressed)
    inform(robot)
    if world.is_walk:
        walk, way = episodes.walks[r], robot.state[0] - x_before
        sample_command(robot, walk)
        judge_walk(world.period, episodes.weights[0], robot, walk, way, slipped)
        if world.fully_compiled:
            _observe(r, True, world, robot, surface, episodes, observing)


@stage(inline=False)
def _sample_errors(r, robot, observing):
    """Sample the errors of a robot's sensors in this control step."""
    is_new = observing.known[r] != robot.seed
    observing.known[r] = robot.seed
    error = observing.mean_error[r]
    error[0], error[1] = sample_errors(
        robot,
        observing.deviation,
        observing.speeds,
        is_new,
        observing.bias[r],
        observing.error[r],
    )


@stage
def _observe(r, moved, world, robot, surface, episodes, observing):
    """Fill the observation of robot ``r``, after a control step if it has ``moved``."""
    out, loads = observing.observation[r], episodes.loads[r]
    read(robot, loads, surface, observing.scan, observing.columns, out)
    if world.is_walk:
        info = episodes.walks[r].info
        observe_walk(info.speed_command, info, observing.task_columns, out)
    if world.noisy or world.onboard:
        _sense(r, moved, world, robot, episodes, observing)


@stage(inline=False)
def _sense(r, moved, world, robot, episodes, observing):
    """Replace the exact observation of robot ``r`` by the values that its sensors measure."""
    out, period, columns = observing.observation[r], world.period, observing.onboard_columns
    if world.onboard:
        read_onboard(period, moved, robot, columns, out)
    velocity, crank_error = robot.info.x_velocity, 0.0
    if world.noisy:
        truth, error = observing.truth[r], observing.mean_error[r]
        velocity, crank_error = velocity + error[0], error[1]
        for i in range(len(out)):
            truth[i] = out[i]
        add_errors(observing.error[r], observing.angles, observing.low, observing.high, out)
    if world.onboard:
        estimate_onboard(period, moved, robot, observing.paths[r], columns, out)
        velocity = float(np.float32(robot.onboard.estimates[VELOCITY]))
    if world.is_walk:
        walk = episodes.walks[r]
        if moved:
            measure_walk(period, robot, walk, velocity, crank_error)
        observe_walk(walk.info.speed_command, walk.measured, observing.task_columns, out)
