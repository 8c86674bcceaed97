"""The projection plant as a machine: same bits every time, copies that go on, refusals."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import Bar, LinkageError, Robot, Terrain
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.rigid_body import RigidBodyPlant

ROUGH = Terrain.rough(np.random.default_rng(7), start=-20.0)


def run(plant, torques):
    """Bits of all states and results; steps of 0.013 s fit no interval between two looks."""
    bits = []
    for torque in torques:
        result = plant.step(torque, 0.013)
        bits.append(plant.state.tobytes() + pickle.dumps(tuple(map(np.asarray, result))))
    return bits


@pytest.fixture
def torques(rng):
    return rng.uniform(-20.0, 20.0, 500).tolist()


@pytest.mark.parametrize("terrain", [Terrain.flat(), ROUGH], ids=["flat", "rough"])
def test_same_inputs_same_bits(terrain, torques):
    """Two plants, or one plant set down again: not one bit differs in 6.5 s of random torque."""
    first, second = (ProjectionPlant(Robot(), terrain) for _ in range(2))
    first.reset(0.0, 0.3)
    second.reset(0.0, 0.3)
    bits = run(first, torques)
    assert run(second, torques) == bits
    first.reset(0.0, 0.3)
    assert run(first, torques) == bits
    assert len(set(bits)) == len(bits)  # and something moved


@pytest.mark.parametrize("terrain", [Terrain.flat(), ROUGH], ids=["flat", "rough"])
def test_a_pickled_plant_goes_on_with_the_same_bits(terrain, torques):
    """Pickled half way, and likewise when only the state is carried to another plant."""
    plant, other = (ProjectionPlant(Robot(), terrain, time_step=5e-4) for _ in range(2))
    plant.reset(0.0, 0.3)
    run(plant, torques[:250])
    copy = pickle.loads(pickle.dumps(plant))
    other.state = plant.state
    bits = run(plant, torques[250:])
    assert run(copy, torques[250:]) == bits
    assert run(other, torques[250:]) == bits


def test_a_pickled_plant_keeps_its_arguments():
    """Robot, terrain, time steps, gravity and the brake."""
    plant = ProjectionPlant(Robot(pad_radius=0.02), ROUGH, 2e-3, 1.62, detection_interval=4e-3)
    plant.prescribed_crank_speed = True
    copy = pickle.loads(pickle.dumps(plant))
    for name in (
        "robot",
        "terrain",
        "time_step",
        "gravity",
        "detection_interval",
        "prescribed_crank_speed",
    ):
        assert getattr(copy, name) == getattr(plant, name), name


def test_states_are_copies():
    """Writing to a state that was handed out changes nothing inside."""
    plant = ProjectionPlant(Robot(), Terrain.flat())
    handed = plant.reset(0.0, 0.3)
    before = plant.state
    handed[:] = 7.0
    plant.state[:] = 7.0
    toes = plant.toe_positions()
    plant.toe_positions()[:] = 7.0
    assert (plant.state == before).all() and (plant.toe_positions() == toes).all()


def test_peek_changes_nothing():
    """It tells what a time step without torque would do; the future stays the same to the bit."""
    plant = ProjectionPlant(Robot(), Terrain.flat())
    plant.reset(0.0, 0.3)
    plant.step(5.0, 0.1)
    before = plant.state
    peeked = plant.lookahead()
    assert (plant.state == before).all()
    step = plant.step(0.0, plant.time_step)
    assert (peeked.contact_force == step.contact_force).all() and step.contact_force.any()


@pytest.mark.parametrize("terrain", [Terrain.flat(), Terrain.slope(0.2), ROUGH])
@pytest.mark.parametrize("pitch", [None, 0.0, 0.15])
def test_set_down_on_the_lowest_toes(terrain, pitch):
    """No gap under the lowest toe, none sunk in but for the depth by which toes are pressed."""
    plant = ProjectionPlant(Robot(), terrain)
    state = plant.reset(0.5, 1.0, pitch)
    assert state[0] == 0.5 and state[3] == 1.0 and (state[4:] == 0.0).all()
    assert pitch is None or state[2] == pitch
    points, tangents = plant.contact_frames()
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    toes = plant.toe_positions()
    # A toe's lowest point along the normal is where its pad meets the ground, if it has no gap.
    depth = terrain.height(points[:, 0]) - points[:, 1]
    assert toes == pytest.approx(points + plant.robot.pad_radius * normals, abs=1e-12)
    assert depth.max() == pytest.approx(PLACEMENT_DEPTH, abs=1e-8)
    assert plant.lookahead().contact_force[:, 1].max() > 0.0


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"time_step": 0.0}, "time_step is 0.0"),
        ({"gravity": -9.81}, "gravity is -9.81"),
        ({"gravity": (0.0,)}, r"gravity is \(0.0,\)"),
        ({"gravity": (0.0, float("nan"))}, "gravity is nan"),
        ({"detection_interval": float("nan")}, "detection_interval is nan"),
    ],
)
def test_bad_arguments(arguments, message):
    """ValueError names the argument and the value."""
    with pytest.raises(ValueError, match=message):
        ProjectionPlant(Robot(), Terrain.flat(), **arguments)


def test_set_down_touches_a_rounded_ridge_everywhere():
    """Over the top, too, where the ground lies below the corner: a loaded toe within 2 ms."""
    plant = ProjectionPlant(Robot(), Terrain(((-1.0, -0.2), (0.0, 0.0), (1.0, -0.2))))
    for x in np.linspace(-0.6, 0.6, 121):
        plant.reset(x, 1.0, pitch=0.1)
        assert plant.step(0.0, 2.0 * plant.time_step).contact_force[:, 1].max() > 0.0


def test_bad_states_and_robots():
    """A state is eight finite numbers; a robot must be able to turn its crank."""
    plant = ProjectionPlant(Robot(), Terrain.flat())
    for state in ([0.0] * 7, [0.0] * 7 + [float("nan")]):
        with pytest.raises(ValueError, match="must be 8 finite numbers"):
            plant.state = state
    with pytest.raises(LinkageError, match="joint C"):
        ProjectionPlant(replace(Robot(), crank=Bar(0.2)), Terrain.flat())


ABSURD_TORQUES = """
from jansen_env import Robot, Terrain
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.plants.projected import ProjectionPlant
plant = ProjectionPlant(Robot(), Terrain.flat())
for power in range(6, 15):
    for crank_angle in (0.0, 0.3, 1.0):
        plant.reset(0.0, crank_angle)
        try:
            plant.step(10.0**power, 0.1)
        except FloatingPointError:
            print("reported")
"""


def test_divergence_is_reported():
    """Absurd torques all end in FloatingPointError: no NaN passes, and the process lives on."""
    code = [sys.executable, "-c", ABSURD_TORQUES]
    ended = subprocess.run(code, capture_output=True, text=True, check=False)
    assert ended.returncode == 0
    assert ended.stdout.split() == ["reported"] * 27


@pytest.mark.parametrize("plant", [ProjectionPlant, RigidBodyPlant])
@pytest.mark.parametrize("argument", ["x", "crank_angle", "pitch"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), "a"])
def test_placements_are_checked(plant, argument, value):
    """Numbers that are none are named; the robot stays where it was."""
    placed = plant(Robot(), Terrain.flat())
    before = placed.reset(0.0, 0.3)
    with pytest.raises(ValueError, match=f"{argument} is"):
        placed.reset(**{argument: value})
    assert (placed.state == before).all()
