"""Robot files walk on the page, which compiles them to the same bits as Python.

A user drops a file on the page, or passes it to the command.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import reads, wait_for_walk
from motions import SPRINGS
from test_walk_engine import in_node, numbers
from test_walk_page import STILL, score, until

from jansen_env.cli.play import main
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.plants.design_tables import DesignTables
from jansen_env.robot import ROBOTS, Compliance, Payload, Spring, TorsionSpring
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.linkage import LARGEST_NUMBER
from jansen_env.robot.motor import MOTORS
from jansen_env.robot.robot_file import (
    file_schema,
    read_robot,
    robot_from_json,
    robot_to_json,
    write_robot,
)
from jansen_env.robot.zoo import ZOO, standing_height
from jansen_env.terrain.generators import NamedGenerator
from jansen_env.viewer.saved_walk import walk_again
from jansen_env.viewer.web.walk import write_walk
from jansen_env.viewer.web.walk_data import MOST_TOES


def other_robots():
    """Yield robots that have no name: other numbers of legs, other motors, feet, loads and pads."""
    paper = ROBOTS["paper"]()
    klann = ZOO["klann"]
    yield from (ROBOTS["built"](1), ROBOTS["holy"](3), klann(1), klann(5), ZOO["strider"](3))
    yield from (ZOO["chebyshev"](4), ZOO["trotbot"](3))
    feet = Compliance(3e4, 20.0, 2e4, 10.0)
    yield replace(paper, motor=MOTORS["mx_106"], pad_compliance=feet, pad_radius=0.02)
    yield replace(klann(2), payload=Payload(1.0, 0.02, (0.03, 0.05)), legs=paper.legs[:3])
    linkage = replace(paper.linkage, pads=(("C", 8), ("P", 1)))
    yield replace(paper, linkage=linkage, bearing_friction=(0.01,) * 10)
    yield replace(paper, springs=SPRINGS)
    yield replace(klann(3), springs=(TorsionSpring("rod", "foot", 0.3, 2.0),))


def as_file(robot):
    return json.loads(json.dumps(robot_to_json(robot)))


@pytest.mark.slow
def test_tables_of_robot_files_are_the_same():
    robots = [*(make() for make in ROBOTS.values()), *other_robots()]
    answers = in_node([as_file(robot) for robot in robots])
    for robot, told in zip(robots, answers["tables"], strict=True):
        tables = compile_robot(robot)
        designs = DesignTables([robot])
        expected = (
            tables.body,
            tables.pads,
            tables.bearings,
            tables.springs,
            designs.depths[0],
            designs.farthest[0],
            [designs.extent[0], advance_per_turn(robot), standing_height(robot)],
        )
        for values, text in zip(expected, told, strict=True):
            assert np.array_equal(numbers(text), np.ravel(values)), robot.linkage.names


@pytest.mark.slow
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

    def sprung(is_, **fields):
        return {**paper, "springs": [{"is": is_, **fields}]}

    wrong = {
        "the format of a robot file must be .jansen_env robot 1., got .jansen_env robot 0.": {
            **paper,
            "format": "jansen_env robot 0",
        },
        "a robot file must contain a Robot, got .Motor.": {**paper, "is": "Motor"},
        "linkage must have the key .pads., got one without it; write_robot writes all keys": {
            **paper,
            "linkage": {k: v for k, v in linkage.items() if k != "pads"},
        },
        r"a key of legs\[1\] must be one of \['side', 'phase'\], got .foot.": {
            **paper,
            "legs": [paper["legs"][0], {**paper["legs"][1], "foot": 1}],
        },
        "damping must be a list, got 0.1": {**paper, "damping": 0.1},
        r"damping\[3\] must be between 0 and": {**paper, "damping": [*[0.1] * 3, -1, *[0.1] * 6]},
        "linkage must be a Linkage, got": {**paper, "linkage": "jansen"},
        "material must be one of .*plywood'.*, got": {**paper, "material": "steel"},
        r"legs\[0\].phase must be 0, because .* defines the crank angle, got 1": {
            **paper,
            "legs": [{"is": "Leg", "side": "back", "phase": 1}],
        },
        r"bodies\[0\].length must be .* at most 1000; lengths are in metres": {
            **paper,
            "bodies": [{**long, "length": 3e3}, *paper["bodies"][1:]],
        },
        r"linkage.dyads\[0\] must be a dyad whose branch is 1 or -1": {
            **paper,
            "linkage": {**linkage, "dyads": [["B", "A", "P", 0], *linkage["dyads"][1:]]},
        },
        "bodies must have 8 entries, the same number as linkage.bodies, got 7": {
            **paper,
            "bodies": paper["bodies"][1:],
        },
        r"bodies\[\d\] must be a (Bar|Triangle) or a Plate with joints": {
            **paper,
            "bodies": [*paper["bodies"][1:], paper["bodies"][0]],
        },
        r"linkage.toes\[0\] must be a joint of the linkage": {
            **paper,
            "linkage": {**linkage, "toes": "Z"},
        },
        r"linkage.damped\[0\] must be the numbers of two different bodies": {
            **paper,
            "linkage": {**linkage, "damped": [[1, 99], *linkage["damped"][1:]]},
        },
        "damping must have 10 entries, the same number as linkage.damped, got 1": {
            **paper,
            "damping": [0.1],
        },
        r"linkage.dyads\[1\] must be a dyad whose start and end": {
            **paper,
            "linkage": {**linkage, "dyads": linkage["dyads"][1:]},
        },
        "does not close": {**paper, "bodies": [long, *paper["bodies"][1:]]},
        "cannot stand": {**paper, "frame_angle": 3.3},
        r"springs\[0\].start must be one of \[.*\], got": sprung(is_="Spring", start="Z"),
        r"springs\[0\] must be between two points that move": sprung(is_="Spring", start="P"),
        r"springs\[0\] must be between two joints": sprung(is_="Spring", start="D", end="B"),
        r"springs\[0\] must be between two different links": sprung(
            is_="TorsionSpring", first="frame", second="foot"
        ),
        "springs must be between two links that do not make whole turns relative to": sprung(
            is_="TorsionSpring", first="crank", second="upper_rod", stiffness=1.0
        ),
        r"springs\[0\].stiffness must be between 0 and": sprung(
            is_="Spring", start="D", stiffness=-1.0
        ),
        f"at most {MOST_TOES} toes, got": as_file(ROBOTS["paper"](MOST_TOES // 2 + 1)),
    }
    for (pattern, _), told in zip(wrong.items(), in_node([*wrong.values()])["tables"], strict=True):
        assert isinstance(told, str) and re.search(pattern, told), (pattern, told)


def test_counts_and_whole_numbers_are_refused_as_in_python():
    """The page and Python name the entry, also where the engine's integers would overflow."""
    paper = as_file(ROBOTS["paper"]())
    linkage = paper["linkage"]
    joint, start, end, _ = linkage["dyads"][0]

    def with_linkage(**fields):
        return {**paper, "linkage": {**linkage, **fields}}

    wrong = [
        ("bodies", {**with_linkage(bodies=[]), "bodies": []}),
        ("bodies", {**with_linkage(bodies=linkage["bodies"][:1]), "bodies": paper["bodies"][:1]}),
        ("dyads", with_linkage(dyads=[])),
        ("toes", with_linkage(toes="")),
        ("legs", {**paper, "legs": []}),
        (r"legs\[0\].phase", {**paper, "legs": [{"is": "Leg", "side": "fore", "phase": 0.5}]}),
        *((name, {**paper, name: paper[name][1:]}) for name in ("bodies", "damping")),
        ("bearing_friction", {**paper, "bearing_friction": [0.0] * 11}),
    ]
    for number in (LARGEST_NUMBER + 1, -LARGEST_NUMBER - 1, 2**64, 2**64 + 2**12):
        for name in ("damped", "bearings"):
            wrong.append((name, with_linkage(**{name: [[number, 2], *linkage[name][1:]]})))
        wrong.append(("pads", with_linkage(pads=[["C", number]])))
        wrong.append(("pins", with_linkage(pins=[["O", 2, number], *linkage["pins"][1:]])))
        dyads = [[joint, start, end, number], *linkage["dyads"][1:]]
        wrong.append(("dyads", with_linkage(dyads=dyads)))
    told = in_node([content for _, content in wrong])["tables"]
    for (name, content), message in zip(wrong, told, strict=True):
        with pytest.raises(ValueError, match=f"{name} must (be|have) .*, got "):
            robot_from_json(content)
        assert re.search(rf"{name}\S* must (be|have) .*, got ", message), message


def test_a_fault_has_the_same_words_as_in_python():
    """Only the name of the entry and the value differ, which Python shows in its own notation."""
    paper = as_file(ROBOTS["paper"]())
    linkage, (fore, *legs), (bar, *bodies) = paper["linkage"], paper["legs"], paper["bodies"]
    dyads = linkage["dyads"]
    triangle = next(k for k, body in enumerate(paper["bodies"]) if body["is"] == "Triangle")
    turned = [*paper["bodies"]]
    turned[triangle] = {**turned[triangle], "alpha": 4.0, "gamma": 5.0}
    wrong = [
        {**paper, "format": "jansen_env robot 0"},
        {**bar, "format": paper["format"]},
        {**paper, "legs": [{**fore, "foot": 1}, *legs]},
        {**paper, "legs": [{"is": "Leg"}, *legs]},
        {**paper, "legs": [{**fore, "side": "left"}, *legs]},
        {**paper, "legs": [{**fore, "phase": 0.5}, *legs]},
        {**paper, "damping": 0.1},
        {**paper, "pad_radius": -1.0},
        {**paper, "pad_radius": "1"},
        {**paper, "pad_compliance": {"is": "Compliance", "damping": 5.0}},
        {**paper, "bodies": turned},
        {**paper, "bodies": [*bodies, bar]},
        {**paper, "springs": [{"is": "Spring", "start": "Z"}]},
        {**paper, "springs": [{"is": "Spring", "start": "P"}]},
        {**paper, "springs": [{"is": "Spring", "start": "D", "end": "B"}]},
        {**paper, "springs": [{"is": "TorsionSpring", "first": "frame", "second": "foot"}]},
        *(
            {**paper, "linkage": {**linkage, **fields}}
            for fields in (
                {"toes": "TT"},
                {"pads": [["X", 8]]},
                {"damped": [[1, 1], *linkage["damped"][1:]]},
                {"bearings": [[1, 99], *linkage["bearings"][1:]]},
                {"dyads": dyads[1:]},
                {"dyads": [*dyads, ["T", "A", "B", 1]]},
                {"dyads": [["B", "A", "A", -1], *dyads[1:]]},
                {"dyads": [["B", "A", "P", 0], *dyads[1:]]},
                {"dyads": dyads[:1]},
            )
        ),
    ]
    for content, told in zip(wrong, in_node(wrong)["tables"], strict=True):
        with pytest.raises(ValueError, match=r"must .*, got") as error:
            robot_from_json(content)
        words = str(error.value).partition(" must ")[2].partition(", got ")[0]
        assert f" must {words}, got " in told, (told, str(error.value))


def wrong_numbers(part, name="Robot", wrap=lambda part: part):
    """Yield (field, robot file) with a number out of the limits of each field, part by part."""
    for field, entry in file_schema()[name]["fields"].items():
        value = part.get(field)
        if number := entry["kind"].get("number"):
            beyond = [number["least"] if number["above"] else (number["least"] or 0.0) - 1e-3]
            beyond += [] if number["most"] is None else [1.01 * number["most"]]
            for wrong in (*beyond, "1", None, True):
                yield field, wrong, wrap({**part, field: wrong})
        elif isinstance(value, dict):
            yield from wrong_numbers(
                value, value["is"], lambda inner, field=field: wrap({**part, field: inner})
            )
        elif isinstance(value, list) and isinstance(value[0], dict):
            for k in {each["is"]: k for k, each in enumerate(value)}.values():
                yield from wrong_numbers(
                    value[k],
                    value[k]["is"],
                    lambda inner, field=field, value=value, k=k: wrap(
                        {**part, field: [*value[:k], inner, *value[k + 1 :]]}
                    ),
                )


def test_every_limit_of_a_robot_file_is_that_of_python():
    """Each number beyond its limits is refused by both, by the name of its entry."""
    of_plates = replace(
        ZOO["klann"](2), motor=MOTORS["mx_106"], pad_compliance=Compliance(3e4, 9.0)
    )
    of_plates = replace(of_plates, springs=(Spring("E", "C"), TorsionSpring("rod", "foot")))
    files = [*wrong_numbers(as_file(ROBOTS["paper"]())), *wrong_numbers(as_file(of_plates))]
    for rule in (
        {"motor": {"is": "Motor", "no_load_speed": 3.0}},
        {"motor": {"is": "Motor", "gear_ratio": 1e4, "rotor_inertia": 1.0}},
        {"pad_compliance": {"is": "Compliance", "damping": 1.0}},
        {"pad_compliance": {"is": "Compliance", "tangential_stiffness": 1e4}},
    ):
        ((_, part),) = rule.items()
        files.append(([*part][1], None, {**as_file(ROBOTS["paper"]()), **rule}))
    foot = {**as_file(ROBOTS["paper"]())["bodies"][7], "gamma": 5.0}
    paper = as_file(ROBOTS["paper"]())
    files.append(("gamma", None, {**paper, "bodies": [*paper["bodies"][:7], foot]}))
    assert len(files) > 150
    told = in_node([content for *_, content in files])["tables"]
    for (field, wrong, content), message in zip(files, told, strict=True):
        may_be_left_out = wrong is None and field.startswith("tangential")
        if not may_be_left_out:
            with pytest.raises(ValueError):
                robot_from_json(content)
        assert isinstance(message, str) and field in message, (field, wrong, message)


def test_what_a_robot_file_leaves_out_is_as_in_python():
    """The page has the same defaults: those of Python's dataclasses."""
    paper = as_file(ROBOTS["paper"]())
    bare = {"format": paper["format"], "is": "Robot"}
    feet = {"is": "Compliance", "stiffness": 3e4, "damping": 20.0}
    files = [bare, {**paper, "pad_compliance": feet}, {**bare, "motor": {"is": "Motor"}}]
    for content, told in zip(files, in_node(files)["tables"], strict=True):
        assert np.array_equal(
            numbers(told[0]), compile_robot(robot_from_json(content)).body.ravel()
        )


@pytest.mark.slow
def test_a_dropped_robot_file_walks(open_window, tmp_path):
    """Klann's linkage with three crank pins walks. Another file causes a message and no change."""
    path = write_walk(tmp_path / "walk.html")
    page = open_window(**STILL).page
    page.goto(path.as_uri())
    wait_for_walk(page)
    drop = """([name, text]) => {
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([text], name));
      dispatchEvent(new DragEvent("drop", { dataTransfer }));
    }"""
    page.evaluate(drop, ["my klann.json", json.dumps(as_file(ZOO["klann"](3)))])
    until(page, lambda: page.input_value("#robot") == "my_klann")
    page.keyboard.press("p")
    until(page, lambda: score(page, "time") > 0.5)
    paper = as_file(ROBOTS["paper"]())
    paper["bodies"][1]["mass"] = -1.0
    page.evaluate(drop, ["x.json", json.dumps(paper)])
    reads(page, "message", r"bodies\[1\].mass must be above 0 and at most 1e\+06, got -1")
    assert page.input_value("#robot") == "my_klann"


@pytest.mark.slow
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
        "wheel": "--robot must be a robot file (.json) or one of",
        str(tmp_path / "none.json"): "is not a robot file",
        str(many): f"at most {MOST_TOES} toes",
    }.items():
        with pytest.raises(SystemExit):
            main(["--robot", wrong, "--no-open"])
        assert text in capsys.readouterr().err.splitlines()[0]
