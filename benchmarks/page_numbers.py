"""List the pages' numbers with their commands and commits: ``python -m benchmarks.page_numbers``.

A line's command is the last one before it that its section names, or else the first one after it;
its commit is the one that changed it last.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

from tabulate import tabulate

ROOT = Path(__file__).parents[1]
COMMAND = re.compile(r"(?:python -m (?!pip)|python train|jansen-env (?=[a-z])|pytest )[^`\n]*")
NUMBER = re.compile(r"(?<![\w.`-])[-+]?\d+(?:,\d{3})*(?:\.\d+)?(?:e-?\d+)?(?: %)?(?![\w`]|\.\d)")
NOT_TEXT = re.compile(r"`[^`]*`|\]\([^)]*\)|^\s*!\[.*|\w+-v\d")  # code, links, pictures, ids


def rows(page: Path) -> Iterator[tuple[str, str, str, str]]:
    """Give place, numbers, command and commit of each line that has numbers; code has none."""
    blame = ["git", "blame", "-s", "--abbrev=7", str(page)]
    lines = subprocess.run(blame, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    found = [line.partition(")") for line in lines.splitlines()]
    command, code = "", False
    for i, (commit, _, text) in enumerate(found):
        if text.startswith(" #") and not code:
            section = [later for *_, later in found[i + 1 :]]
            end = next((k for k, later in enumerate(section) if later.startswith(" ## ")), None)
            first = COMMAND.search("\n".join(section[:end]))
            command = first.group() if first else "none"
        command = [command, *COMMAND.findall(text)][-1].strip(" \\")
        code ^= text.startswith(" ```")
        numbers = NUMBER.findall(NOT_TEXT.sub("", text))
        if numbers and not code and not text.startswith(" #"):
            place = f"{page.relative_to(ROOT)}:{i + 1}"
            yield place, "; ".join(numbers), command, commit.split()[0]


if __name__ == "__main__":
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    every = [row for page in pages if page.name != "changelog.md" for row in rows(page)]
    print(
        tabulate(every, ["page", "numbers", "command", "commit"], "github", disable_numparse=True)
    )
