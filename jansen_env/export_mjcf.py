"""Export any robot to MuJoCo (MJCF).

    jansen-env mjcf klann --out klann.xml

The plane of motion is MuJoCo's x-z plane, angles are counter-clockwise as seen from -y. A tree of
hinges begins at the chassis; each of the other pins closes a loop by ``equality/connect``. What is
approximate: ``docs/mjcf.md``.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import positive, shown
from jansen_env.dynamics.pads import pad_layout
from jansen_env.gravity import GRAVITY
from jansen_env.plants.rigid import bodies as links
from jansen_env.plants.rigid.bodies import CHASSIS, SHAFT, place_of
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK
from jansen_env.terrain import Terrain

STIFF = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp of the largest impedance in MuJoCo
SPRING = (1e-4, 1e-4, 0.001, 0.5, 2.0)  # of the smallest: such a contact is a spring and a damper
THICKNESS = 0.004  # m, radius of the links as drawn


class Tree(NamedTuple):
    """The shallowest tree of bodies from the chassis on, and the pins that close loops."""

    parents: dict[int, int]  # of every body but the chassis, parents first
    origins: dict[int, Array]  # (2,) of bodies: the pin on the parent, m, level at crank angle 0
    loops: list[tuple[int, int, Array]]  # two bodies and their pin


def body_tree(robot: Robot) -> Tree:
    """Find which pins are hinges of a tree, and which close loops."""
    linkage, pins = robot.linkage, [(CHASSIS, SHAFT, np.zeros(2))]
    for i, leg in enumerate(robot.legs):
        joints = joint_positions(robot, leg.side, leg.phase)
        for name, body, other in linkage.moving_pins:
            place = joints[linkage.joints.index(name)]
            pins.append((place_of(robot, i, other), place_of(robot, i, body), place))
    parents: dict[int, int] = {}
    origins, queue = {CHASSIS: np.zeros(2)}, [CHASSIS]
    for body in queue:
        for pin in [pin for pin in pins if body in pin[:2]]:
            other = sum(pin[:2]) - body
            if other not in origins:
                parents[other], origins[other] = body, pin[2]
                queue.append(other)
                pins = [left for left in pins if left is not pin]
    return Tree(parents, origins, pins)


def body_names(robot: Robot) -> list[str]:
    """Name of every body and of the hinge it hangs on; the chassis' hinge is its pitch."""
    moving = robot.linkage.names[CRANK:]
    return ["chassis", "shaft", *(f"{leg}_{link}" for leg in robot.leg_names for link in moving)]


def hinge_angles(robot: Robot, q: Array) -> dict[str, float]:
    """Angle of every hinge (rad, by its name) at q = (x, y, theta, psi)."""
    angle, names = links.poses(robot, q)[:, 0], body_names(robot)
    turned = {names[k]: math.remainder(angle[k] - angle[up], 2.0 * math.pi)
              for k, up in body_tree(robot).parents.items()}  # fmt: skip
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
    """Return a robot as MJCF, level, at crank angle 0, its lowest pad on the ground.

    Args:
        terrain: level or a slope, with its friction; None holds the chassis in the air.
        time_step: s, well below 1 / sqrt(stiffness). loop_stiffness, contact_stiffness: of loops
            and of rigid pads, by mass, 1/s^2, critically damped. Compliant pads have their own.
        impratio: of friction's stiffness to that of the normal. gravity: m/s^2.

    Raises ValueError: a number out of range, or a terrain with several slopes; LinkageError: a leg
    that does not close; ImportError: compliant pads without MuJoCo.
    """
    if terrain is not None and not isinstance(terrain, Terrain):
        raise ValueError(f"terrain must be level or a slope, got {shown(terrain)}")
    positive("time_step", time_step)
    positive("loop_stiffness", loop_stiffness)
    positive("contact_stiffness", contact_stiffness)
    positive("impratio", impratio)
    root, tree = ET.Element("mujoco", model="jansen_env"), body_tree(robot)
    _add(root, "compiler", angle="radian")
    _add(
        root, "option", timestep=time_step, gravity=(0.0, 0.0, -gravity), integrator="implicitfast",
        cone="elliptic", impratio=impratio, solver="Newton", tolerance=1e-14, iterations="100",
    )  # fmt: skip
    world = _add(root, "worldbody")
    bodies = _add_bodies(world, robot, tree)
    if terrain is not None:
        _stand_on(world, bodies[CHASSIS], robot, terrain)
    friction = 0.0 if terrain is None else terrain.friction
    for name, k, place in _pads(robot):
        _add(
            bodies[k], "geom", name=name, type="sphere", size=robot.pad_radius, priority="1",
            pos=_local(place, tree.origins[k]), contype="1", conaffinity="0", condim="3",
            friction=(friction, 0.0, 0.0), solref=_critical(contact_stiffness), solimp=STIFF,
        )  # fmt: skip
    names, equality = body_names(robot), _add(root, "equality")
    for a, b, place in tree.loops:
        _add(
            equality, "connect", body1=names[a], body2=names[b], solimp=STIFF,
            anchor=_local(place, tree.origins[a]), solref=_critical(loop_stiffness),
        )  # fmt: skip
    _add_friction(_add(root, "tendon"), bodies, robot, tree.parents, time_step)
    limit = robot.motor.most_torque
    bound = {} if math.isinf(limit) else {"forcerange": (-limit, limit)}
    _add(_add(root, "actuator"), "motor", name="crank", joint="shaft", **bound)
    if not robot.pad_compliance.rigid:
        _set_springs(root, robot)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _add(parent: ET.Element, tag: str, **attributes: str | float | Sequence[float]) -> ET.Element:
    """Add an element; numbers are written in full."""
    return ET.SubElement(parent, tag, {name: _text(value) for name, value in attributes.items()})


def _text(value: str | float | Sequence[float]) -> str:
    return value if isinstance(value, str) else " ".join(map(repr, np.ravel(value).tolist()))


def _local(place: Array, origin: Array) -> tuple[float, float, float]:
    x, z = place - origin
    return x, 0.0, z


def _critical(stiffness: float) -> tuple[float, float]:
    """Solref of a critically damped constraint."""
    return -stiffness, -2.0 * math.sqrt(stiffness)


def _add_bodies(world: ET.Element, robot: Robot, tree: Tree) -> dict[int, ET.Element]:
    """Add the tree of bodies, with what they weigh and how they look."""
    names, home, at = body_names(robot), links.poses(robot, np.zeros(4))[:, 1:], tree.origins
    bodies = {CHASSIS: _add(world, "body", name=names[CHASSIS])}
    for k, up in tree.parents.items():
        bodies[k] = _add(bodies[up], "body", name=names[k], pos=_local(at[k], at[up]))
        _add(bodies[k], "joint", name=names[k], type="hinge", axis="0 -1 0")
    for k, (mass, inertia) in enumerate(links.inertias(robot)):
        about = [max(inertia, 1e-12)] * 3  # MuJoCo takes no point masses
        _add(bodies[k], "inertial", pos=_local(home[k], at[k]), mass=mass, diaginertia=about)
    for i, leg in enumerate(robot.legs):
        joints = joint_positions(robot, leg.side, leg.phase)
        for body, edges in enumerate(robot.linkage.edges, start=1):
            k = place_of(robot, i, body)
            for a, b in edges:
                ends = (*_local(joints[a], at[k]), *_local(joints[b], at[k]))
                _add(bodies[k], "geom", type="capsule", size=THICKNESS, fromto=ends,
                     contype="0", conaffinity="0", group="1")  # fmt: skip
    return bodies


def _pads(robot: Robot) -> list[tuple[str, int, Array]]:
    """Name, body and centre (level, crank angle 0) of every pad, toes first."""
    layout, pads = pad_layout(robot), []
    owners = links.pad_bodies(robot, layout)
    for i, k, body in zip(layout.leg, layout.joint, owners, strict=True):
        joint, leg = robot.linkage.all_pads[k][0], robot.legs[i]
        name = f"{robot.leg_names[i]}_{robot.linkage.joints[joint]}"
        pads.append((name, body, joint_positions(robot, leg.side, leg.phase)[joint]))
    return pads


def _stand_on(world: ET.Element, chassis: ET.Element, robot: Robot, terrain: Terrain) -> None:
    """Free the chassis, and put it on the ground."""
    (x, y), *_ = points = np.array(terrain.points)
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
    _add(world, "geom", name="ground", type="plane", size="0 0 1", pos=(x, 0.0, y),
         zaxis=(-slope, 0.0, 1.0), contype="0", conaffinity="1")  # fmt: skip


def _add_friction(
    tendons: ET.Element,
    bodies: dict[int, ET.Element],
    robot: Robot,
    parents: dict[int, int],
    time_step: float,
) -> None:
    """Add friction between bodies: in their hinge, or in a tendon over the hinges between them."""
    names, motor = body_names(robot), robot.motor
    viscous, dry = links.viscous_pairs(robot), links.dry_pairs(robot)
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
    if motor.rotor_inertia > 0.0:  # it turns with theta' + G psi'
        rotor = _add(tendons, "fixed", name="rotor", armature=motor.rotor_inertia)
        _add(rotor, "joint", joint="shaft", coef=motor.gear_ratio)
        if bodies[CHASSIS].find("joint") is not None:
            _add(rotor, "joint", joint="chassis", coef=1.0)


def _way(body: int, parents: dict[int, int]) -> set[int]:
    """A body and all it hangs on, without the chassis."""
    return set() if body == CHASSIS else {body} | _way(parents[body], parents)


def _set_springs(root: ET.Element, robot: Robot) -> None:
    """Make pads springs and dampers, which MuJoCo divides by a mass that only it knows."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    give, scale = robot.pad_compliance, 1.0 - SPRING[0]
    for name, k, _ in _pads(robot):
        per_mass = scale * float(model.body(body_names(robot)[k]).invweight0[0])
        pad = next(element for element in root.iter("geom") if element.get("name") == name)
        pad.set("solref", _text((-give.stiffness * per_mass, -give.damping * per_mass)))
        pad.set("solimp", _text(SPRING))
