"""The walking plants by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from jansen_env.checks import one_of
from jansen_env.plants import batch, projected, rigid_batch, rigid_body
from jansen_env.plants.base import BatchedPlant
from jansen_env.plants.rigid_batch import RigidBodyBatch
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Plant: TypeAlias = projected.ProjectionPlant | rigid_body.RigidBodyPlant
"""A plant of one robot."""
PLANTS: dict[str, tuple[type[Plant], float]] = {
    "projection": (projected.ProjectionPlant, batch.TIME_STEP),
    "rigid_body": (rigid_body.RigidBodyPlant, rigid_batch.TIME_STEP),
}


def plant_time_step(name: str, time_step: float | None = None) -> float:
    """Return a plant's own time step, s, for None. Raises ValueError: not the name of a plant."""
    return PLANTS[one_of("plant", name, sorted(PLANTS))][1] if time_step is None else time_step


def make_plant(name: str, robot: Robot, terrain: Terrain, time_step: float | None = None) -> Plant:
    """Return a plant of :data:`PLANTS`, with its own time step for None.

    Raises:
        ValueError: another name, or an argument out of range.
    """
    return PLANTS[name][0](robot, terrain, plant_time_step(name, time_step))


def make_batch(
    name: str,
    robots: Sequence[Robot],
    terrains: Sequence[Terrain],
    time_step: float | None = None,
    threads: int | None = None,
) -> BatchedPlant:
    """Return robots on their terrains, moved by a plant of :data:`PLANTS`.

    Raises:
        ValueError: another name, an argument out of range, or several robots of a plant that moves
            one.
    """
    step = plant_time_step(name, time_step)
    if name == "projection":
        one = 1 if len(robots) == 1 else threads
        return batch.Batch(robots, terrains, step, threads=one)
    if len(robots) > 1:
        raise ValueError(f"plant is {name!r}, must be 'projection' for several robots at once")
    return RigidBodyBatch(robots[0], terrains[0], step)


def plant_of(batched: BatchedPlant) -> Plant:
    """Return the plant of a batch of one robot."""
    if isinstance(batched, batch.Batch):
        return projected.ProjectionPlant.of(batched)
    assert isinstance(batched, RigidBodyBatch)
    return rigid_body.RigidBodyPlant.of(batched)
