"""Pages in browsers and on hosts that refuse something: they say what, in the page."""

import re
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import gymnasium as gym
import numpy as np
import pytest
from browser import WAIT, wait_for_walk

from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.web.bench import write_bench
from jansen_env.viewer.web.page import write_page
from jansen_env.viewer.web.walk import write_walk

PAGES = ("walk", "bench", "replay")
WITHOUT_SCRIPTS = "script-src 'none'"
SECONDS = re.compile(r"^[1-9]\.\d s$")
WITHOUT_WASM = "script-src 'unsafe-inline'"


class Handler(SimpleHTTPRequestHandler):
    """Serve a folder with a content security policy."""

    policy = ""

    def end_headers(self):
        """Add the policy to the headers."""
        if self.policy:
            self.send_header("Content-Security-Policy", self.policy)
        super().end_headers()

    def log_message(self, *_):
        """Stay silent."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with all pages."""
    folder = tmp_path_factory.mktemp("pages")
    write_walk(folder / "walk.html")
    write_bench(folder / "bench.html")
    env = Recorder(gym.make("JansenWalker-v0"))
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.zeros(1, np.float32))
    write_page(folder / "replay.html", env.recording)
    return folder


@pytest.fixture
def served(folder):
    """A function from a content security policy to the address at which a host serves the pages."""
    servers = []

    def start(policy):
        handler = type("WithPolicy", (Handler,), {"policy": policy})
        server = ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(folder)))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture
def page(browser):
    """A page whose errors are the test's own affair."""
    context = browser.new_context(reduced_motion="reduce")
    yield context.new_page()
    context.close()


def check_reason(page, text):
    """Check that the walking page says why it cannot walk, and shows nothing else."""
    page.locator("#reason", has_text=text).wait_for(timeout=WAIT)
    assert page.locator("#failed").is_visible()
    assert not page.locator("main").is_visible() and not page.locator("#starting").is_visible()


def test_a_browser_without_webassembly_is_told(page, folder):
    page.add_init_script("delete globalThis.WebAssembly;")
    page.goto((folder / "walk.html").as_uri())
    check_reason(page, "This browser has no WebAssembly")
    page.keyboard.press("ArrowRight")  # no errors of controls that are not there
    page.keyboard.press("c")
    assert page.locator("#failed").is_visible()


def test_a_host_that_forbids_webassembly_is_named(page, served):
    page.goto(f"{served(WITHOUT_WASM)}/walk.html")
    check_reason(page, "Content Security Policy")


def test_a_browser_that_refuses_synchronous_modules_walks(page, folder):
    """Some browsers compile no more than 4 kB at once."""
    page.add_init_script(
        """for (const name of ["Module", "Instance"])
             WebAssembly[name] = function () { throw new RangeError(`${name} is too large`); };"""
    )
    page.goto((folder / "walk.html").as_uri())
    wait_for_walk(page)
    page.keyboard.press("p")
    page.locator("figcaption dd", has_text=re.compile(r"^[1-9]\.\d s$")).first.wait_for(
        timeout=WAIT
    )


def test_a_replay_needs_no_webassembly(open_window, folder):
    page = open_window().page
    page.add_init_script("delete globalThis.WebAssembly;")
    page.goto((folder / "replay.html").as_uri())
    page.locator("#starting").wait_for(state="detached", timeout=WAIT)


def test_the_bench_says_that_it_needs_webassembly(page, folder):
    page.add_init_script("delete globalThis.WebAssembly;")
    page.goto((folder / "bench.html").as_uri())
    page.locator("#starting", has_text="This browser has no WebAssembly").wait_for(timeout=WAIT)
    assert not page.locator("main").is_visible()


@pytest.mark.parametrize("name", PAGES)
def test_a_page_whose_script_is_forbidden_says_so(page, served, name):
    page.goto(f"{served(WITHOUT_SCRIPTS)}/{name}.html")
    starting = page.locator("#starting")
    assert starting.is_visible() and "content security policy" in starting.text_content()


@pytest.mark.parametrize("name", PAGES)
def test_a_page_that_runs_does_not(open_window, folder, name):
    page = open_window().page
    page.goto((folder / f"{name}.html").as_uri())
    page.locator("#starting").wait_for(state="detached", timeout=WAIT)
    assert not page.locator("#failed").count() or not page.locator("#failed").is_visible()
