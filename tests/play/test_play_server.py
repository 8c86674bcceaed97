"""The page's server: who may reach it, what it does, and that rubbish does no harm."""

import asyncio
import json
import random
import re
import socket
from contextlib import ExitStack

import pytest
from page_client import apart, ask, next_of, talk, until
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from jansen_env.commands import play as program
from jansen_env.play import server
from jansen_env.play.server import ACTIONS, HEADERS, MOST_PAGES, execute, parse
from jansen_env.play.session import ROBOTS, SLIDERS, TERRAINS, Session

MALFORMED = [
    "", "{", "null", "[]", '"reset"', "{}", '{"do": null}', '{"do": []}', '{"do": "__init__"}',
    '{"do": "close"}', '{"do": "reset", "now": 1}', '{"do": "steer"}', 1000 * "[",
    '{"do":' * 150 + "1" + 150 * "}", b"{}", b"\xff\xfe", "\ufeff{}", "\x00",
    '{"do": "build", "robot": "paper"}',
]  # fmt: skip
VALUES = [
    '{"do": "steer", "value": NaN}', '{"do": "steer", "value": 1e999}',
    '{"do": "steer", "value": ' + 400 * "9" + "}", '{"do": "steer", "value": "1"}',
    '{"do": "steer", "value": true}', '{"do": "hold", "direction": 0.5}',
    '{"do": "hold", "direction": true}', '{"do": "set", "name": ["friction"], "value": 1}',
    '{"do": "pause", "value": 1}', '{"do": "choose", "name": "level", "value": 1.5}',
    '{"do": "push", "x": {}, "y": 0}',
    '{"do": "choose", "name": "robot", "value": "' + 41 * "x" + '"}',
    '{"do": "build", "robot": "paper", "lengths": []}',
    '{"do": "build", "robot": "paper", "lengths": {"rocker": "1"}}',
    '{"do": "build", "robot": 3, "lengths": {}}',
    '{"do": "build", "robot": "paper", "lengths": {"rocker": NaN}}',
]  # fmt: skip


@pytest.mark.parametrize("path", ["/", "/bench"])
def test_pages_are_one_file_and_may_open_sockets(served, path):
    status, headers, body = ask(served[1], path)
    assert status == 200 and headers["Content-Type"] == "text/html; charset=utf-8"
    assert headers.items() >= HEADERS.items() and "Server" not in headers
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', body.decode())[1]
    assert policy.startswith("default-src 'none'; ") and "unsafe" not in policy
    assert f"; connect-src ws://{served[1]} ws://localhost:" in policy
    assert not re.search(r"\bsrc=|rel=.stylesheet|<!-- |@import", body.decode())


def test_localhost_is_this_machine_too(served):
    port = served[1].split(":")[1]
    assert ask(served[1], headers=[("Host", f"localhost:{port}")])[0] == 200
    with pytest.raises(OSError):  # and nothing else is
        socket.create_connection(("127.0.0.2", int(port)), timeout=5)


def test_other_requests_are_refused(served):
    """Hosts, methods, paths and origins that are not this server's."""
    host = served[1]
    accept = ("Accept", "*/*")
    for hosts in ([], ["evil.example"], ["127.0.0.1:1"], [f"{host}.evil"], [host, "evil.example"]):
        assert ask(host, headers=[*(("Host", name) for name in hosts), accept])[0] == 421
    for method in "HEAD", "POST", "X":
        assert ask(host, method=method)[0] in (400, 405)
    for path in ("/play.html", "/geometry.py", "/../play/server.py", "/..%2f..%2fpyproject.toml",
                 "/?a", "/bench%00", "http://evil.example/"):  # fmt: skip
        status, headers, body = ask(host, path)
        assert status == 404 and body == b"404 Not Found\n"
        assert headers["Cache-Control"] == "no-store"
    for origin in "http://evil.example", "null", f"https://{host}", f"http://{host}.x":
        for path in "/", "/socket":
            assert ask(host, path, headers=[("Host", host), ("Origin", origin)])[0] == 403
    for origin in None, "http://evil.example", "http://localhost:1":
        with (
            pytest.raises(InvalidStatus, match="403"),
            connect(f"ws://{host}/socket", origin=origin),
        ):
            pass


def test_beyond_this_machine_every_request_needs_the_token(monkeypatch):
    """Of files and sockets, whatever else they have; hosts and origins are checked as ever."""
    monkeypatch.setattr(server, "own_address", lambda: "127.0.0.1")

    def check(link):
        host, token = re.fullmatch(r"http://([\d.:]+)/([\w-]{16})/", link).groups()
        root = f"/{token}"
        for path in "/", "/bench":
            status, headers, body = ask(host, root + path)
            assert status == 200 and b'="/' not in body and headers["Referrer-Policy"]
            for other in ("", root[:-1], f"{root[:-1]}!", f"/{root}", root.swapcase()):
                assert ask(host, other + path)[0] == 403, other
        assert ask(host, f"/?{token}")[0] == ask(host, f"/bench#{token}")[0] == 403
        assert ask(host, root)[0] == ask(host, f"{root}/..")[0] == 404
        assert ask(host, f"{root}/", headers=[("Host", "evil.example")])[0] == 421
        foreign = [("Host", host), ("Origin", "http://evil.example")]
        assert ask(host, f"{root}/", headers=foreign)[0] == 403
        with talk(host, root) as page:
            next_of(page, "state")
        for wrong in ("", f"{root[:-1]}!"):
            with pytest.raises(InvalidStatus, match="403"), talk(host, wrong):
                pass

    async def run():
        links = asyncio.Queue()
        tasks = [
            asyncio.create_task(server.serve(Session(), 0, links.put_nowait, "0.0.0.0"))
            for _ in range(2)
        ]
        first, second = await links.get(), await links.get()
        assert first.split("/")[-2] != second.split("/")[-2]
        await asyncio.to_thread(check, first)
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)

    apart(asyncio.run, run())


def test_a_page_steers_the_robot(served):
    with talk(served[1]) as page:
        scene = next_of(page, "scene")
        assert [slider["name"] for slider in scene["sliders"]] == list(SLIDERS)
        assert len(scene["scene"]["legs"]) == len(next_of(page, "state")["state"]["joints"]) == 4
        page.send('{"do": "hold", "direction": 1}')
        until(page, lambda state: state["input"] == 1.0 and state["score"]["distance"] > 0.0)
        page.send('{"do": "set", "name": "friction", "value": 0.25}')
        assert next_of(page, "scene")["sliders"][0]["value"] == 0.25
        with talk(served[1]) as other:  # which shows the same robot
            assert next_of(other, "scene")["sliders"][0]["value"] == 0.25
        page.send('{"do": "choose", "name": "robot", "value": "iron"}')
        until(page, lambda state: "robot is 'iron'" in state["message"])
        page.send('{"do": "hold", "direction": 1}')
    with talk(served[1]) as again:  # the key is up
        until(again, lambda state: state["input"] == 0.0)


def test_a_robot_is_built_for_the_page_that_asks(served):
    """It walks for all; what is refused is answered in one line."""
    with talk(served[1]) as asking, talk(served[1]) as other:
        wanted = {"do": "build", "robot": "klann", "lengths": {"rod_AD": 0.47}}
        asking.send(json.dumps(wanted))
        assert next_of(asking, "built") == {"kind": "built"}
        while next_of(other, "scene")["lengths"] != wanted["lengths"]:
            pass  # those of the robot before it
        until(other, lambda state: state["score"]["distance"] > 0.01)
        asking.send(json.dumps({**wanted, "lengths": {"rod_AD": 0.1}}))
        message = next_of(asking, "error")["message"]
        assert message.startswith("joint D does not close at crank angle ") and "\n" not in message
        until(other, lambda state: state["message"] == message)
        asking.send(json.dumps({"do": "replay"}))
        assert next_of(asking, "replay")["page"].startswith("<!doctype html>")
        asking.send(json.dumps({"do": "choose", "name": "robot", "value": "built"}))
        asking.send(json.dumps({"do": "choose", "name": "control", "value": "hand"}))
        while next_of(other, "scene")["choices"]["control"] != "hand":
            pass


def test_messages_and_pages_are_limited(served):
    with talk(served[1]) as page:
        page.send(json.dumps({"do": "x" * 2000}))
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                page.recv(timeout=10)
        assert closed.value.rcvd.code == 1009
    with ExitStack() as pages:
        for _ in range(MOST_PAGES):
            next_of(pages.enter_context(talk(served[1])), "state")
        with pytest.raises(InvalidStatus, match="503"):
            pages.enter_context(talk(served[1]))


def test_other_messages_are_refused_and_change_nothing():
    session = Session()
    version = session.version
    for message in [*MALFORMED, *VALUES]:
        reply = execute(session, message)
        assert reply["kind"] == "error" and "must" in reply["message"], message
        assert reply["message"] == session.message and len(session.message) < 500, message
        assert session.version == version and session.input == 0.0, message
    for message in MALFORMED:
        with pytest.raises(ValueError, match="must"):
            parse(message)


def rubbish(rng):
    """A message that is nearly always wrong, some in a way nobody thought of."""
    numbers = [0, -1, 1, 0.3, 1e308, -1e-320, 10**300, True, None, "1", [], {}, [[1]]]
    kind = rng.randrange(6)
    if kind == 0:
        return rng.randbytes(rng.randrange(200))
    action = rng.choice(list(ACTIONS))
    names = [*SLIDERS, "robot", "terrain", "level", "control", "value", "__class__", ""]
    fields = {name: rng.choice(numbers) for name in ACTIONS[action]}
    if "name" in fields:
        fields["name"] = rng.choice(names)
        fields["value"] = rng.choice([*numbers, *ROBOTS, *TERRAINS, "ppo", "hand", *range(11)])
    if kind == 1:
        fields[rng.choice(names)] = rng.choice(numbers)
    text = json.dumps({"do": action, **fields})
    if kind == 2:
        cut = rng.randrange(len(text))
        text = text[:cut] + rng.choice(["", "{", '"', "\\u0000", "NaN"]) + text[cut + 1 :]
    return text


def test_rubbish_does_no_harm(served):
    """Messages, and bytes that are no request; nothing is written to the terminal."""
    process, host, errors = served
    rng, (name, port) = random.Random(0), host.split(":")
    for head in b"", b"GET / HTTP/1.1\r\n", b"GET " + 9000 * b"/", b"\x16\x03\x01":
        with socket.create_connection((name, int(port)), timeout=5) as connection:
            connection.sendall(head + rng.randbytes(rng.randrange(300)))
    with talk(host) as page:
        for _ in range(150):
            page.send(rubbish(rng))
        for message in ({"do": "pause", "value": False}, {"do": "slow", "value": 1.0},
                        {"do": "reset"}):  # fmt: skip
            page.send(json.dumps(message))
        until(page, lambda state: state["score"]["time"] <= 0.1)  # it has started again
        until(page, lambda state: state["score"]["time"] > 0.5)
    assert process.poll() is None and errors.read_text() == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--port", "65536"], "--port is 65536, must be from 0 to 65535"),
     (["--env", "JansenCrank-v0"], "invalid choice: 'JansenCrank-v0'"),
     (["--level", "3"], "level is 3, must be 0 on flat ground"),
     (["--terrain", "stairs", "--level", "10"], "level is 10, must be a whole number from 0 to 9"),
     (["--host", "phone"], "--host: invalid IPv4Address value: 'phone'"),
     (["--seed", "-1"], "seed is -1, must be a whole number, 0 or above")],
)  # fmt: skip
def test_wrong_arguments(arguments, message, capsys):
    with pytest.raises(SystemExit) as ended:
        program.main(arguments)
    assert ended.value.code == 2 and message in capsys.readouterr().err


def test_addresses_that_cannot_be_used(served, capsys):
    port = served[1].split(":")[1]
    for arguments, message in (
        (["--port", "0", "--host", "203.0.113.1"], "--host is 203.0.113.1, must be one that can"),
        (["--port", port], f"--port is {port}, must be one that can be used"),
    ):
        with pytest.raises(SystemExit):
            apart(program.main, arguments)
        assert message in capsys.readouterr().err
