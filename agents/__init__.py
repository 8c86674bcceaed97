"""Policies, their training and their scores; needs the packages of the extra ``train``."""

from importlib.util import find_spec

NEEDED = ("PIL", "cma", "filelock", "imageio", "imageio_ffmpeg", "matplotlib", "rich",
          "scipy", "stable_baselines3", "tabulate", "tensorboard", "torch", "tqdm",
          "yaml")  # fmt: skip

missing = [name for name in NEEDED if find_spec(name) is None]
if missing:
    raise ModuleNotFoundError(
        f"agents needs {', '.join(missing)}, which the extra 'train' installs: "
        'python -m pip install "jansen-env[train]", or in a checkout -e ".[train]"',
        name=missing[0],
    )
