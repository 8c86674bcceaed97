"""Chromium for the tests of pages: skipped, with a reason, where it or playwright is missing.

With $CHROMIUM set, or $JANSEN_ENV_BROWSER "required", they fail there. The fixtures are
``conftest.py``'s; what a page reports is checked at the end.
"""

import json
import math
import os
import re
import shutil
import socket
import subprocess
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from jansen_env.viewer.web.page import FOLDER

ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

WAIT = 30_000  # ms that a page may take
PHONE = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True}
NAMELESS = """() => [...document.querySelectorAll("button, input, select, canvas, dialog, .handle")]
    .filter((e) => !(e.ariaLabel || e.textContent.trim() || e.labels?.length
        || e.getAttribute("aria-labelledby")))
    .map((e) => e.outerHTML)"""
"""Controls that a screen reader has no word for."""


def check_phone(page: Any) -> None:
    """Check that nothing is wider than a phone, and all controls are large enough for a finger."""
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    kinds = ("button", "a.button", "select", "input:not([type=checkbox])")
    for control in page.locator(", ".join(f"{kind}:visible" for kind in kinds)).all():
        box = control.bounding_box()
        assert box["height"] >= 43.9 and box["width"] >= 43.9, control.inner_text()


def reads(page: Any, name: str, pattern: str, timeout: float = WAIT) -> None:
    """Wait until an element's text matches a pattern."""
    from playwright.sync_api import expect

    expect(page.locator(f"#{name}")).to_have_text(re.compile(pattern), timeout=timeout)


def wait_for_walk(page: Any) -> None:
    """Wait until the walk page has begun, and listens to keys."""
    page.locator("#robot").wait_for(timeout=WAIT)
    page.locator("#starting").wait_for(state="detached", timeout=WAIT)


def chromium() -> str | None:
    """Where the browser is: $CHROMIUM, or else one on the path."""
    given = os.environ.get("CHROMIUM")
    names = [given] if given else ["chromium", "chromium-browser", "google-chrome"]
    return next((path for name in names if (path := shutil.which(name))), None)


def missing(reason: str) -> None:
    """Skip, or fail where a browser is asked for."""
    if "CHROMIUM" in os.environ or os.environ.get("JANSEN_ENV_BROWSER") == "required":
        pytest.fail(reason)
    pytest.skip(reason)


def in_node(script: str, **asked: Any) -> Any:
    """What a script for Node.js prints as JSON, with ``asked`` as its input; FOLDER: the pages'."""
    if shutil.which("node") is None:
        pytest.skip("Node.js is not installed")
    command = ["node", "--input-type=module", "-e", script.replace("FOLDER", str(FOLDER))]
    done = subprocess.run(command, input=json.dumps(asked), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="session")
def browser():
    """One browser for all tests."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright is missing: pip install --group browser")
    if (path := chromium()) is None:
        missing("Chromium is missing: apt-get install chromium, or set $CHROMIUM")
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield started
        started.close()


class Firefox:
    """A Firefox with a profile of its own in a folder, driven by its Marionette."""

    def __init__(self, path: str, folder: Path) -> None:
        lines = [
            f'user_pref("browser.download.dir", {json.dumps(str(folder))});',
            'user_pref("browser.download.folderList", 2);',
            'user_pref("marionette.port", 0);',
        ]
        (folder / "user.js").write_text("\n".join(lines))
        command = [path, "--headless", "--marionette", "--no-remote", "--profile", str(folder)]
        silent = subprocess.DEVNULL
        self.process = subprocess.Popen(command, stdout=silent, stderr=silent)

    def connect(self, folder: Path) -> None:
        """Begin a session, once it listens."""
        port = wait_for(folder / "MarionetteActivePort")
        self.socket = socket.create_connection(("127.0.0.1", int(port.read_text())))
        self.replies = self.socket.makefile("rb")
        self.receive()
        self.call("NewSession")

    def receive(self) -> Any:
        """A message: its length, a colon, and JSON."""
        length = iter(partial(self.replies.read, 1), b":")
        return json.loads(self.replies.read(int(b"".join(length))))

    def call(self, name: str, **parameters: Any) -> Any:
        """The value of a WebDriver command."""
        message = json.dumps([0, 1, f"WebDriver:{name}", parameters])
        self.socket.sendall(f"{len(message)}:{message}".encode())
        _, _, error, result = self.receive()
        assert error is None, error
        return result.get("value")

    def evaluate(self, script: str) -> Any:
        """What a script returns in the page."""
        return self.call("ExecuteScript", script=script, args=[])


def wait_for(path: Path) -> Path:
    """A file, once it is there."""
    for _ in range(WAIT // 20):
        if path.exists() and path.stat().st_size:
            return path
        time.sleep(0.05)
    raise AssertionError(f"there is no {path.name} in time")


@pytest.fixture
def firefox(tmp_path):
    """Firefox, skipped where it is missing; it saves files in ``tmp_path``."""
    if (path := shutil.which("firefox") or shutil.which("firefox-esr")) is None:
        pytest.skip("Firefox is missing: apt-get install firefox-esr")
    started = Firefox(path, tmp_path)
    try:
        started.connect(tmp_path)
        yield started
        started.socket.close()
    finally:
        started.process.terminate()
        started.process.wait()


@dataclass
class Window:
    """A page, and what it has reported and asked for."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


def draw_path(page: Any) -> None:
    """Draw a path that is flat below on the bench, and wait for its leg."""
    page.click("#draw")
    box = page.locator("#picture").bounding_box()
    x, y = box["x"] + 0.4 * box["width"], box["y"] + 0.8 * box["height"]
    for k in range(40):
        angle = 2.0 * math.pi * k / 40
        page.mouse.move(x + 150.0 * math.cos(angle), y - 50.0 * max(math.sin(angle), 0.0))
        if k == 0:
            page.mouse.down()
    page.mouse.up()
    page.locator("#message", has_text="of the path's size away").wait_for()


@pytest.fixture
def open_window(browser):
    """A function from Playwright's options of a context to a :class:`Window`."""
    windows = []
    contexts = []

    def opened(**options: Any) -> Window:
        context = browser.new_context(**options)
        contexts.append(context)
        window = Window(context.new_page())
        windows.append(window)
        page = window.page
        errors = window.errors
        page.on("console", lambda m: m.type in ("error", "warning") and errors.append(m.text))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: window.requests.append(request.url))
        return window

    yield opened
    errors = [window.errors for window in windows]
    for context in contexts:
        context.close()
    assert not any(errors), errors
