"""YAML read strictly, as plain data: no tags, no aliases, no key twice, of bounded size."""

from __future__ import annotations

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from jansen_env.files import open_regular

MAX_BYTES = 65_536  # of a file, some 30 times a training configuration


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with YAML 1.2's scalars, without anchors, aliases, tags, merge keys."""

    yaml_implicit_resolvers = {}  # noqa: RUF012  (YAML 1.1's: 5e-1 would be text, yes a bool)

    def compose_node(self, parent: Any, index: int) -> Any:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if event.anchor is not None or getattr(event, "tag", None) is not None:
            raise yaml.MarkedYAMLError(
                problem="anchors, aliases and tags are not allowed", problem_mark=event.start_mark
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        keys = [self.construct_object(key) for key, _ in node.value]
        for i, key in enumerate(keys):
            if not isinstance(key, str) or key in keys[:i]:
                what = "stands twice" if isinstance(key, str) else "must be text"
                mark = node.value[i][0].start_mark
                raise yaml.MarkedYAMLError(problem=f"key {key!r} {what}", problem_mark=mark)
        return super().construct_mapping(node, deep)


SCALARS = {
    "null": r"~|null|Null|NULL|",
    "bool": r"true|True|TRUE|false|False|FALSE",
    "int": r"[-+]?(?=[0-9_]{1,18}$)[0-9]+(_[0-9]+)*",  # below 2^63, longer ones are text
    "float": r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?",
}
for _tag, _pattern in SCALARS.items():
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"({_pattern})$"), None)
_Loader.add_constructor("tag:yaml.org,2002:int", lambda _, node: int(node.value))  # 010 is 10


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
        return yaml.load(text, _Loader)
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
        with open_regular(path) as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise ValueError(f"{path} is larger than {MAX_BYTES} bytes, the most allowed")
        return parse_yaml(data.decode("utf-8-sig"), str(path))
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no UTF-8 text: {error.reason} at {error.start}") from error
