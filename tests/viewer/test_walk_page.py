"""The page that walks, in a real Chromium: from a file, by keys, pointer, finger and link."""

import json
import re
import time
import webbrowser

import gymnasium as gym
import numpy as np
import pytest
from browser import NAMELESS, PHONE, WAIT, check_phone, reads, wait_for, wait_for_walk

from jansen_env.cli.play import main
from jansen_env.policies import pretrained
from jansen_env.terrain.generators import NamedGenerator
from jansen_env.viewer.saved_walk import walk_again
from jansen_env.viewer.web.bench import write_bench
from jansen_env.viewer.web.walk import write_walk
from jansen_env.world.observations import Noise

STILL = {"viewport": {"width": 1200, "height": 720}, "reduced_motion": "reduce"}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_walk(tmp_path_factory.mktemp("walk") / "walk.html")


@pytest.fixture
def opened(open_window, path):
    """A function from a link's choices to the page, offline."""

    def page(choices="", **options):
        window = open_window(offline=True, **(options or STILL))
        window.page.goto(f"{path.as_uri()}#{choices}")
        wait_for_walk(window.page)
        assert [url.split("#")[0] for url in window.requests] == [path.as_uri()]
        return window.page

    return page


def score(page, name, i=0):
    """A number of a robot's score, without its unit; nan until it is shown."""
    cells = page.locator("figure:visible:has(figcaption)").nth(i).locator("figcaption div")
    text = cells.filter(has_text=name).locator("dd").text_content()
    return float(text.split(" ")[0].replace("\u2013", "") or "nan")


def until(page, condition):
    """Wait until something is the case here, while the page goes on."""
    for _ in range(WAIT // 20):
        if condition():
            return
        page.wait_for_timeout(20)
    raise AssertionError("it is not the case in time")


def settled(page, name):
    """A number of the score when time stands still: it is shown five times a second."""
    page.wait_for_timeout(400)
    return score(page, name)


def test_it_walks_at_once(opened):
    page = opened(viewport={"width": 1200, "height": 720})
    until(page, lambda: score(page, "distance") > 0.3)
    assert 0.0 < score(page, "slip per metre") < 1.0 and 0.0 < score(page, "cost") < 2.0
    page.keyboard.press("h")
    time = settled(page, "time")
    assert page.locator("#help").is_visible() and settled(page, "time") == time
    page.keyboard.press("Escape")
    until(page, lambda: score(page, "time") > time)
    assert page.evaluate(NAMELESS) == []


@pytest.mark.slow
def test_firefox_walks_as_python(firefox, path, tmp_path):
    """Actions of a policy on stairs, with noise, are Python's, bit for bit, for two seconds."""
    link = "control=rough+policy&terrain=stairs&level=2&seed=3&command=0.3&noise_level=1"
    firefox.call("Navigate", url=f"{path.as_uri()}#{link}")
    for _ in range(WAIT // 50):
        numbers = firefox.evaluate("return document.querySelector('figure dl').textContent")
        walked = re.search("time([0-9.]+)", numbers)  # none until the engine is compiled
        if walked and float(walked[1]) > 2.0:
            break
        time.sleep(0.05)
    firefox.evaluate("document.getElementById('save').click()")
    steps = json.loads(wait_for(tmp_path / "walk.json").read_text())["steps"]
    env = gym.make(
        "JansenWalkerRough-v0",
        terrain=NamedGenerator("stairs")(np.random.default_rng(3), 2),
        terrain_level=0,
        randomize={},
        noise=Noise(),
        reset_noise_scale=0.0,
        speed_command=0.3,
        terminate_when_fallen=False,
    )
    policy = pretrained.load("JansenWalkerRough-v0").on(env)
    memory = None
    env.reset(seed=3)
    for k, step in enumerate(steps):
        seen = env.unwrapped.task.observation[0]
        action, memory = policy.predict(seen, memory, k == 0)
        assert action[0] == step["action"], k
        env.step(action)
    assert len(steps) > 100


def test_keys_turn_the_crank(opened):
    page = opened("robot=built&control=hand")
    assert page.locator("#pause").get_attribute("aria-pressed") == "true"  # of reduced motion
    page.keyboard.down("ArrowRight")
    reads(page, "input-value", r"^12\.0 N m$")
    until(page, lambda: abs(score(page, "distance")) > 0.02)  # with such a torque it soon falls
    page.keyboard.up("ArrowRight")
    reads(page, "input-value", r"^0\.0 N m$")
    page.keyboard.press("p")
    page.keyboard.press("r")
    until(page, lambda: score(page, "time") == 0.0)
    page.keyboard.press("c")
    reads(page, "input-label", "^speed command$")
    assert page.locator("#control").input_value() == "built policy"
    page.keyboard.press("s")
    assert page.locator("#pace").input_value() == "0.5"
    page.keyboard.press("n")
    assert "seed=1" in page.evaluate("location.hash")


def test_clicks_and_drags_push(opened):
    page = opened()
    page.evaluate(
        """() => {
          window.pushes = [];
          machine_js.Machine.prototype.push = (...impulse) => window.pushes.push(impulse);
        }"""
    )
    box = page.locator("#pictures canvas").first.bounding_box()
    x, y = box["x"] + 0.2 * box["width"], box["y"] + 0.5 * box["height"]
    for right in (0.0, -100.0, 600.0):
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + right, y)
        page.mouse.up()
    page.keyboard.press(" ")
    click, drag, longest, key = page.evaluate("window.pushes")
    assert click[0] > 2.5 and np.hypot(*click) == pytest.approx(3.0)
    assert drag == [pytest.approx(-3.0), 0.0] and longest[0] == 10.0 and key == [3, 0]


def test_choices_are_the_link(opened):
    """A page of this link has them all; an impossible choice is named and changes nothing."""
    page = opened()
    page.get_by_label("robot", exact=True).select_option("klann")
    page.get_by_label("compare with").select_option("paper")
    page.get_by_label("terrain").select_option("rough")
    page.get_by_label("level").select_option("4")
    page.locator("#friction").fill("0.4")
    page.locator("#friction").blur()
    link = page.evaluate("location.hash.slice(1)")
    assert {*link.split("&")} == {
        "robot=klann",
        "control=constant+speed",
        "terrain=rough",
        "level=4",
        "robot2=paper",
        "control2=paper+policy",
        "command=0.30",
        "friction=0.4",
    }
    other = opened(link)
    names = ("robot", "control", "terrain", "level", "robot2", "control2", "friction")
    values = [[p.locator(f"#{name}").input_value() for name in names] for p in (page, other)]
    assert values[0] == values[1] and other.locator("#friction-value").text_content() == "0.40"
    for key in "p":
        other.keyboard.press(key)
    until(other, lambda: score(other, "time", 1) > 0.5)
    time = score(other, "time")
    other.get_by_label("control", exact=True).select_option("hand")  # goes on
    assert score(other, "time") >= time


def test_wrong_links_are_refused(opened):
    """They are refused as the first and as later ones; a robot walks all the same."""
    wrong = {
        "robot=wheel": "The robot of the link must be one of",
        "terrain=constructor": "terrain",
        "level=10": "level",
        "seed=-1": "seed",
        "control=x": "control",
        "robot=klann%26rod_AD=x": "rod_AD",
        "restitution=0.5": "restitution",
        "terrain=drawn": "terrain",
        "terrain=": "terrain must be one of",
        "control=": "control must be one of",
        "level=drawn&ground=70,0": "level must be one of",
        "terrain=drawn&ground=70,0,65,0": "ground",
    }
    first, *others = wrong
    page = opened(first)
    reads(page, "message", wrong[first])
    for link in others:
        page.evaluate("document.getElementById('message').textContent = ''")
        page.evaluate("link => { location.hash = link; }", link)
        reads(page, "message", wrong[link])
    page.keyboard.press("p")
    until(page, lambda: score(page, "time") > 0.1)
    page.evaluate("document.getElementById('message').textContent = ''")
    page.locator("#restitution").fill("0.5")  # compliant pads do not bounce: the slider goes back
    assert "restitution" in page.locator("#message").text_content()
    assert page.locator("#restitution").input_value() == "0"


def test_lengths_of_the_bench_walk(open_window, path):
    """They come by its link, and by a robot file that is dropped; the page leads back to them."""
    write_bench(path.with_name("bench.html"))
    page = open_window(**STILL).page
    page.goto(f"{path.with_name('bench.html').as_uri()}#klann&rod_AD=470")
    page.locator("#walk").click()
    wait_for_walk(page)
    assert page.locator("#robot").input_value() == "klann&rod_AD=470"
    page.keyboard.press("p")
    until(page, lambda: score(page, "distance") > 0.1)
    page.evaluate(
        """() => {
          const file = { format: "jansen_env robot 1", design: "paper", lengths: { rocker: 0.24 } };
          const dataTransfer = new DataTransfer();
          dataTransfer.items.add(new File([JSON.stringify(file)], "mine.json"));
          dispatchEvent(new DragEvent("drop", { dataTransfer }));
        }"""
    )
    until(page, lambda: page.locator("#robot").input_value() == "paper&rocker=240")
    page.locator("#bench").click()
    page.locator("#lengths").wait_for(timeout=WAIT)
    assert page.evaluate("location.hash") == "#paper&rocker=240"


def test_questions_have_answers(opened):
    page = opened()
    page.get_by_text("Six questions").last.click()
    for number in range(1, 7):
        reads(page, "lesson-title", f"^{number}\\. ")
        reads(page, "answer", r"^[^\u2013]*\d[^\u2013]*$")  # no number is missing
        page.locator("#lesson-next").click()
    reads(page, "lesson-title", "^1\\. ")


def test_a_ground_is_drawn(opened):
    """It is level up to the robot, then as drawn, and in the link; the walk starts again on it."""
    page = opened("terrain=stairs&level=3")
    page.get_by_text("Draw ground").click()
    page.wait_for_timeout(100)  # for the picture of all of it
    box = page.locator("#pictures canvas").first.bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, 40):
        page.mouse.move(x + 10 * k, y + 20 * np.sin(0.2 * k))
    page.mouse.up()
    assert page.locator("#terrain").input_value() == "drawn"
    link = page.evaluate("location.hash.slice(1)")
    ground = re.search("ground=([^&]*)", link)[1].replace("%2C", ",").split(",")
    places = np.array(ground, int).reshape(-1, 2)
    assert places[0, 0] > 60 and (np.diff(places[:, 0]) >= 3).all() and np.ptp(places[:, 1]) > 20
    until(page, lambda: score(page, "time") > 0.1)
    assert opened(link).locator("#terrain").input_value() == "drawn"


def test_a_walk_is_saved(opened):
    """The file has its start, and what came in each step."""
    page = opened("control=hand&friction=0.5")
    page.keyboard.press(" ")
    page.keyboard.press("p")
    until(page, lambda: score(page, "time") > 0.3)
    page.keyboard.press("p")
    with page.expect_download() as saved:
        page.locator("#save").click()
    walk = json.loads(saved.value.path().read_text())
    assert walk["format"] == "jansen_env walk 1" and walk["robot"]["name"] == "built"
    assert walk["start"]["changes"] == {"friction": 0.5}
    assert walk["steps"][0] == {"action": 0, "command": pytest.approx(0.3), "pushes": [[3, 0]]}
    assert len(walk_again(saved.value.path()).state) == 1 + len(walk["steps"])
    assert 0.02 * len(walk["steps"]) == pytest.approx(settled(page, "time"), abs=0.06)


def test_time_goes_back(opened):
    """It goes to an earlier place, and from there the same walk follows again."""
    page = opened("terrain=waves&level=2")
    page.keyboard.press("p")
    until(page, lambda: score(page, "time") > 1.6)
    page.keyboard.press("p")
    time = settled(page, "time")
    page.keyboard.press(",")
    page.keyboard.press(",")
    reads(page, "past-value", "s$")
    before = page.locator("#pictures canvas").first.screenshot()
    page.keyboard.press("p")
    until(page, lambda: page.locator("#past-value").text_content() == "now")
    page.keyboard.press("p")
    assert settled(page, "time") < time
    assert page.locator("#pictures canvas").first.screenshot() != before


def test_a_gamepad_is_the_input(opened):
    page = opened("control=hand")
    page.evaluate(
        """() => {
          const pad = { connected: true, axes: [-0.5, 0], buttons: [{ pressed: false }] };
          const other = { connected: true, axes: [], buttons: [] }; // such as a keyboard's
          window.pad = pad;
          navigator.getGamepads = () => [null, other, pad];
        }"""
    )
    reads(page, "input-value", r"^-6\.0 N m$")
    page.evaluate("window.pad.axes = [0.05, 0]")
    reads(page, "input-value", r"^0\.0 N m$")


@pytest.mark.parametrize("across", [False, True])
def test_on_a_phone_in_the_dark(opened, across):
    width, height = PHONE["viewport"].values()
    size = {"width": height, "height": width} if across else PHONE["viewport"]
    page = opened("robot2=klann", **{**PHONE, "viewport": size}, color_scheme="dark")
    until(page, lambda: score(page, "time", 1) > 0.3)
    pixel = "document.querySelector('canvas').getContext('2d').getImageData(3, 3, 1, 1).data"
    assert max(page.evaluate(f"[...{pixel}]")[:3]) < 60
    assert page.evaluate("document.documentElement.scrollWidth") == size["width"]
    if not across:
        check_phone(page)
    before = page.locator("#input-value").text_content()
    page.locator("#left").dispatch_event("pointerdown")
    until(page, lambda: page.locator("#input-value").text_content() < before)
    page.locator("#left").dispatch_event("pointerup")
    page.locator("#show-help").tap()
    assert page.get_by_text("hold \u25c0 \u25b6").is_visible()
    assert not page.locator("kbd").first.is_visible()


@pytest.mark.parametrize("width", [358, 736])
def test_nothing_is_cut_in_a_frame(open_window, path, width):
    """Two pictures with their scores are whole at any width, as on the documentation's
    first page.
    """
    page = open_window(viewport={"width": width, "height": 688}).page
    page.goto(f"{path.as_uri()}?embedded#terrain=stairs&level=4&robot2=built&control2=pid")
    until(page, lambda: score(page, "time", 1) > 0.1)
    size = "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    assert page.evaluate(size) == [width, 688]
    assert not page.locator("#panel").is_visible()
    boxes = [canvas.bounding_box() for canvas in page.locator("#pictures canvas").all()]
    assert min(box["height"] for box in boxes) > 150
    captions = [caption.bounding_box() for caption in page.locator("figcaption").all()]
    assert captions[-1]["y"] + captions[-1]["height"] <= 688


@pytest.mark.slow
def test_the_command_writes_both_pages(tmp_path, capsys, monkeypatch):
    links = []
    monkeypatch.setattr(webbrowser, "open", links.append)
    main(["--env", "JansenWalkerRough-v0", "--level", "4", "--out", str(tmp_path / "x")])
    walk, bench = (tmp_path / "x" / name for name in ("walk.html", "bench.html"))
    assert capsys.readouterr().out.split() == [str(walk), str(bench)]
    assert links == [walk.as_uri()]
    start = "robot=built terrain=mixed level=4 seed=0 control=rough+policy"
    assert r"\u0026".join(start.split()) in walk.read_text()
    for wrong in (
        ["--level", "3"],
        ["--seed", "-1"],
        ["--out", "/proc/x", "--no-open"],
        ["--policy", "robust", "--env", "JansenWalker-v0"],
    ):
        with pytest.raises(SystemExit):
            main(wrong)
        assert ": error: " in capsys.readouterr().err.splitlines()[0]
    main(["--bench", "--robot", "klann", "--out", str(tmp_path)])
    assert '"robot=klann' in (tmp_path / "walk.html").read_text()
    assert links[1:] == [(tmp_path / "bench.html").as_uri()]
