"""Run the paper again: ``python -m jansen_env.paper --out DIR``."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict
from pathlib import Path

from jansen_env.files import write_json, write_text
from jansen_env.paper.claims import judge, levels_markdown, markdown, screen
from jansen_env.paper.results import compute


def main(arguments: list[str] | None = None) -> None:
    """Compute, judge, draw, write: claims.md, claims.json and the figures."""
    parser = argparse.ArgumentParser(prog="python -m jansen_env.paper", description=__doc__)
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for tables and figures")
    parser.add_argument("--workers", type=int, default=2, help="processes; default: 2")
    args = parser.parse_args(arguments)
    if args.workers < 1:
        parser.error(f"--workers is {args.workers}, must be 1 or more")
    try:
        from jansen_env.paper.figures import draw
    except ImportError as error:
        raise SystemExit(f"{error}: the figures need matplotlib, pip install matplotlib") from error
    start, out = time.perf_counter(), Path(args.out)
    try:
        out.mkdir(parents=True, exist_ok=True)  # before the work, not after it
    except OSError as error:
        parser.error(f"--out is {args.out}, must be a folder that can be written to: {error}")
    results = compute(args.workers)
    claims = judge(results)
    print(screen(claims), end="\n\n")
    tables = (
        "# Claims\n\n" + markdown(claims)
        + "\n# Torque at a constant 1 rad/s, by reading\n\n" + levels_markdown(results.levels)
    )  # fmt: skip
    write_text(out / "claims.md", tables)
    write_json(
        out / "claims.json",
        {"claims": [asdict(c) for c in claims], "levels": [asdict(v) for v in results.levels]},
    )
    figures = draw(results, out)
    print(f"written: {out}/claims.md, {out}/claims.json and {len(figures)} figures "
          f"in {time.perf_counter() - start:.0f} s")  # fmt: skip


if __name__ == "__main__":
    main()
