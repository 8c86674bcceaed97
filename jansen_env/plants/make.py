"""The walking plants by name."""

from __future__ import annotations

from jansen_env.checks import shown
from jansen_env.plants import batch, projected, rigid_body
from jansen_env.plants.base import Plant
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

PLANTS = {
    "projection": (projected.ProjectionPlant, batch.TIME_STEP),
    "rigid_body": (rigid_body.RigidBodyPlant, rigid_body.TIME_STEP),
}


def plant_time_step(name: str, time_step: float | None = None) -> float:
    """The time step that :func:`make_plant` gives a plant, s; its own one for None.

    Raises:
        ValueError: not the name of a plant.
    """
    if not isinstance(name, str) or name not in PLANTS:
        raise ValueError(f"plant is {shown(name)}, must be one of {sorted(PLANTS)}")
    return PLANTS[name][1] if time_step is None else time_step


def make_plant(name: str, robot: Robot, terrain: Terrain, time_step: float | None = None) -> Plant:
    """A plant by its name, one of :data:`PLANTS`.

    Args:
        name: ``"projection"`` or ``"rigid_body"``. robot, terrain: what walks where.
        time_step: s; None for the plant's own.

    Raises:
        ValueError: another name, or an argument out of range.
    """
    step = plant_time_step(name, time_step)
    return PLANTS[name][0](robot, terrain, step)
