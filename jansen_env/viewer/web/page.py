"""Recordings as one HTML file that plays them: no server, no network, nothing else to install.

``docs/replay.md`` says how exact they are. :func:`page_of` makes the pages to walk and to design,
too.
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
from jansen_env.viewer.recording import Recording
from jansen_env.viewer.web.geometry import scene_of_robot

FOLDER = Path(__file__).parent
MOST_RECORDINGS = 2
MAX_BYTES = 2**26  # of the recordings in a page: browsers take long to open more
SINGLE_NUMBERS = 16  # of a frame: time, pose, speeds ...; without those of joints and toes
VERTEX_BYTES = 52  # of a vertex of the ground as JSON, at most
SEEN = 30.0  # m of ground beyond either end of the walk
LONGEST_TEXT = 500  # characters of the line under the title
FRAME_HEIGHT = 760  # pixels in a notebook


def page(*recordings: Recording) -> str:
    """The page of one recording, or of two side by side.

    Raises:
        ValueError: If there is another number of recordings, if one is of walking and one of the
            crank alone, or if they need more than ``MAX_BYTES``.
    """
    if not 1 <= len(recordings) <= MOST_RECORDINGS:
        raise ValueError(f"there are {len(recordings)} recordings, must be 1 or 2")
    if len(units := {recording.speed_unit for recording in recordings}) > 1:
        raise ValueError(f"recordings have speeds in {sorted(units)}, must have them in one unit")
    labels = _labels(recordings)
    grounds = [_seen(recording) for recording in recordings]
    vertices = sum(0 if ground is None else len(ground) for ground in grounds)
    check_size([(recording.robot, recording.steps) for recording in recordings], vertices)
    data = {
        "title": " and ".join(labels),
        "subtitle": _subtitle(recordings),
        # Two robots in one picture stand on the same ground.
        "comparable": all(np.array_equal(r.terrain, recordings[0].terrain) for r in recordings),
        "recordings": [
            {"label": label, **_packed(recording, ground)}
            for label, recording, ground in zip(labels, recordings, grounds, strict=True)
        ],
    }
    title = f"<title>{html.escape(' and '.join(labels))}</title>"
    return page_of("replay", data, {"<title>Replay</title>": title})


def check_size(walks: Sequence[tuple[Robot, int]], vertices: int = 0) -> None:
    """Raise ValueError if walks need more than ``MAX_BYTES`` of a page.

    Args:
        walks: The robot and the number of steps of each walk.
        vertices: Number of vertices of the grounds that come into the pictures.
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
    """How many float32 numbers :func:`_packed` has of a frame."""
    joints = len(robot.legs) * len(robot.linkage.joints)
    return SINGLE_NUMBERS + 2 * joints + 5 * len(robot.toes)


def page_of(name: str, data: object, parts: Mapping[str, str] = {}, runs: str = "") -> str:
    """A page as one file, which may ask for nothing, and run nothing else but what ``runs`` allows.

    It is the file of this folder that is called ``name``.html, with ``theme.css``, its own styles
    and script, what that imports, and ``data`` as JSON put in. parts: other texts of the file and
    what replaces them. runs: a source of scripts as its content security policy names it.
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
    pattern = "|".join(map(re.escape, filling))  # all at once: what is put in stays as it is
    return re.sub(pattern, lambda match: filling[match[0]], _read(f"{name}.html"))


def write_page(path: str | Path, *recordings: Recording) -> Path:
    """Write :func:`page` atomically. Raises OSError if it cannot be written."""
    return write_text(path, page(*recordings))


def frame_of(*recordings: Recording) -> str:
    """:func:`page` as a sandboxed frame within another page, such as a notebook's."""
    return (
        f'<iframe srcdoc="{html.escape(page(*recordings))}" sandbox="allow-scripts" '
        f'title="Replay" width="100%" height="{FRAME_HEIGHT}" style="border:0"></iframe>'
    )


def _read(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _script(name: str) -> str:
    """A script and all that it imports as one: each module a function that returns its exports."""
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
            r'^import (?:\* as )?(\w+|\{[^}]*\}) from "\./(\w+)\.js";', r"const \1 = \2_js;",
            source, flags=re.MULTILINE,
        )  # fmt: skip
        if match := re.search(r"^(?:import|export)\b.*|</script|<!--", source, re.MULTILINE):
            raise ValueError(f"{module}.js has {match[0]!r}, which cannot be put into a page")
        result = f"return {{ {', '.join(exported)} }};"
        modules[module] = f"const {module}_js = (() => {{\n{source}\n{result}\n}})();"

    add(name)
    return "\n".join(['"use strict";', *modules.values()])


def _hash_of(text: str) -> str:
    """Hash by which a content security policy names an inline style or script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _json(value: object) -> str:
    """JSON that ends no script element, whatever texts are in it."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _labels(recordings: tuple[Recording, ...]) -> list[str]:
    labels = [recording.label or recording.env_id or "recording" for recording in recordings]
    if len({*labels}) < len(labels):
        labels = [f"{label} ({i})" for i, label in enumerate(labels, start=1)]
    return labels


def _subtitle(recordings: tuple[Recording, ...]) -> str:
    """Events of a recording, each kind once."""
    events = []
    for recording in recordings:
        least, most = recording.command.min(), recording.command.max()
        command = f"{least:.3g}" if least == most else f"{least:.3g} to {most:.3g}"
        given = [f"{name}={shown(value)}" for name, value in recording.env_kwargs.items()]
        arguments = f" with {', '.join(given)}" if given else ""
        seed = "" if recording.seed is None else f", seed {recording.seed}"
        events.append(f"{recording.env_id}{arguments}, commanded speed {command} "
                      f"{recording.speed_unit}{seed}")  # fmt: skip
    text = "; ".join(dict.fromkeys(events))
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}..."


def _packed(recording: Recording, ground: list[list[float]] | None) -> dict[str, object]:
    """A recording's content for ``track.js``: arrays are of all frames, as float32 in base64.

    ``ground``: what may come into the picture. Numbers of a step are 0 at the start. Points are
    relative to the crank axis.
    """
    axis, slip = recording.pose[:, :2], recording.slip.sum(axis=1)
    # Of each step in the direction commanded in it; forwards where nothing ever is.
    command = recording.command[:-1]
    directions = np.sign(command) if command.any() else np.ones(recording.steps)
    # Heights to which the work would lift the robot.
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
        "distance": _after_start(directions * np.diff(axis[:, 0])).cumsum(),
        "returned": _after_start(recording.reward).cumsum(),
        "slipped": _after_start(slip).cumsum(),
        "lifted": _after_start(lifts).cumsum(),
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
    return {"scene": scene, "ended": recording.terminated, "arrays": packed}


def _after_start(values: Array) -> Array:
    """(n + 1, ...) numbers of steps (n, ...), 0 at the start."""
    return np.concatenate([np.zeros_like(values[:1]), values])


def _turned(angles: Array) -> Array:
    """Angles (n, 2), rad, by whole turns nearer to 0: small numbers are exact as float32."""
    return np.asarray(angles - 2.0 * np.pi * np.rint(angles[0] / (2.0 * np.pi)))


def _seen(recording: Recording) -> list[list[float]] | None:
    """The ground that may come into the picture."""
    ground, x = recording.terrain, recording.pose[:, 0]
    if not len(ground):
        return None
    first = max(int(np.searchsorted(ground[:, 0], x.min() - SEEN)) - 1, 0)
    last = int(np.searchsorted(ground[:, 0], x.max() + SEEN)) + 1
    return ground[min(first, len(ground) - 2) : max(last, first + 2)].tolist()
