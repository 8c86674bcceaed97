"""Observations of a robot, and information on its state and its last control step."""

from __future__ import annotations

from jansen_env.engine import mathematics
from jansen_env.engine.collision import height_at
from jansen_env.engine.kernel import stage

# Fields of the information that are reported for a robot with a fixed chassis.
FIXED_CHASSIS_INFORMATION = "crank_angle", "crank_speed", "crank_torque", "diverged"
FIXED_CHASSIS_ENERGIES = (
    "motor_work",
    "electrical_work",
    "joint_loss",
    "mechanical_energy_change",
    "residual",
)


@stage
def account(period, robot, slip, force, loads):
    """Update the information on a robot after a control step.

    Args:
        period: Duration of the control step, in s.
        robot: The robot's record.
        slip: Path that each toe slid while loaded, in m, shape (toes,).
        force: Tangential and normal force on each toe, in N, shape (toes, 2).
        loads: Output, normal force on each toe divided by the weight, shape (toes,).

    Returns:
        The path that all toes together slid while loaded, in m.
    """
    info, total, x = robot.info, robot.accumulators, robot.state[0]
    info.crank_torque += total.torque_impulse / period
    slipped = 0.0
    for j in range(len(slip)):
        slipped += slip[j]
        loads[j] = force[j, 1] / robot.weight
    info.x_velocity = (x - robot.x_before) / period
    info.links_in_ground = total.links_in_ground
    info.diverged = robot.diverged
    robot.x_before = x
    return slipped


@stage
def read(robot, loads, surface, scan, columns, out):
    """Write the readings of a robot into its observation.

    Args:
        robot: The robot's record.
        loads: Normal force on each toe divided by the weight, shape (toes,).
        surface: Vertices of all terrains, in m, shape (vertices, 2).
        scan: Positions of the height scan relative to the crank axis, in m, shape (k,).
        columns: Column of each reading, in the order in which this function writes them, shape
            (10 + toes + k,); -1 for a reading that is not observed.
        out: Output, the observation, shape (d,).
    """
    status, state, toes = robot.status, robot.state, len(loads)
    ground = height_at(surface, status.first_vertex, status.end_vertex, state[0])
    theta, psi = state[2], state[3]
    put(out, columns[0], mathematics.cos(psi))
    put(out, columns[1], robot.direction * mathematics.sin(psi))
    put(out, columns[2], robot.direction * state[7])
    put(out, columns[3], mathematics.sin(theta))
    put(out, columns[4], mathematics.cos(theta))
    put(out, columns[5], state[6])
    put(out, columns[6], state[4])
    put(out, columns[7], state[5])
    put(out, columns[8], state[1] - ground)
    put(out, columns[9], robot.action)
    for j in range(toes):
        put(out, columns[10 + j], loads[j])
    for i in range(len(scan)):
        x = state[0] + scan[i]
        ground = height_at(surface, status.first_vertex, status.end_vertex, x)
        put(out, columns[10 + toes + i], state[1] - ground)


@stage
def put(out, column, value):
    """Write a value into a column of a robot's observation, unless the column is -1."""
    if column >= 0:
        out[column] = value


@stage
def inform(robot):
    """Update the information on the state of a robot and on the energies of its last step.

    Args:
        robot: The robot's record.
    """
    info, energy = robot.info, robot.energy
    state, total = robot.state, robot.accumulators
    info.x_position, info.pitch = state[0], state[2]
    info.crank_angle, info.crank_speed = state[3], state[7]
    energy.motor_work = total.motor_work
    energy.push_work = total.push_work
    energy.correction_work = total.correction_work
    energy.joint_loss = total.joint_loss
    energy.electrical_work = total.electrical_work
    energy.slip_loss = total.slip_loss
    energy.impact_loss = total.impact_loss
    energy.mechanical_energy_change = total.energy_change
    losses = energy.joint_loss + energy.slip_loss + energy.impact_loss
    work = energy.motor_work + energy.push_work + energy.correction_work
    energy.residual = work - losses - energy.mechanical_energy_change
