"""Ctrl-C while a command is loaded: it ends the process at once, without a traceback.

The package imports this module before any other, as most of a command's start is spent on imports.
Programs that import the package keep their own handling of Ctrl-C.
"""

import os
import sys

# Not the module signal, which takes milliseconds to import.
from _signal import SIG_DFL, SIGINT, signal  # type: ignore[import-not-found]

PACKAGES = ("jansen_env", "agents", "benchmarks")  # whose modules run by python -m
ROOT = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))


def runs_command() -> bool:
    """Return whether this process was started as one of the project's commands."""
    program = sys.argv[0] if sys.argv else ""
    if os.path.basename(program).removesuffix(".exe") == "jansen-env":
        return True
    if program != "-m":  # what it is while python -m imports a module's packages
        return os.path.realpath(program) == os.path.join(ROOT, "train.py")
    started = sys.orig_argv
    name = started[started.index("-m") + 1].partition(".")[0] if "-m" in started[:-1] else ""
    package = getattr(sys.modules.get(name), "__file__", None) or ""
    return name in PACKAGES and os.path.realpath(package).startswith(ROOT + os.sep)


def end_quietly_while_loading() -> None:
    """Let Ctrl-C end a command by the signal itself until :func:`jansen_env.process.guarded`.

    Nothing has been written by then, so that the process may end at once.
    """
    if runs_command():
        signal(SIGINT, SIG_DFL)
