"""Compliant pads, motor, rotor, bearings and payload at once; and the limits in which they go."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import HOLD, audit, governor, placed

from jansen_env import ROBOTS, Motor, Payload, Robot, Terrain
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.robot import JANSEN, Compliance
from jansen_env.robot.zoo import ZOO

MOTOR = Motor(14.0, 7.0, 10.0, 40.0, 1e-4, 0.15, 0.02, 0.8)
PADS = Compliance(3e4, 60.0, 2e4, 40.0)
ROUGH = replace(Terrain.rough(np.random.default_rng(0), start=-5.0), friction=0.6)
GROUNDS = {"level": Terrain.flat(0.6), "slope": Terrain.slope(0.1, friction=0.6), "rough": ROUGH}


def full(name, pads=PADS):
    """A design with everything on."""
    robot = ROBOTS[name]()
    return replace(
        robot,
        motor=MOTOR,
        pad_compliance=pads,
        payload=Payload(1.0, 0.02, (0.05, 0.1)),
        bearing_friction=(0.01,) * len(robot.linkage.bearings),
    )


def walking(plant):
    """The torque that holds the crank near 1.5 rad/s."""
    return governor(plant, 1.5, 10.0)


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("name", ["paper", "holy_slender", *ZOO])
def test_energy_audit(name, ground, measured):
    """Motor work is joint, slip and impact loss plus the change of energy, including elastic
    energy.
    """
    shares = []
    for step in (1e-3, 2.5e-4):
        plant = placed(full(name), GROUNDS[ground], time_step=step)
        lost, turned, residual = audit(plant, walking, 4.0)
        shares.append(lost / turned)
        law = residual / (plant.robot.mass * GRAVITY * step)
        measured("everything on: contact law violated, of m g dt", law, 1e-14)
    missed, fine = shares
    most = 5e-6 if name in ZOO else 5e-7  # toes that are three times as fast
    measured(f"everything on, {ground}: energy unaccounted for at 1 ms", missed, most)
    measured(f"everything on, {ground}: the same at 0.25 ms", fine, 0.1 * most)
    measured("everything on: order lost of 2", 2.0 - math.log(missed / fine, 4.0), 0.3)


NOTHING = {
    "gear without rotor": dict(motor=Motor(gear_ratio=5.0)),
    "torque limit alone": dict(motor=Motor(torque_limit=3.0)),
    "efficiency alone": dict(motor=Motor(efficiency=0.5)),
    "no bearing friction": dict(bearing_friction=(0.0,) * len(JANSEN.bearings)),
    "pads of infinite stiffness": dict(pad_compliance=Compliance(math.inf, 0.0)),
    "a line out of reach": dict(motor=Motor(stall_torque=1e30, torque_limit=1e30)),
}


@pytest.mark.parametrize("name", NOTHING)
def test_what_is_not_there_changes_no_bit(name):
    """A walk on rough ground has the same states with a part that does nothing as without it."""
    plant, other = placed(Robot(), ROUGH), placed(replace(Robot(), **NOTHING[name]), ROUGH)
    for _ in range(100):
        torque = walking(plant)
        a, b = plant.step(torque, HOLD), other.step(torque, HOLD)
        assert (plant.state == other.state).all()
        assert a.motor_work == b.motor_work and a.impact_loss == b.impact_loss
