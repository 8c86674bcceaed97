"""The command line of experiments, and the tables that they put into pages of the documentation."""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jansen_env.files import write_json, write_text

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
QUICK = ROOT / "logs" / "quick"  # folder of the output of tiny experiments


def options(description: str | None, **counts: int) -> argparse.Namespace:
    """Parse the command line of an experiment.

    Args:
        description: Docstring of the experiment.
        **counts: Further options that take a whole number, by name, with their defaults.

    Returns:
        ``quick``, ``out`` and the value of each count.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--quick", action="store_true", help="run a tiny version of the experiment, to test it"
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="folder of the pages and their data; default: docs, or logs/quick with --quick",
    )
    for name, default in counts.items():
        parser.add_argument(
            f"--{name}", type=int, default=default, help=f"whole number; default: {default}"
        )
    args = parser.parse_args()
    # A tiny experiment must not replace published data.
    args.out = args.out or (QUICK if args.quick else DOCS)
    return args


def table(head: Sequence[str], rows: Iterable[Sequence[str]], texts: int = 1) -> str:
    """Return a Markdown table.

    Args:
        head: Headings of the columns.
        rows: Cells of each row.
        texts: Number of columns on the left that contain text; the others contain numbers.
    """
    rule = ["---"] * texts + ["---:"] * (len(head) - texts)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *rows))


def rounded(value: float | None, decimals: int) -> str:
    """Return a cell with a number.

    Args:
        value: The number. Slip and cost are None for a robot that did not walk.
        decimals: Number of decimals.
    """
    return "-" if value is None else f"{value:.{decimals}f}"


def mean_and_range(values: list[float | None], decimals: int) -> str:
    """Return a cell with a mean, the lowest and the highest value.

    Args:
        values: Value of each seed. Slip and cost are None for a robot that did not walk.
        decimals: Number of decimals.
    """
    known = [value for value in values if value is not None]
    if not known:
        return "-"
    return "{:.{d}f} ({:.{d}f} to {:.{d}f})".format(
        np.mean(known), min(known), max(known), d=decimals
    )


def publish(folder: Path, data: str, results: Any, tables: Mapping[str, Sequence[str]]) -> None:
    """Write the data of an experiment, print its tables, and put them into the pages.

    Each table replaces the table of the page that has the same headings.

    Args:
        folder: Folder of the pages and of their data.
        data: Path of the data file in the folder.
        results: Content of the data file.
        tables: Tables of each page, in their order on the page.
    """
    (folder / data).parent.mkdir(parents=True, exist_ok=True)
    write_json(folder / data, results)
    for page, new in tables.items():
        print("\n\n".join([f"{page}:", *new, ""]))
        path = folder / page
        if path.exists():
            text = path.read_text(encoding="utf-8")
            write_text(path, with_tables(text, new))


def with_tables(text: str, tables: Sequence[str]) -> str:
    """Return the text of a page in which tables replace those with the same headings.

    Args:
        text: Text of the page.
        tables: The new tables, in their order on the page.

    Raises:
        ValueError: If the page contains no table with these headings.
    """
    before: list[str] = []
    rest = text.split("\n")
    for new in tables:
        heading = new.partition("\n")[0]
        if heading not in rest:
            raise ValueError(f"the page must have a table with the headings {heading}, got none")
        start = rest.index(heading)
        length = next(
            (k for k, line in enumerate(rest[start:]) if not line.startswith("|")),
            len(rest) - start,
        )
        before += [*rest[:start], new]
        rest = rest[start + length :]
    return "\n".join([*before, *rest])
