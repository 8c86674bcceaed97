"""How exactly does the package solve published problems of multibody dynamics?

Run the experiment as follows. The default folder is docs/reference_problems.

    python experiments/reference_problems.py [WINDOWS] [FOLDER]

The script solves problems from the IFToMM library of multibody benchmarks and problems with
contact, which are in ``contact_problems.py``. It prints a table and writes ``results.json``. The
page docs/reference_problems.md contains the table. The script also writes ``A03.txt`` and
``A02.txt``, which can be submitted to the library. WINDOWS is the number of windows of the larger
N-four-bar mechanism, 40 by default. The run takes about a minute on two cores.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from contact_problems import (
    BLOCK_STEPS,
    DISCS,
    TOY_EVENTS_PERIOD,
    TOY_JAM,
    TOY_PERIOD,
    TOY_SICONOS,
    bounce_ball,
    bouncing_ball_closed_form,
    disc_closed_form,
    least_jam_friction,
    rocking_block,
    rocking_block_closed_form,
    rod_closed_form,
    roll_disc,
    slide_rod,
    woodpecker,
)
from scipy.integrate import solve_ivp

from jansen_env import Leg, Robot
from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.projection import (
    orthogonal_complement,
    orthogonal_complement_rate,
    project,
)
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.dynamics.spring_forces import spring_lengths
from jansen_env.files import write_json, write_text
from jansen_env.robot import Dyad, Linkage, Plate, Spring
from jansen_env.robot.kinematics import coordinates

Solution = TypeVar("Solution")

# IFToMM A03, Andrews' squeezing mechanism, in SI units. Source: F. Mazzia and C. Magherini, "Test
# Set for Initial Value Problem Solvers", release 2.4 (2008), problem ANDREWS, which follows W.
# Schiehlen (ed.), "Multibody Systems Handbook" (1990).
SQUEEZER_TIME = 0.03  # s
SQUEEZER_TORQUE = 0.033  # torque on K1, in N m
SQUEEZER_START = -0.0617138900142764496358948458001  # angle beta of K1
SQUEEZER_END = 15.81077119629904  # angle beta at SQUEEZER_TIME
SQUEEZER_SPEED = 1139.920302151208  # rate of beta at SQUEEZER_TIME
SQUEEZER_CRANK = 0.007  # length of K1, in m

# IFToMM A02, the N-four-bar mechanism: N windows of uniform bars of 1 m and 1 kg.
# https://www.iftomm-multibody.org/benchmark/problem/N_four-bar_mechanism
FOUR_BAR_TIME = 10.0  # s
FOUR_BAR_SPEED = -1.0  # initial rate of the upright cranks, in rad/s
FOUR_BAR_END = 0.3284581115, 0.9445185382  # end of the first crank of two windows at 10 s, in m

# Times of the files for the library, in s. The library simulates A03 for longer than the source of
# its reference solution. The times of SQUEEZER_END and FOUR_BAR_END are among them.
SUBMITTED_TIMES = {"A03": np.linspace(0.0, 0.05, 501), "A02": np.linspace(0.0, 10.0, 1001)}


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
            _link(
                (0.0, 0.0),
                (SQUEEZER_CRANK, 0.0),
                centre=(0.00092, 0.0),
                mass=0.04325,
                inertia=2.194e-6,
            ),
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
        times: Times, in s.
        angles: Angle at each time, in rad.
        speeds: Its rate at each time, in rad/s.
        energy_errors: Energy that has appeared since the beginning, at each time, in J.
        seconds: CPU time of the simulation, in s.
    """

    times: Array
    angles: Array
    speeds: Array
    energy_errors: Array
    seconds: float

    @property
    def angle(self) -> float:
        """Angle at the end, in rad."""
        return float(self.angles[-1])

    @property
    def speed(self) -> float:
        """Rate of the angle at the end, in rad/s."""
        return float(self.speeds[-1])

    @property
    def drift(self) -> float:
        """Largest energy that appeared or disappeared, in J."""
        return float(np.abs(self.energy_errors).max())


def _integrate(
    acceleration: Callable[[float, float], float],
    energy: Callable[[float, float], float],
    start: tuple[float, float],
    duration: float,
    tolerance: float,
    times: Array | None = None,
) -> Motion:
    """Integrate the motion of one angle by the method DOP853.

    Args:
        acceleration: Function of the angle and its rate.
        energy: Energy without the work that is put in, a function of the angle and its rate.
        start: Angle and rate at the beginning.
        duration: Duration, in s, if ``times`` is None.
        tolerance: Relative tolerance of a time step; the absolute tolerance is a hundredth of it.
        times: Times of the result, in s; None for the time steps of the method.
    """
    begun = time.process_time()
    solved = solve_ivp(
        lambda _, state: (state[1], acceleration(*state)),
        (0.0, duration if times is None else times[-1]),
        start,
        method="DOP853",
        t_eval=times,
        rtol=tolerance,
        atol=0.01 * tolerance,
    )
    seconds = time.process_time() - begun
    energies = np.array([energy(*state) for state in solved.y.T])
    angles, speeds = solved.y
    return Motion(solved.t, angles, speeds, energies - energies[0], seconds)


def squeezer_by_tables(tolerance: float = 1e-13, times: Array | None = None) -> Motion:
    """Simulate the squeezer by the reduced equation k beta'' + k' beta'^2 / 2 + V' = torque.

    Args:
        tolerance: Relative tolerance of a time step.
        times: Times of the result, in s; None for the time steps until :data:`SQUEEZER_TIME`.
    """
    tables = compile_robot(squeezer())

    def acceleration(angle: float, speed: float) -> float:
        sums = body_sums(tables, angle)
        return float((SQUEEZER_TORQUE - sums.dV - 0.5 * sums.dk * speed * speed) / sums.k)

    def energy(angle: float, speed: float) -> float:
        sums = body_sums(tables, angle)
        return float(0.5 * sums.k * speed * speed + sums.V - SQUEEZER_TORQUE * angle)

    start = SQUEEZER_START, 0.0
    return _integrate(acceleration, energy, start, SQUEEZER_TIME, tolerance, times)


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

    start = SQUEEZER_START, 0.0
    return _integrate(acceleration, energy, start, SQUEEZER_TIME, tolerance)


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

    def solve(self, tolerance: float = 1e-11, times: Array | None = None) -> Motion:
        """Simulate the motion from upright cranks that turn at :data:`FOUR_BAR_SPEED`.

        Args:
            tolerance: Relative tolerance of a time step.
            times: Times of the result, in s; None for the time steps until :data:`FOUR_BAR_TIME`.
        """
        start = 0.5 * math.pi, FOUR_BAR_SPEED
        return _integrate(self.acceleration, self.energy, start, FOUR_BAR_TIME, tolerance, times)


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


def measure_mechanisms(windows: int) -> list[Row]:
    """Solve the problems without contact.

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
    return rows


def solve_submissions() -> dict[str, Motion]:
    """Solve the problems of the library at the times of the files that can be submitted."""
    return {
        "A03": squeezer_by_tables(times=SUBMITTED_TIMES["A03"]),
        "A02": FourBars(2).solve(tolerance=1e-13, times=SUBMITTED_TIMES["A02"]),
    }


def measure_submissions(motions: dict[str, Motion]) -> list[Row]:
    """Return the accuracy and the CPU time that the library asks for."""
    names = {"A03": "A03 squeezer, submission", "A02": "A02 four-bar, submission"}
    return [
        Row(names[problem], "largest energy error, J", 0.0, motion.drift, motion.seconds)
        for problem, motion in motions.items()
    ]


def submission(problem: str, motion: Motion) -> str:
    """Return the content of a file that can be submitted to the library.

    The library compares the position of one point in both problems: the end of the first crank.
    """
    point, length = {"A03": ("F", SQUEEZER_CRANK), "A02": ("B0", 1.0)}[problem]
    header = f"% time_s {point}_x_m {point}_y_m crank_angle_rad crank_speed_rad/s energy_error_J"
    lines = [header]
    for moment, angle, speed, energy_error in zip(
        motion.times, motion.angles, motion.speeds, motion.energy_errors, strict=True
    ):
        x = length * math.cos(angle)
        y = length * math.sin(angle)
        values = " ".join(f"{value:.14e}" for value in (x, y, angle, speed))
        lines.append(f"{moment:.4f} {values} {energy_error:.2e}")
    return "\n".join(lines) + "\n"


def measure_contacts() -> list[Row]:
    """Solve the problems with contact."""
    rows = []
    for name, start in DISCS.items():
        exact_roll = disc_closed_form(*start)
        rolling, seconds = _timed(partial(roll_disc, *start))
        rows += [
            Row(f"disc, {name}", "time until it rolls, s", exact_roll.time, rolling.time, seconds),
            Row(
                f"disc, {name}",
                "speed when it rolls, m/s",
                exact_roll.speed,
                rolling.speed,
                seconds,
            ),
        ]
    exact_ball = bouncing_ball_closed_form()
    ball, seconds = _timed(bounce_ball)
    rows += [
        Row(
            "bouncing ball",
            "height of the third bounce, m",
            exact_ball.height,
            ball.height,
            seconds,
        ),
        Row("bouncing ball", "time of the last bounce, s", exact_ball.rest, ball.rest, seconds),
    ]
    exact_rod = rod_closed_form()
    rod, seconds = _timed(slide_rod)
    rows += [
        Row(
            "Painlevé's rod", "friction without sliding", exact_rod.friction, rod.friction, seconds
        ),
        Row("Painlevé's rod", "spin after the stop, rad/s", exact_rod.spin, rod.spin, seconds),
    ]
    exact_block = rocking_block_closed_form()
    for step in BLOCK_STEPS:
        block, seconds = _timed(partial(rocking_block, step))
        name = f"rocking block, step {1e3 * step:g} ms"
        rows += [
            Row(name, "time until the first impact, s", exact_block.period, block.period, seconds),
            Row(name, "speed after / before the impact", exact_block.ratio, block.ratio, seconds),
        ]
    toy, seconds = _timed(woodpecker)
    quantities = "height, m", "sleeve angle, rad", "bird angle, rad"
    for quantity, published, ours in zip(quantities, TOY_SICONOS, toy.position, strict=True):
        rows.append(Row("woodpecker toy", f"{quantity}, at 0.29998 s", published, ours, seconds))
    rows += [
        Row("woodpecker toy", "period, published, s", TOY_PERIOD, toy.period, seconds),
        Row("woodpecker toy", "period, event-driven, s", TOY_EVENTS_PERIOD, toy.period, seconds),
    ]
    jam, seconds = _timed(least_jam_friction)
    rows.append(Row("woodpecker toy", "least friction that jams", TOY_JAM, jam, seconds))
    return rows


def _timed(solve: Callable[[], Solution]) -> tuple[Solution, float]:
    """Return the solution of a problem and the CPU time, in s."""
    begun = time.process_time()
    solution = solve()
    return solution, time.process_time() - begun


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
    """Solve all problems, print the table, and write the data and the files for the library."""
    windows = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    folder = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/reference_problems")
    folder.mkdir(parents=True, exist_ok=True)
    motions = solve_submissions()
    rows = measure_mechanisms(windows) + measure_submissions(motions) + measure_contacts()
    print(table(rows))
    write_json(folder / "results.json", [row._asdict() for row in rows])
    for problem, motion in motions.items():
        write_text(folder / f"{problem}.txt", submission(problem, motion))


if __name__ == "__main__":
    main()
