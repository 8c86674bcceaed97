"""A recorded episode: arrays in one ``.npz`` file, read without pickle and checked whole.

``docs/replay.md`` has the table of the arrays; :class:`jansen_env.viewer.recorder.Recorder`
records.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from jansen_env.checks import finite, instance, one_of, shown, whole_number, within
from jansen_env.files import open_regular, write_bytes
from jansen_env.viewer.web.geometry import SLIP

FORMAT = "jansen_env recording 2"
MOST_STEPS = 20_000  # of a recording
LARGEST = 1e12  # of any number in it
SHORTEST = 1e-9  # s, of a step: what comes of it, power for one, is a float32 in a page
FARTHEST = 1e9  # times the robot's reach from the origin: pages count marks on the ground up to it
MAX_BYTES = 2**26  # of a file
MAX_UNPACKED = 2**27  # bytes of all its arrays
MAX_DIRECTORY = 2**14  # bytes of the table of contents at the end of a file
MAX_TEXT = 2**20  # bytes of the JSON text in it
LONGEST_NAME = 200  # characters
PACKED = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}  # ways to pack a member of an archive
END_OF_DIRECTORY, BIG_LOCATOR = b"PK\x05\x06", b"PK\x06\x07"  # signatures of zip archives

Array = NDArray[np.float64]

LIMITS = {
    "frames": (2, MOST_STEPS + 1),
    "steps": (1, MOST_STEPS),
    "legs": (1, 256),
    "toes": (1, 1024),
    "joints": (3, 64),
    "states": (1, 64),
    "observed": (0, 100_000),
    "energies": (1, 64),
    "actions": (0, 10_000),
    "vertices": (0, 1_000_000),
}
"""Least and most of each dimension."""
SHAPES: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "time": ("<f8", ("frames",)),
    "state": ("<f8", ("frames", "states")),
    "pose": ("<f8", ("frames", 4)),
    "joints": ("<f4", ("frames", "legs", "joints", 2)),
    "command": ("<f8", ("frames",)),
    "speed": ("<f8", ("frames",)),
    "torque": ("<f8", ("frames",)),
    "weight": ("<f8", ("frames",)),
    "contact": ("|i1", ("frames", "toes")),
    "contact_point": ("<f8", ("frames", "toes", 2)),
    "contact_force": ("<f8", ("frames", "toes", 2)),
    "observation": ("<f4", ("frames", "observed")),
    "action": ("<f4", ("steps", "actions")),
    "reward": ("<f8", ("steps",)),
    "slip": ("<f8", ("steps", "toes")),
    "energy": ("<f8", ("steps", "energies")),
    "terrain": ("<f8", ("vertices", 2)),
}
"""Type and dimensions of each array."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """An episode of n control steps: n + 1 frames, the start and the end of each step.

    Arrays are read-only. Contact, forces and torque of a frame are those of the step that ends
    there, the last two its means.

    Args:
        time: (n + 1,) s. state: (n + 1, k) of the plant: x, y, theta, psi and their rates, or psi
            and its rate where the frame is held. pose: (n + 1, 4) x, y, theta, psi, m and rad.
        joints: (n + 1, legs, joints, 2) m, world frame, in the order of ``scene["joints"]``.
        command: (n + 1,) of the step that begins there, and speed: (n + 1,) in
            ``scene["speedUnit"]``. torque: (n + 1,) N m.
        weight: (n + 1,) N, of the robot, positive.
        contact: (n + 1, toes) 0 in the air, 1 grip, 2 slip. contact_point: (n + 1, toes, 2) m;
            contact_force: (n + 1, toes, 2) mean force of the ground on each toe, N, world frame.
        observation: (n + 1, d) and action: (n, a), flattened, as the policy has them; reward: (n,).
        slip: (n, toes) m slid by each toe while loaded. energy: (n, e) J, see ``energies``.
        terrain: (v, 2) vertices of the ground, m; v = 0 where there is none.
        scene: see :func:`jansen_env.viewer.web.geometry.scene_of`, without its terrain.
        energies: (e,) names of the energies. observed: (d,) names and units of the observation; ()
            where a wrapper has made something else of it.
        robot: fields of the :class:`jansen_env.robot.Robot` by name; parameters: of the episode.
        env_id, env_kwargs, options, seed: how it was made; values that are no JSON as text.
        label: how it is called, by a policy's name for one.
        terminated, truncated: how the last step ended.

    Raises:
        ValueError: an array of another shape, a number that is not finite or out of range, no motor
            work among the energies, or an entry of another kind.
    """

    time: Array
    state: Array
    pose: Array
    joints: NDArray[np.float32]
    command: Array
    speed: Array
    torque: Array
    weight: Array
    contact: NDArray[np.int8]
    contact_point: Array
    contact_force: Array
    observation: NDArray[np.float32]
    action: NDArray[np.float32]
    reward: Array
    slip: Array
    energy: Array
    terrain: Array
    scene: Mapping[str, Any]
    energies: tuple[str, ...]
    observed: tuple[tuple[str, str], ...] = ()
    robot: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    env_id: str = ""
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    label: str = ""
    terminated: bool = False
    truncated: bool = False

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name, (dtype, dimensions) in SHAPES.items():
            array = np.array(getattr(self, name), dtype=dtype)
            _check_array(name, array, dimensions, sizes)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if (shortest := np.diff(self.time).min()) < SHORTEST:
            raise ValueError(
                f"time has a step of {shortest:.3g} s, must increase by at least {SHORTEST:g} s"
            )
        if self.weight.min() < 1e-9:
            raise ValueError(f"weight has {self.weight.min()}, must be at least 1e-9")
        if self.contact.min(initial=0) < 0 or self.contact.max(initial=0) > SLIP:
            raise ValueError("contact has other numbers than 0, 1 and 2")
        if len(self.terrain) == 1 or (np.diff(self.terrain[:, 0]) <= 0.0).any():
            raise ValueError("terrain must have x that increases, and none or two and more points")
        _check_scene(self.scene, sizes)
        far, reach = np.abs(self.pose[:, :2]).max(), self.scene["reach"]
        if far > FARTHEST * reach:
            raise ValueError(
                f"pose has a place {far:.3g} m from the origin, must be within {FARTHEST:g} times "
                f"scene['reach'], {reach:.3g} m"
            )
        for name in ("energies", "observed"):
            entries, count = getattr(self, name), sizes[name]
            if len(entries) != count and (entries or name == "energies"):
                raise ValueError(f"{name} has {len(entries)} entries, must have {count}")
        if "motor_work" not in self.energies:
            raise ValueError(f"energies is {shown(self.energies)}, must have 'motor_work'")
        for text in (*self.energies, *(text for pair in self.observed for text in pair)):
            _check_text("a name", text)
        _check_text("env_id", self.env_id)
        _check_text("label", self.label)
        for name in ("robot", "parameters", "env_kwargs", "options"):
            instance(name, getattr(self, name), dict)
        for name, value in self.parameters.items():
            finite(f"parameters[{shown(name)}]", value)
        for name in ("terminated", "truncated"):
            instance(name, getattr(self, name), bool)
        if self.seed is not None:
            instance("seed", self.seed, int)

    def __repr__(self) -> str:
        return f"<Recording {self.label!r} of {self.env_id}: {self.steps} steps>"

    @property
    def steps(self) -> int:
        """Number of control steps."""
        return len(self.reward)

    @property
    def crank_speed(self) -> Array:
        """(n + 1,) rad/s."""
        return self.state[:, -1]

    @property
    def power(self) -> Array:
        """(n,) W, the motor's mean in each step; negative where it brakes."""
        return self.energy_of("motor_work") / np.diff(self.time)

    def energy_of(self, name: str) -> Array:
        """(n,) J, one of the energies. Raises ValueError if there is none of this name."""
        return self.energy[:, self.energies.index(one_of("energy", name, self.energies))]

    def to_bytes(self) -> bytes:
        """The file's content: compressed arrays, the rest as JSON in ``description``."""
        names = [one.name for one in fields(self) if one.name not in SHAPES]
        others = {name: getattr(self, name) for name in names}
        text = json.dumps({"format": FORMAT, **others}, allow_nan=False).encode()
        description = np.frombuffer(text, np.uint8)
        file, arrays = io.BytesIO(), {name: getattr(self, name) for name in SHAPES}
        np.savez_compressed(file, description=description, **arrays)
        return file.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write a ``.npz`` file atomically. Raises OSError if it cannot be written."""
        return write_bytes(path, self.to_bytes())

    @staticmethod
    def load(path: str | Path) -> Recording:
        """Read a file of :meth:`save`, from whomever: it is checked, and no code in it runs.

        Raises:
            ValueError: it is missing, no recording, damaged or too large.
        """
        try:
            with open_regular(path) as file:
                return Recording.from_bytes(file.read(MAX_BYTES + 1))
        except (OSError, ValueError) as error:
            raise ValueError(f"{path} is no recording: {error}") from error

    @staticmethod
    def from_bytes(data: bytes) -> Recording:
        """A recording from a file's content. Raises ValueError as :meth:`load` does."""
        content: dict[str, Any] = _read_archive(data)
        content |= _read_description(content.pop("description").tobytes())
        return Recording(**content)

    def _repr_html_(self) -> str:
        from jansen_env.viewer.web.page import frame_of  # the page is made of recordings

        return frame_of(self)


def _read_archive(data: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of a file, of the types and no larger than they may be."""
    if len(data) > MAX_BYTES:
        raise ValueError(f"it has more than {MAX_BYTES} bytes")
    # Checked by hand, as the directory is unpacked by the time that its length could be asked.
    end = data[-22:]
    if len(end) < 22 or not end.startswith(END_OF_DIRECTORY) or data[-42:-38] == BIG_LOCATOR:
        raise ValueError("it is no npz file, or it is not complete")
    if int.from_bytes(end[12:16], "little") > MAX_DIRECTORY:
        raise ValueError("its table of contents is too long")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {member.filename: member for member in archive.infolist()}
            wanted = {f"{name}.npy": name for name in ("description", *SHAPES)}
            if {*members} != {*wanted} or len(archive.infolist()) != len(wanted):
                raise ValueError(f"it has {shown(sorted(members))}, must have {sorted(wanted)}")
            # Of other kinds zipfile unpacks more than it is asked for.
            if not {member.compress_type for member in members.values()} <= PACKED:
                raise ValueError("it is packed in another way than npz files are")
            if sum(member.file_size for member in members.values()) > MAX_UNPACKED:
                raise ValueError(f"it unpacks to more than {MAX_UNPACKED} bytes")
            return {
                name: _read_array(name, archive.open(members[file]).read(members[file].file_size))
                for file, name in wanted.items()
            }
    except ValueError:
        raise
    except Exception as error:  # of all kinds, from damaged archives
        raise ValueError(f"it is damaged: {error or type(error).__name__}") from error


def _read_array(name: str, data: bytes) -> NDArray[Any]:
    """An array from a ``.npy`` file's content; nothing is allocated that is not there."""
    dtype = np.dtype("|u1" if name == "description" else SHAPES[name][0])
    file = io.BytesIO(data)
    if npy.read_magic(file) != (1, 0):
        raise ValueError(f"{name} is of another version of npy, must be of 1.0")
    shape, in_columns, found = npy.read_array_header_1_0(file, max_header_size=1000)
    if found != dtype or in_columns:
        raise ValueError(f"{name} has type {found}, must have {dtype.str}, in the order of rows")
    if any(size < 0 for size in shape):
        raise ValueError(f"{name} has shape {shape}, must be of no negative size")
    # reshape refuses another number of bytes than the shape asks for.
    return np.frombuffer(data, dtype, offset=file.tell()).reshape(shape)


def _read_description(text: bytes) -> dict[str, Any]:
    """Parts of :class:`Recording` beside its arrays."""
    if len(text) > MAX_TEXT:
        raise ValueError(f"its description has more than {MAX_TEXT} bytes")
    try:
        found = json.loads(text, parse_constant=_refuse)
    except (RecursionError, ValueError) as error:
        raise ValueError(f"its description is no JSON: {error}") from error
    instance("its description", found, dict)
    if (kind := found.pop("format", None)) != FORMAT:
        raise ValueError(f"its format is {shown(kind)}, must be {FORMAT!r}")
    names = {one.name for one in fields(Recording)} - {*SHAPES}
    if {*found} != names:
        raise ValueError(f"its description has {shown(sorted(found))}, must have {sorted(names)}")
    for name in ("energies", "observed"):
        instance(name, found[name], list)
    for pair in found["observed"]:
        if not isinstance(pair, list) or len(pair) != 2:
            raise ValueError(f"observed has {shown(pair)}, must have a name and a unit each")
    observed = tuple(map(tuple, found["observed"]))
    return {**found, "energies": tuple(found["energies"]), "observed": observed}


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


def _check_array(
    name: str, array: NDArray[Any], dimensions: tuple[str | int, ...], sizes: dict[str, int]
) -> None:
    """Check shape and numbers; ``sizes`` of dimensions are those found first."""
    expected: list[int | str] = []
    for dimension, size in zip(dimensions, array.shape, strict=False):
        if isinstance(dimension, str):
            low, high = LIMITS[dimension]
            if not low <= size <= high:
                raise ValueError(f"{name} has {size} {dimension}, must have {low} to {high}")
            if dimension == "frames":
                sizes.setdefault("steps", size - 1)
            expected.append(sizes.setdefault(dimension, size))
        else:
            expected.append(dimension)
    if len(dimensions) != array.ndim or list(array.shape) != expected:
        # Those that are missing in the list of a shape that is too short are named.
        allowed = tuple(sizes.get(str(one), one) for one in dimensions)
        raise ValueError(f"{name} has shape {array.shape}, must have {allowed}")
    with np.errstate(invalid="ignore"):
        wrong = ~(np.abs(array) <= LARGEST) if array.dtype.kind == "f" else np.zeros(1, bool)
    if wrong.any():
        value = array[tuple(np.argwhere(wrong)[0])]
        raise ValueError(f"{name} has {value}, must have finite numbers up to {LARGEST:g}")


def _check_scene(scene: Any, sizes: dict[str, int]) -> None:
    """Check what is drawn."""
    instance("scene", scene, dict)
    names = {"legs", "payload", "padRadius", "reach", "weight", "torqueLimit", "speedUnit",
             "speedRange", "controlDt", "joints", "toes", "frame", "crank", "skeleton",
             "plates"}  # fmt: skip
    if {*scene} != names:
        raise ValueError(f"scene has {shown(sorted(scene))}, must have {sorted(names)}")
    _check_drawing(scene, sizes)
    instance("scene['legs']", scene["legs"], list)
    for leg in scene["legs"]:
        if not isinstance(leg, dict) or {*leg} != {"side", "depth"}:
            raise ValueError(f"a leg is {shown(leg)}, must have side and depth")
        if leg["side"] not in ("fore", "back"):
            raise ValueError(f"a leg's side is {shown(leg['side'])}, must be 'fore' or 'back'")
        within("a leg's depth", leg["depth"], 0.0, 1.0)
    for name in ("reach", "weight", "controlDt", "speedRange", "padRadius", "torqueLimit"):
        least = 0.0 if name in ("padRadius", "torqueLimit") else 1e-9
        within(f"scene[{name!r}]", scene[name], least, LARGEST)
    _check_text("scene['speedUnit']", scene["speedUnit"])
    if (load := scene["payload"]) is not None:
        if not isinstance(load, dict) or {*load} != {"mass", "x", "y"}:
            raise ValueError(f"payload is {shown(load)}, must have mass, x and y, or be None")
        for name, value in load.items():
            within(f"payload's {name}", value, -LARGEST, LARGEST)


def _check_drawing(scene: dict[str, Any], sizes: dict[str, int]) -> None:
    """Check what :func:`jansen_env.viewer.web.geometry.drawing_of` gives."""
    for name in ("legs", "toes", "joints"):
        instance(f"scene[{name!r}]", scene[name], list)
        if len(scene[name]) != sizes[name]:
            raise ValueError(f"scene has {len(scene[name])} {name}, must have {sizes[name]}")
    for name in scene["joints"]:
        _check_text("a joint's name", name)
    joints = sizes["joints"]
    for name in ("toes", "frame", "crank", "skeleton", "plates"):
        groups_of = instance(f"scene[{name!r}]", scene[name], list)
        least, most = (3, joints) if name == "plates" else (2, 2)
        for numbers in groups_of:
            if not isinstance(numbers, list) or not least <= len(numbers) <= most:
                raise ValueError(f"scene[{name!r}] has {shown(numbers)}, must be joints")
            for k, number in enumerate(numbers):
                of = "legs" if (name, k) == ("toes", 0) else "joints"
                whole_number(f"scene[{name!r}]", number, sizes[of] - 1)


def _check_text(name: str, value: Any) -> None:
    instance(name, value, str)
    if len(value) > LONGEST_NAME:
        raise ValueError(f"{name} is {shown(value)}, must have at most {LONGEST_NAME} characters")
    try:
        value.encode()
    except UnicodeEncodeError:  # half of a pair of surrogates
        raise ValueError(f"{name} is {shown(value)}, must be text that UTF-8 has") from None
