"""Stable-Baselines3's zip files read as plain numbers: no code in them runs, no size is trusted.

A model is a zip file; each of its ``.pth`` members is a zip file again (written by torch), with the
structure as a pickle and each tensor's numbers as a member of their own. The pickle is read with
nothing but the handful of names that a state dict needs.
"""

from __future__ import annotations

import io
import json
import pickle
import pickletools
import sys
import warnings
import zipfile
from collections import OrderedDict
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import torch

from jansen_env.checks import finite, whole_number

LARGEST = 64 * 2**20  # bytes of tensors in a member; the shipped configurations' have 0.1 MB
LARGEST_TEXT = 4 * 2**20  # bytes of the "data" member and of a pickle, which unpack to more
MOST_ITEMS = 100_000  # entries of a member's nested dictionaries and lists
DEEPEST = 10  # levels of them
MOST_STEPS = 10**12  # of a model's training
MEMBERS = ("policy", "policy.optimizer", "actor.optimizer", "critic.optimizer",
           "ent_coef_optimizer", "pytorch_variables")  # fmt: skip
"""All that is needed to go on with PPO or SAC."""

STORAGES = {"FloatStorage": torch.float32, "DoubleStorage": torch.float64,
            "LongStorage": torch.int64}  # fmt: skip


def read_model(path: str | Path, members: Collection[str] = MEMBERS) -> tuple[dict[str, Any], int]:
    """Tensors and number of time steps in a Stable-Baselines3 zip file.

    Args:
        path: of the file. members: which to read; those that it lacks are left out.

    Returns:
        ({member: its dictionary, lists and tensors, all finite}, time steps trained)

    Raises:
        ValueError: no such file, or it is damaged, too large, or not what the members hold.
    """
    with _opened(path) as archive:
        present = set(archive.namelist())
        tensors = {
            name: _read_tensors(_unzip(archive, f"{name}.pth"))
            for name in members
            if f"{name}.pth" in present
        }
        data = json.loads(_unzip(archive, "data", LARGEST_TEXT))
        steps = whole_number("num_timesteps", data["num_timesteps"])
        if steps > MOST_STEPS:
            raise ValueError(f"num_timesteps is {steps}, must be at most {MOST_STEPS}")
    return tensors, steps


def read_json(path: str | Path, member: str) -> Any:
    """A member of a model's zip file that is JSON; None where there is none.

    Raises:
        ValueError: no such file, or it is damaged or too large.
    """
    with _opened(path) as archive:
        if member not in archive.namelist():
            return None
        return json.loads(_unzip(archive, member, LARGEST_TEXT))


@contextmanager
def _opened(path: str | Path) -> Iterator[zipfile.ZipFile]:
    """A zip file, whatever goes wrong in reading it one ValueError that names it."""
    try:
        with warnings.catch_warnings(), zipfile.ZipFile(path) as archive:
            warnings.simplefilter("ignore")  # such as of odd text in a damaged pickle
            yield archive
    except Exception as error:  # of a damaged file the parsers raise nearly every kind there is
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} is no Stable-Baselines3 model: {reason}") from error


def _unzip(archive: zipfile.ZipFile, name: str, most: int = LARGEST) -> bytes:
    """A member's bytes, never more of them than ``most``, whatever its header says."""
    info = archive.getinfo(name)
    if info.file_size > most:
        raise ValueError(f"{name} unpacks to {info.file_size} bytes, must be {most} at most")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{name} is packed by method {info.compress_type}, must be stored or zip")
    with archive.open(info) as member:  # the other methods' readers unpack without bound
        data = member.read(info.file_size + 1)
    if len(data) != info.file_size:
        raise ValueError(f"{name} has {len(data)} bytes, must have {info.file_size}")
    return data


def _read_tensors(data: bytes) -> Any:
    """What torch.save wrote: nested dictionaries and lists of numbers, text and tensors."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        pickles = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        if len(pickles) != 1:
            raise ValueError(f"it has {len(pickles)} files data.pkl, must have 1")
        root = pickles[0].removesuffix("/data.pkl")
        if f"{root}/byteorder" in archive.namelist():
            order = _unzip(archive, f"{root}/byteorder").decode()
            if order != sys.byteorder:
                raise ValueError(f"its byte order is {order!r}, must be {sys.byteorder!r}")
        structure = _unzip(archive, pickles[0], LARGEST_TEXT)
        # Entries of the reader's memory are numbered; one number of 2^31 would fill the computer's.
        for opcode, argument, _ in pickletools.genops(structure):
            entry = argument if opcode.name in ("PUT", "LONG_BINPUT") else 0
            if isinstance(entry, int) and entry > len(structure):
                raise ValueError(f"its pickle numbers an entry {entry}")
        return _Builder(archive, root).build(_Unpickler(io.BytesIO(structure)).load())


class _View(NamedTuple):
    """A tensor as a file describes it: what torch._utils._rebuild_tensor_v2 is called with."""

    storage: Any
    offset: Any
    size: Any
    stride: Any
    requires_grad: Any
    hooks: Any
    metadata: Any = None


class _Unpickler(pickle.Unpickler):
    """Reads state dicts: the only names known are an ordered dictionary's and a tensor's."""

    def find_class(self, module: str, name: str) -> Any:
        """One of the names that torch.save writes for a state dict."""
        if module == "torch" and name in STORAGES:
            return name
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda *arguments: _View(*arguments)  # a pickle may write to what it is given
        raise ValueError(f"it names {module}.{name}, which no state dict needs")

    def persistent_load(self, pid: Any) -> Any:
        """A storage stays what the pickle calls it: ("storage", type, member, device, n)."""
        return pid


class _Builder:
    """Plain data with tensors from what a pickle describes, within bounds of size and depth."""

    def __init__(self, archive: zipfile.ZipFile, root: str) -> None:
        self.archive, self.root = archive, root
        self.items, self.bytes = MOST_ITEMS, LARGEST

    def build(self, value: Any, depth: int = 0) -> Any:
        """The same with dictionaries, lists and tuples of their plain types, and finite numbers."""
        self.items -= 1  # entries may be shared, and may hold themselves
        if self.items < 0 or depth > DEEPEST:
            raise ValueError(
                f"it has more than {MOST_ITEMS} entries, or more than {DEEPEST} levels"
            )
        if isinstance(value, _View):
            return self._tensor(value)
        if isinstance(value, dict):
            if not all(isinstance(key, (str, int)) for key in dict.keys(value)):
                raise ValueError("it has a key that is neither text nor a number")
            return {key: self.build(entry, depth + 1) for key, entry in dict.items(value)}
        if isinstance(value, (list, tuple)):
            return type(value)([self.build(entry, depth + 1) for entry in value])
        if isinstance(value, float):
            return finite("a number in it", value)
        if value is not None and not isinstance(value, (bool, int, str)):
            raise ValueError(f"it has a {type(value).__name__}, must be numbers, text and tensors")
        return value

    def _tensor(self, view: _View) -> torch.Tensor:
        """A tensor of its own numbers, none of them used twice."""
        _, kind, key, _, count = view.storage
        data = _unzip(self.archive, f"{self.root}/data/{key}", self.bytes)
        self.bytes -= len(data)
        storage = torch.frombuffer(bytearray(data), dtype=STORAGES[kind])
        tensor = storage.as_strided(view.size, view.stride, view.offset)  # checks that it is inside
        if len(storage) != count:
            raise ValueError(f"storage {key} has {len(storage)} numbers, must have {count}")
        if tensor.numel() > len(storage):
            raise ValueError(f"a tensor of shape {view.size} has {len(storage)} numbers")
        if not torch.isfinite(tensor).all():
            raise ValueError("it has tensors that are not finite")
        return tensor.clone()
