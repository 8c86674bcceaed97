"""The bench in a real Chromium, as one file."""

import math
import re

import numpy as np
import pytest
from browser import NAMELESS, PHONE, check_phone, reads

from jansen_env.robot import ROBOTS
from jansen_env.robot.kinematics import (
    STANCE,
    advance_per_turn,
    joint_positions,
    nearest_dead_point,
    toe_positions,
)
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.robot_file import read_robot, robot_to_json
from jansen_env.robot.zoo import standing_height
from jansen_env.viewer.web.bench import design_of, write_bench

STILL = {"viewport": {"width": 1400, "height": 900}, "reduced_motion": "reduce"}
SAMPLES = 720


@pytest.fixture
def bench(open_window, tmp_path):
    """A function to the window of the bench's file, with a link's fragment."""

    def opened(fragment="paper", **options):
        path = write_bench(tmp_path / "bench.html")
        window = open_window(**{**STILL, **options}, offline=True, accept_downloads=True)
        window.page.goto(f"{path.as_uri()}#{fragment}")
        return window

    return opened


@pytest.fixture
def window(bench):
    return bench()


def number(page, name):
    """A number of the page, without its unit."""
    text = page.locator(f"#numbers div:has(dt:text-is('{name}')) dd").first.text_content()
    return float(text.split(" ")[0].rstrip("°"))


def fragment(page):
    return page.evaluate("location.hash.slice(1)")


def says(page, pattern):
    reads(page, "message", pattern)


def handle(page, joint):
    """A joint, and where it is on the page."""
    circle = page.locator(f'.handle[data-joint="{joint}"]')
    box = circle.locator("circle").bounding_box()
    return circle, box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]


def changed(page):
    """Names of the lengths that differ from the design's."""
    return {part.split("=")[0] for part in fragment(page).split("&")[1:]}


def drag(page, joint, right, down):
    _, x, y = handle(page, joint)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.5 * right, y + 0.5 * down)
    page.mouse.move(x + right, y + down)
    page.mouse.up()


def numbers_of(robot):
    """What the page's `measure` gives, by the package's own functions."""
    psi = -math.pi + 2.0 * math.pi / SAMPLES * np.arange(SAMPLES)
    heights = toe_positions(robot, psi)[..., 1]
    lowest = heights.min(axis=1)
    standing = standing_height(robot)
    return {
        "standing": standing,
        "heave": np.ptp(lowest),
        "lift": (heights.max(axis=1) - lowest).max(),
        "advance": advance_per_turn(robot),
        "stance": (heights - lowest[:, None] <= STANCE * standing).mean(),
    }


def changed_at_random(robot, rng):
    """The robot with lengths that differ by 1 % or so."""
    changes = {name: v * rng.uniform(0.99, 1.01) for name, v in lengths(robot).items()}
    return with_lengths(robot, changes)


@pytest.mark.slow
def test_the_pages_numbers_are_the_packages(window, rng):
    """Joints and numbers of every design, and of one with all lengths changed, agree to 1e-9."""
    designs = [(name, make()) for name, make in ROBOTS.items()]
    for name, robot in [*designs, *((name, changed_at_random(r, rng)) for name, r in designs)]:
        angles = np.linspace(-7.0, 7.0, 50)
        places, numbers, again = window.page.evaluate(
            """async ([design, angles]) => {
              const { assemble, lengthsOf, measure, place, prepare } = linkage_js;
              const data = JSON.parse(document.getElementById("data").textContent);
              const module = engine_js.numbersOf(data.engine, Uint8Array);
              prepare(await engine_js.loadEngine(module, data.layout), { design });
              const linkage = assemble(design, design.lengths);
              const placed = (psi) => [...design.joints].map((j) => place(linkage, psi).at[j]);
              const { at } = place(linkage, 1);
              const again = Object.assign({}, ...linkage.bodies.map(({ joints }, k) =>
                lengthsOf(design, k, [...joints].map((joint) => at[joint]))));
              return [angles.map(placed), measure(linkage), again];
            }""",
            [{"robot": robot_to_json(robot), **design_of(robot)}, angles.tolist()],
        )
        np.testing.assert_allclose(places, joint_positions(robot, "fore", angles), atol=1e-9)
        expected = numbers_of(robot)
        assert {key: numbers[key] for key in expected} == pytest.approx(expected, abs=1e-9)
        assert again == pytest.approx(lengths(robot), abs=1e-9)
        dead = numbers["dead"]
        sine, joint, psi = nearest_dead_point(robot)
        assert dead["sine"] == pytest.approx(sine, abs=1e-9)
        if name not in ("klann", "strider"):  # which have two alike
            assert dead["joint"] == joint and dead["psi"] == pytest.approx(psi)


def test_a_joint_is_dragged_and_the_path_follows(window):
    """Only the lengths that meet in it change; keys undo and redo the change."""
    page = window.page
    before = page.locator("#drawing .path").get_attribute("d"), number(page, "lift")
    drag(page, "C", 6, -4)
    assert page.locator("#drawing .path").get_attribute("d") != before[0]
    assert number(page, "lift") != before[1]
    assert changed(page) == {"rocker", "lower_rod", "foot_CE", "foot_TC"}
    moved = fragment(page)
    page.keyboard.press("Control+z")
    assert fragment(page) == "paper" and number(page, "lift") == before[1]
    page.keyboard.press("Control+Shift+z")
    assert fragment(page) == moved
    page.locator("#undo").click()
    assert page.locator("#undo").is_disabled() and fragment(page) == "paper"


def test_what_does_not_close_is_said_and_drawn(window):
    """The page says where, and by which links; there is no walk then."""
    page = window.page
    page.locator("#length-rocker + input").fill("150")
    page.keyboard.press("Tab")
    says(page, r"^Joint C does not close from \d+° to \d+° of the crank: links of \d+\.\d mm")
    assert page.locator("#drawing .gap").count() >= 1 and page.locator("#walk").is_disabled()
    with pytest.raises(ValueError, match="joint C does not close"):
        joint_positions(with_lengths(ROBOTS["paper"](), {"rocker": 0.15}), "fore", [*range(7)])
    page.locator("#length-foot_CE + input").fill("900")
    page.keyboard.press("Tab")
    says(page, "^The three sides of foot must form a triangle.$")
    page.locator("#length-foot_CE + input").fill("-1")
    page.keyboard.press("Tab")
    says(page, "^foot CE must be between 0.01 and 10000 mm, got -1.$")


def test_everything_by_keys(window):
    """Keys reach joints (by arrows), a slider, the crank, A, and the difference from it."""
    page = window.page
    page.keyboard.press("a")
    handle(page, "E")[0].focus()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Shift+ArrowLeft")
    assert changed(page) == {"coupler", "foot_CE", "foot_ET"}
    page.locator("#length-rocker").focus()
    page.keyboard.press("ArrowRight")
    assert "rocker=23" in fragment(page)
    kept = page.locator("#numbers .kept").first.text_content()
    assert re.match(r"^A 88\.4 mm, [+\u2212]\d", kept)
    assert page.locator("#drawing .kept").count() == 1
    page.keyboard.press("Escape")
    page.locator("body").click(position={"x": 3, "y": 3})
    angle = page.locator("#angle-value").text_content()
    page.keyboard.press(" ")
    reads(page, "angle-value", f"^(?!{angle})")
    page.keyboard.press(" ")
    page.locator("#back").click()
    assert fragment(page) == "paper"
    assert page.evaluate(NAMELESS) == []


def test_a_link_holds_the_design(bench):
    """It holds the design exactly; a link that is wrong is refused in one line."""
    page = bench("klann&rod_AD=470&foot_T_across=-220.55&frame_angle=-3.25").page
    assert fragment(page) == "klann&rod_AD=470&foot_T_across=-220.55&frame_angle=-3.25"
    assert page.locator("#base").input_value() == "klann"
    for wrong, text in {
        "wheel": "The robot of the link must be one of ",
        "paper&wheels=4": "A length in the link must be one of frame",
        "paper&rocker=1e3": "rocker=1e3",
        "paper&rocker=-5": "rocker must be between 0.01 and 10000 mm, got -5",
        "paper&rocker=99999": "rocker must be between",
        "paper&rocker=<img>": 'the form NAME=NUMBER, got "rocker=',
        "paper" + 900 * "&x=1": 'got "x=1"',
        "%": 'got "%"',
    }.items():
        page.evaluate("location.hash = ''")
        page.evaluate("text => { location.hash = text; }", wrong)
        says(page, re.escape(text))
        assert "=" not in fragment(page) or fragment(page).startswith("klann")


def test_files_are_taken_away(bench, tmp_path):
    """A robot file that Python reads can be saved, and a drawing with all lengths."""
    page = bench("built&rocker=240.08&foot_CE=250&frame_angle=9").page
    with page.expect_download() as robot:
        page.locator("#file").click()
    robot.value.save_as(tmp_path / "robot.json")
    text = (tmp_path / "robot.json").read_text()
    # Rounded: not 0.24008000000000002.
    assert max(map(len, re.findall(r"[\d.]+(?=,?\n)", text))) <= 8
    changed = {"rocker": 0.24008, "foot_CE": 0.25, "frame_angle": math.radians(9.0)}
    expected = lengths(with_lengths(ROBOTS["built"](), changed))
    assert lengths(read_robot(tmp_path / "robot.json")) == pytest.approx(expected, abs=1e-6)
    with page.expect_download() as drawing:
        page.locator("#drawn").click()
    drawing.value.save_as(tmp_path / "drawing.svg")
    text = (tmp_path / "drawing.svg").read_text()
    assert text.startswith("<svg ") and ">240.08</text>" in text and ">383.22</text>" in text


def test_a_robot_of_a_file_is_taken_away_whole(open_window, tmp_path):
    """The saved file has the same lengths as Python computes."""
    robot = ROBOTS["klann"](3)
    path = write_bench(tmp_path / "bench.html", {"built": ROBOTS["built"](), "mine": robot})
    page = open_window(**STILL, offline=True, accept_downloads=True).page
    page.goto(f"{path.as_uri()}#mine&rod_AD=470")
    with page.expect_download() as saved:
        page.locator("#file").click()
    saved.value.save_as(tmp_path / "robot.json")
    assert read_robot(tmp_path / "robot.json") == with_lengths(robot, {"rod_AD": 0.47})


def test_the_file_needs_nothing(bench, tmp_path):
    """It needs no network and nothing but itself; the walk is on the page beside it."""
    window = bench("strider&rod_AD=470")
    assert len(window.requests) == 1 and window.requests[0].startswith("file://")
    text = write_bench(tmp_path / "bench.html").read_text()
    assert "'unsafe" not in text and not re.search(r"\bsrc=|@import|url\(|\bfetch\(|eval\(", text)


def test_on_a_phone_by_touch(bench):
    """Nothing is wider than the screen, and everything is large enough for a finger."""
    page = bench("paper", **PHONE, color_scheme="dark").page
    check_phone(page)
    toe, x, y = handle(page, "T")
    assert toe.locator("circle").bounding_box()["width"] == pytest.approx(44, abs=1)
    point = {"bubbles": True, "pointerId": 1, "clientX": x, "clientY": y, "button": 0}
    page.evaluate("Element.prototype.setPointerCapture = () => {}")
    toe.dispatch_event("pointerdown", point)
    page.locator("#picture").dispatch_event("pointermove", {**point, "clientX": x + 4})
    page.locator("#picture").dispatch_event("pointerup", point)
    assert changed(page) == {"foot_ET", "foot_TC"}
