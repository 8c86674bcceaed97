"""Compliant pads where the ground has edges: planes that come and go bring no energy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Terrain
from jansen_env.plants.batch import Batch
from jansen_env.robot import Compliance
from jansen_env.terrain.generators import HIGHEST, LEVELS, make_generator

HOLD = 0.02  # s
DAMPING_RATIOS = 0.0, 0.05, 0.2, 1.0  # of 1 kg, about what a toe feels like


def grooves(half: float, flats: bool) -> Terrain:
    """Grooves of 45 degrees, ``half`` as deep as wide (m), side by side or with flats between."""
    number = np.arange(-int(3.0 / half), int(3.0 / half) + 1)
    deep = number % 4 == 1 if flats else number % 2 == 1
    return Terrain(tuple(zip(half * number, np.where(deep, -half, 0.0), strict=True)), 0.8)


@pytest.mark.parametrize("time_step", [1e-3, 5e-4, 2.5e-4])
def test_thrown_into_grooves(time_step, rng, measured):
    """Soft and undamped, no torque: kinetic, potential and elastic energy never rise in 20 ms."""
    grounds = [grooves(h, f) for h in (0.005, 0.01, 0.025, 0.05, 0.1, 0.2) for f in (False, True)]
    grounds *= 4
    robot = replace(ROBOTS["paper"](), pad_compliance=Compliance(2e4))
    batch = Batch([robot] * len(grounds), grounds, time_step, threads=1)
    gain, last = 0.0, np.full(len(grounds), math.inf)
    for i in range(len(grounds)):
        batch.place(np.array([i]), rng.uniform(0.0, 2.0 * math.pi, 1))
        state = batch.states[i] + [0.0, 0.05, 0.0, 0.0, *rng.normal(size=4) * (0.5, 0.5, 0.5, 2.0)]
        batch.set_state(i, state)
    for _ in range(100):
        batch.step(np.zeros(len(grounds)), round(HOLD / time_step))
        now = np.array([batch.energy(i) for i in range(len(grounds))])
        now += batch.accumulators["elastic_energy"]
        gain, last = max(gain, (now - last).max()), now
    batch.close()
    measured("thrown into 45-degree grooves: energy gained in 20 ms", gain, 1e-6, "J")


@pytest.mark.parametrize("name", ["paper", "built"])
def test_walks_on_every_ground(name, rng, measured):
    """All generators at all levels, 3 kN/m to 1 MN/m, undamped to damped: the books balance.

    Energy from edges would be missing in them, because no loss is ever negative.
    """
    grounds = [make_generator(kind)(rng, level) for kind in LEVELS for level in range(HIGHEST + 1)]
    count, robots = len(grounds), []
    for i in range(count):
        k, ratio = 10.0 ** rng.uniform(3.5, 6.0), DAMPING_RATIOS[i % len(DAMPING_RATIOS)]
        d = 2.0 * ratio * math.sqrt(k)
        pads = Compliance(k, d, rng.uniform(0.25, 1.0) * k, d)
        robots.append(replace(ROBOTS[name](), pad_compliance=pads))
    batch = Batch(robots, grounds)
    batch.place(np.arange(count), rng.uniform(0.0, 2.0 * math.pi, count))
    speed = rng.uniform(1.0, 5.0, count)
    created, turned = np.zeros(count), np.zeros(count)
    for _ in range(250):
        torque = np.clip(10.0 * (speed - batch.states[:, 7]) + 1.5 * speed, -20.0, 20.0)
        batch.step(torque, 20)
        sums = batch.accumulators
        missing = sums["motor_work"] - sums["energy_change"] - sums["joint_loss"]
        missing -= sums["slip_loss"] + sums["impact_loss"]
        assert not batch.diverged.any()
        assert sums["slip_loss"].min() >= 0.0
        created = np.maximum(created, -missing)
        turned += np.abs(sums["motor_work"])
    batch.close()
    measured(f"{name} on every ground: energy created in 20 ms", created.max(), 0.3, "J")
    share = (created / turned).max()
    measured(f"{name} on every ground: the same of the motor's work in 5 s", share, 2e-3)
