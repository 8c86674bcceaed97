"""Does MuJoCo agree with the simulation backends of this package?

Run the experiment as follows. It takes about five minutes on one core.

    python experiments/mujoco_witness.py [--quick]

Exported robots turn their cranks in the air, stand on springs for half a second, and walk. The
script writes ``docs/validation/mujoco.json`` and the tables of docs/validation/mujoco.md.
"""

import math
import sys
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from mujoco_backend import MujocoPlant
from pages import options, publish, table
from walks import walk

from jansen_env import ROBOTS, Compliance, Robot, Terrain
from jansen_env.plants.mujoco_model import body_names, to_mjcf
from jansen_env.plants.plant import Plant, ProjectionPlant, RigidBodyPlant
from jansen_env.plants.rigid.bodies import poses

DATA, PAGE = "validation/mujoco.json", "validation/mujoco.md"
LINKAGES: tuple[str, ...] = ("paper", "klann", "chebyshev", "trotbot", "strider")
TORQUE = 10.0  # torque in the air, in N m
AIR = (
    (4e-4, 1e5),
    (2e-4, 1e6),
    (1e-4, 1e7),
)  # time steps, in s, and stiffnesses of loops, in 1/s^2
HELD_STEP = 1e-5  # time step of the projection backend with a fixed chassis, in s
STIFFNESS = 2e4  # stiffness of pads that are springs, in N/m
DAMPING = 60.0  # damping of these pads, in N s/m
VISCOSITY = 600.0  # damping of these pads along the ground, in N s/m
STARTS: tuple[tuple[float, float, float], ...] = (
    (0.0, DAMPING, 2e-4),
    (0.0, DAMPING, 1e-4),
    (0.0, DAMPING, 5e-5),
    (0.3, DAMPING, 1e-4),
    (0.3, 6.0, 1e-4),
)
"""Friction, damping of the pads in N s/m, and time step in s, of the first half second."""
CRANK_SPEED, FRICTION = 4.0, 0.3  # rad/s; friction coefficient of the walks
DIFFERENCES = ("pads", "simulation", "compared with")
RIGID_PADS = {1e5: 2e-4, 1e6: 1e-4, 1e7: 4e-5}  # stiffness of contacts, 1/s^2: time step, in s


def in_the_air(name: str, time_step: float, stiffness: float) -> tuple[float, float]:
    """Turn a crank once with a fixed chassis, and compare MuJoCo with the projection backend.

    Args:
        name: Name of the robot.
        time_step: Time step of MuJoCo, in s.
        stiffness: Stiffness of the loops in MuJoCo, in 1/s^2.

    Returns:
        Largest difference of the crank angle, in rad, and of the centre of mass of any link, in m.
    """
    robot, period, worst = ROBOTS[name](), 0.02, np.zeros(2)
    plant, angle = ProjectionPlant(robot, Terrain.flat(), HELD_STEP, fixed_chassis=True), 0.0
    plant.reset()
    text = to_mjcf(robot, None, time_step, stiffness).replace("implicitfast", "RK4")
    model = mujoco.MjModel.from_xml_string(text)
    data, bodies = mujoco.MjData(model), [model.body(name).id for name in body_names(robot)]
    data.ctrl[0] = TORQUE
    while angle < 2.0 * math.pi:
        plant.step(TORQUE, period)
        angle = float(plant.state[3])
        mujoco.mj_step(model, data, round(period / time_step))
        mujoco.mj_kinematics(model, data)
        places = poses(robot, np.array([0.0, 0.0, 0.0, angle]))[:, 1:]
        off = np.abs(data.xipos[bodies][:, ::2] - places).max()
        worst = np.maximum(worst, (abs(float(data.qpos[0]) - angle), off))
    return float(worst[0]), float(worst[1])


def on_springs(name: str, damping: float) -> Robot:
    """Return a robot whose pads are springs that stick by a damper alone, as those of MuJoCo do."""
    return replace(ROBOTS[name](), pad_compliance=Compliance(STIFFNESS, damping, 1e-3, VISCOSITY))


def half_second(name: str, friction: float, damping: float, time_step: float) -> float:
    """Return the largest difference of x, y, pitch and crank angle in half a second from rest.

    Args:
        name: Name of the robot.
        friction: Friction coefficient of the ground.
        damping: Damping of the pads, in N s/m.
        time_step: Time step of MuJoCo, in s.
    """
    robot, ground = on_springs(name, damping), Terrain.flat(friction)
    ours = ProjectionPlant(robot, ground, 0.5 * time_step)
    theirs = MujocoPlant(robot, ground, time_step, impratio=VISCOSITY / damping)
    ours.reset()
    theirs.reset()
    worst = 0.0
    for _ in range(50):
        ours.step(6.0, 0.01)
        theirs.step(6.0, 0.01)
        worst = max(worst, float(np.abs(ours.state - theirs.state)[:4].max()))
    return worst


def walks(name: str, duration: float) -> list[list[Any]]:
    """Let a robot walk on springs and on rigid pads, in all three simulations.

    Args:
        name: Name of the robot.
        duration: Measured duration of each walk, in s.

    Returns:
        Pads, simulation, distance in m, slip per distance, cost of transport and heave in m.
    """
    ground = Terrain.flat(FRICTION)
    springs, rigid = on_springs(name, DAMPING), ROBOTS[name]()
    viscous = {"time_step": 5e-5, "impratio": VISCOSITY / DAMPING}
    plants: dict[tuple[str, str], Plant] = {
        ("springs", "projection"): ProjectionPlant(springs, ground),
        ("springs", "rigid bodies"): RigidBodyPlant(springs, ground),
        ("springs", "MuJoCo"): MujocoPlant(springs, ground, **viscous),
        ("rigid", "projection"): ProjectionPlant(rigid, ground),
        ("rigid", "rigid bodies"): RigidBodyPlant(rigid, ground),
        **{
            ("rigid", f"MuJoCo, {stiffness:.0e} /s²"): MujocoPlant(
                rigid, ground, time_step=time_step, contact_stiffness=stiffness
            )
            for stiffness, time_step in RIGID_PADS.items()
        },
    }
    rows = []
    for label, plant in plants.items():
        found = walk(plant, CRANK_SPEED, duration, settle=1.0)
        numbers = found.distance, found.slip, found.cost_of_transport, found.heave
        rows.append([*label, *(round(number, 5) for number in numbers)])
        print(name, *rows[-1], file=sys.stderr, flush=True)
    return rows


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: in the air, the first half second, and walks."""
    air = [
        [name, *(f"{error:.1e}" for errors in by_step for error in errors)]
        for name, by_step in results["air"].items()
    ]
    heads = [
        f"{what}, {1e3 * step:g} ms" for step, _ in AIR for what in ("crank (rad)", "links (m)")
    ]
    names = [*results["start"]]
    starts = [
        [f"{friction:g}", f"{damping:g}", f"{1e3 * step:g}",
         *(f"{results['start'][name][k]:.1e}" for name in names)]
        for k, (friction, damping, step) in enumerate(STARTS[: len(results["start"][names[0]])])
    ]  # fmt: skip
    walked = [
        [name, *row[:2], *(f"{number:.3f}" for number in row[2:5]), f"{1e3 * row[5]:.1f}"]
        for name, rows in results["walks"].items()
        for row in rows
    ]
    head = ["robot", "pads", "simulation", "distance (m)", "slip (m/m)", "cost of transport"]
    return {
        PAGE: [
            table(["robot", *heads], air),
            table(["friction", "damping of the pads (N s/m)", "time step (ms)", *names], starts),
            table([*head, "heave (mm)"], walked, texts=3),
            table(
                [*DIFFERENCES, "distance (%)", "cost (%)"], differences(results["walks"]), texts=3
            ),
        ]
    }


def differences(walked: dict[str, list[list[Any]]]) -> list[list[str]]:
    """Return the largest differences of MuJoCo's walks from those of each backend."""
    off: dict[tuple[str, str, str], list[Any]] = {}
    for rows in walked.values():
        at = {(row[0], row[1]): np.array(row[2:]) for row in rows}
        for pads, simulation in at:
            if not simulation.startswith("MuJoCo"):
                continue
            for backend in ("projection", "rigid bodies"):
                ratio = at[pads, simulation] / at[pads, backend]
                off.setdefault((pads, simulation, backend), []).append(np.abs(ratio - 1.0)[[0, 2]])
    return [
        [*label, *(f"{100.0 * value:.1f}" for value in np.max(values, axis=0))]
        for label, values in off.items()
    ]


def main() -> None:
    """Measure, and write the data and the tables."""
    args = options(__doc__)
    names, air, starts, duration = LINKAGES, AIR, STARTS, 2.0
    if args.quick:
        names, starts, duration = names[:1], starts[:1], 0.5
    results = {
        "air": {name: [in_the_air(name, *case) for case in air] for name in names},
        "start": {name: [half_second(name, *case) for case in starts] for name in names},
        "walks": {name: walks(name, duration) for name in names},
    }
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
