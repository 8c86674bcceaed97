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
        self._world, self._task, self._parameters = world, task, parameters
        self._arrays, self._step_arrays = dict(arrays), dict(step_arrays)
        (self._of_world, self._info), (self._at_energy, self._energy) = (
            _field(world, name) for name in ("info", "energy")
        )
        (self._of_task, self._own), (self._at_reward, self._reward) = (
            _field(task, name) for name in ("info", "reward")
        )
        self._names = self._info + self._own
        self._terms = tuple(f"reward/{name}" for name in self._reward)
        more = () if parameters is None else ("parameters",)
        self.keys = (
            *self._names, "energy", *arrays, *self._terms, *step_arrays, *more
        )  # fmt: skip

    def single(self, row: int, stepped: bool) -> dict[str, Any]:
        """Return that of one robot, in Python's own types.

        Args:
            stepped: whether of a step, not of a reset.
        """
        world, task = self._world[row].item(), self._task[row].item()
        numbers = world[self._of_world] + task[self._of_task]
        info = dict(zip(self._names, numbers, strict=True))
        info["energy"] = dict(zip(self._energy, world[self._at_energy], strict=True))
        for name, array in self._arrays.items():
            info[name] = array[row].copy()
        if self._parameters is not None:
            names = self._parameters.dtype.names or ()
            info["parameters"] = dict(zip(names, self._parameters[row].item(), strict=True))
        if stepped:
            info.update(zip(self._terms, task[self._at_reward], strict=True))
            for name, array in self._step_arrays.items():
                info[name] = array[row].item()
        return info

    def batched(
        self, known: Bools, stepped: Bools, keys: Sequence[str] | None = None
    ) -> dict[str, Any]:
        """Return Gymnasium's vector information: arrays, 0 where not ``known``, each with a mask.

        Args:
            known, stepped: (n,) of which robots there is any, and of which that of a step.
            keys: of :attr:`keys` those wanted, None for all.
        """
        wanted = self.keys if keys is None else keys
        if not wanted:
            return {}
        world, own = self._world["info"], self._task["info"]
        of_any = {name: world[name] for name in self._info}
        of_any |= {name: own[name] for name in self._own} | self._arrays
        infos = _masked({name: of_any[name] for name in wanted if name in of_any}, known)
        groups = {"energy": self._world["energy"], "parameters": self._parameters}
        for group, rows in groups.items():
            if group in wanted and rows is not None:
                infos[group] = _masked({name: rows[name] for name in rows.dtype.names or ()}, known)
                infos[f"_{group}"] = known.copy()
        if stepped.any():
            terms = zip(self._terms, self._reward, strict=True)
            rewards = self._task["reward"]
            of_step = {name: rewards[term] for name, term in terms} | self._step_arrays
            infos |= _masked({name: of_step[name] for name in wanted if name in of_step}, stepped)
        return infos


def _field(rows: NDArray[Any], name: str) -> tuple[int, tuple[str, ...]]:
    """Return a field's place in structured rows, and the names in it."""
    names: Any = rows.dtype.names
    return names.index(name), tuple(rows.dtype[name].names or ())


def _masked(arrays: dict[str, NDArray[Any]], known: Bools) -> dict[str, Any]:
    """Return copies, 0 where not ``known``, each with its mask."""
    every = bool(known.all())
    infos: dict[str, Any] = {}
    for name, array in arrays.items():
        infos[name], infos[f"_{name}"] = array.copy(), known.copy()
        if not every:
            infos[name][~known] = 0
    return infos
