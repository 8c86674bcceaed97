"""List the pages' numbers with their commands and commits: ``python -m benchmarks.numbers``.

A passage's command is the last one that its section names; of a section without, its page's first.
The commit is the newest that changed a line of the passage.
"""

from __future__ import annotations

import argparse
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tabulate import tabulate

ROOT = Path(__file__).parents[1]
PAGES = "README.md", "docs"
HISTORY = ("docs/changelog.md",)
COMMAND = re.compile(r"(?:python -m (?!pip)|python train|jansen-env|pytest)\b[^`\n]*")
NUMBER = re.compile(r"(?<![\w.`-])[-+]?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?(?: %)?(?![\w`])")
SHOWN = 6  # numbers of a passage


class Passage(NamedTuple):
    """Lines of a page between empty ones, and the command that makes their numbers, or ""."""

    page: str
    line: int
    text: str
    command: str


def passages(page: Path) -> Iterator[Passage]:
    """Give the passages of a page that have numbers; code does not count."""
    text = re.sub(r"\\\n *", "", page.read_text(encoding="utf-8"))
    first = found.group() if (found := COMMAND.search(text)) else ""
    command, line, code = first, 1, False
    for block in re.split(r"(\n\s*\n)", text):
        if block.startswith("#"):
            command = first
        if named := COMMAND.findall(block):
            command = named[-1].strip()
        fences = block.count("```")
        plain = re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)|^#.*$", "", block, flags=re.S | re.M)
        if not code and NUMBER.search(plain):
            yield Passage(str(page.relative_to(ROOT)), line, plain, command)
        code ^= fences % 2 == 1
        line += block.count("\n")


def commit_of(passage: Passage) -> str:
    """Return the newest commit of a passage's lines, abbreviated."""
    last = passage.line + max(passage.text.count("\n"), 0)
    log = ["git", "log", "-1", "--format=%h", "-s", f"-L{passage.line},{last}:{passage.page}"]
    done = subprocess.run(log, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "not committed"


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.numbers", description=__doc__)
    parser.add_argument("--without", action="store_true", help="those without a command alone")
    found = parser.parse_args(arguments)
    pages = [path for name in PAGES for path in ([ROOT / name] if name.endswith(".md") else
             sorted((ROOT / name).rglob("*.md")))]  # fmt: skip
    every = [one for page in pages for one in passages(page) if one.page not in HISTORY]
    rows = []
    for one in every:
        if found.without and one.command:
            continue
        numbers = NUMBER.findall(one.text)
        more = f" and {len(numbers) - SHOWN} more" if len(numbers) > SHOWN else ""
        shown = "; ".join(numbers[:SHOWN]) + more
        rows.append([f"{one.page}:{one.line}", shown, one.command or "none", commit_of(one)])
    print(tabulate(rows, ["page", "numbers", "command", "commit"], "github", disable_numparse=True))


if __name__ == "__main__":
    main()
