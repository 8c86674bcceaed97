"""Messages to the page's server: held to a schema, and rubbish does no harm."""

import asyncio
import json
import random
import socket
import time

import pytest
from page_client import apart, ask, opening, talk, until
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed, InvalidStatus

from jansen_env.play.server import ACTIONS, MOST_ERRORS, Page, parse
from jansen_env.play.session import ROBOTS, SLIDERS, TERRAINS, Session

MALFORMED = [
    "", " ", "{", "null", "[]", "3", '"reset"', "{}", '{"do": null}', '{"do": []}', '{"do": "run"}',
    '{"do": "__init__"}', '{"do": "close"}', '{"do": "advance"}', '{"do": "reset", "now": 1}',
    '{"do": "steer"}', 1000 * "[", '{"do":' * 150 + "1" + 150 * "}", b"{}", b"\xff\xfe",
    '{"do": "choose", "name": "level"}', "\ufeff{}", "\x00", '{"do": "replay", "value": 1}',
    '{"do": "build", "robot": "paper"}',
]  # fmt: skip
VALUES = [
    '{"do": "steer", "value": NaN}', '{"do": "steer", "value": 1e999}',
    '{"do": "steer", "value": ' + 400 * "9" + "}", '{"do": "steer", "value": "1"}',
    '{"do": "steer", "value": true}', '{"do": "steer", "value": null}',
    '{"do": "hold", "direction": 0.5}', '{"do": "hold", "direction": true}',
    '{"do": "set", "name": ["friction"], "value": 1}', '{"do": "pause", "value": 1}',
    '{"do": "choose", "name": "level", "value": 1.5}', '{"do": "push", "x": {}, "y": 0}',
    '{"do": "choose", "name": "robot", "value": "' + 41 * "x" + '"}',
    '{"do": "build", "robot": "paper", "lengths": []}',
    '{"do": "build", "robot": "paper", "lengths": {"rocker": "1"}}',
    '{"do": "build", "robot": 3, "lengths": {}}',
    '{"do": "build", "robot": "paper", "lengths": {"rocker": NaN}}',
    '{"do": "build", "robot": "paper", "lengths": {"' + 41 * "x" + '": 1}}',
]  # fmt: skip
WRONG = [*MALFORMED, *VALUES]


@pytest.mark.parametrize("message", MALFORMED, ids=lambda m: repr(m)[:40])
def test_other_messages_are_refused(message):
    with pytest.raises(ValueError, match="must") as refused:
        parse(message)
    assert len(str(refused.value)) < 500


def test_other_values_are_refused_and_change_nothing():
    session = Session()
    page, before = Page(session, 1), session.version
    for message in VALUES:
        session.say("")
        page._do(*parse(message))
        assert "must" in session.message and len(session.message) < 500, message
        assert session.version == before and session.input == 0.0, message


def rubbish(rng):
    """A message that is nearly always wrong, some in a way nobody thought of."""
    numbers = [0, -1, 1, 0.3, 1e308, -1e-320, 10**300, True, None, "1", [], {}, [[1]]]
    kind = rng.randrange(8)
    if kind == 0:
        return rng.randbytes(rng.randrange(200))
    if kind == 1:
        return "".join(chr(rng.choice([rng.randrange(1, 128), rng.randrange(0xE000, 0x10FFFF)]))
                       for _ in range(rng.randrange(100)))  # fmt: skip
    if kind == 2:
        return rng.choice(WRONG)
    action = rng.choice(list(ACTIONS))
    names = [*SLIDERS, "robot", "terrain", "level", "control", "value", "__class__", ""]
    fields = {name: rng.choice(numbers) for name in ACTIONS[action]}
    if "name" in fields and rng.random() < 0.8:
        fields["name"] = rng.choice(names)
        fields["value"] = rng.choice([*numbers, *ROBOTS, *TERRAINS, "ppo", "torque", *range(11)])
    if kind == 3:
        fields[rng.choice(names)] = rng.choice(numbers)
    text = json.dumps({"do": action, **fields})
    if kind == 4:
        cut = rng.randrange(len(text))
        text = text[:cut] + rng.choice(["", "{", '"', "\\u0000", "NaN"]) + text[cut + 1 :]
    return text


async def throw(host, seed, count):
    """Send ``count`` messages of rubbish, over as many sockets as it takes."""
    rng, sent = random.Random(seed), 0
    while sent < count:
        try:
            async with connect_async(
                f"ws://{host}/socket", origin=f"http://{host}", max_queue=None
            ) as one:  # which reads, whatever the test does
                for _ in range(min(MOST_ERRORS, count - sent)):
                    await one.send(rubbish(rng))
                    sent += 1
                if rng.random() < 0.1:
                    one.transport.abort()
        except (ConnectionClosed, InvalidStatus, EOFError, OSError):
            continue
    return sent


def throw_bytes(host, seed):
    """Bytes that are no request, or no frames after one."""
    rng, address, start = random.Random(seed), host.split(":"), opening(host)
    for head in (b"", b"GET / HTTP/1.1\r\n", b"GET " + 9000 * b"/", b"\x16\x03\x01", start,
                 start[: rng.randrange(len(start))] + b"\r\n\r\n"):  # fmt: skip
        with socket.create_connection((address[0], int(address[1])), timeout=5) as one:
            one.sendall(head + rng.randbytes(rng.randrange(300)))


@pytest.mark.parametrize("messages", [100, pytest.param(2000, marks=pytest.mark.slow)])
def test_rubbish_does_no_harm(served, messages):
    process, host, errors = served

    async def both(count):
        return sum(await asyncio.gather(*(throw(host, seed, count // 2) for seed in range(2))))

    assert apart(asyncio.run, both(messages)) == messages
    for seed in range(20):
        throw_bytes(host, seed)
    assert process.poll() is None and errors.read_text() == ""
    time.sleep(0.5)  # until the last ones are known to be closed
    assert ask(host)[0] == 200
    with talk(host) as one:
        for message in ({"do": "pause", "value": False}, {"do": "slow", "value": 1.0},
                        {"do": "reset"}):  # fmt: skip
            one.send(json.dumps(message))
        until(one, lambda state: state["score"]["time"] <= 0.1)  # it has started again
        until(one, lambda state: state["score"]["time"] > 0.5)
