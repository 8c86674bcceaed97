"""The ``info`` of environments, made of structured arrays of n robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Bools, Rows
from jansen_env.world.settings import Values


class InfoBuilder:
    """Information on n robots: parts of their records, put into dictionaries.

    Args:
        records: Shape (n,), the records.
        world: Shape (n,), part of the records whose fields become entries.
        energy: Shape (n,), part of the records that becomes a dictionary.
        task: Shape (n,), part of the records: the fields of ``info`` become entries, and those of
            ``reward`` the reward's terms, which are 0 at a reset.
        arrays: More entries, each of shape (n,) or (n, ...).
        groups: More records, each of shape (n,), that become dictionaries.

    Attributes:
        keys: Keys of the information of every reset and step.

    Raises:
        ValueError: If two entries have one name.
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
            raise ValueError(f"a task's INFO has {twice}, which the world's information has too")
        of_any = {name: info[name] for info in infos for name in info.dtype.names}
        rewards: Any = task["reward"]
        of_any |= {f"reward/{term}": rewards[term] for term in rewards.dtype.names}
        self._names, self._of_any = tuple(of_any), {**of_any, **arrays}
        self.keys: tuple[str, ...] = (*self._of_any, *self._groups)
        # All numbers of a robot at once, as each look into a record takes long.
        numbers: Any = energy
        self._energy_names = self._groups["energy"][1]
        energies = [numbers[name] for name in self._energy_names]
        self._numbers = _side_by_side(records, [*of_any.values(), *energies])
        self._other_groups = {k: v for k, v in self._groups.items() if k != "energy"}

    def single(self, i: int) -> Values:
        """Return the information on one robot, in Python's own types."""
        numbers: Any = self._numbers.item(i)
        info = dict(zip(self._names, numbers))  # noqa: B905 - the energies come after
        energies = numbers[len(self._names) :]
        info["energy"] = dict(zip(self._energy_names, energies))  # noqa: B905 - strict costs time
        for group, (rows, names) in self._other_groups.items():
            info[group] = dict(zip(names, rows.item(i)))  # noqa: B905
        for name, array in self._arrays.items():
            info[name] = array[i].copy() if array.ndim > 1 else array.item(i)
        return info

    def batched(self, known: Bools, keys: Sequence[str] | None = None) -> Values:
        """Return Gymnasium's vector information: arrays, 0 where not ``known``, each with a mask.

        ``keys``: those wanted, None for all.
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


def _masked(arrays: Values, wanted: Sequence[str], known: Bools) -> Values:
    """Return copies of those wanted, 0 where not ``known``, each with its mask."""
    every = bool(known.all())
    infos: Values = {}
    for name in wanted:
        if name in arrays:
            infos[name], infos[f"_{name}"] = arrays[name].copy(), known.copy()
            if not every:
                infos[name][~known] = 0
    return infos


def _side_by_side(records: Rows, parts: Sequence[NDArray[Any]]) -> Rows:
    """Return one view (n,) of the records with only these parts of them, in this order."""
    start = records.__array_interface__["data"][0]
    offsets = [part.__array_interface__["data"][0] - start for part in parts]
    layout: Any = {
        "names": [f"{number}" for number in range(len(parts))],
        "formats": [part.dtype for part in parts],
        "offsets": offsets,
        "itemsize": records.dtype.itemsize,
    }
    return records.view(np.dtype(layout))
