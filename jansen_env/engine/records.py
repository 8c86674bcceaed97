"""The record of a robot, and the tuples of arrays that kernels and their stages share.

Everything that a robot's future depends on stands in one record. :data:`ROBOT` is the part that has
the same size for every robot; :func:`record_dtype` adds the parts whose size depends on the number
of its toes and pads, on the longest delay, and on its task. A kernel gets each part as an array
whose rows lie apart, see :class:`Motions` and :class:`jansen_env.engine.episode.Episodes`.
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
    """A structured dtype whose rows have their fields as attributes, as plain Python too."""
    dtype = np.dtype(fields, align=True)
    return np.dtype((np.record, dtype)) if PYTHON else dtype


def floats(*names: str) -> list[tuple[str, type]]:
    """Fields of :func:`row_dtype` that are numbers."""
    return [(name, float) for name in names]


PARAMS = row_dtype(
    [
        ("design", "i8"),  # row of the designs' tables
        ("mass", "f8"),  # kg, load included
        ("own_inertia", "f8"),  # kg m^2, of the links about their centres, in the pitch's
        # Factors of the links' masses and inertias, of their inertias on top, and of the joints'
        # viscous friction.
        ("mass_scale", "f8"),
        ("inertia_scale", "f8"),
        ("damping_scale", "f8"),
        ("load_mass", "f8"),  # kg
        ("load_inertia", "f8"),  # kg m^2
        ("load_x", "f8"),  # m, chassis frame
        ("load_y", "f8"),
        ("gravity_x", "f8"),  # m/s^2
        ("gravity_y", "f8"),
        ("friction", "f8"),  # of the terrain
        ("restitution", "f8"),
        ("steepest", "f8"),  # largest slope of the terrain, a tangent
        ("pad_radius", "f8"),  # m
        ("pitch_arm", "f8"),  # m, the farthest that a pad gets from the centre of mass
        ("crank_arm", "f8"),  # m, a pad's fastest motion against that per crank speed
        ("held", "?"),  # whether the chassis stays where it is, and only the crank turns
        ("prescribed_speed", "?"),  # whether the crank keeps its speed whatever torque that takes
        # The motor, see :class:`jansen_env.robot.motor.Motor`; inertias it adds, kg m^2.
        ("rotor_pitch", "f8"),
        ("rotor_coupling", "f8"),
        ("rotor_crank", "f8"),
        ("stall_torque", "f8"),  # N m; inf: ideal
        ("torque_slope", "f8"),  # N m s
        ("most_torque", "f8"),  # N m; inf: ideal
        ("winding", "f8"),  # W / (N m)^2
        ("driving", "f8"),  # the armature's torque per torque at the crank, and where it is driven
        ("driven", "f8"),
        ("limited", "?"),  # whether there is a torque-speed line
        ("viscous_friction", "f8"),  # N m s
        ("gear_friction", "f8"),  # N m
        ("dry", "?"),  # whether gear or bearings have Coulomb friction
        # The pads, see :class:`jansen_env.robot.Compliance`.
        ("compliant", "?"),
        ("stiffness", "f8", 2),  # N/m, normal and tangential
        ("pad_damping", "f8", 2),  # N s/m
    ]
)
"""Numbers that may differ between the robots of a batch."""

STATUS = row_dtype(
    [
        ("step", "i8"),  # time steps taken of this control step
        ("lost", "?"),  # whether it has diverged in it
        ("margin", "f8"),  # m from its pads within which planes are listed, the speculative margin
        ("pad_radius", "f8"),  # m
        ("first_plane", "i8"),
        ("end_plane", "i8"),  # ordered by pad, then nearest first
        ("first_vertex", "i8"),  # of its terrain
        ("end_vertex", "i8"),
        ("first_near", "i8"),  # those of the stretch that it can reach, by pymunk
        ("end_near", "i8"),
        ("asked_x", "f8"),  # m, of the crank axis when that was asked for; inf: never
        ("room", "f8"),  # m that it may move from there
        ("too_deep", "?"),  # whether a pad is so deep in the ground that it has no plane
        ("on_shapes", "?"),  # whether pymunk lists the planes, because the ground is no height line
        ("waits", "?"),  # whether the step has stopped until pymunk's planes are listed
    ]
)
"""Pose and contacts of a robot between collision detection and time steps."""

ACCUMULATORS = row_dtype(
    [
        ("motor_work", "f8"),  # J
        ("joint_loss", "f8"),
        ("slip_loss", "f8"),
        ("impact_loss", "f8"),
        ("worst_residual", "f8"),  # N s, of the contact law, the largest of a time step
        ("contact_gain", "f8"),  # J that contact impulses added, the largest of a time step
        ("impulse_share", "f8"),  # of the largest impulses that a time step's motion explains
        ("non_toe_impulse", "f8"),  # N s, normal, on pads that are no toes
        ("links_in_ground", "i8"),  # sides of links below a vertex of the ground, at the end
        ("initial_energy", "f8"),  # J, kinetic and potential, when the sums were begun
        ("energy_change", "f8"),  # J, since then
        ("elastic_energy", "f8"),  # J, in compliant pads
        ("torque_impulse", "f8"),  # N m s, of the motor, beyond the torque last asked for
        ("electrical_work", "f8"),  # J, drawn
        ("push_work", "f8"),  # J, of the pushes on the chassis
        ("correction_work", "f8"),  # J, of taking pads out of the ground
    ]
)
"""Sums over the time steps of a control step."""

PARAMETERS = row_dtype(
    floats(
        "friction", "restitution", "payload", "payload_x", "payload_y", "mass_scale",
        "inertia_scale", "damping_scale", "foot_stiffness_scale", "foot_damping_scale",
        "motor_strength", "rotor_inertia_scale", "tilt", "delay", "noise_level", "push_strength",
        "terrain_level", "gravity_scale",
    )
)  # fmt: skip
"""Parameters of an episode; :data:`jansen_env.parameters.TABLE` has their meanings and limits."""

STATE = ("x_position", "x_velocity", "pitch", "crank_angle", "crank_speed", "crank_torque")
SUPPORT = ("ground_load", "unsupported")
INFORMATION = row_dtype(
    [*floats(*STATE, *SUPPORT, "joint_gap"), ("links_in_ground", "i8"), ("diverged", bool)]
)
"""Information on a robot in its world; units are listed with the environments."""

ENERGIES = row_dtype(
    floats(
        "motor_work", "push_work", "correction_work", "electrical_work", "joint_loss", "slip_loss",
        "impact_loss", "mechanical_energy_change", "residual",
    )
)  # fmt: skip
"""Energies of the last control step, J."""

GROUND_LOAD = row_dtype(
    [
        ("impulse", "f8"),  # N s, normal, on all contacts together, in the window that is open
        ("steps", "i8"),  # time steps in that window
        ("unevenness", "f8"),  # mean of (load - 1)^2 over the windows that ended last
    ]
)
"""What the ground carries, see :mod:`jansen_env.engine.ground_load`."""

ESTIMATES = 8
ONBOARD = row_dtype(
    [
        # Cosine and sine of the pitch, crank angle (rad) and speed (rad/s), and velocity (m/s) as
        # estimated; pitch rate (rad/s) and two accelerations (m/s^2) without errors.
        ("estimates", "f8", ESTIMATES),
        ("before", "f8", 3),  # pitch, and velocity of the crank axis, when they were read last
        ("is_first", "?"),  # whether there are no estimates yet
    ]
)
"""Memory of a robot's onboard sensors, see :mod:`jansen_env.engine.onboard_estimates`."""

ROBOT = row_dtype(
    [
        ("state", "f8", 8),  # x, y, theta, psi and their rates; x, y the crank axis; m, rad, s
        ("params", PARAMS),
        ("status", STATUS),
        ("accumulators", ACCUMULATORS),
        ("diverged", "?"),  # whether the last step was refused
        ("parameters", PARAMETERS),
        # The episode.
        ("seed", "i8"),  # of everything that is sampled during the episode
        ("elapsed", "i8"),  # control steps since the reset
        ("delay", "i8", 2),  # control steps by which a torque is delayed, and time steps on top
        ("scheduled", "i8"),  # number of pushes in the robot's schedule
        ("random_pushes", "?"),
        # What follows from robot and parameters.
        ("weight", "f8"),  # N
        ("direction", "f8"),  # 1 or -1: which way the crank turns to walk towards +x
        ("full_torque", "f8"),  # N m, the torque of action 1, with its sign
        ("most_change", "f8"),  # of the action in a control step; infinite without a limit
        # The last step.
        ("action", "f8"),  # clipped
        ("action_before", "f8"),
        ("x_before", "f8"),  # m, where the step began
        ("info", INFORMATION),
        ("energy", ENERGIES),
        ("ground_load", GROUND_LOAD),
        ("reward", "f8"),
        ("terminated", "?"),
        ("onboard", ONBOARD),
    ]
)
"""The part of a robot's record that has the same size for every robot."""

CONTACT_STATISTICS = row_dtype([("slip", "f8"), ("impulse", "f8", 2), ("deflection", "f8", 2)])
"""Sums of a pad: path it slid while loaded, m; tangential and normal impulse, N s.

And of a compliant one, as part of the state, m: compression of its spring (of several, the root of
the sum of squares; inf where unknown), and bend of its bristle.
"""

UNKNOWN_DEFLECTION = np.inf, 0.0
"""Deflection of a pad whose past is unknown: compressed as the ground presses it, and not bent."""

PAD = row_dtype([("table", "i8"), ("phase", "f8"), ("mirror", "f8")])
"""A pad of a design: row of the pads' tables, read at mirror psi + phase (rad), x times mirror.

``mirror`` is 1 on fore legs and -1 on back legs.
"""

WORLD = row_dtype(
    [
        ("time_step", "f8"),  # s
        ("stride", "i8"),  # time steps between two looks for the ground
        ("toes", "i8"),  # the first so many pads are toes
        ("capacity", "i8"),  # planes kept of a robot
        ("links_collide", "?"),  # whether sides of links touch vertices of the ground
        ("steps", "i8"),  # time steps of a control step
        ("period", "f8"),  # s, of a control step
        ("is_walk", "?"),  # whether the task is, or extends, the compiled one: walking
        ("is_whole", "?"),  # whether a control step ends with the observation, all compiled
        ("noisy", "?"),  # whether sensors have errors
        ("onboard", "?"),  # whether onboard sensors are observed
    ]
)
"""Data that the robots of a batch have in common."""

MACHINE = row_dtype(
    [
        ("nominal", PARAMS),  # without parameters
        ("links_mass", "f8"),  # kg
        ("torque_limit", "f8"),  # N m
        ("advance", "f8"),  # m per turn of the crank, with its sign
        ("centre", "f8", 2),  # kg m, the largest |c| and |c'| of the robot without its load
        ("pad", "f8", 2),  # m, the largest |p| and |p'| of its pads
    ]
)
"""What a robot is before the parameters of an episode change it."""

PLANE = row_dtype(
    [
        ("normal_x", "f8"),  # unit vector out of the ground
        ("normal_y", "f8"),
        ("offset", "f8"),  # m: a pad's gap is normal . (centre - vertex) - offset - radius
        ("distance", "f8"),  # m, of the pad's centre, when it was found
        ("pad", "i8"),
        # Of a link's side over a vertex: its other end, and the vertex, m. Of a pad -1 and 0.
        ("far_pad", "i8"),
        ("vertex_x", "f8"),
        ("vertex_y", "f8"),
        ("mode", "i8"),  # the last time step's contact mode, a first guess
        ("compression", "f8"),  # m, of a compliant pad's spring there, as far as it is stored
        ("deflection", "f8"),  # m, how far its bristle is bent there
    ]
)
"""The ground as one pad may touch it."""


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
    """Return the record of a robot.

    Args:
        toes: Number of toes.
        pads: Number of contact pads, toes included.
        delayed: Number of torques that are kept, for the longest delay.
        pushes: Number of pushes for which the schedule has room.
        task: Record of the task; None for none.
    """
    return np.dtype(
        [
            ("robot", ROBOT),
            ("slip", "f8", (toes,)),  # m that each toe slid while loaded in the last step
            ("contact_force", "f8", (toes, 2)),  # N, tangential and normal, means of that step
            ("load", "f8", (toes,)),  # normal force / weight
            ("statistics", CONTACT_STATISTICS, (pads,)),
            ("torques", "f8", (delayed,)),  # N m, commanded torques, latest first
            ("schedule", "f8", (pushes, 3)),  # start, s, and impulse in x and y, N s
            ("task", np.dtype([]) if task is None else task),
        ],
        align=True,
    )


class Motions(NamedTuple):
    """How n robots move: parts of their records."""

    robots: Robots
    statistics: Statistics
    slip: FloatRows2
    contact_force: FloatRows3


class Designs(NamedTuple):
    """What the robots of a batch share: tables of their designs, see :class:`Model`; grounds."""

    world: World
    body: Floats4
    pads: Floats5
    layout: Layouts
    bearings: Floats2
    sides: Ints2  # (sides, 2) pads at the ends of links' sides
    depths: Floats2  # (designs, ...) of a :class:`Ground`
    surface: Floats2


class Scratch(NamedTuple):
    """Memory of one thread, see :func:`jansen_env.engine.integrator.work_space`."""

    jacobians: Floats3
    matrices: Floats3
    vectors: Floats2
    readings: Floats3
    spare: Floats2
    ints: Ints1
    planes: Planes
    pushes: Floats3  # (1, steps, 2) N s
    pressed: Floats1  # (steps,) N s, total normal impulse on the ground in each time step
    state: Floats1  # (8,) where the step began
    deflection: Floats2  # (pads, 2) likewise
    flags: Bools1  # (2,) whether a robot has moved by the margin, and whether one has diverged


class Model(NamedTuple):
    """The kernels' view of a compiled robot: see :class:`jansen_env.dynamics.reduced.Tables`.

    That of several designs has them along a first axis more.
    """

    body: Array  # (intervals, order, 8) c_x, c_y, I, b, k, f, and what the links' J are of b and k
    pads: Array  # (tables, intervals, order, 3) p_x, p_y, a
    layout: NDArray[np.void]  # (pads,) PAD
    bearings: Array  # (samples,) Coulomb friction of all bearings on the crank, N m, over a turn


class Ground(NamedTuple):
    """Input of collision detection."""

    surface: Array  # (vertices, 2) m, of all terrains
    depths: Array  # m, by pitch: how far below the axis a pad that is no toe may feel the ground


class Velocity(NamedTuple):
    """Generalised velocity; x, y that of the centre of mass. m/s, rad/s."""

    x: float
    y: float
    pitch: float
    crank: float


class Push(NamedTuple):
    """Load on the chassis in a time step, as a generalised force; x, y per mass, m/s^2."""

    x: float
    y: float
    pitch: float  # N m
    crank: float


class Inertia(NamedTuple):
    """At the middle of a step, about the centre of mass s; ' = d/dpsi."""

    s: tuple[float, float]
    ds: tuple[float, float]
    dds: tuple[float, float]
    pitch: float  # I_s
    pitch_slope: float  # I_s'
    coupling: float  # b_s
    coupling_slope: float
    crank: float  # k_s
    crank_slope: float
    damping: float  # f
    m11: float  # of the inverse of the block of pitch and crank, the damping's half step in it
    m12: float
    m22: float


class Problem(NamedTuple):
    """The contact law of one time step, for as many contacts as arrays hold or fewer.

    Contact c has rows 2 c (normal) and 2 c + 1 (tangential).
    """

    W: Array  # (2 n, 2 n) Delassus matrix, 1/kg
    v_free: Array  # (2 n,) velocities without contact impulses, m/s
    mu: Array  # (n,) friction
    mode: Ints  # (n,) first guess, then the solution's
    P: Array  # (2 n,) out: impulses, N s
    u: Array  # (2 n,) out: velocities, m/s
    A: Array  # (2 n, 2 n) work: LU factors
    rhs: Array  # (2 n,) work
    indices: Ints  # (10 n + 1,) work: see :func:`jansen_env.engine.contact_solver.solve`
    spare: Array  # (4 n + 4, 8 n + 2) work, where modes must be searched for


class Contacts(NamedTuple):
    """The pads that touch in a time step, and their contact law."""

    J: Array  # (2 n, 4) Jacobian
    MJ: Array  # (2 n, 4) J M^-1
    offset: Array  # (2 n,) m/s, added to J v: half a step of the path's curvature; or the springs
    gap: Array  # (n,) m
    # Of compliant pads, (2 n,): see :mod:`jansen_env.engine.compliance`.
    give: Array  # kg, impulse per velocity at the end of the step
    middle: Array  # m, gap and bristle's bend at its middle
    ahead: Array  # s, from there to where the law looks
    curve: Array  # m/s, the path's curvature, as far as it counts
    plane: Ints  # (n,) row of the planes
    problem: Problem


class Work(NamedTuple):
    """A robot's memory in a step."""

    contacts: Contacts
    bound: Array  # (planes,) m a robot's pads may travel before each plane can be touched
    sums: Array  # (3, 6) readings of the body's table
    place: Array  # (3, 6) readings of a pad's table, 3 of each row
    pose: Array  # (6,) last pose, and how far at most any pad has travelled since the first
    listed: Array  # (6,) pose at which the planes were listed
