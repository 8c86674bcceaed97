"""Recordings as one HTML file that plays them, without a server, a network or other software.

``docs/replay.md`` describes how accurate the replay is. :func:`page_of` also makes the walking page
and the bench.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import shown
from jansen_env.files import write_text
from jansen_env.robot import Robot
from jansen_env.scoring.metrics import MIN_DISTANCE
from jansen_env.viewer.recording import Recording
from jansen_env.viewer.web.geometry import scene_of_robot

FOLDER = Path(__file__).parent
MOST_RECORDINGS = 2
MAX_BYTES = 2**26  # largest size of the recordings in a page; browsers open larger pages slowly
SINGLE_NUMBERS = 15  # values per frame besides joints and toes: time, pose, speeds, ...
VERTEX_BYTES = 52  # largest size of a vertex of the terrain as JSON
SEEN = 30.0  # length of terrain included beyond either end of the rollout, in m
LONGEST_TEXT = 500  # largest number of characters in the line under the title
FRAME_HEIGHT = 760  # height of a page in a notebook, in pixels


def page(*recordings: Recording) -> str:
    """Return the page of one recording, or of two recordings side by side.

    Args:
        *recordings: One or two recordings.

    Raises:
        ValueError: If there are no recordings or more than two, if one is of walking and the other
            of the crank alone, or if they need more than ``MAX_BYTES``.
    """
    if not 1 <= len(recordings) <= MOST_RECORDINGS:
        raise ValueError(f"page() must get 1 or 2 recordings, got {len(recordings)}")
    if len(units := {recording.speed_unit for recording in recordings}) > 1:
        raise ValueError(f"recordings must have speeds in one unit, got {sorted(units)}")
    labels = _labels(recordings)
    grounds = [_seen(recording) for recording in recordings]
    vertices = sum(0 if ground is None else len(ground) for ground in grounds)
    check_size([(recording.robot, recording.steps) for recording in recordings], vertices)
    data = {
        "title": " and ".join(labels),
        "subtitle": _subtitle(recordings),
        # Two robots in one picture need the same terrain.
        "comparable": all(np.array_equal(r.terrain, recordings[0].terrain) for r in recordings),
        "recordings": [
            {"label": label, **_packed(recording, ground)}
            for label, recording, ground in zip(labels, recordings, grounds, strict=True)
        ],
    }
    title = f"<title>{html.escape(' and '.join(labels))}</title>"
    return page_of("replay", data, {"<title>Replay</title>": title})


def check_size(walks: Sequence[tuple[Robot, int]], vertices: int = 0) -> None:
    """Check that rollouts need at most ``MAX_BYTES`` of a page.

    Args:
        walks: Robot and number of steps of each rollout.
        vertices: Total number of vertices of the terrains that can come into view.

    Raises:
        ValueError: If the rollouts need more than ``MAX_BYTES``.
    """
    sizes = [_numbers_per_frame(robot) * (steps + 1) * 16 // 3 for robot, steps in walks]  # base64
    size = sum(sizes) + VERTEX_BYTES * vertices
    if size > MAX_BYTES:
        robots = " and ".join(
            f"{steps} steps of {len(robot.legs)} legs with {len(robot.linkage.joints)} joints each"
            for robot, steps in walks
        )
        raise ValueError(
            f"a page must have at most {MAX_BYTES / 1e6:.0f} MB of recordings, got "
            f"{size / 1e6:.0f} MB ({robots}, {vertices} vertices of ground); record fewer steps"
        )


def _numbers_per_frame(robot: Robot) -> int:
    """Return the number of float32 values per frame in the result of :func:`_packed`."""
    joints = len(robot.legs) * len(robot.linkage.joints)
    return SINGLE_NUMBERS + 2 * joints + 5 * len(robot.toes)


def page_of(name: str, data: object, parts: Mapping[str, str] = {}, runs: str = "") -> str:
    """Return a page as one HTML file.

    The page is the file ``name``.html of this folder. Inserted into it are ``theme.css``, the
    page's own styles and script, all modules that the script imports, and ``data`` as JSON. The
    content security policy of the page forbids all requests, and all scripts except its own and
    those that ``runs`` allows.

    Args:
        name: Name of the page.
        data: Data for the script of the page.
        parts: Other texts of the file, and their replacements.
        runs: Source of further scripts, as written in a content security policy.
    """
    style, script = _read("theme.css") + _read(f"{name}.css"), _script(name)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash_of(style)}; "
        f"script-src {_hash_of(script)}{runs and f' {runs}'}; base-uri 'none'; form-action 'none'"
    )
    filling = {
        "default-src 'none'": policy,
        "<!-- style -->": f"<style>{style}</style>",
        "<!-- data -->": f'<script type="application/json" id="data">{_json(data)}</script>',
        "<!-- script -->": f"<script>{script}</script>",
        **parts,
    }
    # All texts are replaced at once, so that inserted texts stay unchanged.
    pattern = "|".join(map(re.escape, filling))
    return re.sub(pattern, lambda match: filling[match[0]], _read(f"{name}.html"))


def write_page(path: str | Path, *recordings: Recording) -> Path:
    """Write the result of :func:`page` to a file, atomically.

    Args:
        path: Path of the file.
        *recordings: One or two recordings.

    Returns:
        The path of the file.

    Raises:
        OSError: If the file cannot be written.
        ValueError: If :func:`page` rejects the recordings.
    """
    return write_text(path, page(*recordings))


def frame_of(*recordings: Recording) -> str:
    """Return the result of :func:`page` as a sandboxed frame for another page, such as a notebook.

    Args:
        *recordings: One or two recordings.
    """
    return (
        f'<iframe srcdoc="{html.escape(page(*recordings))}" sandbox="allow-scripts" '
        f'title="Replay" width="100%" height="{FRAME_HEIGHT}" style="border:0"></iframe>'
    )


def _read(name: str) -> str:
    """Return the text of a file in this folder."""
    return (FOLDER / name).read_text(encoding="utf-8")


def _script(name: str) -> str:
    """Return a script and all modules that it imports as one script.

    Each module becomes a function that returns the module's exports.
    """
    modules: dict[str, str] = {}

    def add(module: str) -> None:
        source = _read(f"{module}.js")
        for imported in re.findall(r' from "\./(\w+)\.js";', source):
            if imported not in modules:
                add(imported)
        exported = re.findall(
            r"^export (?:(?:async )?function\*?|class|const) (\w+)", source, re.MULTILINE
        )
        source = re.sub(r"^export (?=async|function|class|const)", "", source, flags=re.MULTILINE)
        source = re.sub(
            r'^import (?:\* as )?(\w+|\{[^}]*\}) from "\./(\w+)\.js";',
            r"const \1 = \2_js;",
            source,
            flags=re.MULTILINE,
        )
        if match := re.search(r"^(?:import|export)\b.*|</script|<!--", source, re.MULTILINE):
            raise ValueError(f"{module}.js has {match[0]!r}, which cannot be put into a page")
        result = f"return {{ {', '.join(exported)} }};"
        modules[module] = f"const {module}_js = (() => {{\n{source}\n{result}\n}})();"

    add(name)
    return "\n".join(['"use strict";', *modules.values()])


def _hash_of(text: str) -> str:
    """Return the hash that identifies an inline style or script in a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _json(value: object) -> str:
    """Return a value as JSON in which no text can end a script element."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _labels(recordings: tuple[Recording, ...]) -> list[str]:
    """Return the labels of recordings, numbered if they are not unique."""
    labels = [recording.label or recording.env_id or "recording" for recording in recordings]
    if len({*labels}) < len(labels):
        labels = [f"{label} ({i})" for i, label in enumerate(labels, start=1)]
    return labels


def _subtitle(recordings: tuple[Recording, ...]) -> str:
    """Return the environments, commands and seeds of recordings as text, equal entries once."""
    events = []
    for recording in recordings:
        least, most = recording.command.min(), recording.command.max()
        command = f"{least:.3g}" if least == most else f"{least:.3g} to {most:.3g}"
        given = [f"{name}={shown(value)}" for name, value in recording.env_kwargs.items()]
        arguments = f" with {', '.join(given)}" if given else ""
        seed = "" if recording.seed is None else f", seed {recording.seed}"
        events.append(
            f"{recording.env_id}{arguments}, commanded speed {command} {recording.speed_unit}{seed}"
        )
    text = "; ".join(dict.fromkeys(events))
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}..."


def _packed(recording: Recording, ground: list[list[float]] | None) -> dict[str, object]:
    """Return the content of a recording for ``track.js``.

    The arrays have a value for every frame, and are encoded as float32 in base64. Values that
    belong to a step are 0 in the first frame. Points are relative to the crank axis.

    Args:
        recording: Recording to encode.
        ground: Vertices of the terrain that can come into view; None if there is no terrain.
    """
    axis, slip = recording.pose[:, :2], recording.slip.sum(axis=1)
    # Direction commanded in each step; forwards if all commands are zero.
    command = recording.command[:-1]
    directions = np.sign(command) if command.any() else np.ones(recording.steps)
    distance = _after_start(directions * np.diff(axis[:, 0])).cumsum()
    # Heights to which the motor work would lift the robot.
    lifts = np.abs(recording.energy_of("motor_work")) / recording.weight[1:]
    arrays = {
        "time": recording.time - recording.time[0],
        "pose": np.column_stack([axis, _turned(recording.pose[:, 2:])]),
        "joints": recording.joints - axis[:, None, None],
        "contact": recording.contact,
        "contactPoint": recording.contact_point - axis[:, None],
        "contactForce": recording.contact_force,
        "command": recording.command,
        "speed": recording.speed,
        "crankSpeed": recording.crank_speed,
        "torque": recording.torque,
        "power": _after_start(recording.power),
        "reward": _after_start(recording.reward),
        "slip": _after_start(slip / np.diff(recording.time)),
        "returned": _after_start(recording.reward).cumsum(),
        "slipPerMetre": _per_metre(slip, distance),
        "costOfTransport": _per_metre(lifts, distance),
    }
    packed = {
        name: base64.b64encode(values.astype("<f4").tobytes()).decode()
        for name, values in arrays.items()
    }
    scene = {
        **scene_of_robot(recording.robot, float(recording.weight[0])),
        "terrain": ground,
        "speedUnit": recording.speed_unit,
    }
    return {
        "scene": scene,
        "ended": recording.terminated,
        "arrays": packed,
    }


def _after_start(values: Array) -> Array:
    """Prepend a 0 for the first frame to values of steps, shape (n, ...)."""
    return np.concatenate([np.zeros_like(values[:1]), values])


def _per_metre(values: Array, distance: Array) -> Array:
    """Return sums of values up to each frame, divided by the distance up to there.

    Args:
        values: Values of the steps, in m, shape (n,).
        distance: Distance up to each frame, in m, shape (n + 1,).

    Returns:
        Ratios, shape (n + 1,), which are NaN where the distance is at most :data:`MIN_DISTANCE`.
    """
    ratios = np.full(len(distance), np.nan)
    is_far = distance > MIN_DISTANCE
    return np.divide(_after_start(values).cumsum(), distance, out=ratios, where=is_far)


def _turned(angles: Array) -> Array:
    """Shift angles (rad, shape (n, 2)) by whole turns, so that the first ones are near 0.

    Small values lose less precision when they are converted to float32.
    """
    return np.asarray(angles - 2.0 * np.pi * np.rint(angles[0] / (2.0 * np.pi)))


def _seen(recording: Recording) -> list[list[float]] | None:
    """Return the vertices of the terrain that can come into view; None if there is no terrain."""
    ground, x = recording.terrain, recording.pose[:, 0]
    if not len(ground):
        return None
    first = max(int(np.searchsorted(ground[:, 0], x.min() - SEEN)) - 1, 0)
    last = int(np.searchsorted(ground[:, 0], x.max() + SEEN)) + 1
    return ground[min(first, len(ground) - 2) : max(last, first + 2)].tolist()
