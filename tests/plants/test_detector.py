"""The ground as pymunk finds it: gaps and normals against geometry done by hand."""

import math

import numpy as np
import pymunk
import pytest

from jansen_env import Robot, Terrain, paper_robot
from jansen_env.engine.collision import SKIN, SPECULATIVE_MARGIN
from jansen_env.engine.records import ROBOT, WORLD
from jansen_env.plants.batch import Batch
from jansen_env.plants.detector import ContactDetector
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.plants.rigid_body import RigidBodyPlant
from jansen_env.terrain import make_terrain

RADIUS = 0.01  # m, of the pads
HILLS = Terrain(((-2.0, 0.5), (-1.0, 0.0), (0.0, 0.2), (1.0, 0.1), (2.0, 0.6)))


def make(terrains, capacity, extent=1e6):
    """A detector for robots on these terrains, whose axes are at the origin."""
    world = np.zeros(1, WORLD)
    world["capacity"] = capacity
    robots = np.zeros(len(terrains), ROBOT)
    robots["status"]["pad_radius"] = RADIUS
    detector = ContactDetector(robots, terrains, world, np.full(len(terrains), extent))
    find_candidates(detector, np.zeros((len(terrains), 2)))
    return detector


def find_candidates(detector, axes):
    """Let the broad phase find what is near robots with these crank axes (n, 2)."""
    states = np.zeros((len(axes), 8))
    states[:, :2] = axes
    detector.find_candidates(np.arange(len(axes)), states)


def detect(terrain, centres, capacity=None):
    """Planes (normal, offset), pads and gaps found for pads at ``centres``."""
    centres = np.asarray(centres, dtype=float)
    planes, pad = found(make([terrain], capacity or 4 * len(centres)), centres)
    return planes, pad, (planes[:, :2] * centres[pad]).sum(axis=1) - planes[:, 2] - RADIUS


def found(detector, centres, robot=0):
    """A robot's planes near pads at ``centres``, and the pads they are for."""
    rows = detector.planes_near(robot, centres)
    planes = np.stack([rows["normal_x"], rows["normal_y"], rows["offset"]], axis=1)
    return planes, rows["pad"].copy()


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


@pytest.mark.parametrize("kink", [0.1, 0.5])
def test_a_concave_corner_gives_two_planes(kink):
    """A pad in a valley is held by both sides, nearest first; gap to either side's line, 1e-12."""
    valley = Terrain(((-1.0, kink), (0.0, 0.0), (1.0, kink)))
    centre = np.array([0.001, 0.03])
    planes, pad, gaps = detect(valley, [centre])
    expected = [centre @ normal_of(slope) - RADIUS for slope in (kink, -kink)]
    assert pad.tolist() == [0, 0] and gaps == pytest.approx(expected, abs=1e-12)
    assert planes[0, :2] == pytest.approx(normal_of(kink), abs=1e-11)
    assert planes[1, :2] == pytest.approx(normal_of(-kink), abs=1e-11)


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
    """Whatever order pymunk has."""
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


@pytest.mark.parametrize("extent", [0.2, 1.0])
def test_planes_are_the_same_until_the_next_broad_phase(rng, extent):
    """Robots moved by up to SKIN see what each sees alone after a broad phase, bit for bit."""

    def around(places, reach):
        turn, share = rng.uniform(0.0, 2.0 * np.pi, len(places)), rng.uniform(0.0, 1.0, len(places))
        return places + reach * (share * [np.cos(turn), np.sin(turn)]).T

    for _ in range(10):
        terrains = [jagged(rng), HILLS, jagged(rng), Terrain.slope(-0.3)] * 5
        x = rng.uniform(1.0, 9.0, 20)
        ground = [terrain.height(place) for terrain, place in zip(terrains, x, strict=True)]
        start = np.column_stack([x, ground + rng.uniform(0.0, 0.3, 20)])
        moved = around(start, SKIN)
        detector = make(terrains, 400, extent)
        find_candidates(detector, start)
        numbers = []
        for robot in range(20):
            pads = around(moved[[robot] * 50], extent)
            planes, pad = found(detector, pads, robot)
            expected, expected_pad, _ = detect(terrains[robot], pads, capacity=400)
            assert np.array_equal(pad, expected_pad) and np.array_equal(planes, expected)
            numbers.append(len(pad))
        assert max(numbers) > 10


def test_placed_again_candidates_are_those_of_the_last_placement(rng):
    """Bit for bit what a broad phase finds there, wherever the robot has been in between."""
    terrain = jagged(rng)
    home, pads = np.array([[5.0, 0.6]]), np.array([[4.9, 0.02], [5.2, 0.04]])
    states = np.zeros((1, 8))
    states[:, :2] = home
    detector = make([terrain], 40, 1.0)
    detector.recall(np.arange(1), states)
    for x in (7.0, 9.0, 1.0):
        find_candidates(detector, np.array([[x, 0.6]]))
        detector.recall(np.arange(1), np.add(states, [0.1, 0.05, 0, 0, 0, 0, 0, 0]))
        planes, pad = found(detector, pads)
        expected, expected_pad, _ = detect(terrain, pads, capacity=40)
        assert len(pad) > 1
        assert np.array_equal(pad, expected_pad) and np.array_equal(planes, expected)


def test_placed_again_after_a_flight():
    """Far from where its circle is, a robot keeps its ground when pymunk is asked for another."""
    cliff = Terrain(((-20.0, 0.0), (20.0, 0.0), (40.0, -60.0), (300.0, -60.0)))
    batch = Batch([paper_robot()] * 2, [cliff] * 2, threads=1)
    batch.place(np.arange(2), np.zeros(2))
    flying, away = batch.states.copy()
    flying[:2], away[0] = (60.0, 5.0), away[0] + 2.0 * SKIN
    batch.set_state(0, flying)
    batch.step(np.zeros(2), 1)
    batch.place(np.arange(1), np.zeros(1))
    batch.set_state(1, away)
    for _ in range(2):
        batch.step(np.zeros(2), 20)
    weight = 9.81 * paper_robot().mass
    assert batch.contact_force[0, :, 1].sum() == pytest.approx(weight, rel=1e-3)


def test_planes_are_pymunks_own_contacts(rng):
    """Gaps and normals of pymunk's collision of the pad, with its margin, to 1e-11."""
    compared = 0
    for _ in range(40):
        terrain = jagged(rng)
        space, seen = pymunk.Space(), []
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
    """Six pads, room for three planes: those with the smallest gaps stay, in order of pads."""
    gaps = np.array([0.04, 0.01, 0.03, 0.0, 0.02, 0.045])
    centres = np.column_stack([np.arange(6.0), RADIUS + gaps])
    _, pad, found = detect(Terrain.flat(), centres, capacity=3)
    assert pad.tolist() == [1, 3, 4]
    assert found == pytest.approx(gaps[[1, 3, 4]], abs=1e-12)


def test_height_and_gradient():
    """Linear between vertices, first and last slope going on."""
    assert HILLS.height([-2.0, -0.5, 0.0, 0.5, 1.5, 3.0, -3.0]) == pytest.approx(
        [0.5, 0.1, 0.2, 0.15, 0.35, 1.1, 1.0], abs=1e-12
    )
    # On a stretch its own slope; at a vertex the mean of both sides'.
    assert HILLS.gradient([0.5, 1.5, 3.0]) == pytest.approx(
        (HILLS.height([0.6, 1.6, 3.1]) - HILLS.height([0.4, 1.4, 2.9])) / 0.2, abs=1e-9
    )
    ridge = Terrain(((-1.0, 0.0), (0.0, 0.3), (1.0, 0.2)))
    assert ridge.gradient(0.0) == pytest.approx(0.1, abs=1e-9)


def test_make_terrain():
    """Names, points and terrains; friction and restitution replace the terrain's own."""
    assert make_terrain("flat") == Terrain.flat()
    assert make_terrain("slope:0.2", friction=0.3) == Terrain.slope(0.2, friction=0.3)
    assert make_terrain([(0, 0), (1, 0.5)]) == Terrain(((0.0, 0.0), (1.0, 0.5)))
    assert make_terrain(HILLS, restitution=0.5) == Terrain(HILLS.points, 0.8, 0.5)


def test_rough_terrain():
    """Level up to its start, then within +- height; the generator alone decides."""
    rough = Terrain.rough(np.random.default_rng(3), height=0.03, start=2.0)
    x = np.linspace(2.2, 40.0, 1000)
    assert (rough.height(np.linspace(-5.0, 2.0, 50)) == 0.0).all()
    assert 0.02 < rough.height(x).max() <= 0.03 and -0.03 <= rough.height(x).min() < -0.02
    assert rough == Terrain.rough(np.random.default_rng(3), height=0.03, start=2.0)
    assert rough != Terrain.rough(np.random.default_rng(4), height=0.03, start=2.0)


@pytest.mark.parametrize("x", [-3e4, -1000.5, -999.5, 999.8, 1001.0, 2500.0, 1e5])
@pytest.mark.parametrize("angle", [0.0, 0.1])
def test_the_ground_has_no_end(x, angle):
    """Where pymunk's shapes end, and far beyond: one plane a pad, gap to 1e-10 of the way."""
    terrain = Terrain.slope(angle)
    centres = above(terrain, np.array([x, x + 0.3]), math.tan(angle), 0.004)
    planes, pad, gaps = detect(terrain, centres)
    assert pad.tolist() == [0, 1]
    assert gaps == pytest.approx(0.004, abs=1e-12 + 1e-10 * abs(x) * math.tan(angle))
    assert planes[:, :2] == pytest.approx(np.tile([-math.sin(angle), math.cos(angle)], (2, 1)))
    assert terrain.height(x) == pytest.approx(x * math.tan(angle), rel=1e-12, abs=1e-12)


def test_a_robot_walks_off_the_end_of_pymunks_ground():
    """The same step at x = 0 and at 5 km: the same motion, to what is lost in adding 5000."""
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
    with pytest.raises(ValueError, match=r"x is 5000\.0, must be between -99"):
        plant.reset(5000.0)
    state = plant.reset(990.0)
    state[0], state[4] = 995.9, 50.0
    plant.state = state
    with pytest.raises(FloatingPointError, match="the ground of the rigid-body plant ends"):
        plant.step(0.0, 0.02)


def test_nothing_is_kept_between_detections():
    """Detection elsewhere in between, or of the first pad alone, changes no bit of the next one."""
    detector = make([HILLS], 12)
    places = np.array([[-1.0, 0.02], [0.3, 0.18], [2.0, 0.6]])
    seen = []
    for centres in (places, places + 5.0, places[:1], places):
        find_candidates(detector, centres[:1])
        planes, pad = found(detector, centres)
        seen.append((len(pad), planes.tobytes(), pad.tobytes()))
    assert [number for number, *_ in seen] == [4, 0, 2, 4]
    assert seen[3] == seen[0]


def test_robots_in_one_space_see_what_each_sees_alone(rng):
    """30 robots, on three terrains, bit for bit."""
    grounds = [jagged(rng), HILLS, Terrain.slope(-0.3)]
    terrains = [grounds[i % 3] for i in range(30)]
    detector = make(terrains, 40, 1.0)
    axes = np.column_stack([rng.uniform(-1.0, 5.0, 30), np.full(30, 0.5)])
    find_candidates(detector, axes)
    for robot, terrain in enumerate(terrains):
        x = axes[robot, 0] + rng.uniform(-0.5, 0.5, 4)
        centres = np.column_stack([x, terrain.height(x) + rng.uniform(0.0, 0.06, 4)])
        planes, pad = found(detector, centres, robot)
        alone, alone_pad, _ = detect(terrain, centres, capacity=40)
        assert np.array_equal(planes, alone) and np.array_equal(pad, alone_pad)


def test_a_pad_that_sank_in_is_pushed_up():
    """With its centre below the surface the normal still points out of the ground."""
    planes, _, gaps = detect(
        Terrain.slope(0.2), above(Terrain.slope(0.2), [0.5], math.tan(0.2), -0.03)
    )
    assert gaps == pytest.approx([-0.03], abs=1e-12)
    assert planes[0, 1] > 0.0


@pytest.mark.parametrize("width", [0.4, 0.1, 0.02])
def test_a_bump_is_felt_where_it_is(width):
    """However narrow: 3 cm high, the gap of a pad over its top is exact."""
    bump = Terrain(((-1.0, 0.0), (0.0, 0.0), (0.5 * width, 0.03), (width, 0.0), (1.0, 0.0)))
    centre = [0.5 * width, 0.03 + RADIUS + 1e-3]
    _, _, gaps = detect(bump, [centre])
    assert gaps.min() == pytest.approx(1e-3, abs=1e-12)
