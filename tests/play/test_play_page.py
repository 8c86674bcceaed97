"""The page to walk a robot by hand, in a real Chromium against a real server."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from browser import NAMELESS, PHONE, check_phone
from page_client import WAIT, reads

LAN = """from jansen_env.commands import play
from jansen_env.play import server
server.own_address = lambda: "127.0.0.1"
play.main(["--host", "0.0.0.0", "--port", "0"])"""
HAND = ["--policy", "hand", "--env", "JansenWalker-v0"]  # whose rigid feet can bounce


@pytest.fixture
def start():
    """A function from Python's arguments to a program, and the link it prints."""
    programs = []

    def started(*arguments):
        process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True)
        programs.append(process)
        return process, process.stdout.readline().strip()

    yield started
    for process in programs:
        process.terminate()
        process.communicate(timeout=10)


@pytest.fixture
def window(open_window, start):
    """The page of a new session; ``heard`` has the last message of each kind, ``sent`` all."""
    process, address = start("-m", "jansen_env", "play", "--port", "0", *HAND)
    opened = open_window(viewport={"width": 1200, "height": 720}, reduced_motion="reduce")
    opened.heard, opened.sent, opened.process, opened.address = {}, [], process, address

    def keep(frame):
        message = json.loads(frame)
        opened.heard[message["kind"]] = message

    def listen(socket):
        socket.on("framereceived", keep)
        socket.on("framesent", lambda frame: opened.sent.append(json.loads(frame)))

    opened.page.on("websocket", listen)
    opened.page.goto(address)
    opened.page.locator("#terrain").wait_for(timeout=WAIT)
    return opened


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
    before = page.locator("#picture").screenshot()
    page.keyboard.down("ArrowRight")
    reads(page, "input-value", r"^20\.0 N m$")
    assert not page.locator("#help").is_visible()
    reads(page, "distance", r"^(0\.[1-9]|[1-9])")
    reads(page, "slip", r"^\d+\.\d{3} m/m$")
    page.keyboard.up("ArrowRight")
    reads(page, "input-value", r"^0\.0 N m$")
    assert page.locator("#picture").screenshot() != before
    page.keyboard.down("ArrowLeft")
    reads(page, "input-value", r"^-\d")
    page.keyboard.up("ArrowLeft")
    page.keyboard.press("r")
    reads(page, "time", r"^0\.\d s$")


def test_sliders_change_the_robots_world(window):
    page = window.page
    page.keyboard.press("h")
    box = page.locator("#friction").bounding_box()
    page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"])
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


def test_a_policy_walks_and_time_stands_still_behind_help(open_window, start):
    """From the start, on a page whose link has a token; a second page does not stop it."""
    _, address = start("-c", LAN)
    page = open_window().page
    page.goto(address)
    page.locator("#terrain").wait_for(timeout=WAIT)
    assert page.locator("#control").input_value() == "ppo"
    reads(page, "help-control", "^“ppo” turns the crank")

    def stands():
        page.wait_for_timeout(200)
        before = page.locator("#time").text_content()
        page.wait_for_timeout(400)
        return page.locator("#time").text_content() == before

    assert stands() and page.locator("#distance").text_content() == "0.00 m"
    page.locator("#begin").click()
    reads(page, "distance", r"^(0\.[2-9]|[1-9])")
    other = open_window().page
    other.goto(address)
    other.locator("#terrain").wait_for(timeout=WAIT)
    assert not stands() and not other.locator("#help").is_visible()
    page.keyboard.press("h")
    assert stands() and page.locator("#message").is_hidden()
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


def test_the_hand_takes_the_crank_and_gives_it_back(window):
    page, heard = window.page, window.heard
    page.locator("#help .take").click()
    assert soon(window, lambda: heard["scene"]["choices"]["control"] == "ppo")
    assert not page.locator("#help").is_visible()
    reads(page, "input-label", "^speed command$")
    page.keyboard.press("c")
    assert soon(window, lambda: heard["scene"]["choices"]["control"] == "hand")
    assert page.locator("#panel .take").text_content() == "Let “ppo” walk"
    page.get_by_label("control", exact=True).select_option("constant speed")
    assert soon(window, lambda: heard["scene"]["choices"]["control"] == "constant speed")
    page.locator("#panel .take").click()
    reads(page, "input-label", "^torque$")


def test_clicks_and_drags_push(window):
    page = window.page
    page.keyboard.press("Escape")
    page.locator("#help").wait_for(state="hidden", timeout=WAIT)
    box = page.locator("#picture").bounding_box()
    x, y = box["x"] + 0.2 * box["width"], box["y"] + 0.5 * box["height"]

    def pushed(right):
        window.sent.clear()
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + right, y)
        page.mouse.up()
        assert soon(window, lambda: any(message["do"] == "push" for message in window.sent))
        return next(message for message in window.sent if message["do"] == "push")

    click = pushed(0.0)
    assert click["x"] > 2.5 and np.hypot(click["x"], click["y"]) == pytest.approx(3.0)
    assert pushed(-100.0) == {"do": "push", "x": pytest.approx(-3.0), "y": 0.0}
    assert pushed(600.0)["x"] == window.heard["scene"]["largestPush"]


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
    reads(page, "time", r"^[1-9]\.\d s$")
    page.evaluate("window.pad.buttons = [{ pressed: true }]")
    reads(page, "time", r"^0\.\d s$")


def test_it_comes_back_when_the_program_does(window, start):
    page = window.page
    window.process.terminate()
    window.process.wait(10)
    reads(page, "message", "No connection")
    start("-m", "jansen_env", "play", "--port", window.address.rsplit(":", 1)[1], *HAND)
    page.locator("#message").wait_for(state="hidden", timeout=2 * WAIT)
    page.keyboard.press("r")
    reads(page, "time", r"^0\.\d s$")
    assert all("WebSocket" in error for error in window.errors)  # what the browser says of that
    window.errors.clear()


def test_on_a_phone_in_the_dark_by_touch(open_window, start):
    _, address = start("-m", "jansen_env", "play", "--port", "0", *HAND)
    window = open_window(**PHONE, color_scheme="dark", device_scale_factor=2)
    page = window.page
    page.goto(address)
    page.locator("#begin").tap()
    reads(page, "time", r"^0\.[5-9]|^[1-9]")
    page.locator("#show-help").tap()
    assert page.get_by_text("hold ◀ ▶").is_visible()
    assert not page.locator("kbd").first.is_visible()
    check_phone(page)
    page.locator("#begin").tap()
    sky = page.evaluate(
        "[...document.getElementById('picture').getContext('2d').getImageData(3, 3, 1, 1).data]"
    )
    assert max(sky[:3]) < 60
    page.locator("#right").dispatch_event("pointerdown")
    reads(page, "input-value", r"^20\.0 N m$")
    page.locator("#right").dispatch_event("pointerup")
    reads(page, "input-value", r"^0\.0 N m$")
    assert all(url.startswith(address) for url in window.requests)
    assert page.evaluate(NAMELESS) == []
