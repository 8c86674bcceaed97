"""What is fetched from elsewhere: by commit, from one index, without install scripts."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CONFIGS = [*ROOT.glob(".github/workflows/*.yml"), ROOT / ".pre-commit-config.yaml"]
PINNED = re.compile(r"[0-9a-f]{40} +# .*v\d+\.\d+\.\d+")


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_actions_and_hooks_are_pinned_by_commit(path):
    pins = re.findall(r"(?:uses: .*@|rev: *)(.*)", path.read_text(encoding="utf-8"))
    assert pins
    for pin in pins:
        assert PINNED.fullmatch(pin), pin


def test_no_second_index_for_all_names():
    """Whoever registers one of our names there first would have his package installed."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("*.t*ml"), *CONFIGS]
    for path in (*pages, ROOT / ".ci" / "run", ROOT / "Makefile"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"extra.index.url", text, re.IGNORECASE), path
