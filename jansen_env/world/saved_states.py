"""Saved states of robots: copies of their records by name, which other environments can load.

A saved state contains every field of a robot's record (:mod:`jansen_env.engine.records`), except
the fields in :data:`OMITTED` and those that the task omits. A field that is added to the record is
therefore saved without another line of code. If a saved state lacks a field, the field gets the
value that it has at the beginning of an episode.

The fields of the part ``robot`` of a record, such as ``action``, are saved on the same level as
the other parts of the record, such as ``slip``.

A state is saved by ``SingleEnv.get_state``, ``Task.get_state``, ``World.get_state`` and
:meth:`SavedRecords.read`, each of which calls the next one. To restore it, ``SingleEnv.set_state``
calls ``Task.set_state``. This method calls ``check_saved_state``, which checks the state with
:meth:`SavedRecords.check`, and then ``World.restore``, which changes the record with
:meth:`SavedRecords.clear` and :meth:`SavedRecords.write`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from jansen_env import checks
from jansen_env.arrays import Array, Rows
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.world.settings import Check, Values, flag

VERSION = 1
"""Version of the format. A state of another version is rejected."""
LARGEST_COUNT = 2**63 - 1
"""Largest whole number of a record."""
OMITTED = (
    # Values that are computed from the robot, its terrain and the parameters of the episode.
    "properties",
    "status",
    "delay",
    "weight",
    "direction",
    "full_torque",
    "most_change",
    # Results of the last control step that no later step reads.
    "accumulators",
    "energy",
    "diverged",
    "info.diverged",
    "reward",
    "terminated",
    "task.reward",
    # The number of pushes, which is the length of the saved schedule.
    "scheduled",
)
"""Fields of a record that are not saved. A dot separates the names of nested fields."""


APPLIED = ("state", "statistics.deflection", "parameters", "schedule")
"""Saved fields that the simulation applies, so that they need not be written into the record."""


class SavedRecords:
    """Saver and loader of the records of n robots.

    Args:
        records: The records.
        omitted: Fields of the task's part of a record that are not saved.
    """

    def __init__(self, records: RobotRecords, omitted: Collection[str] = ()) -> None:
        self._records = records
        self._omitted = {*OMITTED, *(f"task.{name}" for name in omitted)}

    def _parts(self) -> dict[str, Rows]:
        """Return the saved fields of the records by name, as views with one row per robot."""
        data = self._records.data
        robots = self._records.robots
        parts = {name: robots[name] for name in robots.dtype.names or ()}
        parts |= {name: data[name] for name in data.dtype.names or () if name != "robot"}
        return {name: rows for name, rows in parts.items() if name not in self._omitted}

    def _fields(self, rows: Rows, path: str) -> dict[str, Rows]:
        """Return the saved fields of a nested record by name.

        Args:
            rows: The records.
            path: Path of the field that contains them.
        """
        names = rows.dtype.names or ()
        return {name: rows[name] for name in names if f"{path}.{name}" not in self._omitted}

    def read(self, i: int) -> Values:
        """Return a copy of a robot's record.

        Args:
            i: Index of the robot.

        Returns:
            The saved fields by name: numbers, flags, arrays, and dictionaries of these.
        """
        saved = {name: self._read(rows, i, name) for name, rows in self._parts().items()}
        saved["schedule"] = saved["schedule"][: int(self._records.robots["scheduled"][i])]
        return saved

    def _read(self, rows: Rows, i: int, path: str) -> Any:
        """Return a copy of a field of a robot's record."""
        if rows.dtype.names is None:
            return rows[i].item() if rows.ndim == 1 else rows[i].copy()
        fields = self._fields(rows, path)
        return {name: self._read(part, i, f"{path}.{name}") for name, part in fields.items()}

    def check(self, label: str, given: object, special: Mapping[str, Check]) -> Values:
        """Check a saved record.

        Args:
            label: Name of the record, for error messages.
            given: The record.
            special: Checks of fields by path, in place of the check that a field is finite and has
                the right shape.

        Returns:
            The checked fields by name.

        Raises:
            ValueError: If a field is unknown, has another shape, or is out of range.
        """
        return self._check_all(label, given, self._parts(), "", special)

    def _check_all(
        self,
        label: str,
        given: object,
        fields: Mapping[str, Rows],
        path: str,
        special: Mapping[str, Check],
    ) -> Values:
        """Check the fields of a record or of a part of it."""
        values: Mapping[str, object] = checks.instance(label, given, Mapping)
        if unknown := [name for name in values if name not in fields]:
            allowed = checks.listed([*fields], unknown[0])
            raise checks.invalid(f"a field of {label}", unknown[0], f"one of {allowed}")
        return {
            name: self._check(f"{label}[{name!r}]", values[name], rows, path + name, special)
            for name, rows in fields.items()
            if name in values
        }

    def _check(
        self, label: str, value: object, rows: Rows, path: str, special: Mapping[str, Check]
    ) -> object:
        """Check one field of a record."""
        if path in special:
            return special[path](label, value)
        if rows.dtype.names is not None:
            return self._check_all(label, value, self._fields(rows, path), f"{path}.", special)
        if rows.ndim > 1:
            return finite_array(label, value, rows.shape[1:])
        if rows.dtype.kind == "b":
            return flag(label, value)
        if rows.dtype.kind == "i":
            return checks.whole_number(label, value, most=LARGEST_COUNT)
        return checks.within(label, value, -checks.MOST_SINGLE, checks.MOST_SINGLE)

    def clear(self, i: int, kept: Collection[str] = ()) -> None:
        """Set the saved fields of a robot's record, and the results of its last step, to 0.

        Args:
            i: Index of the robot.
            kept: Paths of fields that keep their values.
        """
        robots = self._records.robots
        for name in ("accumulators", "energy"):
            robots[name][i] = np.zeros((), robots[name].dtype)
        for name, rows in self._parts().items():
            self._clear(rows, i, name, kept)
        robots["random_pushes"][i] = True

    def _clear(self, rows: Rows, i: int, path: str, kept: Collection[str]) -> None:
        """Set a field of a robot's record to 0."""
        if path in kept:
            return
        if rows.dtype.names is None:
            rows[i] = 0
        for name, part in self._fields(rows, path).items():
            self._clear(part, i, f"{path}.{name}", kept)

    def write(self, i: int, values: Values, kept: Collection[str] = ()) -> None:
        """Write checked fields into a robot's record.

        Args:
            i: Index of the robot.
            values: Fields that :meth:`check` returned.
            kept: Paths of fields that keep their values.
        """
        for name, rows in self._parts().items():
            if name in values:
                self._write(rows, i, values[name], name, kept)

    def _write(self, rows: Rows, i: int, value: object, path: str, kept: Collection[str]) -> None:
        """Write a field of a robot's record."""
        if path in kept:
            return
        if not isinstance(value, Mapping):
            rows[i] = value
            return
        for name, part in value.items():
            self._write(rows[name], i, part, f"{path}.{name}", kept)


def finite_array(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return a copy of finite numbers as an array.

    Args:
        name: Name of the array, for the error message.
        value: The numbers.
        shape: Required shape.

    Raises:
        ValueError: If the shape is different, or a number is not finite or too large for float32.
    """
    numbers = checks.numbers_of(value)
    if numbers.shape != shape or not (np.abs(numbers) <= checks.MOST_SINGLE).all():
        allowed = f"finite numbers of shape {shape}, within {checks.MOST_SINGLE:.2g}"
        raise checks.invalid(name, value, allowed)
    return numbers
