"""Workers of a data-parallel run as actors on a Ray cluster, placed by Ray."""

from __future__ import annotations

import importlib.util
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from torch.distributed import TCPStore  # type: ignore[attr-defined]

from agents.data_parallel import Worker, WorkerLost
from agents.launch import HERE, LOST, TIMEOUT, Work, be_worker
from agents.process import SIGNALS
from agents.studies.backends import connect_ray

POLL = 0.5  # s between looks at signals
PATIENCE = 600.0  # s to wait for cores that other work holds
LOCAL: dict[str, Any] = {"include_dashboard": False, "object_store_memory": 80 * 2**20}
"""Of a cluster that is started here: nothing large is passed around."""
Ended = tuple[int | str, str]
"""A worker's exit status, 0 for success, or the line that says why; and the run's folder."""


def check_ray() -> None:
    """Check that there is Ray.

    Raises:
        ValueError: it is not installed.
    """
    if importlib.util.find_spec("ray") is None:
        raise ValueError("--address needs Ray, which the extra 'distributed' installs: "
                         'pip install "jansen-env[distributed]"')  # fmt: skip


class RayWorker:
    """What an actor does. Two threads: :meth:`stop` is heard while :meth:`work` goes on."""

    def __init__(self) -> None:
        self._worker: Worker | None = None
        self._stopped_by = 0

    def serve(self, alone: bool) -> tuple[str, int]:
        """Open the store that all workers have in common; return its address and port.

        Whoever can connect may write to it, so it listens on one address alone: the loopback
        interface's where all workers are on this node (``alone``), the node's otherwise.
        """
        import ray

        address = HERE if alone else ray.util.get_node_ip_address()  # type: ignore[no-untyped-call]
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        listener = socket.create_server((address, 0), family=family)
        port = listener.getsockname()[1]
        self._store = TCPStore(
            address, port, is_master=True, wait_for_workers=False,
            master_listen_fd=listener.detach(),
        )  # fmt: skip
        return address, port

    def work(self, rank: int, size: int, cores: int, at: tuple[str, int], work: Work) -> Ended:
        """Join the others, and work."""

        def known(worker: Worker) -> Path:
            self._worker = worker
            worker.stop.came = self._stopped_by
            return work(worker)

        if at[0] == HERE and sys.platform == "linux":
            os.environ.setdefault("GLOO_SOCKET_IFNAME", "lo")
        store = TCPStore(*at, is_master=False, timeout=TIMEOUT)
        try:
            return 0, str(be_worker(store, rank, size, cores, known))
        except WorkerLost:
            return LOST, ""
        except SystemExit as error:  # would end the actor, and its status be lost
            return error.code or 0, ""

    def stop(self, number: int) -> None:
        """End training as after a signal."""
        self._stopped_by = number
        if self._worker is not None:
            self._worker.stop.came = number


def run_on_ray(address: str, workers: int, cores: int, work: Work) -> Path:
    """Train with so many actors of ``cores`` each; returns the run's folder, on the first's node.

    Ray places all of them or none, on as few nodes as it can. SIGINT, SIGTERM and SIGHUP end
    training of all.

    Args:
        address: of the cluster, ``"auto"`` for the one this machine is part of, ``"local"`` for
            a new one on this machine alone.

    Raises:
        SystemExit: no such cluster, one that asks for no token, too few cores, or a worker has
            ended early.
    """
    try:
        ray = connect_ray(
            address, logging_level=logging.WARNING, **(LOCAL if address == "local" else {})
        )
    except (ConnectionError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise SystemExit(f"train.py: error: --address is {address!r}: {reason}") from error
    try:
        return _run(ray, workers, cores, work)
    finally:
        ray.shutdown()


def _run(ray: Any, workers: int, cores: int, work: Work) -> Path:
    """:func:`run_on_ray` on a cluster that is connected."""
    there = int(ray.cluster_resources().get("CPU", 0))
    if workers * cores > there:
        raise SystemExit(f"train.py: error: {workers} workers of {cores} cores are asked for, the "
                         f"cluster has {there} cores")  # fmt: skip
    places = ray.util.placement_group([{"CPU": cores}] * workers, strategy="PACK")
    if not places.wait(PATIENCE):
        raise SystemExit(f"train.py: error: {workers} times {cores} cores did not get free within "
                         f"{PATIENCE:.0f} s")  # fmt: skip
    actor = ray.remote(num_cpus=cores, max_concurrency=2)(RayWorker)
    actors = [
        actor.options(
            scheduling_strategy=ray.util.scheduling_strategies.PlacementGroupSchedulingStrategy(
                places, placement_group_bundle_index=rank
            )
        ).remote()
        for rank in range(workers)
    ]
    with _noted_signals() as signals:
        nodes = ray.util.placement_group_table(places)["bundles_to_node_id"].values()
        at = ray.get(actors[0].serve.remote(len({*nodes}) == 1))
        running = {
            one.work.remote(rank, workers, cores, at, work): rank for rank, one in enumerate(actors)
        }
        ended: dict[int, Ended] = {}
        while len(ended) < workers:
            while signals:
                number = signals.pop()
                ray.get([one.stop.remote(number) for one in actors])
            waiting = [task for task, rank in running.items() if rank not in ended]
            for task in ray.wait(waiting, timeout=POLL)[0]:
                ended[running[task]] = _ended(ray, task, running[task])
            if any(status not in (0, LOST) for status, _ in ended.values()):
                break
    for status, _ in sorted(ended.values(), key=lambda one: one[0] == LOST):
        if status != 0:
            raise SystemExit(status)
    return Path(ended[0][1])


def _ended(ray: Any, task: Any, rank: int) -> Ended:
    """How a worker has ended."""
    try:
        result: Ended = ray.get(task)
    except ray.exceptions.RayActorError:
        return f"train.py: error: worker {rank} is gone, its process or its node has died; python "\
               "train.py --resume RUN goes on from what is saved", ""  # fmt: skip
    return result


@contextmanager
def _noted_signals() -> Iterator[list[int]]:
    """The numbers of the signals that have come."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():  # no other may take signals
        yield came
        return
    before = {
        number: signal.signal(number, lambda number, frame: came.append(number))
        for number in SIGNALS
        if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
