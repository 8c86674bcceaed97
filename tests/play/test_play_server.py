"""The page's server: who may reach it, and how much it takes."""

import asyncio
import json
import re
import select
import socket
import time
from contextlib import ExitStack
from importlib.resources import files

import pytest
from page_client import apart, ask, next_of, opening, talk, until
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from jansen_env.commands import play as program
from jansen_env.play import server
from jansen_env.play.server import (
    BENCH,
    BURST,
    FILES,
    HEADERS,
    MOST_CONNECTIONS,
    MOST_ERRORS,
    MOST_SOCKETS,
)
from jansen_env.play.session import SLIDERS, Session
from jansen_env.viewer.web.bench import served_bench_page


@pytest.mark.parametrize("path", FILES)
def test_files_are_served_with_a_policy(served, path):
    status, headers, body = ask(served[1], path)
    name, kind = FILES[path]
    assert status == 200 and headers["Content-Type"] == f"{kind}; charset=utf-8"
    if path == BENCH:
        assert body.decode() == served_bench_page()
    else:
        assert body == files("jansen_env.viewer.web").joinpath(name).read_bytes()
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'; script-src 'self'; " in policy and "unsafe" not in policy
    assert f"connect-src ws://{served[1]} ws://localhost:" in policy
    assert {*HEADERS} <= {*headers} and "Server" not in headers


def test_localhost_is_this_machine_too(served):
    port = served[1].split(":")[1]
    assert ask(served[1], headers=[("Host", f"localhost:{port}")])[0] == 200
    with pytest.raises(OSError):  # and nothing else is
        socket.create_connection(("127.0.0.2", int(port)), timeout=5)


@pytest.mark.parametrize(
    "hosts", [[], ["evil.example"], ["127.0.0.1:1"], ["{}.evil.example"], ["{}", "evil.example"]]
)
def test_other_hosts_are_refused(served, hosts):
    headers = [("Host", host.format(served[1])) for host in hosts]
    assert ask(served[1], headers=[*headers, ("Accept", "*/*")])[0] == 421


@pytest.mark.parametrize("method", ["HEAD", "POST", "X"])
def test_other_methods_are_refused(served, method):
    assert ask(served[1], method=method)[0] in (400, 405)


@pytest.mark.parametrize(
    "path",
    ["/play.html", "/geometry.py", "/../play/server.py", "/..%2f..%2fpyproject.toml", "/?a",
     "/play.js%00", "http://evil.example/"],
)  # fmt: skip
def test_other_paths_are_refused(served, path):
    status, headers, body = ask(served[1], path)
    assert status == 404 and body == b"404 Not Found\n" and headers["Cache-Control"] == "no-store"


@pytest.mark.parametrize("path", ["/", "/socket"])
@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://{}", "http://{}.x"])
def test_other_origins_are_refused(served, path, origin):
    headers = [("Host", served[1]), ("Origin", origin.format(served[1]))]
    assert ask(served[1], path, headers=headers)[0] == 403


@pytest.mark.parametrize("origin", [None, "http://evil.example", "http://localhost:1"])
def test_a_socket_needs_the_pages_origin(served, origin):
    with (
        pytest.raises(InvalidStatus, match="403"),
        connect(f"ws://{served[1]}/socket", origin=origin),
    ):
        pass


def test_beyond_this_machine_every_request_needs_the_token(monkeypatch):
    """Of files and sockets, whatever else they have; hosts and origins are checked as ever."""
    monkeypatch.setattr(server, "own_address", lambda: "127.0.0.1")

    def check(link):
        host, token = re.fullmatch(r"http://([\d.:]+)/([\w-]{16})/", link).groups()
        own = f"/{token}"
        for path in FILES:
            status, headers, body = ask(host, own + path)
            assert status == 200 and b'="/' not in body and headers["Referrer-Policy"]
            for other in ("", own[:-1], f"{own[:-1]}!", f"/{own}", own.swapcase()):
                assert ask(host, other + path)[0] == 403, other
        assert ask(host, f"/?{token}")[0] == ask(host, f"/play.js#{token}")[0] == 403
        assert ask(host, own)[0] == ask(host, f"{own}/..")[0] == 404
        assert ask(host, f"{own}/", headers=[("Host", "evil.example")])[0] == 421
        foreign = [("Host", host), ("Origin", "http://evil.example")]
        assert ask(host, f"{own}/", headers=foreign)[0] == 403
        with talk(host, own) as one:
            next_of(one, "state")
        for wrong in ("", f"{own[:-1]}!"):
            with pytest.raises(InvalidStatus, match="403"), talk(host, wrong):
                pass

    async def run():
        links = asyncio.Queue()
        one = asyncio.create_task(server.serve(Session(), 0, links.put_nowait, "0.0.0.0"))
        two = asyncio.create_task(server.serve(Session(), 0, links.put_nowait, "0.0.0.0"))
        first, second = await links.get(), await links.get()
        assert first.split("/")[-2] != second.split("/")[-2]
        await asyncio.to_thread(check, first)
        for task in (one, two):
            task.cancel()
        await asyncio.wait([one, two])

    apart(asyncio.run, run())


def test_a_page_steers_the_robot(served):
    with talk(served[1]) as one:
        scene = next_of(one, "scene")
        assert [slider["name"] for slider in scene["sliders"]] == list(SLIDERS)
        assert len(scene["scene"]["legs"]) == len(next_of(one, "state")["state"]["joints"]) == 4
        one.send('{"do": "hold", "direction": 1}')
        until(one, lambda state: state["input"] == 1.0)
        assert next_of(one, "state")["state"]["torque"] > 0.0
        one.send('{"do": "set", "name": "friction", "value": 0.25}')
        assert next_of(one, "scene")["sliders"][0]["value"] == 0.25
        with talk(served[1]) as other:  # which shows the same robot
            assert next_of(other, "scene")["sliders"][0]["value"] == 0.25
        one.send('{"do": "choose", "name": "robot", "value": "iron"}')
        until(one, lambda state: "robot is 'iron'" in state["message"])
        one.send('{"do": "hold", "direction": 1}')
    with talk(served[1]) as again:  # the key is up
        until(again, lambda state: state["input"] == 0.0)


def close_code(connection):
    with pytest.raises(ConnectionClosed) as closed:
        while True:
            connection.recv(timeout=10)
    return closed.value.rcvd.code


@pytest.mark.parametrize(
    ("messages", "code"),
    [
        ([json.dumps({"do": "x" * 2000})], 1009),
        (['{"do": "steer", "value": 0.0}'] * round(1.5 * BURST), 1008),
        ([b"binary"] * MOST_ERRORS + ["{}"], 1008),
    ],
    ids=["large", "many", "wrong"],
)
def test_too_much_closes_the_socket(served, messages, code):
    with talk(served[1]) as one:
        for message in messages:
            one.send(message)
        assert close_code(one) == code


def test_there_are_only_so_many_pages(served):
    with ExitStack() as pages:
        for _ in range(MOST_SOCKETS):
            pages.enter_context(talk(served[1]))
        with pytest.raises(InvalidStatus, match="503"):
            pages.enter_context(talk(served[1]))


def test_there_are_only_so_many_connections(served):
    """Those that ask for nothing make room for a page, and none for an open socket."""
    host, port = served[1].split(":")
    with ExitStack() as open_ones:
        page = open_ones.enter_context(talk(served[1]))
        idle = [
            open_ones.enter_context(socket.create_connection((host, int(port))))
            for _ in range(MOST_CONNECTIONS + 10)
        ]
        time.sleep(0.2)
        assert select.select(idle, [], [], 1.0)[0] == idle[:11]  # are closed
        assert ask(served[1])[0] == 200
        next_of(page, "state")


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
        asking.send(json.dumps({"do": "choose", "name": "control", "value": "torque"}))
        while next_of(other, "scene")["choices"]["control"] != "torque":
            pass


def test_the_end_does_not_wait_for_idle_connections(monkeypatch):
    monkeypatch.setattr(server, "PATIENCE", 60.0)

    async def run():
        addresses = asyncio.Queue()
        task = asyncio.create_task(server.serve(Session(), 0, addresses.put_nowait))
        address = await addresses.get()
        _, writer = await asyncio.open_connection(*address.removeprefix("http://").split(":"))
        await asyncio.sleep(0.1)
        task.cancel()
        assert (await asyncio.wait([task], timeout=20.0))[0] == {task}
        writer.close()

    apart(asyncio.run, run())


def test_who_asks_and_never_reads_is_cut_off(served):
    ping = b"\x89\xfd" + bytes(4) + bytes(125)
    with socket.create_connection(served[1].split(":"), timeout=10) as one:
        one.sendall(opening(served[1]))
        with pytest.raises(ConnectionError):
            for _ in range(1000):
                one.sendall(1000 * ping)
    assert ask(served[1])[0] == 200


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--port", "65536"], "--port is 65536, must be from 0 to 65535"),
     (["--env", "JansenCrank-v0"], "invalid choice: 'JansenCrank-v0'"),
     (["--robot", "tin"], "invalid choice: 'tin'"), (["--policy", "sac"], "invalid choice: 'sac'"),
     (["--level", "3"], "level is 3, must be 0 on flat ground"),
     (["--terrain", "stairs", "--level", "10"], "level is 10, must be a whole number from 0 to 9"),
     (["--host", "phone"], "--host: invalid IPv4Address value: 'phone'"),
     (["--seed", "-1"], "seed is -1, must be a whole number, 0 or above")],
)  # fmt: skip
def test_wrong_arguments(arguments, message, capsys):
    with pytest.raises(SystemExit) as ended:
        program.main(arguments)
    assert ended.value.code == 2 and message in capsys.readouterr().err


def test_an_address_of_another_machine(capsys):
    with pytest.raises(SystemExit):
        apart(program.main, ["--port", "0", "--host", "203.0.113.1"])
    assert "--host is 203.0.113.1, must be one that can be used" in capsys.readouterr().err


def test_a_port_that_is_taken(served, capsys):
    port = served[1].split(":")[1]
    with pytest.raises(SystemExit):
        apart(program.main, ["--port", port])
    assert f"--port is {port}, must be one that can be used" in capsys.readouterr().err
