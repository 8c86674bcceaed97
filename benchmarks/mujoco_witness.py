"""Does MuJoCo agree with the projection plant?

    python -m benchmarks.mujoco_witness [--out docs/validation] [--quick]

Robots in the air, the first half second on the ground, walks, and the torque that MuJoCo's friction
settings ask for. Writes ``mujoco.md``.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks import measure
from benchmarks.measure import table
from benchmarks.walks import walk, whole_half_turns
from jansen_env import ROBOTS, Compliance, Robot, Terrain
from jansen_env.export_mjcf import body_names, hinge_angles, to_mjcf
from jansen_env.plants.base import StepResult
from jansen_env.plants.bodies import poses
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.rigid_body import RigidBodyPlant
from jansen_env.robot import Payload

LINKAGES = ("paper", "klann", "chebyshev", "trotbot", "strider")
AIR = ((4e-4, 1e5), (2e-4, 1e6), (1e-4, 1e7))  # time step, s; stiffness of loops, 1/s^2
TORQUE, SPEED, FRICTION = 10.0, 4.0, 0.3  # N m in the air; rad/s; of the ground
HELD_STEP = 1e-5  # s, of the held plant
STIFFNESS, VISCOSITY = 2e4, 600.0  # of pads, N/m; N s/m along the ground
DAMPINGS = (200.0, 60.0, 20.0, 6.0, 2.0)  # of pads, N s/m
SETTINGS = ((0.95, 1.0), (0.95, 0.1), (0.9999, 1.0))  # impedance and damping ratio of contacts
Array = NDArray[np.float64]


class MujocoPlant:
    """A robot on a terrain in MuJoCo, as much of a plant as walks need; see :func:`to_mjcf`."""

    def __init__(
        self, robot: Robot, terrain: Terrain, time_step: float = 1e-4, **settings: Any
    ) -> None:
        self.robot, self.terrain, self.time_step = robot, terrain, time_step
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(robot, terrain, time_step, **settings))
        self.data, self.toes = mujoco.MjData(self.model), len(robot.toes)
        self._height = float(self.model.body("chassis").pos[2])
        pads = np.flatnonzero(self.model.geom_contype)
        toes = [f"{robot.leg_names[i]}_{robot.linkage.joints[j]}" for i, j in robot.toes]
        self._toe = {int(pad): -1 for pad in pads}  # toe of each pad's geom, -1 of other joints
        self._toe |= {self.model.geom(name).id: k for k, name in enumerate(toes)}

    def reset(self, crank_angle: float = 0.0) -> Array:
        """Place the robot as the projection plant does."""
        q = ProjectionPlant(self.robot, self.terrain).reset(crank_angle=crank_angle)[:4]
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:2] = q[0], q[1] - self._height
        for name, angle in hinge_angles(self.robot, q).items():
            self.data.joint(name).qpos[0] = angle
        return self.state

    @property
    def state(self) -> Array:
        """(8,) as of any plant."""
        return np.array([*self.data.qpos[:4], *self.data.qvel[:4]]) + self._height * np.eye(8)[1]

    @property
    def x(self) -> float:
        """Position of the crank axis, m."""
        return float(self.data.qpos[0])

    def step(self, torque: float, duration: float) -> StepResult:
        """Hold a torque (N m) for a while (s)."""
        data, h, work, losses, fell = self.data, self.time_step, 0.0, np.zeros(2), False
        slip, impulse = np.zeros(self.toes), np.zeros((self.toes, 2))
        for _ in range(round(duration / h)):
            before = float(data.qvel[3])
            data.ctrl[0] = self.robot.motor.torque(torque, before)
            mujoco.mj_step(self.model, data)
            work += float(data.ctrl[0]) * h * 0.5 * (before + float(data.qvel[3]))
            for geoms, row in zip(data.contact.geom, data.contact.efc_address, strict=True):
                toe, force = self._toe[int(geoms[1])], data.efc_force[row : row + 3]
                speed, rub = data.efc_vel[row : row + 3], math.hypot(*force[1:])
                losses -= h * (force[1:] @ speed[1:]), h * force[0] * speed[0]
                fell |= toe < 0
                if toe >= 0:
                    sliding = rub >= 0.999 * self.terrain.friction * force[0] > 0.0
                    slip[toe] += h * math.hypot(*speed[1:]) * sliding
                    impulse[toe] += h * rub, h * force[0]
        gap = float(np.abs(data.efc_pos[: data.ne]).max())
        along, across = losses.tolist()
        force = impulse / duration
        return StepResult(slip, force, work, 0.0, along, across, 0.0, fell, 0.0, 0.0, gap)


def in_the_air(name: str, time_step: float, stiffness: float) -> tuple[float, float]:
    """Errors over a turn under :data:`TORQUE`: crank angle, rad; mass centres of all links, m."""
    robot, period, worst = ROBOTS[name](), 0.02, np.zeros(2)
    plant, angle = ProjectionPlant(robot, Terrain.flat(), HELD_STEP, held=True), 0.0
    plant.reset()
    text = to_mjcf(robot, None, time_step, stiffness).replace("implicitfast", "RK4")
    model = mujoco.MjModel.from_xml_string(text)
    data, bodies = mujoco.MjData(model), [model.body(one).id for one in body_names(robot)]
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


def half_second(name: str, friction: float, damping: float, time_step: float) -> float:
    """Largest difference of x, y, pitch and crank in half a second from rest, m and rad."""
    robot, ground = on_springs(name, damping), Terrain.flat(friction)
    one = ProjectionPlant(robot, ground, 0.5 * time_step)
    other = MujocoPlant(robot, ground, time_step, impratio=VISCOSITY / damping)
    one.reset()
    other.reset()
    worst = 0.0
    for _ in range(50):
        one.step(6.0, 0.01)
        other.step(6.0, 0.01)
        worst = max(worst, float(np.abs(one.state - other.state)[:4].max()))
    return worst


def on_springs(name: str, damping: float) -> Robot:
    """A robot whose pads are springs and dampers, and stick by a damper alone, as MuJoCo's do."""
    return replace(ROBOTS[name](), pad_compliance=Compliance(STIFFNESS, damping, 1e-3, VISCOSITY))


def walked(label: str, plant: Any, duration: float) -> tuple[str, ...]:
    """Row: a walk under the PID."""
    forces = [0.0]
    start = time.process_time()
    measured = whole_half_turns(SPEED, duration)
    found = walk(plant, SPEED, measured, 1.0, watch=lambda r: forces.append(r.contact_force.max()))
    took, simulated = time.process_time() - start, 1.0 + measured
    if isinstance(plant, MujocoPlant):  # without what Python reads in each time step
        start, simulated = time.process_time(), 500 * plant.time_step
        mujoco.mj_step(plant.model, plant.data, 500)
        took = time.process_time() - start
    values = (found.distance, found.slip, found.cost_of_transport)
    return (label, *(f"{value:.3f}" for value in values), f"{max(forces):.0f}",
            f"{1e3 * found.heave:.1f}", f"{simulated / took:,.2g}")  # fmt: skip


def walks(name: str, duration: float) -> list[tuple[str, ...]]:
    """Rows: a robot on springs, then on rigid pads, on three plants."""
    ground, springs, rigid = Terrain.flat(FRICTION), on_springs(name, 60.0), ROBOTS[name]()
    sticky = {"impratio": VISCOSITY / 60.0}
    runs: dict[str, Any] = {
        "springs, projection": ProjectionPlant(springs, ground),
        "rigid bodies": RigidBodyPlant(springs, ground),
        "MuJoCo, 0.2 ms": MujocoPlant(springs, ground, 2e-4, **sticky),
        "MuJoCo, 0.05 ms": MujocoPlant(springs, ground, 5e-5, **sticky),
        "rigid pads, projection": ProjectionPlant(rigid, ground),
        "rigid bodies ": RigidBodyPlant(rigid, ground),
    }
    for stiffness, h in ((1e5, 2e-4), (1e6, 1e-4), (1e7, 4e-5)):
        plant = MujocoPlant(rigid, ground, h, contact_stiffness=stiffness)
        runs[f"MuJoCo, {stiffness:.0e} /s²"] = plant
    return [walked(f"{name}, {label}", plant, duration) for label, plant in runs.items()]


def settings(impratios: tuple[float, ...]) -> list[tuple[str, ...]]:
    """Rows: the work of a turn of twelve legs without joint friction, and where it goes."""
    robot, ground = ROBOTS["holy_slender"](6), Terrain.flat(1.5)
    robot = replace(robot, damping=(0.0,) * len(robot.damping), payload=Payload(30.0, 100.0))
    plants: dict[tuple[str, ...], Any] = {
        (f"projection, {1e3 * h:g} ms", "", "", ""): ProjectionPlant(robot, ground, h)
        for h in (1e-3, 2.5e-4)
    }
    for impedance, ratio in SETTINGS:
        for impratio in impratios:
            plant = MujocoPlant(robot, ground, 2.5e-4, impratio=impratio)
            pads = plant.model.geom_contype == 1
            plant.model.geom_solref[pads] = -1e5, -2.0 * ratio * math.sqrt(1e5)
            plant.model.geom_solimp[pads, :2] = impedance
            plants["MuJoCo", f"{impratio:g}", f"{ratio:g}", f"{impedance:g}"] = plant
    rows, turn = [], 2.0 * math.pi
    for label, plant in plants.items():
        found: list[StepResult] = []
        walk(plant, 1.0, turn, 1.0, limit=1e3, watch=found.append)
        sums = np.sum([(r.motor_work, r.slip_loss, r.impact_loss) for r in found], axis=0)
        rows.append((*label, *(f"{value / turn:.2f}" for value in sums)))
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    found = measure.chosen(measure.options(__doc__, "docs/validation"), arguments)
    quick, names = found.quick, LINKAGES[: 1 if found.quick else None]
    air = [(name, f"{h:g}", f"{k:.0e}", *(f"{error:.1e}" for error in in_the_air(name, h, k)))
           for name in names for h, k in AIR]  # fmt: skip
    first = [(0.0, 60.0, h) for h in (2e-4, 1e-4, 5e-5)] + [(FRICTION, d, 1e-4) for d in DAMPINGS]
    short = [(f"{friction:g}", f"{d:g}", f"{h:g}",
              *(f"{half_second(name, friction, d, h):.1e}" for name in names))
             for friction, d, h in first[: 2 if quick else None]]  # fmt: skip
    rows = [row for name in names for row in walks(name, 0.5 if quick else 2.0)]
    work = settings((1.0,) if quick else (1.0, 10.0, 100.0))
    measure.report(
        found.out / "mujoco.md",
        "# MuJoCo, the third witness",
        f"`python -m benchmarks.mujoco_witness`. {measure.machine()}",
        "## In the air",
        f"The chassis is held, {TORQUE:g} N m turn the crank once. Largest differences of MuJoCo "
        f"(Runge-Kutta) from `ProjectionPlant(held=True)`, steps of {HELD_STEP:g} s: crank angle, "
        "mass centres of the links.",
        table(("robot", "step (s)", "loop stiffness (1/s²)", "crank (rad)", "links (m)"), air),
        "## The first half second",
        f"From rest under 6 N m, on pads of {STIFFNESS:g} N/m with a damper of {VISCOSITY:g} N s/m "
        "along the ground up to the friction. Largest difference of x, y (m), pitch, crank (rad).",
        table(("friction", "pads' damping (N s/m)", "step (s)", *names), short),
        "## Walks",
        f"The PID at {SPEED:g} rad/s, friction {FRICTION:g}, 2 s after 1 s. Toe force: largest "
        "mean of 20 ms. Springs: 20 kN/m, 60 N s/m, and 600 N s/m along the ground.",
        table(("robot, plant", "distance (m)", "slip (m/m)", "cost of transport", "toe force (N)",
               "heave (mm)", "times real time"), rows),
        "## Friction settings",
        "Twelve legs (`holy_slender`, six phases) without joint friction under 30 kg, one turn at "
        "1 rad/s, friction 1.5. MuJoCo: 0.25 ms, contacts of 1e5 /s². Means; losses in J/rad.",
        table(("plant", "impratio", "damping ratio", "impedance", "motor (N m)",
               "lost along the ground", "lost across it"), work),
    )  # fmt: skip


if __name__ == "__main__":
    main()
