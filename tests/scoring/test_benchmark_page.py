"""The page of the benchmark and the published results agree, and follow from the files."""

import json
from pathlib import Path

import pytest

from jansen_env.cli.benchmark import markdown, tables
from jansen_env.cli.named_policies import policy_sha256
from jansen_env.scoring.comparison import reference_values, score_rows
from jansen_env.scoring.protocol import REFERENCE, TRACKS, plant_hashes, scales
from jansen_env.scoring.result_files import read_result

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "results").glob("*.json"))
PAGE = ROOT / "docs" / "benchmark.md"
ADVICE = "replace the table by what this prints: jansen-env benchmark results/*.json"


@pytest.fixture(scope="module")
def results():
    """Every published result."""
    return [read_result(file) for file in FILES]


def test_the_table_of_scores_is_that_of_the_files(results):
    assert markdown(score_rows(results)) in PAGE.read_text(encoding="utf-8"), ADVICE


def test_the_tables_of_metrics_are_those_of_the_files(results):
    text = (ROOT / "results" / "README.md").read_text(encoding="utf-8")
    assert tables(results, all_metrics=True) in text, f"{ADVICE} --all"


@pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)
def test_the_page_has_the_seeds_and_the_scale_of_each_track(track):
    """These are frozen: another seed, or another scale, is another protocol."""
    scale = scales()[track.name]
    row = f"| `{track.name}` | {len(track.episodes.seed)} | `{track.seeds_sha256}` | "
    row += f"{scale.zero:.4g} | {scale.one:.4g} |"
    assert row in PAGE.read_text(encoding="utf-8")


def test_the_scale_follows_from_the_results(results):
    assert json.loads(REFERENCE.read_text(encoding="utf-8")) == reference_values(results)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_files_are_small_and_of_the_published_physics(file):
    result = read_result(file)
    assert file.stat().st_size < 300_000
    assert result.plants["projection"] == plant_hashes()["projection"]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_pretrained_policies_are_those_of_the_files(file):
    """Otherwise their rows could not be reproduced."""
    result = read_result(file)
    for name, track in result.tracks.items():
        if track.policy.partition(":")[0] == "pretrained":
            assert policy_sha256(track.policy, TRACKS[name].env_id) == track.sha256
