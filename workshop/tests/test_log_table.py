"""The reader of logs takes what loggers and spreadsheets write, and names bad lines."""

import random
import re

import numpy as np
import pytest
from machine_logs import MEASUREMENTS

from jansen_workshop.measured_walks import quantities, read_log

FAST = MEASUREMENTS / "synthetic_economy_2.csv"
LINES = FAST.read_text(encoding="utf-8").splitlines()
COMMENTS = [line for line in LINES if line.startswith("#")]
HEAD, *ROWS = [line.split(",") for line in LINES if not line.startswith("#")]
FIRST = len(COMMENTS) + 2  # line of the first row


@pytest.fixture(scope="module")
def right():
    return read_log(FAST)


def text_of(rows=ROWS, head=HEAD, comments=COMMENTS, mark=","):
    return "\n".join([*comments, *(mark.join(row) for row in [head, *rows])])


def saved(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
    return path


def with_cell(column, value, row=7):
    """The log's text with another cell."""
    rows = [list(cells) for cells in ROWS]
    rows[row][HEAD.index(column)] = value
    return text_of(rows)


def quoted(cells):
    return [f'"{cell}"' for cell in cells]


def comma(cells):
    return [cell.replace(".", ",") for cell in cells]


REMARKS = ["# Walk of Monday: the floor was wet: very", "# - [no YAML", "#", "# robot walked well",
           "# place: workshop", "# place: floor of stone"]  # fmt: skip
LAYOUTS = {
    "quoted": text_of([*map(quoted, ROWS)], quoted(HEAD)),
    "quoted decimal commas": text_of([quoted(comma(row)) for row in ROWS], quoted(HEAD)),
    "semicolons": text_of(mark=";"),
    "decimal commas": text_of([*map(comma, ROWS)], mark=";"),
    "decimal commas in comments": text_of([*map(comma, ROWS)], mark=";",
                                          comments=["# crank_speed: 2,0", "# robot: economy"]),
    "spreadsheet": text_of([[*row, ""] for row in ROWS], [*HEAD, ""],
                           [f'"{line}";;;;;' for line in COMMENTS], ";"),
    "separator line": "sep=;\n" + text_of(mark=";"),
    "tabs": text_of(mark="\t"),
    "spaces": text_of(mark="  "),
    "spaces after commas": text_of(mark=", "),
    "Windows": text_of().replace("\n", "\r\n"),
    "blank lines": text_of().replace("\n", "\n\n"),
    "remarks": text_of(comments=[*COMMENTS, *REMARKS]),
    "remarks between rows": text_of([*ROWS[:9], ["# a pause"], *ROWS[9:]]),
    "repeated heads": text_of([*ROWS[:9], HEAD, *ROWS[9:], HEAD]),
    "small letters": text_of(head=[name.lower() for name in HEAD]),
    "equals signs": text_of(comments=["# crank_speed = 2", "# robot = economy"]),
    "time of day": text_of([[f"{float(row[0]) + 1.7e9:.4f}", *row[1:]] for row in ROWS]),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts_of_loggers_and_spreadsheets_are_the_same_walk(name, right, tmp_path):
    log = read_log(saved(tmp_path, LAYOUTS[name]))
    assert log.speed == right.speed and log.about["robot"] == "economy"
    for ours, theirs in zip(log.walk, right.walk, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-4)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_encodings_are_the_same_walk(encoding, right, tmp_path):
    text = text_of(comments=[*COMMENTS, "# Prüfstand, 20 °C"])
    mark = "\ufeff" if encoding in ("utf-16-le", "utf-16-be") else ""
    log = read_log(saved(tmp_path, mark + text, encoding))
    np.testing.assert_array_equal(log.walk.torque, right.walk.torque)


@pytest.mark.parametrize("blank", ["", " ", "nan", "NaN", '""', "NA"])
def test_places_are_known_twice_a_second(blank, right, tmp_path):
    """Blank cells of an optional column are filled by straight lines."""
    rows = [[*row[:4], row[4] if number % 25 == 17 else blank] for number, row in enumerate(ROWS)]
    log = read_log(saved(tmp_path, text_of(rows)))
    assert not log.notes
    assert quantities(log.walk)["speed"] == pytest.approx(quantities(right.walk)["speed"], rel=0.02)
    np.testing.assert_array_equal(log.walk.pitch, right.walk.pitch)


@pytest.mark.parametrize("known", [range(0), range(10), range(0, 500, 100), range(250, 500)])
def test_places_that_do_not_tell_the_speed_are_left_out(known, tmp_path):
    rows = [[*row[:4], row[4] if number in known else ""] for number, row in enumerate(ROWS)]
    log = read_log(saved(tmp_path, text_of(rows)))
    assert np.isnan(log.walk.x).all()
    assert bool(known) == any("x_m is left out" in note for note in log.notes)


def test_current_may_be_blank_beside_torque(right, tmp_path):
    rows = [[*row, ""] for row in ROWS]
    log = read_log(saved(tmp_path, text_of(rows, [*HEAD, "current_A"])))
    np.testing.assert_array_equal(log.walk.torque, right.walk.torque)


CELL = rf"line {FIRST + 7}: "
BAD = {
    "unknown unit": (text_of(head=["time_s", "crank_turns", *HEAD[2:]]),
                     rf"line {FIRST - 1}: a column must be one of .*, got 'crank_turns'; did you"),
    "two columns": (text_of(head=["time_s", "crank_rad", "crank_deg", *HEAD[3:]]),
                    rf"line {FIRST - 1}: crank must have one column, got 2"),
    "no column": (text_of([row[:3] for row in ROWS], HEAD[:3]),
                  rf"line {FIRST - 1}: the log must have a column pitch_rad or pitch_deg"),
    "blank": (with_cell("pitch_rad", ""), CELL + "pitch_rad must be a number in every row, got a"),
    "NaN": (with_cell("torque_Nm", "nan"), CELL + "torque_Nm must be a number in every"),
    "infinite": (with_cell("torque_Nm", "inf"), CELL + "torque_Nm must be a number, got 'inf'"),
    "huge": (with_cell("torque_Nm", "1e308"),
             CELL + r"torque_Nm must be between -1e\+04 and 1e\+04, got 1e308; is its unit right"),
    "beyond floats": (with_cell("torque_Nm", "1e999"), CELL + "torque_Nm must be between"),
    "steep": (with_cell("pitch_rad", "2.9"), CELL + "pitch_rad must be between -0.8 and 0.8, g"),
    "unit": (with_cell("torque_Nm", "1.0 N m"), CELL + "torque_Nm must be a number, got '1.0 N m'"),
    "underscore": (with_cell("torque_Nm", "1_0"), CELL + "torque_Nm must be a number, got '1_0'"),
    "thousands": (with_cell("torque_Nm", '"1.000,5"'), CELL + "torque_Nm must be a number"),
    "decimal commas": (text_of([*map(comma, ROWS)]),
                       rf"line {FIRST}: the row must have 5 cells, got 10; if decimals"),
    "cut off": (text_of([*ROWS, ROWS[0][:2]]),
                rf"line {FIRST + len(ROWS)}: the row must have 5 cells, got 2; is the line cut"),
    "open quote": (with_cell("torque_Nm", '"1.0'), CELL + ".*quotation marks must be closed"),
    "long cell": (with_cell("torque_Nm", "1" * 300_000), CELL + "cells must be short numbers"),
    "Latin 1": (text_of(comments=[*COMMENTS, "# Prüfstand"]).encode("latin-1"),
                rf"line {FIRST - 1}: the text must be UTF-8"),
    "UTF-16 without a mark": (text_of().encode("utf-16-le"), "line 1: the text must have no null"),
    "half a character": (text_of().encode("utf-16")[:-1], rf"line {FIRST + len(ROWS) - 1}: the t"),
    "empty": ("", r"line 1: the file must have a header row \(time_s, crank_rad or"),
    "comments only": ("\n".join(COMMENTS), "line 4: the file must have a header row"),
    "no speed": (text_of(comments=["# a walk of Monday"]),
                 "line 2: a comment above must give crank_speed, for example '# crank_speed: 1'"),
    "speed in words": (text_of(comments=["# crank_speed: slow"]), "line 1: crank_speed must be"),
    "slow": (text_of(comments=["# crank_speed: 0.1"]), "line 1: crank_speed must be.*got 0.1"),
    "two speeds": (text_of(comments=["# crank_speed: 2", "# crank_speed: 1"]),
                   "line 2: crank_speed must be given only once, got it in line 1, too"),
    "gains": (text_of(comments=["# crank_speed: 2", "# gains: [10, 1"]), "line 2: gains"),
    "mass": (text_of(comments=["# crank_speed: 2", "# mass: -1"]), "line 2: mass must be.*got -1"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_named_by_its_line(name, tmp_path):
    text, message = BAD[name]
    with pytest.raises(ValueError, match=message) as raised:
        read_log(saved(tmp_path, text))
    assert not re.search("array|dtype|shape|convert|numpy|_csv", str(raised.value))


PIECES = [
    "", ",", ";", "\t", '"', "#", "\n", "\r", "\0", "\ufeff", "\x85", "nan", "-", "1e308", "1e-400",
    "é", "# gains: [1,2", "# crank_speed: .nan", "# mass: 1e999", "# robot: &a [*a]", "sep=;\n",
    "time_s", "crank_deg", "1,5", "9" * 400, "\u0665",
]  # fmt: skip


def mangled(rng):
    """A log of which bytes or cells are replaced, removed, moved or inserted; or any bytes."""
    if rng.random() < 0.1:
        return rng.randbytes(rng.randrange(60))
    encoding = rng.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16"])
    text = LAYOUTS[rng.choice([*LAYOUTS])]
    if rng.random() < 0.3:  # of a few lines only
        text = "\n".join(text.split("\n")[: rng.randrange(12)])
    for _ in range(rng.randrange(4)):
        place = rng.choice([rng.randrange(300), rng.randrange(len(text) + 1)])
        text = text[:place] + rng.choice(PIECES) + text[place + rng.randrange(9) :]
    data = text.encode(encoding)
    for _ in range(rng.choice([0, 0, 1, 3])):
        place = rng.randrange(len(data) + 1)
        data = data[:place] + rng.randbytes(rng.randrange(3)) + data[place + rng.randrange(3) :]
    return data


@pytest.mark.slow
def test_any_bytes_are_a_log_or_refused_with_a_line(tmp_path):
    rng, loaded, path = random.Random(0), 0, tmp_path / "log.csv"
    for number in range(400):
        path.write_bytes(mangled(rng))
        try:
            log = read_log(path)
        except ValueError as error:
            message = str(error)
            assert re.search(r"lines? \d+", message), (number, message)
            assert "\n" not in message and len(message) < 1200, (number, message)
        else:
            loaded += 1
            assert np.isfinite([log.walk.crank, log.walk.torque, log.walk.pitch]).all(), number
    assert 40 < loaded < 360
