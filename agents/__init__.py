"""Policies, their training and their scores; needs the packages of the extra ``train``."""

from importlib.util import find_spec

NEEDED = ("PIL", "matplotlib", "rich", "stable_baselines3", "tensorboard", "torch", "tqdm", "yaml")

missing = [name for name in NEEDED if find_spec(name) is None]
if missing:
    raise ModuleNotFoundError(
        f"agents needs {', '.join(missing)}, which the extra 'train' installs: "
        'python -m pip install "jansen-env[train]", or in a checkout -e ".[train]"',
        name=missing[0],
    )
