"""The page on which robots walk, by the compiled engine in the browser."""

from __future__ import annotations

from pathlib import Path

from jansen_env.files import write_text
from jansen_env.viewer.web.page import page_of
from jansen_env.viewer.web.walk_data import walk_data


def walk_page(start: str = "") -> str:
    """Return the page as one HTML file, with engine, robots, policies and grounds in it.

    start: its first choices, as they stand in the page's links.
    """
    return page_of("walk", {**walk_data(), "start": start}, runs="'wasm-unsafe-eval'")


def write_walk(path: str | Path, start: str = "") -> Path:
    """Write :func:`walk_page` atomically. Raises OSError: it cannot be written."""
    return write_text(path, walk_page(start))
