"""Messages about names that are not known: what is allowed, and which may have been meant."""

import gymnasium as gym
import pytest

from jansen_env.checks import one_of
from jansen_env.policies import pretrained
from jansen_env.scoring.benchmarks import find_benchmark


@pytest.mark.parametrize(
    "make, meant",
    [
        (lambda: gym.make("JansenWalker-v0", frction=0.5), "friction"),
        (lambda: gym.make_vec("JansenWalker-v0", 2, frction=0.5), "friction"),
        (lambda: gym.make("JansenWalker-v0", robot="papr"), "paper"),
        (lambda: gym.make("JansenWalker-v0", terrain="stiars:rise=0.01"), "stairs"),
        (lambda: gym.make("JansenWalker-v0", plant="rigid-body"), "rigid_body"),
        (lambda: gym.make("JansenWalker-v0", randomize={"frction": (0.4, 1.0)}), "friction"),
        (lambda: gym.make("JansenWalker-v0", slip_wieght=1.0), "slip_weight"),
        (lambda: gym.make("JansenWalker-v0").reset(options={"titl": 0.1}), "tilt"),
        (lambda: find_benchmark("JansenWalker-v1"), "JansenWalker-v0"),
        (lambda: pretrained.load("JansenWalkerBuilt-v0", "robst"), "robust"),
    ],
)
def test_misspelt_names_are_understood(make, meant):
    with pytest.raises((TypeError, ValueError), match=rf"; did you mean '{meant}'\?"):
        make()


@pytest.mark.parametrize("value", ["", "x" * 10**6, "lava", None, 3, b"paper", ["paper"]])
def test_what_is_like_no_name_gets_the_names_alone(value):
    with pytest.raises(ValueError, match=r"robot must be one of \['built', 'paper'\]"):
        one_of("robot", value, ("built", "paper"))


@pytest.mark.parametrize("level, told", [(3, "3"), ((1, 4), r"\(1, 4\)")])
def test_a_terrain_level_is_told_as_it_was_given(level, told):
    with pytest.raises(ValueError, match=f"^terrain_level must be 0 for terrain .*, got {told}"):
        gym.make("JansenWalker-v0", terrain_level=level)
