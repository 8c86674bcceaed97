"""The ``info`` of environments, made of structured arrays of n robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Bools, Rows
from jansen_env.world.settings import Values


class InfoBuilder:
    """Information on n robots: arrays of the world and of the task, put into dictionaries.

    Args:
        world: (n,) structured rows of numbers and flags. energy: (n,) rows that become a
            dictionary of their own. task: (n,) rows: ``info`` has more numbers and flags,
            ``reward`` the reward's terms, which are 0 at a reset.
        arrays: (n,) or (n, ...) more of it.
        groups: (n,) structured rows that become dictionaries, by name.

    Attributes:
        keys: those of the information of every reset and step.

    Raises:
        ValueError: a name that two have.
    """

    def __init__(
        self,
        world: Rows,
        energy: Rows,
        task: Rows,
        arrays: Mapping[str, NDArray[np.generic]],
        groups: Mapping[str, Rows],
    ) -> None:
        self._world, self._task, self._arrays = world, task[["info", "reward"]], dict(arrays)
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

    def single(self, i: int) -> Values:
        """Return that of one robot, in Python's own types."""
        world: Any = self._world.item(i)
        task: Any = self._task.item(i)
        info = dict(zip(self._names, world + task[0] + task[1]))  # noqa: B905 - strict costs time
        for group, (rows, names) in self._groups.items():
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
