"""Compare logs of a machine's walks with the published predictions.

``workshop/measurements/README.md`` describes the format of a log.
"""

import json
from dataclasses import astuple
from pathlib import Path

from jansen_env.checks import named_errors, one_of
from jansen_env.cli.flags import Parser
from jansen_workshop.measured_walks import compared, read_log, table

PREDICTIONS = Path(__file__).parents[1] / "predictions"


def published(path: Path) -> list[list[str]]:
    """Return rows of :func:`table` that compare a log with the published predictions.

    Args:
        path: File of the log.

    Raises:
        ValueError: If there are no predictions for the robot and the crank speed of the log. The
            message lists the available ones.
    """
    log = read_log(path)
    names = sorted(file.stem for file in PREDICTIONS.glob("*.json"))
    with named_errors(path):
        robot = one_of("robot", log.about.get("robot"), names)
        text = (PREDICTIONS / f"{robot}.json").read_text(encoding="utf-8")
        content = json.loads(text)
        if (gains := [*astuple(log.gains)]) != content["gains"]:
            raise ValueError(
                f"gains must be {content['gains']}, those of the prediction, got {gains}"
            )
        speeds = content["crank_speed"]
        known = speeds[one_of("crank_speed", f"{log.speed:g}", speeds)]
    bands = {name: (row["low"], row["high"]) for name, row in known.items()}
    return compared(path.name, log, bands)


def main(arguments: list[str] | None = None) -> None:
    """Compare logs with the published predictions and print the table.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = Parser(
        "jansen-workshop measurements",
        __doc__,
        "jansen-workshop measurements workshop/measurements/*.csv",
    )
    parser.add_argument(
        "logs", nargs="+", type=Path, metavar="LOG.csv", help="logs to compare with the predictions"
    )
    args = parser.parse_args(arguments)
    with parser.refusing():
        print(table([row for path in args.logs for row in published(path)]))
