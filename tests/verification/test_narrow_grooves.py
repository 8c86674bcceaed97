"""Robots in grooves narrower than a pad or a link, whose links collide or not: losses and impulses.

Contacts on both sides of a pad or a link can press on each other with any force. What a time step's
motion explains bounds it: see :func:`jansen_env.engine.contacts.impulse_ratio`.
"""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from motions import placed, shift

from jansen_env import ROBOTS, Robot, Terrain
from jansen_env.dynamics.reduced import compile_robot, mass_matrix
from jansen_env.engine.contact_solver import WEDGE_COMPLIANCE
from jansen_env.plants.batch import Batch
from jansen_env.robot import RIGID

STEP = 1e-3  # s
HOLD = 0.02  # s
LOSSES = ("joint_loss", "slip_loss", "impact_loss")
SAW = tuple((0.1 * i - 4.0, 0.25 * (i % 2)) for i in range(80))


def narrow_grooves(rng: np.random.Generator) -> Terrain:
    """Grooves of 2 mm to 0.4 m, up to 0.3 m deep: equal ones, with flats between, or random."""
    half = 10.0 ** rng.uniform(-3.0, -0.7)  # m
    deep = min(0.3, half * math.tan(rng.uniform(0.0, 1.39)))
    count = int(min(3.0, 400.0 * half) / half)
    number = np.arange(-count, count + 1)
    y = [
        np.where(number % 2, -deep, 0.0),
        np.where(number % 4 == 1, -deep, 0.0),
        rng.uniform(-deep, 0.0, 2 * count + 1),
    ][rng.integers(3)]
    friction, restitution = rng.uniform([0.0, 0.0], [1.5, 1.0]) * (rng.random(2) > 0.2)
    points = [(-9.0, 0.0), *zip(half * number, y, strict=True), (9.0, 0.0)]
    return Terrain(points, friction, restitution)


def walk(name: str, rigid: bool, links_collide: bool, seed: int, episodes: int):
    """Random torques for 100 control periods.

    Returns:
        dict of (episodes,): the least loss and the largest energy unaccounted for in a period (J);
        kinetic energy that contacts added in a time step (J); impulses as a share of their bound;
        the worst residual of the contact law (N s); mean force on a toe in a period (N).
    """
    rng = np.random.default_rng([seed, [*ROBOTS].index(name), rigid, links_collide])
    robot = ROBOTS[name]()
    terrains = [narrow_grooves(rng) for _ in range(episodes)]
    if rigid:
        robot = replace(robot, pad_compliance=RIGID)
    else:
        terrains = [replace(terrain, restitution=0.0) for terrain in terrains]
    batch = Batch([robot] * episodes, terrains, STEP, threads=1, links_collide=links_collide)
    every = np.arange(episodes)
    batch.place(every, rng.uniform(0.0, 2.0 * math.pi, episodes))
    most = min(robot.motor.torque_limit, 20.0)
    mean, spread = rng.uniform(-1.0, 1.0, episodes), rng.uniform(0.0, 1.5, episodes)
    worst = dict.fromkeys(("loss", "energy", "gain", "share", "law", "force"), np.zeros(episodes))
    for _ in range(100):
        share = np.clip(mean + spread * rng.uniform(-1.0, 1.0, episodes), -1.0, 1.0)
        batch.step(most * share, round(HOLD / STEP))
        assert not batch.diverged.any()
        sums = batch.accumulators
        missed = sums["motor_work"] + sums["correction_work"] - sums["energy_change"]
        found = {
            "loss": -np.min([sums[name] for name in LOSSES], axis=0),
            "energy": np.abs(missed - np.sum([sums[name] for name in LOSSES], axis=0)),
            "gain": sums["contact_gain"],
            "share": sums["impulse_ratio"],
            "law": sums["worst_residual"],
            "force": np.abs(batch.contact_force).max(axis=(1, 2)),
        }
        worst = {key: np.maximum(worst[key], found[key]) for key in worst}
    batch.close()
    return worst


def check_bounds(worst):
    """No loss below zero, no impulse beyond what the motion explains; a few times what was found.

    Found in 5,120 episodes: 3.5 J unaccounted for in 20 ms, as crank speeds of 36 rad/s reverse
    within a few time steps; 5.2 mJ that contacts added in a time step; a residual of the contact
    law of 1.3 nN s.
    """
    assert worst["loss"].max() <= 0.0
    assert worst["share"].max() <= 1.0 + 1e-9
    assert worst["energy"].max() < 4.0
    assert worst["gain"].max() < 0.01
    assert worst["law"].max() < 1e-8


CASES = [
    pytest.param(2, id="2"),
    pytest.param(128, id="128", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("episodes", CASES)
@pytest.mark.parametrize("links_collide", [False, True], ids=["pads", "links"])
@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "soft"])
@pytest.mark.parametrize("name", ROBOTS)
def test_jammed_robots_stay_within_what_their_motion_explains(name, rigid, links_collide, episodes):
    if not rigid and ROBOTS[name]().pad_compliance.rigid:
        pytest.skip("this robot has rigid feet")
    check_bounds(walk(name, rigid, links_collide, 0, episodes))


@pytest.mark.parametrize(
    ("name", "friction", "restitution", "seeds"),
    [("paper", 0.3, 0.5, range(8)), ("strider", 0.0, 1.0, range(100, 106))],
)
def test_links_between_the_teeth_of_a_saw(name, friction, restitution, seeds):
    """Forces stay within some hundred weights, where they were 1e10 N, and no loss is below
    zero.
    """
    env = gym.make(
        "JansenWalker-v0",
        robot=name,
        terrain=SAW,
        friction=friction,
        restitution=restitution,
        links_collide=True,
        terminate_when_fallen=False,
    ).unwrapped
    for seed in seeds:
        env.reset(seed=seed)
        for _ in range(200):
            observation, *_, info = env.step([0.35])
            assert np.abs(info["contact_force"]).max() < 500.0 * env.weight
            assert np.abs(observation).max() < 1e4
            assert min(info["energy"][name] for name in LOSSES) >= 0.0


def test_soft_feet_and_links_between_the_teeth_of_a_saw_keep_energy():
    env = gym.make(
        "JansenWalkerBuilt-v0",
        terrain=SAW,
        friction=0.8,
        links_collide=True,
        terminate_when_fallen=False,
    ).unwrapped
    for seed in range(6):
        env.reset(seed=seed)
        for _ in range(200):
            energy = env.step([0.35])[4]["energy"]
            assert abs(energy["residual"]) < 0.5
            assert min(energy[name] for name in LOSSES) >= 0.0


def test_impulses_stay_below_a_bound_from_the_mass_matrix(measured):
    """A second robot high above the ground shows the velocity v of a time step without contacts.

    The mean diagonal of W is at least 1 / m, so that the largest impulse is m v M v / (4 s).
    """
    rng = np.random.default_rng(3)
    count = 24
    robot = Robot()
    tables = compile_robot(Robot())
    grounds = [replace(narrow_grooves(rng), friction=1.5, restitution=0.5) for _ in range(count)]
    batch = Batch([robot] * count, grounds, STEP, threads=1)
    sky = Batch([robot] * count, [Terrain.flat()] * count, STEP, threads=1)
    batch.place(np.arange(count), rng.uniform(0.0, 2.0 * math.pi, count))
    largest = 0.0
    for _ in range(300):
        torque = rng.uniform(-20.0, 20.0, count)
        for i in range(count):
            sky.set_mechanical_state(i, batch.states[i] + shift(y=1000.0))
        batch.step(torque, 1)
        sky.step(torque, 1)
        squares = (batch.records.statistics["impulse"] ** 2).sum(axis=(1, 2))
        for square, state in zip(squares, sky.states, strict=True):
            v = state[4:]
            bound = robot.mass * v @ mass_matrix(tables, state[:4]) @ v / (4.0 * WEDGE_COMPLIANCE)
            largest = max(largest, float(square / bound))
    batch.close()
    sky.close()
    assert largest > 1e-3  # some contacts had impulses
    measured("wedged pads: impulses over an independent bound", math.sqrt(largest), 1.0)


def test_jammed_links_stay(measured):
    """Drive robots into teeth with colliding links, then leave them alone for 3 s.

    The test measures the median motion, so that half of the robots may rock.
    """
    ground = Terrain(SAW, 0.8)
    moved = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        plant = placed(ROBOTS["holy"](), ground, rng.uniform(0.0, 6.0), links_collide=True)
        for _ in range(50):
            plant.step(rng.uniform(-20.0, 20.0), HOLD)
        plant.step(0.0, 3.0)
        before = plant.state
        plant.step(0.0, 1.0)
        moved.append(np.abs(plant.state - before)[:3].max())
    measured("links jammed in teeth, left alone: motion in a second", np.median(moved), 1e-3, "m")
