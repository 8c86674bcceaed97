"""A recorded episode: arrays in one ``.npz`` file, read without pickle and checked whole.

``docs/replay.md`` has the table of the arrays; :class:`jansen_env.viewer.recorder.Recorder`
records.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array
from jansen_env.checks import instance, named_errors, one_line, one_of, printable, shown
from jansen_env.files import read_bounded, write_bytes
from jansen_env.rendering import SLIP, reach_of
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import world_joints
from jansen_env.robot.robot_file import robot_from_json, robot_to_json
from jansen_env.world.settings import Values

FORMAT = "jansen_env recording 4"
MOST_RECORDED = 20_000  # of a recording
LARGEST = 1e12  # of any number in it
SHORTEST = 1e-9  # s, of a step: the page's float32 numbers include power, energy over time
FARTHEST = 1e9  # times the robot's reach from the origin: the page counts marks on the ground
MAX_BYTES = 2**26  # of a file
MAX_UNPACKED = 2**27  # bytes of all its arrays
MAX_MEMBERS = 64  # of an archive; one byte of a directory becomes ten in memory
MAX_TEXT = 2**20  # bytes of the JSON text in it
DIRECTORY_ENTRY = b"PK\x01\x02"
# zipfile unpacks other kinds, such as bzip2, without a limit on the result.
PACKED = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}

Array32 = NDArray[np.float32]


def shaped(*dimensions: str | int, dtype: str = "<f8") -> dict[str, object]:
    """Metadata of an array: its type and the names or numbers of its dimensions."""
    return {"dtype": np.dtype(dtype), "dimensions": dimensions}


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """An episode of n control steps: n + 1 frames, the start and the end of each step.

    Arrays are read-only, in SI units, places and forces in the world frame. Contact, forces and
    torque of a frame are those of the step that ends there, the last two its means; the command is
    that of the step that begins there. ``observed``, the names and units of the observation, is ()
    if a wrapper has changed it; ``energies`` names the columns of ``energy``.

    Raises ValueError: an array of another shape, a number that is not finite or out of range, no
    motor work among the energies, or an entry of another kind.
    """

    time: Array = field(metadata=shaped("frames"))
    state: Array = field(metadata=shaped("frames", "states"))
    pose: Array = field(metadata=shaped("frames", 4))
    command: Array = field(metadata=shaped("frames"))
    speed: Array = field(metadata=shaped("frames"))
    torque: Array = field(metadata=shaped("frames"))
    weight: Array = field(metadata=shaped("frames"))
    contact: NDArray[np.int8] = field(metadata=shaped("frames", "toes", dtype="|i1"))
    contact_point: Array = field(metadata=shaped("frames", "toes", 2))
    contact_force: Array = field(metadata=shaped("frames", "toes", 2))
    observation: Array32 = field(metadata=shaped("frames", "observed", dtype="<f4"))
    action: Array32 = field(metadata=shaped("steps", "actions", dtype="<f4"))
    reward: Array = field(metadata=shaped("steps"))
    slip: Array = field(metadata=shaped("steps", "toes"))
    energy: Array = field(metadata=shaped("steps", "energies"))
    terrain: Array = field(metadata=shaped("vertices", 2))
    robot: Robot
    energies: tuple[str, ...]
    speed_unit: str
    observed: tuple[tuple[str, str], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    env_id: str = ""
    env_kwargs: Mapping[str, object] = field(default_factory=dict)
    options: Mapping[str, object] = field(default_factory=dict)
    seed: int | None = None
    label: str = ""
    terminated: bool = False
    truncated: bool = False

    def __post_init__(self) -> None:
        instance("robot", self.robot, Robot)
        self._check_arrays()
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
        far, reach = np.abs(self.pose[:, :2]).max(), reach_of(self.robot)
        if far > FARTHEST * reach:
            raise ValueError(
                f"pose has a place {far:.3g} m from the origin, must be within {FARTHEST:g} times "
                f"the robot's reach, {reach:.3g} m"
            )
        if len(self.observed) not in (0, self.observation.shape[1]):
            count = len(self.observed)
            raise ValueError(f"observed must have one entry per number, got {count} entries")
        if wrong := [pair for pair in self.observed if len(pair) != 2]:
            raise ValueError(f"observed must have a name and a unit each, got {shown(wrong[0])}")
        if "motor_work" not in self.energies:
            raise ValueError(f"energies is {shown(self.energies)}, must have 'motor_work'")
        for name in ("speed_unit", "env_id", "label"):
            printable(name, instance(name, getattr(self, name), str))
        for name in ("parameters", "env_kwargs", "options"):
            instance(name, getattr(self, name), dict)
        if self.seed is not None:
            instance("seed", self.seed, int)

    def _check_arrays(self) -> None:
        """Make the arrays read-only, of their types, after checking shapes and numbers."""
        frames = len(self.time)
        if not 2 <= frames <= MOST_RECORDED + 1:
            raise ValueError(f"time must have 2 to {MOST_RECORDED + 1} frames, got {frames}")
        sizes: dict[str | int, int] = {
            "frames": frames, "steps": frames - 1, "toes": len(self.robot.toes),
            "energies": len(self.energies), 2: 2, 4: 4,
        }  # fmt: skip
        for name, (dtype, dimensions) in ARRAYS.items():
            array = np.array(getattr(self, name), dtype=dtype)
            for dimension, size in zip(dimensions, array.shape, strict=False):
                sizes.setdefault(dimension, size)
            allowed = tuple(sizes.get(dimension, dimension) for dimension in dimensions)
            if array.shape != allowed or sizes.get("states") == 0:
                raise ValueError(f"{name} must have the shape {allowed}, got {array.shape}")
            with np.errstate(invalid="ignore"):
                wrong = array[~(np.abs(array) <= LARGEST)]
            if wrong.size:
                raise ValueError(f"{name} must have finite numbers to {LARGEST:g}, got {wrong[0]}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        return f"<Recording {self.label!r} of {self.env_id}: {self.steps} steps>"

    @property
    def steps(self) -> int:
        """Number of control steps."""
        return len(self.reward)

    @property
    def joints(self) -> Array:
        """(n + 1, legs, joints, 2) m, world frame, in the order of ``robot.linkage.joints``."""
        return world_joints(self.robot, self.pose)

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
        arrays = {name: getattr(self, name) for name in ARRAYS}
        others = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        others = {name: value for name, value in others.items() if name not in arrays}
        others |= {"format": FORMAT, "robot": robot_to_json(self.robot)}
        text, file = json.dumps(others, allow_nan=False).encode(), io.BytesIO()
        np.savez_compressed(file, description=np.frombuffer(text, np.uint8), **arrays)
        return file.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write a ``.npz`` file atomically. Raises OSError if it cannot be written."""
        return write_bytes(path, self.to_bytes())

    @staticmethod
    def load(path: str | Path) -> "Recording":
        """Read a file of :meth:`save`, from any source: it is checked, and no code in it runs.

        Raises ValueError: it is missing, no recording, damaged or too large.
        """
        with named_errors(f"{path} is no recording"):
            return Recording.from_bytes(read_bounded(path, MAX_BYTES))

    @staticmethod
    def from_bytes(data: bytes) -> "Recording":
        """A recording from a file's content. Raises ValueError as :meth:`load` does."""
        content: Values = {**_read_archive(data)}
        text = content.pop("description").tobytes()
        if len(text) > MAX_TEXT:
            raise ValueError(f"its description has more than {MAX_TEXT} bytes")
        try:
            content |= json.loads(text)
            if (kind := content.pop("format", None)) != FORMAT:
                raise ValueError(f"its format must be {FORMAT!r}, got {shown(kind)}")
            content["energies"] = tuple(content["energies"])
            content["observed"] = tuple(map(tuple, content["observed"]))
            content["robot"] = robot_from_json(content["robot"])
            return Recording(**content)
        except RecursionError as error:
            raise ValueError("its description is nested too deeply") from error
        except (KeyError, TypeError) as error:
            raise ValueError(f"its description is wrong: {one_line(error)}") from error

    def _repr_html_(self) -> str:
        from jansen_env.viewer.web.page import frame_of  # the page is made of recordings

        return frame_of(self)


ARRAYS = {entry.name: (entry.metadata["dtype"], entry.metadata["dimensions"])
          for entry in fields(Recording) if entry.metadata}  # fmt: skip
"""Type and dimensions of each array; other fields are kept as JSON."""


def _read_archive(data: bytes) -> dict[str, NDArray[np.generic]]:
    """The arrays of a file; their number and sizes are checked before they are unpacked."""
    if not zipfile.is_zipfile(io.BytesIO(data)):
        raise ValueError("it is no .npz file")
    if data.count(DIRECTORY_ENTRY) > MAX_MEMBERS:
        raise ValueError(f"it has more than {MAX_MEMBERS} members")
    wanted = {"description": np.dtype(np.uint8), **{n: kind for n, (kind, _) in ARRAYS.items()}}
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            members = archive.zip.infolist()
            if {*archive.files} != {*wanted}:
                raise ValueError(f"it must contain {sorted(wanted)}, got {shown(archive.files)}")
            if not {member.compress_type for member in members} <= PACKED:
                raise ValueError("it is packed in another way than npz files are")
            if sum(member.file_size for member in members) > MAX_UNPACKED:
                raise ValueError(f"it unpacks to more than {MAX_UNPACKED} bytes")
            arrays = {name: archive[name] for name in wanted}
            for name, kind in wanted.items():
                if (dtype := arrays[name].dtype) != kind:
                    raise ValueError(f"{name} must have the type {kind}, got {dtype}")
            return arrays
    except ValueError:
        raise
    except Exception as error:  # damaged archives raise errors of many kinds
        raise ValueError(f"it is damaged: {one_line(error)}") from error
