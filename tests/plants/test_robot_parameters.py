"""Robot parameters: robots move as the machines do that are built with these numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Motor, Payload, Robot, Terrain
from jansen_env.plants.base import static_deflection
from jansen_env.plants.batch import Batch
from jansen_env.plants.parameters import EPISODE, effective, nominal
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.plants.robot_parameters import gravity_of, machine_of, terrain_of
from jansen_env.robot import Compliance
from jansen_env.robot.motor import MOTORS

GRAVITY = (0.0, -9.81)
RIGID = Robot(payload=Payload(0.4, 0.02, (0.02, 0.1)), motor=Motor(8.0, 6.0, 6.0, 20.0, 1e-4, 0.1))
FEET = Compliance(2e4, 60.0, 1.5e4, 40.0)
GIVING = replace(ROBOTS["paper_slender"](), motor=MOTORS["ak80_6"], pad_compliance=FEET)
DESIGNS = {"rigid": RIGID, "giving": GIVING}
CHANGES = {
    "friction": 0.5,
    "restitution": 0.4,
    "payload": 1.3,
    "payload_x": -0.1,
    "payload_y": 0.2,
    "mass_scale": 1.3,
    "inertia_scale": 0.6,
    "damping_scale": 1.7,
    "foot_stiffness_scale": 0.6,
    "foot_damping_scale": 1.5,
    "motor_strength": 0.7,
    "rotor_inertia_scale": 3.0,
    "tilt": 0.06,
    "gravity_scale": 0.9,
}
GROUND = Terrain.slope(0.05, 0.8)


def changed_row(robot, *names):
    """A row with some of :data:`CHANGES`, as far as the robot allows them."""
    row = nominal(robot, GROUND)
    for name in names:
        if name != "restitution" or robot.pad_compliance.rigid:
            row[name] = CHANGES[name]
    return row


def walked(batch, steps=40):
    """The states of a batch that goes for a walk with pushes; energies and forces of its last."""
    n = len(batch.states)
    batch.place(np.arange(n), np.full(n, 0.3))
    states = [batch.states.copy()]
    for _ in range(steps):
        torque = 12.0 * (1.5 - batch.states[:, 7]) + 2.0
        batch.step(torque, 20, pushes=np.full((n, 20, 2), 0.02))
        states.append(batch.states.copy())
    sums = [batch.accumulators[name] for name in batch.accumulators.dtype.names]
    return np.array(states), np.array(sums), batch.contact_force.copy()


@pytest.mark.parametrize("design", DESIGNS)
def test_varied_robots_are_those_built_so(design):
    """All parameters at once, and each alone, agree to 1e-10 after 240 time steps and to 1e-8 after
    800.
    """
    robot = DESIGNS[design]
    cases = [[], list(CHANGES), *([name] for name in CHANGES)]
    for case in cases[-len(CHANGES) :]:
        if "payload" in case[0]:
            case.insert(0, "payload")  # the place of one without mass says nothing
    rows = np.array([changed_row(robot, *names) for names in cases], EPISODE)
    batch = Batch([robot] * len(cases), [GROUND] * len(cases))
    every = np.arange(len(cases))
    batch.set_parameters(every, rows[np.roll(every, 1)])  # what comes next never builds on it
    batch.set_parameters(every, rows)
    states, sums, forces = walked(batch)
    for k, (names, row) in enumerate(zip(cases, rows, strict=True)):
        size = 9.81 * row["gravity_scale"]
        pull = -size * math.sin(row["tilt"]), -size * math.cos(row["tilt"])  # as on a slope
        other = Batch([machine_of(robot, row)], [terrain_of(GROUND, row)], gravity=pull)
        expected = walked(other)
        apart = np.abs(states[:, k] - expected[0][:, 0]).max(axis=1)
        assert apart[:13].max() < 1e-10 and apart.max() < 1e-8, names
        assert sums[:, k] == pytest.approx(expected[1][:, 0], rel=1e-7, abs=1e-9)
        assert forces[k] == pytest.approx(expected[2][0], rel=1e-7, abs=1e-7)
        assert np.abs(batch.properties[k]["mass"] - other.properties[0]["mass"]) < 1e-12
        for name in ("pitch_arm", "crank_arm", "winding", "stall_torque"):
            assert batch.properties[k][name] == pytest.approx(other.properties[0][name], rel=1e-12)
        same = (states[-1, k] == states[-1, 0]).all()
        assert same == (not set(names) & set(effective(robot))), names
    assert sums[list(batch.accumulators.dtype.names).index("push_work")].all()


@pytest.mark.parametrize("design", DESIGNS)
def test_a_row_that_changes_nothing_changes_no_bit(design):
    robot = DESIGNS[design]
    plain, other = (Batch([robot, robot], [GROUND] * 2) for _ in range(2))
    rows = np.array([changed_row(robot, *CHANGES)] * 2, EPISODE)
    other.set_parameters(np.arange(2), rows)
    assert (other.properties["mass"] > plain.properties["mass"]).all()
    other.set_parameters(np.arange(2), plain.parameters)
    for name in plain.properties.dtype.names:
        assert other.properties[name].tobytes() == plain.properties[name].tobytes()
    for a, b in zip(walked(plain), walked(other), strict=True):
        assert a.tobytes() == b.tobytes()


def test_the_rigid_body_plant_is_varied_alike():
    """Set down and driven, both backends are in the same state after 0.06 s; set back, it is as it
    was, to the bit.
    """
    ends = {}
    for name, make in {"projection": ProjectionPlant, "rigid_body": RigidBodyPlant}.items():
        batch = make(GIVING, GROUND).batch
        place = np.zeros(1, np.int64), np.array([0.3])
        batch.set_parameters(place[0], np.array([changed_row(GIVING, *CHANGES)], EPISODE))
        batch.place(*place)
        steps = round(0.06 / batch.time_step)
        batch.step(np.array([2.0]), steps, pushes=np.full((1, steps, 2), 1.0 / steps))
        ends[name] = batch.states[0, :4].copy()
        assert not batch.any_diverged
        again = make(GIVING, GROUND).batch
        batch.set_parameters(place[0], again.parameters)
        batch.place(*place)
        again.place(*place)
        assert batch.states.tobytes() == again.states.tobytes()
    assert np.abs(ends["projection"] - [0.0, 0.0, 0.0, 0.3]).max() > 0.02
    assert ends["rigid_body"] == pytest.approx(ends["projection"], abs=1e-3)


def test_another_ground_puts_its_friction_in_force():
    batch = Batch([GIVING] * 2, [GROUND] * 2)
    batch.set_terrain(1, Terrain.flat(0.3))
    for numbers in (batch.parameters, batch.properties):
        assert numbers["friction"].tolist() == [GROUND.friction, 0.3]


def test_what_is_in_force_counts_for_placing_and_forces():
    """Compliant feet sink in by the weight in force, which joint forces know, too."""
    row = changed_row(GIVING, *CHANGES)
    plant = ProjectionPlant(GIVING, GROUND)
    built = machine_of(GIVING, row)
    pull = gravity_of(GRAVITY, row)
    other = ProjectionPlant(built, terrain_of(GROUND, row), gravity=pull)
    plant.set_parameters(row)
    assert static_deflection(built, -pull[1]) > 1.2 * static_deflection(GIVING, 9.81)
    for each in (plant, other):
        each.batch.tracing = True
        each.reset(0.0, 0.3)
        each.step(2.0, 0.02)
    assert plant.state == pytest.approx(other.state, abs=1e-10)
    bearing, expected = (each.batch.joint_forces().bearing for each in (plant, other))
    assert bearing == pytest.approx(expected, rel=1e-6)
    assert plant.batch.peak_loads()[0] == pytest.approx(other.batch.peak_loads()[0], rel=1e-6)
    assert plant.energy() == pytest.approx(other.energy(), rel=1e-9)


@pytest.mark.parametrize("plant", [ProjectionPlant, RigidBodyPlant])
def test_refused(plant):
    plant = plant(GIVING, GROUND)
    plant.reset()
    before = plant.state
    for name, value, message in (
        ("mass_scale", 0.0, r"mass_scale must be between 0.01 and 100, got 0.0"),
        ("tilt", math.nan, "tilt must be between.*got nan"),
        ("restitution", 0.5, "restitution must be 0 with compliant pads.*got 0.5"),
    ):
        row = nominal(plant.robot, plant.terrain)
        row[name] = value
        with pytest.raises(ValueError, match=message):
            plant.set_parameters(row)
    assert plant.state.tobytes() == before.tobytes()
    row = nominal(plant.robot, plant.terrain)
    row["foot_stiffness_scale"] = 0.01
    row["mass_scale"] = 10.0
    plant.set_parameters(row)
    with pytest.raises(ValueError, match=r"stiffness must be at least .*, got 200\.0 N/m"):
        plant.reset()
