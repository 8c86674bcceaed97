"""Data that web pages need to call the engine: its module, kernels, records and constants."""

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.dynamics import reduced
from jansen_env.engine import (
    collision,
    contact_frames,
    crank_control,
    cutting,
    ground_load,
    kernel,
    link_shapes,
    machines,
    pcg64,
    placement,
    pushes,
    records,
    reduction,
    topology,
    walk_reward,
)
from jansen_env.plants import design_tables
from jansen_env.robot import buildable, kinematics, links, robot, robot_file, zoo
from jansen_env.tasks.walking import walker_env
from jansen_env.world import push

Json = dict[str, Any]
RUNS = "'wasm-unsafe-eval'"
"""Source that a page with the engine allows in its content security policy.

It is allowed in addition to the page's own script.
"""
RECORDS = {
    "ROBOT": records.ROBOT,
    "STATISTICS": records.CONTACT_STATISTICS,
    "PAD": records.PAD,
    "WORLD": records.WORLD,
    "PLANE": records.PLANE,
    "MACHINE": records.MACHINE,
    "LINK": link_shapes.LINK,
    "BUILD": link_shapes.BUILD,
    "CUTTING": cutting.CUTTING,
    "CHASSIS": machines.CHASSIS,
    "WALK": walk_reward.ROW,
    "SETTINGS": walk_reward.SETTINGS,
    "PUSHES": pushes.PUSHES,
}
NUMBERS = {
    reduction: "SAMPLES HARMONICS INTERVALS ORDER BEARING_SAMPLES BODY_SUMS PAD_FUNCTIONS",
    reduced: "TAIL_TOLERANCE WORK_ARRAYS",
    ground_load: "UNSUPPORTED",
    kinematics: "TURN_SAMPLES STANCE",
    zoo: "HEIGHT_SAMPLES",
    design_tables: "PITCHES",
    collision: "SPECULATIVE_MARGIN",
    push: "MOST_PUSHES",
    topology: "CHASSIS",
    walker_env: "FASTEST_COMMAND",
    robot: "MOST_PADS",
    placement: "DEEPEST",
}
OF_PAGES = (pcg64, contact_frames, crank_control)
"""Modules of the engine that pages use. Importing a module registers its kernels."""


def engine_of_page() -> Json:
    """Return the module and the layout of the engine, which a page needs to load it."""
    return {"engine": engine_module(), "layout": engine_layout()}


def engine_module() -> str:
    """Return the WebAssembly module of the engine, encoded in base64."""
    module = kernel.built_library("wasm").read_bytes()
    return packed(np.frombuffer(module, np.uint8), "u1")


def engine_layout() -> Json:
    """Return the kernels' arguments, the layouts of records, and the constants that pages need."""
    return {
        "kernels": {each.symbol: _arguments(each) for each in kernel.kernels},
        "records": {name: _layout(dtype) for name, dtype in RECORDS.items()},
        "numbers": {n: getattr(part, n) for part, names in NUMBERS.items() for n in names.split()},
        "expansion": packed(reduced._expansion(), "<f8"),
        "links": link_shapes.KINDS,
        "linkageFaults": topology.LINKAGE_FAULTS,
        "springFaults": topology.SPRING_FAULTS,
        "jointsOf": {kind.__name__: kind.JOINTS for kind in (links.Bar, links.Triangle)},
        "format": robot_file.FORMAT,
        "schema": robot_file.file_schema(),
        "build": values_of(buildable.build_row()[0]),
    }


def packed(values: ArrayLike, dtype: str) -> str:
    """Return the bytes of an array, encoded in base64.

    Args:
        values: Values of the array.
        dtype: Type to which the values are converted.
    """
    return base64.b64encode(np.ascontiguousarray(values, dtype).tobytes()).decode()


def values_of(row: np.void) -> Json:
    """Return the values of a record by name.

    Args:
        row: Record, an element of a structured array.
    """
    return dict(zip(row.dtype.names or (), row.item(), strict=True))


def _arguments(made: kernel.Kernel) -> list[tuple[str, str, int, bool]]:
    """Return the name, type and number of axes of each argument of a kernel.

    The last entry of an argument is True if the rows of the array may lie apart in memory.
    """
    named: dict[Any, str] = {dtype: name for name, dtype in RECORDS.items()}
    return [
        (p.name, named.get(p.dtype) or p.dtype.str[1:], p.ndim, p.apart) for p in made.parameters
    ]


def _layout(dtype: np.dtype[Any]) -> Json:
    """Return the size of a record, and the offset, type and length of each of its fields."""
    fields = {name: _field(*place[:2]) for name, place in (dtype.fields or {}).items()}
    return {"size": dtype.itemsize, "fields": fields}


def _field(dtype: np.dtype[Any], offset: int) -> tuple[int, str | Json, int]:
    """Return the offset, type and length of a field."""
    kind, shape = dtype.subdtype or (dtype, ())
    return offset, _layout(kind) if kind.names else kind.str[1:], math.prod(shape)
