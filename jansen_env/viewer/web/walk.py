"""The page on which robots walk, by the compiled engine in the browser."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from jansen_env.files import write_text
from jansen_env.robot import Robot
from jansen_env.viewer.web.engine_data import RUNS, Json
from jansen_env.viewer.web.page import page_of
from jansen_env.viewer.web.walk_data import walk_data

LARGE = 200_000  # characters of a network's weights in base64, from which on it has its own file


def write_walk(
    path: str | Path,
    start: str = "",
    apart: bool = False,
    robots: Mapping[str, Robot] | None = None,
) -> Path:
    """Write the page as one HTML file, with engine, robots, policies and grounds in it.

    Args:
        path: The file.
        start: First choices, as they stand in the page's links.
        apart: Whether large networks stand in files beside the page, which loads a network when it
            is chosen. For a page on a server: it is then half as large.
        robots: Robots on the page, by name. None selects the built-in designs.
    """
    data = {**walk_data(robots), "start": start}
    runs = RUNS
    if apart:
        runs += " 'self'"
        for policy in data["policies"].values():
            if len(policy["weights"]) > LARGE:
                policy |= _write_weights(Path(path).parent, policy["weights"])
    return write_text(path, page_of("walk", data, runs=runs))


def _write_weights(folder: Path, weights: str) -> Json:
    """Write weights as a script, named by its content so that it cannot be another page's."""
    name = f"network-{hashlib.sha256(weights.encode()).hexdigest()[:16]}.js"
    script = f"(globalThis.jansenNetworks ??= {{}})[{json.dumps(name)}] = {json.dumps(weights)};\n"
    write_text(folder / name, script)
    return {"weights": None, "file": name}
