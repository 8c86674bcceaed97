"""YAML read as plain data by PyYAML's safe loader, without aliases or repeated keys, bounded; and
rules for its values."""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

import yaml

from jansen_env.checks import LONGEST, invalid
from jansen_env.files import read_bounded

MAX_BYTES = 65_536  # of a file, some 30 times a training configuration
TINY, HUGE = 1e-30, 1e30
IN_WORDS = {bool: "true or false", NoneType: "null", dict: "a mapping, such as {}",
            list: "a list", str: "text"}  # fmt: skip


class _Loader(yaml.SafeLoader):
    def compose_node(self, parent: Any, index: int) -> Any:
        if self.check_event(yaml.AliasEvent):  # a few of them may make gigabytes
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="aliases are not allowed", problem_mark=mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, object]:
        keys = [key.value for key, _ in node.value]
        for i, (key, _) in enumerate(node.value):
            if not isinstance(key.value, str) or key.value in keys[:i]:
                problem = f"key {key.value!r} is no text or stands twice"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
        return super().construct_mapping(node, deep)


# YAML 1.1 takes 1e-4 and 1.5e3 for text.
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def parse_yaml(text: str, name: str) -> Any:
    """Parse text as plain data; a ValueError begins with the ``name`` of its source, and the line
    where there is one."""
    try:
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        line = "" if error.problem_mark is None else f", line {error.problem_mark.line + 1}"
        raise ValueError(f"{name}{line}: {error.problem or error.context}") from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ValueError(f"{name} is no YAML: {' '.join(str(error).split())}") from error


def read_yaml(path: str | Path) -> Any:
    """Parse a file; a ValueError names it where it is missing, too large, no UTF-8 or no YAML."""
    try:
        return parse_yaml(read_bounded(path, MAX_BYTES).decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no UTF-8 text: {error.reason} at {error.start}") from error


class Rule(NamedTuple):
    """Allowed values: of some types, numbers within limits, words, or a prefix and a number."""

    types: tuple[type, ...] = ()
    low: float = -HUGE
    high: float = HUGE
    words: Sequence[str] = ()
    prefix: str = ""

    def check(self, name: str, value: object) -> None:
        """Raise a ValueError that says what is allowed unless ``value`` is."""
        number: object = value
        low = self.low
        if self.prefix and isinstance(value, str) and value.startswith(self.prefix):
            with suppress(ValueError):
                number, low = float(value.removeprefix(self.prefix)), max(low, TINY)
        if isinstance(number, (int, float)) and not isinstance(number, bool):
            known = float in self.types or type(number) in self.types
            allowed = known and low <= number <= self.high
        else:
            allowed = type(value) in self.types or value in self.words
        if not allowed:
            raise invalid(name, value, self)

    def __str__(self) -> str:
        parts = [text for kind, text in IN_WORDS.items() if kind in self.types]
        if {int, float} & {*self.types}:
            whole = "" if float in self.types else "whole "
            parts.insert(0, f"a {whole}number from {self.low} to {self.high}")
        parts += [f"'{self.prefix}NUMBER'"] * (self.prefix != "")
        parts += [f"one of {sorted(self.words)}"] * (self.words != ())
        return ", or ".join(parts)


def check_keys(part: str, values: dict[str, object], table: dict[str, Rule]) -> None:
    """Check each value against the rule for its key; raise ValueError with the values allowed."""
    for name, value in values.items():
        if name not in table:
            where = f" of {part}" if part else ""
            near = get_close_matches(name[:LONGEST], table, 1)
            allowed = f"must be in {sorted(table)}"
            if near:
                allowed = f"must be one of {len(table)} others; did you mean {near[0]!r}?"
            raise ValueError(f"{name!r} is no key{where}, {allowed}")
        table[name].check(f"{part}.{name}" if part else name, value)
