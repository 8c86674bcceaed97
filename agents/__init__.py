"""Training, tuning, search and export of policies; requires the packages of the extra ``train``."""

import jansen_env  # noqa: F401  # isort: skip  # first, so that Ctrl-C ends a command while it is loading

import os
from importlib.util import find_spec

WAITING = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME")
"""Environment variables that determine how the threads of OpenMP wait."""
SPINS = "2000"  # number of spins of a waiting thread before it sleeps


def need(extra: str, *names: str, who: str = "agents") -> None:
    """Check that packages are installed.

    Args:
        extra: Extra of this package that installs them.
        *names: Names of the packages.
        who: Program that needs the packages.

    Raises:
        SystemExit: If a package is missing. The message names the extra.
    """
    if missing := [name for name in names if find_spec(name) is None]:
        raise SystemExit(
            f"{who} needs {', '.join(missing)}, which the extra {extra!r} installs: "
            f'python -m pip install -c constraints.txt -e ".[{extra}]"'
        )


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
