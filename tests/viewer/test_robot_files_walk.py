"""Robot files walk on the page, which compiles them to the same bits as Python.

A user drops a file on the page, or passes it to the command.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import WAIT, reads
from test_walk_engine import in_node, numbers
from test_walk_page import STILL, score, until

from jansen_env.commands.play import main
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.plants.design_tables import DesignTables
from jansen_env.robot import ROBOTS, Compliance, Payload
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.motor import MOTORS
from jansen_env.robot.robot_file import read_robot, robot_to_json, write_robot
from jansen_env.robot.zoo import ZOO, standing_height
from jansen_env.terrain.generators import NamedGenerator
from jansen_env.viewer.saved_walk import walk_again
from jansen_env.viewer.web.walk import write_walk
from jansen_env.viewer.web.walk_data import MOST_TOES


def other_robots():
    """Yield robots that have no name: other numbers of legs, other motors, feet, loads and pads."""
    paper, klann = ROBOTS["paper"](), ZOO["klann"]
    yield from (ROBOTS["built"](1), ROBOTS["holy"](3), klann(1), klann(5), ZOO["strider"](3))
    yield from (ZOO["chebyshev"](4), ZOO["trotbot"](3))
    feet = Compliance(3e4, 20.0, 2e4, 10.0)
    yield replace(paper, motor=MOTORS["mx_106"], pad_compliance=feet, pad_radius=0.02)
    yield replace(klann(2), payload=Payload(1.0, 0.02, (0.03, 0.05)), legs=paper.legs[:3])
    linkage = replace(paper.linkage, pads=(("C", 8), ("P", 1)))
    yield replace(paper, linkage=linkage, bearing_friction=(0.01,) * 10)


def as_file(robot):
    return json.loads(json.dumps(robot_to_json(robot)))


def test_tables_of_robot_files_are_the_same():
    robots = [*(make() for make in ROBOTS.values()), *other_robots()]
    answers = in_node([as_file(robot) for robot in robots])
    for robot, told in zip(robots, answers["tables"], strict=True):
        tables, designs = compile_robot(robot), DesignTables([robot])
        expected = (
            tables.body,
            tables.pads,
            tables.bearings,
            designs.depths[0],
            designs.farthest[0],
            [designs.extent[0], advance_per_turn(robot), standing_height(robot)],
        )
        for values, text in zip(expected, told, strict=True):
            assert np.array_equal(numbers(text), np.ravel(values)), robot.linkage.names


def test_robot_files_walk_as_in_python(tmp_path, rng):
    robots = [*other_robots()]
    grounds = ["stairs", "rough", "waves", "steps", "ramps", "slope"]
    controls = ["hand", "constant speed"]
    asked = [
        {
            "robot": k,
            "ground": NamedGenerator(grounds[k % len(grounds)])(rng, 1).points,
            "control": controls[k % len(controls)],
        }
        for k in range(len(robots))
    ]
    answers = in_node([as_file(robot) for robot in robots], saved=asked)
    for number, saved in enumerate(answers["saved"]):
        path = tmp_path / f"{number}.json"
        path.write_text(json.dumps(saved["file"]))
        assert np.array_equal(walk_again(path).state, saved["states"]), number


def test_what_is_no_robot_is_refused():
    """A sentence says why, before anything is computed."""
    paper = as_file(ROBOTS["paper"]())
    linkage, long = paper["linkage"], {**paper["bodies"][0], "length": 3.0}
    wrong = {
        "its format is not": {**paper, "format": "jansen_env robot 0"},
        "describes a Motor": {**paper, "is": "Motor"},
        'no "motor"': {key: value for key, value in paper.items() if key != "motor"},
        'no "pads"': {**paper, "linkage": {k: v for k, v in linkage.items() if k != "pads"}},
        "a link for each body": {**paper, "bodies": paper["bodies"][1:]},
        "is not a link of": {**paper, "bodies": [*paper["bodies"][1:], paper["bodies"][0]]},
        "a joint that its linkage": {**paper, "linkage": {**linkage, "toes": "Z"}},
        "a body that its linkage": {**paper, "linkage": {**linkage, "damped": [[1, 99]]}},
        "damping or friction": {**paper, "damping": [0.1]},
        "do not locate": {**paper, "linkage": {**linkage, "dyads": linkage["dyads"][1:]}},
        "does not close": {**paper, "bodies": [long, *paper["bodies"][1:]]},
        "cannot stand": {**paper, "frame_angle": 3.3},
        f"{MOST_TOES + 2} toes": as_file(ROBOTS["paper"](MOST_TOES // 2 + 1)),
    }
    for (pattern, _), told in zip(wrong.items(), in_node([*wrong.values()])["tables"], strict=True):
        assert isinstance(told, str) and re.search(pattern, told), (pattern, told)


def test_a_dropped_robot_file_walks(open_window, tmp_path):
    """Klann's linkage with three crank pins walks. Another file causes a message and no change."""
    path = write_walk(tmp_path / "walk.html")
    page = open_window(**STILL).page
    page.goto(path.as_uri())
    page.locator("#robot").wait_for(timeout=WAIT)
    drop = """([name, text]) => {
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([text], name));
      dispatchEvent(new DragEvent("drop", { dataTransfer }));
    }"""
    page.evaluate(drop, ["my klann.json", json.dumps(as_file(ZOO["klann"](3)))])
    until(page, lambda: page.input_value("#robot") == "my_klann")
    page.keyboard.press("p")
    until(page, lambda: score(page, "time") > 0.5)
    page.evaluate(drop, ["x.json", '{"format": "jansen_env robot 1", "is": "Robot"}'])
    reads(page, "message", "write it with write_robot")
    assert page.input_value("#robot") == "my_klann"


def test_the_command_takes_a_robot_file(tmp_path, capsys):
    """The page has the robot by its file's name. The command rejects what cannot walk."""
    path = write_robot(tmp_path / "six legs.json", ROBOTS["built"](3))
    main(["--robot", str(path), "--out", str(tmp_path), "--no-open"])
    walk, bench = (tmp_path / name for name in ("walk.html", "bench.html"))
    assert '"start":"robot=six_legs\\u0026' in walk.read_text() and "six_legs" in bench.read_text()
    assert read_robot(path) == ROBOTS["built"](3)
    capsys.readouterr()
    many = write_robot(tmp_path / "many.json", ROBOTS["paper"](MOST_TOES))
    for wrong, text in {
        "wheel": "--robot is 'wheel'",
        str(tmp_path / "none.json"): "is no robot file",
        str(many): f"at most {MOST_TOES} toes",
    }.items():
        with pytest.raises(SystemExit):
            main(["--robot", wrong, "--no-open"])
        assert text in capsys.readouterr().err.splitlines()[0]
