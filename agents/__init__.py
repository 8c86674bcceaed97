"""Training, tuning, searches and export of policies; needs the packages of the extra ``train``."""

import jansen_env  # noqa: F401  # isort: skip  # first: Ctrl-C ends a command that is loaded

from importlib.util import find_spec


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
