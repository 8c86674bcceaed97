"""The benchmark protocol: test seeds that nothing else uses, and episodes of every kind."""

from collections import Counter

import numpy as np
import pytest

from agents import tune
from agents.design import measures
from agents.training import callbacks
from agents.training.config import shipped_configs
from jansen_env.files.plain_yaml import read_yaml
from jansen_env.policies import pretrained
from jansen_env.sb3.run_config import RunConfig, make_config
from jansen_env.scoring import evaluation, rollout
from jansen_env.scoring.protocol import (
    COLUMNS,
    LEAST_SEED,
    TRACKS,
    Part,
    Track,
    check_training_seed,
    run_track,
    tracks_of_seeds,
)
from jansen_env.tasks.walking.walker_benchmark import BASELINES

SMALL = Track("flat", "JansenWalkerBuilt-v0", "return", (Part("flat", commands=(0.2, 0.3)),))


def test_test_seeds_are_all_different_and_have_32_bits():
    count = sum(len(track.episodes.seed) for track in TRACKS.values())
    seeds = tracks_of_seeds()
    assert len(seeds) == count and min(seeds) >= LEAST_SEED and max(seeds) < 2**32


def test_other_seeds_of_the_project_are_smaller():
    """Training, tuning, selection of models, design, and `jansen-env evaluate`."""
    configs = [read_yaml(path) for path in shipped_configs()]
    training = [config.get("seed", 0) + config.get("n_envs", 16) for config in configs]
    first = (
        tune.FIRST_SEED,
        callbacks.SELECTION_SEED,
        measures.SEED,
        evaluation.FIRST_SEED,
        rollout.DRAWN_SEED,
    )
    assert max(*training, *first) + 10**6 < LEAST_SEED


@pytest.mark.parametrize("before", [0, 15])
def test_training_refuses_a_test_seed(before):
    seed = int(TRACKS["terrain"].episodes.seed[7]) - before
    with pytest.raises(ValueError, match=f"seed must not lead to a test seed .* got {seed}:"):
        RunConfig(seed=seed, n_envs=16)
    with pytest.raises(ValueError, match="a test seed of the track 'terrain'"):
        make_config({"seed": seed})


def test_seeds_beside_a_test_seed_are_free():
    seed = int(TRACKS["terrain"].episodes.seed[7])
    check_training_seed(seed - 16, 16)
    check_training_seed(seed + 1, 16)
    check_training_seed(0, 10_000)


@pytest.mark.parametrize("name", ["terrain", "robust"])
def test_each_level_has_every_kind_and_command(name):
    track = TRACKS[name]
    part, command, level, *_ = track.episodes
    cells = Counter(zip(part.tolist(), command.tolist(), level.tolist(), strict=True))
    assert len(cells) == 7 * 5 * 10 and {*cells.values()} == {3}
    assert all(len(episodes) == 105 for episodes in track.groups.values())


@pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)
def test_parts_have_the_same_weight(track):
    episodes = track.episodes
    weights = np.bincount(episodes.part, episodes.weight)
    np.testing.assert_allclose(weights, 1.0 / len(track.parts))


def test_the_onboard_track_is_that_of_the_packaged_policy():
    track = TRACKS["onboard"]
    assert dict(track.env_kwargs) == pretrained.load(track.env_id, track.pretrained).env_kwargs


def test_scores_are_those_of_evaluate():
    """The columns of a track are the metrics of the walkers' benchmark."""
    track = SMALL
    with_seeds = track.episodes
    env = track.make_env()
    policy = BASELINES["pid"](env.unwrapped)
    columns = run_track(policy, track)
    assert {*columns} == {*COLUMNS} and all(len(values) == 2 for values in columns.values())
    run = rollout.run_episodes(policy, track.env_id, {}, with_seeds.command, with_seeds.seed)
    np.testing.assert_array_equal(columns["return"], run["returns"])
    np.testing.assert_array_equal(columns["slip"], run["slip"])
    np.testing.assert_array_equal(columns["distance"], run["distance"])
