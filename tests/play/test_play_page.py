"""The page to walk a robot by hand, in a real Chromium against a real server."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from page_client import WAIT, reads

LAN = """from jansen_env.commands import play
from jansen_env.play import server
server.own_address = lambda: "127.0.0.1"
play.main(["--host", "0.0.0.0", "--port", "0"])"""


def start(port="0", policy="hand", code=None):
    """A program, or one of this code, and the link it prints."""
    program = ["-m", "jansen_env", "play", "--port", port, "--policy", policy, "--env",
               "JansenWalker-v0"]  # whose rigid feet can bounce  # fmt: skip
    process = subprocess.Popen(
        [sys.executable, *(["-c", code] if code else program)],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    return process, process.stdout.readline().strip()


def stop(process):
    process.terminate()
    process.communicate(timeout=10)


@pytest.fixture
def window(open_window):
    """The page of a new session, which keeps the last message of each kind; ``heard`` has them."""
    process, address = start()
    opened = open_window(viewport={"width": 1200, "height": 720}, reduced_motion="reduce")
    heard = {}

    def keep(frame):
        message = json.loads(frame)
        heard[message["kind"]] = message

    opened.page.on("websocket", lambda socket: socket.on("framereceived", keep))
    opened.page.goto(address)
    opened.heard, opened.process, opened.address = heard, process, address
    opened.page.locator("#terrain").wait_for(timeout=WAIT)
    yield opened
    stop(opened.process)


def pixels(page):
    return page.locator("#picture").screenshot()


def settings(window, name):
    return next(s["value"] for s in window.heard["scene"]["sliders"] if s["name"] == name)


def soon(window, condition):
    """Wait until something is the case here, while the page goes on."""
    for _ in range(WAIT // 20):
        if condition():
            return True
        window.page.wait_for_timeout(20)
    return False


def test_keys_turn_the_crank_and_the_score_follows(window):
    page = window.page
    assert page.locator("#help").is_visible()
    before = pixels(page)
    page.keyboard.down("ArrowRight")
    reads(page, "input-value", r"^20\.0 N m$")
    assert not page.locator("#help").is_visible()
    reads(page, "distance", r"^(0\.[1-9]|[1-9])")
    reads(page, "slip", r"^\d+\.\d{3} m/m$")
    page.keyboard.up("ArrowRight")
    reads(page, "input-value", r"^0\.0 N m$")
    assert pixels(page) != before
    page.keyboard.down("ArrowLeft")
    reads(page, "input-value", r"^-\d")
    page.keyboard.up("ArrowLeft")
    page.keyboard.press("r")
    reads(page, "time", r"^0\.\d s$")


def test_sliders_change_the_robots_world(window):
    page = window.page
    page.keyboard.press("h")
    box = page.locator("#friction").bounding_box()
    x, y = box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.click(x, y)
    assert soon(window, lambda: settings(window, "friction") == pytest.approx(0.3, abs=0.08))
    shown = f"{settings(window, 'friction'):.2f}"
    reads(page, "friction-value", f"^{shown}$")
    page.keyboard.down("ArrowRight")  # the robot's again
    reads(page, "input-value", r"^20\.0 N m$")
    page.keyboard.up("ArrowRight")
    assert page.locator("#friction").input_value() == f"{float(shown):g}"
    page.get_by_label("payload", exact=True).focus()  # and a slider's with the focus on it
    page.keyboard.press("ArrowRight")
    assert soon(window, lambda: settings(window, "payload") == pytest.approx(0.01))
    page.get_by_label("slope", exact=True).fill("-0.1")
    assert soon(window, lambda: settings(window, "tilt") == pytest.approx(-0.1))


def test_a_policy_walks_and_time_stands_still_behind_help(open_window):
    """From the start, on a page whose link has a token; a second page does not stop it."""
    process, address = start(code=LAN)
    try:
        page = open_window().page
        page.goto(address)
        page.locator("#terrain").wait_for(timeout=WAIT)
        assert page.locator("#control").input_value() == "ppo"
        reads(page, "help-control", "^“ppo” turns the crank")

        def stands():
            page.wait_for_timeout(300)
            before = page.locator("#time").text_content()
            page.wait_for_timeout(500)
            return page.locator("#time").text_content() == before

        assert stands() and page.locator("#distance").text_content() == "0.00 m"
        page.locator("#begin").click()
        reads(page, "distance", r"^(0\.[2-9]|[1-9])")
        page.keyboard.press("h")
        assert stands() and page.locator("#message").is_hidden()
        page.keyboard.press("Escape")
        assert not stands() and not page.locator("#help").is_visible()
        other = open_window().page
        other.goto(address)
        other.locator("#terrain").wait_for(timeout=WAIT)
        assert not stands() and not other.locator("#help").is_visible()
        page.keyboard.press("h")
        assert stands()
        other.keyboard.press("p")
        page.locator("#help").wait_for(state="hidden", timeout=WAIT)
        assert not stands()
        for keys in "p", "hh":  # help leaves a pause as it was
            for key in keys:
                page.keyboard.press(key)
            assert stands()
        page.keyboard.press("p")
        page.locator("#bench").click()
        page.wait_for_url(re.compile(f"^{address}bench#built$"), timeout=WAIT)
        page.locator("#walk").click()
        page.wait_for_url(f"{address}#walk", timeout=WAIT)
        reads(page, "input-label", "^speed command$")
    finally:
        stop(process)


def test_the_hand_takes_the_crank_and_gives_it_back(window):
    page, heard = window.page, window.heard
    page.locator("#help .take").click()
    assert soon(window, lambda: heard["scene"]["choices"]["control"] == "ppo")
    assert not page.locator("#help").is_visible()
    reads(page, "input-label", "^speed command$")
    page.keyboard.press("c")
    assert soon(window, lambda: heard["scene"]["choices"]["control"] == "torque")
    assert page.locator("#panel .take").text_content() == "Let “ppo” walk"
    page.get_by_label("control", exact=True).select_option("constant speed")
    assert soon(window, lambda: heard["scene"]["choices"]["control"] == "constant speed")
    page.locator("#panel .take").click()
    reads(page, "input-label", "^torque$")


def test_clicks_and_drags_push(window):
    page, heard, sent = window.page, window.heard, []
    page.on("websocket", lambda socket: socket.on("framesent", lambda frame: sent.append(frame)))
    page.reload()
    page.locator("#terrain").wait_for(timeout=WAIT)
    page.keyboard.press("Escape")
    page.locator("#help").wait_for(state="hidden", timeout=WAIT)
    box = page.locator("#picture").bounding_box()
    x, y = box["x"] + 0.2 * box["width"], box["y"] + 0.5 * box["height"]

    def pushed(right):
        sent.clear()
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + right, y)
        page.mouse.up()
        assert soon(window, lambda: any('"push"' in frame for frame in sent))
        return next(m for m in map(json.loads, sent) if m["do"] == "push")

    click = pushed(0.0)
    assert click["x"] > 2.5 and np.hypot(click["x"], click["y"]) == pytest.approx(3.0)
    assert pushed(-100.0) == {"do": "push", "x": pytest.approx(-3.0), "y": 0.0}
    assert pushed(600.0)["x"] == heard["scene"]["largestPush"]


def test_a_gamepad_is_the_input(window):
    page = window.page
    page.evaluate(
        """() => {
          const pad = { connected: true, axes: [-0.5, 0], buttons: [{ pressed: false }] };
          window.pad = pad;
          const other = { connected: true, axes: [], buttons: [] }; // such as a keyboard's
          navigator.getGamepads = () => [null, other, pad];
        }"""
    )
    reads(page, "input-value", r"^-10\.0 N m$")
    page.evaluate("window.pad.axes = [0.05, 0]")
    reads(page, "input-value", r"^0\.0 N m$")
    reads(page, "time", r"^[3-9]\.\d s$")
    page.evaluate("window.pad.buttons = [{ pressed: true }]")
    reads(page, "time", r"^[01]\.\d s$")


def test_it_comes_back_when_the_program_does(window):
    page = window.page
    stop(window.process)
    reads(page, "message", "No connection")
    window.process, _ = start(window.address.rsplit(":", 1)[1])
    page.locator("#message").wait_for(state="hidden", timeout=2 * WAIT)
    page.keyboard.press("r")
    reads(page, "time", r"^0\.\d s$")
    assert all("WebSocket" in error for error in window.errors)  # what the browser says of that
    window.errors.clear()


def test_on_a_phone_in_the_dark_by_touch(open_window):
    process, address = start()
    try:
        found = open_window(
            viewport={"width": 360, "height": 740}, color_scheme="dark", has_touch=True,
            is_mobile=True, device_scale_factor=2,
        )  # fmt: skip
        page = found.page
        page.goto(address)
        page.locator("#begin").tap()
        reads(page, "time", r"^0\.[5-9]|^[1-9]")
        assert page.evaluate("document.documentElement.scrollWidth") == 360
        page.locator("#show-help").tap()
        assert page.get_by_text("hold ◀ ▶").is_visible()
        assert not page.locator("kbd").first.is_visible()
        for control in page.locator("button:visible, input:visible, select:visible, a").all():
            box = control.bounding_box()
            assert box["height"] >= 43.9 and box["width"] >= 43.9
        page.locator("#begin").tap()
        sky = page.evaluate(
            "[...document.getElementById('picture').getContext('2d').getImageData(3, 3, 1, 1).data]"
        )
        assert max(sky[:3]) < 60
        page.locator("#right").dispatch_event("pointerdown")
        reads(page, "input-value", r"^20\.0 N m$")
        page.locator("#right").dispatch_event("pointerup")
        reads(page, "input-value", r"^0\.0 N m$")
        assert all(url.startswith(address) for url in found.requests)
        names = page.evaluate(
            """() => [...document.querySelectorAll("button, select, input, canvas")].map((e) =>
              e.getAttribute("aria-label") || e.labels?.[0]?.textContent || e.textContent)"""
        )
        assert len(names) > 15 and all(name.strip() for name in names)
    finally:
        stop(process)
