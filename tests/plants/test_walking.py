"""Contacts of a robot that walks, rolls on a pad, or lies on its back."""

import math

import numpy as np
import pytest
from motions import placed, toes_of

from jansen_env import Robot, Terrain
from jansen_env.robot.kinematics import joint_positions


@pytest.mark.parametrize("psi", [0.3, 2.0, 4.5])
def test_upside_down_it_comes_to_rest_on_its_bumpers(psi):
    """Dropped on its back with the crank locked, it rests after 4 s, with pads no deeper than 0.1
    mm.
    """
    plant = placed(state=[0.0, 0.6, math.pi, psi, 0.0, 0.0, 0.0, 0.0], locked=True)
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


RADIUS = 0.03  # m, three times the default
POSES = [(1.0, 0.15), (1.0, -0.1), (4.0, 0.15), (4.0, -0.1)]  # crank angle, pitch from the slope


def on_one_toe(slope, psi, pitch, friction, time_step):
    """A plant set down with such a pitch that one toe carries all, and which one."""
    robot = Robot(pad_radius=RADIUS)
    terrain = Terrain.slope(slope, friction=friction)
    plant = placed(robot, terrain, psi, slope + pitch, time_step=time_step)
    load = plant.lookahead().contact_force[:, 1]
    assert np.count_nonzero(load) == 1
    return plant, int(np.argmax(load))


@pytest.mark.parametrize("psi, pitch", POSES)
def test_a_gripping_toe_rolls(psi, pitch):
    """Swung about that toe for 0.1 s, it moves along the slope by -radius * turn of the foot link.

    The error is 5 um of some 2 mm, of order h^2; off the slope, a toe that opens for a step falls
    by g h^2.
    """
    slope = 0.2
    errors = []
    for h in (1e-3, 5e-4):
        plant, toe = on_one_toe(slope, psi, pitch, friction=20.0, time_step=h)
        start = toes_of(plant.robot, plant.state)[toe]
        result = plant.step(20.0, 0.1)
        assert np.count_nonzero(result.contact_force[:, 1]) == 1 and result.slip.sum() == 0.0
        x, y, turn = toes_of(plant.robot, plant.state)[toe] - start
        turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
        assert abs(RADIUS * turn) > 1e-3
        errors.append(x * math.cos(slope) + y * math.sin(slope) + RADIUS * turn)
        assert abs(y * math.cos(slope) - x * math.sin(slope)) <= 10.0 * h * h
    assert abs(errors[1]) <= 5e-6
    assert abs(errors[0] / errors[1]) > 3.5


@pytest.mark.parametrize("psi, pitch", POSES)
def test_slip_is_the_path_of_the_contact_point(psi, pitch):
    """Its speed is the tangential velocity of the toe plus radius times its turning rate, to 1e-4
    m/s in 1e-5 s.
    """
    h = 1e-5
    plant, toe = on_one_toe(0.0, psi, pitch, friction=0.0, time_step=h)
    state = plant.state
    state[4:] = 0.3, 0.0, 1.0, 4.0

    def rate():  # of the pad, by central differences
        ahead, behind = state[:4] + h * state[4:], state[:4] - h * state[4:]
        return (toes_of(plant.robot, ahead) - toes_of(plant.robot, behind))[toe] / (2.0 * h)

    state[5] -= rate()[1]  # neither lifts nor lands
    plant.state = state
    vx, vy, turning = rate()
    assert abs(vy) < 1e-9 and abs(RADIUS * turning) > 0.01
    result = plant.step(0.0, h)
    assert result.slip[toe] / h == pytest.approx(abs(vx + RADIUS * turning), abs=1e-4)
    assert result.contact_force[toe, 1] > 0.0
