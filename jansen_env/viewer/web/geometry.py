"""Geometry of a robot as numbers for JSON, which ``scene.js`` draws.

Colours, widths and meaning are the same as in :mod:`jansen_env.world.rendering`.
"""

from jansen_env.robot import Robot
from jansen_env.world import drawn_springs, rendering
from jansen_env.world.rendering import reach_of

SIZES = {
    rendering: "ARROW_PER_WEIGHT ARROW_PER_REACH LONGEST_ARROW COIL_WIDTH SPIRAL_RADIUS "
    "PAYLOAD_SIDE PAYLOAD_SIDES LARGEST_PAYLOAD PICTURE_HEIGHT PICTURE_WIDTH AXIS_HEIGHT "
    "DEPTH_BELOW NEARBY NEARBY_POINTS",
    drawn_springs: "COILS LEAD TURNS SPIRAL_POINTS MOST_SPRINGS",
}
STYLE = {name: getattr(part, name) for part, names in SIZES.items() for name in names.split()}
"""Sizes of what is drawn, by the names of the constants in :data:`SIZES`."""


def scene_of_robot(robot: Robot, weight: float) -> dict[str, object]:
    """Return the scene of a robot: everything that does not change while the robot moves.

    Args:
        robot: Robot to draw.
        weight: Weight of robot and payload, in N.

    Returns:
        A dictionary with the following entries.

        - ``style``: :data:`STYLE`.
        - ``joints``: Names of a leg's joints.
        - ``bodies``: Indices of the joints of each body, the frame first and the crank second.
        - ``phases``: Phase of each leg, in rad.
        - ``toes``: Indices of the leg and the joint of each toe.
        - ``padRadius``: Radius of the contact pads, in m.
        - ``reach``: Distance of the farthest joint from the crank axis, in m.
        - ``weight``: Weight of robot and payload, in N.
        - ``payload``: ``mass`` in kg, and ``x`` and ``y`` in m in the chassis frame. None if there
          is no payload.
        - ``springs``: Springs of all legs with ``leg``, ``joints`` and ``anchor``, see
          :class:`jansen_env.world.drawn_springs.DrawnSpring`. Missing if there are no springs.
    """
    linkage, load, payload = robot.linkage, robot.payload, None
    if load.mass > 0.0:
        payload = {"mass": load.mass, "x": load.position[0], "y": load.position[1]}
    springs = [spring._asdict() for spring in drawn_springs.drawn_springs(robot)]
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
        **({"springs": springs} if springs else {}),
    }
