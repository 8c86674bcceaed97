"""The state of a walking robot in its world: saved, checked, restored, and drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from jansen_env.checks import whole_number
from jansen_env.dynamics.pads import pad_layout
from jansen_env.plants.base import check_deflection, check_in_contact, check_state
from jansen_env.rendering import Frame
from jansen_env.world.push import check_schedule

if TYPE_CHECKING:
    from jansen_env.world.world import World

MOST_STEPS = 2**63 - 1  # of an episode; and the largest seed
SLIPPING = 0.01  # m/s of mean slip speed from which a toe is drawn as slipping


def get_state(world: World, row: int) -> dict[str, Any]:
    """Return all that a robot's future depends on but the task and random numbers."""
    in_contact = world.plant.in_contact
    return {
        "plant": world.plant.states[row].copy(),
        "in_contact": None if row > 0 or in_contact is None else in_contact.copy(),
        "deflection": world.plant.deflection[row].copy(),
        **world.actuation_state(row),
        "steps": int(world.elapsed[row]),
        "command_seed": int(world.seeds[row]),
        "loads": world.loads[row].copy(),
        **world.episodes.state(row),
        "pushes": world.pushes.scheduled(row),
        "random_pushes": bool(world.pushes.random[row]),
    }


def checked_state(world: World, row: int, state: Mapping[str, Any]) -> dict[str, Any]:
    """Return a state of :func:`get_state`, ready for :func:`restore`.

    Raises:
        ValueError: an entry is out of range.
    """
    loads = np.array(state["loads"], dtype=float)
    if loads.shape != world.loads[row].shape or not np.isfinite(loads).all():
        raise ValueError(
            f"state['loads'] is {loads}, must be {len(world.loads[row])} finite numbers"
        )
    pads = len(pad_layout(world.robots[0]).leg)
    return {
        **world.checked_actuation(state),
        "plant": check_state(state["plant"]),
        "loads": loads,
        "in_contact": check_in_contact(state["in_contact"], pads),
        "deflection": check_deflection(state["deflection"], len(world.plant.deflection[row])),
        "steps": whole_number("state['steps']", state["steps"], MOST_STEPS),
        "seed": whole_number("state['command_seed']", state["command_seed"], MOST_STEPS),
        "pushes": check_schedule("state['pushes']", state["pushes"]),
        "random_pushes": bool(state["random_pushes"]),
        "plan": world.episodes.planned(row, state),
    }


def restore(world: World, row: int, state: dict[str, Any]) -> None:
    """Let a robot go on from a state of :func:`checked_state`."""
    plant, one = world.plant, np.array([row])
    plan, level = state["plan"]
    world.apply_parameters(one, [plan])
    world.episodes.level[row] = level
    plant.set_state(row, state["plant"], state["deflection"])
    if row == 0:
        plant.in_contact = state["in_contact"]
    world.begin_delay(one, np.array([state["delay"]]), state["asked"])
    plant.slip[row] = plant.contact_force[row] = 0.0
    world.loads[row] = state["loads"]
    world.clear_episode(one, state["action"])
    world.elapsed[row], world.seeds[row] = state["steps"], state["seed"]
    world.pushes.schedule(row, state["pushes"], state["random_pushes"])


def frame(world: World, row: int) -> Frame:
    """Return the picture data of a robot as it stands, without a command."""
    plant = world.plant
    state = plant.states[row]
    points, tangents = plant.contact_frames(row)
    return Frame(
        q=state[:4],
        contact_point=points,
        contact_tangent=tangents,
        contact_force=plant.contact_force[row],
        slipping=plant.slip[row] > SLIPPING * world.control_dt,
        command=None,
        speed=float(state[4]),
        torque=float(world.torque[row]),
        torque_limit=abs(float(world.full_torque[row])),
        time=float(world.elapsed[row]) * world.control_dt,
    )
