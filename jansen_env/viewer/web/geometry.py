"""Geometry of a robot as plain numbers, ready for JSON: ``scene.js`` draws them.

Colours, widths and meaning are those of :mod:`jansen_env.rendering`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.gravity import GRAVITY
from jansen_env.rendering import Frame, depths_of, reach_of
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import world_joints
from jansen_env.robot.linkage import CRANK, FRAME, Linkage

Array = NDArray[np.float64]

AIR, GRIP, SLIP = 0, 1, 2  # a toe is lifted, holds, slides while it is loaded
TOUCHING = 1e-6  # of the robot's weight: the normal force from which a toe is on the ground


def scene_of(env: Any) -> dict[str, object]:
    """:func:`scene_of_robot` of one robot's environment, of any task, with its ``terrain``."""
    inner = env.unwrapped
    scene, frame = inner.scene(), inner.frame()
    ground, robot = scene["terrain_points"], scene["robot"]
    weight = float(getattr(inner, "weight", robot.mass * GRAVITY))
    unit, fastest = scene.get("speed_unit", "m/s"), float(scene.get("speed_range", 1.0))
    dt, limit = float(inner.control_dt), float(frame.torque_limit)
    return {
        **scene_of_robot(robot, weight, limit, unit, fastest, dt),
        "terrain": None if ground is None else np.asarray(ground).tolist(),
    }


def scene_of_robot(
    robot: Robot,
    weight: float,
    torque_limit: float,
    speed_unit: str,
    speed_range: float,
    control_dt: float,
) -> dict[str, object]:
    """Scene of a robot: what does not change while it moves.

    Returns:
        :func:`drawing_of` its linkage, and ``legs``: for each its ``side`` and ``depth`` (0 the
        nearest, 1 the farthest); ``toes``: leg and joint of each; ``padRadius`` m; ``reach`` m, of
        the farthest joint from the crank axis; ``weight`` N; ``payload``: ``mass`` kg and ``x``,
        ``y`` m in the chassis frame, or None; ``torqueLimit`` N m; ``speedUnit`` and
        ``speedRange`` of the speed gauge; ``controlDt`` s.
    """
    depths, load = depths_of(robot), robot.payload
    return {
        "legs": [
            {"side": leg.side, "depth": depth}
            for leg, depth in zip(robot.legs, depths, strict=True)
        ],
        "toes": [list(toe) for toe in robot.toes],
        **drawing_of(robot.linkage),
        "padRadius": float(robot.pad_radius),
        "reach": reach_of(robot),
        "weight": weight,
        "payload": {"mass": load.mass, "x": load.position[0], "y": load.position[1]}
        if load.mass > 0.0
        else None,
        "torqueLimit": torque_limit,
        "speedUnit": speed_unit,
        "speedRange": speed_range,
        "controlDt": control_dt,
    }


def drawing_of(linkage: Linkage) -> dict[str, object]:
    """How a leg is drawn: edges as pairs of joints, joints as indices.

    Returns:
        ``joints``: their names; ``frame``: its edges; ``crank``: its edges, the first from
        the axis on;
        ``skeleton``: edges of the other bodies; ``plates``: corners of those with more than two.
    """
    return {
        "joints": list(linkage.joints),
        "frame": [list(edge) for edge in linkage.edges[FRAME - 1]],
        "crank": [list(edge) for edge in linkage.edges[CRANK - 1]],
        "skeleton": [list(edge) for edges in linkage.edges[CRANK:] for edge in edges],
        "plates": [list(joints) for joints in linkage.members[CRANK:] if len(joints) > 2],
    }


def state_of_frame(robot: Robot, frame: Frame) -> dict[str, object]:
    """Pose, toes, speed and torque of a robot in a frame.

    Returns:
        ``t`` s; ``x``, ``y`` m of the crank axis, ``pitch`` and ``crank`` rad; ``joints``: (legs,
        joints, 2) m, world frame; ``toes``: for each ``contact`` (:data:`AIR`, :data:`GRIP` or
        :data:`SLIP`), ``point`` (2,) m where it touches and ``force`` (2,) N on it, world frame;
        ``command`` and ``speed`` in the scene's unit, ``torque`` N m.
    """
    toes = zip(
        contacts(frame, robot.mass * GRAVITY).tolist(),
        np.asarray(frame.contact_point).tolist(),
        world_forces(frame).tolist(),
        strict=True,
    )
    return {
        "t": frame.time,
        **dict(zip(("x", "y", "pitch", "crank"), map(float, frame.q), strict=True)),
        "joints": world_joints(robot, frame.q).tolist(),
        "toes": [dict(zip(("contact", "point", "force"), toe, strict=True)) for toe in toes],
        "command": frame.command,
        "speed": frame.speed,
        "torque": frame.torque,
    }


def contacts(frame: Frame, weight: float) -> NDArray[np.int8]:
    """(toes,) what each toe does, of a robot with a ``weight`` in N."""
    touching = np.asarray(frame.contact_force)[:, 1] > TOUCHING * weight
    return np.where(frame.slipping, SLIP, np.where(touching, GRIP, AIR)).astype(np.int8)


def world_forces(frame: Frame) -> Array:
    """(toes, 2) forces of the ground on the toes, N, world frame."""
    tangent = np.asarray(frame.contact_tangent, dtype=float)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
    along, across = np.asarray(frame.contact_force, dtype=float).T[..., None]
    forces: Array = along * tangent + across * normal
    return forces
