"""A round pad on the ground: where it grips it rolls, where it slides its path is measured."""

from __future__ import annotations

import math

import numpy as np
import pytest
from walks import placed, shift

from jansen_env import Robot, Terrain
from jansen_env.robot.kinematics import T, coordinates, joint_positions

RADIUS = 0.03  # m, three times the default
POSES = [(1.0, 0.15), (1.0, -0.1), (4.0, 0.15), (4.0, -0.1)]  # crank angle, pitch from the slope


def on_one_toe(slope, psi, pitch, friction, time_step):
    """A plant set down with such a pitch that one toe carries all, and which one."""
    robot, terrain = Robot(pad_radius=RADIUS), Terrain.slope(slope, friction=friction)
    plant = placed(robot, terrain, psi, slope + pitch, time_step=time_step)
    load = plant.lookahead().contact_force[:, 1]
    assert np.count_nonzero(load) == 1
    return plant, int(np.argmax(load))


def pad(q, toe):
    """(3,) the pad's centre, m, and the angle of the foot link that it is part of, rad."""
    leg = Robot().legs[toe]
    place = joint_positions(Robot(), leg.side, q[3] + leg.phase)[T] @ [1.0, 1.0j]
    centre = q[0] + 1j * q[1] + np.exp(1j * q[2]) * place
    turn = q[2] + coordinates(Robot(), leg.side, q[3] + leg.phase)[21]
    return np.array([centre.real, centre.imag, turn])


@pytest.mark.parametrize("psi, pitch", POSES)
def test_a_gripping_toe_rolls(psi, pitch):
    """Swung about that toe for 0.1 s: along the slope by -radius * turn of the foot link.

    Error: 5 um of some 2 mm, of order h^2; off the slope a toe that opens for a step falls g h^2.
    """
    slope, errors = 0.2, []
    for h in (1e-3, 5e-4):
        plant, toe = on_one_toe(slope, psi, pitch, friction=20.0, time_step=h)
        start = pad(plant.state, toe)
        result = plant.step(20.0, 0.1)
        assert np.count_nonzero(result.contact_force[:, 1]) == 1 and result.slip.sum() == 0.0
        x, y, turn = pad(plant.state, toe) - start
        turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
        assert abs(RADIUS * turn) > 1e-3
        errors.append(x * math.cos(slope) + y * math.sin(slope) + RADIUS * turn)
        assert abs(y * math.cos(slope) - x * math.sin(slope)) <= 10.0 * h * h
    assert abs(errors[1]) <= 5e-6
    assert abs(errors[0] / errors[1]) > 3.5


@pytest.mark.parametrize("psi, pitch", POSES)
def test_slip_is_the_path_of_the_contact_point(psi, pitch):
    """Tangential velocity of the toe plus radius times its turning rate; 1e-4 m/s in 1e-5 s."""
    h = 1e-5
    plant, toe = on_one_toe(0.0, psi, pitch, friction=0.0, time_step=h)
    state = plant.state
    state[4:] = 0.3, 0.0, 1.0, 4.0

    def rate():  # of the pad, by central differences
        ahead, behind = state[:4] + h * state[4:], state[:4] - h * state[4:]
        return (pad(ahead, toe) - pad(behind, toe)) / (2.0 * h)

    state[5] -= rate()[1]  # neither lifts nor lands
    plant.state = state
    vx, vy, turning = rate()
    assert abs(vy) < 1e-9 and abs(RADIUS * turning) > 0.01
    result = plant.step(0.0, h)
    assert result.slip[toe] / h == pytest.approx(abs(vx + RADIUS * turning), abs=1e-4)
    assert result.contact_force[toe, 1] > 0.0


def test_a_toe_pushed_into_the_ground_comes_out():
    """1 mm deep: out to the 20 um that are left, slowly, and with no speed gained (1e-9 m/s)."""
    plant, heights = placed(psi=1.0, moved=shift(y=-1e-3), locked=True), []
    rest = plant.state[1] + 1e-3
    for _ in range(100):
        plant.step(0.0, plant.time_step)
        heights.append(plant.state[1] - rest)
        assert np.abs(plant.state[4:]).max() <= 1e-9
    assert (np.diff(heights) >= -1e-12).all() and heights[0] < -7e-4
    assert -2.1e-5 <= heights[-1] <= 0.0
