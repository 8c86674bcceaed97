"""The page on which robots walk, simulated by the compiled engine in the browser."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from jansen_env.files import write_text
from jansen_env.robot import Robot
from jansen_env.viewer.web.engine_data import RUNS, Json
from jansen_env.viewer.web.page import page_of
from jansen_env.viewer.web.walk_data import walk_data

# Networks whose weights have more characters in base64 can be stored in separate files.
LARGE = 200_000


def write_walk(
    path: str | Path,
    start: str = "",
    apart: bool = False,
    robots: Mapping[str, Robot] | None = None,
) -> Path:
    """Write the page as one HTML file that contains the engine, robots, policies and terrains.

    Args:
        path: Path of the file.
        start: Initial choices on the page, in the form of the page's links.
        apart: Whether large networks are stored in separate files in the same folder. The page then
            loads a network when the user chooses it. Use this for a page on a server: the page
            becomes half as large.
        robots: Robots on the page, by name. None selects the built-in designs.

    Returns:
        The path of the file.
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
    """Write weights as a script, named by the hash of its content so that pages never mix files."""
    name = f"network-{hashlib.sha256(weights.encode()).hexdigest()[:16]}.js"
    script = f"(globalThis.jansenNetworks ??= {{}})[{json.dumps(name)}] = {json.dumps(weights)};\n"
    write_text(folder / name, script)
    return {"weights": None, "file": name}
