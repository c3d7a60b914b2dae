"""The status page of a gateway, on a port of its own, by default on loopback: `[status] url = "http://127.0.0.1:8502"`.

    /               the page: lines, units, rates and errors over time, the latest errors in words, frames live
    /status.json    what it shows
    /frames.json    ?backend=NAME&unit=N: the latest exchanges with a unit, while they are asked for
    /metrics        for Prometheus

It only shows: no request changes anything. The page loads nothing from elsewhere. microdot serves it, a small library
for asyncio (1 MB of memory): `pip install barewire[gateway]`.
"""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from barewire.errors import PortError
from barewire.gateway.config import host_and_port
from barewire.gateway.status import metrics
from barewire.io.ports.network import place_of, reason

if TYPE_CHECKING:
    from barewire.gateway.backend import Backend

_PAGE = Path(__file__).with_name("page.html")
_JSON = {"Content-Type": "application/json", "Cache-Control": "no-store"}
_HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    # Nothing from elsewhere, no frame around it, nothing sent.
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "connect-src 'self'; img-src data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


_TIMEOUT = 10.0
"""Seconds that a request and its response may take."""


class Shown(Protocol):
    """What the page shows: a gateway."""

    backends: list[Backend]

    def status(self) -> dict[str, Any]: ...


class StatusPage:
    """The page of one gateway. `start` opens the port. Raises ModuleNotFoundError without microdot."""

    def __init__(self, gateway: Shown, url: str) -> None:
        self.url = url
        self._app = _app(gateway)
        self._server: asyncio.Server | None = None

    async def start(self) -> None:
        """Open the port. Raises PortError."""
        host, port = host_and_port(self.url)
        try:
            self._server = await self._app.start_server(host, port, start_serving=False)
            await self._server.start_serving()
        except OSError as error:
            raise PortError(f"{place_of(host, port)}: {reason(error)}") from None
        self.url = f"http://{place_of(host, self._server.sockets[0].getsockname()[1])}"

    async def close(self) -> None:
        """Release the port."""
        if self._server is not None:
            self._server.close()


def _app(gateway: Shown) -> Any:
    """Return the microdot application."""
    from microdot import Microdot, Request, Response

    class App(Microdot):
        async def handle_request(self, reader: Any, writer: Any) -> None:
            """Answer one request, or close: microdot prints a traceback for bytes that are no HTTP."""
            try:
                async with asyncio.timeout(_TIMEOUT):
                    request = await Request.create(self, reader, writer, writer.get_extra_info("peername"))
                    response = await self.dispatch_request(request)
                    await response.write(writer)
            except Exception:
                pass
            finally:
                writer.close()

    async def page(request: Request) -> Any:
        return Response(_PAGE.read_text(encoding="utf-8"), headers=_HEADERS)

    async def state(request: Request) -> Any:
        return Response(json.dumps(gateway.status()), headers=_JSON)

    async def frames(request: Request) -> Any:
        name, unit = request.args.get("backend", ""), request.args.get("unit", "")
        backend = next((row for row in gateway.backends if row.name == name), None)
        if backend is None or not unit.isdecimal():
            return Response("expected backend=NAME&unit=NUMBER\n", 404)
        rows = [row._asdict() for row in backend.watch_frames() if row.unit == int(unit)]
        return Response(json.dumps(rows), headers=_JSON)

    async def prometheus(request: Request) -> Any:
        try:
            text = metrics(gateway.status())
        except ModuleNotFoundError:
            return Response("metrics need prometheus-client: pip install barewire[gateway]\n", 501)
        return Response(text, headers={"Content-Type": "text/plain; version=0.0.4; charset=utf-8"})

    app: Any = App()
    for path, answer in (("/", page), ("/status.json", state), ("/frames.json", frames), ("/metrics", prometheus)):
        app.get(path)(answer)
    return app
