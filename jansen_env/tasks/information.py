"""The ``info`` of environments, made of structured arrays of n robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]


class InfoBuilder:
    """Information on n robots: arrays of the world and of the task, put into dictionaries.

    Args:
        world: (n,) structured rows: their field ``info`` has numbers and flags, ``energy`` becomes
            a dictionary of its own. task: (n,) rows: ``info`` has more numbers and flags,
            ``reward`` the reward's terms, which only a step has.
        arrays: (n, ...) more of it. step_arrays: (n,) more numbers that only a step has.
        parameters: (n,) structured rows that become a dictionary of that name; None for none.

    Attributes:
        keys: all that a step's information has.
    """

    def __init__(
        self,
        world: NDArray[Any],
        task: NDArray[Any],
        arrays: Mapping[str, NDArray[Any]],
        step_arrays: Mapping[str, NDArray[Any]],
        parameters: NDArray[Any] | None = None,
    ) -> None:
        self._world, self._task = world[["info", "energy"]], task[["info", "reward"]]
        self._arrays, self._parameters = dict(arrays), parameters
        energy = world["energy"]
        self._groups: dict[str, Any] = {"energy": (energy, energy.dtype.names)}
        if parameters is not None:
            self._groups["parameters"] = (parameters, parameters.dtype.names)
        infos: Any = (world["info"], task["info"])
        of_any = {name: info[name] for info in infos for name in info.dtype.names}
        self._names = tuple(of_any)
        rewards: Any = task["reward"]
        self._terms = {f"reward/{term}": rewards[term] for term in rewards.dtype.names}
        self._names_of_step = (*self._names, *self._terms)
        self._step_arrays, self._of_any = dict(step_arrays), {**of_any, **arrays}
        self.keys = (*self._of_any, *self._groups, *self._terms, *step_arrays)

    def single(self, row: int, stepped: bool) -> dict[str, Any]:
        """Return that of one robot, in Python's own types; ``stepped``: of a step, not a reset."""
        world: Any = self._world.item(row)
        task: Any = self._task.item(row)
        names, numbers = self._names, world[0] + task[0]
        if stepped:
            names, numbers = self._names_of_step, numbers + task[1]
        info = dict(zip(names, numbers, strict=True))
        info["energy"] = dict(zip(self._groups["energy"][1], world[1], strict=True))
        if self._parameters is not None:
            values = self._parameters.item(row)
            info["parameters"] = dict(zip(self._groups["parameters"][1], values, strict=True))
        for name, array in self._arrays.items():
            info[name] = array[row].copy()
        if stepped:
            for name, array in self._step_arrays.items():
                info[name] = array.item(row)
        return info

    def batched(
        self, known: Bools, stepped: Bools, keys: Sequence[str] | None = None
    ) -> dict[str, Any]:
        """Return Gymnasium's vector information: arrays, 0 where not ``known``, each with a mask.

        ``stepped``: (n,) whether it is of a step; ``keys``: those wanted, None for all.
        """
        wanted = self.keys if keys is None else keys
        if not wanted:
            return {}
        infos = _masked(self._of_any, wanted, known)
        for group, (rows, names) in self._groups.items():
            if group in wanted:
                infos[group] = _masked({name: rows[name] for name in names}, names, known)
                infos[f"_{group}"] = known.copy()
        if stepped.any():
            infos |= _masked({**self._terms, **self._step_arrays}, wanted, stepped)
        return infos


def _masked(arrays: Mapping[str, Any], wanted: Sequence[str], known: Bools) -> dict[str, Any]:
    """Return copies of those wanted, 0 where not ``known``, each with its mask."""
    every = bool(known.all())
    infos: dict[str, Any] = {}
    for name in wanted:
        if name in arrays:
            infos[name], infos[f"_{name}"] = arrays[name].copy(), known.copy()
            if not every:
                infos[name][~known] = 0
    return infos
