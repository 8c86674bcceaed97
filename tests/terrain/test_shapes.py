"""Grounds that users make from pymunk's shapes: copies, height lines, and rejected shapes."""

import copy
import math
import pickle

import gymnasium as gym
import numpy as np
import pymunk
import pytest

from jansen_env import Terrain
from jansen_env.plants.mujoco_model import to_mjcf
from jansen_env.plants.shape_planes import ShapePlanes
from jansen_env.robot import paper_robot
from jansen_env.terrain import Piece, Shapes, make_ground
from jansen_env.viewer.recorder import Recorder

ID = "JansenWalker-v0"
BODIES = []
"""Bodies of the shapes below; a shape keeps no reference to its body."""


def static(**motion):
    body = pymunk.Body(body_type=pymunk.Body.STATIC)
    for name, value in motion.items():
        setattr(body, name, value)
    BODIES.append(body)
    return body


def box(left, bottom, right, top, body=None):
    corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
    return pymunk.Poly(body or static(), corners)


def floor():
    return box(-30.0, -1.0, 30.0, 0.0)


def test_all_kinds_are_copied_to_where_their_bodies_are():
    body = static(position=(0.5, -1.0), angle=0.5 * math.pi)
    shapes = [
        pymunk.Circle(body, 0.4, (1.0, 0.0)),
        pymunk.Segment(body, (0.0, -1.0), (0.0, 1.0), 0.1),
        box(0.0, 0.0, 2.0, 1.0, body),
    ]
    ground = make_ground(shapes)
    circle, segment, polygon = ground.pieces
    np.testing.assert_allclose(circle.points, [(0.5, 0.0)], atol=1e-12)
    np.testing.assert_allclose(segment.points, [(1.5, -1.0), (-0.5, -1.0)], atol=1e-12)
    assert (circle.radius, segment.radius, polygon.radius) == (0.4, 0.1, 0.0)
    expected = {(0.5, -1.0), (0.5, 1.0), (-0.5, 1.0), (-0.5, -1.0)}
    assert {(round(x, 9), round(y, 9)) for x, y in polygon.points} == expected
    assert (ground.friction, ground.restitution) == (0.8, 0.0)


def test_a_users_space_stays_as_it_is():
    """Later changes of the space do not change the ground, either."""
    space = pymunk.Space()
    shape = box(-9.0, -1.0, 9.0, 0.0, space.static_body)
    space.add(shape)
    env = gym.make(ID, terrain=space)
    env.reset(seed=0)
    before = env.unwrapped.terrain
    assert list(space.shapes) == [shape] and not space.bodies
    space.remove(shape)
    env.reset(seed=0)
    assert env.unwrapped.terrain == before
    np.testing.assert_allclose(
        env.step(np.array([0.3], np.float32))[4]["x_position"], 0.0, atol=0.1
    )


def test_a_ground_of_shapes_is_a_value():
    """Grounds with the same shapes in any order are equal; they can be copied and pickled."""
    grounds = []
    for turn in (1, -1):
        space = pymunk.Space()
        body = space.static_body
        space.add(*[box(-9.0, -1.0, 9.0, 0.0, body), pymunk.Circle(body, 0.3, (1.0, 0.0))][::turn])
        grounds.append(make_ground(space))
    ground, other = grounds
    assert ground == other and hash(ground) == hash(other)
    for same in (copy.deepcopy(ground), pickle.loads(pickle.dumps(ground))):
        assert same == ground
    assert make_ground(ground, friction=0.3) != ground
    assert make_ground(ground, friction=0.3).friction == 0.3


def test_thin_segments_from_left_to_right_are_a_height_line():
    """Segments may have any order and direction. A vertical face or a radius makes them shapes."""
    points = [(-2.0, 0.0), (-0.5, 0.1), (1.0, 0.0), (3.0, 0.5)]
    pairs = [(points[2], points[1]), (points[2], points[3]), (points[0], points[1])]
    segments = [pymunk.Segment(static(), a, b, 0.0) for a, b in pairs]
    assert make_ground(segments) == Terrain(tuple(points))
    wall = pymunk.Segment(static(), (3.0, 0.5), (3.0, 1.0), 0.0)
    assert isinstance(make_ground([*segments, wall]), Shapes)
    segments[0].unsafe_set_radius(0.01)
    assert isinstance(make_ground(segments), Shapes)


def test_friction_and_elasticity_are_those_of_the_shapes():
    """All shapes must have the same values. The arguments of an environment replace them."""
    shapes = [floor(), box(1.0, 0.0, 2.0, 0.1)]
    for shape in shapes:
        shape.friction = 0.5
        shape.elasticity = 0.2
    env = gym.make(ID, terrain=shapes)
    assert (env.unwrapped.terrain.friction, env.unwrapped.terrain.restitution) == (0.5, 0.2)
    env = gym.make(ID, terrain=shapes, friction=0.3, restitution=0.0)
    assert (env.unwrapped.terrain.friction, env.unwrapped.terrain.restitution) == (0.3, 0.0)
    shapes[1].friction = 0.6
    with pytest.raises(ValueError, match=r"must have the same friction, got 0\.5 to 0\.6"):
        make_ground(shapes)


def with_(**values):
    shape = floor()
    for name, value in values.items():
        setattr(shape, name, value)
    return shape


MOVING = pymunk.Body(1.0, 1.0)


@pytest.mark.parametrize(
    "terrain, message",
    [
        (lambda: pymunk.Space(), "terrain must have at least one static shape, got an empty space"),
        (lambda: [floor(), 3], r"terrain\[1\] must be a pymunk.Circle, Segment or Poly, got 3"),
        (lambda: [box(-1, -1, 1, 0, MOVING)], "got a shape of a body that can move"),
        (lambda: [pymunk.Circle(None, 1.0)], "got a shape without a body; keep a reference"),
        (lambda: [with_(sensor=True)], r"terrain\[0\] must be solid, got a sensor"),
        (lambda: [with_(surface_velocity=(1.0, 0.0))], "must have a surface_velocity of"),
        (lambda: [with_(filter=pymunk.ShapeFilter(group=1))], "must have pymunk's default filter"),
        (lambda: [box(1.0, -1.0, 2.0, 0.0)], "terrain must have a shape at x = 0, where robots"),
        (lambda: [pymunk.Circle(static(), 0.0)], "must be a circle with a radius above 0"),
        (lambda: [pymunk.Circle(static(), 1.0, (0.0, 1e7))], "must have coordinates within 1e"),
        (lambda: [pymunk.Circle(static(), 1.0, (0.0, math.nan))], "must have coordinates within"),
    ],
)
def test_what_cannot_be_ground_is_refused(terrain, message):
    with pytest.raises(ValueError, match=message):
        gym.make(ID, terrain=terrain())


@pytest.mark.parametrize(
    "points, message",
    [
        ((), "coordinates"),
        (((0.0, 0.0), (0.0, 0.0)), "must be a segment with a length above 0"),
        (((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)), "must be a convex polygon of at least"),
        (((0.0, 0.0), (0.0, 1.0), (1.0, 0.0)), "counter-clockwise"),
    ],
)
def test_pieces_without_extent_are_refused(points, message):
    with pytest.raises(ValueError, match=message):
        Shapes((Piece(points),))


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"links_collide": True}, "links_collide must be False on a ground of pymunk shapes"),
        ({"links_collide": True, "plant": "rigid_body"}, "links_collide must be False"),
        ({"terrain_level": 3}, "terrain_level must be 0.*got 3"),
        ({"curriculum": True}, "curriculum must be None on terrain that has no"),
        (
            {"randomize": {"terrain_level": (0, 9)}},
            "a key of randomize must be .*, got 'terrain_level'",
        ),
        ({"height_scan": (0.5, 0.9, 15)}, r"height_scan must be None on a ground with overhangs"),
    ],
)
def test_what_shapes_cannot_be_combined_with_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        gym.make(ID, terrain=[floor(), box(1.0, 1.2, 2.0, 1.4)], **arguments)


def test_levels_recordings_and_mujoco_are_of_height_lines():
    """Each error names what is rejected."""
    ground = make_ground([floor()])
    env = gym.make(ID, terrain=lambda rng, level: ground)
    with pytest.raises(ValueError, match=r"must be a Terrain"):
        env.reset(seed=0)
    with pytest.raises(ValueError, match="env must walk on a height line to be recorded"):
        Recorder(gym.make(ID, terrain=ground))
    with pytest.raises(ValueError, match="terrain must be level or a slope, got Shapes"):
        to_mjcf(paper_robot(), ground)


def test_overhangs_are_found():
    """There may be air beside a shape's corners, below circles and above another floor."""
    level = Shapes((Piece(((-9.0, -1.0), (9.0, -1.0), (9.0, 0.0), (-9.0, 0.0))),))
    on_floor = Piece(((1.0, -0.1), (2.0, -0.1), (2.0, 0.5), (1.0, 0.5)))
    leaning = Piece(((1.0, 0.0), (1.2, 0.0), (1.5, 0.6)))
    for piece, expected in (
        (on_floor, False),
        (Piece(((1.0, -0.2),), 0.3), False),
        (leaning, True),
        (Piece(((1.0, 0.0),), 0.3), False),  # its lower half is in the floor
        (Piece(((1.0, 0.1),), 0.3), True),
        (Piece(((1.0, 1.0), (2.0, 1.0))), True),
    ):
        found = ShapePlanes(Shapes((*level.pieces, piece))).find_overhang()
        assert (found is not None) == expected, piece
