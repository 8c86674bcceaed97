"""The bill of materials of the built robot as a table."""

from __future__ import annotations

from benchmarks.measure import table
from jansen_env import Robot
from jansen_env.drawings.materials import bill_of_materials


def parts_table(robot: Robot) -> str:
    """The bill of materials."""
    parts = bill_of_materials(robot)
    head = ("part", "material", "dimensions", "number", "each (g)", "all (g)", "price class")
    rows = [(p.name, p.material, p.dimensions, p.number, f"{1e3 * p.each:.1f}",
             f"{1e3 * p.mass:.0f}", p.price) for p in parts]  # fmt: skip
    total = ("all", "", "", "", "", f"{1e3 * sum(p.mass for p in parts):.0f}", "")
    return table(head, [*rows, total])
