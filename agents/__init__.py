"""Training, tuning, searches and export of policies; needs the packages of the extra ``train``."""

import jansen_env  # noqa: F401  # isort: skip  # first: Ctrl-C ends a command that is loaded

import os
from importlib.util import find_spec

WAITING = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME")
"""Environment variables that say how OpenMP's threads wait."""
SPINS = "2000"  # of a thread that waits, before it sleeps


def need(extra: str, *names: str, who: str = "agents") -> None:
    """Raise SystemExit, with the extra that brings them, where packages are missing."""
    if missing := [name for name in names if find_spec(name) is None]:
        raise SystemExit(
            f"{who} needs {', '.join(missing)}, which the extra {extra!r} installs: "
            f'python -m pip install -c constraints.txt -e ".[{extra}]"'
        )


NEEDED = ("PIL", "cma", "imageio_ffmpeg", "jinja2", "matplotlib",
          "rich", "scipy", "stable_baselines3", "tabulate", "tensorboard", "torch",
          "tqdm", "yaml")  # fmt: skip
need("train", *NEEDED)


def set_openmp() -> None:
    """Set OpenMP's environment variables for training, unless the user has set them.

    Call it before torch is loaded. One thread acts for the robots: more slow down a step, and
    change the rounding of initial weights and so the run of a seed. An update takes more threads,
    which spin by default where they wait for one another. Beside other processes they take the
    processor from the very thread that they wait for, so they sleep soon.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if not any(name in os.environ for name in WAITING):
        os.environ["GOMP_SPINCOUNT"] = SPINS
