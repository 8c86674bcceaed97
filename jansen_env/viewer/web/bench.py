"""The bench, a page to design legs on, as one file.

``linkage.js`` closes the linkages, whose topology and lengths it gets from here.
"""

import cmath
from pathlib import Path

from jansen_env.files import write_text
from jansen_env.robot import ROBOTS, Robot
from jansen_env.robot.lengths import lengths
from jansen_env.viewer.web.page import page_of


def write_bench(path: str | Path) -> Path:
    """Write the bench with all designs as one HTML file; beside :mod:`.walk`'s they walk."""
    designs = {name: design_of(make()) for name, make in ROBOTS.items()}
    return write_text(path, page_of("bench", {"base": "built", "designs": designs}))


def design_of(robot: Robot) -> dict[str, object]:
    """A robot's linkage and lengths as plain numbers; ``linkage.js`` says what is what."""
    linkage = robot.linkage
    start, end = (cmath.rect(c, o) for c, o in robot.bodies[0].corners[:2])
    return {
        "joints": linkage.joints,
        "bodies": [list(body) for body in linkage.bodies],
        "kinds": [type(link).__name__ for link in robot.bodies],
        "dyads": [list(dyad) for dyad in linkage.dyads],
        "toes": linkage.toes,
        "legs": [[leg.side, leg.phase] for leg in robot.legs],
        "turn": cmath.phase(end - start),
        "lengths": lengths(robot),
    }
