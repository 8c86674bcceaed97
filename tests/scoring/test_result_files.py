"""Result files are plain JSON, and nothing else than a result of the protocol is accepted."""

import json
import math

import numpy as np
import pytest

from jansen_env.scoring.protocol import COLUMNS, TRACKS
from jansen_env.scoring.result_files import (
    MAX_BYTES,
    Result,
    TrackResult,
    read_result,
    rounded,
    write_result,
)

TRACK = TRACKS["flat"]
COUNT = len(TRACK.episodes.seed)


def some_columns(rng):
    """Return raw scores of the flat track."""
    columns = {name: rng.uniform(0.0, 300.0, COUNT) for name in COLUMNS}
    return {**columns, "success": np.ones(COUNT), "falls": np.zeros(COUNT)}


@pytest.fixture
def result(rng):
    """A result on one track."""
    track = TrackResult("pid", None, rounded(some_columns(rng)))
    package = {"jansen_env": "0.1.0", "python": "3.11.7", "numpy": "2.4.6"}
    plants = {"projection": "0123456789abcdef", "rigid_body": "0" * 16}
    return Result("pid", package, "Some CPU (x86_64)", plants, {"flat": track})


def test_a_result_is_read_as_it_was_written(result, tmp_path):
    read = read_result(write_result(tmp_path / "pid.json", result))
    columns = read.tracks["flat"].columns
    for name, values in result.tracks["flat"].columns.items():
        np.testing.assert_array_equal(columns[name], values)
    assert read.name == "pid" and read.plants == result.plants


def test_scores_have_four_digits(rng):
    columns = some_columns(rng)
    for name, values in rounded(columns).items():
        np.testing.assert_allclose(values, columns[name], rtol=5.01e-4)
        assert all(float(f"{value:.4g}") == value for value in values)


def test_a_score_that_is_not_finite_is_refused(rng):
    columns = some_columns(rng)
    columns["load"][3] = np.nan
    with pytest.raises(ValueError, match="load of episode 3 must be finite"):
        rounded(columns)


def change(*path, to):
    """Return a function that replaces an entry of a JSON object."""

    def changed(content):
        part = content
        for key in path[:-1]:
            part = part[key]
        part[path[-1]] = to
        return content

    return changed


FLAT = ("tracks", "flat")
REFUSED = {
    "another format": (change("format", to="jansen_env result 2"), "format must be"),
    "another protocol": (change("protocol", to=2), "protocol must be 1, got 2"),
    "true": (change("protocol", to=True), "protocol must be 1, got True"),
    "an unknown entry": (change("more", to=1), "entries of the file must be exactly"),
    "an unknown track": (change("tracks", "goal", to={}), "tracks must be some of"),
    "no track": (change("tracks", to={}), "tracks must be some of"),
    "a table in the name": (change("name", to="a | b"), "name must be text that matches"),
    "markup in the name": (change("name", to="<b>x</b>"), "name must be text that matches"),
    "two lines": (change("name", to="a\nb"), "name must be text that matches"),
    "a long name": (change("name", to="a" * 121), "name must be text that matches"),
    "a list for a name": (change("name", to=["a"]), "name must be text that matches"),
    "other seeds": (change(*FLAT, "seeds", to="0" * 64), "flat.seeds must be"),
    "a short digest": (change(*FLAT, "sha256", to="abc"), "flat.sha256 must be text"),
    "fewer episodes": (change(*FLAT, "episodes", "return", to=[1.0]), "must have 180 numbers"),
    "a missing column": (change(*FLAT, "episodes", to={}), "entries of flat.episodes must be"),
    "half a fall": (change(*FLAT, "episodes", "falls", 0, to=0.5), "must be 0 or 1, got 0.5"),
    "a bool": (change(*FLAT, "episodes", "success", 0, to=True), "must be 0 or 1, got True"),
    "a text": (change(*FLAT, "episodes", "load", 0, to="1"), "numbers from 0 to 1e+09, got '1'"),
    "a negative slip": (change(*FLAT, "episodes", "slip", 0, to=-1), "numbers from 0 to 1e+09"),
    "a huge return": (change(*FLAT, "episodes", "return", 0, to=10**400), "must be numbers from"),
    "infinity": (change(*FLAT, "episodes", "return", 0, to=math.inf), "numbers must be finite"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_other_content_is_refused_by_name(case, result, tmp_path):
    changed, message = REFUSED[case]
    path = write_result(tmp_path / "pid.json", result)
    path.write_text(json.dumps(changed(json.loads(path.read_text()))))
    with pytest.raises(ValueError) as error:
        read_result(path)
    assert str(error.value).startswith(f"{path} is not a result file: ")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "is not a result file"),
        ("{", "is not a result file"),
        ("[]", "the file must be a dict"),
        (" " * (MAX_BYTES + 1), "must have at most"),
        ("\udcff", "is not a result file"),
    ],
    ids=["deep", "cut", "list", "large", "no text"],
)
def test_damaged_files_are_refused(text, message, tmp_path):
    path = tmp_path / "x.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(ValueError, match=message):
        read_result(path)
