"""One run of a study: begun, resumed or recognised as finished, in its own folder."""

from __future__ import annotations

import json
import os
import socket
import traceback
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any, NamedTuple

from agents.studies.plan import Run
from agents.training.runs import FINAL, last_state, locked, record_run
from jansen_env.files import open_regular, write_json

STATUS, LOG, SCORES, TOKEN = "status.json", "log.txt", "scores.json", "token.txt"
PATIENCE = 30.0  # s for another process, whose driver or node was killed, to leave a run's folder


class RunRequest(NamedTuple):
    """A run, and what the process that executes it must know.

    Attributes:
        eval_freq, save_freq, eval_episodes: as of ``train.py``. cores: for the environments.
        command: that began the study. token: what the study's folder has in :data:`TOKEN`.
    """

    run: Run
    eval_freq: int | None
    save_freq: int
    eval_episodes: int
    cores: int
    command: str
    token: str

    @property
    def name(self) -> str:
        """Of the run."""
        return self.run.name


class RunResult(NamedTuple):
    """End of a run: "finished", "failed", "stopped" (by a signal) or "lost" (its process)."""

    state: str
    error: str = ""


def is_finished(folder: Path) -> bool:
    """Return whether a run is trained and scored."""
    return (folder / FINAL).is_file() and (folder / SCORES).is_file()


def read_status(folder: Path) -> dict[str, Any]:
    """Read a run's "state", "error", "host" and "pid" at its last change of state; {} without."""
    with suppress(OSError, ValueError):
        with open_regular(folder / STATUS) as file:
            found = json.load(file)
        if isinstance(found, dict):
            return found
    return {}


def run_state(run: Run) -> str:
    """Return a run's state by its folder."""
    if is_finished(run.folder):
        return "finished"
    return str(read_status(run.folder).get("state", "waiting"))


def _write_status(folder: Path, state: str, error: str = "") -> None:
    row = {"state": state, "error": error, "host": socket.gethostname(), "pid": os.getpid()}
    with suppress(OSError):  # a full disk is reported by what must be written
        write_json(folder / STATUS, row)


def execute_run(request: RunRequest) -> RunResult:
    """Train and score a run, from its last checkpoint if it has one; errors are the result.

    Its output goes to log.txt in its folder.
    """
    folder = request.run.folder
    os.environ["JANSEN_ENV_THREADS"] = str(request.cores)
    try:
        _check_shared(folder.parent.parent, request.token)
        folder.mkdir(parents=True, exist_ok=True)
        with (
            locked(folder, PATIENCE),
            (folder / LOG).open("a", encoding="utf-8") as log,
            redirect_stdout(log),
            redirect_stderr(log),
        ):
            try:
                _train_and_score(request)
                result = RunResult("finished")
            except (KeyboardInterrupt, SystemExit) as error:
                text = str(error) if isinstance(getattr(error, "code", None), str) else ""
                result = RunResult("failed" if text else "stopped", text)
            except Exception as error:
                traceback.print_exc()
                result = RunResult("failed", f"{type(error).__name__}: {error}")
            _write_status(folder, *result)
            return result
    except (OSError, ValueError) as error:
        return RunResult("failed", str(error))


def _check_shared(folder: Path, token: str) -> None:
    """Raise a ValueError where this machine does not see the study's folder as its driver does."""
    found = b""
    with suppress(OSError, ValueError), open_regular(folder / TOKEN) as file:
        found = file.read()
    if found != token.encode():
        raise ValueError(
            f"{socket.gethostname()} does not see {folder} as the study's driver does: all "
            "machines must share this folder, under this path"
        )


def _train_and_score(request: RunRequest) -> None:
    import torch

    from agents.training.scores import score_run
    from agents.training.train_model import prepare, train

    torch.set_num_threads(1)  # whatever the cores: the run that a seed gives depends on the number
    folder, config = request.run.folder, request.run.config
    _write_status(folder, "starting")
    resume = last_state(folder)
    model = prepare(config, resume)
    if resume is None or resume.name != FINAL or model.num_timesteps < config["timesteps"]:
        record_run(folder, config, request.command)
        _write_status(folder, "training")
        train(
            model, config, folder, eval_every=request.eval_freq, save_every=request.save_freq,
            tensorboard=str(folder / "tensorboard"), resume=resume, progress=False,
        )  # fmt: skip
    _write_status(folder, "scoring")
    score_run(folder, config, request.eval_episodes)
