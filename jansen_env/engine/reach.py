"""How far points reach in directions."""

from __future__ import annotations

from jansen_env.engine.kernel import Floats1, Floats2, kernel


@kernel
def put_reach(points: Floats2, directions: Floats2, out: Floats1) -> None:
    """Put the farthest that points (n, 2) reach along unit vectors (2, k) into (k,), m."""
    for k in range(len(out)):
        out[k] = points[0, 0] * directions[0, k] + points[0, 1] * directions[1, k]
    for i in range(1, len(points)):
        x, y = points[i, 0], points[i, 1]
        for k in range(len(out)):
            along = x * directions[0, k] + y * directions[1, k]
            out[k] = along if along > out[k] else out[k]
