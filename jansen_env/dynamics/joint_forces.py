"""Forces in the pins of all legs, from which links and joints can be sized.

Equation (4) of the paper adds C^T lambda to each body. Each pair of rows of C belongs to one pin
(Phi_hf, Phi_hb). Its two multipliers are therefore the force in this pin, x and y in the world
frame. The rows of x_2, y_2 and of the following bodies contain as many equations as a leg has
multipliers (twenty for Jansen's leg):

    C_2^T lambda = (M x_ddot - h - contact forces) without the rows of theta_1, x_1, y_1, theta_2

The remainder in the four other rows is the load that the leg receives from the rest of the robot:
the chassis holds the frame of the leg, and the shaft turns its crank. The functions accept any
number of instants at once, and any linkage. Shapes with 24 and 20 are those of Jansen's leg.

The friction of a dry bearing is a torque between two bodies, with the magnitude tau_i while the
bearing turns. At a standstill the torques are smaller. The dry friction torque of the crank is then
distributed to the bearings and the gear in proportion to the largest torque that each can hold at
the crank: tau_i |a_j' - a_i'| for a bearing, and the friction torque of the gear for the gear.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.dynamics.pads import pad_layout
from jansen_env.dynamics.projection import (
    DOF,
    constraint_matrix,
    forces,
    leg_motion,
    leg_sides,
    masses,
    system_coordinates,
    tangent_bias,
    tangent_matrix,
    times,
)
from jansen_env.dynamics.spring_forces import spring_forces
from jansen_env.robot import Linkage, Robot
from jansen_env.robot.kinematics import world_joints


@functools.lru_cache(maxsize=16)
def pin_signs(linkage: Linkage) -> Array:
    """Return the factors by which the force of each pin acts on the link at each corner.

    Returns:
        Factors 1, -1 or 0, shape (corners, pins).
    """
    signs = np.array([
        [(pin.joint == joint) * (float(pin.body == body) - float(pin.other == body))
         for pin in linkage.pins]
        for body, joint in linkage.corners
    ])  # fmt: skip
    signs.setflags(write=False)
    return signs


def corner_name(linkage: Linkage, index: int) -> str:
    """Return the name of a corner, such as ``"link 1 at P"``.

    Args:
        linkage: The linkage.
        index: Index of the corner in ``linkage.holes``.
    """
    body, joint = linkage.holes[index]
    return f"link {body} at {joint}"


@dataclass(frozen=True)
class JointForces:
    """Forces in the joints of all legs at one or several instants (...), in the world frame.

    Attributes:
        robot: The robot.
        pin: Force in each of ``linkage.pins``, in N, shape (..., legs, pins, 2).
        frame: Force x, y (N) and moment about the crank axis (N m) with which the chassis holds the
            leg's frame, shape (..., legs, 3). A fixed chassis transmits them to its support.
        shaft: Torque with which the shaft turns the leg's crank, in N m, shape (..., legs).
        gear: Part of the motor's torque that is lost to the inertia of the rotor and the friction
            of the gear, in N m, shape (...).
        toe: Contact force on each toe, in N, shape (..., toes, 2).
        body: Moment about the centre of mass (N m) and force x, y (N) that all constraints together
            exert on each body, M x_ddot - h of equation (4), shape (..., legs, bodies, 3). Weight,
            contacts, joint friction, springs and motor (on the first leg) are applied forces and
            not part of it.
        joints: Positions of the joints, in m, shape (..., legs, joints, 2).
        centres: Positions of the centres of mass, in m, shape (..., legs, bodies, 2).
        q_ddot: Accelerations of (x, y, theta, psi), in m/s^2 and rad/s^2, shape (..., 4).
    """

    robot: Robot
    pin: Array
    frame: Array
    shaft: Array
    gear: Array
    toe: Array
    body: Array
    joints: Array
    centres: Array
    q_ddot: Array

    @property
    def magnitude(self) -> Array:
        """Magnitude of the force in each of ``linkage.pins``, in N, shape (..., legs, pins).

        For Jansen's leg, the pins connect the same pairs of bodies as in the paper.
        """
        return np.hypot(self.pin[..., 0], self.pin[..., 1])

    @property
    def bearing(self) -> Array:
        """Magnitude of the force on each of ``linkage.holes``, in N, shape (..., legs, holes)."""
        linkage = self.robot.linkage
        held = [linkage.corners.index(hole) for hole in linkage.holes]
        force = (pin_signs(linkage) @ self.pin)[..., held, :]
        return np.hypot(force[..., 0], force[..., 1])

    @property
    def torque(self) -> Array:
        """Torque of the motor, in N m, shape (...)."""
        return np.asarray(self.shaft.sum(axis=-1) + self.gear)

    def at(self, index: int) -> JointForces:
        """Return the forces at one of several instants.

        Args:
            index: Index of the instant along the first axis.

        Raises:
            ValueError: If these are the forces at a single instant.
        """
        if self.shaft.ndim < 2:
            raise ValueError("JointForces.at needs forces at several instants, got a single one")
        arrays = {name: value[index] for name, value in vars(self).items() if name != "robot"}
        return JointForces(robot=self.robot, **arrays)

    def largest(self) -> tuple[float, str, str]:
        """Return the largest bearing force in N, its leg, and its corner.

        The leg and the corner are names such as ``"rf"`` and ``"link 1 at P"``.
        """
        size = self.bearing
        *_, leg, corner = np.unravel_index(np.argmax(size), size.shape)
        place = corner_name(self.robot.linkage, int(corner))
        return float(size.max()), self.robot.leg_names[leg], place

    def corner_forces(self) -> Array:
        """Return the force of links and ground on each of ``linkage.corners``.

        Contact forces on pads other than toes are not included.

        Returns:
            Forces in the world frame, in N, shape (..., legs, corners, 2).
        """
        linkage = self.robot.linkage
        corner = pin_signs(linkage) @ self.pin
        layout = pad_layout(self.robot)
        for k in range(layout.toes):
            joint, body = linkage.all_pads[layout.joint[k]]
            place = linkage.corners.index((body + 1, linkage.joints[joint]))
            corner[..., layout.leg[k], place, :] += self.toe[..., k, :]
        return corner

    def link_loads(self) -> Array:
        """Return the axial and the shear load at each of ``linkage.corners``.

        The axial load is along the line from the centre of mass of the link to the corner, that is,
        along the bar if the link is a bar. Tension is positive. The direction of the shear load is
        90 degrees counter-clockwise from this line. For a corner at the centre of mass, the line is
        the x axis.

        Returns:
            Loads in N, shape (..., legs, corners, 2).
        """
        linkage = self.robot.linkage
        bodies = np.array([body - 1 for body, _ in linkage.corners])
        joints = np.array([linkage.joints.index(joint) for _, joint in linkage.corners])
        along = self.joints[..., joints, :] - self.centres[..., bodies, :]
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        at_centre = length < 1e-9
        along = np.where(at_centre, (1.0, 0.0), along / np.where(at_centre, 1.0, length))
        force = self.corner_forces()
        axial = (force * along).sum(axis=-1)
        shear = force[..., 1] * along[..., 0] - force[..., 0] * along[..., 1]
        return np.stack([axial, shear], axis=-1)


def joint_forces(
    robot: Robot,
    q: Array,
    q_dot: Array,
    torque: Array | float = 0.0,
    contact: Array | None = None,
    *,
    fixed_base: bool = False,
    q_ddot: Array | None = None,
    dry: Array | float | None = None,
    gravity: Gravity = GRAVITY,
) -> JointForces:
    """Return the forces in all joints from a state, the crank torque and the contact forces.

    Args:
        robot: The robot.
        q: Position x, y of the crank axis (m), pitch theta and crank angle psi (rad), shape (...,
            4).
        q_dot: Rates of ``q``, in m/s and rad/s, shape (..., 4).
        torque: Torque on the crank, in N m, a number or an array of shape (...). It is not used if
            ``q_ddot`` is given.
        contact: Contact forces on the first k pads (toes first, in the order of the legs), shape
            (..., k, 3): force x, y in the world frame (N), and moment about the centre of the pad
            (N m). None for no contact.
        fixed_base: Whether the chassis is fixed. The first three entries of ``q_dot`` and
            ``q_ddot`` must then be 0.
        q_ddot: Accelerations, in m/s^2 and rad/s^2, shape (..., 4). None to compute them.
        dry: Total torque of the dry friction of all bearings and the gear on the crank, in N m, a
            number or an array of shape (...). None for the friction at the present crank speed,
            which is 0 at a standstill.
        gravity: Acceleration of gravity, in m/s^2: a number (downwards) or a vector (x, y).

    Raises:
        ValueError: If the shapes do not match, or a fixed chassis moves.
    """
    q = np.asarray(q, dtype=float)
    q_dot = np.asarray(q_dot, dtype=float)
    _check_arguments(q, q_dot, torque, fixed_base, q_ddot, dry)
    X = system_coordinates(robot, q)
    joints = world_joints(robot, q)
    T = tangent_matrix(robot, q)
    M = masses(robot)
    x_dot, D, bias = leg_motion(robot, leg_sides(robot), X, times(T, q_dot[..., None, :]))
    # x_ddot = D_q q_ddot + bias
    D_q = D @ T
    bias = bias + times(D, tangent_bias(robot, q, q_dot))
    h = forces(robot, x_dot, 0.0, gravity)  # the torque of the motor is added at the shaft, below
    bearings, gear = _dry_friction(robot, D_q, q_dot[..., 3], dry)
    h += bearings + spring_forces(robot, leg_sides(robot), X)
    gear = gear - robot.motor.viscous_friction * q_dot[..., 3]
    f, toe = _contact_forces(robot, X, joints, contact)
    if q_ddot is None:
        on_crank = torque + gear
        q_ddot = _acceleration(robot, q, q_dot, D_q, bias, M, h + f, on_crank, fixed_base, gravity)
    q_ddot = np.asarray(q_ddot, dtype=float)
    ratio = robot.motor.gear_ratio
    rotor = robot.motor.rotor_inertia * (q_ddot[..., 2] + ratio * q_ddot[..., 3])
    missing = M * (times(D_q, q_ddot[..., None, :]) + bias) - h - f
    C_T = np.swapaxes(constraint_matrix(robot, leg_sides(robot), X), -1, -2)
    solved = np.linalg.solve(C_T[..., DOF:, :], missing[..., DOF:, None])
    multipliers = np.asarray(solved, np.float64)
    rest = missing[..., :DOF] - (C_T[..., :DOF, :] @ multipliers)[..., 0]
    body = missing.copy()
    # The paper's h contains -tau on the frame of the first leg, and +tau on its crank.
    body[..., 0, 0] += rest[..., 3].sum(axis=-1) + rotor
    body[..., 0, 3] -= rest[..., 3].sum(axis=-1)
    centres = X.reshape(*X.shape[:-1], -1, 3)[..., 1:]
    arm = centres[..., 0, :] - q[..., None, :2]  # from the crank axis to the centre of mass
    moment = rest[..., 0] + arm[..., 0] * rest[..., 2] - arm[..., 1] * rest[..., 1]
    return JointForces(
        robot=robot,
        pin=multipliers.reshape(*X.shape[:-1], -1, 2),
        frame=np.stack([rest[..., 1], rest[..., 2], moment], axis=-1),
        shaft=rest[..., 3],
        gear=ratio * rotor - gear,
        toe=toe,
        body=body.reshape(*missing.shape[:-1], -1, 3),
        joints=joints,
        centres=centres,
        q_ddot=q_ddot,
    )


def _check_arguments(
    q: Array,
    q_dot: Array,
    torque: Array | float,
    fixed_base: bool,
    q_ddot: Array | None,
    dry: Array | float | None,
) -> None:
    """Raise ValueError if the shapes do not match, or a fixed chassis moves."""
    if q.shape[-1:] != (4,) or q_dot.shape != q.shape:
        raise ValueError(
            f"q and q_dot must have the shape (..., 4), got {q.shape} and {q_dot.shape}"
        )
    if not (np.isfinite(q).all() and np.isfinite(q_dot).all()):
        raise ValueError(f"q and q_dot must be finite, got {q} and {q_dot}")
    for name, value in (("torque", torque), ("dry", 0.0 if dry is None else dry)):
        if np.ndim(value) > 0 and np.shape(value) != q.shape[:-1]:
            raise ValueError(f"{name} must have the shape {q.shape[:-1]}, got {np.shape(value)}")
    if q_ddot is not None and np.shape(q_ddot) != q.shape:
        raise ValueError(f"q_ddot must have the shape {q.shape} of q, got {np.shape(q_ddot)}")
    for name, rate in (("q_dot", q_dot), ("q_ddot", q_ddot)):
        if fixed_base and rate is not None and np.any(np.asarray(rate)[..., :3] != 0.0):
            raise ValueError(f"the first three of {name} must be 0 with a fixed base, got {rate}")


def _contact_forces(
    robot: Robot, X: Array, joints: Array, contact: Array | None
) -> tuple[Array, Array]:
    """Return the contact forces in the legs' coordinates, and those on the toes.

    Returns:
        Generalised forces, shape (..., legs, 24), and forces on the toes in N, shape (..., toes,
        2).
    """
    f = np.zeros(X.shape)
    toe = np.zeros((*X.shape[:-2], len(robot.toes), 2))
    if contact is None:
        return f, toe
    contact = np.asarray(contact, dtype=float)
    layout = pad_layout(robot)
    pads = contact.shape[-2] if contact.ndim > 1 else 0
    if contact.shape != (*X.shape[:-2], pads, 3) or pads > len(layout.leg):
        allowed = (*X.shape[:-2], f"<= {len(layout.leg)}", 3)
        raise ValueError(f"contact must have the shape {allowed}, got {contact.shape}")
    for k in range(pads):
        leg = layout.leg[k]
        joint, body = robot.linkage.all_pads[layout.joint[k]]
        column = 3 * body
        force = contact[..., k, :2]
        moment = contact[..., k, 2]
        arm = joints[..., leg, joint, :] - X[..., leg, column + 1 : column + 3]
        f[..., leg, column] += moment + arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
        f[..., leg, column + 1 : column + 3] += force
        if k < layout.toes:
            toe[..., k, :] += force
    return f, toe


def _dry_friction(
    robot: Robot, D_q: Array, speed: Array, dry: Array | float | None
) -> tuple[Array, Array]:
    """Return the dry friction of the bearings and of the gear.

    Returns:
        Generalised forces of the bearings in the legs' coordinates, shape (..., legs, 24), and the
        friction torque of the gear on the crank in N m, shape (...).
    """
    h = np.zeros(D_q.shape[:-1])
    size = np.array(robot.bearing_friction)
    first, second = 3 * (np.array(robot.linkage.bearings).T - 1)  # rows of the bodies' angles
    turning = D_q[..., second, 3] - D_q[..., first, 3]
    most = robot.motor.friction + (size * np.abs(turning)).sum(axis=(-2, -1))
    if dry is None:
        share = -np.sign(speed)
    else:
        share = np.divide(dry, most, out=np.zeros(speed.shape), where=most > 0.0)
    moments = share[..., None, None] * size * np.sign(turning)
    for k, (i, j) in enumerate(zip(first, second, strict=True)):
        h[..., j] += moments[..., k]
        h[..., i] -= moments[..., k]
    return h, share * robot.motor.friction


def _acceleration(
    robot: Robot,
    q: Array,
    q_dot: Array,
    D: Array,
    bias: Array,
    M: Array,
    h: Array,
    torque: Array | float,
    fixed_base: bool,
    gravity: Gravity,
) -> Array:
    """Return the accelerations of (x, y, theta, psi), shape (..., 4).

    They are the solution of equation (12), including the payload and the contact forces.
    """
    mass = np.einsum("...lij,i,...lik->...jk", D, M, D)
    force = np.einsum("...lij,...li->...j", D, h - M * bias)
    force[..., 3] += torque
    load = robot.payload
    if load.mass > 0.0 or load.inertia > 0.0:
        cos, sin = np.cos(q[..., 2]), np.sin(q[..., 2])
        px, py = load.position
        arm = np.stack([cos * px - sin * py, sin * px + cos * py], axis=-1)
        J = np.zeros((*q.shape[:-1], 3, 4))  # Jacobian of the payload's theta, x and y
        J[..., 0, 2] = J[..., 1, 0] = J[..., 2, 1] = 1.0
        J[..., 1, 2] = -arm[..., 1]
        J[..., 2, 2] = arm[..., 0]
        M_load = np.array([load.inertia, load.mass, load.mass])
        h_load = np.zeros((*q.shape[:-1], 3))
        h_load[..., 1:] = load.mass * q_dot[..., 2, None] ** 2 * arm
        h_load[..., 1:] += load.mass * np.array(gravity_vector(gravity))
        mass += np.einsum("...ij,i,...ik->...jk", J, M_load, J)
        force += np.einsum("...ij,...i->...j", J, h_load)
    motor = robot.motor
    if motor.rotor_inertia > 0.0:
        spin = np.array([1.0, motor.gear_ratio])
        mass[..., 2:, 2:] += motor.rotor_inertia * np.outer(spin, spin)
    if fixed_base:
        q_ddot = np.zeros(q.shape)
        q_ddot[..., 3] = force[..., 3] / mass[..., 3, 3]
        return q_ddot
    return np.asarray(np.linalg.solve(mass, force[..., None])[..., 0], np.float64)
