"""The page on which robots walk, by the compiled engine in the browser."""

from pathlib import Path

from jansen_env.files import write_text
from jansen_env.viewer.web.page import page_of
from jansen_env.viewer.web.walk_data import walk_data


def write_walk(path: str | Path, start: str = "") -> Path:
    """Write the page as one HTML file, with engine, robots, policies and grounds in it.

    start: its first choices, as they stand in the page's links.
    """
    data = {**walk_data(), "start": start}
    return write_text(path, page_of("walk", data, runs="'wasm-unsafe-eval'"))
