"""Springs in pictures: where they are drawn, in Python and on the page."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from browser import in_node
from motions import ODD, SPRINGS
from test_rendering import picture

from jansen_env import Robot, Terrain
from jansen_env.dynamics.spring_forces import spring_lengths
from jansen_env.robot import Spring
from jansen_env.robot.kinematics import coordinates, joint_positions
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.viewer.web.geometry import STYLE, scene_of_robot
from jansen_env.world.drawn_springs import MOST_SPRINGS, coil, drawn_springs, spiral

SPRUNG = replace(ODD, springs=SPRINGS)


def test_springs_are_drawn_between_their_ends():
    """The distance of the ends in a picture is the length of the spring in the equations."""
    linear = tuple(spring for spring in SPRINGS if isinstance(spring, Spring))
    robot = replace(ODD, springs=linear)
    springs = drawn_springs(robot)
    assert len(springs) == len(linear) * len(robot.legs)
    for k, (leg, joints, anchor) in enumerate(springs):
        side = robot.legs[leg].side
        psi = 0.7 + robot.legs[leg].phase
        places = [joint_positions(robot, side, psi)[joint] for joint in joints]
        if anchor is not None:
            places.append(np.array(anchor))
        expected = spring_lengths(robot, side, coordinates(robot, side, psi))[k % len(linear)]
        assert np.hypot(*(places[1] - places[0])) == pytest.approx(expected, abs=1e-14)


def test_torsion_springs_are_drawn_at_their_pins():
    linkage = SPRUNG.linkage
    members = {name: joints for name, joints in linkage.bodies}
    pins = [
        linkage.joints[spring.joints[0]] for spring in drawn_springs(SPRUNG) if spring.leg == 0
    ][2:]
    for spring, pin in zip(SPRINGS[2:], pins, strict=True):
        assert pin in members[spring.first] and pin in members[spring.second]


def test_lines_of_springs():
    """A coil begins and ends at the ends; a spiral begins at a link and ends at the other one."""
    points = coil((1.0, 2.0), (4.0, 6.0), 0.5)
    assert np.allclose(points[[0, -1]], [(1.0, 2.0), (4.0, 6.0)])
    across = (points - points[0]) @ [-0.8, 0.6]
    assert np.abs(across).max() == pytest.approx(0.25)
    assert np.isfinite(coil((1.0, 2.0), (1.0, 2.0), 0.5)).all()
    points = spiral((1.0, 1.0), (3.0, 1.0), (1.0, 5.0), 0.2)
    assert np.allclose(points[[0, -1]], [(1.1, 1.0), (1.0, 1.2)])
    turned = np.unwrap(np.arctan2(*(points - 1.0).T[::-1]))
    assert turned[-1] - turned[0] == pytest.approx(2.5 * math.pi)


def test_a_picture_shows_the_springs_and_nothing_else_changes():
    ground = Terrain.flat().polyline
    q = np.array([0.0, 0.6, 0.05, 0.6])
    plain, _ = picture(Robot(), ground, q=q)
    sprung, _ = picture(replace(Robot(), springs=SPRINGS), ground, q=q)
    changed = (plain != sprung).any(axis=2)
    assert 0.001 < changed.mean() < 0.05
    many = Robot(springs=SPRINGS * 1000)
    assert len(drawn_springs(many)) == MOST_SPRINGS
    assert "springs" not in scene_of_robot(Robot(), 30.0)


def test_the_page_draws_the_same_springs():
    """Scene and lines of scene.js are those of Python."""
    script = """
        import { readFileSync } from "node:fs";
        import { coil, sceneOf, spiral } from "FOLDER/scene.js";
        const { robots, ends, spirals, style } = JSON.parse(readFileSync(0, "utf8"));
        console.log(JSON.stringify({
          springs: robots.map((robot) => sceneOf(robot, 1, style).springs ?? null),
          coils: ends.map((each) => coil(...each, style)),
          spirals: spirals.map((each) => spiral(...each, style)),
        }));
    """
    ends = [[[1, 2], [4, 6], 0.5], [[0, 0], [0, 0], 1], [[3, -1], [-2, 5], 11]]
    spirals = [
        [[0, 0], [1, 0.2], [-3, 1], 2],
        [[4, 5], [1, 1], [2, 9], 15],
        [[0, 0], [-1, 2], [1, 1], 1],
    ]
    robots = [json.loads(json.dumps(robot_to_json(robot))) for robot in (Robot(), SPRUNG)]
    told = in_node(script, robots=robots, ends=ends, spirals=spirals, style=STYLE)
    expected = json.loads(json.dumps([spring._asdict() for spring in drawn_springs(SPRUNG)]))
    assert told["springs"] == [None, expected]
    for each, points in zip(ends, told["coils"], strict=True):
        assert np.allclose(points, coil(*each), rtol=0.0, atol=1e-12)
    for each, points in zip(spirals, told["spirals"], strict=True):
        centre, first, second, radius = each
        assert np.allclose(points, spiral(centre, first, second, radius), rtol=0.0, atol=1e-12)
