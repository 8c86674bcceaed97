"""Handling of external events that end a command, for all commands of the project.

A command that is interrupted or terminated, runs out of memory or cannot write its output ends with
at most one line and with the exit status that shells expect.
"""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import NoReturn

STOPPED = {name: getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)}
"""Signals that ask a process to end. Windows has no SIGHUP."""


@contextlib.contextmanager
def guarded(program: str) -> Iterator[None]:
    """Run a command within a context that ends it cleanly if an external event stops it.

    Ctrl-C, SIGTERM and SIGHUP unwind the stack, so that incomplete files are removed.

    Args:
        program: Name of the command, with which error messages begin.

    Raises:
        SystemExit: If the command is stopped. The status is 130 after Ctrl-C, and 128 plus the
            number of the signal after another signal. It is 1 if a pipe was closed, the output or a
            file cannot be written, or there is not enough memory.
    """
    with _handlers() as came:
        try:
            try:
                yield
            finally:  # an error when the interpreter flushes the output would print a traceback
                if sys.stdout is not None:
                    sys.stdout.flush()
        except KeyboardInterrupt:
            raise SystemExit(130) from None
        except BrokenPipeError:  # the program that read the output has ended
            _forget(sys.stdout)
            raise SystemExit(1) from None
        except MemoryError:
            _fail(program, "there is not enough memory; reduce the size of the task")
        except Exception as error:
            if came:  # a library may have turned the signal into another error, e.g. in an import
                raise SystemExit(128 + came[-1]) from None
            if not isinstance(error, OSError):
                raise
            if error.filename is None:
                _forget(sys.stdout)
            _fail(program, f"{error.filename or 'the output'}: {error.strerror or error}")


def run(program: str, main: Callable[[], object]) -> NoReturn:
    """Run the main function of a command within :func:`guarded`, and end the process.

    Args:
        program: Name of the command, with which error messages begin.
        main: Main function. If it returns an integer, this is the exit status. Any other value
            means success.
    """
    with guarded(program):
        status = main()
    raise SystemExit(status if isinstance(status, int) else 0)


@contextlib.contextmanager
def _handlers() -> Iterator[list[int]]:
    """Turn signals into exceptions, and restore the previous handlers at the end of the context.

    Yields:
        List of the numbers of the signals received so far.
    """
    came: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        came.append(number)
        if _loads_extension(frame):
            _signal_soon(number)
        elif number == signal.SIGINT:
            raise KeyboardInterrupt
        else:
            raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():
        yield came  # only the main thread receives signals
        return
    before = {number: signal.getsignal(number) for number in STOPPED.values()}
    interrupt = signal.getsignal(signal.SIGINT)
    unraisable = sys.unraisablehook
    sys.unraisablehook = functools.partial(_stop_again, came, unraisable)
    for number in STOPPED.values():
        if before[number] is signal.SIG_DFL:  # nohup, for example, ignores the signal
            signal.signal(number, stop)
    if interrupt in (signal.SIG_DFL, signal.default_int_handler):  # a shell may ignore the signal
        signal.signal(signal.SIGINT, stop)
    try:
        yield came
    finally:
        signal.signal(signal.SIGINT, interrupt or signal.SIG_DFL)
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
        sys.unraisablehook = unraisable


def _stop_again(
    came: list[int],
    report: Callable[[sys.UnraisableHookArgs], object],
    ignored: sys.UnraisableHookArgs,
) -> None:
    """Send a signal again if its exception was raised where Python ignores exceptions.

    Python ignores exceptions in destructors and in callbacks from C, for example where pymunk frees
    shapes.
    """
    if came and isinstance(ignored.exc_value, (SystemExit, KeyboardInterrupt)):
        _signal_soon(came[-1])
    else:
        report(ignored)


def _loads_extension(frame: FrameType | None) -> bool:
    """Return whether an extension module is being loaded.

    Its code in C may import other modules and ignore their exceptions, as ``pygame.image`` does.
    """
    while frame is not None:
        if isinstance(frame.f_locals.get("self"), ExtensionFileLoader):
            return True
        frame = frame.f_back
    return False


def _signal_soon(number: int) -> None:
    """Send a signal again, after the main thread has left code in which exceptions are ignored."""
    again = threading.Timer(0.01, _signal_main_thread, [number])
    again.daemon = True
    again.start()


def _signal_main_thread(number: int) -> None:
    """Send a signal to the main thread, which runs the command and may be sleeping or waiting."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:  # Windows
        signal.raise_signal(number)


def _fail(program: str, reason: str) -> NoReturn:
    """End the process with status 1, after printing an error message of one line if possible."""
    with contextlib.suppress(OSError):
        print(f"{program}: error: {reason}", file=sys.stderr, flush=True)
    raise SystemExit(1) from None


def _forget(stream: object) -> None:
    """Discard the buffered data of a stream, so that the interpreter does not try to write them."""
    with contextlib.suppress(AttributeError, OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[attr-defined]
        os.close(nowhere)
