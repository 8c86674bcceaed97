"""Places where a study's runs are executed, and again where lost: local processes, Ray's tasks."""

from __future__ import annotations

import multiprocessing
import os
import secrets
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from multiprocessing.connection import wait as wait_for
from typing import Any

from agents.studies.run import RunResult, execute_run
from agents.training.callbacks import StopOnSignal
from agents.training.process import HANGUP
from jansen_env.cores import available_cores

RETRIES = 10  # of a run whose process or machine was lost
TICK = 1.0  # s between two looks at the runs
ANSWER = 10.0  # s for a cluster to answer
STOPPING, AGAIN = 120.0, 15.0  # s for runs to save checkpoints, and between two calls to do so
LOST = RunResult("lost", f"its process was lost {RETRIES + 1} times")
STOPPED = RunResult("stopped")
OBJECT_STORE = 80_000_000  # bytes, nearly the least that Ray takes: runs pass files, not objects
TOKENS = ("make one with 'ray get-auth-token --generate', copy ~/.ray/auth_token to all machines, "
          "and set RAY_AUTH_MODE=token for each 'ray start'")  # fmt: skip
QUESTION = "/ray.rpc.NodeInfoGcsService/CheckAlive"

Watch = Callable[[dict[str, RunResult]], None]
"""Called every :data:`TICK` with the results so far, by the runs' names."""


def has_ray() -> bool:
    """Return whether Ray is installed."""
    return find_spec("ray") is not None


def run_locally(
    requests: Sequence[Any], workers: int, watch: Watch,
    execute_one: Callable[[Any], RunResult] = execute_run,
) -> dict[str, RunResult]:  # fmt: skip
    """Execute runs in so many local processes side by side, and return the result of each by name.

    A request has a ``name`` and ``cores``, and is what ``execute_one`` takes.

    On Ctrl-C, runs in training save checkpoints before this returns.
    """
    context = multiprocessing.get_context("spawn")  # a process with threads must not be forked

    def execute(request: Any) -> RunResult:
        """Execute a run in a new process; retry if the process dies."""
        for _ in range(RETRIES + 1):
            if stop.signal:
                return STOPPED
            with (
                ProcessPoolExecutor(1, context, initializer=_begin_worker) as pool,
                suppress(BrokenProcessPool),
            ):
                return pool.submit(execute_one, request).result()
        return LOST

    with StopOnSignal() as stop, ThreadPoolExecutor(workers) as threads:
        futures = {threads.submit(execute, request): request.name for request in requests}
        while wait(futures, TICK).not_done and not stop.signal:
            watch({name: f.result() for f, name in futures.items() if f.done()})
        if stop.signal:
            for process in multiprocessing.active_children():
                process.terminate()  # SIGTERM: a run in training saves a checkpoint
    results = {name: future.result() for future, name in futures.items()}
    watch(results)
    return results


def _begin_worker() -> None:
    """Leave a terminal's signals to the driver, which passes them on; end with it, even killed."""
    for number in (signal.SIGINT, *HANGUP):
        signal.signal(number, signal.SIG_IGN)
    driver = multiprocessing.parent_process()

    def follow() -> None:
        assert driver is not None
        wait_for([driver.sentinel])
        os._exit(1)  # a run left behind would be in the way of the same command given again

    threading.Thread(target=follow, daemon=True).start()


def run_on_ray(
    requests: Sequence[Any], address: str | None, watch: Watch,
    execute_one: Callable[[Any], RunResult] = execute_run,
) -> dict[str, RunResult]:  # fmt: skip
    """Execute runs as tasks of Ray, which begins those lost with a process or node again, else as
    :func:`run_locally`; without an address on a new cluster of this machine's cores.

    Raises:
        ConnectionError: there is no cluster at the address, or it asks for no token.
    """
    results: dict[str, RunResult] = {}
    with _cluster(address) as ray, StopOnSignal() as stop:
        task = ray.remote(execute_one)
        names = {
            task.options(
                num_cpus=request.cores, max_retries=RETRIES, name=request.name
            ).remote(request): request.name
            for request in requests
        }  # fmt: skip
        while names and not stop.signal:
            _collect(ray, names, results, TICK)
            watch(results)
        end = time.monotonic() + STOPPING
        while names and time.monotonic() < end:
            for ref in names:
                ray.cancel(ref)  # as SIGINT: a run in training saves a checkpoint
            # Again after a while: an interrupt within a callback from C is lost.
            _collect(ray, names, results, AGAIN, len(names))
        results |= dict.fromkeys(names.values(), STOPPED)
        watch(results)
    return results


def _collect(
    ray: Any, names: dict[Any, str], results: dict[str, RunResult], seconds: float, count: int = 1
) -> None:
    """Wait for some tasks, and move those that have ended from ``names`` to ``results``."""
    ray.wait(list(names), num_returns=count, timeout=seconds)
    for ref in ray.wait(list(names), num_returns=len(names), timeout=0)[0]:
        try:
            result = ray.get(ref)
        except ray.exceptions.TaskCancelledError:
            result = STOPPED
        except ray.exceptions.RayTaskError as error:  # such as a package missing there
            result = RunResult("failed", str(error.cause))
        except ray.exceptions.RayError as error:
            result = RunResult("lost", f"{type(error).__name__}: {' '.join(str(error).split())}")
        results[names.pop(ref)] = result


@contextmanager
def _cluster(address: str | None) -> Iterator[Any]:
    """Give Ray's module, connected to a cluster, or to a new one that ends with the context."""
    common: dict[str, Any] = {
        "log_to_driver": False, "logging_level": "ERROR",
        "runtime_env": {"env_vars": {"OMP_NUM_THREADS": "1"}},  # before workers load torch
    }  # fmt: skip
    place = "/tmp" if os.path.isdir("/tmp") else None  # names of sockets may have 100 characters
    with tempfile.TemporaryDirectory("", "jansen-ray-", place, True) as folder:
        new = {"num_cpus": available_cores(), "include_dashboard": False, "_temp_dir": folder,
               "object_store_memory": OBJECT_STORE}  # fmt: skip
        ray = connect_ray(address, **common, **(new if address is None else {}))
        try:
            yield ray
        finally:
            ray.shutdown()


def connect_ray(address: str | None, **options: Any) -> Any:
    """Return Ray's module, connected to a cluster, or to a new one on this machine.

    Ray listens on all network interfaces and runs what it is sent: so only clusters that ask for a
    token are used, and a new one gets a token that this process and its children alone know.

    Raises:
        ConnectionError: there is no cluster at the address, or it asks for no token.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
    os.environ["RAY_AUTH_MODE"] = "token"  # before Ray is loaded
    new = address in (None, "local")
    if new:
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    elif ":" in str(address) and "/" not in str(address):
        _check_answers(str(address))
    import ray

    try:
        ray.init(address=address or "local", **options)
    except ray.exceptions.AuthenticationError as error:
        raise ConnectionError(f"no token for the Ray cluster is found here: {TOKENS}") from error
    if not new and _answers_anybody(at := ray.get_runtime_context().gcs_address):
        ray.shutdown()
        raise ConnectionError(f"the Ray cluster at {at} asks for no token, so that whoever can "
                              f"connect may run anything: {TOKENS}")  # fmt: skip
    return ray


def _check_answers(address: str) -> None:
    """Raise a ConnectionError where nobody answers; Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), ANSWER).close()
    except (OSError, OverflowError, ValueError) as error:
        raise ConnectionError(f"no Ray cluster answers at {address}: {error}") from error


def _answers_anybody(address: str) -> bool:
    """Return whether a cluster answers a client that has no token."""
    import grpc

    with grpc.insecure_channel(address, [("grpc.enable_http_proxy", 0)]) as channel:
        try:
            channel.unary_unary(QUESTION)(b"", timeout=ANSWER)
        except grpc.RpcError:
            return False
    return True
