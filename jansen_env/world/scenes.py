"""Data from which pictures of the robots of a world are drawn."""

from __future__ import annotations

import numpy as np

from jansen_env.engine.contact_frames import AIR, put_contacts
from jansen_env.terrain import Shapes, Terrain
from jansen_env.world.rendering import Frame
from jansen_env.world.settings import Values
from jansen_env.world.world import World


def scene_of(world: World, i: int) -> Values:
    """Return the arguments of :class:`jansen_env.world.rendering.Renderer` to draw a robot.

    Args:
        world: Simulation of the robot.
        i: Index of the robot.
    """
    if world.fixed_chassis:
        return {"robot": world.robots[i], "terrain_points": None, "speed_unit": "rad/s"}
    ground = world.plant.terrains[i]
    shapes = world.plant.shapes(i)
    robot = world.episodes.shown_robot(i, world.robots[i])
    if isinstance(ground, Shapes) and shapes is not None:
        return {"robot": robot, "terrain_points": shapes.line, "shapes": ground.pieces}
    assert isinstance(ground, Terrain)
    return {"robot": robot, "terrain_points": ground.polyline}


def frame_of(world: World, i: int, command: float | None) -> Frame:
    """Return the data from which a picture of a robot in its present state is drawn.

    Args:
        world: Simulation of the robot.
        i: Index of the robot.
        command: Commanded value that the picture shows. None for no command.
    """
    plant = world.plant
    state = plant.states[i]
    points = np.zeros((plant.toes, 2))
    force = np.zeros((plant.toes, 2))
    contact = np.full(plant.toes, AIR)
    speed = state[7]
    load = None
    if not world.fixed_chassis:
        points, tangents = plant.contact_frames(i)
        put_contacts(i, world.control_dt, world.records.motions, tangents, contact, force)
        speed = state[4]
        load = float(world.records.robots["info"]["ground_load"][i])
    return Frame(
        q=state[:4].copy(),
        contact=contact,
        contact_point=points,
        contact_force=force,
        weight=float(world.weight[i]),
        command=command,
        speed=float(speed),
        torque=float(world.torque[i]),
        torque_limit=abs(float(world.full_torque[i])),
        time=float(world.elapsed[i]) * world.control_dt,
        load=load,
    )
