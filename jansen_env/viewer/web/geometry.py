"""Geometry of a robot as plain numbers, ready for JSON: ``scene.js`` draws them.

Colours, widths and meaning are those of :mod:`jansen_env.rendering`.
"""

from jansen_env import rendering
from jansen_env.rendering import reach_of
from jansen_env.robot import Robot

STYLE = {
    "arrowPerWeight": rendering.ARROW_PER_WEIGHT,
    "arrowPerReach": rendering.ARROW_PER_REACH,
    "longestArrow": rendering.LONGEST_ARROW,
    "largestPayload": rendering.LARGEST_PAYLOAD,
}
"""Sizes of what is drawn beside the links."""


def scene_of_robot(robot: Robot, weight: float) -> dict[str, object]:
    """Scene of a robot of a ``weight``, N: what does not change while it moves.

    Returns:
        A dictionary with these entries.

        - ``style``: :data:`STYLE`.
        - ``joints``: Names of a leg's joints.
        - ``bodies``: Joints of each body as indices, the frame's and the crank's first.
        - ``phases``: Phase of each leg, in rad.
        - ``toes``: Leg and joint of each toe.
        - ``padRadius``: Radius of the pads, in m.
        - ``reach``: Distance of the farthest joint from the crank axis, in m.
        - ``weight``: In N.
        - ``payload``: ``mass`` in kg, and ``x`` and ``y`` in m in the chassis frame, or None.
    """
    linkage, load, payload = robot.linkage, robot.payload, None
    if load.mass > 0.0:
        payload = {"mass": load.mass, "x": load.position[0], "y": load.position[1]}
    return {
        "style": STYLE,
        "joints": linkage.joints,
        "bodies": linkage.members,
        "phases": [leg.phase for leg in robot.legs],
        "toes": robot.toes,
        "padRadius": robot.pad_radius,
        "reach": reach_of(robot),
        "weight": weight,
        "payload": payload,
    }
