"""The robot with its crank at rest: it stands, and upside down it lies, as mechanics says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jansen_env import Robot, Terrain
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot.kinematics import joint_positions


@pytest.mark.parametrize("psi", [0.3, 2.0, 4.5])
def test_upside_down_it_comes_to_rest_on_its_bumpers(psi):
    """Dropped on its back with the crank locked: at rest after 4 s, pads no deeper than 0.1 mm."""
    plant = ProjectionPlant(Robot(), Terrain.flat())
    plant.prescribed_crank_speed = True
    plant.state = [0.0, 0.6, math.pi, psi, 0.0, 0.0, 0.0, 0.0]
    assert not plant.step(0.0, 0.05).non_toe_contact  # still falling
    plant.step(0.0, 4.0)
    result = plant.step(0.0, 0.1)
    assert result.non_toe_contact and (result.contact_force == 0.0).all()
    assert np.abs(plant.state[4:]).max() <= 1e-6
    x, y, theta = plant.state[:3]
    legs = plant.robot.legs
    joints = np.array([joint_positions(plant.robot, leg.side, psi + leg.phase) for leg in legs])
    height = y + (np.exp(1j * theta) * (joints @ [1.0, 1.0j])).imag - plant.robot.pad_radius
    assert -1e-4 <= height.min() <= 1e-9
    assert abs(x) < 0.1
