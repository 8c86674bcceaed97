"""The replay page in a real browser: it plays, is right, and can be used by everybody."""

import gymnasium as gym
import numpy as np
import pytest
from browser import NAMELESS, PHONE, check_phone

import jansen_env  # noqa: F401 - registers the environments
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.web.page import frame_of, write_page

PIXELS = "canvas => canvas.toDataURL()"
DIGITS = {"crankSpeed": 2, "torque": 2, "power": 2, "returned": 1}  # 3 of the others
STILL = {"reduced_motion": "reduce"}
SLOW = "0.25"  # a replay that cannot reach its end between two looks of a busy machine


def recorded(env_id, label, amplitude, **arguments):
    env = Recorder(gym.make(env_id, **arguments), label)
    env.reset(seed=1)
    for k in range(100):
        env.step(np.array([0.1 + amplitude * np.sin(0.1 * k)], np.float32))
    return env.recording


@pytest.fixture(scope="module")
def recordings():
    return [recorded("JansenWalker-v0", f"robot {a}", a, speed_command=0.3) for a in (0.1, 0.2)]


@pytest.fixture
def opened(open_window, recordings, tmp_path):
    """A function to the window of a page with the first recordings of a number."""

    def window(count=1, shown=None, **options):
        path = write_page(tmp_path / "replay.html", *(shown or recordings[:count]))
        window = open_window(**options)
        window.page.goto(path.as_uri())
        assert window.requests == [path.as_uri()]
        return window

    return window


def time_of(page):
    return float(page.inner_text("#time").removesuffix(" s"))


def numbers(page, i=0):
    cells = page.locator(f"td[data-recording='{i}']")
    values = cells.evaluate_all("all => all.map(e => [e.dataset.name, e.textContent])")
    return {name: float(text) if text != "\u2013" else None for name, text in values}


def expected(episode, k):
    """What it should say of a control step, from the recording."""
    distance = episode.pose[k, 0] - episode.pose[0, 0]
    slipped = episode.slip[:k].sum()
    work = np.abs(episode.energy_of("motor_work"))[:k].sum()
    return {
        "command": episode.command[k],
        "speed": episode.speed[k],
        "crankSpeed": episode.crank_speed[k],
        "torque": episode.torque[k],
        "power": episode.power[k - 1],
        "position": episode.pose[k, 0],
        "slip": episode.slip[k - 1].sum() / (episode.time[k] - episode.time[k - 1]),
        "pitch": episode.pose[k, 2],
        "returned": episode.reward[:k].sum(),
        "slipPerMetre": slipped / distance if distance > 1e-3 else None,
        "costOfTransport": work / episode.weight[k] / distance if distance > 1e-3 else None,
    }


def check(page, recordings, k):
    for i, episode in enumerate(recordings):
        for name, value in expected(episode, k).items():
            number = numbers(page, i)[name]
            if value is None:
                assert number is None, name
            else:
                assert number == pytest.approx(value, abs=0.501 * 0.1 ** DIGITS.get(name, 3)), name


def settled(page):
    for _ in range(2):
        page.evaluate("() => new Promise(requestAnimationFrame)")


def test_it_plays(opened):
    page = opened().page
    picture = page.locator("#stage canvas")
    page.select_option("#rate", SLOW)
    page.wait_for_function("() => parseFloat(document.querySelector('#time').value) > 0.3")
    first = time_of(page)
    pixels = picture.evaluate(PIXELS)
    later = f"() => parseFloat(document.querySelector('#time').value) > {first} + 0.2"
    page.wait_for_function(later)
    assert picture.evaluate(PIXELS) != pixels
    page.select_option("#rate", "4")
    page.wait_for_function("() => document.querySelector('#play').ariaLabel.startsWith('Play')")
    assert time_of(page) == 2.0
    page.select_option("#rate", SLOW)
    page.click("#play")
    page.wait_for_function("() => parseFloat(document.querySelector('#time').value) < 1.5")
    page.click("#play")
    page.wait_for_function("() => document.querySelector('#play').ariaLabel.startsWith('Play')")
    settled(page)
    stopped = time_of(page)
    page.wait_for_timeout(150)
    assert time_of(page) == stopped > 0.0


def test_numbers_are_those_of_the_recording(opened, recordings):
    """They are after scrubbing, and after a click in a plot, whose curve is where the number is."""
    page = opened(2, **STILL).page
    for time in (0.0, 0.5, 1.3, 2.0):
        scrub = f"e => {{ e.value = {time + 0.004}; e.dispatchEvent(new Event('input')); }}"
        page.locator("#scrub").evaluate(scrub)
        settled(page)
        assert time_of(page) == time
        if time:
            check(page, recordings, round(time / 0.02))
    plot = page.locator("#plots canvas").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    before = plot.evaluate(PIXELS)
    page.mouse.click(box["x"] + 38 + 0.25 * (box["width"] - 44), box["y"] + 20)
    settled(page)
    assert time_of(page) == pytest.approx(0.5, abs=0.021)
    assert plot.evaluate(PIXELS) != before
    check(page, recordings, round(time_of(page) / 0.02))


def test_the_keyboard_is_enough(opened, recordings):
    page = opened(2, **STILL).page
    assert page.evaluate(NAMELESS) == []
    assert page.get_attribute("html", "lang") == "en" and page.title() == "robot 0.1 and robot 0.2"
    assert page.locator("#scrub").get_attribute("aria-valuetext") == "0.00 s of 2.00 s"
    picture = page.locator("#stage canvas").first
    press = page.keyboard.press

    def changed(key):
        before = picture.evaluate(PIXELS)
        press(key)
        settled(page)
        return picture.evaluate(PIXELS) != before

    assert time_of(page) == 0.0  # reduced motion
    press("Space")
    page.wait_for_function("() => parseFloat(document.querySelector('#time').value) > 0.1")
    press("Space")
    press("Home")
    for _ in range(30):
        press("ArrowRight")
    press("ArrowLeft")
    settled(page)
    assert time_of(page) == 0.58
    check(page, recordings, 29)
    assert "0.58 s: robot 0.1" in page.text_content("#status")
    press("Shift+ArrowRight")
    settled(page)
    assert time_of(page) == 1.08
    press("End")
    settled(page)
    assert time_of(page) == 2.0
    press("Shift+ArrowLeft")
    for key in ("+", "w", "a", "0", "-", "s", "d", "0", "c", "t", "g"):
        assert changed(key), key
    pressed = [page.get_attribute(f"#{name}", "aria-pressed") for name in ("ghosts", "forces")]
    assert pressed == ["true", "false"]
    assert page.locator("#stage canvas:visible").count() == 1
    assert not changed("f") and changed("ArrowRight")  # it stays where it is, the robot moves
    assert page.get_attribute("#follow", "aria-pressed") == "false"
    press(",")
    assert page.input_value("#rate") == "0.5"
    press("?")
    assert page.locator("#keys").is_visible()
    press("Escape")
    assert not page.locator("#keys").is_visible()
    visited = []
    for _ in range(12):
        press("Tab")
        visited.append(page.evaluate("document.activeElement.id"))
        outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert visited[-1] == "" or outline != "none", visited
    controls = page.locator("button:visible, input:visible, select:visible")
    assert {*controls.evaluate_all("all => all.map(e => e.id)")} <= {*visited}
    page.focus("#forces")
    press("Space")  # presses the button that has the focus, and does not play
    assert page.get_attribute("#forces", "aria-pressed") == "true"
    assert page.get_attribute("#play", "aria-label") == "Play (space)"


def test_wheel_drag_and_pinch(opened):
    window = opened(**STILL, has_touch=True)
    page = window.page
    picture = window.page.locator("#stage canvas")
    box = picture.bounding_box()
    x, y = box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"]
    settled(page)
    seen = {picture.evaluate(PIXELS)}

    def fresh():
        settled(page)
        pixels = picture.evaluate(PIXELS)
        new = pixels not in seen
        seen.add(pixels)
        return new

    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    assert fresh()
    assert page.evaluate("scrollY") == 0
    page.mouse.down()
    page.mouse.move(x + 60, y + 10)
    page.mouse.up()
    assert fresh()
    fingers = page.context.new_cdp_session(page)
    for kind, apart in (("touchStart", 20), ("touchMove", 60), ("touchMove", 90), ("touchEnd", 0)):
        points = [{"x": x - apart, "y": y, "id": 1}, {"x": x + apart, "y": y, "id": 2}]
        touch = {"type": kind, "touchPoints": points if apart else []}
        fingers.send("Input.dispatchTouchEvent", touch)
    assert fresh()
    page.keyboard.press("f")
    assert page.get_attribute("#follow", "aria-pressed") == "false"
    page.click("#fit")
    assert page.get_attribute("#follow", "aria-pressed") == "true"


def test_fingers_are_large(opened):
    """Controls have 44 pixels, help has no keys, and a tapped word explains itself."""
    page = opened(2, **STILL, **PHONE).page
    check_phone(page)
    page.tap("#help")
    assert page.locator("#keys").is_visible() and not page.locator("kbd").first.is_visible()
    page.tap("#keys button")
    page.tap("th:has-text('cost of transport')")
    shown = "getComputedStyle(document.activeElement, '::after').content"
    assert page.evaluate(shown).startswith('"Work of the motor per weight and distance')


def test_the_crank_has_no_ground(opened):
    episode = recorded("JansenCrank-v0", "crank", 0.1)
    page = opened(shown=[episode], **STILL).page
    page.keyboard.press("g")  # there is no second one
    page.keyboard.press("End")
    settled(page)
    shown = numbers(page)
    assert shown["speed"] == pytest.approx(episode.crank_speed[-1], abs=6e-4)
    assert "slip" not in shown and not page.locator("#legend").is_visible()
    assert page.locator("#stage canvas").evaluate(PIXELS)


def test_names_are_text(opened, open_window, recordings, tmp_path):
    """They are no markup or code, in the page and in a notebook's frame, which may not do
    anything.
    """
    evil = "</script><script>document.title='x'</script><img src=x onerror=alert(1)>\"'&"
    episode = recorded("JansenWalker-v0", evil, 0.1)
    page = opened(shown=[episode], **STILL).page
    assert page.inner_text("h1") == evil == page.title()
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!doctype html><p>before</p>{episode._repr_html_()}", encoding="utf-8")
    window = open_window(**STILL)
    window.page.goto(notebook.as_uri())
    frame = window.page.frame_locator("iframe")
    assert frame.locator("h1").inner_text() == evil
    frame.locator("#play").focus()
    window.page.keyboard.press("End")
    frame.locator("#time", has_text="2.00 s").wait_for()
    assert len(window.requests) == 1 or all(u.startswith("about:") for u in window.requests[1:])
    assert frame_of(episode) == episode._repr_html_()
