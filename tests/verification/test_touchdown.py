"""Touchdown: Newton's restitution, bounce heights, and several toes that strike at once.

``level(n)`` have n toes level at crank angle ``PSI``: two crank angles give one toe height, and
back legs mirror fore legs. Three and four carry loads that are undetermined.
"""

import functools
import itertools
import math

import numpy as np
import pytest
from motions import placed, shift, toes_of

from jansen_env import ROBOTS, Leg, Payload, Robot, Terrain
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.robot.kinematics import T, joint_positions

PSI = 2.75  # rad
IMPACT = 1e-8  # s, time step in which an impact is dealt: nothing else matters in it
locked = pytest.mark.parametrize("locked", [True, False], ids=["locked", "free"])


@functools.cache
def level(toes):
    """A robot with so many toes, all level at crank angle ``PSI``."""

    def rise(psi):
        high = [joint_positions(Robot(), "fore", angle)[T, 1] for angle in (psi, PSI)]
        return high[0] - high[1]

    low, high = 3.4, 3.9
    while high - low > 1e-15 and low < 0.5 * (low + high) < high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rise(middle) < 0.0 else (low, middle)
    mirror = [("fore", PSI), ("back", math.pi - PSI), ("fore", low), ("back", math.pi - low)]
    legs = tuple(Leg(side, angle - PSI) for side, angle in mirror[:toes])
    return Robot(legs=legs)


def jacobians(robot, q):
    """(toes, 4) normal and tangential Jacobian on level ground, by central differences."""
    steps = 1e-5 * np.eye(4)
    columns = [(toes_of(robot, q + step) - toes_of(robot, q - step)) / 2e-5 for step in steps]
    motion = np.stack(columns, axis=2)
    return motion[:, 1], motion[:, 0] + robot.pad_radius * motion[:, 2]


def inverse_mass(plant, q):
    """M^-1, with a locked crank: as if its inertia were infinite."""
    M = rd.mass_matrix(plant.tables, q)
    inverse = np.zeros((4, 4))
    free = 3 if plant.prescribed_crank_speed else 4
    inverse[:free, :free] = np.linalg.inv(M[:free, :free])
    return inverse


def least_impulse(inverse, normal, v, restitution):
    """Velocity after a smooth impact: of all with J v+ >= -e J v nearest in M, by trying sets."""
    least = math.inf
    answer = v
    wanted = -restitution * np.minimum(normal @ v, 0.0)
    for some in itertools.product([False, True], repeat=len(normal)):
        J = normal[list(some)]
        P = np.linalg.lstsq(J @ inverse @ J.T, (wanted - normal @ v)[list(some)], rcond=1e-9)[0]
        after = v + inverse @ J.T @ P
        far = P @ J @ inverse @ J.T @ P
        if (normal @ after >= wanted - 1e-9).all() and far < least:
            least = far
            answer = after
    return answer


def coulomb(inverse, normal, tangential, v, mu):
    """All velocities after a plastic impact with friction, by trying every toe's mode."""
    toes = len(normal)
    answers = []
    J = np.vstack([normal, tangential])
    W = J @ inverse @ J.T
    q = J @ v
    for modes in itertools.product(["open", "stick", 1.0, -1.0], repeat=toes):
        basis = []
        rows = []
        for i, mode in enumerate(modes):
            if mode == "open":
                continue
            along = np.zeros(2 * toes)
            along[i] = 1.0
            if mode == "stick":
                rows.append(toes + i)
                basis.append(np.eye(2 * toes)[toes + i])
            else:
                along[toes + i] = -mu * mode
            rows.append(i)
            basis.append(along)
        P = np.zeros(2 * toes)
        if rows:
            B = np.array(basis).T
            P = B @ np.linalg.lstsq((W @ B)[rows], -q[rows], rcond=1e-9)[0]
        u = W @ P + q
        n, t = np.split(P, 2)
        tiny = 1e-8
        signorini = (n >= -tiny).all() and (u[:toes] >= -tiny).all()
        signorini = signorini and (np.abs(n * u[:toes]) < tiny).all()
        cone = (np.abs(t) <= mu * n + tiny).all()
        work = np.abs(t * u[toes:] + mu * n * np.abs(u[toes:])).max()  # most dissipation
        if signorini and cone and work < tiny:
            answers.append(v + inverse @ J.T @ P)
    return np.array(answers)


def strike(robot, v, mu, restitution, locked, psi=PSI):
    """Let it strike with velocity v.

    Returns:
        Plant, pose, velocity just after, the kinetic energy gained, that less what is booked, J.
    """
    ground = Terrain.flat(friction=mu, restitution=restitution)
    above = np.array([0.0, PLACEMENT_DEPTH + 0.01 * IMPACT, 0.0, 0.0, *v])  # all but touching
    settings = dict(locked=locked, tracing=True, gravity=0.0, time_step=IMPACT)
    plant = placed(robot, ground, psi, 0.0, moved=above, **settings)
    pose = plant.state[:4] + 0.5 * IMPACT * plant.state[4:]
    result = plant.step(0.0, IMPACT)
    assert plant.batch.touchdowns.all()
    M = rd.mass_matrix(plant.tables, pose)
    after = plant.state[4:]
    gained = 0.5 * (after @ M @ after - v @ M @ v) - result.motor_work
    return plant, pose, after, gained, gained + result.impact_loss + result.slip_loss


VELOCITIES = [
    (0.0, -1.0, 0.0, 0.0),
    (0.3, -1.0, 0.6, 0.0),
    (-0.5, -0.7, -0.4, 2.0),
    (0.2, -1.0, 0.1, -3.0),
]


@pytest.mark.slow
@locked
@pytest.mark.parametrize("toes", [1, 2, 3, 4])
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.8, 1.0])
def test_smooth_impact_is_the_least_impulse(toes, restitution, locked, measured):
    """With mu = 0, v+ is the nearest to v in M with J v+ >= -e J v, which is strictly convex, so
    unique.
    """
    worst = newton = unbooked = 0.0
    most = -math.inf
    for v in np.array(VELOCITIES) * [1.0, 1.0, 1.0, not locked]:
        plant, pose, after, gained, missing = strike(level(toes), v, 0.0, restitution, locked)
        most = max(most, gained)
        unbooked = max(unbooked, abs(missing))
        normal, _ = jacobians(plant.robot, pose)
        expected = least_impulse(inverse_mass(plant, pose), normal, v, restitution)
        worst = max(worst, np.abs(after - expected).max())
        if toes == 1:
            newton = max(newton, abs(normal[0] @ after + restitution * normal[0] @ v))
        assert np.abs(after - v).max() > 0.1
    measured(f"velocity after an impact, {toes} toe(s)", worst, 2e-7, "m/s")
    measured("rebound + e * approach of a single toe", newton, 1e-8, "m/s")
    measured("energy gained", most, 5e-7 if restitution == 1.0 else 0.0, "J")
    measured("loss not booked", unbooked, 5e-7, "J")


@pytest.mark.slow
@locked
@pytest.mark.parametrize("toes", [1, 2, 3, 4])
@pytest.mark.parametrize("mu", [0.3, 0.8])
def test_rough_impact_is_coulombs(toes, mu, locked, measured):
    """With e = 0, v+ is what trying all modes (open, stick, slide) of all toes finds, and only
    that.
    """
    worst = unbooked = 0.0
    most = -math.inf
    for v in np.array(VELOCITIES) * [1.0, 1.0, 1.0, not locked]:
        plant, pose, after, gained, missing = strike(level(toes), v, mu, 0.0, locked)
        most = max(most, gained)
        unbooked = max(unbooked, abs(missing))
        answers = coulomb(inverse_mass(plant, pose), *jacobians(plant.robot, pose), v, mu)
        assert len(answers) > 0
        worst = max(worst, np.abs(answers - after).max())
    measured(f"velocity after a rough impact, {toes} toe(s)", worst, 2e-7, "m/s")
    measured("energy gained in it", most, 0.0, "J")
    measured("loss not booked in it", unbooked, 5e-7, "J")


@pytest.mark.slow
@pytest.mark.parametrize("toes", [3, 4])
@pytest.mark.parametrize("mu, restitution", [(0.8, 0.0), (0.3, 0.0), (0.8, 0.5), (0.0, 0.8)])
def test_the_order_of_the_legs_is_of_no_matter(toes, mu, restitution, measured):
    """Level toes strike together and get one velocity, in whichever order the legs are named."""
    velocities = []
    v = np.array([0.1, -0.8, 0.2, 1.5])
    for order in itertools.permutations(level(toes).legs):
        first = order[0].phase
        robot = Robot(legs=tuple(Leg(leg.side, leg.phase - first) for leg in order))
        velocities.append(strike(robot, v, mu, restitution, False, PSI + first)[2])
    apart = np.ptp(velocities, axis=0).max()
    measured(f"velocities apart, {len(velocities)} orders of {toes} legs", apart, 1e-14)
    assert np.abs(velocities[0] - v).max() > 0.1


@pytest.mark.parametrize("toes, locked", [(2, True), (3, True), (4, True), (3, False), (4, False)])
def test_level_toes_share_the_weight(toes, locked, measured):
    """Loads balance; those of the locked robot are linear in x, as on equal springs."""
    robot = level(toes)
    plant = placed(robot, None, PSI, 0.0, moved=shift(y=0.05), locked=True)
    plant.step(0.0, 0.5)
    plant.prescribed_crank_speed = locked
    before = plant.state
    result = plant.step(0.0, 10.0)
    drift = np.abs(plant.state - before)[:4].max()
    measured(f"drift in 10 s on {toes} toes", drift, 3e-13, "m")
    x = plant.toe_positions()[:, 0]
    load = result.contact_force[:, 1]
    q = plant.state
    weight = robot.mass * GRAVITY
    arm = x - q[0] - (rd.body_sums(plant.tables, q[3]).c[0] / robot.mass)  # the pitch is 0
    measured("pitch", abs(q[2]), 1e-4, "rad")
    measured("sum of loads less weight", abs(load.sum() - weight), 1e-11, "N")
    measured("moment of the loads", abs(arm @ load), 1e-5 * weight, "N m")
    measured("least load, negative", -load.min(), 0.0, "N")
    if locked:
        balance = np.vstack([np.ones(toes), arm])
        springs = np.linalg.lstsq(balance, np.array([weight, 0.0]), rcond=None)[0]
        measured("loads less springs'", np.abs(load - springs).max(), 2e-5 * weight, "N")


DROP = 0.1  # m


SLOW = pytest.mark.slow
BOUNCES = [(1, 0.3, 3)] + [
    pytest.param(toes, *case, marks=SLOW)
    for toes in (1, 2, 3, 4)
    for case in ((0.3, 3), (0.5, 4), (0.8, 4), (1.0, 3))
    if (toes, *case) != (1, 0.3, 3)
]


@pytest.mark.parametrize("toes, restitution, bounces", BOUNCES)
def test_bounce_heights(toes, restitution, bounces, measured):
    """Dropped flat it rises to h_k = e^2k h_0, flying for 2 sqrt(2 h_k / g); e = 1: for ever.

    An impact is dealt within v h of the ground, v its speed: so far heights may be off.
    """
    step = 1e-5
    chunk = 1e-4
    robot = level(toes)
    if toes == 1:  # c + load * (x, y) = (mass + load) * toe's x
        place = joint_positions(robot, "fore", PSI)[T, 0]
        c = rd.body_sums(rd.compile_robot(robot), PSI).c[0]
        load = 5.0
        along = ((robot.mass + load) * place - c) / load
        robot = Robot(legs=robot.legs, payload=Payload(load, 0.1, (float(along), -0.2)))
    ground = Terrain.flat(friction=0.0, restitution=restitution)
    up = shift(y=PLACEMENT_DEPTH + DROP)
    plant = placed(robot, ground, PSI, 0.0, moved=up, locked=True, time_step=step)
    rest = plant.state[1] - DROP
    start = plant.energy()
    heights = []
    times = []
    steps = 0
    while len(heights) < bounces:
        falling = plant.state[5]
        plant.step(0.0, chunk)
        steps += 1
        height = plant.state[1] - rest
        rising = plant.state[5]
        if rising > falling:
            heights.append(height + rising**2 / (2.0 * GRAVITY))
            times.append(steps * chunk)
    k = np.arange(1, bounces + 1)
    expected = DROP * restitution ** (2 * k)
    speed = np.sqrt(2.0 * GRAVITY * DROP) * restitution ** (k - 1)
    measured("height's error, of v h", (np.abs(heights - expected) / (speed * step)).max(), 1.0)
    flights = 2.0 * np.sqrt(2.0 * expected[:-1] / GRAVITY)
    measured("time between bounces", np.abs(np.diff(times) - flights).max(), 1.5 * chunk, "s")
    if restitution == 1.0:
        measured("energy lost or won at e = 1", abs(plant.energy() - start) / start, 1e-10)
    measured("pitch rate", abs(plant.state[6]), 2e-11, "rad/s")


THROWN = 1e-6  # s, time step in which thrown robots strike
HEAVY = Robot(payload=Payload(60.0, 1.0, (0.1, 0.0)))


def impacts(robot, friction, restitution, rng, count=300):
    """(n, 2) energies before and after random single impacts in weightlessness, crank free."""
    ground = Terrain.flat(friction, restitution)
    plant = placed(robot, ground, tracing=True, time_step=THROWN, gravity=0.0)
    energies = []
    for _ in range(count):
        state = plant.reset(0.0, rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.3, 0.3))
        state[4:] = rng.normal(size=4) * (1.0, 0.0, 1.0, 3.0) - (0.0, 1.0, 0.0, 0.0)
        state[1] += PLACEMENT_DEPTH + 0.2 * THROWN  # it touches down next, if it comes near
        plant.state = state
        before = plant.energy()
        plant.step(0.0, THROWN)
        if plant.batch.touchdowns[0]:
            energies.append((before, plant.energy()))
    assert len(energies) > count // 2
    return np.array(energies)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8, 2.0])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("robot", [ROBOTS["holy_slender"](2), HEAVY], ids=["holy_slender", "60 kg"])
def test_no_impact_creates_energy(robot, friction, restitution, rng, measured):
    """Newton's law alone gives more than twice as much (60 kg, friction 0.8, e = 1)."""
    energies = impacts(robot, friction, restitution, rng)
    gain = (energies[:, 1] / energies[:, 0]).max() - 1.0
    measured(f"energy gained in an impact, friction {friction}, e = {restitution}", gain, 2e-6)
