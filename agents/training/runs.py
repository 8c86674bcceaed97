"""Run folders: their names, locks, configurations and evaluations.

The folder of a run contains config.yml, command.txt, best_model.zip, final_model.zip,
evaluations.json, checkpoints/model_STEPS_steps.zip, tensorboard/ and, for off-policy algorithms,
replay_buffer_STEPS.npz. At the end of the training, the scores are written into it, too.

A checkpoint contains the state of the training as the entry ``state`` of its member notes.json, and
so does final_model.zip. ``--resume`` needs this state. Runs of off-policy algorithms also need
replay_buffer_STEPS.npz with the same number of steps.
"""

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

CHECKPOINT = re.compile(r"model_([0-9]{1,18})_steps\.zip")  # other files do not belong to the run
FINAL = "final_model.zip"
BEST = "best_model.zip"


def new_run_folder(root: str | Path, algo: str, env_id: str) -> Path:
    """Create the folder ``root/ALGO/ENV_N``, where N is one more than the last number.

    Args:
        root: Parent folder of all runs.
        algo: Name of the algorithm.
        env_id: Id of the environment.
    """
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
    """Lock the folder of a run against other processes while the context is active.

    On entry, files that a killed process has left half written are removed.

    Args:
        folder: Folder of the run.

    Raises:
        ValueError: If another process uses the folder.
        OSError: If the folder is not writable.
    """
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
    """Return the model with the most steps in the folder of a run; None if there is no model.

    Args:
        folder: Folder of the run.

    Raises:
        ValueError: If the final model is damaged.
    """
    paths = (folder / "checkpoints").glob("model_*_steps.zip")
    named = [(CHECKPOINT.fullmatch(path.name), path) for path in paths]
    known = [(int(match[1]), False, path) for match, path in named if match]
    # At the same number of steps, the final model is newer: it is saved after the update, and a
    # checkpoint is saved before it.
    if (final := folder / FINAL).is_file():
        known.append((read_model(final).steps, True, final))
    return max(known)[2] if known else None


def replay_path(folder: Path, steps: int) -> Path:
    """Return the file of the replay buffer of a model.

    Args:
        folder: Folder of the run.
        steps: Number of steps for which the model has been trained.
    """
    return folder / f"replay_buffer_{steps}.npz"


def record_run(folder: Path, config: RunConfig, command: str) -> None:
    """Write config.yml, and append the command to command.txt.

    Args:
        folder: Folder of the run.
        config: Configuration of the run.
        command: Command that starts or continues the run.
    """
    write_text(folder / "config.yml", yaml.safe_dump(asdict(config), sort_keys=False))
    with (folder / "command.txt").open("a", encoding="utf-8") as file:
        file.write(f"{command}\n")


def read_evaluations(folder: Path) -> list[dict[str, Any]]:
    """Return the records in evaluations.json; an empty list if there is no file.

    Args:
        folder: Folder of the run.

    Raises:
        ValueError: If the file is damaged.
    """
    path = folder / "evaluations.json"
    needed = "a list of evaluations, each with 'steps' and 'return'"
    with named_errors(f"{path} must be {needed}", OSError, RecursionError):
        rows = json.loads(path.read_bytes()) if path.is_file() else []
        for row in instance("the whole", rows, list):
            for name in ("steps", "return"):
                finite(name, instance("an evaluation", row, dict).get(name))
        return list(rows)


def best_score(folder: Path) -> float:
    """Return the score that best_model.zip achieved in its evaluation; -inf if there is none.

    Args:
        folder: Folder of the run.
    """
    notes = read_model(folder / BEST).notes if (folder / BEST).is_file() else {}
    return finite(f"score in {folder / BEST}", notes["score"]) if "score" in notes else -math.inf
