"""YAML read strictly, as plain data: no tags, no aliases, no key twice, of bounded size."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

LARGEST = 65_536  # bytes of a file, some 30 times a training configuration
DIGITS = 18  # of whole numbers, below 2^63
INTEGER = re.compile(r"[-+]?[0-9]+(_[0-9]+)*")
FLOAT = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}


class _Loader(yaml.BaseLoader):
    """Nodes without anchors, aliases and tags; aliases of aliases would grow without bound."""

    def compose_node(self, parent: Any, index: int) -> Any:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if event.anchor is not None or getattr(event, "tag", None) is not None:
            raise yaml.composer.ComposerError(
                None, None, "anchors, aliases and tags are not allowed", event.start_mark
            )
        return super().compose_node(parent, index)


def parse_yaml(text: str, name: str) -> Any:
    """None, bool, int, float, str, and lists and dictionaries (keys are str) of these.

    Numbers are YAML 1.2's: ``2e2`` and ``5e-1`` are numbers (to YAML 1.1 they are text), ``010`` is
    10, and only ``true`` and ``false`` are bool, not ``yes`` or ``on``.

    Args:
        text: YAML. name: of its source, for messages.

    Raises:
        ValueError: no YAML, an anchor, alias, tag or key that stands twice; names the line.
    """
    try:
        node = _Loader(text).get_single_node()
        return None if node is None else _plain(node)
    except yaml.MarkedYAMLError as error:
        line = "" if error.problem_mark is None else f", line {error.problem_mark.line + 1}"
        raise ValueError(f"{name}{line}: {error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise ValueError(f"{name} is no YAML: {' '.join(str(error).split())}") from error
    except RecursionError as error:
        raise ValueError(f"{name} is nested too deeply") from error


def read_yaml(path: str | Path) -> Any:
    """:func:`parse_yaml` of a file.

    Raises:
        ValueError: no such file, too large a one, no UTF-8, or no YAML as read here.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    if len(data) > LARGEST:
        raise ValueError(f"{path} is larger than {LARGEST} bytes, the most allowed")
    try:
        return parse_yaml(data.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no UTF-8 text: {error.reason} at {error.start}") from error


def _plain(node: Any) -> Any:
    if isinstance(node, yaml.ScalarNode):
        return _scalar(node) if node.style is None else node.value
    if isinstance(node, yaml.SequenceNode):
        return [_plain(entry) for entry in node.value]
    mapping: dict[str, Any] = {}
    for key, value in node.value:
        name = _plain(key)
        if not isinstance(name, str) or name in mapping:
            what = "stands twice" if isinstance(name, str) else "must be text"
            raise yaml.MarkedYAMLError(problem=f"key {name!r} {what}", problem_mark=key.start_mark)
        mapping[name] = _plain(value)
    return mapping


def _scalar(node: yaml.ScalarNode) -> Any:
    """What a scalar without quotes stands for."""
    text: str = node.value
    if text in WORDS:
        return WORDS[text]
    if INTEGER.fullmatch(text):
        if len(text) > DIGITS:
            problem = f"a whole number has {len(text)} digits, must have at most {DIGITS}"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        return int(text)
    return float(text) if FLOAT.fullmatch(text) else text
