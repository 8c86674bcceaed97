"""Read the comments and columns of a log, a CSV file as written by data loggers and spreadsheets.

The text may be UTF-8 or UTF-16. Cells may be quoted and may be separated by commas, semicolons,
tabs, vertical bars or spaces. The decimal separator may be a comma. Every error message begins with
the number of the line.
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
from jansen_env.checks import LONGEST, invalid, listed, shown

DELIMITERS = ";\t,| "  # the first of these characters in the header row separates the cells
BLANK = {"", "nan", "na", "n/a", "null", "none", "-"}  # cells without a value, in lower case
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
COMMENT = re.compile(r"(\w+)\s*[:=]\s*(.*)", re.ASCII)
UNICODE_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",  # written by redirections in PowerShell
    codecs.BOM_UTF16_BE: "utf-16-be",
}


class Column(NamedTuple):
    """A column that a log may have.

    Attributes:
        quantity: Quantity in the column; a log has one column per quantity.
        factor: Factor that converts the unit of the column to SI units.
        most: Largest allowed magnitude, in SI units.
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
    """Contents of a log.

    Attributes:
        comments: Line number and text of each comment ``name: value``, by name.
        columns: Columns in SI units by quantity, shape (n,); NaN where a cell is blank.
        head: Line number of the header row.
        lines: Line number of each row, shape (n,).
    """

    comments: dict[str, tuple[int, str]]
    columns: dict[str, Array]
    head: int
    lines: Ints


def at_line(line: int, text: str) -> ValueError:
    """Return a ValueError whose message begins with a line number.

    Args:
        line: Number of the line.
        text: The message.
    """
    return ValueError(f"line {line}: {text}")


def decoded(data: bytes) -> str:
    """Decode a file as UTF-16 if it begins with a UTF-16 byte order mark, otherwise as UTF-8.

    Args:
        data: Contents of the file.

    Raises:
        ValueError: If the text is in another encoding or contains null characters.
    """
    encoding = "utf-8"
    for mark, name in UNICODE_MARKS.items():
        if data.startswith(mark):
            data = data.removeprefix(mark)
            encoding = name
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
    """Split text into the lines that an editor would count.

    Args:
        text: The text.
    """
    return [line.strip() for line in io.StringIO(text, newline=None)]


def split_cells(line: int, text: str, delimiter: str) -> list[str]:
    """Split a line into its cells.

    Args:
        line: Number of the line, for error messages.
        text: Text of the line.
        delimiter: Character that separates cells.

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
    """Read the comments and columns of a log.

    Args:
        data: Contents of the file.
        once: Names of comments that may appear only once; other comments are free remarks.

    Raises:
        ValueError: If the log cannot be read. The message names the line, the problem and what is
            allowed.
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
                    raise at_line(
                        number, f"{name} must be given only once, got it in line {before}, too"
                    )
                comments[name] = number, value
        elif text.strip('";,\t| ') and not re.fullmatch(r'"?sep=.*', text, re.IGNORECASE):
            rows.append((number, text))
    if not rows:
        needed = ", ".join(NEEDED)
        raise at_line(number, f"the file must have a header row ({needed}), got none")
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
    """Return the names of the columns, or raise ValueError if a column is unknown or missing."""
    while cells and not cells[-1]:
        cells.pop()
    names = {name.casefold(): name for name in COLUMNS}
    for cell in cells:
        if cell.casefold() not in names:
            raise at_line(line, str(invalid("a column", cell, f"one of {listed(COLUMNS, cell)}")))
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
    """Return the numbers of a row in SI units."""
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
    """Return the number in a cell in SI units; NaN if the cell is blank."""
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
