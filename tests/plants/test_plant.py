"""The projection plant as a machine: same bits every time, copies that go on, refusals."""

import math
import pickle

import numpy as np
import pytest
from motions import depth

from jansen_env import ROBOTS, Bar, LinkageError, Robot, Terrain
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.plants.base import static_deflection
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.robot.lengths import lengths, with_lengths

ROUGH = Terrain.rough(np.random.default_rng(7), start=-20.0)
STEPS = Terrain.steps(np.random.default_rng(7), height=0.2, start=0.1)


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
    """This holds for two backends, for one set down again, for one pickled half way, and for one
    with the state of another.
    """
    arguments = Robot(pad_radius=0.02), terrain, 5e-4, 1.62
    first, second, third = (ProjectionPlant(*arguments) for _ in range(3))
    first.reset(0.0, 0.3)
    bits = run(first, torques)
    assert len(set(bits)) == len(bits)  # and something moved
    for plant in (first, second):
        plant.reset(0.0, 0.3)
        assert run(plant, torques[:250]) == bits[:250]
    third.state = second.state
    copy = pickle.loads(pickle.dumps(second))
    for plant in (second, third, copy):
        assert run(plant, torques[250:]) == bits[250:]
    second.prescribed_crank_speed = True
    copy = pickle.loads(pickle.dumps(second))
    for name in ("robot", "terrain", "time_step"):
        assert getattr(copy, name) == getattr(second, name), name
    assert copy.prescribed_crank_speed


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
    """A look ahead returns what a time step without torque would do; the future stays the same to
    the bit.
    """
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
    """There is no gap under the lowest toe, and no toe is sunk in but for the depth by which toes
    are pressed.
    """
    plant = ProjectionPlant(Robot(), terrain)
    state = plant.reset(0.5, 1.0, pitch)
    assert state[0] == 0.5 and state[3] == 1.0 and (state[4:] == 0.0).all()
    assert pitch is None or state[2] == pitch
    points, tangents = plant.batch.contact_frames(0)
    normals = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    toes = plant.toe_positions()
    # A toe's lowest point along the normal is where its pad meets the ground, if it has no gap.
    depth = terrain.height(points[:, 0]) - points[:, 1]
    assert toes == pytest.approx(points + plant.robot.pad_radius * normals, abs=1e-12)
    assert depth.max() == pytest.approx(PLACEMENT_DEPTH, abs=1e-8)
    assert plant.lookahead().contact_force[:, 1].max() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("make", [ProjectionPlant, RigidBodyPlant])
@pytest.mark.parametrize("name", ROBOTS)
def test_set_down_on_the_lowest_of_all_pads(name, make, rng):
    """Lengths vary by up to 60 %, on any ground; the first step gets no energy from nothing."""
    nominal = ROBOTS[name]()
    placed = 0
    wanted = PLACEMENT_DEPTH if make is ProjectionPlant else 0.0
    while placed < 6:
        changed = rng.choice([*lengths(nominal)], rng.integers(1, 4), replace=False)
        given = {name: lengths(nominal)[name] * rng.uniform(0.4, 1.6) for name in changed}
        terrain = [Terrain.flat(), ROUGH, STEPS][placed % 3]
        try:
            plant = make(with_lengths(nominal, given), terrain)
            plant.reset(rng.uniform(-10.0, 10.0), rng.uniform(0.0, 2.0 * math.pi))
        except ValueError:
            continue
        rigid = plant.robot.pad_compliance.rigid
        sag = 0.0 if rigid else static_deflection(plant.robot, GRAVITY)  # as on level ground
        assert -1e-9 < depth(plant, plant.batch.pad_centres(0)) < wanted + sag + 1e-6, given
        result = plant.step(0.0, 0.01)
        assert result.correction_work < 1e-2, given
        placed += 1


def test_what_a_robot_in_the_ground_gets_from_nothing():
    """It is in the account: 2 J for 7 cm, and neither in losses nor in the residual."""
    plant = ProjectionPlant(Robot(), Terrain.flat())
    plant.reset(0.0, 1.0)
    before = plant.energy()
    plant.state = plant.state - [0.0, 0.07, *[0.0] * 6]
    deep = plant.energy()
    results = [plant.step(0.0, 0.02) for _ in range(5)]
    gained = sum(result.correction_work for result in results)
    assert gained == pytest.approx(before - deep, rel=0.1) and gained > 2.0
    assert all(result.impact_loss > -1e-6 for result in results)
    assert max(abs(result.energy_residual) for result in results) < 1e-3


def projection(robot=None, **arguments):
    return ProjectionPlant(robot or Robot(), Terrain.flat(), **arguments)


def rigid_body(robot=None, **arguments):
    return RigidBodyPlant(robot or Robot(), Terrain.flat(), **arguments)


def held(robot=None, **arguments):
    return projection(robot, fixed_chassis=True, **arguments)


TOO_LONG = Robot().with_bodies(crank=Bar(0.2))
REFUSED = [
    *(
        (make, {name: value}, None, f"{name} must be .*, got {value}")
        for make in (projection, rigid_body)
        for name, value in (("time_step", 0.0), ("gravity", -9.81))
    ),
    *((make, {"robot": TOO_LONG}, None, "joint C") for make in (projection, rigid_body)),
    (projection, {"gravity": (0.0,)}, None, r"gravity must be .*, got \(0.0,\)"),
    (projection, {"gravity": (0.0, math.nan)}, None, "gravity must be .*, got nan"),
    *((make, {}, state, r"state must be 8 finite numbers, within 1e\+12")
      for make in (projection, rigid_body) for state in ([0.0] * 7, [math.nan] * 8)),
    (held, {}, np.ones(8), "fixed chassis does not move"),
    (rigid_body, {"fixed_chassis": True}, np.ones(8), "fixed chassis does not move"),
]  # fmt: skip


@pytest.mark.parametrize("make, arguments, state, message", REFUSED)
def test_bad_arguments_and_states(make, arguments, state, message):
    """ValueError names the argument and the value; a robot must be able to turn its crank."""
    error = LinkageError if "robot" in arguments else ValueError
    with pytest.raises(error, match=message):
        make(**arguments).state = state


def test_a_held_crank_that_diverges_stays():
    plant = held()
    before = plant.state
    with pytest.raises(FloatingPointError, match=f"under a torque of {1e9}"):
        plant.step(1e9, 0.1)
    assert (plant.state == before).all()


def test_joints_that_come_apart():
    """The simulation diverges within a few time steps, before rounding decides how it ends."""
    for torque, duration, message in ((1e4, 0.1, "came apart"), (1e6, 0.02, "simulation diverged")):
        with pytest.raises(FloatingPointError, match=message):
            rigid_body(time_step=0.02).step(torque, duration)


@pytest.mark.parametrize("make", [projection, rigid_body])
@pytest.mark.parametrize("argument", ["x", "crank_angle", "pitch"])
def test_placements_are_checked(make, argument):
    """Values that are not numbers are named, and the robot stays where it was."""
    placed = make()
    before = placed.reset(0.0, 0.3)
    for value in (math.nan, math.inf, "a"):
        with pytest.raises(ValueError, match=f"{argument} must be a finite number"):
            placed.reset(**{argument: value})
        assert (placed.state == before).all()
