"""One run of a study: begun, gone on with or recognised as finished, in its own folder."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

from agents.runs import FINAL, last_state, locked, record_run
from agents.study_plan import Run
from jansen_env.files import open_regular, write_json

STATUS, LOG, SCORES, TOKEN = "status.json", "log.txt", "scores.json", "token.txt"
PATIENCE = 30.0  # s for another process to leave a run's folder
PERIOD = 2.0  # s between two lines of how far a run is


@dataclass(frozen=True)
class Order:
    """A run, and what the process that performs it must know.

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


class Outcome(NamedTuple):
    """How a run ended: "finished", "failed", "stopped" (by a signal) or "lost" (its process)."""

    state: str
    error: str = ""


def is_finished(folder: Path) -> bool:
    """Whether a run is trained and scored."""
    return (folder / FINAL).is_file() and (folder / SCORES).is_file()


def read_status(folder: Path) -> dict[str, Any]:
    """What a run last wrote of itself; {} where there is nothing that can be read."""
    with suppress(OSError, ValueError):
        with open_regular(folder / STATUS) as file:
            found = json.load(file)
        if isinstance(found, dict):
            return found
    return {}


class Status:
    """Says in status.json how far a run is, from a thread of its own: training knows nothing of it.

    Attributes:
        model: what is being trained, once there is one. state: "starting", "training" or "scoring".
    """

    def __init__(self, folder: Path, target: int) -> None:
        self.folder, self.target = folder, target
        self.state, self.model = "starting", cast(Any, None)
        self._begun: tuple[float, int] | None = None
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._keep, daemon=True)

    def __enter__(self) -> Status:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._end.set()
        self._thread.join()

    def train(self, model: Any) -> None:
        """Training begins."""
        self._begun = time.perf_counter(), model.num_timesteps
        self.model, self.state = model, "training"

    def _keep(self) -> None:
        while not self._end.is_set():
            self.write(self.state)
            self._end.wait(PERIOD)

    def write(self, state: str, error: str = "") -> None:
        """Write the file; where that is not possible the run has other things to worry about."""
        row: dict[str, Any] = {"state": state, "target": self.target, "host": socket.gethostname(),
                               "pid": os.getpid()}  # fmt: skip
        if self._begun is not None and self.model is not None:
            then, steps = self._begun
            row["steps"] = int(self.model.num_timesteps)
            row["steps_per_second"] = round(
                (row["steps"] - steps) / max(time.perf_counter() - then, 1e-9), 1
            )
        if error:
            row["error"] = error
        with suppress(OSError):
            write_json(self.folder / STATUS, row)


def perform(order: Order) -> Outcome:
    """Train and score a run, from its last checkpoint if it has one; raises nothing of its own.

    What it prints goes to log.txt in its folder. The networks take one thread whatever the cores,
    as with ``train.py``: their sums, and so the run that a seed gives, depend on the number.
    """
    folder = order.run.folder
    problem = _unshared(folder.parent.parent, order.token)
    if problem:
        return Outcome("failed", problem)
    os.environ["NUMBA_NUM_THREADS"] = str(order.cores)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (
            _held(folder),
            (folder / LOG).open("a", encoding="utf-8") as log,
            redirect_stdout(log),
            redirect_stderr(log),
        ):
            return _perform(order)
    except (OSError, ValueError) as error:
        return Outcome("failed", str(error))


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """A run's folder for this process alone; one whose driver or node was killed has time to end.

    Raises:
        ValueError: another process has it, or it cannot be written to.
    """
    end = time.monotonic() + PATIENCE
    with ExitStack() as stack:
        while True:
            try:
                stack.enter_context(locked(folder))
                break
            except ValueError:
                if time.monotonic() > end:
                    raise
            time.sleep(1.0)
        yield


def _perform(order: Order) -> Outcome:
    """Train and score; what goes wrong is the outcome."""
    status = Status(order.run.folder, order.run.config["timesteps"])
    outcome = Outcome("finished")
    with status:
        try:
            _train_and_score(order, status)
        except (KeyboardInterrupt, SystemExit) as error:
            text = str(error) if isinstance(getattr(error, "code", None), str) else ""
            outcome = Outcome("failed" if text else "stopped", text)
        except Exception as error:
            traceback.print_exc()
            outcome = Outcome("failed", f"{type(error).__name__}: {error}")
    status.write(*outcome)
    return outcome


def _unshared(folder: Path, token: str) -> str:
    """What is wrong where a worker does not see the study's folder as the driver does."""
    try:
        with open_regular(folder / TOKEN) as file:
            found = file.read().decode()
    except (OSError, ValueError):
        found = ""
    if found == token:
        return ""
    return (
        f"{socket.gethostname()} does not see {folder} as the study's driver does: all machines "
        "must share this folder, under this path"
    )


def _train_and_score(order: Order, status: Status) -> None:
    import torch

    from agents.scoring import score_run
    from agents.training import prepare, train

    torch.set_num_threads(1)
    folder, config = order.run.folder, order.run.config
    resume = last_state(folder)
    model = prepare(config, resume)
    if resume is None or resume.name != FINAL or model.num_timesteps < config["timesteps"]:
        record_run(folder, config, order.command)
        status.train(model)
        train(
            model, config, folder, eval_every=order.eval_freq, save_every=order.save_freq,
            tensorboard=str(folder / "tensorboard"), resume=resume, progress=False,
        )  # fmt: skip
    status.state = "scoring"
    score_run(folder, config, order.eval_episodes)
