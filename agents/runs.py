"""Run folders. A run's folder holds all that is needed to go on with it or to score it:

config.yml  command.txt  best_model.zip  final_model.zip  evaluations.json
checkpoints/model_STEPS_steps.zip  monitor/*.csv  tensorboard/
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from jansen_env.files import write_text


def new_run_folder(root: str | Path, algo: str, env_id: str) -> Path:
    """``root/ALGO/ENV_N``, N one above the last; created."""
    parent = Path(root) / algo
    parent.mkdir(parents=True, exist_ok=True)
    pattern = re.compile(re.escape(env_id) + r"_(\d+)")
    found = [int(m.group(1)) for p in parent.iterdir() if (m := pattern.fullmatch(p.name))]
    folder = parent / f"{env_id}_{max(found, default=0) + 1}"
    folder.mkdir()
    return folder


def last_checkpoint(folder: str | Path) -> Path:
    """The checkpoint with the most steps in a run's folder.

    Raises:
        ValueError: there is none.
    """
    found = {
        int(m.group(1)): p
        for p in (Path(folder) / "checkpoints").glob("model_*_steps.zip")
        if (m := re.fullmatch(r"model_(\d+)_steps", p.stem))
    }
    if not found:
        raise ValueError(f"no checkpoint in {Path(folder) / 'checkpoints'}, nothing to resume from")
    return found[max(found)]


def record_run(folder: Path, config: dict[str, Any], command: str) -> None:
    """Write config.yml and command.txt."""
    write_text(folder / "config.yml", yaml.safe_dump(config, sort_keys=False))
    write_text(folder / "command.txt", command + "\n")
