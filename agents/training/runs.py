"""Run folders: config.yml, command.txt, best_model.zip, final_model.zip, evaluations.json,
checkpoints/model_STEPS_steps.zip, tensorboard/ and, of SAC, replay_buffer_STEPS.npz."""

import itertools
import json
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml
from stable_baselines3.common.utils import get_latest_run_id

from jansen_env.checks import finite, instance, named_errors
from jansen_env.files import PART, write_text
from jansen_env.sb3.run_config import RunConfig
from jansen_env.sb3.trained import read_model

CHECKPOINT = re.compile(r"model_([0-9]{1,18})_steps\.zip")  # others are not the run's
FINAL, BEST = "final_model.zip", "best_model.zip"


def new_run_folder(root: str | Path, algo: str, env_id: str) -> Path:
    """Make ``root/ALGO/ENV_N``, N one above the last."""
    parent = Path(root) / algo
    parent.mkdir(parents=True, exist_ok=True)
    for number in itertools.count(get_latest_run_id(str(parent), env_id) + 1):
        folder = parent / f"{env_id}_{number}"
        with suppress(FileExistsError):  # another run has taken the number in the meantime
            folder.mkdir()
            break
    return folder


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from a run's folder, and remove what a killed one had half written; a
    ValueError where another process has it, an OSError where it cannot be written to."""
    with (folder / ".lock").open("w") as file:
        with suppress(ImportError):  # Windows has no such locks
            import fcntl

            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(f"{folder} is in use by another process") from None
        for part in folder.rglob(f"{PART}*"):
            if part.is_file():
                part.unlink()
        yield


def last_state(folder: Path) -> Path | None:
    """Return the model with the most steps in a run's folder, None without one; a ValueError where
    the final model is damaged."""
    paths = (folder / "checkpoints").glob("model_*_steps.zip")
    named = [(CHECKPOINT.fullmatch(path.name), path) for path in paths]
    known = [(int(match[1]), False, path) for match, path in named if match]
    if (final := folder / FINAL).is_file():  # after the update that a checkpoint comes before
        known.append((read_model(final).steps, True, final))
    return max(known)[2] if known else None


def replay_path(folder: Path, steps: int) -> Path:
    """Return where the replay buffer of a model of so many steps lies."""
    return folder / f"replay_buffer_{steps}.npz"


def record_run(folder: Path, config: RunConfig, command: str) -> None:
    """Write config.yml, and add a line to command.txt."""
    write_text(folder / "config.yml", yaml.safe_dump(asdict(config), sort_keys=False))
    with (folder / "command.txt").open("a", encoding="utf-8") as file:
        file.write(f"{command}\n")


def read_evaluations(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of evaluations.json, none without it; a ValueError where it is damaged."""
    path = folder / "evaluations.json"
    needed = "a list of evaluations, each with 'steps' and 'return'"
    with named_errors(f"{path} must be {needed}", OSError, RecursionError):
        rows = json.loads(path.read_bytes()) if path.is_file() else []
        for row in instance("the whole", rows, list):
            for name in ("steps", "return"):
                finite(name, instance("an evaluation", row, dict).get(name))
        return list(rows)


def best_score(folder: Path) -> float:
    """Return the score of best_model.zip at its evaluation; -inf where there is none."""
    notes = read_model(folder / BEST).notes if (folder / BEST).is_file() else {}
    return finite(f"score in {folder / BEST}", notes["score"]) if "score" in notes else -math.inf
