"""``jansen-env verify`` tells whether this machine computes the published walks."""

import pytest

from jansen_env.__main__ import main
from jansen_env.cli import verify
from jansen_env.scoring.walk_hashes import published_hashes


def test_equal_walks_are_counted(capsys):
    main(["verify", "--walk", "crank", "--walk", "built"])
    printed = capsys.readouterr().out
    assert printed.endswith("2 of 2 walks equal bit for bit\n")
    assert printed.count(published_hashes()["crank"][0]) == 2  # found and published


def test_a_difference_is_shown_and_is_the_exit_status(monkeypatch, capsys):
    wrong = {**published_hashes(), "crank": ["0" * 16, published_hashes()["crank"][1]]}
    monkeypatch.setattr(verify, "published_hashes", lambda: wrong)
    with pytest.raises(SystemExit) as ended:
        main(["verify", "--walk", "crank"])
    printed = capsys.readouterr().out
    assert ended.value.code == 1
    assert printed.count("DIFFERS") == 1 and "0 of 1 walks equal" in printed


def test_an_unknown_walk_is_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["verify", "--walk", "bilt"])
    assert ended.value.code == 2 and "did you mean 'built'" in capsys.readouterr().err
