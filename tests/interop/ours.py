"""Our two sides as strangers meet them: a server that knows every function, and a client that notes what it was told.

unit 1 of our server     input register 4 is 1234, discrete input 6 is on, exception status 5A, file 4 holds 100 ...
                         109, the queue at 30 holds 7, 8, FFFF; everything else is zero and may be written
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import time
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
"""Identification objects besides the three of every device: together they do not fit one answer."""

Seen = set[str]


class Known(Table):
    """The unit. It notes what it answered. It answers 08, 0B and 0C itself where the server does not, on TCP, and 08/03
    where no line of ASCII is."""

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
        """All there is."""
        return True

    def handle(self, request: Any, now: float) -> Response | None:
        """What the table says, and a little more."""
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
            return DiagnosticsResponse(CHANGE_ASCII_DELIMITER, b"\n\0")  # LF was as good as anything there
        if isinstance(request, ANSWERED):
            if self._counters is not None:
                return self._counters.answer(request)
            self._seen.add(service(request))
            raise ModbusException(ILLEGAL_FUNCTION)  # the server has the counters of the line, and answers
        if isinstance(request, CanopenReference):
            data = b"" if request.write else bytes(range(request.count))
            place = (request.node, request.index, request.sub_index, request.start, request.count)
            return CanopenReferenceResponse(*place, data, write=request.write, dialect=request.dialect)
        return super().handle(request, now)


def server_url(carrier: str, certificates: Path) -> str:
    """Where our server is to be started."""
    if carrier in ("rtu", "ascii"):
        return f"{carrier}://pty{LINE}"
    return tls_url(certificates, "server", roles="any") if carrier == "tls" else f"{carrier}://127.0.0.1:0"


@contextlib.contextmanager
def our_server(carrier: str, certificates: Path, seen: Seen) -> Iterator[tuple[str, Known]]:
    """Our server, and its unit 1; gives PATH or HOST:PORT."""
    unit = Known(carrier, seen)
    with ModbusServer(server_url(carrier, certificates), units={1: unit}) as host:
        yield place_of(host), unit


@contextlib.contextmanager
def our_asyncio_server(carrier: str, seen: Seen) -> Iterator[tuple[str, Known]]:
    """The same on a serial line, where our asyncio server is another one; gives the path of the line's other end."""
    unit = Known(carrier, seen)

    @contextlib.asynccontextmanager
    async def serving() -> AsyncIterator[None]:
        async with AsyncModbusServer(f"{carrier}://{here}{LINE}", {1: unit}):
            yield

    with relayed() as (here, there), in_its_own_loop(serving):
        yield there, unit


def place_of(host: ModbusServer) -> str:
    """PATH or HOST:PORT of a URL."""
    return host.url.partition("://")[2].partition("?")[0]


def port_of(place: str) -> int:
    """The port of HOST:PORT."""
    return int(place.rpartition(":")[2])


def client_url(carrier: str, place: str, certificates: Path, timeout: float = 2.0) -> str:
    """The URL of a server at PATH or HOST:PORT, as our client takes it."""
    if carrier == "tls":
        return tls_url(certificates, "operator", place, unit="1", timeout=str(timeout))
    options = f"{LINE}&" if carrier in ("rtu", "ascii") else "?"
    return f"{carrier}://{place}{options}unit=1&timeout={timeout}"


class Asker:
    """Our client, blocking or asyncio, under the same words; it notes what was answered."""

    def __init__(self, client: Any, seen: Seen) -> None:
        self._client = client
        self._seen = seen

    async def ask(self, request: Any, **how: Any) -> Any:
        """Any message."""
        answer = await _value(self._client.ask(request, **how))
        self._seen.add(service(request))
        return answer

    async def silenced(self) -> None:
        """Force Listen Only: nobody answers."""
        assert isinstance(await self.ask(Diagnostics(FORCE_LISTEN_ONLY), timeout=0.1), Unanswered)

    async def talk(self, make: Callable[..., Any]) -> Any:
        """Any conversation."""
        return await _value(self._client.run_with_bus(make))

    def __getattr__(self, name: str) -> Callable[..., Awaitable[Any]]:
        async def said(*values: Any, **named: Any) -> Any:
            answer = await _value(getattr(self._client, name)(*values, **named))
            request, _ = getattr(ModbusMethods, name).__wrapped__(self._client, *values, **named)
            self._seen.add(service(request))
            return answer

        return said


async def _value(said: Any) -> Any:
    return await said if inspect.isawaitable(said) else said


def until(happened: Callable[[], bool]) -> None:
    """Wait for what our server does in its own thread, half a minute at most."""
    give_up = time.monotonic() + 30.0
    while not happened():
        assert time.monotonic() < give_up
        time.sleep(0.01)


def with_both(url: str, seen: Seen, talk: Callable[[Asker], Awaitable[None]]) -> None:
    """Have the same conversation with the blocking client, then with the asyncio one."""

    async def main() -> None:
        with ModbusClient(url) as blocking:
            await talk(Asker(blocking, seen))
            blocking.settle()
        async with AsyncModbusClient(url) as waiting:
            await talk(Asker(waiting, seen))

    asyncio.run(main())
