"""Starting the workers of a data-parallel run: on this machine, or by torchrun on several too."""

from __future__ import annotations

import os
import shlex
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from types import FrameType

import torch.distributed as dist
from torch.distributed import TCPStore  # type: ignore[attr-defined]
from torch.distributed.distributed_c10d import Store
from torch.distributed.rendezvous import rendezvous
from torch.multiprocessing.spawn import ProcessContext, ProcessExitedException, spawn

from agents.data_parallel import Worker, WorkerLost, connected
from agents.process import SIGNALS, outlive_readers
from jansen_env.cores import available_cores

TIMEOUT = timedelta(minutes=30)  # in which a worker must answer: the leader may be evaluating
GRACE = 10.0  # s that workers have to end by themselves after one of them has failed
HERE = "127.0.0.1"
LOST = 75  # exit status of a worker that has lost the others; sysexits.h's temporary failure

Work = Callable[[Worker], Path]
"""What each worker does, a function that can be pickled; returns the run's folder."""


def torchrun_size() -> int:
    """How many processes torchrun has started, this one among them; 0 without torchrun."""
    return int(os.environ.get("WORLD_SIZE", "0")) if "RANK" in os.environ else 0


def count_workers(asked: int) -> int:
    """How many workers there are: torchrun's, or as many as asked for.

    Raises:
        ValueError: both, and they differ.
    """
    started = torchrun_size()
    if started and asked not in (1, started):
        raise ValueError(f"--workers is {asked}, must be left out: torchrun has started {started}")
    return started or asked


def join_torchrun(work: Work) -> Path:
    """Be one of torchrun's workers.

    Raises:
        SystemExit: another worker is gone.
    """
    store, rank, size = next(rendezvous("env://", timeout=TIMEOUT))
    local = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    try:
        return be_worker(store, rank, size, available_cores() // local, work)
    except WorkerLost as error:
        raise SystemExit(f"train.py: error: worker {rank} has lost the others: {error}") from error


def run_here(workers: int, work: Work) -> Path:
    """Train with so many processes on this machine; returns the run's folder.

    SIGINT (Ctrl-C), SIGTERM and SIGHUP go on to all of them, as does the end of this process.

    Raises:
        SystemExit: a worker has ended early, with its status, or saying what killed it.
    """
    # The store is here, not in a worker: its port is one that the system has found free. Left to
    # itself it would listen on all interfaces, and to everybody.
    listener = socket.create_server((HERE, 0))
    port = listener.getsockname()[1]
    store = TCPStore(
        HERE, port, is_master=True, wait_for_workers=False, master_listen_fd=listener.detach()
    )
    with ExitStack() as stack:
        with _blocked_signals():  # what comes meanwhile is for the workers
            context = spawn(  # type: ignore[no-untyped-call]
                _local_worker, (workers, store.port, work), nprocs=workers, join=False
            )
            stack.enter_context(_forwarded_signals(context))
        with suppress(ProcessExitedException):
            while not context.join(grace_period=GRACE):
                pass
    folder = Path(store.get("folder").decode()) if store.check(["folder"]) else None
    codes = [process.exitcode or 0 for process in context.processes]
    if any(codes):
        raise SystemExit(_why(codes, folder))
    assert folder is not None
    return folder


def _why(codes: list[int], folder: Path | None) -> str | int:
    """What to exit with after workers ended with these statuses, not all of them 0."""
    # Those that have lost another, or were ended here after that, are not the cause.
    causes = [rank for rank, code in enumerate(codes) if code not in (0, LOST, -signal.SIGTERM)]
    rank = causes[0] if causes else max(range(len(codes)), key=lambda i: codes[i] != 0)
    if codes[rank] > 0 and codes[rank] != LOST:  # and it has said why
        return codes[rank]
    if codes[rank] == -signal.SIGINT:
        return 128 + signal.SIGINT
    more = ""
    if folder is not None:
        more = f"; python train.py --resume {shlex.quote(str(folder))} goes on from what is saved"
    end = "has lost the others"
    if codes[rank] < 0:
        end = f"was killed by {signal.Signals(-codes[rank]).name}"
    return f"train.py: error: worker {rank} {end}{more}"


def _local_worker(rank: int, size: int, port: int, work: Work) -> None:
    """A process of :func:`run_here`."""
    outlive_readers()
    if sys.platform != "win32":
        os.setsid()  # a terminal's Ctrl-C goes to the parent alone, which hands it on once
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    if sys.platform == "linux":
        os.environ.setdefault("GLOO_SOCKET_IFNAME", "lo")  # the machine's name need not resolve
    try:
        store = TCPStore(HERE, port, is_master=False, timeout=TIMEOUT)
        be_worker(store, rank, size, available_cores() // size, work)
    except WorkerLost:
        raise SystemExit(LOST) from None  # the parent says which one


def be_worker(store: Store, rank: int, size: int, cores: int, work: Work) -> Path:
    """Join the other workers, and work with so many cores; returns the run's folder.

    Raises:
        WorkerLost: another worker has ended, or does not answer.
    """
    store.set_timeout(TIMEOUT)
    with connected():
        dist.init_process_group("gloo", store=store, rank=rank, world_size=size, timeout=TIMEOUT)
    try:
        return work(Worker(rank, size, store, max(1, cores)))
    finally:
        dist.destroy_process_group()


@contextmanager
def _blocked_signals() -> Iterator[None]:
    """Signals that come within are delivered after it; processes started within begin so, too."""
    if sys.platform == "win32":
        yield
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


@contextmanager
def _forwarded_signals(context: ProcessContext) -> Iterator[None]:
    """Hand signals on to the processes."""

    def forward(number: int, frame: FrameType | None) -> None:
        for process in context.processes:
            if process.is_alive():
                os.kill(process.pid, number)

    if threading.current_thread() is not threading.main_thread():  # no other may take signals
        yield
        return
    before = {number: signal.signal(number, forward) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
