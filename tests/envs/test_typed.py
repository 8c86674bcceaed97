"""Arguments that type checkers know are those that environments take; mypy finds wrong calls."""

from typing import get_type_hints

import pytest

from jansen_env.envs.arguments import OF_BATCHES
from jansen_env.registration import IDS
from jansen_env.scoring.benchmarks import single_env, vector_env


def typed_arguments(kind):
    """Names and types that type checkers know of an environment's constructor."""
    hints = get_type_hints(kind.__init__)
    (unpacked,) = hints.pop("arguments").__args__
    del hints["return"]
    return {**hints, **get_type_hints(unpacked)}


@pytest.mark.parametrize("env_id", IDS)
def test_type_checkers_know_the_arguments_of_the_settings(env_id):
    single = single_env(env_id)
    many = vector_env(env_id)
    known = {*single.defaults()}
    assert {*typed_arguments(single)} == known and {*single.PRESET} <= known
    assert {*typed_arguments(many)} == {*known, *OF_BATCHES} and many.SINGLE is single
