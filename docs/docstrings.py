"""Sphinx extension: turns docstrings, which are written to be read as they are, into its markup."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

from jansen_env.registration import IDS
from jansen_env.scoring.benchmarks import single_env


def adapt_docstring(
    app: Sphinx, what: str, name: str, member: Any, options: Any, lines: list[str]
) -> None:
    """Mark blocks of equations, which are indented after a blank line, and escape ``|x|``."""
    pages = {single_env(env_id): env_id for env_id in IDS}
    if what == "class" and member in pages:  # its docstring is Markdown, and a page
        lines[:] = [lines[0], "", f":doc:`Its documentation </environments/{pages[member]}>`."]
        return
    # In front of an attribute's text an empty comment, or napoleon reads "type: text" from it.
    text = ["..", ""] if what in ("attribute", "data", "property") else []
    block, before = 0, 0  # indentation of the block of equations, 0 outside; and of the line before
    for i, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if line and indent < block:
            block = 0
        if line and not block and i and not lines[i - 1] and indent >= before + 4:
            block = indent
            text += [" " * before + "::", ""]
        text.append(line if block or "``" in line else line.replace("|", r"\|"))
        before = indent if line else before
    lines[:] = text


def join_names(
    app: Sphinx, what: str, name: str, member: Any, options: Any, lines: list[str]
) -> None:
    """Several names described at once, ``x, y: ...``: Sphinx would take the first for a type."""
    for i, line in enumerate(lines):
        if found := re.match(r":(param|ivar) ([^:]* [^:]*):", line):
            lines[i] = f":{found[1]} {found[2].replace(' ', '')}:{line[found.end() :]}"


def skip_member(app: Sphinx, what: str, name: str, member: Any, skip: bool, options: Any) -> bool:
    """Leave out what a NamedTuple says of its fields: "Alias for field number 0"."""
    return skip or str(member.__doc__).startswith("Alias for field")


def setup(app: Sphinx) -> None:
    """Connect the functions of this file to the events of Sphinx."""
    app.connect("autodoc-process-docstring", adapt_docstring, priority=400)
    app.connect("autodoc-process-docstring", join_names, priority=600)  # napoleon's is 500
    app.connect("autodoc-skip-member", skip_member)
