"""Compile all that environments need, for containers and continuous integration.

What ``gym.make`` would compile is kept in NUMBA_CACHE_DIR, beside the package or in the user's
cache folder, whichever can be written first: ``jansen-env compile``.
"""

from __future__ import annotations

import argparse
import inspect
import logging
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium as gym

from jansen_env.checks import listed
from jansen_env.engine import jit
from jansen_env.policies.environment import registered

OPTIONS = ("noise", "push")  # arguments that bring kernels of their own


def main(arguments: list[str] | None = None) -> None:
    """Make environments. Raises SystemExit: nothing can be compiled or kept."""
    known = [*registered()]
    parser = argparse.ArgumentParser(prog="jansen-env compile", description=__doc__)
    parser.add_argument("ids", nargs="*", metavar="ID", help=f"default: {' '.join(known)}")
    ids = parser.parse_args(arguments).ids or known
    for name in ids:
        if name not in known:
            parser.error(f"ID is {name!r}, must be one of {listed(known, name)}")
    if jit.DISABLED or not jit.FOLDER:
        why = "NUMBA_DISABLE_JIT is set" if jit.DISABLED else f"it compiles {jit.NOT_KEPT}"
        raise SystemExit(f"jansen_env has no machine code to keep: {why}")
    logging.basicConfig(format="%(message)s", stream=sys.stdout)
    start = time.perf_counter()
    for number, name in enumerate(ids, start=1):
        print(f"{number} of {len(ids)}: {name}", flush=True)
        env = gym.make(name)
        accepted = inspect.signature(type(env.unwrapped)).parameters
        options: dict[str, Any] = {one: {} for one in OPTIONS if one in accepted}
        gym.make(name, **options).close()
        env.close()
    if jit.failed_to_keep():
        raise SystemExit(f"jansen_env could not keep all its machine code in {jit.FOLDER}")
    size = sum(path.stat().st_size for path in Path(jit.FOLDER).rglob("*.nbc")) / 1e6
    print(f"{size:.1f} MB in {jit.FOLDER}, after {time.perf_counter() - start:.0f} s")
