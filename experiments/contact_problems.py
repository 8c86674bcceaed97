"""Reference problems with contact and friction: bodies on the ground, and the woodpecker toy.

A robot with one or two legs and a locked crank is a rigid body with round feet. The disc, the ball,
Painleve's rod and the rocking block are such robots. They test the contact law that every walking
robot uses. The woodpecker toy slides on a pole and has no crank, so it is not a robot. Its
equations are written out here, and the solver of the contact law computes its impulses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad

from jansen_env import Leg, Payload, Robot, Terrain
from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.reduced import body_sums, compile_robot, mass_matrix
from jansen_env.engine.contact_solver import COMPLIANCE, STICK, allocate_problem, regularise, solve
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.robot.kinematics import joint_positions

CRANK = 2.75  # angle of the locked crank, in rad


class Body(NamedTuple):
    """A robot with one leg and a locked crank: a rigid body with a round foot.

    Attributes:
        robot: The robot.
        toe: Centre of the foot in the chassis frame, in m, shape (2,).
        centre: Centre of mass in the chassis frame, in m, shape (2,).
    """

    robot: Robot
    toe: Array
    centre: Array


def rigid_body(radius: float, mass: float, inertia: float, height: float) -> Body:
    """Return a body whose payload gives it the requested mass and inertia.

    Args:
        radius: Radius of the foot, in m.
        mass: Mass, in kg.
        inertia: Moment of inertia about the centre of mass, in kg m^2.
        height: Height of the centre of mass above the centre of the foot, in m.
    """
    legs = (Leg("fore"),)
    bare = Robot(legs=legs, pad_radius=radius)
    toe = _toe(CRANK)
    centre = toe + np.array([0.0, height])
    load = mass - bare.mass
    x, y = (mass * centre - body_sums(compile_robot(bare), CRANK).c) / load
    pose = np.array([0.0, 0.0, 0.0, CRANK])
    loaded = Robot(legs=legs, pad_radius=radius, payload=Payload(load, 0.0, (float(x), float(y))))
    about_axis = float(mass_matrix(compile_robot(loaded), pose)[2, 2])
    missing = inertia - (about_axis - mass * float(centre @ centre))
    payload = Payload(load, missing, (float(x), float(y)))
    return Body(Robot(legs=legs, pad_radius=radius, payload=payload), toe, centre)


def release(
    body: Body,
    terrain: Terrain,
    time_step: float,
    *,
    tilt: float = 0.0,
    clearance: float = 0.0,
    speed: float = 0.0,
    spin: float = 0.0,
) -> ProjectionPlant:
    """Return a simulation of a body that is released above level ground.

    Args:
        body: The body.
        terrain: The ground.
        time_step: Time step, in s.
        tilt: Pitch of the body, in rad, positive anticlockwise.
        clearance: Height of the foot above the ground, in m.
        speed: Horizontal speed of the centre of mass, in m/s.
        spin: Pitch rate, in rad/s, positive anticlockwise.
    """
    plant = ProjectionPlant(body.robot, terrain, time_step)
    toe, arm = _turned(body.toe, tilt), _turned(body.centre, tilt)
    state = np.zeros(8)
    state[0], state[1] = -toe[0], body.robot.pad_radius + clearance - toe[1]
    state[2], state[3] = tilt, CRANK
    state[4], state[5], state[6] = speed + spin * arm[1], -spin * arm[0], spin
    plant.state = state
    plant.prescribed_crank_speed = True
    return plant


def centre_speed(body: Body, plant: ProjectionPlant) -> float:
    """Return the horizontal speed of the centre of mass, in m/s."""
    state = plant.state
    return float(state[4] - state[6] * _turned(body.centre, state[2])[1])


def _turned(place: Array, angle: float) -> Array:
    """Return a vector after a rotation by an angle, in rad."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos * place[0] - sin * place[1], sin * place[0] + cos * place[1]])


def _toe(psi: float) -> Array:
    """Return the position of the toe of the paper's fore leg, in m."""
    places: Array = joint_positions(Robot(), "fore", psi)[-1]
    return places


class Rolling(NamedTuple):
    """Result of a disc that slides and comes to roll.

    Attributes:
        time: Time until the disc rolls, in s.
        speed: Speed of the rolling disc, in m/s.
    """

    time: float
    speed: float


DISC_RADIUS = 0.2  # m
DISC_MASS = 100.0  # in kg; the disc is heavy, so that the leg changes little
DISC_FRICTION = 0.3
DISC_STEP = 1e-3  # s
DISCS = {  # initial speed (m/s) and spin (rad/s, positive anticlockwise)
    "thrown without spin": (1.0, 0.0),
    "thrown with back-spin": (0.3, 4.5),
    "set down with spin": (0.0, -5.0),
}


def disc() -> Body:
    """Return a solid disc, whose moment of inertia is m r^2 / 2."""
    inertia = 0.5 * DISC_MASS * DISC_RADIUS * DISC_RADIUS
    return rigid_body(DISC_RADIUS, DISC_MASS, inertia, 0.0)


def disc_closed_form(speed: float, spin: float) -> Rolling:
    """Return the closed form: friction mu m g acts until the point of contact is at rest.

    The angular momentum about a point of the ground is kept, so the final speed is two thirds of
    the initial speed minus a third of the initial ``spin`` times the radius.

    Args:
        speed: Initial speed v, in m/s.
        spin: Initial pitch rate, in rad/s, positive anticlockwise.
    """
    slip = abs(speed + DISC_RADIUS * spin)
    rolling = (2.0 * speed - DISC_RADIUS * spin) / 3.0
    return Rolling(slip / (3.0 * DISC_FRICTION * GRAVITY), rolling)


def roll_disc(speed: float, spin: float) -> Rolling:
    """Simulate a disc that is set down on level ground, until it rolls.

    Args:
        speed: Initial speed, in m/s.
        spin: Initial pitch rate, in rad/s, positive anticlockwise.
    """
    body = disc()
    plant = release(body, Terrain.flat(DISC_FRICTION), DISC_STEP, speed=speed, spin=spin)
    slips = [speed + DISC_RADIUS * spin]
    while abs(slips[-1]) > 1e-9:
        plant.step(0.0, DISC_STEP)
        slips.append(centre_speed(body, plant) + DISC_RADIUS * plant.state[6])
    # The slip falls linearly. It ends at this fraction of the last step.
    share = slips[-2] / (slips[-3] - slips[-2])
    return Rolling((len(slips) - 2 + share) * DISC_STEP, centre_speed(body, plant))


class Bouncing(NamedTuple):
    """Result of a bouncing ball.

    Attributes:
        height: Height of the third bounce, in m.
        rest: Time from the release to the last bounce, in s.
    """

    height: float
    rest: float


BALL_DROP = 0.1  # m
BALL_RESTITUTION = 0.8
BALL_STEP = 1e-5  # s


def bouncing_ball_closed_form() -> Bouncing:
    """Return the closed form of infinitely many bounces, whose heights fall by e^2 each."""
    fall = math.sqrt(2.0 * BALL_DROP / GRAVITY)
    rest = fall * (1.0 + BALL_RESTITUTION) / (1.0 - BALL_RESTITUTION)
    return Bouncing(BALL_DROP * BALL_RESTITUTION**6, rest)


def bounce_ball() -> Bouncing:
    """Simulate a ball that is dropped, until a little after the time of its last bounce."""
    body = disc()
    terrain = Terrain.flat(friction=0.0, restitution=BALL_RESTITUTION)
    plant = release(body, terrain, BALL_STEP, clearance=BALL_DROP)
    ground = plant.state[1] - BALL_DROP
    heights, rest = [], 0.0
    for k in range(math.ceil(1.05 * bouncing_ball_closed_form().rest / BALL_STEP)):
        falling = plant.state[5]
        plant.step(0.0, BALL_STEP)
        rising = plant.state[5]
        if rising > falling + 1e-9:
            rest = (k + 1) * BALL_STEP
            heights.append(float(plant.state[1] - ground + rising * rising / (2.0 * GRAVITY)))
    return Bouncing(heights[2], rest)


class Rod(NamedTuple):
    """Result of Painleve's rod.

    Attributes:
        friction: Least friction coefficient at which the rod cannot slide.
        spin: Angular speed of the rod after it has been stopped, in rad/s.
    """

    friction: float
    spin: float


ROD_HALF = 0.5  # half the length of the rod, in m
ROD_MASS = 20.0  # kg
ROD_TILT = math.atan(0.5)  # worst angle between the rod and the vertical, in rad
ROD_SPEED = 1.0  # speed at which the rod slides, in m/s
ROD_FOOT = 1e-8  # radius of the end of the rod, in m: nearly a point
ROD_STEP = 1e-7  # s


def rod_closed_form() -> Rod:
    """Return Painleve's threshold and the spin after the "impact without a collision".

    A uniform rod slides on one end, with the friction pressing this end into the ground. The
    balance of forces has a solution only if the friction coefficient is below W_nn / |W_nt|, whose
    smallest value over all tilts is 4/3 (P. Painleve, "Sur les lois du frottement de glissement",
    1895). Above it, an impulse stops the end, and the angular momentum about the end is kept.
    """
    return Rod(4.0 / 3.0, 0.75 * ROD_SPEED * math.cos(ROD_TILT) / ROD_HALF)


def slide_rod() -> Rod:
    """Find the least friction coefficient at which one time step stops the rod, by bisection."""
    body = rigid_body(ROD_FOOT, ROD_MASS, ROD_MASS * ROD_HALF * ROD_HALF / 3.0, ROD_HALF)

    def slide(friction: float) -> tuple[bool, float]:
        """Return whether the rod is stopped, and its angular speed in rad/s."""
        plant = release(body, Terrain.flat(friction), ROD_STEP, tilt=ROD_TILT, speed=ROD_SPEED)
        plant.step(0.0, ROD_STEP)
        height = _turned(body.centre - body.toe, plant.state[2])[1]
        spin = float(plant.state[6])
        return abs(centre_speed(body, plant) + height * spin) < 0.01 * ROD_SPEED, abs(spin)

    low, high = 1.0, 2.0
    while low < 0.5 * (low + high) < high:
        middle = 0.5 * (low + high)
        if slide(middle)[0]:
            high = middle
        else:
            low = middle
    return Rod(high, slide(2.0)[1])


class Rocking(NamedTuple):
    """Result of a rocking block.

    Attributes:
        period: Time from the release to the first impact, in s.
        ratio: Speed after the first impact divided by the speed before it.
    """

    period: float
    ratio: float


BLOCK_ANGLE = 0.02  # tilt at which the block is released, in rad
BLOCK_STEPS = 1e-4, 2e-5  # time steps, in s
PAD = 1e-5  # radius of the two feet, in m: nearly points


def block() -> Robot:
    """Return a robot with two feet that a locked crank makes a rigid block."""
    legs = Leg("fore"), Leg("back", math.pi - 2.0 * CRANK)  # mirror images at this angle
    return Robot(legs=legs, pad_radius=PAD, payload=Payload(3.0, 0.1, (0.0, 0.1)))


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
    sums = body_sums(compile_robot(robot), CRANK)
    centre = sums.c / robot.mass
    toe = _toe(CRANK)
    inertia = float(mass_matrix(compile_robot(robot), np.array([0.0, 0.0, 0.0, CRANK]))[2, 2])
    inertia -= robot.mass * float(centre @ centre)
    return robot.mass, inertia, abs(float(toe[0])), float(centre[1] - toe[1])


def rocking_block(time_step: float) -> Rocking:
    """Simulate a block that is released with a tilt, until it has struck the ground.

    Args:
        time_step: Time step of the projection backend, in s.
    """
    plant = ProjectionPlant(block(), Terrain.flat(friction=5.0), time_step)
    x, y = -abs(_toe(CRANK)[0]), _toe(CRANK)[1]  # foot about which it turns
    cos, sin = math.cos(BLOCK_ANGLE), math.sin(BLOCK_ANGLE)
    state = np.zeros(8)
    state[0], state[1] = -(cos * x - sin * y), PAD - (sin * x + cos * y)
    state[2], state[3] = BLOCK_ANGLE, CRANK
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


class Toy(NamedTuple):
    """Values of the woodpecker toy, a sleeve on a pole with a bird on a torsion spring.

    Source of the values and of the equations: R. I. Leine, C. Glocker and D. H. van Campen,
    "Nonlinear dynamics of the woodpecker toy" (ASME DETC 2001), which follows C. Glocker, "Dynamik
    von Starrkoerpersystemen mit Reibung und Stoessen" (1995).
    """

    sleeve_mass: float = 0.0003  # kg
    sleeve_inertia: float = 5e-9  # kg m^2
    bird_mass: float = 0.0045  # kg
    bird_inertia: float = 7e-7  # kg m^2
    stiffness: float = 0.0056  # stiffness of the torsion spring, in N m/rad
    pole_radius: float = 0.0025  # m
    hole_radius: float = 0.0031  # radius of the hole in the sleeve, in m
    sleeve_height: float = 0.0058  # half the height of the sleeve, in m
    spring_arm: float = 0.010  # distance from the sleeve to the spring, in m
    bird_arm: float = 0.015  # distance from the spring to the bird, in m
    beak_height: float = 0.020  # m
    beak_length: float = 0.0201  # m
    friction: float = 0.3
    restitution: tuple[float, float, float] = (0.5, 0.0, 0.0)  # beak, lower and upper edge


TOY_START = (0.0, -0.1036, -0.2788), (-0.3411, 0.0, -7.4583)  # published position and velocity
TOY_STEP = 2e-5  # s
TOY_PERIOD = 0.1452  # published period of the limit cycle, in s
TOY_EVENTS_PERIOD = 0.145976  # period by an event-driven solution (test_woodpecker.py), in s
TOY_JAM = 0.285  # published least friction at which the sleeve jams
# Position at 0.29998 s in the reference file of Siconos (examples/mechanics/Woodpecker), from the
# same start with the same time step.
TOY_SICONOS = -4.134818676833654e-02, -1.034684682717361e-01, -3.409339755504301e-01
TOY_TIME = 0.29998  # s
TOY_CYCLES = 6  # number of periods over which the period is averaged, after the first one


class Woodpecker:
    """The woodpecker toy, by the time-stepping scheme of Moreau and Jean with theta = 1/2.

    The coordinates are the height y of the sleeve (m), the angle of the sleeve and the angle of the
    bird (rad). The three contacts with the pole are those of the beak, of the lower edge and of the
    upper edge of the sleeve.

    Args:
        time_step: Time step, in s.
        toy: Values of the toy.

    Attributes:
        mass: Mass matrix, shape (3, 3).
        springs: Stiffness matrix, shape (3, 3).
        weight: Generalised force of gravity, shape (3,).
        jacobian: Normal and tangential directions of the contacts, in turn, shape (6, 3).
        gaps: Distances of the contacts from the pole where all angles are 0, in m, shape (3,).
        position: Coordinates, shape (3,).
        velocity: Their rates, shape (3,).
    """

    def __init__(self, time_step: float, toy: Toy | None = None) -> None:
        toy = toy or Toy()
        bird, arms = toy.bird_mass, np.array([1.0, toy.spring_arm, toy.bird_arm])
        self.mass = bird * np.outer(arms, arms)
        self.mass += np.diag([toy.sleeve_mass, toy.sleeve_inertia, toy.bird_inertia])
        c = toy.stiffness
        self.springs = np.array([[0.0, 0.0, 0.0], [0.0, c, -c], [0.0, -c, c]])
        self.weight = -GRAVITY * (bird * arms + np.array([toy.sleeve_mass, 0.0, 0.0]))
        self._step = time_step
        self._inverse = np.linalg.inv(self.mass + 0.25 * time_step * time_step * self.springs)
        hole, edge = toy.hole_radius, toy.sleeve_height
        self.jacobian = np.array(
            [
                [0.0, 0.0, -toy.beak_height],  # normal and tangential direction of the beak
                [1.0, toy.spring_arm, toy.bird_arm - toy.beak_length],
                [0.0, edge, 0.0],  # normal direction of the lower edge of the sleeve
                [1.0, hole, 0.0],
                [0.0, -edge, 0.0],  # normal direction of the upper edge of the sleeve
                [1.0, hole, 0.0],
            ]
        )
        beak = toy.spring_arm + toy.bird_arm - toy.beak_length - toy.pole_radius
        play = hole - toy.pole_radius
        self.gaps = np.array([beak, play, play])
        self._friction, self._restitution = toy.friction, np.array(toy.restitution)
        self._law = allocate_problem(3)
        self.position, self.velocity = (np.array(start) for start in TOY_START)

    def step(self) -> None:
        """Advance the toy by a time step."""
        h = self._step
        middle = self.position + 0.5 * h * self.velocity
        forces = self.weight - self.springs @ middle
        after = self.velocity + h * (self._inverse @ forces)
        closed = np.flatnonzero(self.gaps + self.jacobian[0::2] @ middle <= 0.0)
        if len(closed):
            J = self.jacobian[np.stack([2 * closed, 2 * closed + 1], axis=1).ravel()]
            v_free = J @ after
            v_free[0::2] += self._restitution[closed] * (J[0::2] @ self.velocity)
            after += self._inverse @ J.T @ self._impulses(J, v_free)
        self.position = middle + 0.5 * h * after
        self.velocity = after

    def _impulses(self, J: Array, v_free: Array) -> Array:
        """Return the impulses of closed contacts, by the contact law of the package."""
        count, law = len(J) // 2, self._law
        W = J @ self._inverse @ J.T
        regularise(count, W, COMPLIANCE)
        P = np.zeros(2 * count)
        law.mode[:] = STICK
        law.factored[:] = 0
        mu = np.full(count, self._friction)
        solve(count, law._replace(W=W, v_free=v_free, mu=mu, P=P, u=np.zeros(2 * count)))
        return P

    def jams(self) -> bool:
        """Return whether the sleeve jams at rest, with the bird hanging backwards."""
        sleeve = -self.gaps[1] / self.jacobian[2, 1]
        sag = self.weight[2] / self.springs[2, 2]
        self.position = np.array([0.0, sleeve, sleeve + sag])
        self.velocity = np.zeros(3)
        self.step()
        return bool(abs(self.velocity[0]) < 1e-9)


class Pecking(NamedTuple):
    """Result of the woodpecker toy.

    Attributes:
        position: Coordinates after :data:`TOY_TIME`.
        period: Mean period of the limit cycle, in s.
    """

    position: tuple[float, float, float]
    period: float


def woodpecker(cycles: int = TOY_CYCLES) -> Pecking:
    """Simulate the toy from the published start.

    Args:
        cycles: Number of periods over which the period is averaged, after the first one.
    """
    toy = Woodpecker(TOY_STEP)
    returns: list[float] = []
    position = toy.position
    steps = 0
    while steps * TOY_STEP < TOY_TIME or len(returns) <= cycles:
        swing = toy.velocity[2]
        toy.step()
        steps += 1
        if steps == round(TOY_TIME / TOY_STEP):
            position = toy.position
        # The bird turns back where it hangs farthest backwards.
        if swing <= 0.0 < toy.velocity[2] and toy.position[2] < -0.4:
            share = -swing / (toy.velocity[2] - swing)
            returns.append((steps - 1 + share) * TOY_STEP)
    y, sleeve, bird = position.tolist()
    return Pecking((y, sleeve, bird), (returns[-1] - returns[0]) / (len(returns) - 1))


def least_jam_friction() -> float:
    """Return the least friction coefficient at which the sleeve jams, by bisection."""
    low, high = 0.1, 0.5
    while low < 0.5 * (low + high) < high:
        middle = 0.5 * (low + high)
        if Woodpecker(TOY_STEP, Toy(friction=middle)).jams():
            high = middle
        else:
            low = middle
    return high
