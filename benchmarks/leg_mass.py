"""Does the torque rise with the mass of the legs, and why: the energy account of walks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.measure import chosen, machine, options, report, require, table
from benchmarks.walks import walk
from jansen_env import ROBOTS, Payload, Robot, Terrain
from jansen_env.baselines.pid import PID
from jansen_env.baselines.walker_baselines import measured, measured_setting, walking_pid
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.policies import pretrained
from jansen_env.robot.links import CRANK_RADIUS
from jansen_env.scoring.rollout import make_envs

ENVS = {"built": "JansenWalkerBuilt-v0", "paper_slender": "JansenWalker-v0"}
FACTORS, SPEEDS = (0.5, 1.0, 2.0, 4.0), (0.1, 0.3, 0.5)  # m/s
SAME_TOTAL = 2.0  # of the factors: its total mass for all up to it
HEAD = ["m/s", "legs, kg", "total, kg", "falls", "RMS torque, N m", "largest", "work, J a turn",
        "of it given back", "joints", "slip", "impacts"]  # fmt: skip
STEPS, SETTLING = 500, 100  # of control; those that are not measured
SHARES = {0.119: 4.8, 0.285: 8.9, 0.475: 12.4}  # of the legs in the total: N m found elsewhere
SAME = 10.0 * CRANK_RADIUS / (50.0 * 0.3)  # N m here for one there: as masses and cranks
SETTINGS = {"1e5 /s^2": (1e5, 1.0, 0.9), "1e6 /s^2": (1e6, 1.0, 0.9),
            "impratio 10": (1e5, 10.0, 0.9), "impedance 0.9999": (1e5, 1.0, 0.9999)}  # fmt: skip


def with_legs(design: str, factor: float, heaviest: float = 0.0) -> Robot:
    """A design with its legs, but for the frames, so many times as heavy.

    ``heaviest``: the total is that with legs so many times as heavy, by a load on the chassis.
    """
    robot = ROBOTS[design]()
    names = robot.linkage.names[1:]
    scaled = robot.with_bodies(**{
        name: replace(one, mass=factor * one.mass, inertia=factor * one.inertia)
        for name, one in zip(names, robot.bodies[1:], strict=True)
    })  # fmt: skip
    more = with_legs(design, heaviest).mass - scaled.mass if heaviest else 0.0
    return replace(scaled, payload=Payload(max(more, 0.0)))


def twelve_legs(share: float) -> Robot:
    """Twelve legs of bars without friction on 10 kg in all, which cannot pitch."""
    robot = ROBOTS["holy_slender"](6)
    sides = [math.fsum(one.distance(*pair) for pair in combinations(range(len(one.corners)), 2))
             for one in robot.bodies]  # fmt: skip
    a_metre = share * 10.0 / 12.0 / math.fsum(sides[1:])
    links = {name: replace(one, mass=a_metre * side).slender() for name, one, side
             in zip(robot.linkage.names, robot.bodies, sides, strict=True)}  # fmt: skip
    links["frame"] = replace(robot.frame, mass=1e-3, inertia=1e-6)
    robot = replace(robot.with_bodies(**links), damping=(0.0,) * len(robot.damping))
    return replace(robot, payload=Payload(10.0 - robot.mass, 100.0))


def mean_torque(plant: Any) -> tuple[float, float]:
    """Motor work and slip loss of a turn at 1 rad/s over its angle, N m."""
    found: list[tuple[float, float]] = []
    walk(plant, 1.0, 2.0 * math.pi, 1.0, 0.3, 1e3,
         watch=lambda step: found.append((step.motor_work, step.slip_loss)))  # fmt: skip
    work, slip = np.sum(found, axis=0) / (2.0 * math.pi)
    return float(work), float(slip)


def in_mujoco(robot: Robot, stiffness: float, impratio: float, impedance: float) -> Any:
    """The robot in MuJoCo, with settings of its contacts."""
    from benchmarks.mujoco_witness import MujocoPlant

    plant = MujocoPlant(robot, Terrain.flat(1.5), 2.5e-4, impratio=impratio)
    pads = plant.model.geom_contype == 1
    plant.model.geom_solref[pads] = -stiffness, -2.0 * math.sqrt(stiffness)
    plant.model.geom_solimp[pads, :2] = impedance, max(impedance, 0.95)
    return plant


def friction_mass(plant: Any) -> float:
    """Friction of MuJoCo's contacts, where a walk ended, per acceleration: a mass, kg."""
    data = plant.data
    return float(np.mean(data.efc_D[data.contact.efc_address[data.contact.efc_address >= 0] + 1]))


def pid(design: str) -> Callable[[Any], Any]:
    """The PID, with one crank speed for all masses of a design's legs."""
    robot = ROBOTS[design]()
    gains = PID(*measured("pid", robot)["gains"])
    return lambda env: walking_pid(measured_setting("pid", robot), env, gains)


def shipped(design: str) -> Callable[[Any], Any]:
    """The policy that comes with the package."""
    return lambda _: pretrained.load(ENVS[design])


def account(
    design: str, make: Callable[[Any], Any], robot: Robot, speed: float, count: int
) -> list[str]:
    """Masses, falls, torques (N m), and energies a turn of the crank (J), over some episodes."""
    parts, legs = [], len(robot.legs) * math.fsum(one.mass for one in robot.bodies[1:])
    envs = make_envs(ENVS[design], {"robot": robot}, count)
    seen, _ = envs.reset(seed=[*range(count)], options={"speed_command": np.full(count, speed)})
    policy, state, starts, stood = make(envs), None, np.ones(count, bool), np.ones(count, bool)
    for _ in range(STEPS):
        action, state = policy.predict(seen, state, starts, True)
        seen, _, ended, _, info = envs.step(action)
        starts, stood, energy = np.zeros(count, bool), stood & ~ended, info["energy"]
        work = energy["motor_work"]
        parts.append([info["crank_torque"], info["crank_speed"] * envs.control_dt, work,
                      np.minimum(work, 0.0), energy["joint_loss"], energy["slip_loss"],
                      energy["impact_loss"]])  # fmt: skip
    envs.close()
    first = [f"{speed:g}", f"{legs:.2f}", f"{robot.mass:.1f}", f"{1.0 - stood.mean():.0%}"]
    if not stood.any():
        return [*first, *["-"] * (len(HEAD) - len(first))]
    torque, turn, *energies = np.array(parts)[SETTLING:, :, stood].swapaxes(0, 1)
    turns = abs(float(turn.sum())) / (2.0 * math.pi)
    return [*first, f"{np.sqrt(np.square(torque).mean()):.2f}",
            f"{np.abs(torque).max(axis=0).mean():.1f}",
            *(f"{one.sum() / turns:.2f}" for one in energies)]  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    args = chosen(options(__doc__, "logs/leg_mass", episodes=16), arguments)
    require("mujoco")
    count, speeds = (2, SPEEDS[1:2]) if args.quick else (args.episodes, SPEEDS)
    parts = [f"# Mass of the legs and torque\n\n`python -m benchmarks.leg_mass`. {machine()}"]
    for design in ENVS:
        for label, make, heaviest in (
            ("the PID", pid(design), 0.0),
            ("the shipped policy", shipped(design), 0.0),
            ("the PID, of one total mass", pid(design), SAME_TOTAL),
        ):
            factors = [one for one in FACTORS if not heaviest or one <= heaviest]
            rows = [account(design, make, with_legs(design, factor, heaviest), speed, count)
                    for speed in speeds for factor in factors]  # fmt: skip
            parts += [f"`{design}` under {label}:", table(HEAD, rows)]
    rows = []
    for share, theirs in SHARES.items():
        robot, cells = twelve_legs(share), [f"{share:.0%}", f"{theirs * SAME:.2f}"]
        plants = [in_mujoco(robot, *one) for one in SETTINGS.values() if not args.quick]
        for plant in (ProjectionPlant(robot, Terrain.flat(1.5), 2.5e-4), *plants):
            cells.append("{:.2f} ({:.2f})".format(*mean_torque(plant)))
        rows.append([*cells, *(f"{friction_mass(plant):.2f}" for plant in plants[:1])])
    head = ["legs' share", "strandbeest-evolution, to scale", "exact"]
    head += [] if args.quick else [*SETTINGS, "mass felt by friction, kg"]
    report(args.out / "leg_mass.md", *parts, table(head, rows))


if __name__ == "__main__":
    main()
