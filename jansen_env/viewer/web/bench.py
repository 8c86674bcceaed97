"""The bench, a page to design legs on: served by ``jansen_env.play``, or as one file.

``linkage.js`` closes the linkages, whose topology and lengths it gets from here.
"""

from __future__ import annotations

import cmath
from pathlib import Path

from jansen_env.files import write_text
from jansen_env.robot import ROBOTS, Robot
from jansen_env.robot.lengths import lengths
from jansen_env.viewer.web.page import filled, page_of

# Each after what it imports.
SCRIPTS = ("linkage", "bench_picture", "bench_design", "terms", "bench")
STYLES = ("theme.css", "bench.css")
LINKS = {
    "<!-- style -->": "".join(f'<link rel="stylesheet" href="{name}">' for name in STYLES),
    "<!-- script -->": '<script type="module" src="bench.js"></script>',
    # The server sends a policy itself.
    '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'">': "",
}


def bench_page() -> str:
    """The bench as one HTML file with all designs, which needs no server and cannot walk."""
    return page_of("bench.html", STYLES, SCRIPTS, bench_data(served=False))


def served_bench_page() -> str:
    """The bench whose styles and scripts a server has, and which asks it to walk."""
    return filled("bench.html", LINKS, bench_data(served=True))


def write_bench(path: str | Path) -> Path:
    """Write :func:`bench_page` atomically. Raises OSError: it cannot be written."""
    return write_text(path, bench_page())


def bench_data(served: bool) -> dict[str, object]:
    """What the page knows: ``designs`` by name, the first one, and whether it is ``served``."""
    designs = {name: design_of(make()) for name, make in ROBOTS.items()}
    return {"served": served, "base": "built", "designs": designs}


def design_of(robot: Robot) -> dict[str, object]:
    """A robot's linkage and lengths as plain numbers; ``linkage.js`` says what is what."""
    linkage = robot.linkage
    start, end = (cmath.rect(c, o) for c, o in robot.frame.corners[:2])
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
