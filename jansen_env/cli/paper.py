"""Reproduce the paper: ``jansen-env paper --out DIR``."""

import time

from jansen_env.cli.flags import Parser, path_flag
from jansen_env.cli.progress import progress
from jansen_env.files import check_writable, write_text
from jansen_env.paper.claims import as_lines, check_claims, table
from jansen_env.paper.figures import draw
from jansen_env.paper.results import compute


def main(arguments: list[str] | None = None) -> None:
    """Compute the results, check the claims, and write ``claims.md`` and the figures.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = Parser(
        "jansen-env paper",
        "Reproduce the paper.",
        "jansen-env paper --out paper",
        "jansen-env paper --out paper --all",
    )
    parser.add_argument(
        "--out",
        type=path_flag,
        required=True,
        metavar="DIR",
        help="folder for the table and figures",
    )
    parser.add_argument("--all", action="store_true", help="print the complete table of claims")
    args = parser.parse_args(arguments)
    start = time.perf_counter()
    out = args.out
    with parser.refusing():
        check_writable("--out", out)  # checked before the long computation
    with progress("simulating", None):
        results = compute()
        claims = check_claims(results)
    text = table(claims)
    print(text if args.all else as_lines(claims))
    write_text(out / "claims.md", text)
    with progress("drawing", None):
        figures = draw(results, out)
    print(
        f"written: {out}/claims.md and {len(figures)} figures "
        f"in {time.perf_counter() - start:.0f} s"
    )
