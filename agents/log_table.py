"""Read the comments and columns of a log, a CSV file as loggers and spreadsheets write it.

Text may be UTF-8 or UTF-16, cells may be quoted, and commas, semicolons, tabs, bars or spaces may
separate them. Decimals may have a comma. Each error begins with the number of its line.
"""

import codecs
import csv
import io
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Array, Ints
from jansen_env.checks import LONGEST, listed, shown

DELIMITERS = ";\t,| "  # the first of these that the row of heads has separates cells
BLANK = {"", "nan", "na", "n/a", "null", "none", "-"}  # cells without a value, in any case
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
COMMENT = re.compile(r"(\w+)\s*[:=]\s*(.*)", re.ASCII)
UNICODE_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",  # PowerShell's redirections
    codecs.BOM_UTF16_BE: "utf-16-be",
}


class Column(NamedTuple):
    """A column that a log may have.

    Attributes:
        quantity: What it holds; a log has one column of a quantity.
        factor: Its unit in SI.
        most: The largest magnitude in SI.
        optional: Whether cells may be blank.
    """

    quantity: str
    factor: float
    most: float
    optional: bool = False


COLUMNS = {
    "time_s": Column("time", 1.0, 1e10),
    "crank_rad": Column("crank", 1.0, 1e6),
    "crank_deg": Column("crank", math.pi / 180.0, 1e6),
    "torque_Nm": Column("torque", 1.0, 1e4),
    "current_A": Column("current", 1.0, 1e4),
    "pitch_rad": Column("pitch", 1.0, 0.8),
    "pitch_deg": Column("pitch", math.pi / 180.0, 0.8),
    "x_m": Column("x", 1.0, 1e4, optional=True),
}
NEEDED = "time_s", "crank_rad or crank_deg", "torque_Nm or current_A", "pitch_rad or pitch_deg"


class LogTable(NamedTuple):
    """What a log's file says.

    Attributes:
        comments: Line and text of each comment ``name: value``, by name.
        columns: Columns in SI by quantity, shape (n,); NaN where a cell is blank.
        head: The line of the heads.
        lines: The line of each row, shape (n,).
    """

    comments: dict[str, tuple[int, str]]
    columns: dict[str, Array]
    head: int
    lines: Ints


def at_line(line: int, text: str) -> ValueError:
    """Return the error of a line."""
    return ValueError(f"line {line}: {text}")


def decoded(data: bytes) -> str:
    """Decode a file as UTF-16, if it begins with its mark, or as UTF-8.

    Raises:
        ValueError: If it is neither.
    """
    encoding = "utf-8"
    for mark, name in UNICODE_MARKS.items():
        if data.startswith(mark):
            data, encoding = data[len(mark) :], name
            break
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        before = data[: error.start].decode(encoding, errors="replace")
        message = "the text must be UTF-8; save the file as 'CSV UTF-8'"
        raise at_line(len(split_lines(f"{before}.")), message) from None
    if "\0" in text:
        message = "the text must have no null characters; save the file as 'CSV UTF-8'"
        raise at_line(len(split_lines(text.partition("\0")[0] + ".")), message)
    return text.replace("\ufeff", "")


def split_lines(text: str) -> list[str]:
    """Split text at the ends of lines that editors count."""
    return [line.strip() for line in io.StringIO(text, newline=None)]


def split_cells(line: int, text: str, delimiter: str) -> list[str]:
    """Split a line into its cells.

    Raises:
        ValueError: If quotation marks do not match or a cell is far too long.
    """
    try:
        (cells,) = csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True)
    except csv.Error:
        cause = "cells must be short numbers, and quotation marks must be closed"
        raise at_line(line, f"{cause}, got {shown(text)}") from None
    return [cell.strip() for cell in cells]


def read_table(data: bytes, once: Sequence[str] = ()) -> LogTable:
    """Read the bytes of a log.

    Args:
        data: The file's bytes.
        once: Names of comments that a log may have only once; others are free remarks.

    Raises:
        ValueError: If the log cannot be read. Names the line, what is wrong and what is allowed.
    """
    comments: dict[str, tuple[int, str]] = {}
    rows = []
    number = 1
    for number, text in enumerate(split_lines(decoded(data)), start=1):
        if (bare := text.lstrip('" ')).startswith("#"):
            remark = bare.lstrip("# ").rstrip('";,\t| ')
            if match := COMMENT.fullmatch(remark):
                name, value = match.groups()
                if name in comments and name in once:
                    before = comments[name][0]
                    raise at_line(number, f"{name} must be given once, is in line {before}, too")
                comments[name] = number, value
        elif text.strip('";,\t| ') and not re.fullmatch(r'"?sep=.*', text, re.IGNORECASE):
            rows.append((number, text))
    if not rows:
        needed = ", ".join(NEEDED)
        raise at_line(number, f"the file must have a row of heads ({needed}), and ends without")
    (head, text), *rest = rows
    delimiter = next((mark for mark in DELIMITERS if mark in text), ",")
    heads = _heads(head, split_cells(head, text, delimiter))
    table = [
        (number, _numbers(number, cells, heads, delimiter))
        for number, cells in ((line, split_cells(line, text, delimiter)) for line, text in rest)
        if [cell.casefold() for cell in cells[: len(heads)]] != [name.casefold() for name in heads]
    ]
    values = np.array([row for _, row in table]).reshape(len(table), len(heads)).T
    quantities = [COLUMNS[name].quantity for name in heads]
    columns = dict(zip(quantities, values, strict=True))
    return LogTable(comments, columns, head, np.array([number for number, _ in table], int))


def _heads(line: int, cells: list[str]) -> list[str]:
    """Return the names of the columns."""
    while cells and not cells[-1]:
        cells.pop()
    names = {name.casefold(): name for name in COLUMNS}
    for cell in cells:
        if cell.casefold() not in names:
            known = f"must be one of {listed(COLUMNS, cell)}"
            raise at_line(line, f"the column {shown(cell)} is unknown, {known}")
    heads = [names[cell.casefold()] for cell in cells]
    quantities = [COLUMNS[name].quantity for name in heads]
    for quantity in quantities:
        if quantities.count(quantity) > 1:
            raise at_line(
                line, f"{quantity} must have one column, got {quantities.count(quantity)}"
            )
    for needed in NEEDED:
        if not set(needed.split(" or ")) & set(heads):
            raise at_line(line, f"the log must have a column {needed}, got {', '.join(heads)}")
    return heads


def _numbers(line: int, cells: list[str], heads: Sequence[str], delimiter: str) -> list[float]:
    """Return the numbers of a row in SI."""
    needless = {"current_A"} if "torque_Nm" in heads else set()
    optional = {name for name in heads if COLUMNS[name].optional} | needless
    missing = heads[len(cells) :]
    if any(cells[len(heads) :]) or not optional.issuperset(missing):
        cure = "; is the line cut off?" if missing else ""
        if delimiter == "," and len(cells) > len(heads):
            cure = "; if decimals have commas, separate cells by semicolons"
        raise at_line(line, f"the row must have {len(heads)} cells, got {len(cells)}{cure}")
    cells = [*cells, *[""] * len(missing)]
    return [
        _number(line, cell, name, name in optional)
        for cell, name in zip(cells, heads, strict=False)
    ]


def _number(line: int, cell: str, name: str, optional: bool) -> float:
    """Return the number of a cell in SI; NaN where it is blank."""
    column = COLUMNS[name]
    if cell.casefold() in BLANK:
        if not optional:
            raise at_line(line, f"{name} must be a number in every row, got {cell or 'a blank'}")
        return math.nan
    if len(cell) > LONGEST or not NUMBER.fullmatch(cell):
        cure = "; write numbers without units and separators of thousands"
        raise at_line(line, f"{name} must be a number, got {shown(cell)}{cure}")
    value = float(cell.replace(",", "."))
    most = column.most / column.factor
    if not abs(value) <= most:
        allowed = f"between {-most:.4g} and {most:.4g}"
        raise at_line(line, f"{name} must be {allowed}, got {cell}; is its unit right?")
    return column.factor * value
