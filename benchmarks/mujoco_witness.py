"""Does MuJoCo agree with the projection plant?

    python -m benchmarks.mujoco_witness [--out docs/validation] [--quick]

Robots in the air, the first half second on the ground, and walks. Writes ``mujoco.md``.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks import measure
from benchmarks.measure import table
from benchmarks.walks import walk
from jansen_env import ROBOTS, Compliance, Robot, Terrain
from jansen_env.export_mjcf import body_names, hinge_angles, to_mjcf
from jansen_env.plants.base import StepResult
from jansen_env.plants.plant import Plant, ProjectionPlant, RigidBodyPlant
from jansen_env.plants.rigid.bodies import poses

LINKAGES = ("paper", "klann", "chebyshev", "trotbot", "strider")
AIR = ((4e-4, 1e5), (2e-4, 1e6), (1e-4, 1e7))  # time step, s; stiffness of loops, 1/s^2
TORQUE, SPEED, FRICTION = 10.0, 4.0, 0.3  # N m in the air; rad/s; of the ground
HELD_STEP = 1e-5  # s, of the held plant
STIFFNESS, VISCOSITY = 2e4, 600.0  # of pads, N/m; N s/m along the ground
DAMPINGS = (60.0, 6.0)  # of pads, N s/m
Array = NDArray[np.float64]


class MujocoPlant:
    """A robot on a terrain in MuJoCo, as much of a plant as walks need; see :func:`to_mjcf`."""

    def __init__(
        self, robot: Robot, terrain: Terrain, time_step: float = 1e-4, **settings: float
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
        data, h, work, fell, slip = self.data, self.time_step, 0.0, False, np.zeros(self.toes)
        for _ in range(round(duration / h)):
            before = float(data.qvel[3])
            data.ctrl[0] = self.robot.motor.torque(torque, before)
            mujoco.mj_step(self.model, data)
            work += float(data.ctrl[0]) * h * 0.5 * (before + float(data.qvel[3]))
            for geoms, row in zip(data.contact.geom, data.contact.efc_address, strict=True):
                toe, force = self._toe[int(geoms[1])], data.efc_force[row : row + 3]
                fell |= toe < 0
                if toe >= 0:
                    rub = math.hypot(*force[1:])
                    sliding = rub >= 0.999 * self.terrain.friction * force[0] > 0.0
                    slip[toe] += h * math.hypot(*data.efc_vel[row + 1 : row + 3]) * sliding
        force, nan = np.zeros((self.toes, 2)), math.nan
        return StepResult(slip, force, work, nan, nan, nan, nan, fell, 0.0, 0.0)


def in_the_air(name: str, time_step: float, stiffness: float) -> tuple[float, float]:
    """Errors over a turn under :data:`TORQUE`: crank angle, rad; mass centres of all links, m."""
    robot, period, worst = ROBOTS[name](), 0.02, np.zeros(2)
    plant, angle = ProjectionPlant(robot, Terrain.flat(), HELD_STEP, held=True), 0.0
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


def half_second(name: str, friction: float, damping: float, time_step: float) -> float:
    """Largest difference of x, y, pitch and crank in half a second from rest, m and rad."""
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


def on_springs(name: str, damping: float) -> Robot:
    """A robot whose pads are springs and dampers, and stick by a damper alone, as MuJoCo's do."""
    return replace(ROBOTS[name](), pad_compliance=Compliance(STIFFNESS, damping, 1e-3, VISCOSITY))


def walks(name: str, duration: float) -> list[tuple[str, ...]]:
    """Rows: walks of a robot under the PID on three plants, on springs, then on rigid pads."""
    ground, springs, rigid = Terrain.flat(FRICTION), on_springs(name, 60.0), ROBOTS[name]()
    plants: dict[tuple[str, str], Plant | MujocoPlant] = {
        ("springs", "projection"): ProjectionPlant(springs, ground),
        ("springs", "rigid bodies"): RigidBodyPlant(springs, ground),
        ("springs", "MuJoCo"): MujocoPlant(springs, ground, 5e-5, impratio=VISCOSITY / 60.0),
        ("rigid", "projection"): ProjectionPlant(rigid, ground),
        ("rigid", "rigid bodies"): RigidBodyPlant(rigid, ground),
        ("rigid", "MuJoCo"): MujocoPlant(rigid, ground, 4e-5, contact_stiffness=1e7),
    }
    rows: list[tuple[str, ...]] = []
    for label, plant in plants.items():
        walked = walk(cast(Plant, plant), SPEED, duration, settle=1.0)
        rows.append((name, *label, f"{walked.distance:.3f}", f"{walked.slip:.3f}",
                     f"{walked.cost_of_transport:.3f}", f"{1e3 * walked.heave:.1f}"))  # fmt: skip
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    args = measure.parse(measure.options(__doc__, "docs/validation"), arguments)
    quick, names = args.quick, LINKAGES[: 1 if args.quick else None]
    air = [(name, *(f"{error:.1e}" for h, k in AIR for error in in_the_air(name, h, k)))
           for name in names]  # fmt: skip
    first = [(0.0, 60.0, h) for h in (2e-4, 1e-4, 5e-5)] + [(FRICTION, d, 1e-4) for d in DAMPINGS]
    short = [(f"{friction:g}", f"{d:g}", f"{h:g}",
              *(f"{half_second(name, friction, d, h):.1e}" for name in names))
             for friction, d, h in first[: 2 if quick else None]]  # fmt: skip
    rows = [row for name in names for row in walks(name, 0.5 if quick else 2.0)]
    head = (f"{what}, {1e3 * h:g} ms" for h, _ in AIR for what in ("crank (rad)", "links (m)"))
    measure.report(
        args.out / "mujoco.md",
        "# MuJoCo, the third witness",
        f"`python -m benchmarks.mujoco_witness`. {measure.machine()}",
        "## In the air",
        f"The chassis is held, {TORQUE:g} N m turn the crank once. Largest differences of MuJoCo "
        f"(Runge-Kutta) from `ProjectionPlant(held=True)`, steps of {HELD_STEP:g} s: crank angle, "
        "mass centres of the links. Loops are stiffer the smaller the step: 1e5, 1e6, 1e7 /s².",
        table(("robot", *head), air),
        "## The first half second",
        f"From rest under 6 N m, on pads of {STIFFNESS:g} N/m with a damper of {VISCOSITY:g} N s/m "
        "along the ground up to the friction. Largest difference of x, y (m), pitch, crank (rad).",
        table(("friction", "pads' damping (N s/m)", "step (s)", *names), short),
        "## Walks",
        f"The PID at {SPEED:g} rad/s, friction {FRICTION:g}, 2 s after 1 s. Springs: 20 kN/m, 60 "
        "N s/m, and 600 N s/m along the ground. MuJoCo: 0.05 ms on springs; 0.04 ms and contacts "
        "of 1e7 /s² on rigid pads.",
        table(("robot", "pads", "plant", "distance (m)", "slip (m/m)", "cost of transport",
               "heave (mm)"), rows),
    )  # fmt: skip


if __name__ == "__main__":
    main()
