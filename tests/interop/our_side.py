"""Our side of the Modbus exchanges: a server with every function, and a client that records the answered services.

unit 1 of our server     input register 4 is 1234, discrete input 6 is on, exception status 5A, file 4 holds 100 ...
                         109, the queue at 30 holds 7, 8, FFFF; all else is zero and may be written
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.io.modbus.methods import ModbusMethods
from barewire.modbus import CanopenReference, Diagnostics, Response, SerialCounters, Table
from barewire.modbus.exceptions import ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.messages.canopen_reference import CanopenReferenceResponse
from barewire.modbus.messages.diagnostics import (
    CHANGE_ASCII_DELIMITER,
    FORCE_LISTEN_ONLY,
    DiagnosticsResponse,
    Unanswered,
)
from barewire.modbus.server.serial_counters import ANSWERED
from tests.certificates import tls_url
from tests.interop.relay import in_its_own_loop, relayed
from tests.interop.services import TCP_LIKE, service

LINE = "?baudrate=115200&parity=N"  # a pseudo-terminal has no parity
LONG = "x" * 200
OBJECTS = {3: "http://barewire.example", 0x80: "serial 42", 0x81: LONG}
"""Identification objects beyond the three mandatory ones: together they do not fit into one answer."""

Seen = set[str]


class FullUnit(Table):
    """Unit 1 of our server. It records the services that it answered.

    On TCP the server leaves 08, 0B and 0C to the unit, so it answers them. It answers 08/03 on all but ASCII lines.
    """

    def __init__(self, carrier: str, seen: Seen) -> None:
        super().__init__(10000, objects=OBJECTS, files={4: range(100, 110)})
        self.input_registers[4] = 1234
        self.discrete_inputs[6] = 1
        self.exception_status = 0x5A
        self.queues[30] = [7, 8, 0xFFFF]
        self._seen = seen
        self._is_ascii = carrier in ("ascii", "ascii+tcp")
        self._counters = None if carrier not in TCP_LIKE else SerialCounters()

    @staticmethod
    def supports(request: type[Any]) -> bool:
        """Return True: every function."""
        return True

    def handle(self, request: Any, now: float) -> Response | None:
        """Answer from the table; count on TCP; record the service."""
        counters = self._counters
        if counters is not None:
            counters.frame()
            counters.received()
            if not counters.accepts(request.encode()):
                return None
        response = self._answer(request, now)
        if counters is not None:
            counters.finished(request, None, answered=response is not None)
        self._seen.add(service(request))
        return response

    def _answer(self, request: Any, now: float) -> Response | None:
        if request == Diagnostics(CHANGE_ASCII_DELIMITER, b"\n\0") and not self._is_ascii:
            return DiagnosticsResponse(CHANGE_ASCII_DELIMITER, b"\n\0")  # no effect outside ASCII
        if isinstance(request, ANSWERED):
            if self._counters is not None:
                return self._counters.answer(request)
            self._seen.add(service(request))
            raise ModbusException(ILLEGAL_FUNCTION)  # the server has the line's counters and answers itself
        if isinstance(request, CanopenReference):
            data = b"" if request.write else bytes(range(request.count))
            place = (request.node, request.index, request.sub_index, request.start, request.count)
            return CanopenReferenceResponse(*place, data, write=request.write, dialect=request.dialect)
        return super().handle(request, now)


def server_url(carrier: str, certificates: Path) -> str:
    """Return the URL for our server."""
    if carrier in ("rtu", "ascii"):
        return f"{carrier}://pty{LINE}"
    return tls_url(certificates, "server", roles="any") if carrier == "tls" else f"{carrier}://127.0.0.1:0"


@contextlib.contextmanager
def our_server(carrier: str, certificates: Path, seen: Seen) -> Iterator[tuple[str, FullUnit]]:
    """Run our server; yield PATH or HOST:PORT, and unit 1."""
    unit = FullUnit(carrier, seen)
    with ModbusServer(server_url(carrier, certificates), units={1: unit}) as host:
        yield place_of(host), unit


@contextlib.contextmanager
def our_asyncio_server(carrier: str, seen: Seen) -> Iterator[tuple[str, FullUnit]]:
    """Run our asyncio server on a serial line; yield the path of the other end, and unit 1."""
    unit = FullUnit(carrier, seen)

    @contextlib.asynccontextmanager
    async def serving() -> AsyncIterator[None]:
        async with AsyncModbusServer(f"{carrier}://{here}{LINE}", {1: unit}):
            yield

    with relayed() as (here, there), in_its_own_loop(serving):
        yield there, unit


def place_of(host: ModbusServer) -> str:
    """Return PATH or HOST:PORT of a URL."""
    return host.url.partition("://")[2].partition("?")[0]


def port_of(place: str) -> int:
    """Return the port of HOST:PORT."""
    return int(place.rpartition(":")[2])


def client_url(carrier: str, place: str, certificates: Path, timeout: float = 10.0) -> str:
    """Return the URL with which our client connects to a server at PATH or HOST:PORT."""
    if carrier == "tls":
        return tls_url(certificates, "operator", place, unit="1", timeout=str(timeout))
    options = f"{LINE}&" if carrier in ("rtu", "ascii") else "?"
    return f"{carrier}://{place}{options}unit=1&timeout={timeout}"


class RecordingClient:
    """Our client, blocking or asyncio, with the same awaitable methods; it records the answered services."""

    def __init__(self, client: Any, seen: Seen) -> None:
        self._client = client
        self._seen = seen

    async def ask(self, request: Any, **how: Any) -> Any:
        """Send any request and return its response."""
        answer = await _value(self._client.ask(request, **how))
        self._seen.add(service(request))
        return answer

    async def force_listen_only(self) -> None:
        """Force Listen Only Mode, which has no answer."""
        assert isinstance(await self.ask(Diagnostics(FORCE_LISTEN_ONLY), timeout=0.1), Unanswered)

    async def run(self, make: Callable[..., Any]) -> Any:
        """Run any conversation of the bus."""
        return await _value(self._client.run_with_bus(make))

    def __getattr__(self, name: str) -> Callable[..., Awaitable[Any]]:
        async def method(*values: Any, **named: Any) -> Any:
            answer = await _value(getattr(self._client, name)(*values, **named))
            request, _ = getattr(ModbusMethods, name).__wrapped__(self._client, *values, **named)
            self._seen.add(service(request))
            return answer

        return method


async def _value(result: Any) -> Any:
    return await result if inspect.isawaitable(result) else result


def with_both(url: str, seen: Seen, talk: Callable[[RecordingClient], Awaitable[None]]) -> None:
    """Run the same requests with the blocking client, then with the asyncio client."""

    async def main() -> None:
        with ModbusClient(url) as blocking:
            await talk(RecordingClient(blocking, seen))
            blocking.settle()
        async with AsyncModbusClient(url) as waiting:
            await talk(RecordingClient(waiting, seen))

    asyncio.run(main())
