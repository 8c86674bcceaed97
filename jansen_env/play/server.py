"""A session on a web page: served on 127.0.0.1 unless asked otherwise, with states by websocket.

All open pages show and change the same session; time stands still while none is open.

A page of another site may be open in the same browser and must not reach the robot: the ``Host``
of a request must be this server's (against DNS rebinding), an ``Origin`` too, and a socket needs
one. Beyond this machine every request needs the link's random token, too. Messages to the server
are small :data:`ACTIONS` of the session, which checks their values.
"""

from __future__ import annotations

import asyncio
import json
import logging
import socket
from collections.abc import Callable
from dataclasses import asdict
from http import HTTPStatus
from ipaddress import ip_address
from secrets import compare_digest, token_urlsafe
from time import monotonic

import numpy as np
from websockets.asyncio.server import ServerConnection, broadcast
from websockets.asyncio.server import serve as serve_sockets
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from jansen_env.checks import one_of, shown
from jansen_env.play.session import BY_HAND, LARGEST_PUSH, PACES, SLIDERS, Session
from jansen_env.viewer.web.bench import bench_page
from jansen_env.viewer.web.geometry import scene_of_robot, state_of_frame
from jansen_env.viewer.web.page import page as replay_page
from jansen_env.viewer.web.page import page_of

ADDRESS = "127.0.0.1"
SOCKET = "/socket"
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",  # the pages have the rest
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
FRAME_TIME = 0.02  # s between two states that are sent
MOST_BYTES = 1024  # of a message to the server
MOST_UNREAD = 2**16  # bytes on their way to a page, beyond which it skips states
PATIENCE = 3.0  # s for a request to be complete
MOST_PAGES = 4
LOGGER = logging.getLogger("jansen_env.play")
# Clients' errors give no traceback in the terminal; errors of the handler do.
LOGGER.addFilter(lambda record: "handler failed" in str(record.msg))

ACTIONS = {
    "steer": {"value"},
    "hold": {"direction"},
    "set": {"name", "value"},
    "choose": {"name", "value"},
    "build": {"robot", "lengths"},
    "push": {"x", "y"},
    "pause": {"value"},
    "slow": {"value"},
    "reset": set[str](),
    "another": set[str](),
    "replay": set[str](),
}
"""Arguments of each action; nothing else of a session can be reached."""


def parse(message: str | bytes) -> tuple[str, dict[str, object]]:
    """Return an action of a session, and its arguments, from a message.

    Raises:
        ValueError: it is no text, no JSON, no action or has other arguments.
    """
    try:
        content = json.loads(message) if isinstance(message, str) else None
    except (RecursionError, ValueError) as error:
        raise ValueError(f"message is {shown(message)}, must be JSON") from error
    if not isinstance(content, dict) or "do" not in content:
        raise ValueError(f"message is {shown(message)}, must be an object that says what to do")
    action = one_of("do", content.pop("do"), ACTIONS)
    if {*content} != ACTIONS[action]:
        raise ValueError(
            f"{action} has {shown(sorted(content))}, must have {sorted(ACTIONS[action])}"
        )
    return action, content


def execute(session: Session, message: str | bytes) -> dict[str, object] | None:
    """Do what a message asks for, and return the answer to its sender alone, if there is one."""
    try:
        action, arguments = parse(message)
        if action == "replay":
            return {"kind": "replay", "page": replay_page(session.recording())}
        getattr(session, action)(**arguments)
    except ValueError as error:
        session.say(str(error))
        return {"kind": "error", "message": str(error)}
    return {"kind": "built"} if action == "build" else None


class Page:
    """Messages to and from all pages of a session, served at a port."""

    def __init__(self, session: Session, port: int, host: str = ADDRESS, token: str = "") -> None:
        self.session = session
        self.root = f"/{token}" if token else ""  # of all paths; the pages' links are relative
        end = "" if port == 80 else f":{port}"  # browsers leave that one out
        self.hosts = [f"{name}{end}" for name in dict.fromkeys((host, ADDRESS, "localhost"))]
        sockets = " ".join(f"ws://{host}" for host in self.hosts)  # to some browsers not 'self'
        self.pages = {
            "/": page_of("play", None, sockets=sockets),
            "/bench": bench_page(sockets),
        }
        self._open: set[ServerConnection] = set()

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The response to a request; None for a socket that may be opened."""
        path = request.path[len(self.root) :]
        status = self._status(request, path)
        if status == HTTPStatus.SWITCHING_PROTOCOLS:
            return None
        text, kind = f"{status.value} {status.phrase}\n", "text/plain"
        if status == HTTPStatus.OK:
            text, kind = self.pages[path], "text/html"
        response = connection.respond(status, text)
        del response.headers["Content-Type"]
        for name, value in {**HEADERS, "Content-Type": f"{kind}; charset=utf-8"}.items():
            response.headers[name] = value
        return response

    def _status(self, request: Request, path: str) -> HTTPStatus:
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        root = request.path[: len(self.root)].encode(errors="replace")
        if getattr(request, "method", "GET") != "GET":  # older versions refuse others themselves
            return HTTPStatus.METHOD_NOT_ALLOWED
        if len(hosts) != 1 or hosts[0] not in self.hosts:
            return HTTPStatus.MISDIRECTED_REQUEST
        if origins not in ([], [f"http://{hosts[0]}"]):
            return HTTPStatus.FORBIDDEN
        if not compare_digest(root, self.root.encode()):
            return HTTPStatus.FORBIDDEN
        if path in self.pages:
            return HTTPStatus.OK
        if path != SOCKET:
            return HTTPStatus.NOT_FOUND
        if not origins:
            return HTTPStatus.FORBIDDEN
        full = len(self._open) >= MOST_PAGES
        return HTTPStatus.SERVICE_UNAVAILABLE if full else HTTPStatus.SWITCHING_PROTOCOLS

    async def converse(self, connection: ServerConnection) -> None:
        """Do what a page asks for, until it goes."""
        try:
            await connection.send(scene_message(self.session))
            self._open.add(connection)
            async for message in connection:
                if (reply := execute(self.session, message)) is not None:
                    await connection.send(json.dumps(reply))
                await asyncio.sleep(0.0)  # others have their turn, however many messages there are
        except ConnectionClosed:
            pass
        finally:
            self._open.discard(connection)
            self.session.hold(0)  # a key may have been down

    async def run(self) -> None:
        """Let time pass, and send states, while somebody looks."""
        before, version = monotonic(), self.session.version
        while True:
            await asyncio.sleep(FRAME_TIME)
            now = monotonic()
            if self._open:
                self.session.advance(now - before)
                if version != self.session.version:
                    broadcast(self._open, scene_message(self.session))
                    version = self.session.version
                quick = [
                    connection
                    for connection in self._open
                    if connection.transport.get_write_buffer_size() < MOST_UNREAD
                ]
                broadcast(quick, state_message(self.session))
            before = now


def scene_message(session: Session) -> str:
    """Scene, settings and choices, which change with the session's version."""
    values, scene, frame = session.values(), session.env.scene(), session.frame()
    message = {
        "kind": "scene",
        "scene": {
            **scene_of_robot(scene["robot"], frame.weight),
            "terrain": np.asarray(scene["terrain_points"]).tolist(),
            "torqueLimit": frame.torque_limit,
        },
        "sliders": [
            {"name": name, "value": values[name], **slider._asdict()}
            for name, slider in SLIDERS.items()
        ],
        "choices": asdict(session.choices),
        "lengths": session.lengths,
        "options": session.options,
        "byHand": BY_HAND,
        "topSpeed": session.top_speed,
        "largestPush": LARGEST_PUSH,
        "pace": session.pace,
        "paces": PACES,
        "paused": session.paused,
    }
    return json.dumps(message, allow_nan=False)


def state_message(session: Session) -> str:
    """Pose of the robot, and the score."""
    message = {
        "kind": "state",
        "state": state_of_frame(session.env.scene()["robot"], session.frame()),
        "score": asdict(session.score()),
        "input": session.input,
        "message": session.message,
        "fallen": session.fallen,
    }
    return json.dumps(message, allow_nan=False)


def own_address() -> str:
    """Return this machine's address in its network. Raises OSError: it is in none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # of nobody (RFC 5737), and nothing is sent
        return str(probe.getsockname()[0])


async def serve(
    session: Session, port: int, ready: Callable[[str], object], host: str = ADDRESS
) -> None:
    """Serve a session until cancelled.

    Args:
        port: 0 for any that is free. ready: is given the link once it is served. host: IPv4
            address to serve at, 0.0.0.0 for all; beyond this machine the link has a random token.

    Raises:
        OSError: the port or the host cannot be used.
    """
    address = ip_address(host)
    seen = own_address() if address.is_unspecified else host
    token = "" if address.is_loopback else token_urlsafe(12)  # 96 bits, in 16 characters
    listening = socket.create_server((host, port))
    page = Page(session, listening.getsockname()[1], seen, token)
    async with serve_sockets(
        page.converse, sock=listening, process_request=page.answer, compression=None,
        server_header=None, max_size=MOST_BYTES, open_timeout=PATIENCE, close_timeout=2,
        logger=LOGGER,
    ):  # fmt: skip
        ready(f"http://{page.hosts[0]}" + (f"{page.root}/" if token else ""))
        await page.run()
