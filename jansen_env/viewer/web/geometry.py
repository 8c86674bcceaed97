"""Geometry of a robot as plain numbers, ready for JSON: ``scene.js`` draws them.

Colours, widths and meaning are those of :mod:`jansen_env.rendering`.
"""

from jansen_env.rendering import depths_of, reach_of
from jansen_env.robot import Robot
from jansen_env.robot.linkage import CRANK, FRAME


def scene_of_robot(robot: Robot, weight: float) -> dict[str, object]:
    """Scene of a robot of a ``weight``, N: what does not change while it moves.

    Returns:
        ``joints``: names of a leg's; ``frame``: its edges as pairs of indices of joints; ``crank``:
        its edges, the first from the axis on; ``skeleton``: edges of the other bodies; ``plates``:
        corners of those with more than two; ``legs``: for each its ``depth`` (0 the nearest, 1 the
        farthest); ``toes``: leg and joint of each; ``padRadius`` m; ``reach`` m, of the farthest
        joint from the crank axis; ``weight`` N; ``payload``: ``mass`` kg and ``x``, ``y`` m in the
        chassis frame, or None.
    """
    linkage, load, payload = robot.linkage, robot.payload, None
    if load.mass > 0.0:
        payload = {"mass": load.mass, "x": load.position[0], "y": load.position[1]}
    return {
        "joints": linkage.joints,
        "frame": linkage.edges[FRAME - 1],
        "crank": linkage.edges[CRANK - 1],
        "skeleton": [edge for edges in linkage.edges[CRANK:] for edge in edges],
        "plates": [joints for joints in linkage.members[CRANK:] if len(joints) > 2],
        "legs": [{"depth": depth} for depth in depths_of(robot)],
        "toes": robot.toes,
        "padRadius": robot.pad_radius,
        "reach": reach_of(robot),
        "weight": weight,
        "payload": payload,
    }
