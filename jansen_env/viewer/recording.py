"""Recorded episode: arrays in one ``.npz`` file, which is read without pickle and fully checked.

``docs/replay.md`` contains a table of the arrays. :class:`jansen_env.viewer.recorder.Recorder`
makes recordings.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from jansen_env.arrays import Array
from jansen_env.checks import instance, named_errors, one_line, one_of, printable, shown
from jansen_env.engine.contact_frames import SLIP
from jansen_env.files import read_bounded, write_bytes
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import world_joints
from jansen_env.robot.robot_file import robot_from_json, robot_to_json
from jansen_env.world.rendering import reach_of
from jansen_env.world.settings import Values

FORMAT = "jansen_env recording 4"
MOST_RECORDED = 20_000  # largest number of steps in a recording
LARGEST = 1e12  # largest magnitude of any value in a recording
# Shortest step, in s. The page's float32 values include the power, which is energy over time.
SHORTEST = 1e-9
# Largest distance from the origin, in multiples of the robot's reach. The page counts the marks on
# the ground.
FARTHEST = 1e9
MAX_BYTES = 2**26  # largest size of a file
MAX_UNPACKED = 2**27  # largest size of all arrays in a file, in bytes
# Largest number of members in a file's archive. Each byte of the archive's directory takes about
# ten bytes in memory.
MAX_MEMBERS = 64
MAX_TEXT = 2**20  # largest size of the JSON text in a file, in bytes
DIRECTORY_ENTRY = b"PK\x01\x02"
# zipfile unpacks other kinds of compression, such as bzip2, without limiting the result's size.
PACKED = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}

Array32 = NDArray[np.float32]


def shaped(*dimensions: str | int, dtype: str = "<f8") -> dict[str, object]:
    """Return the metadata of an array field.

    Args:
        *dimensions: Name or length of each axis.
        dtype: Type of the array.
    """
    return {"dtype": np.dtype(dtype), "dimensions": dimensions}


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """Episode of n control steps, with n + 1 frames: the initial state and the end of each step.

    All arrays are read-only and in SI units. Positions and forces refer to the world frame. The
    contacts, forces and torque of a frame belong to the step that ends there; forces and torque are
    averages over this step. The command of a frame belongs to the step that begins there.

    Attributes:
        time: Time of each frame, in s, shape (n + 1,).
        state: Position of the crank axis, pitch and crank angle, followed by their rates, shape
            (n + 1, 8).
        pose: x and y of the crank axis in m, pitch and crank angle in rad, shape (n + 1, 4).
        command: Commanded speed, in ``speed_unit``, shape (n + 1,).
        speed: Speed, in ``speed_unit``, shape (n + 1,).
        torque: Motor torque, in N m, shape (n + 1,).
        weight: Weight of robot and payload, in N, shape (n + 1,).
        contact: State of each toe (0 in the air, 1 gripping, 2 slipping), shape (n + 1, toes).
        contact_point: Contact point of each toe, in m, shape (n + 1, toes, 2).
        contact_force: Force of the ground on each toe, in N, shape (n + 1, toes, 2).
        observation: Observation that the policy received, shape (n + 1, observed).
        action: Action that the policy returned, shape (n, actions).
        reward: Reward of each step, shape (n,).
        slip: Distance that each toe slid under load in each step, in m, shape (n, toes).
        energy: Energies of each step, in J, shape (n, energies).
        terrain: Vertices of the ground, in m, shape (vertices, 2). There are none for a fixed
            chassis.
        robot: Robot that was recorded.
        energies: Names of the columns of ``energy``. They include "motor_work".
        speed_unit: Unit of ``command`` and ``speed``, "m/s" or "rad/s".
        observed: Name and unit of each value of the observation; empty if a wrapper has changed
            the observation.
        parameters: Parameters of the episode by name.
        env_id: Id of the environment.
        env_kwargs: Arguments of the environment.
        options: Reset options of the episode.
        seed: Seed of the episode; None if the reset had none.
        label: Label of the recording, such as the name of the policy.
        terminated: Whether the episode was terminated.
        truncated: Whether the episode was truncated.

    Raises:
        ValueError: If an array has the wrong shape, if a value is not finite or is out of range,
            if the energies do not include the motor work, or if an entry has the wrong type.
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
                f"time must increase by at least {SHORTEST:g} s, got a step of {shortest:.3g} s"
            )
        if self.weight.min() < 1e-9:
            raise ValueError(f"weight must be at least 1e-9, got {self.weight.min()}")
        if (others := self.contact[(self.contact < 0) | (self.contact > SLIP)]).size:
            raise ValueError(f"every entry of contact must be 0, 1 or 2, got {others[0]}")
        if len(self.terrain) == 1:
            raise ValueError("terrain must be empty or have at least 2 points, got 1")
        if (narrowest := np.diff(self.terrain[:, 0]).min(initial=np.inf)) <= 0.0:
            raise ValueError(f"x must increase in terrain, got a change of {narrowest:g} m")
        far = np.abs(self.pose[:, :2]).max()
        reach = reach_of(self.robot)
        if far > FARTHEST * reach:
            raise ValueError(
                f"pose must be within {FARTHEST:g} times the robot's reach, {reach:.3g} m, of the "
                f"origin, got a distance of {far:.3g} m"
            )
        if len(self.observed) not in (0, self.observation.shape[1]):
            count = len(self.observed)
            columns = self.observation.shape[1]
            raise ValueError(
                f"observed must be empty or have one entry per column of observation, {columns}, "
                f"got {count} entries"
            )
        if wrong := [pair for pair in self.observed if len(pair) != 2]:
            raise ValueError(f"observed must have a name and a unit each, got {shown(wrong[0])}")
        if "motor_work" not in self.energies:
            raise ValueError(f"energies must have 'motor_work', got {shown(self.energies)}")
        for name in ("speed_unit", "env_id", "label"):
            printable(name, instance(name, getattr(self, name), str))
        for name in ("parameters", "env_kwargs", "options"):
            instance(name, getattr(self, name), dict)
        if self.seed is not None:
            instance("seed", self.seed, int)

    def _check_arrays(self) -> None:
        """Check the shapes and values of the arrays, convert their types, and freeze them."""
        frames = len(self.time)
        if not 2 <= frames <= MOST_RECORDED + 1:
            raise ValueError(f"time must have 2 to {MOST_RECORDED + 1} frames, got {frames}")
        sizes: dict[str | int, int] = {
            "frames": frames,
            "steps": frames - 1,
            "toes": len(self.robot.toes),
            "energies": len(self.energies),
            2: 2,
            4: 4,
        }
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
                raise ValueError(
                    f"{name} must contain finite numbers from {-LARGEST:g} to {LARGEST:g}, "
                    f"got {wrong[0]}"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @override
    def __repr__(self) -> str:
        return f"<Recording {self.label!r} of {self.env_id}: {self.steps} steps>"

    @property
    def steps(self) -> int:
        """Number of control steps."""
        return len(self.reward)

    @property
    def joints(self) -> Array:
        """Positions of the joints in the world frame, in m, shape (n + 1, legs, joints, 2).

        The joints are in the order of ``robot.linkage.joints``.
        """
        return world_joints(self.robot, self.pose)

    @property
    def crank_speed(self) -> Array:
        """Crank speed, in rad/s, shape (n + 1,)."""
        return self.state[:, -1]

    @property
    def power(self) -> Array:
        """Mean motor power in each step, in W, shape (n,); negative where the motor brakes."""
        return self.energy_of("motor_work") / np.diff(self.time)

    def energy_of(self, name: str) -> Array:
        """Return one of the energies of each step, in J, shape (n,).

        Args:
            name: Name of the energy, one of ``energies``.

        Raises:
            ValueError: If there is no energy of this name.
        """
        return self.energy[:, self.energies.index(one_of("energy", name, self.energies))]

    def to_bytes(self) -> bytes:
        """Return the content of a file of this recording.

        The file contains the compressed arrays, and all other fields as JSON in ``description``.
        """
        arrays = {name: getattr(self, name) for name in ARRAYS}
        others = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        others = {name: value for name, value in others.items() if name not in arrays}
        others |= {"format": FORMAT, "robot": robot_to_json(self.robot)}
        text = json.dumps(others, allow_nan=False).encode()
        file = io.BytesIO()
        np.savez_compressed(file, description=np.frombuffer(text, np.uint8), **arrays)
        return file.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write the recording to a ``.npz`` file atomically.

        Args:
            path: Path of the file.

        Returns:
            The path.

        Raises:
            OSError: If the file cannot be written.
        """
        return write_bytes(path, self.to_bytes())

    @staticmethod
    def load(path: str | Path) -> "Recording":
        """Read a file that :meth:`save` has written.

        The file may come from any source: its content is checked, and no code in it is run.

        Args:
            path: Path of the file.

        Raises:
            ValueError: If the file is missing, damaged or too large, or is not a recording.
        """
        with named_errors(f"{path} is not a recording"):
            return Recording.from_bytes(read_bounded(path, MAX_BYTES))

    @staticmethod
    def from_bytes(data: bytes) -> "Recording":
        """Return the recording in the content of a file.

        Args:
            data: Content of the file.

        Raises:
            ValueError: If the content is damaged or too large, or is not a recording.
        """
        content: Values = {**_read_archive(data)}
        text = content.pop("description").tobytes()
        if len(text) > MAX_TEXT:
            raise ValueError(f"its description must have at most {MAX_TEXT} bytes, got {len(text)}")
        try:
            content |= json.loads(text)
            if (kind := content.pop("format", None)) != FORMAT:
                raise ValueError(f"its format must be {FORMAT!r}, got {shown(kind)}")
            content["energies"] = tuple(content["energies"])
            content["observed"] = tuple(map(tuple, content["observed"]))
            content["robot"] = robot_from_json(content["robot"])
            return Recording(**content)
        except RecursionError as error:
            raise ValueError("its description must not be nested so deeply") from error
        except (KeyError, TypeError) as error:
            raise ValueError(f"its description is not valid: {one_line(error)}") from error

    def _repr_html_(self) -> str:
        # Import it here, because the module of the page imports this module.
        from jansen_env.viewer.web.page import frame_of

        return frame_of(self)


ARRAYS = {
    entry.name: (entry.metadata["dtype"], entry.metadata["dimensions"])
    for entry in fields(Recording)
    if entry.metadata
}
"""Type and dimensions of each array field. All other fields are stored as JSON."""


def _read_archive(data: bytes) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of a file, after checking their number and sizes without unpacking them."""
    if not zipfile.is_zipfile(io.BytesIO(data)):
        raise ValueError("it is not an .npz file")
    if (count := data.count(DIRECTORY_ENTRY)) > MAX_MEMBERS:
        raise ValueError(f"it must have at most {MAX_MEMBERS} members, got {count}")
    wanted = {"description": np.dtype(np.uint8), **{n: kind for n, (kind, _) in ARRAYS.items()}}
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            members = archive.zip.infolist()
            if {*archive.files} != {*wanted}:
                raise ValueError(f"it must contain {sorted(wanted)}, got {shown(archive.files)}")
            if not {member.compress_type for member in members} <= PACKED:
                raise ValueError("its members must be stored or deflated, as in other .npz files")
            if (size := sum(member.file_size for member in members)) > MAX_UNPACKED:
                raise ValueError(f"it must unpack to at most {MAX_UNPACKED} bytes, got {size}")
            arrays = {name: archive[name] for name in wanted}
            for name, kind in wanted.items():
                if (dtype := arrays[name].dtype) != kind:
                    raise ValueError(f"{name} must have the type {kind}, got {dtype}")
            return arrays
    except ValueError:
        raise
    except Exception as error:  # damaged archives raise errors of many kinds
        raise ValueError(f"it is damaged: {one_line(error)}") from error
