"""Handling of Ctrl-C while a command is loaded: it ends the process at once, without a traceback.

The package imports this module before any other module, because a command spends most of its start
on imports. Other programs that import the package keep their own handling of Ctrl-C.
"""

import os
import sys

# The module ``signal`` would take milliseconds to import.
from _signal import SIG_DFL, SIGINT, signal  # type: ignore[import-not-found]

PACKAGES = ("jansen_env", "jansen_workshop", "agents", "benchmarks")
"""Packages with modules that ``python -m`` can run."""
COMMANDS = ("jansen-env", "jansen-workshop")  # console scripts
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))


def runs_command() -> bool:
    """Return whether this process was started as one of the project's commands."""
    program = sys.argv[0] if sys.argv else ""
    if os.path.basename(program).removesuffix(".exe") in COMMANDS:
        return True
    if program != "-m":  # sys.argv[0] is "-m" while python -m imports the packages of a module
        return os.path.realpath(program) == os.path.join(ROOT, "train.py")
    started = sys.orig_argv
    name = started[started.index("-m") + 1].partition(".")[0] if "-m" in started[:-1] else ""
    package = getattr(sys.modules.get(name), "__file__", None) or ""
    return name in PACKAGES and os.path.realpath(package).startswith(ROOT + os.sep)


def end_quietly_while_loading() -> None:
    """Let Ctrl-C end a command until :func:`jansen_env.cli.process.guarded` takes over.

    The process may end at once, because it has not written anything before that.
    """
    if runs_command():
        signal(SIGINT, SIG_DFL)
