"""Single robots of a world: changed while they walk, saved, restored, and drawn."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jansen_env.checks import shown, whole_number
from jansen_env.dynamics.pads import pad_layout
from jansen_env.parameters import CHANGES, PARAMETERS, check
from jansen_env.plants.base import check_deflection, check_in_contact, check_state, numbers_of
from jansen_env.rendering import Frame
from jansen_env.world.actuated import ActuatedRobots
from jansen_env.world.argument_checks import Check
from jansen_env.world.push import check_schedule
from jansen_env.world.settings import load_compliance, load_motor, load_payload

if TYPE_CHECKING:
    from jansen_env.world.world import World

MOST_STEPS = 2**63 - 1  # of an episode; and the largest seed
PLACED = ("delay", "terrain_level")  # changes that apply from the next reset on
KEPT = ("friction", "restitution", *CHANGES)
SLIPPING = 0.01  # m/s of mean slip speed from which a toe is drawn as slipping


def checked(world: World, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes for :func:`apply`; ValueError: out of range, or fixed by the plant."""
    physical = sorted({*changes} - {*PLACED})
    if not {*physical} <= world.plant.changeable:
        raise ValueError(f"{physical[0]} cannot be changed with plant='rigid_body'")
    checks: dict[str, Check] = {
        "payload": load_payload,
        "motor": load_motor,
        "pad_compliance": load_compliance,
        "delay": world.checked_delay_range,
        "terrain_level": lambda name, value: world.episodes.checked_level(row, value),
    }
    found = {
        name: checks.get(name, partial(check, name))(name, value) for name, value in changes.items()
    }
    world.episodes.check_names(row, [name for name in found if name in CHANGES], "changes")
    if physical:
        pads = found.get("pad_compliance", world.robots[row].pad_compliance)
        world.episodes.check_change(row, pads, _numbers(found))
    return found


def _numbers(changes: Mapping[str, Any]) -> dict[str, float]:
    """Return the parameters that checked changes set at once."""
    found = {name: changes[name] for name in PARAMETERS if name in {*changes} - {*PLACED}}
    if "payload" in found:
        load = found["payload"]
        found["payload_x"], found["payload_y"] = load.position
        found["payload"] = load.mass
    return found


def apply(world: World, row: int, checked: dict[str, Any]) -> None:
    """Apply changes of a robot and its ground."""
    if "delay" in checked:
        world.delay_range[row] = checked["delay"]
    if "terrain_level" in checked:
        world.episodes.level[row] = world.episodes.levels[row] = checked["terrain_level"]
    physical = {name: value for name, value in checked.items() if name not in PLACED}
    if not physical:
        return
    world.plant.change(row, physical)
    world.robots[row] = world.plant.robots[row]
    world.lengths.equip(row, world.robots[row])
    world.episodes.take(row, _numbers(checked))
    world.update_scales(np.array([row]))


def get_attr(world: World, name: str) -> list[Any] | None:
    """Return an attribute of each robot; None for a name that is none of these.

    Names: ``robot``, ``state``, ``delay`` (s, of this episode), ``terrain``, ``terrain_level``,
    ``payload``, ``motor``, ``torque_limit``, ``pad_compliance``, ``weight``,
    ``reset_noise_scale`` and :data:`jansen_env.world.single_robots.KEPT`.
    """
    if name == "terrain":
        return list(world.plant.terrains)
    if name in ("payload", "motor", "pad_compliance"):
        return [getattr(robot, name) for robot in world.robots]
    if name == "torque_limit":
        return [robot.motor.torque_limit for robot in world.robots]
    if name in ("weight", "reset_noise_scale"):
        return getattr(world, name).tolist()
    if name == "terrain_level":
        return world.episodes.values[name].astype(int).tolist()
    if name in KEPT:
        return world.episodes.values[name].tolist()
    return ActuatedRobots.get_attr(world, name)


def get_state(world: World, row: int) -> dict[str, Any]:
    """Return all that a robot's future depends on but the task and random numbers."""
    in_contact = world.plant.in_contact
    return {
        **ActuatedRobots.get_state(world, row),
        "in_contact": None if row > 0 or in_contact is None else in_contact.copy(),
        "deflection": world.plant.deflection[row].copy(),
        "steps": int(world.elapsed[row]),
        "command_seed": int(world.seeds[row]),
        "loads": world.loads[row].copy(),
        **world.episodes.state(row),
        "pushes": world.pushes.scheduled(row),
        "random_pushes": bool(world.pushes.random[row]),
    }


def checked_state(world: World, row: int, state: Mapping[str, Any]) -> dict[str, Any]:
    """Return a state of :func:`get_state` for :func:`restore`; ValueError: out of range."""
    loads = numbers_of(state["loads"])
    if loads.shape != world.loads[row].shape or not np.isfinite(loads).all():
        raise ValueError(
            f"state['loads'] is {shown(state['loads'])}, must be {len(world.loads[row])} finite "
            "numbers"
        )
    pads = len(pad_layout(world.robots[0]).leg)
    own = ActuatedRobots.checked_state(world, row, state)
    robot = own["builds"][row].robot if own["builds"] else world.robots[row]
    return {
        **own,
        "plant": check_state(state["plant"]),
        "loads": loads,
        "in_contact": check_in_contact(state["in_contact"], pads),
        "deflection": check_deflection(state["deflection"], len(world.plant.deflection[row])),
        "steps": whole_number("state['steps']", state["steps"], MOST_STEPS),
        "seed": whole_number("state['command_seed']", state["command_seed"], MOST_STEPS),
        "pushes": check_schedule("state['pushes']", state["pushes"]),
        "random_pushes": bool(state["random_pushes"]),
        "plan": world.episodes.planned(row, state, robot),
    }


def restore(world: World, row: int, state: dict[str, Any]) -> None:
    """Let a robot go on from a state of :func:`checked_state`."""
    plant, one = world.plant, np.array([row])
    plan, level = state["plan"]
    with world.all_or_nothing(one, state["builds"], [plan]):
        world.exchange(state["builds"])
        world.apply_parameters(one, [plan])
        plant.set_state(row, state["plant"], state["deflection"])
    world.episodes.level[row] = level
    if row == 0:
        plant.in_contact = state["in_contact"]
    world.begin_delay(one, np.array([state["delay"]]), state["asked"])
    plant.slip[row] = plant.contact_force[row] = 0.0
    world.loads[row] = state["loads"]
    world.clear_episode(one, state["action"])
    world.elapsed[row], world.seeds[row] = state["steps"], state["seed"]
    world.pushes.schedule(row, state["pushes"], state["random_pushes"])


def frame(world: World, row: int, command: float | None) -> Frame:
    """Return the picture data of a robot as it stands."""
    plant = world.plant
    state = plant.states[row]
    points, tangents = plant.contact_frames(row)
    return Frame(
        q=state[:4], contact_point=points, contact_tangent=tangents,
        contact_force=plant.contact_force[row],
        slipping=plant.slip[row] > SLIPPING * world.control_dt, command=command,
        speed=float(state[4]), torque=float(world.torque[row]),
        torque_limit=abs(float(world.full_torque[row])),
        time=float(world.elapsed[row]) * world.control_dt,
    )  # fmt: skip
