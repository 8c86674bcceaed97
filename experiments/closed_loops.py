"""How well do simulators keep the closed loops of a linkage closed?

Run the experiment as follows. It takes about four minutes on one idle core.

    python experiments/closed_loops.py [--quick]

Three problems are solved in both simulation backends of this package and in MuJoCo, with the
default settings of each and with the most accurate settings that were found: a swing of the robot
``built`` with a fixed chassis and without friction, Andrews' squeezing mechanism, and a walk of the
paper's robot. ``experiments/newton_loops.py`` adds the results of Newton. The script writes
``docs/closed_loops/closed_loops.json`` and the tables of docs/closed_loops.md.
"""

import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
from mujoco_backend import MujocoBatch, MujocoPlant, put_hinges, widest_gap
from pages import DOCS, options, publish, table
from reference_problems import (
    SQUEEZER_END,
    SQUEEZER_START,
    SQUEEZER_TIME,
    SQUEEZER_TORQUE,
    squeezer,
)
from typing_extensions import override
from walks import CONTROL_DT, walk

from jansen_env import ROBOTS, Compliance, Robot, Terrain
from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.plants.base import StepResult
from jansen_env.plants.mujoco_model import to_mjcf
from jansen_env.plants.plant import Plant, ProjectionPlant, RigidBodyPlant
from jansen_env.robot.kinematics import world_joints
from jansen_env.robot.motor import IDEAL

DATA, PAGE = "closed_loops/closed_loops.json", "closed_loops.md"
NEWTON = "closed_loops/newton.json"  # written by experiments/newton_loops.py

SWING_SPEED = 10.0  # initial crank speed of the swing, in rad/s
SWING_TIME = 1.0  # s
SWING_SAMPLES = 50
REFERENCE_STEP = 2e-5  # time step of the projection backend for the reference of the swing, in s
SQUEEZER_SAMPLES = 100
BELOW = Terrain(((-100.0, -5.0), (100.0, -5.0)))
"""Ground that the legs of a fixed chassis do not reach, in the rigid-body backend."""
CRANK_SPEED, FRICTION, WALK_TIME = 4.0, 0.3, 4.0  # in rad/s; without unit; in s

OURS, RIGID, MUJOCO = "this package, projection", "this package, rigid bodies", "MuJoCo"
PLANTS: dict[str, Any] = {OURS: ProjectionPlant, RIGID: RigidBodyPlant}
TIMINGS = 3  # number of runs, of which the fastest determines the CPU time


TimeSteps = dict[str, tuple[float, ...]]
"""Time steps of each backend of this package, in s."""


class Setting(NamedTuple):
    """Settings of MuJoCo.

    Attributes:
        label: Description of the settings.
        time_step: Time step, in s.
        stiffness: Stiffness of loops, divided by mass, in 1/s^2. None keeps the default of MuJoCo
            for the constraints that close loops and for contacts.
        contact_stiffness: Stiffness of contacts, divided by mass, in 1/s^2.
        integrator: Name of the integrator.
    """

    label: str
    time_step: float
    stiffness: float | None
    contact_stiffness: float
    integrator: str


def default_setting(time_step: float = 2e-3) -> Setting:
    """Return the default settings of MuJoCo, with a time step."""
    return Setting(f"default, {1e3 * time_step:g} ms", time_step, None, 0.0, "Euler")


def stiff(
    time_step: float, stiffness: float, integrator: str, contact_stiffness: float = 1e6
) -> Setting:
    """Return settings with stiff loops."""
    label = f"{integrator}, {1e3 * time_step:g} ms, {stiffness:.0e} /s²"
    return Setting(label, time_step, stiffness, contact_stiffness, integrator)


def model_text(robot: Robot, terrain: Terrain | None, setting: Setting, gravity: float) -> str:
    """Return a robot as MJCF with settings of MuJoCo.

    Args:
        robot: The robot.
        terrain: The ground. None holds the chassis in the air.
        setting: The settings.
        gravity: Acceleration of gravity, in m/s^2.
    """
    stiffness = setting.stiffness or 1e6
    contact = setting.contact_stiffness or 1e6
    text = to_mjcf(robot, terrain, setting.time_step, stiffness, contact, gravity=gravity)
    root = ET.fromstring(text)
    option = next(root.iter("option"))
    option.set("integrator", setting.integrator)
    if setting.stiffness is None:
        for name in ("cone", "impratio", "solver", "tolerance", "iterations"):
            del option.attrib[name]
        for element in root.iter():
            for name in ("solref", "solimp"):
                element.attrib.pop(name, None)
    ET.SubElement(option, "flag", energy="enable")
    return ET.tostring(root, encoding="unicode")


class Machine(Protocol):
    """A mechanism with a fixed frame in a simulator."""

    gap: float
    """Widest gap of any pin so far, in m."""
    seconds: float
    """CPU time of all steps so far, in s."""

    quick: bool
    """Whether the CPU time of a step is too short to be measured together with other quantities.

    If so, the CPU time is measured in separate runs.
    """

    def advance(self, torque: float, duration: float) -> None:
        """Simulate some time under a constant torque on the crank."""

    def time(self, torque: float, duration: float) -> float:
        """Return the CPU time of a motion in which nothing else is measured, in s."""

    @property
    def angle(self) -> float:
        """Crank angle, in rad."""

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, in J."""


class PlantMachine:
    """A mechanism in one of the simulation backends of this package.

    Args:
        plant: The backend with a fixed chassis.
        angle: Initial crank angle, in rad.
        speed: Initial crank speed, in rad/s.
    """

    def __init__(self, plant: Plant, angle: float, speed: float) -> None:
        self.plant = plant
        self.gap = 0.0
        self.quick = isinstance(plant, ProjectionPlant)
        self.seconds = 0.0
        state = np.zeros(8)
        state[3] = angle
        state[7] = speed
        plant.state = state

    def advance(self, torque: float, duration: float) -> None:
        """Simulate some time under a constant torque on the crank."""
        begun = time.process_time()
        result = self.plant.step(torque, duration)
        self.seconds += time.process_time() - begun
        self.gap = max(self.gap, result.joint_gap, self._pad_error())

    def time(self, torque: float, duration: float) -> float:
        """Return the CPU time of a motion in which nothing else is measured, in s."""
        begun = time.process_time()
        self.plant.step(torque, duration)
        return time.process_time() - begun

    def _pad_error(self) -> float:
        """Return the distance of the toes from their positions in the closed linkage, in m."""
        if not isinstance(self.plant, ProjectionPlant):
            return 0.0
        robot = self.plant.robot
        joints: Array = world_joints(robot, self.plant.state[:4])
        toes = np.array([joints[leg][joint] for leg, joint in robot.toes])
        return float(np.abs(self.plant.toe_positions() - toes).max())

    @property
    def angle(self) -> float:
        """Crank angle, in rad."""
        return float(self.plant.state[3])

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, in J."""
        return self.plant.energy()


class MujocoMachine:
    """A mechanism in MuJoCo.

    Args:
        robot: The mechanism.
        setting: Settings of MuJoCo.
        angle: Initial crank angle, in rad.
        speed: Initial crank speed, in rad/s.
        gravity: Acceleration of gravity, in m/s^2.
    """

    def __init__(
        self, robot: Robot, setting: Setting, angle: float, speed: float, gravity: float
    ) -> None:
        text = model_text(robot, None, setting, gravity)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.gap = 0.0
        self.quick = True
        self.seconds = 0.0
        motion = np.array([0.0, 0.0, 0.0, angle]), np.array([0.0, 0.0, 0.0, speed])
        put_hinges(self.data, robot, *motion)
        mujoco.mj_forward(self.model, self.data)

    def advance(self, torque: float, duration: float) -> None:
        """Simulate some time under a constant torque on the crank."""
        self.data.ctrl[0] = torque
        for _ in range(round(duration / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
            self.gap = max(self.gap, widest_gap(self.data))

    def time(self, torque: float, duration: float) -> float:
        """Return the CPU time of a motion in which nothing else is measured, in s."""
        self.data.ctrl[0] = torque
        begun = time.process_time()
        mujoco.mj_step(self.model, self.data, round(duration / self.model.opt.timestep))
        return time.process_time() - begun

    @property
    def angle(self) -> float:
        """Crank angle, in rad."""
        return float(self.data.joint("shaft").qpos[0])

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, in J."""
        mujoco.mj_forward(self.model, self.data)
        return float(self.data.energy.sum())


class Motion(NamedTuple):
    """Result of a motion with a fixed frame.

    Attributes:
        angle: Crank angle at the end, in rad.
        gap: Widest gap of any pin, in m.
        drift: Largest energy that appeared or disappeared, in J.
        seconds: CPU time of the simulation per second of simulated time, in s.
    """

    angle: float
    gap: float
    drift: float
    seconds: float


def follow(make: Callable[[], Machine], torque: float, duration: float, samples: int) -> Motion:
    """Simulate a motion under a constant torque, and measure it.

    Args:
        make: Function that returns the mechanism in its initial state.
        torque: Torque on the crank, in N m.
        duration: Duration, in s.
        samples: Number of times at which the energy is measured.
    """
    machine = make()
    start = machine.energy - torque * machine.angle
    drift = 0.0
    for _ in range(samples):
        machine.advance(torque, duration / samples)
        drift = max(drift, abs(machine.energy - torque * machine.angle - start))
    seconds = machine.seconds
    if machine.quick:
        seconds = min(make().time(torque, duration) for _ in range(TIMINGS))
    return Motion(machine.angle, machine.gap, drift, seconds / duration)


def swinging_robot() -> Robot:
    """Return the robot ``built`` without friction, and with an ideal motor."""
    robot = ROBOTS["built"]()
    frictionless = (0.0,) * len(robot.bearing_friction)
    return replace(robot, bearing_friction=frictionless, motor=IDEAL, pad_compliance=Compliance())


def swings(plants: TimeSteps, settings: list[Setting]) -> list[list[Any]]:
    """Swing a robot whose chassis is fixed.

    Args:
        plants: Time steps of each backend of this package, in s.
        settings: Settings of MuJoCo.

    Returns:
        Simulator, settings, gap in m, energy error relative to the initial kinetic energy, error of
        the crank angle at the end in rad, and CPU time per simulated second, in s.
    """
    robot = swinging_robot()

    def ours(kind: str, step: float) -> Machine:
        made = PLANTS[kind](robot, BELOW, step, fixed_chassis=True)
        return PlantMachine(made, 0.0, SWING_SPEED)

    def run(make: Callable[[], Machine]) -> Motion:
        return follow(make, 0.0, SWING_TIME, SWING_SAMPLES)

    reference = run(lambda: ours(OURS, REFERENCE_STEP)).angle
    at_rest = PlantMachine(ProjectionPlant(robot, BELOW, fixed_chassis=True), 0.0, 0.0).energy
    kinetic = ours(OURS, 1e-3).energy - at_rest
    rows: list[list[Any]] = []
    for kind, steps in plants.items():
        for step in steps:
            found = run(partial(ours, kind, step))
            rows.append([kind, f"{1e3 * step:g} ms", *_errors(found, reference, kinetic)])
            report("swing", rows[-1])
    for setting in settings:
        found = run(partial(MujocoMachine, robot, setting, 0.0, SWING_SPEED, GRAVITY))
        rows.append([MUJOCO, setting.label, *_errors(found, reference, kinetic)])
        report("swing", rows[-1])
    return rows


def _errors(found: Motion, reference: float, scale: float) -> list[float]:
    """Return gap, energy error, error of the crank angle and CPU time of a motion."""
    return [found.gap, found.drift / scale, abs(found.angle - reference), found.seconds]


def squeezes(plants: TimeSteps, settings: list[Setting]) -> list[list[Any]]:
    """Solve Andrews' squeezing mechanism.

    Args:
        plants: Time steps of each backend of this package, in s.
        settings: Settings of MuJoCo.

    Returns:
        Simulator, settings, gap in m, energy error relative to the work of the torque, error of the
        crank angle at the end in rad, and CPU time per simulated second, in s.
    """
    robot = squeezer()
    work = SQUEEZER_TORQUE * (SQUEEZER_END - SQUEEZER_START)

    def ours(kind: str, step: float) -> Machine:
        made = PLANTS[kind](robot, BELOW, step, gravity=0.0, fixed_chassis=True)
        return PlantMachine(made, SQUEEZER_START, 0.0)

    def run(make: Callable[[], Machine], step: float) -> Motion:
        samples = min(SQUEEZER_SAMPLES, round(SQUEEZER_TIME / step))
        return follow(make, SQUEEZER_TORQUE, SQUEEZER_TIME, samples)

    rows: list[list[Any]] = []
    for kind, steps in plants.items():
        for step in steps:
            found = run(partial(ours, kind, step), step)
            rows.append([kind, f"{1e3 * step:g} ms", *_errors(found, SQUEEZER_END, work)])
            report("squeezer", rows[-1])
    for setting in settings:
        found = run(
            partial(MujocoMachine, robot, setting, SQUEEZER_START, 0.0, 0.0), setting.time_step
        )
        rows.append([MUJOCO, setting.label, *_errors(found, SQUEEZER_END, work)])
        report("squeezer", rows[-1])
    return rows


class SetBatch(MujocoBatch):
    """A robot in MuJoCo with settings.

    Args:
        robot: The robot.
        terrain: The ground.
        setting: Settings of MuJoCo.
    """

    def __init__(self, robot: Robot, terrain: Terrain, setting: Setting) -> None:
        self._setting = setting
        super().__init__(robot, terrain, setting.time_step)

    @override
    def _model_text(self) -> str:
        """Return the robot on its terrain as MJCF with the settings."""
        ground: Any = self._ground
        return model_text(self._machine, ground, self._setting, GRAVITY)


class SetPlant(MujocoPlant):
    """A robot in MuJoCo with settings; the arguments are those of :class:`SetBatch`."""

    def __init__(self, robot: Robot, terrain: Terrain, setting: Setting) -> None:
        Plant.__init__(self, SetBatch(robot, terrain, setting))


def walks(plants: TimeSteps, settings: list[Setting], duration: float) -> list[list[Any]]:
    """Let the paper's robot walk under the paper's PID.

    Args:
        plants: Time steps of each backend of this package, in s.
        settings: Settings of MuJoCo.
        duration: Measured duration of each walk, in s.

    Returns:
        Simulator, settings, gap in m, speed in m/s, slip per distance, cost of transport, and CPU
        time per simulated second, in s.
    """
    robot, ground = ROBOTS["paper"](), Terrain.flat(FRICTION)
    made: list[tuple[str, str, Callable[[], Plant]]] = []
    for kind, steps in plants.items():
        plant = PLANTS[kind]
        for step in steps:
            made.append((kind, f"{1e3 * step:g} ms", partial(plant, robot, ground, step)))
    for setting in settings:
        made.append((MUJOCO, setting.label, partial(SetPlant, robot, ground, setting)))
    rows: list[list[Any]] = []
    for simulator, label, make in made:
        rows.append([simulator, label, *_walked(make(), duration)])
        report("walk", rows[-1])
    return rows


def _walked(plant: Plant, duration: float) -> list[float | None]:
    """Let a robot walk; return gap, speed, slip, cost of transport and CPU time."""
    gaps = [0.0]

    def watch(result: StepResult) -> None:
        gaps.append(result.joint_gap)

    try:
        found = walk(plant, CRANK_SPEED, duration, watch=watch)
    except FloatingPointError:
        return [None] * 5
    numbers = found.speed, found.slip, found.cost_of_transport
    return [max(gaps), *(None if math.isnan(n) else n for n in numbers), _walking_time(plant)]


def _walking_time(plant: Plant) -> float:
    """Return the CPU time per simulated second of a robot that is walking, in s."""
    control_steps = 10
    duration = control_steps * CONTROL_DT
    begun = time.process_time()
    if isinstance(plant, SetPlant):
        mujoco.mj_step(plant.model, plant.data, round(duration / plant.time_step))
    else:
        for _ in range(control_steps):
            plant.step(0.0, CONTROL_DT)
    return (time.process_time() - begun) / duration


def report(problem: str, row: list[Any]) -> None:
    """Print a row to standard error."""
    print(problem, *row, file=sys.stderr, flush=True)


def number(value: float | None, form: str) -> str:
    """Return a number as text, or a dash if there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:{form}}"


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: the swing, the squeezer, and the walk."""
    heads = {
        "swing": [
            "simulator (swing)",
            "settings",
            "widest gap (m)",
            "energy error (fraction of the kinetic energy)",
            "error of the crank angle (rad)",
        ],
        "squeezer": [
            "simulator (squeezer)",
            "settings",
            "widest gap (m)",
            "energy error (fraction of the work)",
            "error of the crank angle (rad)",
        ],
        "walk": [
            "simulator (walk)",
            "settings",
            "widest gap (m)",
            "speed (m/s)",
            "slip (m/m)",
            "cost of transport",
        ],
    }
    made = []
    for problem, head in heads.items():
        forms = [".1e", ".3f", ".3f", ".3f"] if problem == "walk" else [".1e"] * 3
        rows = [
            [*row[:2], *map(number, row[2:-1], forms), number(row[-1], ".2g")]
            for row in results[problem]
        ]
        made.append(table([*head, "CPU time per simulated second (s)"], rows, texts=2))
    return {PAGE: made}


def main() -> None:
    """Measure, and write the data and the tables."""
    args = options(__doc__)
    plants: TimeSteps = {OURS: (1e-3, 1e-4), RIGID: (2.5e-4, 1e-4)}
    swing_settings = [
        default_setting(),
        default_setting(1e-4),
        stiff(5e-4, 1e6, "implicitfast"),
        stiff(1e-4, 1e7, "implicitfast"),
        stiff(1e-3, 1e5, "RK4"),
        stiff(2e-4, 1e6, "RK4"),
        stiff(1e-4, 1e7, "RK4"),
    ]
    squeezer_plants: TimeSteps = {OURS: (1e-4, 1e-5, 1e-6), RIGID: (1e-5, 2e-6)}
    squeezer_settings = [
        default_setting(1e-3),
        default_setting(1e-4),
        stiff(1e-5, 1e9, "implicitfast"),
        stiff(1e-5, 1e9, "RK4"),
        stiff(1e-6, 1e11, "RK4"),
    ]
    walk_settings = [
        default_setting(),
        default_setting(1e-4),
        stiff(5e-4, 1e6, "implicitfast", 2e5),
        stiff(1e-4, 1e7, "implicitfast"),
        stiff(4e-5, 1e7, "implicitfast", 1e7),
    ]
    duration = WALK_TIME
    if args.quick:
        plants = {OURS: (1e-3,), RIGID: (2.5e-4,)}
        squeezer_plants = {OURS: (1e-4,), RIGID: (1e-5,)}
        swing_settings, squeezer_settings, walk_settings = (
            settings[:1] for settings in (swing_settings, squeezer_settings, walk_settings)
        )
        duration = 0.5
    results = {
        "swing": swings(plants, swing_settings),
        "squeezer": squeezes(squeezer_plants, squeezer_settings),
        "walk": walks(plants, walk_settings, duration),
    }
    if (DOCS / NEWTON).exists():
        newton = json.loads((DOCS / NEWTON).read_text(encoding="utf-8"))
        for problem, rows in newton.items():
            results[problem] += rows
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
