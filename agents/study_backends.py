"""Where a study's runs are performed: in local processes, or as tasks of Ray.

Both give an order to :func:`agents.study_runs.perform` in a process with nothing else to do, and
again when that process was lost; all a run needs to go on is in its folder.
"""

from __future__ import annotations

import multiprocessing
import os
import secrets
import shutil
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib.util import find_spec
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from agents.process import HANGUP, SIGNALS, after_the_first
from agents.study_runs import Order, Outcome, perform
from jansen_env.cores import available_cores
from jansen_env.files import remove_unused

RETRIES = 10  # of a run whose process or machine was lost
TICK = 1.0  # s between two looks at the runs
ANSWER = 10.0  # s for a cluster to answer
STOPPING, AGAIN = 120.0, 15.0  # s for runs to save checkpoints, and between two calls to do so
LOST = Outcome("lost", f"its process was lost {RETRIES + 1} times")
STOPPED = Outcome("stopped")
OBJECT_STORE = 80_000_000  # bytes, nearly the least that Ray takes: runs pass files, not objects
TEMPORARY, UNUSED = "jansen-ray-", 7 * 86_400.0  # s after which one is taken to be nobody's
TOKENS = ("make one with 'ray get-auth-token --generate', copy ~/.ray/auth_token to all machines, "
          "and set RAY_AUTH_MODE=token for each 'ray start'")  # fmt: skip
QUESTION = "/ray.rpc.NodeInfoGcsService/CheckAlive"
ENVIRONMENT = {"OMP_NUM_THREADS": "1"}  # of workers, before they load torch

Watch = Callable[[dict[str, Outcome]], None]
"""Called every :data:`TICK` with the outcomes so far, by the runs' names."""


def has_ray() -> bool:
    """Whether Ray is installed."""
    return find_spec("ray") is not None


@contextmanager
def stopped_by_signal() -> Iterator[threading.Event]:
    """An event that SIGINT (Ctrl-C), SIGTERM or SIGHUP sets; a second Ctrl-C ends this at once.

    No exception, which libraries' callbacks might swallow.
    """
    stop = threading.Event()

    def take(*_: object) -> None:
        stop.set()
        for number in SIGNALS:
            signal.signal(number, after_the_first(number))

    before = {
        number: signal.signal(number, take)
        for number in SIGNALS
        if signal.getsignal(number) != signal.SIG_IGN  # as in the background of a shell
    }
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# Local processes


def run_locally(orders: Sequence[Order], workers: int, watch: Watch) -> dict[str, Outcome]:
    """Perform orders in local processes, by ``concurrent.futures``.

    Args:
        orders: of runs. workers: processes side by side. watch: see :data:`Watch`.

    Returns:
        How each run ended, by its name. After Ctrl-C the running ones have saved checkpoints.
    """
    pools: SimpleQueue[ProcessPoolExecutor] = SimpleQueue()
    for _ in range(workers):
        pools.put(new_pool())

    def one(order: Order) -> Outcome:
        """In a pool of one process, so that one that is lost takes no other with it."""
        for _ in range(RETRIES + 1):
            if stop.is_set():
                return STOPPED
            pool = pools.get()
            try:
                return pool.submit(perform, order).result()
            except BrokenProcessPool:
                pool = new_pool()
            finally:
                pools.put(pool)
        return LOST

    with stopped_by_signal() as stop, ThreadPoolExecutor(workers) as threads:
        futures = {threads.submit(one, order): order.run.name for order in orders}
        while wait(futures, TICK).not_done and not stop.is_set():
            watch(_outcomes(futures))
        if stop.is_set():
            for process in multiprocessing.active_children():
                process.terminate()  # SIGTERM: a run in training saves a checkpoint
    for _ in range(workers):
        pools.get().shutdown()
    outcomes = _outcomes(futures)
    watch(outcomes)
    return outcomes


def _outcomes(futures: dict[Future[Outcome], str]) -> dict[str, Outcome]:
    return {name: future.result() for future, name in futures.items() if future.done()}


def new_pool() -> ProcessPoolExecutor:
    """One process, which ends with this one."""
    # Spawned, not forked: a process with threads must not be forked.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, context, initializer=_begin_worker)


def _begin_worker() -> None:
    """In a new process: a terminal's signals are for the driver alone, whose end is this one's too.

    The driver passes them on as SIGTERM. Killed, it can tell nobody, and a run left behind would
    be in the way of the same command given again.
    """
    for number in (signal.SIGINT, *HANGUP):
        signal.signal(number, signal.SIG_IGN)
    driver = multiprocessing.parent_process()

    def follow() -> None:
        assert driver is not None
        wait_for([driver.sentinel])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


# Ray


def run_on_ray(orders: Sequence[Order], address: str | None, watch: Watch) -> dict[str, Outcome]:
    """Perform orders as tasks of Ray, each with its cores; what is lost with a node is run again.

    Args:
        orders: of runs. address: of a cluster to join, "auto" for that of this machine; None for
            one of this machine's cores, for as long as the study takes. watch: see :data:`Watch`.

    Returns:
        How each run ended, by its name. After Ctrl-C the running ones have saved checkpoints.

    Raises:
        ConnectionError: there is no cluster at the address.
    """
    outcomes: dict[str, Outcome] = {}
    with ray_cluster(address) as ray, stopped_by_signal() as stop:
        task = ray.remote(perform)
        names = {
            task.options(
                num_cpus=order.cores, max_retries=RETRIES, name=order.run.name
            ).remote(order): order.run.name
            for order in orders
        }  # fmt: skip
        while names and not stop.is_set():
            _collect(ray, names, outcomes, TICK)
            watch(outcomes)
        if names:
            end = time.monotonic() + STOPPING
            while names and time.monotonic() < end:
                for ref in names:
                    ray.cancel(ref)  # as SIGINT: a run in training saves a checkpoint
                # Again after a while: an interrupt within a callback from C is lost.
                _collect(ray, names, outcomes, AGAIN, all_of_them=True)
            outcomes.update(dict.fromkeys(names.values(), STOPPED))
            watch(outcomes)
    return outcomes


def _collect(
    ray: Any,
    names: dict[Any, str],
    outcomes: dict[str, Outcome],
    seconds: float,
    all_of_them: bool = False,
) -> None:
    """Move what is done from ``names`` to ``outcomes``."""
    done, _ = ray.wait(list(names), num_returns=len(names) if all_of_them else 1, timeout=seconds)
    if not all_of_them:  # one has ended; so may others have
        done, _ = ray.wait(list(names), num_returns=len(names), timeout=0)
    for ref in done:
        try:
            outcome = ray.get(ref)
        except ray.exceptions.TaskCancelledError:
            outcome = STOPPED
        except ray.exceptions.RayTaskError as error:  # such as a package missing there
            outcome = Outcome("failed", str(error.cause))
        except ray.exceptions.RayError as error:
            outcome = Outcome("lost", f"{type(error).__name__}: {' '.join(str(error).split())}")
        outcomes[names.pop(ref)] = outcome


def _check_address(address: str) -> None:
    """Raises ConnectionError where nobody answers; Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    if not host or "/" in host or not port.isdecimal():
        return  # "auto", or one of another kind
    try:
        socket.create_connection((host, int(port)), ANSWER).close()
    except (OSError, OverflowError) as error:
        raise ConnectionError(f"no Ray cluster answers at {address}: {error}") from error


def connect_ray(address: str | None, **options: Any) -> Any:
    """Ray's module, connected to a cluster, or to a new one on this machine.

    Ray listens on all network interfaces and runs what it is sent: so only clusters that ask for a
    token are used, and a new one gets a token that this process and its children alone know.

    Args:
        address: of a cluster to join; None or "local" for a new one. options: of ``ray.init``.

    Raises:
        ConnectionError: there is no cluster at the address, or it asks for no token.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
    os.environ["RAY_AUTH_MODE"] = "token"  # before Ray is loaded
    new = address in (None, "local")
    if new:
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
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


def _answers_anybody(address: str) -> bool:
    """Return whether a cluster answers a client that has no token."""
    import grpc

    with grpc.insecure_channel(address, [("grpc.enable_http_proxy", 0)]) as channel:
        try:
            channel.unary_unary(QUESTION)(b"", timeout=ANSWER)
        except grpc.RpcError:
            return False
    return True


@contextmanager
def ray_cluster(address: str | None) -> Iterator[Any]:
    """Ray's module, connected to a cluster, or to a new one that ends with the context.

    Raises:
        ConnectionError: there is no cluster at the address, or it asks for no token.
    """
    common: dict[str, Any] = {
        "log_to_driver": False, "logging_level": "ERROR", "runtime_env": {"env_vars": ENVIRONMENT},
    }  # fmt: skip
    folder = None
    if address is None:
        # Those that killed drivers left go too. Names of sockets may have 100 characters or so.
        place = Path("/tmp" if os.path.isdir("/tmp") else tempfile.gettempdir())
        remove_unused(place.glob(f"{TEMPORARY}*"), UNUSED)
        folder = tempfile.mkdtemp(prefix=TEMPORARY, dir=place)
        ray = connect_ray(
            None, num_cpus=available_cores(), include_dashboard=False, _temp_dir=folder,
            object_store_memory=OBJECT_STORE, **common,
        )  # fmt: skip
    else:
        _check_address(address)
        ray = connect_ray(address, **common)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # in place of Ray's, which aborts
    try:
        yield ray
    finally:
        ray.shutdown()
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
