"""The bench, a page on which users design legs, as one HTML file.

The script ``linkage.js`` closes the linkages with the kernels of the engine.
"""

from collections.abc import Mapping
from pathlib import Path

from jansen_env.files import write_text
from jansen_env.robot import ROBOTS, Robot, part_sizes
from jansen_env.robot.designs import built_parts_of, is_of_built_parts
from jansen_env.robot.lengths import is_signed, length_names, lengths
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.viewer.web.engine_data import RUNS, engine_of_page, values_of
from jansen_env.viewer.web.page import page_of

# Size of a sheet, in m, by the material of the robot.
SHEETS = {"aluminium": (2.0, 1.0), "plywood": (0.6, 0.3)}


def write_bench(path: str | Path, robots: Mapping[str, Robot] | None = None) -> Path:
    """Write the bench as one HTML file.

    If the page of :mod:`.walk` is in the same folder, users can let their designs walk there.

    Args:
        path: Path of the file.
        robots: Robots by name. None selects the built-in designs.
    """
    designs = bench_designs(robots)
    data = {"base": "built", "builtIn": [*ROBOTS], "designs": designs, **engine_of_page()}
    return write_text(path, page_of("bench", data, runs=RUNS))


def bench_designs(robots: Mapping[str, Robot] | None = None) -> dict[str, dict[str, object]]:
    """Return designs by name, including how their parts are cut.

    Args:
        robots: Robots by name. None selects the built-in designs.
    """
    if robots is None:
        robots = {name: make() for name, make in ROBOTS.items()}
    return {
        name: {"robot": robot_to_json(each), **design_of(each), "cutting": cutting_of(each)}
        for name, each in robots.items()
    }


def cutting_of(robot: Robot) -> dict[str, object]:
    """Return the data with which the engine checks whether a robot's parts can be cut.

    Args:
        robot: Robot whose parts are cut.

    Returns:
        The material of the robot, and the arguments of
        :func:`jansen_env.engine.cutting.find_uncut`.
    """
    length, width = SHEETS[robot.material]
    radii, feet = part_sizes.hole_rows(robot)
    return {
        "material": robot.build.material,
        "radii": radii.tolist(),
        "feet": feet.tolist(),
        "sizes": values_of(part_sizes.cutting_row(robot, (1e3 * length, 1e3 * width))[0]),
    }


def design_of(robot: Robot) -> dict[str, object]:
    """Return the link lengths of a robot, and the built part of each of its bodies.

    Args:
        robot: Robot to describe.

    Returns:
        The names of the lengths, their values in m, the names of those lengths that may be
        negative, and the kind of built part of each body. The parts are None for a robot that does
        not consist of built parts.
    """
    return {
        "names": length_names(robot),
        "lengths": lengths(robot),
        "signed": [name for name in lengths(robot) if is_signed(name)],
        "parts": built_parts_of(robot).tolist() if is_of_built_parts(robot) else None,
    }
