"""Training, tuning, searches and export of policies; needs the packages of the extra ``train``."""

from importlib.util import find_spec


def need(extra: str, *names: str) -> None:
    """Raise ModuleNotFoundError where a package is missing, with the extra that brings it."""
    if missing := [name for name in names if find_spec(name) is None]:
        raise ModuleNotFoundError(
            f"agents needs {', '.join(missing)}, which the extra {extra!r} installs: "
            f'python -m pip install -c constraints.txt -e ".[{extra}]"',
            name=missing[0],
        )


NEEDED = ("PIL", "cma", "filelock", "imageio", "imageio_ffmpeg", "matplotlib", "rich",
          "scipy", "stable_baselines3", "tabulate", "tensorboard", "torch", "tqdm",
          "yaml")  # fmt: skip
need("train", *NEEDED)
