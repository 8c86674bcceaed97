"""Levels by how far a robot has walked."""

from __future__ import annotations

import numpy as np
import pytest

from jansen_env.terrain.curriculum import Curriculum


@pytest.mark.parametrize(
    "level, walked, commanded, then",
    [
        (3, 2.51, 5.0, 4),
        (3, 2.5, 5.0, 3),  # more than half is more than half
        (3, 1.25, 5.0, 3),
        (3, 1.24, 5.0, 2),
        (3, -1.0, 5.0, 2),
        (0, 0.0, 5.0, 0),
        (0, 5.0, 5.0, 1),
        (8, 5.0, 5.0, 9),
        (9, 2.0, 5.0, 9),
        (9, 0.0, 5.0, 8),
        (4, 0.0, 0.0, 4),  # nothing was asked for
    ],
)
def test_the_rule(level, walked, commanded, then, rng):
    before = rng.bit_generator.state
    assert Curriculum().next_level(level, walked, commanded, rng) == then
    assert rng.bit_generator.state == before  # nothing is drawn


def test_past_the_top_any_level(rng):
    curriculum = Curriculum(highest=4)
    levels = [curriculum.next_level(4, 5.0, 5.0, rng) for _ in range(500)]
    counts = np.bincount(levels, minlength=5)
    assert len(counts) == 5 and counts.min() > 60
    # Who comes from above goes to one of those levels too.
    assert {curriculum.next_level(9, 0.0, 5.0, rng) for _ in range(100)} == {0, 1, 2, 3, 4}


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"up": 1.5}, "up is 1.5"),
        ({"down": -0.1}, "down is -0.1"),
        ({"up": 0.2}, "down is 0.25, must be at most up, 0.2"),
        ({"highest": 10}, "highest is 10"),
        ({"horizon": 0.0}, "horizon is 0.0"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Curriculum(**arguments)
