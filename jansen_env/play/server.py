"""A session on a web page: served on 127.0.0.1 unless asked otherwise, with states by websocket.

All pages that are open show and change the same session; time stands still while none is open.

A page of another site may be open in the same browser and must not reach the robot: the ``Host``
of a request must be this server's own (against DNS rebinding), an ``Origin`` too, and a socket
needs one. Beyond this machine every request needs the link's random token, too. Only
:data:`FILES` are served. Messages are small, few and :data:`ACTIONS` of the session, which checks
their values; clients that keep sending rubbish, or never read, are cut off.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable
from dataclasses import asdict
from http import HTTPStatus
from importlib.resources import files
from ipaddress import ip_address
from secrets import compare_digest, token_urlsafe
from socket import AF_INET, SOCK_DGRAM, socket
from time import monotonic
from typing import Any, ClassVar

from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as serve_sockets
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.protocol import State

from jansen_env.checks import one_of, shown
from jansen_env.play.session import BY_HAND, LARGEST_PUSH, PACES, SLIDERS, Session
from jansen_env.viewer.web import bench
from jansen_env.viewer.web.geometry import scene_of, state_of_frame
from jansen_env.viewer.web.page import page as replay_page

ADDRESS = "127.0.0.1"
SOCKET = "/socket"
BENCH = "/bench"
FILES = {
    "/": ("play.html", "text/html"),
    BENCH: ("bench.html", "text/html"),
    "/theme.css": ("theme.css", "text/css"),
    "/play.css": ("play.css", "text/css"),
    "/bench.css": ("bench.css", "text/css"),
    **{
        f"/{name}.js": (f"{name}.js", "text/javascript")
        for name in ("play", "push", "scene", *bench.SCRIPTS)
    },
}
"""File of ``jansen_env/viewer/web`` and its type, by path; the bench has its designs put in."""
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src {sockets}; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
FRAME_TIME = 0.02  # s between two states that are sent
MOST_BYTES = 1024  # of a message to the server
MOST_UNREAD = 2**22  # bytes that are kept for somebody who sends but does not read
PATIENCE = 5.0  # s for a request to be complete
MOST_SOCKETS, MOST_CONNECTIONS = 4, 32  # at once
RATE, BURST = 200.0, 200.0  # messages a second of one socket, and how many at once
MOST_ERRORS = 20  # messages of one socket that are refused before it is closed
VIOLATION = 1008  # RFC 6455: policy violation
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


def parse(message: str | bytes) -> tuple[str, dict[str, Any]]:
    """Return an action of a session, and its arguments, from a message.

    Raises:
        ValueError: it is no text, no JSON, no action or has other arguments.
    """
    if not isinstance(message, str):
        raise ValueError("message is binary, must be text")
    try:
        content = json.loads(message)
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


class Page:
    """Messages to and from all pages of a session, served at a port."""

    def __init__(self, session: Session, port: int, host: str = ADDRESS, token: str = "") -> None:
        self.session = session
        self.root = f"/{token}" if token else ""  # of all paths; the files' links are relative
        end = "" if port == 80 else f":{port}"  # browsers leave that one out
        self.hosts = [f"{name}{end}" for name in dict.fromkeys((host, ADDRESS, "localhost"))]
        sockets = " ".join(f"ws://{host}" for host in self.hosts)  # to some browsers not 'self'
        self.headers = {name: value.format(sockets=sockets) for name, value in HEADERS.items()}
        self._files = {
            path: (files("jansen_env.viewer.web").joinpath(name).read_text("utf-8"), kind)
            for path, (name, kind) in FILES.items()
        }
        self._files[BENCH] = bench.served_bench_page(), FILES[BENCH][1]
        self._sockets = 0
        self._fresh = asyncio.Event()  # set at the next state
        self._scene, self._scene_version, self._state = "", -1, ""

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The response to a request; None for a socket that may be opened."""
        path = request.path[len(self.root) :]
        status = self._status(request, path)
        if status == HTTPStatus.SWITCHING_PROTOCOLS:
            return None
        text, kind = f"{status.value} {status.phrase}\n", "text/plain"
        if status == HTTPStatus.OK:
            text, kind = self._files[path]
        response = connection.respond(status, text)
        del response.headers["Content-Type"]
        for name, value in {**self.headers, "Content-Type": f"{kind}; charset=utf-8"}.items():
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
        if path in self._files:
            return HTTPStatus.OK
        if path != SOCKET:
            return HTTPStatus.NOT_FOUND
        if not origins:
            return HTTPStatus.FORBIDDEN
        full = self._sockets >= MOST_SOCKETS
        return HTTPStatus.SERVICE_UNAVAILABLE if full else HTTPStatus.SWITCHING_PROTOCOLS

    async def converse(self, connection: ServerConnection) -> None:
        """Send states to a page, and do what it asks for, until it goes."""
        if self._sockets >= MOST_SOCKETS:  # several may have been let in at the same time
            await connection.close(VIOLATION, "too many pages")
            return
        self._sockets += 1
        sending = asyncio.create_task(self._send_states(connection))
        try:
            await self._listen(connection)
        except ConnectionClosed:
            pass
        finally:
            self._sockets -= 1
            self.session.hold(0)  # a key may have been down
            sending.cancel()

    async def _listen(self, connection: ServerConnection) -> None:
        """Do what messages ask for; ends when the connection is closed."""
        errors, allowance, before = 0, BURST, monotonic()
        async for message in connection:
            allowance = min(allowance + RATE * (monotonic() - before), BURST) - 1.0
            if allowance < 0.0:
                return await connection.close(VIOLATION, "too many messages")
            try:
                action, arguments = parse(message)
            except ValueError as error:
                errors += 1
                if errors > MOST_ERRORS:
                    return await connection.close(VIOLATION, "too many errors")
                await connection.send(json.dumps({"kind": "error", "message": str(error)}))
            else:
                if (reply := self._do(action, arguments)) is not None:
                    await connection.send(json.dumps(reply))
            before = monotonic()  # the work for a message, such as another robot's, earns nothing
            await asyncio.sleep(0.0)  # others have their turn, however many messages there are

    def _do(self, action: str, arguments: dict[str, Any]) -> dict[str, object] | None:
        """Do what a message asks for, and return the answer to it alone, if there is one."""
        if action == "replay":
            try:
                return {"kind": "replay", "page": replay_page(self.session.recording())}
            except ValueError as error:
                self.session.say(str(error))
        elif action == "build":
            robot, lengths = arguments["robot"], arguments["lengths"]
            if not self.session.attempt("choose", name="robot", value=robot, lengths=lengths):
                return {"kind": "error", "message": self.session.message}
            self.session.pause(False)
            return {"kind": "built"}
        else:
            self.session.attempt(action, **arguments)
        return None

    async def _send_states(self, connection: ServerConnection) -> None:
        """Send each state that there is when the one before has gone out."""
        shown = None
        try:
            while True:
                await self._fresh.wait()
                if shown != self._scene_version:
                    shown = self._scene_version
                    await connection.send(self._scene)
                await connection.send(self._state)
        except ConnectionClosed:
            pass

    async def run(self) -> None:
        """Let time pass while somebody looks."""
        due = before = monotonic()
        while True:
            due = max(due + FRAME_TIME, monotonic())
            await asyncio.sleep(due - monotonic())
            now = monotonic()
            if self._sockets:
                self.session.advance(now - before)
                self._publish()
            before = now

    def _publish(self) -> None:
        """Have the present state sent, and the scene if it is another one."""
        if self._scene_version != self.session.version:
            self._scene_version = self.session.version
            self._scene = json.dumps(scene_message(self.session), allow_nan=False)
        self._state = json.dumps(state_message(self.session), allow_nan=False)
        fresh, self._fresh = self._fresh, asyncio.Event()
        fresh.set()


def scene_message(session: Session) -> dict[str, object]:
    """Scene, settings and choices, which change with the session's version."""
    values = session.values()
    return {
        "kind": "scene",
        "scene": scene_of(session.env),
        "sliders": [
            {"name": name, "value": values[name], **slider._asdict()}
            for name, slider in SLIDERS.items()
        ],
        "choices": session.choices,
        "lengths": session.lengths,
        "options": session.options,
        "environment": session.env_id,
        "byHand": BY_HAND,
        "topSpeed": session.top_speed,
        "largestPush": LARGEST_PUSH,
        "pace": session.pace,
        "paces": PACES,
        "paused": session.paused,
    }


def state_message(session: Session) -> dict[str, object]:
    """Pose of the robot, and the score."""
    return {
        "kind": "state",
        "state": state_of_frame(session.scene()["robot"], session.frame()),
        "score": asdict(session.score()),
        "input": session.input,
        "message": session.message,
        "fallen": session.fallen,
    }


class _Limited(ServerConnection):
    """A connection; where there are too many, the one that has been idle longest is cut off."""

    present: ClassVar[dict[_Limited, None]] = {}  # in the order they came

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.present[self] = None
        if len(self.present) > MOST_CONNECTIONS:
            self.cut_off_idle(1)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.transport.get_write_buffer_size() > MOST_UNREAD:  # answers to pings
            self.transport.abort()

    @classmethod
    def cut_off_idle(cls, count: int | None = None) -> None:
        """Cut off those that have been idle longest, all or so many."""
        idle = [connection for connection in cls.present if connection.state is not State.OPEN][
            :count
        ]
        for connection in idle:
            del cls.present[connection]
            connection.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self.present.pop(self, None)
        super().connection_lost(exc)


def own_address() -> str:
    """Return this machine's address in its network. Raises OSError: it is in none."""
    with socket(AF_INET, SOCK_DGRAM) as probe:
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
    shown = own_address() if address.is_unspecified else host
    token = "" if address.is_loopback else token_urlsafe(12)  # 96 bits, in 16 characters
    page: Page
    async with serve_sockets(
        lambda connection: page.converse(connection), host, port,
        process_request=lambda connection, request: page.answer(connection, request),
        create_connection=_Limited, compression=None, server_header=None, max_size=MOST_BYTES,
        open_timeout=PATIENCE, close_timeout=2, logger=LOGGER,
    ) as server:  # fmt: skip
        page = Page(session, server.sockets[0].getsockname()[1], shown, token)
        ready(f"http://{page.hosts[0]}" + (f"{page.root}/" if token else ""))
        try:
            await page.run()
        finally:
            _Limited.cut_off_idle()  # for which closing would wait
