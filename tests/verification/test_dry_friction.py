"""Coulomb friction of gear and bearings on the crank: exact at standstill, on both bases."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import PADS, pads, pinned, placed, shift

from jansen_env import Motor, Robot
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.robot import ROBOTS
from jansen_env.robot.kinematics import joint_positions

TORQUE = 1.5  # N m, of friction
SMOOTH = replace(Robot(), damping=(0.0,) * 10)
GEAR = Motor(friction=TORQUE)


def test_bearings_are_the_kinematics(rng, measured):
    """sum tau_i |a_j' - a_i'| agrees with angles between the joints' central differences."""
    h = 1e-6
    for design in ROBOTS.values():
        robot = design()
        bearings = robot.linkage.bearings
        members = robot.linkage.members
        friction = rng.uniform(0.0, 1.0, len(bearings))
        robot = replace(robot, bearing_friction=tuple(friction))
        model = compile_robot(robot).bearings
        worst = 0.0
        for row in rng.integers(0, len(model), 20):
            psi = 2.0 * math.pi * row / len(model)
            total = 0.0
            for leg in robot.legs:
                angle = psi + leg.phase + np.array([-h, h])
                joints = joint_positions(robot, leg.side, angle) @ [1.0, 1.0j]
                rate = {1: 0.0}
                for body, (first, second, *_) in enumerate(members[1:], start=2):
                    bar = joints[:, second] - joints[:, first]
                    rate[body] = np.angle(bar[1] / bar[0]) / (2.0 * h)
                pairs = zip(friction, bearings, strict=True)
                total += sum(f * abs(rate[j] - rate[i]) for f, (i, j) in pairs)
            worst = max(worst, abs(model[row] - total) / total)
        measured("bearings' friction against the joints' motion", worst, 1e-8)


@pads
@pytest.mark.parametrize("share", [-0.999, 0.0, 0.999])
def test_a_crank_below_its_friction_stands_still(name, share, measured):
    """In 10 s on its feet, under 99.9 % of what holds it, not one bit changes; the weight's torque
    is included.
    """
    robot = replace(Robot(), motor=Motor(friction=30.0), pad_compliance=PADS[name])
    plant = placed(robot)
    plant.step(0.0, 2.0)
    before = plant.state
    result = plant.step(share * 20.0, 10.0)
    after = plant.state
    assert after[7] == 0.0 and before[7] == 0.0
    measured("crank's creep in 10 s below friction", abs(after[3] - before[3]), 0.0, "rad")
    measured("chassis' motion meanwhile", np.abs(after - before)[:3].max(), 2e-4, "m, rad")
    assert result.motor_work == 0.0 and result.joint_loss == 0.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_it_breaks_away_at_friction_and_weight(sign, measured):
    """By bisection, it breaks away at F less the weight's torque on a fixed base, and at F itself
    free in space.
    """
    tables = compile_robot(replace(SMOOTH, motor=GEAR))

    def fixed(torque):
        plant = pinned(tables.robot, 1.0)
        plant.step(torque, 0.01)
        return plant.state[3] != 1.0

    def free(torque):
        plant = placed(tables.robot, state=shift(y=5.0, pitch=0.1, psi=1.0), gravity=0.0)
        plant.step(torque, 0.01)
        return plant.state[7] != 0.0

    weight = float(GRAVITY * body_sums(tables, 1.0).dc[1])
    for base, turns, expected in (("fixed", fixed, sign * weight), ("free", free, 0.0)):
        low, high = 0.0, 10.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if turns(sign * middle) else (middle, high)
        off = abs(high - TORQUE - expected)
        measured(f"{base} base: break away off friction", off, 1e-10, "N m")


def test_a_free_crank_stops_in_time(measured):
    """It stops after k n / F where k is constant; otherwise by energy, k n^2 / 2 = F psi."""
    robot = replace(SMOOTH, motor=Motor(friction=TORQUE, rotor_inertia=1e-3, gear_ratio=1e3))
    tables = compile_robot(robot)  # k is 1000 kg m^2 and 0.7
    plant = pinned(robot, 0.3, 0.01, gravity=0.0)
    k = float(body_sums(tables, 0.3).k)
    times = 0
    stop = k * 0.01 / TORQUE
    while plant.state[7] > 0.0:
        plant.step(0.0, 1e-3)
        times += 1
    measured("fixed base: time to stop off k n / F", abs(times * 1e-3 - stop), 1.1e-3, "s")
    turned = 0.5 * k * 0.01**2 / TORQUE
    measured("fixed base: angle to stop", abs(plant.state[3] - 0.3 - turned) / turned, 1e-7)
    light = replace(SMOOTH, motor=GEAR)
    plant = pinned(light, 0.3, 6.0, 2.5e-4, gravity=0.0)
    energy = plant.energy()
    result = plant.step(0.0, 10.0)
    assert plant.state[7] == 0.0
    share = TORQUE * (plant.state[3] - 0.3) / energy
    measured("fixed base: F psi off the energy lost", abs(share - 1.0), 1e-7)
    measured("fixed base: joint loss off it", abs(result.joint_loss / energy - 1.0), 1e-7)


@pads
def test_the_same_stop_in_flight(name, measured):
    """On a free base without weight, friction has what the motion loses, to second order."""
    robot = replace(SMOOTH, motor=GEAR, pad_compliance=PADS[name])
    ends = []
    for step in (2e-3, 1e-3, 5e-4, 3.125e-5):
        thrown = [0.0, 50.0, 0.1, 1.0, 0.1, 0.0, 0.5, 4.0]
        plant = placed(robot, state=thrown, time_step=step, gravity=0.0)
        start = plant.energy()
        result = plant.step(0.0, 3.0)
        assert plant.state[7] == 0.0
        lost = start - plant.energy()
        measured("flight: joint loss off the energy lost", abs(result.joint_loss / lost - 1), 5e-8)
        ends.append(plant.state)
    errors = [np.abs(end - ends[-1])[3] for end in ends[:3]]
    measured("flight: crank angle at which it stops, error at 1 ms", errors[1], 5e-6, "rad")
    measured("flight: order lost of 2", 2.0 - math.log(errors[0] / errors[2], 4.0), 0.3)
