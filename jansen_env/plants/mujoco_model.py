"""Export any robot to MuJoCo (MJCF).

The following command exports a built-in design:

    jansen-env mjcf klann --out klann.xml

The plane of motion is MuJoCo's x-z plane, and angles are counter-clockwise as seen from -y. The
bodies form a tree of hinges that begins at the chassis. Each remaining pin closes a loop by
``equality/connect``. ``docs/mjcf.md`` lists the approximations.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import positive, shown
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.pads import pad_layout
from jansen_env.dynamics.spring_forces import end_position, spring_ends, torsion_deflections
from jansen_env.plants.rigid import bodies as links
from jansen_env.plants.rigid.bodies import CHASSIS, SHAFT, place_of
from jansen_env.robot import Robot, Spring
from jansen_env.robot.kinematics import coordinates, joint_positions
from jansen_env.robot.linkage import CRANK
from jansen_env.terrain import Terrain

STIFF = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp with the largest impedance in MuJoCo
SPRING = (1e-4, 1e-4, 0.001, 0.5, 2.0)  # solimp with the smallest: a contact is a spring and damper
THICKNESS = 0.004  # radius of the links as drawn, in m


class Tree(NamedTuple):
    """The shallowest tree of bodies that begins at the chassis, and the pins that close loops.

    All positions are those of a level robot at crank angle 0.

    Attributes:
        parents: Parent of every body except the chassis. Parents come before their children.
        origins: Origin of each body, which is the pin that connects it to its parent, in m, shape
            (2,).
        loops: Two bodies and the position of the pin that connects them, in m, shape (2,), for each
            loop.
    """

    parents: dict[int, int]
    origins: dict[int, Array]
    loops: list[tuple[int, int, Array]]


def body_tree(robot: Robot) -> Tree:
    """Return a tree whose hinges are pins of the robot, and the pins that close loops."""
    linkage = robot.linkage
    pins = [(CHASSIS, SHAFT, np.zeros(2))]
    for i, leg in enumerate(robot.legs):
        joints = joint_positions(robot, leg.side, leg.phase)
        for name, body, other in linkage.moving_pins:
            place = joints[linkage.joints.index(name)]
            pins.append((place_of(robot, i, other), place_of(robot, i, body), place))
    parents: dict[int, int] = {}
    origins = {CHASSIS: np.zeros(2)}
    queue = [CHASSIS]
    for body in queue:
        for pin in [pin for pin in pins if body in pin[:2]]:
            other = pin[0] + pin[1] - body
            if other not in origins:
                parents[other] = body
                origins[other] = pin[2]
                queue.append(other)
                pins = [left for left in pins if left is not pin]
    return Tree(parents, origins, pins)


def body_names(robot: Robot) -> list[str]:
    """Return the names of all bodies.

    The hinge of a body has the same name. The hinge of the chassis is its pitch.
    """
    moving = robot.linkage.names[CRANK:]
    return ["chassis", "shaft", *(f"{leg}_{link}" for leg in robot.leg_names for link in moving)]


def hinge_angles(robot: Robot, q: Array) -> dict[str, float]:
    """Return the angles of all hinges by name, in rad.

    Args:
        robot: The robot.
        q: Pose (x, y, theta, psi), in m and rad, shape (4,).
    """
    angle = links.poses(robot, q)[:, 0]
    names = body_names(robot)
    turned = {
        names[k]: math.remainder(angle[k] - angle[up], 2.0 * math.pi)
        for k, up in body_tree(robot).parents.items()
    }
    return {**turned, "chassis": float(q[2]), "shaft": float(q[3])}


def to_mjcf(
    robot: Robot,
    terrain: Terrain | None = None,
    time_step: float = 1e-4,
    loop_stiffness: float = 1e7,
    contact_stiffness: float = 1e6,
    impratio: float = 10.0,
    gravity: float = GRAVITY,
) -> str:
    """Return a robot as MJCF.

    The robot is level at crank angle 0, and its lowest pad touches the ground.

    Args:
        robot: The robot.
        terrain: Level terrain or a slope, with its friction. None holds the chassis in the air.
        time_step: Time step, in s. It must be well below 1 / sqrt(stiffness).
        loop_stiffness: Stiffness of the constraints that close loops, divided by mass, in 1/s^2.
            The constraints are critically damped.
        contact_stiffness: Stiffness of the contacts of rigid pads, divided by mass, in 1/s^2. The
            contacts are critically damped. Compliant pads have their own stiffness and damping.
        impratio: Ratio of the stiffness of friction to that in the direction of the normal.
        gravity: Acceleration of gravity, downwards, in m/s^2.

    Raises:
        ValueError: If a number is out of range, or the terrain has several slopes.
        LinkageError: If a leg does not close.
        ImportError: If the robot has compliant pads and MuJoCo is not installed.
    """
    if terrain is not None and not isinstance(terrain, Terrain):
        raise ValueError(f"terrain must be level or a slope, got {shown(terrain)}")
    positive("time_step", time_step)
    positive("loop_stiffness", loop_stiffness)
    positive("contact_stiffness", contact_stiffness)
    positive("impratio", impratio)
    root = ET.Element("mujoco", model="jansen_env")
    tree = body_tree(robot)
    _add(root, "compiler", angle="radian")
    _add(
        root,
        "option",
        timestep=time_step,
        gravity=(0.0, 0.0, -gravity),
        integrator="implicitfast",
        cone="elliptic",
        impratio=impratio,
        solver="Newton",
        tolerance=1e-14,
        iterations="100",
    )
    world = _add(root, "worldbody")
    bodies = _add_bodies(world, robot, tree)
    if terrain is not None:
        _stand_on(world, bodies[CHASSIS], robot, terrain)
    friction = 0.0 if terrain is None else terrain.friction
    for name, k, place in _pads(robot):
        _add(
            bodies[k],
            "geom",
            name=name,
            type="sphere",
            size=robot.pad_radius,
            priority="1",
            pos=_local(place, tree.origins[k]),
            contype="1",
            conaffinity="0",
            condim="3",
            friction=(friction, 0.0, 0.0),
            solref=_critical(contact_stiffness),
            solimp=STIFF,
        )
    names = body_names(robot)
    equality = _add(root, "equality")
    for a, b, place in tree.loops:
        _add(
            equality,
            "connect",
            body1=names[a],
            body2=names[b],
            solimp=STIFF,
            anchor=_local(place, tree.origins[a]),
            solref=_critical(loop_stiffness),
        )
    tendons = _add(root, "tendon")
    _add_friction(tendons, bodies, robot, tree.parents, time_step)
    _add_leg_springs(tendons, bodies, robot, tree)
    limit = robot.motor.most_torque
    bound = {} if math.isinf(limit) else {"forcerange": (-limit, limit)}
    _add(_add(root, "actuator"), "motor", name="crank", joint="shaft", **bound)
    if not robot.pad_compliance.rigid:
        _set_springs(root, robot)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _add(parent: ET.Element, tag: str, **attributes: str | float | Sequence[float]) -> ET.Element:
    """Add an element to another element, and return it. Numbers are written in full precision."""
    return ET.SubElement(parent, tag, {name: _text(value) for name, value in attributes.items()})


def _text(value: str | float | Sequence[float]) -> str:
    """Return the text of an attribute."""
    return value if isinstance(value, str) else " ".join(map(repr, np.ravel(value).tolist()))


def _local(place: Array, origin: Array) -> tuple[float, float, float]:
    """Return a position in the plane of motion relative to an origin, as MuJoCo's (x, y, z)."""
    x, z = place - origin
    return x, 0.0, z


def _critical(stiffness: float) -> tuple[float, float]:
    """Return the solref of a critically damped constraint with a stiffness by mass in 1/s^2."""
    return -stiffness, -2.0 * math.sqrt(stiffness)


def _add_bodies(world: ET.Element, robot: Robot, tree: Tree) -> dict[int, ET.Element]:
    """Add the tree of bodies with their masses, inertias and shapes for drawing."""
    names = body_names(robot)
    home = links.poses(robot, np.zeros(4))[:, 1:]
    at = tree.origins
    bodies = {CHASSIS: _add(world, "body", name=names[CHASSIS])}
    for k, up in tree.parents.items():
        bodies[k] = _add(bodies[up], "body", name=names[k], pos=_local(at[k], at[up]))
        _add(bodies[k], "joint", name=names[k], type="hinge", axis="0 -1 0")
    for k, (mass, inertia) in enumerate(links.inertias(robot)):
        about = [max(inertia, 1e-12)] * 3  # MuJoCo does not accept point masses
        _add(bodies[k], "inertial", pos=_local(home[k], at[k]), mass=mass, diaginertia=about)
    for i, leg in enumerate(robot.legs):
        joints = joint_positions(robot, leg.side, leg.phase)
        for body, edges in enumerate(robot.linkage.edges, start=1):
            k = place_of(robot, i, body)
            for a, b in edges:
                ends = (*_local(joints[a], at[k]), *_local(joints[b], at[k]))
                _add(
                    bodies[k],
                    "geom",
                    type="capsule",
                    size=THICKNESS,
                    fromto=ends,
                    contype="0",
                    conaffinity="0",
                    group="1",
                )
    return bodies


def _pads(robot: Robot) -> list[tuple[str, int, Array]]:
    """Return the name, the body and the centre of every pad, toes first.

    The centres are those of a level robot at crank angle 0.
    """
    layout = pad_layout(robot)
    pads = []
    owners = links.pad_bodies(robot, layout)
    for i, k, body in zip(layout.leg, layout.joint, owners, strict=True):
        joint = robot.linkage.all_pads[k][0]
        leg = robot.legs[i]
        name = f"{robot.leg_names[i]}_{robot.linkage.joints[joint]}"
        pads.append((name, body, joint_positions(robot, leg.side, leg.phase)[joint]))
    return pads


def _stand_on(world: ET.Element, chassis: ET.Element, robot: Robot, terrain: Terrain) -> None:
    """Add a plane as the ground, free the chassis, and place it on the ground."""
    points = np.array(terrain.points)
    x, y = points[0]
    slopes = np.diff(points[:, 1]) / np.diff(points[:, 0])
    if np.ptp(slopes) > 1e-9:
        raise ValueError(f"terrain must have one slope, got {slopes.tolist()}")
    slope = float(slopes[0])
    below = robot.pad_radius * math.hypot(1.0, slope)
    height = max(y + slope * (u - x) - v + below for _, _, (u, v) in _pads(robot))
    chassis.set("pos", _text((0.0, 0.0, height)))
    joints = ("chassis", "hinge", "0 -1 0"), ("z", "slide", "0 0 1"), ("x", "slide", "1 0 0")
    for name, kind, axis in joints:
        chassis.insert(0, ET.Element("joint", name=name, type=kind, axis=axis))
    _add(
        world,
        "geom",
        name="ground",
        type="plane",
        size="0 0 1",
        pos=(x, 0.0, y),
        zaxis=(-slope, 0.0, 1.0),
        contype="0",
        conaffinity="1",
    )


def _add_friction(
    tendons: ET.Element,
    bodies: dict[int, ET.Element],
    robot: Robot,
    parents: dict[int, int],
    time_step: float,
) -> None:
    """Add the friction between bodies, and the rotor of the motor.

    The friction of two bodies belongs to the hinge that connects them. If there is no such hinge,
    it belongs to a tendon over all hinges between them.
    """
    names = body_names(robot)
    motor = robot.motor
    viscous = links.viscous_pairs(robot)
    dry = links.dry_pairs(robot)
    for a, b in dict.fromkeys([*viscous, *dry]):
        if parents[b] == a:
            holder = next(element for element in bodies[b] if element.get("name") == names[b])
        else:
            holder = _add(tendons, "fixed", name=f"{names[a]}_{names[b]}")
            for k in sorted(_way(a, parents) ^ (way := _way(b, parents))):
                _add(holder, "joint", joint=names[k], coef=1.0 if k in way else -1.0)
        if (a, b) in viscous:
            holder.set("damping", _text(viscous[a, b]))
        if (a, b) in dry:
            holder.set("frictionloss", _text(dry[a, b]))
            holder.set("solreffriction", _text((-1.0, -0.5 / time_step)))
            holder.set("solimpfriction", _text(STIFF))
    if motor.rotor_inertia > 0.0:  # the speed of the rotor is theta' + G psi'
        rotor = _add(tendons, "fixed", name="rotor", armature=motor.rotor_inertia)
        _add(rotor, "joint", joint="shaft", coef=motor.gear_ratio)
        if bodies[CHASSIS].find("joint") is not None:
            _add(rotor, "joint", joint="chassis", coef=1.0)


def _add_leg_springs(
    tendons: ET.Element, bodies: dict[int, ET.Element], robot: Robot, tree: Tree
) -> None:
    """Add the springs of the legs.

    A linear spring is a spatial tendon between two sites. A torsion spring is a fixed tendon over
    all hinges between its two links.
    """
    names = body_names(robot)
    linkage = robot.linkage
    for i, leg in enumerate(robot.legs):
        x = coordinates(robot, leg.side, leg.phase)
        deflections = iter(torsion_deflections(robot, leg.side, x).tolist())
        for number, spring in enumerate(robot.springs):
            name = f"{robot.leg_names[i]}_spring_{number}"
            if isinstance(spring, Spring):
                tendon = _add(
                    tendons,
                    "spatial",
                    name=name,
                    stiffness=spring.stiffness,
                    springlength=spring.rest_length,
                )
                for end, where in zip(spring_ends(robot, spring), ("start", "end"), strict=True):
                    k = place_of(robot, i, end.body + 1)
                    place, _ = end_position(end, leg.side, x)
                    site = f"{name}_{where}"
                    _add(bodies[k], "site", name=site, pos=_local(place, tree.origins[k]))
                    _add(tendon, "site", site=site)
                continue
            first = _way(place_of(robot, i, linkage.names.index(spring.first) + 1), tree.parents)
            second = _way(place_of(robot, i, linkage.names.index(spring.second) + 1), tree.parents)
            # The length of the tendon is 0 in the model's initial pose. MuJoCo's springs have no
            # negative length at rest, so the signs of all hinges are chosen accordingly.
            rest = -next(deflections)
            sign = math.copysign(1.0, rest)
            tendon = _add(
                tendons,
                "fixed",
                name=name,
                stiffness=spring.stiffness,
                springlength=abs(rest),
            )
            for k in sorted(first ^ second):
                _add(tendon, "joint", joint=names[k], coef=sign if k in second else -sign)


def _way(body: int, parents: dict[int, int]) -> set[int]:
    """Return a body and all its ancestors in the tree, without the chassis."""
    return set() if body == CHASSIS else {body} | _way(parents[body], parents)


def _set_springs(root: ET.Element, robot: Robot) -> None:
    """Make the pads springs and dampers.

    MuJoCo divides the stiffness and the damping by an effective mass that only MuJoCo can compute.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    give = robot.pad_compliance
    scale = 1.0 - SPRING[0]
    for name, k, _ in _pads(robot):
        per_mass = scale * float(model.body(body_names(robot)[k]).invweight0[0])
        pad = next(element for element in root.iter("geom") if element.get("name") == name)
        pad.set("solref", _text((-give.stiffness * per_mass, -give.damping * per_mass)))
        pad.set("solimp", _text(SPRING))
