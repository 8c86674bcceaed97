"""Chromium for the tests of pages: skipped, with a reason, where it or playwright is missing.

Import the fixtures; all that a page reports or asks for is kept and checked when it is closed.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from typing import Any

import pytest

ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip


def chromium() -> str | None:
    """Where the browser is: $CHROMIUM, or one on the path."""
    names = (os.environ.get("CHROMIUM"), "chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if name and (path := shutil.which(name))), None)


@pytest.fixture(scope="session")
def browser():
    """One browser for all tests."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is missing: pip install '.[browser]'"
    )
    path = chromium()
    if path is None:
        pytest.skip("Chromium is missing: apt-get install chromium, or set $CHROMIUM")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield started
        started.close()


@dataclass
class Window:
    """A page, and what it has reported and asked for."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@pytest.fixture
def open_window(browser):
    """A function from Playwright's options of a context to a :class:`Window`.

    At the end of the test no page may have reported an error or a warning.
    """
    windows, contexts = [], []

    def opened(**options: Any) -> Window:
        context = browser.new_context(**options)
        contexts.append(context)
        window = Window(context.new_page())
        windows.append(window)
        page, errors = window.page, window.errors
        page.on("console", lambda m: m.type in ("error", "warning") and errors.append(m.text))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: window.requests.append(request.url))
        return window

    yield opened
    found = [window.errors for window in windows]
    for context in contexts:
        context.close()
    assert not any(found), found
