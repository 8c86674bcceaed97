"""A client of the page's server."""

import http.client
import json
import re
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("websockets", reason="the extra 'tools' is not installed")

from websockets.sync.client import connect

WAIT = 10_000  # ms that a page may take


def reads(page, name, pattern, timeout=WAIT):
    """Wait until an element's text matches a pattern."""
    from playwright.sync_api import expect

    expect(page.locator(f"#{name}")).to_have_text(re.compile(pattern), timeout=timeout)


def apart(function, *arguments):
    """What a function returns in a thread: Playwright may have its event loop in this one."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(function, *arguments).result()


def ask(host, path="/", method="GET", headers=()):
    """Status and headers and body of a request; ``headers``: pairs, of which Host may be one."""
    connection = http.client.HTTPConnection(host, timeout=10)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in headers or [("Host", host)]:
        connection.putheader(name, value)
    connection.endheaders()
    response = connection.getresponse()
    return response.status, dict(response.getheaders()), response.read()


def talk(host, root="", **options):
    return connect(f"ws://{host}{root}/socket", origin=f"http://{host}", open_timeout=10, **options)


def next_of(connection, kind):
    """The next message of a kind; 10 s of others may come before it."""
    for _ in range(500):
        message = json.loads(connection.recv(timeout=10))
        if message["kind"] == kind:
            return message
    raise AssertionError(f"no {kind} comes; the last message was {message}")


def until(connection, fits):
    """The first state for which ``fits`` is true; 10 s of them may come before it."""
    for _ in range(500):
        if fits(state := next_of(connection, "state")):
            return state
    raise AssertionError(f"the last state was {state}")
