"""Signals that end training, and output that nobody reads any more."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
from typing import Any

HANGUP = (signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()  # a closed terminal's
SIGNALS = (signal.SIGINT, signal.SIGTERM, *HANGUP)
UNREAD = {errno.EPIPE, errno.EIO, errno.EINVAL}  # of a pipe, of a terminal, of a pipe of Windows


class _Output(io.FileIO):
    """A file that drops what is written once its reader has gone."""

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in UNREAD:
                raise
            return memoryview(data).nbytes


def outlive_readers() -> None:
    """Let this process go on when nobody reads its output any more, as after ``| head``."""
    for name in ("stdout", "stderr"):
        stream: Any = getattr(sys, name)
        console = os.name == "nt" and stream is not None and stream.isatty()  # has its own writer
        if type(stream) is not io.TextIOWrapper or console:  # a notebook's, or none
            continue
        file: Any = _Output(stream.fileno(), "w", closefd=False)
        text = io.TextIOWrapper(
            file if stream.write_through else io.BufferedWriter(file), stream.encoding,
            stream.errors, None, stream.line_buffering, stream.write_through,
        )  # fmt: skip
        setattr(sys, name, text)
