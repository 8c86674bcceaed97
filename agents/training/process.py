"""Signals that end training, and output that nobody reads any more."""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from typing import Any

HANGUP = (signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()  # a closed terminal's
SIGNALS = (signal.SIGINT, signal.SIGTERM, *HANGUP)


class _Output:
    """A stream that drops what is written once its reader has gone."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            self._stream.flush()


def outlive_readers() -> None:
    """Let this process go on when nobody reads its output any more, as after ``| head``."""
    sys.stdout, sys.stderr = _Output(sys.stdout), _Output(sys.stderr)
