"""Functions that read YAML as plain data, and rules for the values.

The safe loader of PyYAML reads the files. Aliases and repeated keys are rejected, and the size of a
file is limited.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

import yaml
from typing_extensions import override

from jansen_env.checks import HINT, LONGEST, invalid
from jansen_env.files import read_bounded

MAX_BYTES = 65_536  # largest size of a file, about 30 times that of a training configuration
TINY, HUGE = 1e-30, 1e30
IN_WORDS = {
    bool: "true or false",
    NoneType: "null",
    dict: "a mapping, such as {}",
    list: "a list",
    str: "text",
}


class _Loader(yaml.SafeLoader):
    """Safe loader that rejects aliases, and keys that are repeated or not text."""

    @override
    def compose_node(self, parent: Any, index: int) -> Any:
        if self.check_event(yaml.AliasEvent):  # a few aliases can expand to gigabytes
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="aliases are not allowed", problem_mark=mark)
        return super().compose_node(parent, index)

    @override
    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, object]:
        keys = [key.value for key, _ in node.value]
        for i, (key, _) in enumerate(node.value):
            if not isinstance(key.value, str) or key.value in keys[:i]:
                problem = f"a key must be a text that occurs only once, got {key.value!r}"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
        return super().construct_mapping(node, deep)


# YAML 1.1 treats 1e-4 and 1.5e3 as text.
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def parse_yaml(text: str, name: str) -> Any:
    """Return the data in a YAML text.

    Args:
        text: The text.
        name: Name of the source of the text, for error messages.

    Raises:
        ValueError: If the text is not valid. The message begins with the name of the source, and
            with the line if it is known.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        line = "" if error.problem_mark is None else f", line {error.problem_mark.line + 1}"
        raise ValueError(f"{name}{line}: {error.problem or error.context}") from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise ValueError(f"{name} is not valid YAML: {' '.join(str(error).split())}") from error


def read_yaml(path: str | Path) -> Any:
    """Return the data in a YAML file.

    Raises:
        ValueError: If the file is missing, too large, or not valid UTF-8 or YAML. The message names
            the file.
    """
    try:
        return parse_yaml(read_bounded(path, MAX_BYTES).decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path} must be encoded as UTF-8, got {error.reason} at byte {error.start}"
        ) from error


class Rule(NamedTuple):
    """Rule for a value: allowed types, limits of numbers, words, and a prefix with a number.

    Attributes:
        types: Allowed types.
        low: Smallest allowed number.
        high: Largest allowed number.
        words: Allowed texts.
        prefix: Text that may precede a number in a text. It is empty if there is none.
    """

    types: tuple[type, ...] = ()
    low: float = -HUGE
    high: float = HUGE
    words: Sequence[str] = ()
    prefix: str = ""

    def check(self, name: str, value: object) -> None:
        """Check that a value follows the rule.

        Args:
            name: Name of the value, for the error message.
            value: The value.

        Raises:
            ValueError: If the value is not allowed. The message describes the allowed values.
        """
        number: object = value
        low = self.low
        if self.prefix and isinstance(value, str) and value.startswith(self.prefix):
            with suppress(ValueError):
                number = float(value.removeprefix(self.prefix))
                low = max(low, TINY)
        if isinstance(number, (int, float)) and not isinstance(number, bool):
            known = float in self.types or type(number) in self.types
            allowed = known and low <= number <= self.high
        else:
            allowed = type(value) in self.types or value in self.words
        if not allowed:
            raise invalid(name, value, self)

    @override
    def __str__(self) -> str:
        parts = [text for kind, text in IN_WORDS.items() if kind in self.types]
        if {int, float} & {*self.types}:
            whole = "" if float in self.types else "whole "
            parts.insert(0, f"a {whole}number from {self.low} to {self.high}")
        parts += [f"'{self.prefix}NUMBER'"] * (self.prefix != "")
        parts += [f"one of {sorted(self.words)}"] * (self.words != ())
        return ", or ".join(parts)


def check_keys(part: str, values: dict[str, object], table: dict[str, Rule]) -> None:
    """Check that all keys are known, and that each value follows the rule for its key.

    Args:
        part: Name of the part of the file that contains the values, for error messages.
        values: The values by key.
        table: The rules by key.

    Raises:
        ValueError: If a key is unknown, or a value is not allowed. The message describes what is
            allowed.
    """
    for name, value in values.items():
        if name not in table:
            near = get_close_matches(name[:LONGEST], table, 1)
            allowed = f"one of {sorted(table)}"
            if near:
                allowed = f"one of {len(table)} others{HINT}{near[0]!r}?"
            raise invalid(f"a key of {part}" if part else "a key", name, allowed)
        table[name].check(f"{part}.{name}" if part else name, value)
