"""Record of a robot, and the tuples of arrays that kernels and their stages share.

The record of a robot contains the parameters and the seed of its episode, and all values that a
control step reads and changes. :data:`ROBOT` is the part that has the same size for every robot.
:func:`record_dtype` adds the parts whose size depends on the number of toes and pads, on the
longest delay, and on the task. A kernel gets each part as an array whose rows are not adjacent in
memory, see :class:`Motions` and :class:`jansen_env.engine.episode.Episodes`.

The result of a control step also depends on the following data, which are not in the record:

- the action,
- the tables of the robot's design, the terrain, and the settings of the simulation
  (:class:`Designs`),
- the settings of pushes and of the reward (:class:`jansen_env.engine.episode.Episodes`), and
- the settings of the observation, such as the standard deviations of the sensors, and the paths of
  the toes (:class:`jansen_env.engine.episode.Observing`).

A control step changes none of these data. The random numbers of a control step, including the
biases of the sensors, follow from the seed in the record and from the time since the reset. A reset
and a change of parameters also read the robot to which the parameters are applied
(:data:`MACHINE`). If the terrain consists of pymunk's shapes, or if pymunk moves the robot, a
control step also depends on data of pymunk.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.kernel import (
    APART,
    PYTHON,
    Bools1,
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Floats5,
    Ints1,
    Ints2,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def row_dtype(fields: list[tuple[Any, ...]]) -> np.dtype[np.void]:
    """Return a structured dtype whose rows have their fields as attributes.

    The rows also have these attributes if the kernels run as plain Python.

    Args:
        fields: Fields of the dtype, as ``numpy.dtype`` takes them.
    """
    dtype = np.dtype(fields, align=True)
    return np.dtype((np.record, dtype)) if PYTHON else dtype


def floats(*names: str) -> list[tuple[str, type]]:
    """Return fields for :func:`row_dtype` that hold one float each.

    Args:
        *names: Names of the fields.
    """
    return [(name, float) for name in names]


PROPERTIES = row_dtype(
    [
        ("design", "i8"),  # index of the design in the tables
        ("mass", "f8"),  # kg, including the load
        # Sum of the inertias of the links about their centres of mass, in kg m^2. It is a part of
        # the inertia of the pitch.
        ("own_inertia", "f8"),
        ("mass_scale", "f8"),  # factor on the masses and inertias of the links
        ("inertia_scale", "f8"),  # additional factor on the inertias of the links
        ("damping_scale", "f8"),  # factor on the viscous friction of the joints
        ("load_mass", "f8"),  # kg
        ("load_inertia", "f8"),  # kg m^2
        ("load_x", "f8"),  # m, position of the load in the chassis frame
        ("load_y", "f8"),
        ("gravity_x", "f8"),  # m/s^2
        ("gravity_y", "f8"),
        ("friction", "f8"),  # friction coefficient of the terrain
        ("restitution", "f8"),  # coefficient of restitution of the terrain
        ("steepest", "f8"),  # largest slope of the terrain, as a tangent
        ("pad_radius", "f8"),  # m
        ("pitch_arm", "f8"),  # m, largest distance of a pad from the centre of mass
        # Largest speed of a pad relative to the centre of mass per crank speed, in m.
        ("crank_arm", "f8"),
        ("fixed_chassis", "?"),  # whether the chassis is fixed and only the crank turns
        ("prescribed_speed", "?"),  # whether the crank keeps its speed, whatever torque this takes
        # The motor, see :class:`jansen_env.robot.motor.Motor`.
        ("rotor_pitch", "f8"),  # kg m^2, inertias that the rotor adds
        ("rotor_coupling", "f8"),
        ("rotor_crank", "f8"),
        ("stall_torque", "f8"),  # N m; infinite for an ideal motor
        ("torque_slope", "f8"),  # N m s, slope of the torque-speed line
        ("most_torque", "f8"),  # N m, largest torque; infinite for an ideal motor
        ("winding", "f8"),  # W / (N m)^2
        # Torque of the armature per torque at the crank, if the motor drives the crank and if the
        # crank drives the motor.
        ("driving", "f8"),
        ("driven", "f8"),
        ("limited", "?"),  # whether there is a torque-speed line
        ("viscous_friction", "f8"),  # N m s
        ("gear_friction", "f8"),  # N m, Coulomb friction
        ("dry", "?"),  # whether the gear or a bearing has Coulomb friction
        ("sprung", "?"),  # whether the legs have springs
        # The pads, see :class:`jansen_env.robot.Compliance`.
        ("compliant", "?"),
        ("stiffness", "f8", 2),  # N/m, normal and tangential
        ("pad_damping", "f8", 2),  # N s/m, normal and tangential
    ]
)
"""Physical properties of a robot in an episode, which the stages of a time step read.

The kernel ``apply_parameters`` computes them from the robot (:data:`MACHINE`) and the parameters of
its episode (:data:`PARAMETERS`).
"""

STATUS = row_dtype(
    [
        ("step", "i8"),  # time steps taken in this control step
        ("lost", "?"),  # whether the robot has diverged in this control step
        # Speculative margin, in m: planes within this distance of a pad are listed.
        ("margin", "f8"),
        ("pad_radius", "f8"),  # m
        # Range of the robot's planes, which are ordered by pad and then by distance.
        ("first_plane", "i8"),
        ("end_plane", "i8"),
        ("first_vertex", "i8"),  # range of the vertices of the robot's terrain
        ("end_vertex", "i8"),
        # Range of the vertices that the robot can reach.
        ("first_near", "i8"),
        ("end_near", "i8"),
        # Position of the crank axis, in m, at which this range was determined; inf if it was never
        # determined.
        ("ground_x", "f8"),
        ("room", "f8"),  # m, distance that the robot may move from there
        ("too_deep", "?"),  # whether a pad is so deep in the ground that it has no plane
        # Whether pymunk lists the planes, because the terrain is not a height line.
        ("on_shapes", "?"),
        ("waits", "?"),  # whether the step has stopped until pymunk has listed the planes
    ]
)
"""Progress, terrain and contact planes of a robot in a control step."""

ACCUMULATORS = row_dtype(
    [
        ("motor_work", "f8"),  # J
        ("joint_loss", "f8"),  # J
        ("slip_loss", "f8"),  # J
        ("impact_loss", "f8"),  # J
        ("worst_residual", "f8"),  # N s, largest residual of the contact law in a time step
        ("contact_gain", "f8"),  # J, largest energy that contact impulses added in a time step
        # Largest ratio of the contact impulses to the impulses that the motion explains.
        ("impulse_ratio", "f8"),
        ("non_toe_impulse", "f8"),  # N s, normal impulse on pads other than toes
        # Number of sides of links that are below a vertex of the ground at the end of the step.
        ("links_in_ground", "i8"),
        ("initial_energy", "f8"),  # J, kinetic and potential energy at the beginning of the step
        ("energy_change", "f8"),  # J, change of the energy since then
        ("elastic_energy", "f8"),  # J, energy of compliant pads
        # Impulse of the motor torque minus that of the latest commanded torque, in N m s.
        ("torque_impulse", "f8"),
        ("electrical_work", "f8"),  # J, drawn by the motor
        ("push_work", "f8"),  # J, work of the pushes on the chassis
        ("correction_work", "f8"),  # J, work of moving pads out of the ground
    ]
)
"""Sums over the time steps of a control step."""

PARAMETERS = row_dtype(
    floats(
        "friction",
        "restitution",
        "payload",
        "payload_x",
        "payload_y",
        "mass_scale",
        "inertia_scale",
        "damping_scale",
        "foot_stiffness_scale",
        "foot_damping_scale",
        "motor_strength",
        "rotor_inertia_scale",
        "tilt",
        "delay",
        "noise_level",
        "push_strength",
        "terrain_level",
        "gravity_scale",
    )
)
"""Parameters of an episode.

:data:`jansen_env.plants.parameters.TABLE` has their meanings and limits.
"""

MOTION = ("x_position", "x_velocity", "pitch", "crank_angle", "crank_speed", "crank_torque")
SUPPORT = ("ground_load", "unsupported")
INFORMATION = row_dtype(
    [*floats(*MOTION, *SUPPORT, "joint_gap"), ("links_in_ground", "i8"), ("diverged", bool)]
)
"""Information on a robot in the simulation; the environments document the units."""

ENERGIES = row_dtype(
    floats(
        "motor_work",
        "push_work",
        "correction_work",
        "electrical_work",
        "joint_loss",
        "slip_loss",
        "impact_loss",
        "mechanical_energy_change",
        "residual",
    )
)
"""Energies of the last control step, in J."""

GROUND_LOAD = row_dtype(
    [
        ("impulse", "f8"),  # N s, sum of the normal impulses of all contacts in the current window
        ("steps", "i8"),  # time steps in the current window
        # Mean of (load - 1)^2 over the windows that ended in a control step: the last step in which
        # any window ended.
        ("unevenness", "f8"),
    ]
)
"""Load that the ground carries, see :mod:`jansen_env.engine.ground_load`."""

ESTIMATES = 8
ONBOARD = row_dtype(
    [
        # Estimates of the cosine and sine of the pitch, of the crank angle (rad) and speed (rad/s),
        # and of the velocity (m/s); then the pitch rate (rad/s) and two accelerations (m/s^2),
        # which are exact.
        ("estimates", "f8", ESTIMATES),
        # Pitch (rad) and velocity of the crank axis in x and y (m/s) at the last reading.
        ("before", "f8", 3),
        ("is_first", "?"),  # whether there are no estimates yet
    ]
)
"""Memory of a robot's onboard sensors, see :mod:`jansen_env.engine.onboard_estimates`."""

ROBOT = row_dtype(
    [
        # Mechanical state: x, y, theta, psi and their rates, in m, rad and s; x, y is the position
        # of the crank axis.
        ("state", "f8", 8),
        ("properties", PROPERTIES),
        ("status", STATUS),
        ("accumulators", ACCUMULATORS),
        ("diverged", "?"),  # whether the robot diverged in the last step, which was then undone
        ("parameters", PARAMETERS),
        # The episode.
        ("seed", "i8"),  # seed of everything that is sampled during the episode
        ("elapsed", "i8"),  # control steps since the reset
        # Delay of the torque: a number of control steps, and an additional number of time steps.
        ("delay", "i8", 2),
        ("scheduled", "i8"),  # number of pushes in the robot's schedule
        ("random_pushes", "?"),  # whether random pushes are enabled in this episode
        # Values derived from the robot and its parameters.
        ("weight", "f8"),  # N
        ("direction", "f8"),  # sign of the crank speed with which the robot walks towards +x
        ("full_torque", "f8"),  # N m, torque of action 1, with its sign
        # Largest change of the action in a control step; infinite if there is no limit.
        ("most_change", "f8"),
        # The last step.
        ("action", "f8"),  # after clipping and limiting the rate
        ("action_before", "f8"),
        ("x_before", "f8"),  # m, position of the crank axis at the beginning of the step
        ("info", INFORMATION),
        ("energy", ENERGIES),
        ("ground_load", GROUND_LOAD),
        ("reward", "f8"),
        ("terminated", "?"),
        ("onboard", ONBOARD),
    ]
)
"""Part of a robot's record that has the same size for every robot."""

CONTACT_STATISTICS = row_dtype([("slip", "f8"), ("impulse", "f8", 2), ("deflection", "f8", 2)])
"""Sums over a control step for each pad, and the deflection of a compliant pad.

The sums are ``slip``, the path in m that the pad slid while loaded, and ``impulse``, the tangential
and the normal impulse in N s.

The ``deflection`` is a part of the state. It consists of the compression of the pad's spring and
the bend of its bristle, in m. If the pad has several springs, the compression is the root of the
sum of their squares. It is infinite if it is unknown.
"""

UNKNOWN_DEFLECTION = np.inf, 0.0
"""Deflection of a pad whose past is unknown: compressed as the ground presses it, and not bent."""

PAD = row_dtype([("table", "i8"), ("phase", "f8"), ("mirror", "f8")])
"""Pad of a design.

``table`` is the index of the pad's table. The table is read at the angle mirror * psi + phase, in
rad, and the x coordinate is multiplied by ``mirror``, which is 1 on fore legs and -1 on back legs.
"""

WORLD = row_dtype(
    [
        ("time_step", "f8"),  # s
        ("stride", "i8"),  # number of time steps after which the planes are listed again
        ("toes", "i8"),  # number of toes, which are the first pads
        ("capacity", "i8"),  # largest number of planes that are listed for a robot
        ("links_collide", "?"),  # whether sides of links touch vertices of the ground
        ("steps", "i8"),  # time steps per control step
        ("period", "f8"),  # s, duration of a control step
        ("is_walk", "?"),  # whether the task is the compiled walking task or extends it
        # Whether the kernel also fills the observation at the end of a control step, because no
        # method in Python follows.
        ("fully_compiled", "?"),
        ("noisy", "?"),  # whether the sensors have errors
        ("onboard", "?"),  # whether onboard sensors are observed
    ]
)
"""Data that the robots of a batch have in common."""

MACHINE = row_dtype(
    [
        ("nominal", PROPERTIES),  # values before the parameters of an episode are applied
        ("links_mass", "f8"),  # kg
        ("torque_limit", "f8"),  # N m
        ("advance", "f8"),  # m per turn of the crank, with its sign
        ("centre", "f8", 2),  # kg m, largest |c| and |c'| of the robot without its load
        ("pad", "f8", 2),  # m, largest |p| and |p'| of the pads
    ]
)
"""A robot before the parameters of an episode change it."""

PLANE = row_dtype(
    [
        ("normal_x", "f8"),  # unit vector that points out of the ground
        ("normal_y", "f8"),
        # Offset, in m. The gap of a pad is normal . (centre - vertex) - offset - radius.
        ("offset", "f8"),
        ("distance", "f8"),  # m, distance of the pad's centre when the plane was listed
        ("pad", "i8"),
        # If a side of a link is over a vertex: the pad at the other end of the side, and the
        # position of the vertex in m. For a pad: -1 and 0.
        ("far_pad", "i8"),
        ("vertex_x", "f8"),
        ("vertex_y", "f8"),
        ("mode", "i8"),  # contact mode in the last time step, the first guess for the next one
        # Compression of a compliant pad's spring at this plane, in m, as far as it stores energy.
        ("compression", "f8"),
        ("deflection", "f8"),  # m, bend of the pad's bristle at this plane
    ]
)
"""Plane by which the ground may touch a pad or a side of a link."""


Robots = Annotated[NDArray[np.void], ROBOT, 1, APART]
Statistics = Annotated[NDArray[np.void], CONTACT_STATISTICS, 2, APART]
FloatRows2 = Annotated[NDArray[np.float64], np.dtype("f8"), 2, APART]
FloatRows3 = Annotated[NDArray[np.float64], np.dtype("f8"), 3, APART]
Machines = Annotated[NDArray[np.void], MACHINE, 1]
Layout = Annotated[NDArray[np.void], PAD, 1]
Layouts = Annotated[NDArray[np.void], PAD, 2]
World = Annotated[NDArray[np.void], WORLD, 1]
Planes = Annotated[NDArray[np.void], PLANE, 1]


def record_dtype(
    toes: int, pads: int, delayed: int = 2, pushes: int = 0, task: np.dtype[np.void] | None = None
) -> np.dtype[np.void]:
    """Return the dtype of a robot's record.

    Args:
        toes: Number of toes.
        pads: Number of contact pads, including the toes.
        delayed: Number of stored torques, for the longest delay.
        pushes: Largest number of pushes in the schedule.
        task: Dtype of the task's part of the record; None for no task.
    """
    return np.dtype(
        [
            ("robot", ROBOT),
            ("slip", "f8", (toes,)),  # m, path that each toe slid while loaded
            ("contact_force", "f8", (toes, 2)),  # N, tangential and normal, means over the step
            ("load", "f8", (toes,)),  # normal force on each toe / weight
            ("statistics", CONTACT_STATISTICS, (pads,)),
            ("torques", "f8", (delayed,)),  # N m, commanded torques, latest first
            ("schedule", "f8", (pushes, 3)),  # start in s, impulses in x and y in N s
            ("task", np.dtype([]) if task is None else task),
        ],
        align=True,
    )


class Motions(NamedTuple):
    """Motion of n robots: parts of their records.

    Attributes:
        robots: Records of :data:`ROBOT`, shape (n,).
        statistics: Records of :data:`CONTACT_STATISTICS`, shape (n, pads).
        slip: Path that each toe slid while loaded in the last step, in m, shape (n, toes).
        contact_force: Tangential and normal force on each toe, means over the last step, in N,
            shape (n, toes, 2).
    """

    robots: Robots
    statistics: Statistics
    slip: FloatRows2
    contact_force: FloatRows3


class Designs(NamedTuple):
    """Data that the robots of a batch share: tables of their designs, and terrains.

    Attributes:
        world: Record of :data:`WORLD`, shape (1,).
        body: Tables of the bodies, see :class:`Model`, with the designs along the first axis.
        pads: Tables of the pads, likewise.
        layout: Pads of the designs, likewise.
        bearings: Friction of the bearings, likewise.
        springs: Energy of the springs, likewise.
        sides: Pads at the ends of the links' sides, shape (sides, 2).
        depths: Depths of a :class:`Ground` for each design, shape (designs, ...).
        surface: Vertices of all terrains, in m, shape (vertices, 2).
    """

    world: World
    body: Floats4
    pads: Floats5
    layout: Layouts
    bearings: Floats2
    springs: Floats4
    sides: Ints2
    depths: Floats2
    surface: Floats2


class Scratch(NamedTuple):
    """Work space of a thread, see :func:`jansen_env.engine.integrator.work_space`.

    Attributes:
        jacobians: Jacobians of the contacts.
        matrices: Delassus matrix and its factors.
        vectors: Vectors of the contact problem.
        readings: Readings of the tables.
        spare: Work space for the search for contact modes.
        ints: Integers of the contact problem.
        planes: Contact planes of a robot.
        pushes: Impulses of the pushes in each time step, in N s, shape (1, steps, 2).
        pressed: Sum of the normal impulses on the ground in each time step, in N s, shape (steps,).
        state: State at the beginning of the step, shape (8,).
        deflection: Deflection of the pads at the beginning of the step, in m, shape (pads, 2).
        flags: Whether a robot has moved by the margin, and whether a robot has diverged, shape
            (2,).
    """

    jacobians: Floats3
    matrices: Floats3
    vectors: Floats2
    readings: Floats3
    spare: Floats2
    ints: Ints1
    planes: Planes
    pushes: Floats3
    pressed: Floats1
    state: Floats1
    deflection: Floats2
    flags: Bools1


class Model(NamedTuple):
    """Tables of a compiled robot, see :class:`jansen_env.dynamics.reduced.Tables`.

    The tables of several designs have the designs along an additional first axis.

    Attributes:
        body: Polynomials of c_x, c_y, I, b, k, f, and of the parts of b and k that come from the
            inertias J of the links, shape (intervals, order, 8).
        pads: Polynomials of p_x, p_y and a, shape (tables, intervals, order, 3).
        layout: Records of :data:`PAD`, shape (pads,).
        bearings: Coulomb friction of all bearings on the crank over a turn, in N m, shape
            (samples,).
        springs: Polynomials of the energy of all springs, in J, shape (intervals, order, 1).
    """

    body: Array
    pads: Array
    layout: NDArray[np.void]
    bearings: Array
    springs: Array


class Ground(NamedTuple):
    """Input of collision detection.

    Attributes:
        surface: Vertices of all terrains, in m, shape (vertices, 2).
        depths: Depth below the crank axis at which a pad other than a toe may touch the ground, for
            each pitch, in m. The last entry is the largest of these depths.
    """

    surface: Array
    depths: Array


class Velocity(NamedTuple):
    """Generalised velocity.

    Attributes:
        x: Velocity of the centre of mass in x, in m/s.
        y: Velocity of the centre of mass in y, in m/s.
        pitch: Pitch rate, in rad/s.
        crank: Crank speed, in rad/s.
    """

    x: float
    y: float
    pitch: float
    crank: float


class Push(NamedTuple):
    """Load on the chassis in a time step, as a generalised force.

    Attributes:
        x: Force in x per mass of the robot, in m/s^2.
        y: Force in y per mass of the robot, in m/s^2.
        pitch: Generalised force on the pitch, in N m.
        crank: Generalised force on the crank, in N m.
    """

    x: float
    y: float
    pitch: float
    crank: float


class Inertia(NamedTuple):
    """Inertia about the centre of mass at the middle of a step; ' is d/dpsi.

    Attributes:
        s: Position of the centre of mass in the chassis frame, in m.
        ds: s', in m.
        dds: s'', in m.
        pitch: I_s, in kg m^2.
        pitch_slope: I_s', in kg m^2.
        coupling: b_s, in kg m^2.
        coupling_slope: b_s', in kg m^2.
        crank: k_s, in kg m^2.
        crank_slope: k_s', in kg m^2.
        damping: f, in N m s.
        m11: First diagonal entry of the inverse of the 2 x 2 block for pitch and crank. The block
            includes the damping over half a step.
        m12: Off-diagonal entry of this inverse.
        m22: Second diagonal entry of this inverse.
    """

    s: tuple[float, float]
    ds: tuple[float, float]
    dds: tuple[float, float]
    pitch: float
    pitch_slope: float
    coupling: float
    coupling_slope: float
    crank: float
    crank_slope: float
    damping: float
    m11: float
    m12: float
    m22: float


class Problem(NamedTuple):
    """Contact law of a time step, for up to n contacts.

    Contact c has the rows 2 c (normal) and 2 c + 1 (tangential).

    Attributes:
        W: Delassus matrix, in 1/kg, shape (2 n, 2 n).
        v_free: Velocities without contact impulses, in m/s, shape (2 n,).
        mu: Friction coefficients, shape (n,).
        mode: First guess of the contact modes, replaced by those of the solution, shape (n,).
        P: Output, impulses in N s, shape (2 n,).
        u: Output, velocities in m/s, shape (2 n,).
        A: Work space for LU factors, shape (2 n, 2 n).
        rhs: Work space, shape (2 n,).
        factored: Number of unknowns of the linear problem whose LU factors are in ``A``; 0 if
            there are no valid factors, shape (1,).
        factored_modes: Contact modes to which these factors belong, shape (n,).
        unknowns: Row of ``P`` of each unknown of this linear problem, shape (2 n,).
        exchanges: Row with which each row was exchanged in the factorisation, shape (2 n,).
        search: Work space for the search for contact modes: the modes of the best solution, then
            the basis of Lemke's method, shape (5 n,).
        spare: Work space for the same search, shape (4 n + 4, 8 n + 2).
    """

    W: Array
    v_free: Array
    mu: Array
    mode: Ints
    P: Array
    u: Array
    A: Array
    rhs: Array
    factored: Ints
    factored_modes: Ints
    unknowns: Ints
    exchanges: Ints
    search: Ints
    spare: Array


class Contacts(NamedTuple):
    """Contacts of a time step, and their contact law.

    The attributes ``give`` to ``curve`` are used for compliant pads only, see
    :mod:`jansen_env.engine.compliance`.

    Attributes:
        J: Jacobian, shape (2 n, 4).
        MJ: J M^-1, shape (2 n, 4).
        offset: Velocity that is added to J v, in m/s, shape (2 n,): half a step of the curvature of
            the pads' paths, or the effect of springs.
        gap: Gaps, in m, shape (n,).
        give: Impulse per velocity at the end of the step, in kg, shape (2 n,).
        middle: Gap and bend of the bristle at the middle of the step, in m, shape (2 n,).
        ahead: Time from there to the time at which the contact law is evaluated, in s, shape
            (2 n,).
        curve: Curvature of the path as far as it is taken into account, in m/s, shape (2 n,).
        plane: Index of the plane of each contact, shape (n,).
        problem: Contact law.
    """

    J: Array
    MJ: Array
    offset: Array
    gap: Array
    give: Array
    middle: Array
    ahead: Array
    curve: Array
    plane: Ints
    problem: Problem


class Work(NamedTuple):
    """Work space of a robot in a step.

    Attributes:
        contacts: Contacts of a time step.
        bound: Distance that the pads may travel before they can touch each plane, in m, shape
            (planes,).
        sums: Readings of the table of the body, shape (3, 6).
        place: Readings of the table of a pad, shape (3, 6), of which the first three columns are
            used.
        pose: Last pose, followed by an upper bound of the distance that any pad has travelled since
            the first pose, shape (6,).
        listed: Pose at which the planes were listed, shape (6,).
    """

    contacts: Contacts
    bound: Array
    sums: Array
    place: Array
    pose: Array
    listed: Array
