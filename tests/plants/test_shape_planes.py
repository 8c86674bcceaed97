"""Contact planes from pymunk, on height lines equal to the kernels'; walls, roofs and boxes."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pymunk
import pytest

from jansen_env import Compliance, Robot, Terrain
from jansen_env.engine.collision import SPECULATIVE_MARGIN
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.plants.shape_planes import ShapePlanes
from jansen_env.terrain import Piece, Shapes
from jansen_env.terrain.generators import LEVELS, make_generator

IDS = (
    "JansenWalker-v0",
    "JansenWalkerBuilt-v0",
    "JansenWalkerRough-v0",
    "JansenWalkerHardcore-v0",
    "JansenGoal-v0",
)
POSES = 10_000
FEET = Compliance(stiffness=2e4, damping=50.0)


def box(left, bottom, right, top):
    return Piece(((left, bottom), (right, bottom), (right, top), (left, top)))


FLOOR = box(-30.0, -1.0, 30.0, 0.0)


def random_centres(plant, row, terrain, rng):
    """Return the pads' centres of a robot at a random pose above the ground, but near it."""
    state = np.zeros(8)
    state[0] = rng.uniform(-8.0, 8.0)
    state[3] = rng.uniform(0.0, 2.0 * math.pi)
    state[2] = rng.uniform(-0.3, 0.3)
    plant.set_mechanical_state(row, state)
    centres = plant.pad_centres(row)
    above = (centres[:, 1] - terrain.height(centres[:, 0])).min()
    centres[:, 1] += rng.uniform(0.0, plant.robots[row].pad_radius + SPECULATIVE_MARGIN) - above
    return centres


def compare_planes(poses, change=lambda shapes: shapes):
    """Compare the kernels' planes with pymunk's; return the largest difference and their number."""
    rng = np.random.default_rng(0)
    worst = 0.0
    count = 0
    for env_id in IDS:
        envs = gym.make_vec(env_id, 20)
        envs.reset(seed=3)
        plant = envs.unwrapped.task.world.plant
        near = plant.robots[0].pad_radius + SPECULATIVE_MARGIN
        for row, terrain in enumerate(plant.terrains):
            shapes = change(ShapePlanes(terrain))
            for _ in range(poses // (len(IDS) * 20)):
                centres = random_centres(plant, row, terrain, rng)
                expected = plant.contact_planes(row, centres)
                planes = shapes.find(centres, near)
                assert [plane.pad for plane in planes] == [plane.pad for plane in expected]
                if planes:
                    worst = max(worst, float(np.abs(np.subtract(planes, expected)).max()))
                count += len(planes)
    return worst, count


def test_planes_on_height_lines_are_pymunks():
    """Compare the planes at 10,000 random poses on generated terrains of every id.

    No pad's centre is inside the ground, where a pad leaves a line and shapes in different ways.
    """
    worst, count = compare_planes(POSES)
    assert worst < 1e-11
    assert count > POSES


@pytest.mark.parametrize("answer", ["nothing", "nearest alone", "turned", "higher", "nearer"])
def test_the_comparison_notices_another_answer(monkeypatch, answer):
    """Alter pymunk's answers: the comparison must then find other planes."""
    query = pymunk.Space.point_query

    def other(*arguments):
        hits = query(*arguments)
        if answer == "nothing":
            return []
        if answer == "nearest alone":
            return sorted(hits, key=lambda hit: hit.distance)[:1]
        if answer == "turned":
            return [hit._replace(gradient=hit.gradient.rotated(1e-4)) for hit in hits]
        if answer == "nearer":
            return [hit._replace(distance=hit.distance - 1e-9) for hit in hits]
        return [hit._replace(point=hit.point + pymunk.Vec2d(0.0, 1e-9)) for hit in hits]

    monkeypatch.setattr(pymunk.Space, "point_query", other)
    with pytest.raises(AssertionError):
        assert compare_planes(POSES // 10)[0] < 1e-11


def test_a_step_on_shapes_asks_pymunk(monkeypatch):
    """A robot stands on shapes as long as pymunk finds them, and falls when pymunk finds none."""
    plant = ProjectionPlant(Robot(), Shapes((FLOOR,)))
    plant.reset()
    plant.step(0.0, 0.1)
    assert plant.step(0.0, 0.1).contact_force[:, 1].sum() > 0.0
    monkeypatch.setattr(pymunk.Space, "point_query", lambda *_: [])
    before = plant.state
    result = plant.step(0.0, 0.1)
    assert (result.contact_force == 0.0).all()
    assert plant.state[1] < before[1] - 0.04


def generated(kind):
    """Return a terrain of level 5, moved so that the robot does not start on its level part."""
    terrain = make_generator(kind)(np.random.default_rng(5), 5)
    return Terrain(tuple((x - 1.7 * (kind != "slope"), y) for x, y in terrain.points))


@pytest.mark.parametrize("kind", LEVELS)
@pytest.mark.parametrize("feet", [None, FEET])
def test_both_paths_walk_alike(kind, feet):
    """Walk 50 control steps on a height line and on the polygons below it.

    The states (m, rad, m/s, rad/s) differ by less than 1e-9: by about 1e-10 on a slope, whose
    polygons are 1 km long, and by about 1e-12 on other grounds.
    """
    line = generated(kind)
    grounds = line, Shapes.under(line)
    arguments = {"pad_compliance": feet, "terminate_when_fallen": False}
    envs = [gym.make("JansenWalker-v0", terrain=ground, **arguments) for ground in grounds]
    for env in envs:
        env.reset(seed=1)
    states = [env.unwrapped.get_state()["record"]["state"] for env in envs]
    for _ in range(50):
        for env in envs:
            env.step(np.array([0.6], np.float32))
        states = [env.unwrapped.get_state()["record"]["state"] for env in envs]
        np.testing.assert_allclose(states[1], states[0], rtol=0.0, atol=1e-9)
    assert abs(states[0][0]) > 0.05 or abs(states[0][3]) > 5.0


def drive(plant, steps=150, torque=10.0):
    """Let a robot walk; return its largest x, m, and the largest energy residual of a step, J."""
    farthest = plant.x
    residual = 0.0
    for _ in range(steps):
        result = plant.step(torque, 0.02)
        farthest = max(farthest, plant.x)
        residual = max(residual, abs(result.energy_residual))
    return farthest, residual


def test_a_wall_stops_the_robot():
    """Without a wall, the robot walks on. With one, it stops; no pad's centre enters the wall."""
    wall = box(1.0, -0.5, 1.3, 3.0)
    free, stopped = (ProjectionPlant(Robot(), Shapes(p)) for p in ((FLOOR,), (FLOOR, wall)))
    for plant in (free, stopped):
        plant.reset()
    assert drive(free)[0] > 1.5
    farthest, residual = drive(stopped)
    assert farthest < 0.5
    assert residual < 5e-3
    assert stopped.batch.pad_centres(0)[:, 0].max() < 1.0


@pytest.mark.parametrize("height", [0.03, 0.1, 0.3])
def test_a_box_is_climbed_or_not_as_on_the_height_line(height):
    """The robot climbs 3 cm and 10 cm on both grounds, and 30 cm on neither.

    After 4 s, the two positions differ by less than 0.1 m. The faces of a height line are no
    steeper than 80 degrees; those of a box are vertical.
    """
    run = height / math.tan(math.radians(79.0))
    line = Terrain(((-1.0, 0.0), (1.0 - run, 0.0), (1.0, height), (3.0, height)))
    ends = []
    for ground in (line, Shapes((FLOOR, box(1.0, -0.5, 30.0, height)))):
        plant = ProjectionPlant(Robot(), ground)
        plant.reset()
        ends.append(drive(plant, 200)[0])
    assert [end > 2.0 for end in ends] == [height < 0.2] * 2
    assert ends[1] == pytest.approx(ends[0], abs=0.1)


def test_an_overhang_stops_a_robot_or_lets_it_pass():
    """A roof above all joints does not change the walk. A lower roof stops the robot."""
    ends = []
    for bottom in (math.inf, 1.2, 0.9, 0.6, 0.3):
        roof = [box(0.9, bottom, 1.4, 2.0)] if bottom < math.inf else []
        plant = ProjectionPlant(Robot(), Shapes((FLOOR, *roof)))
        plant.reset()
        ends.append(drive(plant)[0])
    assert ends[0] == ends[1] > 1.5
    assert max(ends[2:]) < 0.5


def test_a_pad_touches_a_roof_from_below():
    """A roof stops a robot that flies up at 4 m/s, to within its way in a time step."""
    roof = box(-3.0, 1.5, 3.0, 2.0)
    plant = ProjectionPlant(Robot(), Shapes((FLOOR, roof)))
    state = np.zeros(8)
    state[1] = 1.0
    state[5] = 4.0
    plant.state = state
    highest = -math.inf
    for _ in range(12):
        result = plant.step(0.0, 0.02)
        highest = max(highest, plant.batch.pad_centres(0)[:, 1].max())
        assert abs(result.energy_residual) < 5e-3
    radius = plant.robot.pad_radius
    assert 1.5 - radius - 3e-3 < highest < 1.5 - radius + 3e-3
    assert plant.state[5] < 0.0


def test_a_robot_walks_over_a_ball():
    """The contact planes on a large ball are its tangents, and the robot walks over its top."""
    ball = Piece(((0.0, -50.0),), 50.0)
    plant = ProjectionPlant(Robot(), Shapes((ball,)))
    plant.reset()
    for plane in plant.batch.contact_planes(0):
        centre = plant.batch.pad_centres(0)[plane.pad]
        assert plane.distance == pytest.approx(math.hypot(centre[0], centre[1] + 50.0) - 50.0)
    assert drive(plant, 100)[0] > 0.5
    assert abs(plant.energy()) < math.inf


def test_seams_between_shapes_are_not_felt():
    """The robot walks on a floor of many boxes as on a single box, to 1e-9."""
    tiles = tuple(box(-3.0 + 0.1 * k, -1.0, -3.0 + 0.1 * (k + 1), 0.0) for k in range(100))
    ends = []
    for pieces in ((FLOOR,), tiles):
        plant = ProjectionPlant(Robot(), Shapes(pieces))
        plant.reset()
        drive(plant, 100)
        ends.append(plant.state)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=1e-9)


def test_a_pad_in_a_shape_comes_out_of_the_near_side():
    """Where two shapes overlap, the pad does not come out into the other shape."""
    shapes = ShapePlanes(Shapes((box(-1.0, -1.0, 0.05, 0.0), box(0.0, -1.0, 1.0, 0.0))))
    for x in (0.005, 0.045):
        planes = shapes.find(np.array([[x, -0.02]]), 0.06)
        assert {(plane.normal_x, plane.normal_y) for plane in planes} == {(0.0, 1.0)}
        assert planes[0].distance == pytest.approx(-0.02)
    post = ShapePlanes(Shapes((box(-0.02, -1.0, 0.02, 1.0),)))
    (plane,) = post.find(np.array([[0.015, 0.5]]), 0.06)
    assert (plane.normal_x, plane.normal_y) == (1.0, 0.0)


def test_a_robot_is_placed_from_above():
    """Some toes meet a box first. Where there is no shape, the robot is rejected."""
    plant = ProjectionPlant(Robot(), Shapes((FLOOR, box(0.3, 0.05, 0.6, 0.15))))
    plant.reset()
    planes = plant.batch.contact_planes(0)
    gaps = [plane.distance - plant.robot.pad_radius for plane in planes]
    assert min(gaps) == pytest.approx(-1e-5, abs=1e-8)
    assert plant.state[2] > 0.1
    with pytest.raises(ValueError, match=r"terrain must carry the robot at x = 50 m, got no shape"):
        plant.reset(50.0)


@pytest.mark.parametrize("feet", [None, FEET])
def test_the_rigid_body_plant_walks_on_shapes_as_on_the_line(feet):
    """The robot moves alike on one polygon and on level ground, with rigid and compliant feet."""
    robot = Robot() if feet is None else replace(Robot(), pad_compliance=feet)
    ends = []
    for ground in (Terrain.flat(), Shapes((FLOOR,))):
        plant = RigidBodyPlant(robot, ground)
        plant.reset()
        for _ in range(5):
            plant.step(6.0, 0.02)
        ends.append(plant.state)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=1e-6)
    assert abs(ends[0][3]) > 0.02


@pytest.mark.slow
def test_both_plants_stop_at_a_wall():
    """The wall stops the chassis at the same x, within the difference of the contact solvers."""
    grounds = Shapes((FLOOR,)), Shapes((FLOOR, box(0.62, -0.5, 0.9, 3.0)))
    ends = []
    for kind in (ProjectionPlant, RigidBodyPlant):
        for ground in grounds:
            plant = kind(Robot(), ground)
            plant.reset()
            ends.append(drive(plant, 40)[0])
        assert plant.batch.pad_centres(0)[:, 0].max() < 0.62
    free, stopped, other_free, other_stopped = ends
    assert min(free, other_free) > 0.15
    assert max(stopped, other_stopped) < 0.02
