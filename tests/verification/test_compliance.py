"""Compliant pads against mass, spring and damper: landing, bounce, sag, and no energy from nowhere.

With a locked crank ``level(n)`` is one mass on n springs and n dampers: without gravity it leaves
after t = (pi - atan2(2 D s, 1 - 2 D^2)) / (w s) with e^(-D w t) of its speed, w^2 = n k / m,
D = n d / (2 m w), s^2 = 1 - D^2 (T. Schwager and T. Poeschel, Granular Matter 9, 2007).
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import placed, shift
from test_touchdown import PSI, level

from jansen_env import ROBOTS, Terrain
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.plants.batch import Batch
from jansen_env.robot import Compliance

SPEED = 1.0  # m/s


def flat_fall(toes, pads, time_step, gravity=0.0, speed=SPEED, ahead=0.0):
    """A plant whose toes touch the ground in ``ahead`` time steps, crank locked."""
    robot = replace(level(toes), pad_compliance=pads)
    arguments = dict(locked=True, time_step=time_step, gravity=gravity)
    plant = placed(robot, Terrain.flat(friction=0.0), PSI, 0.0, **arguments)
    above = plant.toe_positions()[:, 1].min() - robot.pad_radius
    plant.state = plant.state + shift(y=ahead * time_step * speed - above, vy=-speed)
    return plant


def pads_of(omega, ratio, toes=2):
    """The pads that give ``level(toes)`` an angular frequency (rad/s) and a damping ratio."""
    mass = level(toes).mass
    return Compliance(mass * omega**2 / toes, 2.0 * ratio * mass * omega / toes)


def contact_time(omega, ratio):
    """How long the mass stays on its spring, s, and the share of its speed with which it leaves."""
    if ratio == 0.0:
        return math.pi / omega, 1.0
    s = math.sqrt(1.0 - ratio**2)
    time = (math.pi - math.atan2(2.0 * ratio * s, 1.0 - 2.0 * ratio**2)) / (omega * s)
    return time, math.exp(-ratio * omega * time)


def leaving(plant, steps):
    """Time steps in which the pads push, and the speed at the end."""
    plant.batch.tracing = True
    plant.step(0.0, steps * plant.time_step)
    return int((plant.batch.trace["impulses"][:, :, 1] > 0.0).any(axis=1).sum()), plant.state[5]


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("toes", [2, 4])
def test_landing_is_a_damped_oscillation(toes, ratio, measured):
    """Height and speed agree all the way down and half the way up, with gravity; errors are of
    second order.
    """
    omega = 200.0
    errors = []
    delta = ratio * omega
    turn = omega * math.sqrt(1.0 - ratio**2)
    rest = -GRAVITY / omega**2
    for step in (4e-4, 2e-4, 1e-4):
        plant = flat_fall(toes, pads_of(omega, ratio, toes), step, GRAVITY)
        worst = 0.0
        start = plant.state[1]
        b = (-SPEED - delta * rest) / turn
        for k in range(1, 13):
            plant.step(0.0, 1e-3 * 0.8)
            t = 0.8e-3 * k
            cos, sin = math.cos(turn * t), math.sin(turn * t)
            wave = math.exp(-delta * t)
            z = rest + wave * (-rest * cos + b * sin)
            v = wave * ((-delta * -rest + turn * b) * cos + (-delta * b + turn * rest) * sin)
            worst = max(worst, omega * abs(plant.state[1] - start - z), abs(plant.state[5] - v))
        errors.append(worst)
    order = math.log(errors[0] / errors[2], 4.0)
    measured(f"landing on {toes} springs, 2 % of a period a step: error of 1 m/s", errors[2], 2e-4)
    measured(f"landing on {toes} springs: order lost of 2", 2.0 - order, 0.05)


@pytest.mark.parametrize("ratio", [0.05, 0.1, 0.2, 0.4, 0.6, 0.9])
def test_restitution_is_the_dampers(ratio, measured):
    """Speed and time of leaving follow from the damping ratio, at 500 steps a bounce and at
    eight.
    """
    omega = 500.0
    time, share = contact_time(omega, ratio)
    step = time / 500.0
    steps, speed = leaving(flat_fall(2, pads_of(omega, ratio), step), 700)
    measured("damped bounce: rebound off exp(-D w t)", abs(speed - share), 1e-5)
    measured("damped bounce: contact time", abs(steps - 500.0), 1.0, "time steps")
    rough = [
        leaving(flat_fall(2, pads_of(omega, ratio), time / 8.0, ahead=part), 40)[1] - share
        for part in (0.2, 0.4, 0.6, 0.8)
    ]
    measured("damped bounce in 8 time steps: rebound off", np.abs(rough).max(), 0.1)


def test_sag(measured):
    """At rest the springs are m g / (n k) shorter, with gravity level or not, on 2 to 4 toes."""
    for toes in (2, 4):
        pads = Compliance(2e4, 100.0)
        plant = flat_fall(toes, pads, 1e-3, GRAVITY, speed=0.1)
        start = plant.state[1]
        plant.step(0.0, 3.0)
        sag = plant.robot.mass * GRAVITY / (toes * pads.stiffness)
        measured("sag off m g / (n k)", abs(start - plant.state[1] - sag) / sag, 1e-11)
        measured("creep after 3 s", np.abs(plant.state[4:]).max(), 1e-12, "m/s, rad/s")


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("toes", [1, 2, 3, 4])
def test_the_rigid_limit_of_a_landing(toes, friction, measured):
    """Thrown on its toes with the crank free, a robot is in the same place after 20 ms on 1e14 N/m
    and on rigid pads.
    """
    for step, limit in ((1e-3, 2e-2), (1e-4, 3e-3)):
        ends = []
        for pads in (Compliance(1e14), Compliance()):
            robot = replace(level(toes), pad_compliance=pads)
            thrown = shift(y=2.34e-3, vx=0.2, vy=-0.5, spin=0.3, crank=1.0)
            plant = placed(robot, Terrain.flat(friction), PSI, 0.02, moved=thrown, time_step=step)
            plant.step(1.0, 0.02)
            ends.append(plant.state)
        apart = np.abs(ends[0] - ends[1]).max()
        measured(f"landing on 1e14 N/m or rigid, {1e3 * step:g} ms", apart, limit, "m, rad, 1/s")


def thrown(rng, count):
    """A batch of robots in weightlessness on pads of all kinds, thrown at the ground."""
    step = 10.0 ** rng.uniform(-4.0, -1.7)
    robots = []
    friction = rng.choice([0.0, 0.3, 0.8, 2.0])
    for _ in range(count):
        k, kt = 10.0 ** rng.uniform(2.0, 16.0, 2)
        d, dt = rng.choice([0.0, 1.0], 2) * 10.0 ** rng.uniform(0.0, 10.0, 2)
        robots.append(replace(ROBOTS["paper"](), pad_compliance=Compliance(k, d, kt, dt)))
    batch = Batch(robots, [Terrain.flat(float(friction))] * count, step, 0.0, threads=1)
    for i, robot in enumerate(robots):
        psi, pitch = rng.uniform([0.0, -0.3], [2.0 * math.pi, 0.3])
        batch.place_at(np.array([i]), np.array([psi]), pitch=pitch)
        state = batch.states[i]
        sunk = robot.mass * GRAVITY / robot.pad_compliance.stiffness
        state[1] += rng.uniform(0.0, 2.0) * step + sunk
        state[4:] = rng.normal(size=4) * (0.5, 0.3, 0.5, 0.0) - (0.0, 1.0, 0.0, 0.0)
        batch.set_mechanical_state(i, state)
    return batch


def resolved(batch):
    """(n,) whether the time step resolves all pads; 20 / kg is the most that W has there."""
    h, pads = batch.time_step, batch.properties
    stiff = h * np.sqrt(20.0 * pads["stiffness"].max(axis=1)) < 2.0
    return stiff & (20.0 * h * pads["pad_damping"].max(axis=1) < 2.0)


def test_no_pad_creates_energy(rng, measured):
    """The crank is locked; k is up to 1e16 N/m, d up to 1e10 N s/m, and steps are 0.1 to 20 ms.

    The account includes elastic energy.
    """
    gain = residual = 0.0
    for _ in range(20):
        batch = thrown(rng, 16)
        batch.properties["prescribed_speed"] = True
        start = np.array([batch.energy(i) for i in range(16)])
        for _ in range(40):
            batch.step(np.zeros(16), 1)
            assert not batch.diverged.any()
            now = np.array([batch.energy(i) for i in range(16)])
            now += np.where(resolved(batch), batch.accumulators["elastic_energy"], 0.0)
            gain = max(gain, float((now / start).max()) - 1.0)
            residual = max(residual, float(batch.accumulators["worst_residual"].max()))
        batch.close()
    measured("thrown at compliant pads: kinetic energy gained, relative", gain, 1e-12)
    measured("thrown at compliant pads: contact law violated", residual, 1e-13, "N s")
