"""The page of a panel on a port of this machine, and who may write.

    GET  /               the page and its files, which load nothing from elsewhere
    GET  /device.json    groups and parameters of the device
    GET  /events         ?name=A&name=B: what changes, as server-sent events, while the connection is open
    GET  /frame          ?number=N: a frame field by field
    POST /plan  /write   {"name": ..., "text": ...}: the frames that would be sent; sent, and what the device has then
    POST /read           {"name": ..., "text": ""}: a setting behind the numbers of a menu, which are written for that
    POST /world  /fault  likewise: the environment of a machine that is simulated here, and the faults of its line

A request must name this machine as its host, which a page of another site cannot (DNS rebinding), and must not come
from another origin. Writing needs the token of the printed URL, which stands behind its # and is sent in a header only.
A browser that does not read its events for `_STALLED` seconds is cut off; nothing is queued for it, as each event has
the newest values.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import socket
from contextlib import suppress
from importlib.resources import files
from typing import Any, cast
from urllib.parse import urlsplit

from microdot import Microdot, Request, Response

from barewire.devices import Parameter
from barewire.errors import BarewireError, PortError
from barewire.io.ports.network import reason
from barewire_workbench.cli.dry_run import address_text, raw_text
from barewire_workbench.cli.panels.description import description, planned_frames, value_to_write
from barewire_workbench.cli.panels.line import Busy, PanelLine
from barewire_workbench.cli.panels.world import SimulatedWorld

_FILES = files("barewire_workbench.cli.panels") / "page"
_KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript"}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; style-src 'self'; script-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_HOSTS = {"127.0.0.1", "localhost", "::1"}
_TIMEOUT = 10.0
"""Seconds that a request may take to arrive."""
_STALLED = 10.0
"""Seconds after which a browser that does not read is cut off."""
_UNREAD = 65536
"""Bytes that wait for a browser, here and in the kernel."""
_QUIET = 5.0
"""Seconds after which an event is sent though nothing has changed: a closed connection is noticed."""
_VIEWERS = 64
_NAMES = 100
"""Values that one browser may look at."""


class PanelServer:
    """The page of one machine. `start` opens the port on loopback. `token` is None if nothing may be written.

    `world` is the environment of a machine that is simulated here.
    """

    def __init__(
        self,
        line: PanelLine,
        *,
        writable: bool,
        world: SimulatedWorld | None = None,
        stalled: float = _STALLED,
    ) -> None:
        self.line = line
        self._world = world
        self.token = secrets.token_urlsafe(16) if writable else None
        self.viewers = 0
        self.url = ""
        self._stalled = stalled
        self._changed = asyncio.Event()
        self._server: asyncio.Server | None = None
        self._connections: set[asyncio.Task[None]] = set()

    async def start(self, port: int = 0) -> None:
        """Open the port. Raises PortError."""
        loop = asyncio.get_running_loop()

        def notify() -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._notify)

        self.line.on_change = notify
        try:
            self._server = await asyncio.start_server(self._accept, "127.0.0.1", port, limit=65536)
        except OSError as error:
            raise PortError(f"127.0.0.1:{port}: {reason(error)}") from None
        self._app = self._routes()
        self.url = f"http://127.0.0.1:{self._server.sockets[0].getsockname()[1]}/"
        if self.token is not None:
            self.url += f"#{self.token}"

    async def close(self) -> None:
        """Release the port, and close every connection."""
        if self._server is not None:
            self._server.close()
        for task in self._connections:
            task.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    def _notify(self) -> None:
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    # Requests

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.create_task(self._handle(reader, writer))
        self._connections.add(task)
        task.add_done_callback(self._connections.discard)

    async def _handle(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer one request, then close."""
        with suppress(Exception):  # bytes that are no HTTP, a browser that has gone: nothing can be sent
            stream: Any = writer
            async with asyncio.timeout(_TIMEOUT):
                request = await Request.create(self._app, reader, stream, writer.get_extra_info("peername"))
            if request is not None:
                problem = self._forbidden(request)
                if problem:
                    response = _problem(problem, 403)
                elif request.path == "/events" and request.method == "GET":
                    await self._send_events(request, writer)
                    return
                else:
                    response = await self._app.dispatch_request(request)
                async with asyncio.timeout(self._stalled):
                    await response.write(cast("asyncio.StreamWriter", _Drained(writer)))
        writer.transport.abort() if writer.transport.get_write_buffer_size() else writer.close()

    def _forbidden(self, request: Request) -> str:
        """Return why a request is refused, or an empty text."""
        host = request.headers.get("Host", "")
        if urlsplit(f"//{host}").hostname not in _HOSTS:
            return "the panel is asked by another name than that of this machine"
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"http://{host}":
            return "the request comes from a page of another site"
        if request.method == "POST":
            if self.token is None:
                return "this panel only shows: start it with --write to write"
            if not hmac.compare_digest(request.headers.get("X-Token", "").encode(), self.token.encode()):
                return "the token is missing: open the URL that the command has printed"
        return ""

    async def _send_events(self, request: Request, writer: asyncio.StreamWriter) -> None:
        """Send what changes until the browser closes the connection, or does not read."""
        menus = self.line.menus
        known = {row.name for row in self.line.device.parameters} | menus.keys()
        arguments: Any = request.args
        names = [name for name in arguments.getlist("name") if name in known][:_NAMES]
        readable = [name for name in names if name in menus or self.line.device.find(name).readable]
        head = "\r\n".join(f"{name}: {text}" for name, text in _HEADERS.items())
        too_many = self.viewers >= _VIEWERS
        status = "503 Too many viewers" if too_many else "200 OK"
        writer.write(f"HTTP/1.0 {status}\r\nContent-Type: text/event-stream\r\n{head}\r\n\r\n".encode())
        if too_many:
            writer.close()
            return
        writer.transport.set_write_buffer_limits(high=_UNREAD)
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD)
        self.viewers += 1
        try:
            with self.line.look_at(readable):
                revision, world = 0, None
                while not writer.is_closing():
                    changed = self._changed
                    event = self.line.changes_since(revision, readable)
                    revision = event["revision"]
                    if self._world is not None and (state := self._world.state()) != world:
                        event["world"] = world = state
                    writer.write(f"data: {json.dumps(event, allow_nan=False)}\n\n".encode())
                    async with asyncio.timeout(self._stalled):
                        await writer.drain()
                    with suppress(TimeoutError):
                        async with asyncio.timeout(_QUIET):
                            await changed.wait()
        finally:
            self.viewers -= 1
            writer.transport.abort()

    def _routes(self) -> Microdot:
        app = Microdot()
        app.get("/device.json")(self._device)
        app.get("/frame")(self._frame)
        app.get("/")(_file)
        app.get("/<name>")(_file)
        app.post("/plan")(self._plan)
        app.post("/write")(self._write)
        app.post("/read")(self._read)
        app.post("/world")(self._set_world)
        app.post("/fault")(self._set_world)
        return app

    async def _device(self, request: Request) -> Response:
        described = description(self.line.device, self.line.endpoint) | {
            "writable": self.token is not None,
            "world": self._world is not None,
        }
        return _answer(described)

    async def _frame(self, request: Request) -> Response:
        number = request.args.get("number", "")
        frame = self.line.frame(int(number)) if number.isdecimal() else None
        if frame is None:
            return _problem("this frame is no longer kept", 404)
        explanation = frame.explanation
        rows = [(field.hex, field.name, field.shown, field.meaning) for field in explanation.fields]
        findings = [finding.line for finding in explanation.diagnosis]
        answer = {"digits": frame.digits, "verdict": explanation.verdict, "fields": rows, "findings": findings}
        return _answer(answer)

    async def _plan(self, request: Request) -> Response:
        """Answer what would be written."""
        try:
            parameter, value, values = self._asked(request)
            answer = {
                "name": parameter.name,
                "value": parameter.text(value),
                "address": address_text(parameter, is_can=self.line.is_can),
                "raw": raw_text(parameter, value, is_can=self.line.is_can),
                "frames": planned_frames(self.line.endpoint, self.line.device, values),
            }
        except BarewireError as error:
            return _problem(str(error), 400)
        return _answer(answer)

    async def _write(self, request: Request) -> Response:
        """Write, and answer what the device has then."""
        try:
            parameter, value, _ = self._asked(request)
            result = await asyncio.wrap_future(self.line.write(parameter.name, value))
        except Busy as error:
            return _problem(str(error), 503)
        except BarewireError as error:
            return _problem(str(error), 400)
        return _answer({"result": f"{parameter.name} = {parameter.text(value)}, {result}"})

    async def _read(self, request: Request) -> Response:
        """Read a setting of a menu, whose numbers are written for that; its value comes as an event."""
        try:
            name, _ = _named_text(request)
            if name not in self.line.menus:
                known = ", ".join(self.line.menus)
                raise BarewireError(f"{name}: expected {f'one of {known}' if known else 'a menu, and there is none'}")
            result = await asyncio.wrap_future(self.line.write(name, None))
        except BarewireError as error:
            return _problem(str(error), 400)
        return _answer({"result": result})

    async def _set_world(self, request: Request) -> Response:
        """Set a property of the environment, or the faults of one kind."""
        if self._world is None:
            return _problem("this machine is not simulated here", 404)
        try:
            name, text = _named_text(request)
            (self._world.set_fault if request.path == "/fault" else self._world.set)(name, text)
        except BarewireError as error:
            return _problem(str(error), 400)
        self._notify()
        return _answer({"result": f"{name}: {text or 'off'}"})

    def _asked(self, request: Request) -> tuple[Parameter, Any, dict[str, Any]]:
        """Return the parameter, the value, and what is written for it. Raises BarewireError."""
        name, text = _named_text(request)
        menus = self.line.menus
        if text.startswith("@") and name not in menus and self.line.device.find(name).type in ("octets", "domain"):
            raise BarewireError(f"{name}: a browser names no file of this machine: expected bytes")
        return value_to_write(self.line.device, name, text, menus)


def _named_text(request: Request) -> tuple[str, str]:
    """Return the name and the text of a request. Raises BarewireError."""
    try:
        body = json.loads(request.body or b"")
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict) or not all(isinstance(body.get(key), str) for key in ("name", "text")):
        raise BarewireError('expected {"name": TEXT, "text": TEXT}')
    return body["name"], body["text"]


class _Drained:
    """A stream as microdot writes to one."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self._writer = writer

    async def awrite(self, data: bytes) -> None:
        """Write, and wait while too much is unread."""
        self._writer.write(data)
        await self._writer.drain()


async def _file(request: Request, name: str = "index.html") -> Response:
    kind = _KINDS.get(name.rpartition(".")[2])
    if kind is None or name not in {file.name for file in _FILES.iterdir()}:
        return _problem("no such page", 404)
    return Response((_FILES / name).read_bytes(), headers=_HEADERS | {"Content-Type": f"{kind}; charset=utf-8"})


def _answer(value: dict[str, Any], status: int = 200) -> Response:
    return Response(json.dumps(value), status, headers=_HEADERS | {"Content-Type": "application/json; charset=utf-8"})


def _problem(text: str, status: int) -> Response:
    return _answer({"problem": text}, status)
