"""Stable-Baselines3's zip files read as plain numbers: no code in them runs, no size is trusted.

Each ``.pth`` member of a model is a zip file again, written by ``torch.save``. Sizes and the names
in its pickle are checked before torch reads it with ``weights_only=True``. Nothing may be packed:
so no file asks for more memory than a few times its size.
"""

from __future__ import annotations

import io
import json
import pickle
import pickletools
import warnings
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from jansen_env.checks import finite, instance, whole_number
from jansen_env.files import open_regular

MAX_BYTES = 64 * 2**20  # of tensors in a member; the shipped configurations' have 0.1 MB
MAX_TEXT = 4 * 2**20  # bytes of the "data" member and of a pickle, which make more in memory
NAMES_OF_ONE = 4  # of a tensor in a state dict: networks may share their features
MAX_STATE = 64 * 2**20  # bytes of a training state: some 2 kB a robot
MAX_ENTRIES = 100_000  # of a member's nested dictionaries and lists
MAX_DEPTH = 10  # levels of them
MAX_STEPS = 10**12  # of a model's training
MEMBERS = ("policy", "policy.optimizer", "actor.optimizer", "critic.optimizer",
           "ent_coef_optimizer", "pytorch_variables")  # fmt: skip
"""All that is needed to go on with any of :data:`jansen_env.sb3.run_config.ALGORITHMS`."""

NOTES = "notes.json"  # what belongs to a model and Stable-Baselines3 does not know
STATE = "state.json"  # of training, see agents.training.training_state

NAMES = ("collections OrderedDict", "torch._utils _rebuild_tensor_v2", "torch FloatStorage",
         "torch DoubleStorage", "torch LongStorage")  # fmt: skip
"""Names in the pickle of a state dict."""


def read_model(path: str | Path, members: Collection[str] = MEMBERS) -> tuple[dict[str, Any], int]:
    """Read the tensors, all finite, of those ``members`` that a Stable-Baselines3 zip file has, and
    the number of time steps trained.

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
        data = parse_json(_unzip(archive, "data", MAX_TEXT))
        return tensors, whole_number("num_timesteps", data["num_timesteps"], MAX_STEPS)


def read_notes(path: str | Path) -> dict[str, Any]:
    """Return the notes of :func:`agents.training.models.save_model`; {} if there are none."""
    return _read_json(path, NOTES, MAX_TEXT, needed=False)


def read_training_state(path: str | Path) -> dict[str, Any]:
    """Return the training state in a model's file, see :mod:`agents.training.training_state`."""
    return _read_json(path, STATE, MAX_STATE)


def _read_json(path: str | Path, name: str, limit: int, needed: bool = True) -> dict[str, Any]:
    """Return a dictionary that is a member of a model's file; {} where none is needed."""
    with _opened(path) as archive:
        if not needed and name not in archive.namelist():
            return {}
        value = parse_json(_unzip(archive, name, limit))
        instance(name, value, dict)
    return dict(value)


def parse_json(data: bytes) -> Any:
    """Parse JSON, but no text of nothing but brackets, each of which takes many times its size."""
    if data.count(b"[") + data.count(b"{") > MAX_ENTRIES:
        raise ValueError(f"it has more than {MAX_ENTRIES} lists and dictionaries")
    return json.loads(data)


@contextmanager
def _opened(path: str | Path) -> Iterator[zipfile.ZipFile]:
    """Open a zip file; whatever goes wrong in reading it is one ValueError that names it."""
    try:
        with warnings.catch_warnings(), open_regular(path) as file:
            warnings.simplefilter("ignore")  # such as of odd text in a damaged pickle
            with zipfile.ZipFile(file) as archive:
                yield archive
    except Exception as error:  # of a damaged file the parsers raise nearly every kind there is
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} is no Stable-Baselines3 model: {reason}") from error


def _unzip(archive: zipfile.ZipFile, name: str, limit: int = MAX_BYTES) -> bytes:
    """Read a member's bytes, never more of them than ``limit``, whatever its header says."""
    info = archive.getinfo(name)
    if info.file_size > limit:
        raise ValueError(f"{name} unpacks to {info.file_size} bytes, must be {limit} at most")
    if info.compress_type != zipfile.ZIP_STORED:  # as Stable-Baselines3 writes it
        raise ValueError(f"{name} is packed by method {info.compress_type}, must be stored")
    with archive.open(info) as member:
        data = member.read(info.file_size + 1)
    if len(data) != info.file_size:
        raise ValueError(f"{name} has {len(data)} bytes, must have {info.file_size}")
    return data


def _read_tensors(data: bytes) -> Any:
    """Read what torch.save wrote: nested dictionaries and lists of numbers, text and tensors."""
    if not data.startswith(b"PK\3\4"):  # with anything before, torch takes other formats for it
        raise ValueError("a member is no zip file")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        sizes = sum(info.file_size for info in archive.infolist())
        if sizes > len(data):
            raise ValueError(f"it unpacks to {sizes} bytes, must be {len(data)} at most")
        packed = [info.filename for info in archive.infolist() if info.compress_type]
        if packed:
            raise ValueError(f"{packed[0]} in it is packed, must be stored")
        pickles = [name for name in archive.namelist() if name.lower().endswith("/data.pkl")]
        if len(pickles) != 1:
            raise ValueError(f"it has {len(pickles)} files data.pkl, must have 1")
        for opcode, argument, _ in pickletools.genops(_unzip(archive, pickles[0], MAX_TEXT)):
            if "GLOBAL" in opcode.name and argument not in NAMES:
                raise ValueError(f"it names {argument}, which no state dict needs")
    try:
        value = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:  # whose text advises to load without this safety
        raise ValueError("its pickle is no state dict") from None
    _check_plain(value, len(data))
    return value


def _nodes(value: Any, depth: int = 0) -> Iterator[Any]:
    """Give a value and all in its nested dictionaries and lists; of bounded depth."""
    if depth == MAX_DEPTH:
        raise ValueError(f"it has more than {MAX_DEPTH} levels")
    yield value
    if isinstance(value, dict):
        if not all(isinstance(key, (str, int)) for key in dict.keys(value)):
            raise ValueError("it has a key that is neither text nor a number")
        value = tuple(dict.values(value))
    if isinstance(value, (list, tuple)):
        for entry in value:
            yield from _nodes(entry, depth + 1)


def _check_plain(value: Any, stored: int) -> None:
    """Raise a ValueError unless all is dictionaries, lists, finite numbers and tensors, text; these
    may share what is ``stored``, bytes, under a few names."""
    size = 0
    for count, node in enumerate(_nodes(value)):
        if count == MAX_ENTRIES:
            raise ValueError(f"it has more than {MAX_ENTRIES} entries")
        if isinstance(node, torch.Tensor):
            size += node.nbytes  # views of few numbers may be large, or many
            if size > NAMES_OF_ONE * stored:
                raise ValueError(f"its tensors take more than {NAMES_OF_ONE} x {stored} bytes")
            if not torch.isfinite(node).all():
                raise ValueError("it has tensors that are not finite")
        elif isinstance(node, float):
            finite("a number in it", node)
        elif node is not None and not isinstance(node, (dict, list, tuple, int, str)):
            raise ValueError(f"it has a {type(node).__name__}, must be numbers and tensors")
