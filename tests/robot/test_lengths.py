"""Lengths by name, robots with others, and robot files."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import ROBOTS, Robot
from jansen_env.robot import Bar, Payload
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.robot_file import read_robot, robot_from_json, robot_to_json, write_robot

DESIGNS = [name for name in ROBOTS if not name.endswith("_slender")]
ANGLES = np.linspace(0.0, 6.0, 7)


@pytest.mark.parametrize("name", ROBOTS)
def test_lengths_are_distances_between_joints(name):
    """This holds for every name with two joints, at any crank angle."""
    robot = ROBOTS[name]()
    linkage = robot.linkage
    known = lengths(robot)
    place = joint_positions(robot, "fore", ANGLES)
    for (body, joints), link in zip(linkage.bodies, robot.bodies, strict=True):
        bar = [(body, joints)] if isinstance(link, Bar) else []
        named = bar + [(key, key[-2:]) for key in known if key.startswith(f"{body}_")]
        for key, (a, b) in [pair for pair in named if pair[1].isupper()]:
            between = place[:, linkage.joints.index(a)] - place[:, linkage.joints.index(b)]
            assert np.hypot(*between.T) == pytest.approx(known[key], rel=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_design_twice_as_large_has_the_same_angles(name):
    """With all lengths doubled, joints are twice as far apart; halved again, masses and inertias
    are the same, too.
    """
    robot = ROBOTS[name]()
    before = lengths(robot)
    twice = {key: value * (1.0 if key == "frame_angle" else 2.0) for key, value in before.items()}
    assert with_lengths(robot, before) == robot
    large = with_lengths(robot, twice)
    assert lengths(large) == pytest.approx(twice, abs=1e-12)
    place = [joint_positions(r, "fore", ANGLES) for r in (robot, large)]
    assert place[1] == pytest.approx(2.0 * place[0], abs=1e-9)
    again = with_lengths(large, before)
    for old, new in zip(robot.bodies, again.bodies, strict=True):
        assert (new.mass, new.inertia) == pytest.approx((old.mass, old.inertia), rel=1e-3)


def test_a_longer_rod_is_heavier_in_its_own_material():
    """A rod keeps its mass per metre and has m L^2 / 12; a part of the built robot has its flat
    bar's numbers.
    """
    slender = with_lengths(ROBOTS["paper_slender"](), {"rocker": 0.47016})
    rod = slender.body("rocker")
    assert (rod.mass, rod.inertia) == pytest.approx((0.2, 0.2 * 0.47016**2 / 12.0))
    built = with_lengths(ROBOTS["built"](), {"rocker": 0.3, "foot_CE": 0.3})
    bar = built.body("rocker")
    assert bar.mass == pytest.approx(2700.0 * 5e-3 * (15e-3 * 0.3 + math.pi * 7.5e-3**2) + 16e-3)
    nominal = ROBOTS["built"]()
    assert with_lengths(built, lengths(nominal)).mass == pytest.approx(nominal.mass, rel=1e-4)


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"shin": 1.0}, r"a key of lengths must be one of \['frame'.*, got 'shin'"),
        (3, r"lengths must be a dictionary with some of .*, got 3"),
        ({"rocker": -1.0}, r"lengths\['rocker'\]"),
        ({"rocker": math.nan}, r"lengths\['rocker'\]"),
        (
            {"rocker": 1e9},
            r"lengths\['rocker'\] must be .* 1000; lengths are in metres, got 1000000000.0",
        ),
        ({"rocker": 240}, r"lengths\['rocker'\] of 240 m: rocker would .* lengths are in metres"),
        ({"frame_angle": 11.6}, r"lengths\['frame_angle'\] .* 11.6 degrees are 0.2025 rad"),
        ({"foot_CE": 5.0}, "lengths of foot: .* must form a triangle"),
    ],
)
def test_impossible_lengths_are_refused(changed, message):
    """The error names them in one line."""
    with pytest.raises(ValueError, match=message) as error:
        with_lengths(Robot(), changed)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_file_gives_the_same_robot(name, tmp_path):
    """The robot is the same to the last bit, and the file is strict JSON."""
    robot = replace(ROBOTS[name](), payload=Payload(0.3, 0.01, (0.1, 0.2)))
    path = write_robot(tmp_path / "mine.json", robot)
    assert read_robot(path) == robot
    json.loads(path.read_text(), parse_constant=pytest.fail)


def test_a_robot_file_may_be_a_design_with_other_lengths(tmp_path):
    """The bench writes such files."""
    path = tmp_path / "mine.json"
    content = {"format": "jansen_env robot 1", "design": "built", "lengths": {"rocker": 0.24}}
    path.write_text(json.dumps(content))
    assert read_robot(path) == with_lengths(ROBOTS["built"](), {"rocker": 0.24})
    for wrong, message in (
        ({"design": "wheel"}, "design must be one of.*got 'wheel'"),
        ({"lengths": [1]}, r"lengths must be a dictionary with some of .*, got \[1\]"),
        ({"legs": 4}, r"must have 'format', 'design' and 'lengths', got one with \['legs'\]"),
        ({"lengths": {"rocker": None}}, "rocker"),
    ):
        with pytest.raises(ValueError, match=message):
            robot_from_json({**content, **wrong})
    del content["lengths"]
    with pytest.raises(ValueError, match=r"got one without \['lengths'\]"):
        robot_from_json(content)


@pytest.mark.parametrize(
    "text, message",
    [
        ("[1", "is not a robot file"),
        ("[1]", "the format of a robot file must be 'jansen_env.*, got None"),
        (
            '{"format": "jansen_env robot 1"}',
            r"a part must be one of \['Robot', 'Linkage',.*, got None",
        ),
        (
            '{"format": "jansen_env robot 1", "is": "Bar", "length": 1}',
            "a robot file must contain a Robot, got 'Bar'",
        ),
        (
            '{"format": "jansen_env robot 1", "is": "Robot", "wheels": 4}',
            "a key of a Robot must be.*, got 'wheels'",
        ),
        ('{"format": "jansen_env robot 1", "is": "Robot", "frame_angle": NaN}', "frame_angle"),
        ('{"format": "jansen_env robot 1", "is": "Robot", "payload": {"is": "os"}}', "'os'"),
        ('{"format": "jansen_env robot 1", "is": "Robot", "legs": [{"is": "Leg"}]}', "side"),
        ("[" * 100_000, "is not a robot file"),
    ],
)
def test_a_file_that_is_no_robot_is_refused(text, message, tmp_path):
    """The error names the file in one line."""
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_robot(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_a_file_with_a_pin_at_a_joint_that_its_body_lacks_is_refused(tmp_path):
    """The error names the file, the pin and its joint."""
    content = robot_to_json(Robot())
    pins = content["linkage"]["pins"]
    pins[3] = ["T", *pins[3][1:]]
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"Linkage\.pins\[3\] .* got \('T', 4, 1\)") as error:
        read_robot(path)
    assert str(path) in str(error.value)


def test_a_missing_and_a_huge_file_are_refused(tmp_path):
    """They are refused before they are parsed."""
    with pytest.raises(ValueError, match=r"cannot be read: No such file"):
        read_robot(tmp_path / "none.json")
    (tmp_path / "huge.json").write_bytes(b" " * 2**21)
    with pytest.raises(ValueError, match="must have at most 1048576 bytes"):
        read_robot(tmp_path / "huge.json")
    with pytest.raises(ValueError, match="the format of a robot file must be"):
        robot_from_json(robot_to_json(Robot())["bodies"])
