"""How well does Newton keep the closed loops of a linkage closed?

Newton is not among the dependencies of this package. Run the experiment in an environment with
Newton 1.8, from the root of a clone. It takes about 20 minutes on one core.

    python -m pip install newton==1.8.0 mujoco gymnasium pymunk scipy
    PYTHONPATH=.:experiments python -m experiments.newton_loops

The problems are those of ``experiments/closed_loops.py``. The script writes
``docs/closed_loops/newton.json``, which that script adds to its tables. Newton reads the exported
MJCF. Torques, springs and joint friction are applied as external forces on the bodies.
"""

import math
import sys
import time
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import newton
import numpy as np
import warp as wp
from closed_loops import (
    BELOW,
    CRANK_SPEED,
    FRICTION,
    NEWTON,
    SWING_SPEED,
    PlantMachine,
    swinging_robot,
)
from pages import DOCS
from reference_problems import (
    SQUEEZER_END,
    SQUEEZER_START,
    SQUEEZER_TIME,
    SQUEEZER_TORQUE,
    squeezer,
)
from walks import CONTROL_DT

from jansen_env import ROBOTS, Robot, Terrain
from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.spring_forces import end_position, spring_ends
from jansen_env.files import write_json
from jansen_env.plants.mujoco_model import body_names, to_mjcf
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.plants.rigid import bodies as links
from jansen_env.plants.rigid.bodies import CHASSIS, SHAFT
from jansen_env.policies.policy import PAPER_PID
from jansen_env.robot import Spring
from jansen_env.robot.kinematics import coordinates

SIMULATOR = "Newton 1.8, SolverKamino"
RAIL = 1e-3  # mass of the two bodies that let the chassis move in the plane, in kg
SWING_TIME = 0.2  # duration of the swing, which is shorter than in closed_loops.py, in s
SETTLE = 1.0  # time of walking that is not measured, in s
WALK_TIME = 0.5 * math.pi  # two half turns of the crank, in s


class Setting(NamedTuple):
    """Settings of SolverKamino.

    Attributes:
        label: Description of the settings.
        time_step: Time step, in s.
        solver: Name of the solver of the dynamics.
        alpha: Fraction of the gap of a joint that is corrected per time step.
        tolerance: Tolerance of the solver PADMM, and its largest number of iterations.
    """

    label: str
    time_step: float
    solver: str = "padmm"
    alpha: float = 0.01
    tolerance: tuple[float, int] = (1e-6, 200)


def model_text(robot: Robot, terrain: Terrain | None) -> str:
    """Return a robot as MJCF that SolverKamino accepts.

    The solver rejects a body with several joints. The chassis therefore moves on two light bodies,
    one along x and one along z.

    Args:
        robot: The robot.
        terrain: The ground. None holds the chassis in the air.
    """
    root = ET.fromstring(to_mjcf(robot, terrain))
    if terrain is None:
        return ET.tostring(root, encoding="unicode")
    world = next(root.iter("worldbody"))
    chassis = next(body for body in world if body.get("name") == "chassis")
    position = chassis.attrib.pop("pos")
    parent = world
    world.remove(chassis)
    for name in ("x", "z"):
        joint = next(each for each in chassis if each.get("name") == name)
        chassis.remove(joint)
        rail = ET.SubElement(parent, "body", name=f"rail_{name}")
        rail.append(joint)
        tiny = {"pos": "0 0 0", "mass": str(RAIL), "diaginertia": "1e-6 1e-6 1e-6"}
        ET.SubElement(rail, "inertial", tiny)
        parent = rail
    first = next(body for body in world if body.get("name") == "rail_x")
    first.set("pos", position)
    parent.append(chassis)
    return ET.tostring(root, encoding="unicode")


class Kamino:
    """A robot in Newton.

    Args:
        robot: The robot.
        terrain: The ground. None holds the chassis in the air.
        setting: Settings of the solver.
        gravity: Acceleration of gravity, in m/s^2.
        q: Initial pose (x, y, theta, psi), in m and rad.
        v: Initial rates of the pose, in m/s and rad/s.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain | None,
        setting: Setting,
        gravity: float,
        q: Array,
        v: Array,
    ) -> None:
        self.robot = robot
        self.setting = setting
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
        newton.solvers.SolverKamino.register_custom_attributes(builder)
        builder.begin_world(label="world")
        text = model_text(robot, terrain)
        builder.add_mjcf(text, parse_visuals=False, enable_self_collisions=False)
        builder.end_world()
        model = self.model = builder.finalize(skip_validation_joints=True, device="cpu")
        model.gravity.assign(np.tile([0.0, 0.0, -gravity], (len(model.gravity), 1)))
        if terrain is not None:
            model.shape_material_mu.fill_(FRICTION)
            model.shape_material_restitution.fill_(0.0)
        kind = newton.solvers.SolverKamino.Config
        config = kind.from_model(model, dynamics_solver=setting.solver)
        config.use_collision_detector = terrain is not None
        config.constraints.alpha = setting.alpha
        tolerance, iterations = setting.tolerance
        config.padmm.primal_tolerance = tolerance
        config.padmm.dual_tolerance = tolerance
        config.padmm.compl_tolerance = tolerance
        config.padmm.max_iterations = iterations
        self.solver = newton.solvers.SolverKamino(model=model, config=config)
        self.state, self.next = model.state(), model.state()
        self.control = model.control()
        labels = [label.rsplit("/", 1)[-1] for label in model.body_label]
        self.bodies = [labels.index(name) for name in body_names(robot)]
        self.mass = model.body_mass.numpy().astype(float)
        self.inertia = model.body_inertia.numpy().astype(float)[:, 1, 1]
        self.com = model.body_com.numpy().astype(float)
        self.friction = links.joint_friction(robot)
        self._put(links.poses(robot, q), links.rates(robot, q, v))
        self.gap = 0.0
        self.seconds = 0.0
        self.turns = 0.0
        self._last = self._shaft_angle()
        self._start = float(q[3])

    def _put(self, poses: Array, rates: Array) -> None:
        """Set the poses and the rates of all bodies."""
        place = self.state.body_q.numpy()
        speed = self.state.body_qd.numpy()
        for k, (angle, x, z), (spin, vx, vz) in zip(self.bodies, poses, rates, strict=True):
            cos, sin = math.cos(angle), math.sin(angle)
            cx, _, cz = self.com[k]
            place[k, :3] = x - cos * cx + sin * cz, 0.0, z - sin * cx - cos * cz
            place[k, 3:] = 0.0, -math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle)
            speed[k] = vx, 0.0, vz, 0.0, -spin, 0.0
        chassis = self.bodies[CHASSIS]
        for k, label in enumerate(self.model.body_label):
            if label.endswith("rail_x"):
                place[k, 0] = place[chassis, 0]
            if label.endswith("rail_z"):
                place[k, :3] = place[chassis, :3]
        self.state.body_q.assign(place)
        self.state.body_qd.assign(speed)

    def motion(self) -> tuple[Array, Array, Array, Array]:
        """Return angles, centres of mass, spins and velocities of the bodies of the robot."""
        place = self.state.body_q.numpy().astype(float)[self.bodies]
        speed = self.state.body_qd.numpy().astype(float)[self.bodies]
        angles = -2.0 * np.arctan2(place[:, 4], place[:, 6])
        cos, sin = np.cos(angles), np.sin(angles)
        cx, cz = self.com[self.bodies][:, 0], self.com[self.bodies][:, 2]
        x = place[:, 0] + cos * cx - sin * cz
        z = place[:, 2] + sin * cx + cos * cz
        return angles, np.stack([x, z], axis=1), -speed[:, 4], speed[:, [0, 2]]

    def _shaft_angle(self) -> float:
        angles = self.motion()[0]
        return float(angles[SHAFT] - angles[CHASSIS])

    @property
    def angle(self) -> float:
        """Crank angle, in rad."""
        turned = self._shaft_angle()
        self.turns += math.remainder(turned - self._last, 2.0 * math.pi)
        self._last = turned
        return self._start + self.turns

    def _spring_ends(self) -> list[tuple[int, Array, int, Array, Spring]]:
        """Return, for each spring of the first leg, its two bodies and its ends on them."""
        found = []
        x = coordinates(self.robot, "fore", 0.0)
        home = links.poses(self.robot, np.zeros(4))
        for spring in self.robot.springs:
            assert isinstance(spring, Spring)
            ends = []
            for end in spring_ends(self.robot, spring):
                place, _ = end_position(end, "fore", x)
                ends += [end.body, np.asarray(place) - home[end.body, 1:]]
            found.append((*ends, spring))
        return found  # type: ignore[return-value]

    def advance(self, torque: float, duration: float) -> None:
        """Simulate some time under a constant torque on the crank."""
        springs = self._spring_ends()
        for _ in range(round(duration / self.setting.time_step)):
            angles, centres, spins, _ = self.motion()
            force = np.zeros((self.model.body_count, 6), np.float32)
            turning = -self.friction @ spins
            turning[SHAFT] += torque
            turning[CHASSIS] -= torque
            push = np.zeros((len(self.bodies), 2))
            for a, on_a, b, on_b, spring in springs:
                arms = [turned(angles[k], on) for k, on in ((a, on_a), (b, on_b))]
                line = centres[b] + arms[1] - centres[a] - arms[0]
                length = float(np.hypot(*line))
                pull = spring.stiffness * (length - spring.rest_length) / length * line
                for k, arm, f in ((a, arms[0], pull), (b, arms[1], -pull)):
                    push[k] += f
                    turning[k] += arm[0] * f[1] - arm[1] * f[0]
            force[self.bodies, 0], force[self.bodies, 2] = push.T
            force[self.bodies, 4] = -turning
            self.state.body_f.assign(force)
            begun = time.process_time()
            self.solver.step(self.state, self.next, self.control, None, self.setting.time_step)
            self.seconds += time.process_time() - begun
            self.state, self.next = self.next, self.state
            self.gap = max(self.gap, self.widest_gap())
            _ = self.angle

    def widest_gap(self) -> float:
        """Return the widest gap of any pin, in m."""
        place = self.state.body_q.numpy().astype(float)
        kinds = self.model.joint_type.numpy()
        ends = []
        for side in ("p", "c"):
            body = (self.model.joint_parent if side == "p" else self.model.joint_child).numpy()
            at = getattr(self.model, f"joint_X_{side}").numpy().astype(float)[:, :3]
            pose = np.where(body[:, None] < 0, [0.0, 0, 0, 0, 0, 0, 1], place[body])
            angle = -2.0 * np.arctan2(pose[:, 4], pose[:, 6])
            x = pose[:, 0] + np.cos(angle) * at[:, 0] - np.sin(angle) * at[:, 2]
            z = pose[:, 2] + np.sin(angle) * at[:, 0] + np.cos(angle) * at[:, 2]
            ends.append(np.stack([x, z], axis=1))
        pins = np.isin(kinds, [newton.JointType.REVOLUTE, newton.JointType.BALL])
        return float(np.linalg.norm(ends[0] - ends[1], axis=1)[pins].max())

    @property
    def energy(self) -> float:
        """Kinetic energy, energy of the weight and energy of the springs, in J."""
        angles, centres, spins, speeds = self.motion()
        mass, inertia = links.inertias(self.robot).T
        gravity = -float(self.model.gravity.numpy()[0, 2])
        total = 0.5 * mass @ (speeds**2).sum(axis=1) + 0.5 * inertia @ spins**2
        total += gravity * mass @ centres[:, 1]
        for a, on_a, b, on_b, spring in self._spring_ends():
            ends = [centres[k] + turned(angles[k], on) for k, on in ((a, on_a), (b, on_b))]
            stretch = float(np.hypot(*(ends[1] - ends[0]))) - spring.rest_length
            total += 0.5 * spring.stiffness * stretch**2
        return float(total)


def turned(angle: float, arm: Array) -> Array:
    """Return a vector turned counter-clockwise by an angle in rad."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]])


def follow(machine: Kamino, torque: float, duration: float, samples: int) -> list[float]:
    """Return the crank angle, the gap, the energy error and the CPU time of a motion.

    Args:
        machine: The mechanism in its initial state.
        torque: Torque on the crank, in N m.
        duration: Duration, in s.
        samples: Number of times at which the energy is measured.
    """
    start = machine.energy - torque * machine.angle
    drift = 0.0
    machine.advance(torque, machine.setting.time_step)  # compiles the kernels
    machine.seconds = 0.0
    for _ in range(samples):
        machine.advance(torque, duration / samples)
        drift = max(drift, abs(machine.energy - torque * machine.angle - start))
    return [machine.angle, machine.gap, drift, machine.seconds / duration]


def swing(setting: Setting) -> list[Any]:
    """Return the row of the swing; see :func:`closed_loops.swings`."""
    robot = swinging_robot()
    q, v = np.zeros(4), np.array([0.0, 0.0, 0.0, SWING_SPEED])
    plant = ProjectionPlant(robot, BELOW, 1e-4, fixed_chassis=True)
    exact = PlantMachine(plant, 0.0, SWING_SPEED)
    kinetic = exact.energy - PlantMachine(plant, 0.0, 0.0).energy
    exact = PlantMachine(plant, 0.0, SWING_SPEED)
    exact.advance(0.0, SWING_TIME + setting.time_step)
    machine = Kamino(robot, None, setting, GRAVITY, q, v)
    angle, gap, drift, seconds = follow(machine, 0.0, SWING_TIME, 40)
    return [SIMULATOR, setting.label, gap, drift / kinetic, abs(angle - exact.angle), seconds]


def squeeze(setting: Setting) -> list[Any]:
    """Return the row of the squeezer; see :func:`closed_loops.squeezes`."""
    q = np.array([0.0, 0.0, 0.0, SQUEEZER_START])
    machine = Kamino(squeezer(), None, setting, 0.0, q, np.zeros(4))
    duration = SQUEEZER_TIME - setting.time_step
    angle, gap, drift, seconds = follow(machine, SQUEEZER_TORQUE, duration, 1)
    work = SQUEEZER_TORQUE * (SQUEEZER_END - SQUEEZER_START)
    error = abs(angle - SQUEEZER_END)
    return [SIMULATOR, setting.label, gap, drift / work, error, seconds]


def walk(setting: Setting) -> list[Any]:
    """Return the row of the walk; see :func:`closed_loops.walks`.

    The slip is not measured, because the forces of the contacts are not read.
    """
    robot, ground = ROBOTS["paper"](), Terrain.flat(FRICTION)
    plant = ProjectionPlant(robot, ground)
    plant.reset(crank_angle=0.0)
    machine = Kamino(robot, ground, setting, GRAVITY, plant.state[:4], np.zeros(4))
    limit = robot.motor.torque_limit
    reference, integral, work = 0.0, np.zeros(()), 0.0
    first, last = round(SETTLE / CONTROL_DT), round((SETTLE + WALK_TIME) / CONTROL_DT)
    for k in range(last):
        angles, centres, spins, _ = machine.motion()
        if k == first:
            start = float(centres[CHASSIS, 0])
            machine.gap, machine.seconds, work = 0.0, 0.0, 0.0
        rate = float(spins[SHAFT] - spins[CHASSIS])
        before = machine.angle
        commanded, integral = PAPER_PID.torque(
            reference - before, CRANK_SPEED - rate, integral, CONTROL_DT, limit
        )
        torque = min(limit, max(-limit, float(commanded)))
        reference += CRANK_SPEED * CONTROL_DT
        machine.advance(torque, CONTROL_DT)
        work += abs(torque * (machine.angle - before))
        if k % 10 == 0:
            progress = k, angles[CHASSIS], centres[CHASSIS], machine.angle, machine.gap
            print(*progress, file=sys.stderr, flush=True)
        if not np.isfinite(centres).all() or abs(angles[CHASSIS]) > 1.2:
            return [SIMULATOR, setting.label, *[None] * 5]
    way = float(machine.motion()[1][CHASSIS, 0]) - start
    cost = work / (robot.mass * GRAVITY * abs(way))
    walked = CONTROL_DT * (last - first)
    seconds = machine.seconds / walked
    return [SIMULATOR, setting.label, machine.gap, way / walked, None, cost, seconds]


SETTINGS: dict[str, list[Setting]] = {
    "swing": [
        Setting("default (PADMM), 2.5 ms", 2.5e-3),
        Setting("DVI, 10 % of the gap, 1 ms", 1e-3, "dvi", 0.1),
    ],
    "squeezer": [
        Setting("default (PADMM), 0.1 ms", 1e-4),
        Setting("DVI, 10 % of the gap, 0.1 ms", 1e-4, "dvi", 0.1),
    ],
    "walk": [Setting("DVI, 10 % of the gap, 2.5 ms", 2.5e-3, "dvi", 0.1)],
}
"""Settings of each problem."""


def run() -> None:
    """Measure, and write the data."""
    problems = {"swing": swing, "squeezer": squeeze, "walk": walk}
    results: dict[str, list[list[Any]]] = {}
    for name, simulate in problems.items():
        results[name] = []
        for setting in SETTINGS[name]:
            results[name].append(simulate(setting))
            print(name, *results[name][-1], flush=True)
    (DOCS / NEWTON).parent.mkdir(parents=True, exist_ok=True)
    write_json(DOCS / NEWTON, results)


if __name__ == "__main__":
    wp.config.quiet = True
    run()
