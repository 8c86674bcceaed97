"""Friction of compliant pads: bristles hold exactly up to mu N, and give back what they took."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from test_grooves import grooves

from jansen_env import ROBOTS, Robot, Terrain
from jansen_env.gravity import GRAVITY
from jansen_env.plants.batch import Batch
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot import Compliance

STEP = 1e-3  # s
PADS = Compliance(3e4, 600.0, 1e4, 300.0)
FRICTION = 0.2


def standing(pads=PADS, friction=FRICTION, time_step=STEP, settle=10.0):
    """The paper's robot at rest on two toes, crank locked."""
    plant = ProjectionPlant(
        replace(Robot(), pad_compliance=pads), Terrain.flat(friction), time_step
    )
    plant.reset(0.0, 0.3)
    plant.prescribed_crank_speed = True
    if settle > 0.0:
        plant.step(0.0, settle)
    plant.tracing = True
    return plant


def pulled(plant, pull, steps):
    """Pull at the centre of mass with ``pull`` m/s^2 along the ground; returns the result."""
    plant.gravity = pull, -GRAVITY
    return plant.step(0.0, steps * plant.time_step)


def shares(plant):
    """Tangential force of each trace row and pad over mu times its normal one; NaN in the air."""
    tangential, normal = np.moveaxis(plant.trace["impulses"][:, :, :2], -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.abs(tangential) / (FRICTION * normal)


def test_bristles_hold_an_oscillating_pull(measured):
    """100 cycles of 1 Hz at 30 % of the friction: it sways on its bristles and comes back.

    The rigid law for comparison: it does not move at all.
    """
    for name, pads in (("bristles", PADS), ("rigid", Compliance())):
        plant = standing(pads)
        start, sway, slip = plant.state, 0.0, 0.0
        for k in range(100 * 50):
            result = pulled(plant, 0.3 * FRICTION * GRAVITY * math.sin(math.pi * k / 25.0), 20)
            slip += result.slip.sum()
            sway = max(sway, abs(plant.state[0] - start[0]))
        plant.gravity = 0.0, -GRAVITY
        plant.step(0.0, 10.0)
        drift = np.abs(plant.state - start)[:4].max()
        measured(f"{name}: slip in 100 cycles of pull", slip, 1e-11, "m")
        measured(f"{name}: off its place after them", drift, 1e-10, "m, rad")
        mass, stiffness = plant.robot.mass, 2.0 * pads.tangential_stiffness
        static = 0.3 * FRICTION * GRAVITY * mass / stiffness
        assert 0.8 * static < sway < 4.0 * static or (pads.rigid and sway < 1e-10)


def test_sliding_begins_at_mu_n_and_not_before(measured):
    """The pull grows by 1e-4 of itself every 20 ms: no slip below mu m g, and then it slides."""
    plant, limit = standing(PADS), FRICTION * GRAVITY
    for share in np.arange(0.0, 0.9, 1e-2):
        pulled(plant, share * limit, 100)
    for share in np.arange(0.9, 1.01, 1e-4):
        slid = pulled(plant, share * limit, 20).slip
        over = np.nanmax(shares(plant))
        measured("bristles: force over mu N", over - 1.0, 1e-10)
        if sorted(slid)[-2] > 1e-6:  # m: both of the toes that carry
            break
    measured("bristles: pull at which both toes slide, less mu m g, relative", abs(share - 1), 1e-3)
    before = plant.state[4]
    pulled(plant, 1.5 * limit, 200)
    gained = (plant.state[4] - before) / 0.2
    measured("sliding on bristles: acceleration off pull - mu g", abs(gained / limit - 0.5), 2e-2)


def test_it_stands_below_and_slides_above(measured):
    """10 s at 99.9 % of mu m g: no creep once both bristles are bent. At 100.1 %: it is off."""
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
    """No dampers, no slip, no gravity change: kinetic, potential and elastic energy keep their sum.

    Swinging on its bristles for 5 s, with a period of 16 time steps.
    """
    plant = standing(Compliance(3e4, 0.0, 1e4, 0.0), friction=5.0, settle=0.0)
    state = plant.state
    state[4] = 0.02
    plant.state = state
    energies, slip = [], 0.0
    for _ in range(500):
        slip += plant.step(0.0, 0.01).slip.sum()
        elastic = plant.batch.accumulators["elastic_energy"][0]
        energies.append(plant.energy() + elastic)
        energies[-1] -= energies[0] if len(energies) > 1 else 0.0
    swung = 0.5 * plant.robot.mass * 0.02**2
    assert slip == 0.0
    measured("undamped bristles: energy lost in 5 s", np.abs(energies[1:]).max() / swung, 1e-9)


@pytest.mark.parametrize("time_step", [1e-3, 1e-2])
@pytest.mark.parametrize("name", ["paper_slender", "holy", "built"])
def test_random_walks_in_grooves(name, time_step, measured):
    """Two planes and more at a pad, random torques, pads of all kinds: nothing diverges, friction
    never drives, and little energy is unaccounted for: what springs up to 1 TN/m, which no such
    time step resolves, give back of what counted as lost.
    """
    rng, count = np.random.default_rng(7), 48
    terrains = [replace(grooves(rng), restitution=0.0) for _ in range(count)]
    robots = []
    for _ in range(count):
        k, kt = 10.0 ** rng.uniform(3.0, 12.0, 2)
        d, dt = rng.choice([0.0, 1.0], 2) * 10.0 ** rng.uniform(0.0, 6.0, 2)
        robots.append(replace(ROBOTS[name](), pad_compliance=Compliance(k, d, kt, dt)))
    batch = Batch(robots, terrains, time_step, threads=1)
    for i in range(count):
        batch.place(np.array([i]), np.array([rng.uniform(0.0, 2.0 * math.pi)]))
    unaccounted, residual, lowest = np.zeros(count), 0.0, 0.0
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


def test_left_alone_in_grooves_it_comes_to_rest(measured):
    """No torque: the sum of kinetic, potential and elastic energy only falls, all 20 ms."""
    rng, gain = np.random.default_rng(11), 0.0
    for k in range(24):
        pads = Compliance(10.0 ** rng.uniform(3.5, 8.0), 10.0 ** rng.uniform(0.0, 3.0))
        robot = replace(ROBOTS["paper_slender"](), pad_compliance=pads)
        plant = ProjectionPlant(robot, replace(grooves(rng), restitution=0.0), 1e-3)
        plant.reset(0.0, rng.uniform(0.0, 2.0 * math.pi))
        plant.prescribed_crank_speed = k % 2 == 0
        plant.step(0.0, 0.001)
        last = plant.energy() + plant.batch.accumulators["elastic_energy"][0]
        for _ in range(100):
            plant.step(0.0, 0.02)
            now = plant.energy() + plant.batch.accumulators["elastic_energy"][0]
            gain, last = max(gain, now - last), now
    measured("left alone in grooves: energy gained in 20 ms", gain, 5e-4, "J")
