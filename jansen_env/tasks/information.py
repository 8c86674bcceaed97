"""The ``info`` of environments, built from structured arrays of n robots."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Bools, Rows
from jansen_env.world.settings import Values

FORMATS = {
    "b1": "?",
    "i1": "b",
    "i2": "h",
    "i4": "i",
    "i8": "q",
    "u1": "B",
    "u2": "H",
    "u4": "I",
    "u8": "Q",
    "f2": "e",
    "f4": "f",
    "f8": "d",
}
"""Format characters of :mod:`struct`, by NumPy type."""


class InfoBuilder:
    """Builder of the information on n robots, which reads parts of their records.

    Args:
        records: Records of the robots, shape (n,).
        world: Part of the records whose fields become entries, shape (n,).
        energy: Part of the records that becomes a dictionary, shape (n,).
        task: Part of the records that belongs to the task, shape (n,). The fields of its ``info``
            become entries, and the fields of its ``reward`` become the terms of the reward, which
            are 0 at a reset.
        arrays: Further entries, each with shape (n,) or (n, ...).
        groups: Further records that become dictionaries, each with shape (n,).

    Attributes:
        keys: Keys of the information of every reset and step.

    Raises:
        ValueError: If two entries have the same name.
    """

    def __init__(
        self,
        records: Rows,
        world: Rows,
        energy: Rows,
        task: Rows,
        arrays: Mapping[str, NDArray[np.generic]],
        groups: Mapping[str, Rows],
    ) -> None:
        self._arrays = dict(arrays)
        every: Values = {"energy": energy, **groups}
        self._groups = {name: (rows, rows.dtype.names or ()) for name, rows in every.items()}
        infos: Any = (world, task["info"])
        names = [name for info in infos for name in info.dtype.names] + [*arrays, *every]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(
                f"a task's INFO must not have names of the world's information, got {twice}"
            )
        of_any = {name: info[name] for info in infos for name in info.dtype.names}
        rewards: Any = task["reward"]
        of_any |= {f"reward/{term}": rewards[term] for term in rewards.dtype.names}
        self._of_any = {**of_any, **arrays}
        self.keys: tuple[str, ...] = (*self._of_any, *self._groups)
        self._reader = Reader(records, of_any)
        self._group_readers = dict[str, Reader]()
        for group, (rows, fields) in self._groups.items():
            owner = records if np.may_share_memory(records, rows) else rows
            self._group_readers[group] = Reader(owner, {name: rows[name] for name in fields})

    def single(self, i: int) -> Values:
        """Return the information on one robot as values of Python types.

        Args:
            i: Index of the robot.
        """
        info = self._reader.read(i)
        for group, reader in self._group_readers.items():
            info[group] = reader.read(i)
        for name, array in self._arrays.items():
            info[name] = array[i].copy() if array.ndim > 1 else array.item(i)
        return info

    def batched(self, known: Bools, keys: Sequence[str] | None = None) -> Values:
        """Return the information of a Gymnasium vector environment: arrays, each with a mask.

        Args:
            known: Whether a robot has information, shape (n,). The other entries of the arrays are
                0.
            keys: Keys to return. None for all keys.
        """
        wanted = self.keys if keys is None else keys
        if not wanted:
            return {}
        infos = _masked(self._of_any, wanted, known)
        for group, (rows, names) in self._groups.items():
            if group in wanted:
                infos[group] = _masked({name: rows[name] for name in names}, names, known)
                infos[f"_{group}"] = known.copy()
        return infos


class Reader:
    """Reader that returns the numbers of one record as Python types, much faster than NumPy does.

    Args:
        records: Records of the robots, shape (n,).
        columns: Fields of these records, by name.
    """

    def __init__(self, records: Rows, columns: Mapping[str, NDArray[Any]]) -> None:
        start = records.__array_interface__["data"][0]
        places = {
            name: column.__array_interface__["data"][0] - start for name, column in columns.items()
        }
        self._names = sorted(places, key=places.__getitem__)
        layout = "="
        end = 0
        for name in self._names:
            dtype = columns[name].dtype
            layout += f"{places[name] - end}x{FORMATS[dtype.str[1:]]}"
            end = places[name] + dtype.itemsize
        self._struct = struct.Struct(layout)
        self._bytes = records.view(np.uint8).data
        self._size = records.dtype.itemsize

    def read(self, i: int) -> Values:
        """Return the numbers of a record, by name.

        Args:
            i: Index of the record.
        """
        numbers = self._struct.unpack_from(self._bytes, i * self._size)
        return dict(zip(self._names, numbers))  # noqa: B905 - strict costs time


def _masked(arrays: Values, wanted: Sequence[str], known: Bools) -> Values:
    """Return copies of the wanted arrays, with 0 where not ``known``, and a mask for each."""
    every = bool(known.all())
    infos: Values = {}
    for name in wanted:
        if name in arrays:
            infos[name] = arrays[name].copy()
            infos[f"_{name}"] = known.copy()
            if not every:
                infos[name][~known] = 0
    return infos
