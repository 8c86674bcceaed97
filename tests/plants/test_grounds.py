"""The ground as kernels find it: gaps and normals against hand calculations and pymunk."""

import math

import numpy as np
import pymunk
import pytest

from jansen_env import Robot, Terrain
from jansen_env.engine.collision import MARGIN, SPECULATIVE_MARGIN, planes_near
from jansen_env.engine.records import PLANE, ROBOT, WORLD
from jansen_env.plants.grounds import FASTEST, Grounds
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant

RADIUS = 0.01  # m, of the pads
HILLS = Terrain(((-2.0, 0.5), (-1.0, 0.0), (0.0, 0.2), (1.0, 0.1), (2.0, 0.6)))


def detect(terrain, centres, capacity=None, axis=None, extent=1.0, duration=0.0):
    """Planes (normal, offset), pads and gaps found for pads at ``centres``.

    On the ground of a robot whose crank ``axis`` (x, m) was there when it was asked for; by default
    on all of it.
    """
    centres = np.asarray(centres, dtype=float)
    robots = np.zeros(1, ROBOT)
    world = np.zeros(1, WORLD)
    world["capacity"] = capacity or 4 * len(centres)
    status = robots["status"]
    status["pad_radius"] = RADIUS
    status["margin"] = SPECULATIVE_MARGIN
    grounds = Grounds([terrain], status)
    planes = np.zeros(world["capacity"][0], PLANE)
    grounds.find_stretch(0, axis or 0.0, extent if axis else 1e7, duration)
    planes_near(0, centres, robots, grounds.surface, world, planes)
    planes = planes[: status["end_plane"][0]]
    numbers = np.stack([planes["normal_x"], planes["normal_y"], planes["offset"]], axis=1)
    gaps = (numbers[:, :2] * centres[planes["pad"]]).sum(axis=1) - numbers[:, 2] - RADIUS
    return numbers, planes["pad"], gaps


def normal_of(slope):
    return np.array([-slope, 1.0]) / math.hypot(1.0, slope)


def above(terrain, x, slope, gap):
    """(n, 2) centres of pads with that gap over a straight stretch of the given slope."""
    return np.column_stack([x, terrain.height(x)]) + (RADIUS + gap) * normal_of(slope)


def test_pads_out_of_reach_are_not_listed():
    """Planes are found up to SPECULATIVE_MARGIN from the pad, and no farther."""
    near, far = RADIUS + SPECULATIVE_MARGIN - 1e-6, RADIUS + SPECULATIVE_MARGIN + 1e-6
    assert detect(Terrain.flat(), [[0.0, far], [1.0, near], [2.0, 5.0]])[1].tolist() == [1]


def test_no_ghost_at_a_joint_of_collinear_segments():
    """Pads over 21 vertices of one straight line see that line alone, wherever they are."""
    terrain = Terrain(tuple((x, 0.1 * x) for x in np.linspace(-1.0, 1.0, 21)))
    for gap in (0.001, -0.004):
        planes, pad, gaps = detect(terrain, above(terrain, np.linspace(-0.5, 0.5, 501), 0.1, gap))
        assert set(pad) == set(range(501))
        assert np.abs(gaps - gap).max() <= 1e-12
        assert np.abs(planes[:, :2] - normal_of(0.1)).max() <= 1e-12


def test_the_far_side_of_a_ridge_is_not_felt():
    """Beside a narrow ridge a pad feels the side that faces it and the ground, not the other."""
    ridge = Terrain(((-1.0, 0.0), (0.0, 0.0), (0.01, 0.04), (0.02, 0.0), (1.0, 0.0)))
    planes, _, gaps = detect(ridge, [[0.035, 0.012]])
    assert len(gaps) == 2 and gaps.min() > 0.0
    assert (planes[:, 0] >= 0.0).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("width", [0.0, 0.02])
def test_a_pad_deep_in_a_ridge_comes_out_of_the_near_side(side, width):
    """Its centre in the ground, a soft pad is not pushed out of the far side, from deeper in."""
    edge = 0.5 * width
    top = ((-edge, 0.0), (edge, 0.0)) if width else ((0.0, 0.0),)
    ridge = Terrain(((-edge - 1.0, -3.0), *top, (edge + 1.0, -3.0)))
    centre = np.array([side * (edge + 0.002), -0.02])
    planes, _, gaps = detect(ridge, [centre])
    np.testing.assert_allclose(planes[:, :2], [normal_of(-3.0 * side)], atol=1e-11)
    expected = (centre - [side * edge, 0.0]) @ normal_of(-3.0 * side) - RADIUS
    assert gaps == pytest.approx([expected], abs=1e-12)


def test_order_is_by_pad_then_nearest_first():
    """The order of the segments does not matter."""
    rng = np.random.default_rng(1)
    x = rng.uniform(-3.0, 3.0, 40)
    centres = np.column_stack([x, HILLS.height(x) + rng.uniform(0.0, 0.05, 40)])
    centres[:3, 0] = -1.0  # three in the valley, which see two planes each
    centres[:3, 1] = [0.02, 0.03, 0.04]
    _, pad, gaps = detect(HILLS, centres)
    assert (np.diff(pad) >= 0).all() and (np.diff(gaps)[np.diff(pad) == 0] >= -1e-15).all()
    assert (pad[:6] == [0, 0, 1, 1, 2, 2]).all()


def jagged(rng, spacing=0.05, count=200):
    """Steep and narrow ridges and grooves."""
    x = spacing * np.arange(count) + rng.uniform(-0.3, 0.3, count) * spacing
    return Terrain(tuple(zip(x, rng.uniform(-0.06, 0.06, count), strict=True)))


@pytest.mark.parametrize("extent, duration", [(0.2, 0.0), (1.0, 0.02)])
def test_a_stretch_has_all_that_a_robot_can_reach(rng, extent, duration):
    """Robots moved by all their room see what they would on the whole ground, bit for bit."""
    room = MARGIN + FASTEST * duration
    most = 0
    for k in range(200):
        terrain = [jagged(rng, 0.05, 1000), HILLS, Terrain.slope(-0.3)][k % 3]
        axis = rng.uniform(15.0, 25.0)
        x = axis + rng.choice([-room, room]) + rng.uniform(-extent, extent, 20)
        pads = np.column_stack([x, terrain.height(x) + rng.uniform(-0.02, 0.06, 20)])
        planes, pad, _ = detect(terrain, pads, 400, axis, extent, duration)
        expected, expected_pad, _ = detect(terrain, pads, 400)
        assert np.array_equal(pad, expected_pad) and np.array_equal(planes, expected)
        most = max(most, len(pad))
    assert most > 30


def test_a_step_that_leaves_the_stretch_is_refused():
    """Faster than 200 m/s along the ground a robot has diverged; at 150 m/s it keeps its ground."""
    plant = ProjectionPlant(Robot(), Terrain.flat(0.0), gravity=0.0)
    for speed, duration in ((150.0, 0.02), (150.0, 0.2), (-150.0, 0.02)):
        state = plant.reset()
        plant.state = state + np.eye(8)[4] * speed
        plant.step(0.0, duration)
        assert plant.x == pytest.approx(speed * duration, rel=1e-3)
        assert plant.batch.contact_frames(0)[0][1:3, 1] == pytest.approx(0.0, abs=2e-5)
    plant = ProjectionPlant(Robot(), Terrain.flat(0.0), gravity=0.0)
    plant.reset()
    plant.step(0.0, 0.02)
    state = plant.state = plant.state + np.eye(8)[4] * 300.0
    with pytest.raises(FloatingPointError, match="diverged"):
        plant.step(0.0, 0.02)
    assert (plant.state == state).all()


def test_planes_are_pymunks_own_contacts(rng):
    """Gaps and normals are those of pymunk's collision of the pad, with its margin, to 1e-11."""
    compared = 0
    for _ in range(40):
        terrain = jagged(rng)
        space = pymunk.Space()
        seen = []
        terrain.add_to(space)
        x = rng.uniform(1.0, 9.0)
        centre = np.array([x, terrain.height(x) + rng.uniform(0.0, 0.06)])
        body = pymunk.Body(1.0, math.inf)
        body.position = tuple(centre)
        circle = pymunk.Circle(body, RADIUS + SPECULATIVE_MARGIN)
        space.add(body, circle)
        for hit in space.shape_query(circle):
            points = hit.contact_point_set
            normal = -np.array(points.normal)
            if normal[1] > 0.0:
                seen.append([*normal, np.hypot(*(centre - points.points[0].point_b)) - RADIUS])
        planes, _, gaps = detect(terrain, [centre], capacity=40)
        for normal_x, normal_y, gap in seen:
            apart = np.abs(planes[:, :2] - [normal_x, normal_y]).sum(axis=1) + np.abs(gaps - gap)
            assert apart.min() < 1e-11
        compared += len(seen)
    assert compared > 40


def test_the_nearest_planes_are_kept_when_there_is_no_room():
    """Of six pads with room for three planes, those with the smallest gaps stay, in order
    of pads.
    """
    gaps = np.array([0.04, 0.01, 0.03, 0.0, 0.02, 0.045])
    centres = np.column_stack([np.arange(6.0), RADIUS + gaps])
    _, pad, kept = detect(Terrain.flat(), centres, capacity=3)
    assert pad.tolist() == [1, 3, 4]
    assert kept == pytest.approx(gaps[[1, 3, 4]], abs=1e-12)


def test_a_robot_walks_off_the_end_of_the_line():
    """A step at x = 0 and one at 5 km give the same motion, to what is lost in adding 5000."""
    motions = []
    for x in (0.0, 5000.0):
        plant = ProjectionPlant(Robot(), Terrain.flat(0.3))
        start = plant.reset(x, 0.3)
        for _ in range(50):
            plant.step(15.0 - 5.0 * plant.state[7], 0.02)
        motions.append(plant.state - start)
    assert motions[1] == pytest.approx(motions[0], abs=1e-7)
    assert motions[0][3] > 1.0  # rad the crank has turned


def test_the_rigid_body_plant_says_where_its_ground_ends():
    """A placement beyond it is refused, and so is a step that leads there."""
    plant = RigidBodyPlant(Robot(), Terrain.flat())
    with pytest.raises(ValueError, match=r"x must be between -996\.0 and 996\.0, got 5000\.0"):
        plant.reset(5000.0)
    state = plant.reset(990.0)
    state[0] = 995.9
    state[4] = 50.0
    plant.state = state
    with pytest.raises(FloatingPointError, match="the ground of the rigid-body plant ends"):
        plant.step(0.0, 0.02)
