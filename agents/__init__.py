"""Training, tuning, search and export of policies; requires the packages of the extra ``train``."""

import jansen_env  # noqa: F401  # isort: skip  # first, so that Ctrl-C ends a command while it is loading

import os
from importlib.util import find_spec

WAITING = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME")
"""Environment variables that determine how the threads of OpenMP wait."""
GROUPS = ("distributed",)
"""Dependency groups of ``pyproject.toml``, which pip installs from version 25.1 on."""
SPINS = "2000"  # number of spins of a waiting thread before it sleeps


def need(extra: str, *names: str, who: str = "agents") -> None:
    """Check that packages are installed.

    Args:
        extra: Extra or dependency group of this package that installs them.
        *names: Names of the packages.
        who: Program that needs the packages.

    Raises:
        SystemExit: If a package is missing. The message contains the command that installs it.
    """
    if missing := [name for name in names if find_spec(name) is None]:
        packages = '".[train]" --group ' + extra if extra in GROUPS else f'".[{extra}]"'
        raise SystemExit(
            f"{who} needs {', '.join(missing)}: "
            f"python -m pip install -c constraints.txt -e {packages}"
        )


def need_workshop(who: str) -> None:
    """Check that the package ``jansen_workshop``, from the folder ``workshop``, is installed.

    Args:
        who: Program that needs the package.

    Raises:
        SystemExit: If the package is missing.
    """
    if find_spec("jansen_workshop") is None:
        command = "python -m pip install -c constraints.txt -e . -e workshop"
        raise SystemExit(f"{who} needs jansen_workshop: {command}")


NEEDED = (
    "PIL",
    "cma",
    "imageio_ffmpeg",
    "jinja2",
    "matplotlib",
    "rich",
    "scipy",
    "stable_baselines3",
    "tabulate",
    "tensorboard",
    "torch",
    "tqdm",
    "yaml",
)
need("train", *NEEDED)


def set_openmp() -> None:
    """Set OpenMP's environment variables for training, unless the user has set them.

    Call this function before torch is loaded. A single thread computes the actions of the robots.
    More threads would slow down a step, and they would change the rounding of the initial weights
    and therefore the result of a seed. An update uses more threads. By default, these threads spin
    while they wait for one another. If other processes are running, spinning threads can take the
    processor from the very thread that they wait for. They are therefore set to sleep soon.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if not any(name in os.environ for name in WAITING):
        os.environ["GOMP_SPINCOUNT"] = SPINS
