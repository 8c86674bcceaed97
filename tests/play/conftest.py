"""The page's server, in a process of its own."""

import subprocess
import sys

import pytest


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """``jansen-env play``: process, host and port, and the file of its errors."""
    errors = tmp_path_factory.mktemp("served") / "stderr"
    with errors.open("wb") as stderr:
        process = subprocess.Popen(
            [sys.executable, "-m", "jansen_env", "play", "--port", "0", "--policy", "hand"],
            stdout=subprocess.PIPE, stderr=stderr, text=True,
        )  # fmt: skip
        address = process.stdout.readline().strip()
    assert address.startswith("http://127.0.0.1:"), errors.read_text()
    yield process, address.removeprefix("http://"), errors
    assert process.poll() is None
    process.terminate()
    process.communicate(timeout=10)
    assert errors.read_text() == ""
