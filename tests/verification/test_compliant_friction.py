"""Friction of compliant pads: bristles hold exactly up to mu N, and give back what they took."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import placed, pull, shift
from test_grooves import grooves

from jansen_env import ROBOTS, Robot, Terrain
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.plants.batch import Batch
from jansen_env.robot import Compliance

PADS = Compliance(3e4, 600.0, 1e4, 300.0)
FRICTION = 0.2


def standing(pads=PADS, friction=FRICTION, speed=0.0, settle=10.0):
    """The paper's robot at rest on two toes, crank locked."""
    robot = replace(Robot(), pad_compliance=pads)
    plant = placed(robot, Terrain.flat(friction), moved=shift(vx=speed), locked=True)
    if settle > 0.0:
        plant.step(0.0, settle)
    plant.batch.tracing = True
    return plant


def pulled(plant, along, steps):
    """Pull at the centre of mass with ``along`` m/s^2 along the ground; returns the result."""
    pull(plant, along)
    return plant.step(0.0, steps * plant.time_step)


@pytest.mark.slow
def test_bristles_hold_an_oscillating_pull(measured):
    """Pulled for 100 cycles at 1 Hz with 30 % of the friction, it sways on its bristles and comes
    back.
    """
    for name, pads in (("bristles", PADS), ("rigid", Compliance())):
        plant = standing(pads)
        start = plant.state
        sway = slip = 0.0
        for k in range(100 * 50):
            result = pulled(plant, 0.3 * FRICTION * GRAVITY * math.sin(math.pi * k / 25.0), 20)
            slip += result.slip.sum()
            sway = max(sway, abs(plant.state[0] - start[0]))
        pull(plant, 0.0)
        plant.step(0.0, 10.0)
        drift = np.abs(plant.state - start)[:4].max()
        measured(f"{name}: slip in 100 cycles of pull", slip, 1e-11, "m")
        measured(f"{name}: off its place after them", drift, 1e-10, "m, rad")
        mass = plant.robot.mass
        stiffness = 2.0 * pads.tangential_stiffness
        static = 0.3 * FRICTION * GRAVITY * mass / stiffness
        assert 0.8 * static < sway < 4.0 * static or (pads.rigid and sway < 1e-10)


def test_it_stands_below_and_slides_above(measured):
    """In 10 s at 99.9 % of mu m g it does not creep once both bristles are bent.

    At 100.1 % it slides off.
    """
    for share in (0.999, 1.001):
        plant = standing(PADS)
        for part in np.linspace(0.0, share, 200):
            pulled(plant, part * FRICTION * GRAVITY, 20)
        pulled(plant, share * FRICTION * GRAVITY, 10000)
        before = plant.state[0]
        slip = pulled(plant, share * FRICTION * GRAVITY, 10000).slip.max()
        if share < 1.0:
            measured("bristles at 99.9 %: slip in 10 s", slip, 1e-12, "m")
            measured("bristles at 99.9 %: creep in 10 s", abs(plant.state[0] - before), 1e-12, "m")
        else:
            assert slip > 0.1


def test_bristles_and_springs_give_back_what_they_took(measured):
    """Without dampers and slip, 5 s of swinging at 16 time steps a period keep the sum of all
    energies.
    """
    plant = standing(Compliance(3e4, 0.0, 1e4, 0.0), 5.0, speed=0.02, settle=0.0)
    energies = []
    slip = 0.0
    for _ in range(500):
        slip += plant.step(0.0, 0.01).slip.sum()
        elastic = plant.batch.accumulators["elastic_energy"][0]
        energies.append(plant.energy() + elastic)
        energies[-1] -= energies[0] if len(energies) > 1 else 0.0
    swung = 0.5 * plant.robot.mass * 0.02**2
    assert slip == 0.0
    measured("undamped bristles: energy lost in 5 s", np.abs(energies[1:]).max() / swung, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("time_step", [1e-3, 1e-2])
@pytest.mark.parametrize("name", ["paper_slender", "holy", "built", "klann", "strider"])
def test_random_walks_in_grooves(name, time_step, measured):
    """Nothing diverges, and friction never drives; springs up to 1 TN/m give back what counted as
    lost.
    """
    rng = np.random.default_rng(7)
    count = 48
    terrains = [replace(grooves(rng), restitution=0.0) for _ in range(count)]
    robots = []
    for _ in range(count):
        k, kt = 10.0 ** rng.uniform(3.0, 12.0, 2)
        d, dt = rng.choice([0.0, 1.0], 2) * 10.0 ** rng.uniform(0.0, 6.0, 2)
        robots.append(replace(ROBOTS[name](), pad_compliance=Compliance(k, d, kt, dt)))
    batch = Batch(robots, terrains, time_step, threads=1)
    for i in range(count):
        batch.place(np.array([i]), np.array([rng.uniform(0.0, 2.0 * math.pi)]))
    unaccounted = np.zeros(count)
    residual = lowest = 0.0
    for _ in range(50):
        batch.step(rng.uniform(-20.0, 20.0, count), round(0.02 / time_step))
        assert not batch.diverged.any()
        sums = batch.accumulators
        missing = sums["motor_work"] - sums["energy_change"]
        for loss in ("joint_loss", "slip_loss", "impact_loss"):
            missing -= sums[loss]
        unaccounted = np.maximum(unaccounted, np.abs(missing))
        residual = max(residual, sums["worst_residual"].max())
        lowest = min(lowest, sums["slip_loss"].min())
    batch.close()
    where = f"grooves, {name}, {1e3 * time_step:g} ms"
    measured(f"{where}: energy unaccounted for in 20 ms, median", np.median(unaccounted), 0.15, "J")
    measured(f"{where}: energy unaccounted for in 20 ms", unaccounted.max(), 15.0, "J")
    measured(f"{where}: contact law violated", residual, 1e-12, "N s")
    measured(f"{where}: friction's least loss in 20 ms, negative", -lowest, 0.0, "J")


def edges(half: float, flats: bool) -> Terrain:
    """Grooves of 45 degrees, ``half`` as deep as wide (m), side by side or with flats between."""
    number = np.arange(-int(3.0 / half), int(3.0 / half) + 1)
    deep = number % 4 == 1 if flats else number % 2 == 1
    return Terrain(tuple(zip(half * number, np.where(deep, -half, 0.0), strict=True)), 0.8)


@pytest.mark.parametrize("time_step", [1e-3, 5e-4, 2.5e-4])
def test_thrown_into_grooves(time_step, rng, measured):
    """Soft and undamped, without torque: kinetic, potential and elastic energy never rise
    in 20 ms.
    """
    grounds = [edges(h, f) for h in (0.005, 0.01, 0.025, 0.05, 0.1, 0.2) for f in (False, True)]
    grounds *= 4
    robot = replace(ROBOTS["paper"](), pad_compliance=Compliance(2e4))
    batch = Batch([robot] * len(grounds), grounds, time_step, threads=1)
    gain = 0.0
    last = np.full(len(grounds), math.inf)
    for i in range(len(grounds)):
        batch.place(np.array([i]), rng.uniform(0.0, 2.0 * math.pi, 1))
        state = batch.states[i] + [0.0, 0.05, 0.0, 0.0, *rng.normal(size=4) * (0.5, 0.5, 0.5, 2.0)]
        batch.set_mechanical_state(i, state)
    for _ in range(100):
        batch.step(np.zeros(len(grounds)), round(0.02 / time_step))
        now = np.array([batch.energy(i) for i in range(len(grounds))])
        now += batch.accumulators["elastic_energy"]
        gain = max(gain, (now - last).max())
        last = now
    batch.close()
    measured("thrown into 45-degree grooves: energy gained in 20 ms", gain, 1e-6, "J")
