"""What errata of the paper come to: every number, from two sides where there are two."""

import numpy as np
import pytest

from jansen_env.dynamics.inverse import crank_torque
from jansen_env.paper import errata, fixed_model, toes
from jansen_env.robot import JANSEN, paper_robot


def test_dropped_velocity_terms():
    """0.091 N m at 1 rad/s: with a fixed base all of (12)'s velocity terms, which are k' / 2."""
    most = errata.dropped_velocity_terms().numbers["most"]
    assert most == pytest.approx(0.0909, abs=5e-4)
    angle = toes.turn(errata.ANGLES)
    projected = fixed_model.fixed_base_projection(paper_robot(), angle, np.ones(len(angle)), 0.0)
    assert np.abs(projected.velocity_terms).max() == pytest.approx(most, rel=1e-12)
    assert np.abs(crank_torque(paper_robot(), angle).inertia).max() == pytest.approx(most, rel=1e-9)


def test_frame_pairs_at_the_pivot():
    """1.562 N m as listed, 3.7 to 8.2 % more with the frame's at P: each adds its own loss."""
    numbers = errata.frame_pairs().numbers
    assert numbers == pytest.approx(
        {"listed": 1.5622, "four": 1.6204, "five": 1.6327, "both": 1.6909}, abs=1e-4
    )
    assert not {(1, 4), (1, 5)} & set(JANSEN.damped) and (4, 5) in JANSEN.damped
    more = numbers["four"] + numbers["five"] - numbers["listed"]
    assert numbers["both"] == pytest.approx(more, rel=1e-12)
