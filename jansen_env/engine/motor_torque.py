"""Motor of a robot: the torque that it delivers, and the electrical power that it draws.

:class:`jansen_env.robot.motor.Motor` documents the model.
"""

from __future__ import annotations

from jansen_env.engine.kernel import stage


@stage
def limited_torque(commanded, lost, factor, properties):
    """Limit a commanded torque to what the motor can deliver, in N m.

    Args:
        commanded: Commanded torque, in N m.
        lost: Torque by which the speed of the motor reduces the stall torque, in N m.
        factor: Factor on the torque-speed line. It is below 1 if the effect of the torque on the
            speed within the time step is solved for (see :func:`motor_torque`), and otherwise 1.
        properties: Physical properties of the robot.
    """
    most = properties.most_torque
    high = max(min(factor * (properties.stall_torque - lost), most), -most)
    low = min(max(-factor * (properties.stall_torque + lost), -most), most)
    return min(high, max(low, commanded))


@stage
def drawn_power(torque, speed, properties):
    """Return the electrical power that a motor draws, in W; a motor feeds no power back.

    Args:
        torque: Torque at the crank, in N m.
        speed: Speed of the crank, in rad/s.
        properties: Physical properties of the robot.
    """
    inner = torque * (properties.driving if torque * speed >= 0.0 else properties.driven)
    return max(inner * (speed + properties.winding * inner), 0.0)


@stage
def motor_torque(h, commanded, n, from_contacts, pitch_force, crank_force, inertia, properties):
    """Return the torque of the motor at the mean crank speed of the step, in N m.

    The mean speed depends on the torque, so the method is implicit. The contacts enter only through
    the crank speed that they added in the last pass. They can only make the crank feel heavier, so
    the method is stable however steep the torque-speed line of the motor is.

    Args:
        h: Time step, in s.
        commanded: Commanded torque, in N m.
        n: Crank speed at the beginning of the step, in rad/s.
        from_contacts: Crank speed that the contacts added in the last pass, in rad/s.
        pitch_force: Generalised force on the pitch, in N m.
        crank_force: Generalised force on the crank without motor and damping, in N m.
        inertia: Inertia at the middle of the step.
        properties: Physical properties of the robot.
    """
    crank_force -= inertia.damping * n
    rest = n + from_contacts + h * (inertia.m12 * pitch_force + inertia.m22 * crank_force)
    lost = 0.5 * properties.torque_slope * (n + rest)
    factor = 1.0 / (1.0 + 0.5 * h * properties.torque_slope * inertia.m22)
    return limited_torque(commanded, lost, factor, properties)
