"""How exactly does the package solve published problems of multibody dynamics?

Run the experiment as follows. The default folder is docs/reference_problems.

    python -m experiments.reference_problems [WINDOWS] [FOLDER]

The script solves problems from the IFToMM library of multibody benchmarks and a rocking block. It
prints a table and writes ``results.json``. The page docs/reference_problems.md contains the table.
WINDOWS is the number of windows of the larger N-four-bar mechanism, 40 by default. The run takes
about a minute on two cores.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import quad, solve_ivp

from jansen_env import Leg, Payload, Robot, Terrain
from jansen_env.arrays import Array
from jansen_env.dynamics.projection import (
    orthogonal_complement,
    orthogonal_complement_rate,
    project,
)
from jansen_env.dynamics.reduced import body_sums, compile_robot, mass_matrix
from jansen_env.dynamics.spring_forces import spring_lengths
from jansen_env.files import write_json
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.robot import Dyad, Linkage, Plate, Spring
from jansen_env.robot.kinematics import coordinates, joint_positions

# IFToMM A03, Andrews' squeezing mechanism, in SI units. Source: F. Mazzia and C. Magherini, "Test
# Set for Initial Value Problem Solvers", release 2.4 (2008), problem ANDREWS, which follows W.
# Schiehlen (ed.), "Multibody Systems Handbook" (1990).
SQUEEZER_TIME = 0.03  # s
SQUEEZER_TORQUE = 0.033  # N m, on K1
SQUEEZER_START = -0.0617138900142764496358948458001  # angle beta of K1
SQUEEZER_END = 15.81077119629904  # angle beta at SQUEEZER_TIME
SQUEEZER_SPEED = 1139.920302151208  # rate of beta at SQUEEZER_TIME

# IFToMM A02, the N-four-bar mechanism: N windows of uniform bars of 1 m and 1 kg.
# https://www.iftomm-multibody.org/benchmark/problem/N_four-bar_mechanism
GRAVITY = 9.81  # m/s^2
FOUR_BAR_TIME = 10.0  # s
FOUR_BAR_SPEED = -1.0  # initial rate of the upright cranks, rad/s
FOUR_BAR_END = 0.3284581115, 0.9445185382  # end of the first crank of two windows at 10 s, m


def squeezer() -> Robot:
    """Return Andrews' squeezing mechanism as a robot with one leg, in weightlessness.

    The crank K1 moves the rod K2. The end P of the rod carries the triangle K3 with the spring, and
    two pairs of links that end at the pivot A: K4 and K5, and K6 and K7. The crank angle is called
    beta in the source.
    """
    linkage = Linkage(
        bodies=(
            ("frame", "OABC"),
            ("K1", "OQ"),
            ("K2", "QP"),
            ("K3", "BPD"),
            ("K4", "PE"),
            ("K5", "AE"),
            ("K6", "PH"),
            ("K7", "AH"),
        ),
        dyads=(Dyad("P", "Q", "B", 1), Dyad("E", "P", "A", -1), Dyad("H", "P", "A", 1)),
        toes="D",
    )
    frame = ((0.0, 0.0), (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072))
    return Robot(
        linkage=linkage,
        bodies=(
            Plate(frame, mass=1.0, inertia=1.0),  # at rest
            _link((0.0, 0.0), (0.007, 0.0), centre=(0.00092, 0.0), mass=0.04325, inertia=2.194e-6),
            _link((0.0, 0.0), (0.028, 0.0), centre=(0.0115, 0.0), mass=0.00365, inertia=4.41e-7),
            _link(
                (0.0, 0.0),
                (0.0, -0.035),
                (0.02, -0.018),
                centre=(0.01043, -0.01874),
                mass=0.02373,
                inertia=5.255e-6,
            ),
            _link((0.0, 0.0), (0.02, 0.0), centre=(0.01421, 0.0), mass=0.00706, inertia=5.667e-7),
            _link(
                (0.0, 0.0), (0.04, 0.0), centre=(0.02308, 0.00916), mass=0.0705, inertia=1.169e-5
            ),
            _link((0.0, 0.0), (0.02, 0.0), centre=(0.01421, 0.0), mass=0.00706, inertia=5.667e-7),
            _link(
                (0.0, 0.0), (0.0, -0.04), centre=(0.00449, -0.01228), mass=0.05498, inertia=1.912e-5
            ),
        ),
        frame_angle=0.0,
        damping=(0.0,) * 10,
        bearing_friction=(0.0,) * 10,
        legs=(Leg("fore"),),
        springs=(Spring("D", "C", stiffness=4530.0, rest_length=0.07785),),
    )


def _link(
    *joints: tuple[float, float], centre: tuple[float, float], mass: float, inertia: float
) -> Plate:
    """Return a link from its joints and its centre of mass in any axes, in m, kg and kg m^2."""
    return Plate(tuple((x - centre[0], y - centre[1]) for x, y in joints), mass, inertia)


class Motion(NamedTuple):
    """Result of a simulation.

    Attributes:
        angle: Angle at the end, in rad.
        speed: Its rate, in rad/s.
        drift: Largest energy that appeared or disappeared, in J.
        evaluations: Number of evaluations of the acceleration.
        seconds: CPU time of the simulation, in s.
    """

    angle: float
    speed: float
    drift: float
    evaluations: int
    seconds: float


def _integrate(
    acceleration: Callable[[float, float], float],
    energy: Callable[[float, float], float],
    start: tuple[float, float],
    duration: float,
    tolerance: float,
) -> Motion:
    """Integrate the motion of one angle by the method DOP853.

    Args:
        acceleration: Function of the angle and its rate.
        energy: Energy without the work that is put in, a function of the angle and its rate.
        start: Angle and rate at the beginning.
        duration: Duration, in s.
        tolerance: Relative tolerance of a time step; the absolute tolerance is a hundredth of it.
    """
    begun = time.process_time()
    solved = solve_ivp(
        lambda _, state: (state[1], acceleration(*state)),
        (0.0, duration),
        start,
        method="DOP853",
        rtol=tolerance,
        atol=0.01 * tolerance,
    )
    seconds = time.process_time() - begun
    energies = np.array([energy(*state) for state in solved.y.T])
    drift = float(np.abs(energies - energies[0]).max())
    angle, speed = solved.y[:, -1].tolist()
    return Motion(angle, speed, drift, solved.nfev, seconds)


def squeezer_by_tables(tolerance: float = 1e-13) -> Motion:
    """Simulate the squeezer by the reduced equation k beta'' + k' beta'^2 / 2 + V' = torque."""
    tables = compile_robot(squeezer())

    def acceleration(angle: float, speed: float) -> float:
        sums = body_sums(tables, angle)
        return float((SQUEEZER_TORQUE - sums.dV - 0.5 * sums.dk * speed * speed) / sums.k)

    def energy(angle: float, speed: float) -> float:
        sums = body_sums(tables, angle)
        return float(0.5 * sums.k * speed * speed + sums.V - SQUEEZER_TORQUE * angle)

    return _integrate(acceleration, energy, (SQUEEZER_START, 0.0), SQUEEZER_TIME, tolerance)


def squeezer_by_projection(tolerance: float = 1e-13) -> Motion:
    """Simulate the squeezer by the projection method: M, C, D and D_dot of all eight bodies."""
    robot = squeezer()

    def projection(angle: float, speed: float) -> Any:
        q, q_dot = np.array([0.0, 0.0, 0.0, angle]), np.array([0.0, 0.0, 0.0, speed])
        return project(robot, q, q_dot, SQUEEZER_TORQUE, fixed_base=True, gravity=0.0)

    def acceleration(angle: float, speed: float) -> float:
        return float(projection(angle, speed).acceleration()[0])

    def energy(angle: float, speed: float) -> float:
        spring = robot.springs[0]
        assert isinstance(spring, Spring)
        stretch = spring_lengths(robot, "fore", coordinates(robot, "fore", angle))[0]
        stretch -= spring.rest_length
        mass = float(projection(angle, speed).mass[0, 0])
        stored = 0.5 * spring.stiffness * stretch * stretch
        return float(0.5 * mass * speed * speed + stored - SQUEEZER_TORQUE * angle)

    return _integrate(acceleration, energy, (SQUEEZER_START, 0.0), SQUEEZER_TIME, tolerance)


class FourBars:
    """The N-four-bar mechanism in absolute coordinates, solved by the projection method.

    The coordinates are the angle and the centre of mass (x, y) of each of the 2 N + 1 bars: first
    of the cranks, which are pinned to the ground, and then of the couplers between their ends.
    Where all bars are in line, the constraint matrix C loses N ranks.

    Args:
        windows: Number N of windows.
    """

    def __init__(self, windows: int) -> None:
        self.windows = windows
        self.cranks = range(windows + 1)
        self.couplers = range(windows + 1, 2 * windows + 1)
        bodies = 2 * windows + 1
        self._masses = np.tile([1.0 / 12.0, 1.0, 1.0], bodies)
        self._weights = np.tile([0.0, 0.0, -GRAVITY], bodies)
        foot, tip = -0.5, 0.5  # ends of a bar, from its centre of mass, in m
        pins: list[tuple[tuple[int, float], ...]] = [((k, foot),) for k in self.cranks]
        pins += [((c, foot), (k, tip)) for k, c in enumerate(self.couplers)]
        pins += [((c, tip), (k + 1, tip)) for k, c in enumerate(self.couplers)]
        self._constant = np.zeros((2 * len(pins), 3 * bodies))
        terms = []
        for row, pin in enumerate(pins):
            for (body, along), sign in zip(pin, (1.0, -1.0), strict=False):
                place = slice(2 * row, 2 * row + 2), slice(3 * body + 1, 3 * body + 3)
                self._constant[place] = sign * np.eye(2)
                terms.append((2 * row, 3 * body, sign * along))
        row, column, arm = np.array(terms).T
        self._row, self._column, self._arm = row.astype(int), column.astype(int), arm

    def positions(self, angle: float) -> Array:
        """Return the coordinates of all bars at a crank angle: all windows stay parallelograms."""
        x = np.zeros((2 * self.windows + 1, 3))
        cos, sin = math.cos(angle), math.sin(angle)
        cranks, couplers = x[: self.windows + 1], x[self.windows + 1 :]
        cranks[:] = angle, 0.5 * cos, 0.5 * sin
        cranks[:, 1] += self.cranks
        couplers[:] = 0.0, cos + 0.5, sin
        couplers[:, 1] += range(self.windows)
        return x.ravel()

    def acceleration(self, angle: float, speed: float) -> float:
        """Return the acceleration of the crank angle, equations (5) to (12) of the paper."""
        x = self.positions(angle)
        turned = x[self._column]
        C = self._constant.copy()
        C[self._row, self._column] = -self._arm * np.sin(turned)
        C[self._row + 1, self._column] = self._arm * np.cos(turned)
        D = orthogonal_complement(C, 1)
        rate = (D[:, 0] * speed)[self._column]
        C_dot = np.zeros_like(C)
        C_dot[self._row, self._column] = -self._arm * np.cos(turned) * rate
        C_dot[self._row + 1, self._column] = -self._arm * np.sin(turned) * rate
        D_dot = orthogonal_complement_rate(C, C_dot, D)
        mass = D[:, 0] @ (self._masses * D[:, 0])
        return float(D[:, 0] @ (self._weights - self._masses * D_dot[:, 0] * speed) / mass)

    def energy(self, angle: float, speed: float) -> float:
        """Return the kinetic and potential energy, in J."""
        n = self.windows
        inertia = (n + 1) / 3.0 + n  # of the cranks about their pins, and of the couplers
        height = (0.5 * (n + 1) + n) * math.sin(angle)
        return 0.5 * inertia * speed * speed + GRAVITY * height

    def solve(self, tolerance: float = 1e-11) -> Motion:
        """Simulate ten seconds from upright cranks that turn at :data:`FOUR_BAR_SPEED`."""
        start = 0.5 * math.pi, FOUR_BAR_SPEED
        return _integrate(self.acceleration, self.energy, start, FOUR_BAR_TIME, tolerance)


class Rocking(NamedTuple):
    """Result of a rocking block.

    Attributes:
        period: Time from the release to the first impact, in s.
        ratio: Speed after the first impact divided by the speed before it.
    """

    period: float
    ratio: float


BLOCK_ANGLE = 0.02  # tilt at which the block is released, rad
BLOCK_CRANK = 2.75  # angle of the locked crank, rad
BLOCK_STEPS = 1e-4, 2e-5  # time steps, s
PAD = 1e-5  # radius of its two feet, m: nearly points


def block() -> Robot:
    """Return a robot with two feet that a locked crank makes a rigid block."""
    legs = Leg("fore"), Leg("back", math.pi - 2.0 * BLOCK_CRANK)  # mirror images at this angle
    return Robot(legs=legs, pad_radius=PAD, payload=Payload(3.0, 0.1, (0.0, 0.1)))


def _toe(psi: float) -> Array:
    """Return the position of the toe of the paper's fore leg, in m."""
    places: Array = joint_positions(Robot(), "fore", psi)[-1]
    return places


def rocking_block_closed_form() -> Rocking:
    """Return Housner's closed form, as in "The behavior of inverted pendulum structures" (1963).

    A block with the distance b of each foot from the middle and the height h of the centre of mass
    turns about one foot. At the impact, the angular momentum about the other foot is kept.
    """
    m, inertia, b, h = _block_inertia()
    about_foot = inertia + m * (b * b + h * h)

    def speed(angle: float) -> float:
        fallen = _rise(BLOCK_ANGLE, b, h) - _rise(angle, b, h)
        return math.sqrt(2.0 * m * GRAVITY * fallen / about_foot)

    # With angle = start (1 - s^2), the integrand is finite at the release.
    period, _ = quad(
        lambda s: 2.0 * BLOCK_ANGLE * s / speed(BLOCK_ANGLE * (1.0 - s * s)) if s > 0.0 else 0.0,
        0.0,
        1.0,
        epsabs=1e-12,
    )
    return Rocking(period, (inertia + m * (h * h - b * b)) / about_foot)


def _rise(angle: float, b: float, h: float) -> float:
    """Return the height of the centre of mass of a block that is tilted by an angle, in m."""
    return b * math.sin(angle) + h * math.cos(angle)


def _block_inertia() -> tuple[float, float, float, float]:
    """Return mass, inertia, half the width and the height of the centre of mass of the block."""
    robot = block()
    sums = body_sums(compile_robot(robot), BLOCK_CRANK)
    centre = sums.c / robot.mass
    toe = _toe(BLOCK_CRANK)
    inertia = float(mass_matrix(compile_robot(robot), np.array([0.0, 0.0, 0.0, BLOCK_CRANK]))[2, 2])
    inertia -= robot.mass * float(centre @ centre)
    return robot.mass, inertia, abs(float(toe[0])), float(centre[1] - toe[1])


def rocking_block(time_step: float) -> Rocking:
    """Simulate a block that is released with a tilt, until it has struck the ground.

    Args:
        time_step: Time step of the projection backend, in s.
    """
    plant = ProjectionPlant(block(), Terrain.flat(friction=5.0), time_step)
    x, y = -abs(_toe(BLOCK_CRANK)[0]), _toe(BLOCK_CRANK)[1]  # foot about which it turns
    cos, sin = math.cos(BLOCK_ANGLE), math.sin(BLOCK_ANGLE)
    state = np.zeros(8)
    state[0], state[1] = -(cos * x - sin * y), PAD - (sin * x + cos * y)
    state[2], state[3] = BLOCK_ANGLE, BLOCK_CRANK
    plant.state = state
    plant.prescribed_crank_speed = True
    elapsed = 0.0
    while True:
        before = plant.state
        plant.step(0.0, time_step)
        elapsed += time_step
        struck = plant.state
        if struck[6] > before[6]:  # the impact slows the block down
            break
    # Before the impact, the block reaches the level position at this fraction of the last step.
    share = min(1.0, max(0.0, -before[2] / (before[6] * time_step)))
    return Rocking(elapsed + (share - 1.0) * time_step, float(struck[6] / before[6]))


class Row(NamedTuple):
    """Line of the table.

    Attributes:
        problem: Problem and method.
        quantity: Quantity that is compared, with its unit.
        published: Published value, or the value of a closed form.
        ours: Value of this package.
        seconds: CPU time of the solution, in s.
    """

    problem: str
    quantity: str
    published: float
    ours: float
    seconds: float


def measure(windows: int) -> list[Row]:
    """Solve all problems.

    Args:
        windows: Number of windows of the larger N-four-bar mechanism.
    """
    rows = []
    methods = {"tables": squeezer_by_tables, "projection": squeezer_by_projection}
    for method, solve in methods.items():
        motion = solve()
        name = f"A03 squeezer, {method}"
        rows += [
            Row(name, "crank angle at 0.03 s, rad", SQUEEZER_END, motion.angle, motion.seconds),
            Row(name, "crank speed at 0.03 s, rad/s", SQUEEZER_SPEED, motion.speed, motion.seconds),
            Row(name, "largest energy error, J", 0.0, motion.drift, motion.seconds),
        ]
    for count in (2, windows):
        motion = FourBars(count).solve()
        name = f"A02 four-bar, {count} windows"
        if count == 2:  # the only number of windows with a published end
            ends = math.cos(motion.angle), math.sin(motion.angle)
            for axis, published, ours in zip("xy", FOUR_BAR_END, ends, strict=True):
                quantity = f"end of the first crank at 10 s, {axis}, m"
                rows.append(Row(name, quantity, published, ours, motion.seconds))
        rows.append(Row(name, "largest energy error, J", 0.0, motion.drift, motion.seconds))
    exact = rocking_block_closed_form()
    for step in BLOCK_STEPS:
        begun = time.process_time()
        block_motion = rocking_block(step)
        seconds = time.process_time() - begun
        name = f"rocking block, step {1e3 * step:g} ms"
        rows += [
            Row(name, "time until the first impact, s", exact.period, block_motion.period, seconds),
            Row(name, "speed after / before the impact", exact.ratio, block_motion.ratio, seconds),
        ]
    return rows


def table(rows: list[Row]) -> str:
    """Return the table of the page."""
    lines = [
        "| problem | quantity | reference | ours | error | CPU time, s |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        error = abs(row.ours - row.published)
        values = (
            f"{row.published:.13g}",
            f"{row.ours:.13g}" if row.published else f"{row.ours:.1e}",
            f"{error:.1e}",
            f"{row.seconds:.2g}",
        )
        lines.append("| " + " | ".join((row.problem, row.quantity, *values)) + " |")
    return "\n".join(lines)


def main() -> None:
    """Solve all problems, print the table and write the data."""
    windows = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    folder = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/reference_problems")
    folder.mkdir(parents=True, exist_ok=True)
    rows = measure(windows)
    print(table(rows))
    write_json(folder / "results.json", [row._asdict() for row in rows])


if __name__ == "__main__":
    main()
