"""Run folders: config.yml, command.txt, best_model.zip, final_model.zip, evaluations.json,
checkpoints/model_STEPS_steps.zip, tensorboard/ and, of SAC, replay_buffer_STEPS.npz."""

from __future__ import annotations

import itertools
import math
import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import yaml
from filelock import FileLock, Timeout
from stable_baselines3.common.utils import get_latest_run_id

from agents.training.replay_buffers import check_replay_file
from jansen_env.checks import finite, instance
from jansen_env.files import PART, write_bytes, write_text
from jansen_env.sb3.model_files import parse_json, read_model, read_notes, read_training_state

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
def locked(folder: Path, patience: float = 0.0) -> Iterator[None]:
    """Keep other processes from a run's folder, and remove what a killed one had half written; a
    ValueError where another has it for ``patience`` s, or it cannot be written to."""
    holder = folder / ".lock-holder"
    try:
        held = FileLock(folder / ".lock").acquire(patience)
        write_text(holder, f"process {os.getpid()} on {socket.gethostname()}")
    except Timeout:
        by = holder.read_text("utf-8", "replace") if holder.is_file() else "another process"
        raise ValueError(f"{folder} is in use by {by}") from None
    except OSError as error:
        raise ValueError(f"{folder} cannot be written to: {error}") from error
    with held:
        for place in (folder, folder / "checkpoints"):
            for part in place.glob(f"{PART}*"):
                if part.is_file():  # what else is called so is not ours
                    part.unlink()
        yield


def last_state(folder: str | Path) -> Path | None:
    """Return the model with the most steps in a run's folder, None without one.

    One that is damaged, or whose replay buffer is, is passed over, with a line that says so; where
    all are, a ValueError does.
    """
    found = [
        (int(path.stem.split("_")[1]), False, path)
        for path in (Path(folder) / "checkpoints").glob("model_*_steps.zip")
        if re.fullmatch(r"model_\d+_steps", path.stem)
    ]
    errors = []
    if (final := Path(folder) / FINAL).is_file():
        try:  # after the update that a checkpoint of as many steps comes before
            found.append((read_model(final)[1], True, final))
        except ValueError as error:
            errors.append(error)
    for steps, _, path in sorted(found, reverse=True):
        try:
            read_model(path)
            read_training_state(path)
            if (buffer := replay_path(Path(folder), steps)).is_file():
                check_replay_file(buffer)
        except ValueError as error:
            errors.append(error)
            continue
        for damage in errors:
            print(f"{damage}; the checkpoint before takes its place")
        return path
    if errors:
        raise errors[0]
    return None


def replay_path(folder: Path, steps: int) -> Path:
    """Return where the replay buffer of a model of so many steps lies."""
    return folder / f"replay_buffer_{steps}.npz"


def record_run(folder: Path, config: dict[str, Any], command: str) -> None:
    """Write config.yml, and add a line to command.txt."""
    write_text(folder / "config.yml", yaml.safe_dump(config, sort_keys=False))
    commands = folder / "command.txt"
    before = commands.read_bytes() if commands.is_file() else b""
    write_bytes(commands, before + f"{command}\n".encode())


def read_evaluations(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of evaluations.json, none without it; a ValueError where it is damaged."""
    path = folder / "evaluations.json"
    try:
        rows = parse_json(path.read_bytes()) if path.is_file() else []
        instance("the whole", rows, list)
        for row in rows:
            instance("an evaluation", row, dict)
            for name in {"steps", "return", *({"seconds", "score"} & {*row})}:
                finite(name, row.get(name))
    except (OSError, RecursionError, ValueError) as error:
        needed = "a list of evaluations, each with 'steps' and 'return'"
        raise ValueError(f"{path} must be {needed}: {error}") from error
    return rows


def best_score(folder: Path) -> float:
    """Return the score of best_model.zip at its evaluation; -inf where there is none."""
    notes = read_notes(folder / BEST) if (folder / BEST).is_file() else {}
    return finite(f"score in {folder / BEST}", notes["score"]) if "score" in notes else -math.inf
