"""The bench, a page on which users design legs, as one HTML file.

The script ``linkage.js`` closes the linkages with the kernels of the engine.
"""

from collections.abc import Mapping
from pathlib import Path

from jansen_env.files import write_text
from jansen_env.robot import ROBOTS, Robot, part_sizes
from jansen_env.robot.buildable import ALUMINIUM, OUTLINE
from jansen_env.robot.designs import built_parts_of, is_of_built_parts
from jansen_env.robot.lengths import is_signed, length_names, lengths
from jansen_env.robot.part_sizes import MARGIN
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.viewer.web.engine_data import RUNS, engine_of_page
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
    """Return the data with which ``cutting.js`` checks whether a robot's parts can be cut.

    Args:
        robot: Robot whose parts are cut.

    Returns:
        The material of the robot, and sizes of its parts and their holes, in m.
    """
    build, bodies = robot.build, range(1, len(robot.bodies) + 1)
    shoe = build is ALUMINIUM
    return {
        "material": build.material,
        "holes": [
            {joint: 1e-3 * radius for joint, radius in part_sizes.pin_hole_radii(robot, k).items()}
            for k in bodies
        ],
        "feet": [part_sizes.feet_of(robot, k) for k in bodies],
        "hub": {"away": build.hub_screws, "radius": 1e-3 * part_sizes.M3},
        "foot": {
            "radius": 1e-3 * (part_sizes.SHOE_SCREW if shoe else part_sizes.M3),
            "away": [[1e-3 * x for x in pair] for pair in part_sizes.SHOE_SCREWS] if shoe else [],
            "parallel": part_sizes.PARALLEL,
        },
        # The radius of a plate's inscribed circle is at most half of the plate's height.
        "rim": (OUTLINE - 1.0) / 2.0,
        "wall": 1e-3 * part_sizes.WALL,
        "sheet": [side - 2e-3 * MARGIN for side in SHEETS[robot.material]],
        "widths": [build.frame_width, build.width],
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
