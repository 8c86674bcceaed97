"""Reproduce the paper: ``jansen-env paper --out DIR``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from jansen_env.commands.flags import Parser
from jansen_env.files import check_writable, write_json, write_text
from jansen_env.paper.claims import Claim, as_lines, as_markdown, check_claims
from jansen_env.paper.errata import Erratum, errata
from jansen_env.paper.figures import draw
from jansen_env.paper.interpretations import Level, PIDLevel
from jansen_env.paper.results import compute


def main(arguments: list[str] | None = None) -> None:
    """Compute, check, draw, write: claims.md, claims.json and the figures."""
    parser = Parser("jansen-env paper", "Reproduce the paper.", "jansen-env paper --out paper",
                    "jansen-env paper --out paper --all")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="DIR",
                        help="folder for tables and figures")  # fmt: skip
    parser.add_argument("--all", action="store_true", help="print all tables")
    args = parser.parse_args(arguments)
    start, out = time.perf_counter(), args.out
    with parser.refusing():
        check_writable("--out", out)  # before the work
    results = compute()
    claims, effects = check_claims(results), errata()
    text = as_markdown(claims, effects, results.levels, results.pid_levels)
    print(text if args.all else as_lines(claims))
    write_text(out / "claims.md", text)
    tables: dict[str, Sequence[Claim | Level | PIDLevel | Erratum]] = {
        "claims": claims, "levels": results.levels, "pid_levels": results.pid_levels,
        "errata": effects,
    }  # fmt: skip
    rows = {name: [asdict(row) for row in table] for name, table in tables.items()}
    write_json(out / "claims.json", rows)
    figures = draw(results, out)
    print(f"written: {out}/claims.md, {out}/claims.json and {len(figures)} figures "
          f"in {time.perf_counter() - start:.0f} s")  # fmt: skip
