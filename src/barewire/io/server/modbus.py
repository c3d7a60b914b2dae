"""The Modbus servers: units on a port, by URL; `ModbusServer` in a thread, `AsyncModbusServer` in the running loop.

    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as server:
        server.url          the URL that clients use: with the port number, or the pseudo-terminal, that it got

    async with AsyncModbusServer("tcp://0.0.0.0:502", units={1: Table()}) as server: ...

    kind of port                      in a thread                        in the running loop
    tcp                               `tcp`: without an event loop       `asyncio_network`
    tls, udp, rtu+tcp, ascii+tcp      `asyncio_network`, in a thread     `asyncio_network`
    rtu, ascii                        `serial`                           `serial`

Each of these files is loaded when a URL needs it. Several servers in threads may serve the same units: only one thread
at a time enters a unit (`locking`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol

from barewire._callbacks import deferred
from barewire.errors import EncodeError, PortError, shown
from barewire.io.endpoint import CARRIERS, PSEUDO_TERMINAL
from barewire.io.engine.locking import SharedUnits
from barewire.io.modbus.carriers import modbus_endpoint
from barewire.io.server.base import AsyncServer, ThreadedServer

if TYPE_CHECKING:
    import socket
    from ssl import SSLContext
    from typing import Unpack

    from barewire.io.endpoint import Endpoint, SetDirection
    from barewire.io.fault_injection.faults import Faults, GivenFaults
    from barewire.io.modbus.carriers import ModbusOptions
    from barewire.io.server.asyncio_network import DatagramServer, StreamServer
    from barewire.io.server.limits import ConnectionTable
    from barewire.io.server.serial import SerialServer
    from barewire.modbus import AnyUnit, Authorization
    from barewire.modbus.server.server import ServerStatistics


_SERVED = ("tcp", "tls", "udp", "serial")
"""The transports that have a server."""


class Counted(Protocol):
    """What is counted of a port."""

    statistics: ServerStatistics

    @property
    def connections(self) -> ConnectionTable[Any]: ...


class Service(Counted, Protocol):
    """Serves units on one kind of port, which its constructor opens."""

    url: str

    def serve(self, is_over: Callable[[], bool]) -> None: ...

    def close(self) -> None: ...


class _Served:
    """What both servers tell of the service that serves their port."""

    url: str
    _service: Counted

    @property
    def port(self) -> int:
        """The number of the TCP or UDP port that it listens on. Raises PortError for a serial line, which has none."""
        return _port_number(self.url)

    @property
    def connections(self) -> ConnectionTable[Any]:
        """The open connections, and why others were closed. Empty for UDP and serial lines."""
        return self._service.connections

    @property
    def statistics(self) -> ServerStatistics:
        """Counters of requests and connections, and the latest errors in the code of units."""
        return self._service.statistics


class ModbusServer(_Served, ThreadedServer):
    """A server of units on a port. The constructor opens the port; `with`, `start()` or `run(stop)` serve.

    url             one of the forms that `barewire.io.endpoint` lists; port 0 takes a free port
    units           by unit address, 0..255: a `Table`, `Functions`, or any object with handle(request, now)
    authorization   the rights of each role of a TLS certificate; by default the table that the URL names as `roles`
    set_direction   called as set_direction(sending) to set the direction of a two-wire line, for example by a GPIO pin
    ssl_context     an `ssl.SSLContext` for tls://, in place of the files of the URL, with a `verify_mode`
    faults          the faults in the answers: kinds and probabilities as a text, "late:0.5,drop", or a dict; faults of
                    selected answers as a text, "exception=04@20,drop@nth=5", or objects of `Fault`; by default none
                    (`barewire.io.fault_injection.faults` explains the text, `faults` lists the kinds)
    fault_seed      an integer with which the same answers have the same faults; by default they are random
    fault_delay     the delay of a late answer in seconds; by default 1.5
    on_fault        called as on_fault(kind) for each fault
    options         all other options of a URL, which they override

    An error in the code of a unit is exception 04 for the client. It is logged with its traceback, under the name
    `barewire.modbus.server`, as are connections and refusals; `statistics` counts them, and has the latest ten errors.

    Raises EncodeError for a wrong URL or option, PortError for a port that cannot be taken.
    """

    _logger = "barewire.modbus.server"
    _service: Service

    def __init__(
        self,
        url: str,
        units: Mapping[int, AnyUnit],
        *,
        authorization: Authorization | None = None,
        set_direction: SetDirection | None = None,
        ssl_context: SSLContext | None = None,
        faults: GivenFaults | None = None,
        fault_seed: int | None = None,
        fault_delay: float | None = None,
        on_fault: Callable[[str], None] | None = None,
        **options: Unpack[ModbusOptions],
    ) -> None:
        super().__init__()
        endpoint = _server_endpoint(url, units, set_direction, ssl_context, options)
        self.faults = _faults_of(endpoint, units, faults, fault_seed, fault_delay, on_fault)
        self._service = _service(endpoint, SharedUnits(units), authorization, self.faults)
        self.url = self._service.url

    def _serve(self, stop: threading.Event) -> None:
        self._service.serve(lambda: self.is_over(stop))

    def _release(self) -> None:
        self._service.close()


class AsyncModbusServer(_Served, AsyncServer):
    """A server of units on a port of the running loop. The arguments are those of `ModbusServer`, and:

    listener        a socket that is already bound, on which the server listens; by default it binds one

    The constructor opens nothing; `async with` or `await start()` opens the port. A serial line has to exist: only
    `ModbusServer` makes pseudo-terminals. Units need no locks, because nothing in a unit awaits.

    Raises EncodeError for a wrong URL or option when it is constructed, PortError for a port that cannot be opened.
    """

    _service: StreamServer | DatagramServer | SerialServer

    def __init__(
        self,
        url: str,
        units: Mapping[int, AnyUnit],
        *,
        authorization: Authorization | None = None,
        set_direction: SetDirection | None = None,
        ssl_context: SSLContext | None = None,
        listener: socket.socket | None = None,
        faults: GivenFaults | None = None,
        fault_seed: int | None = None,
        fault_delay: float | None = None,
        on_fault: Callable[[str], None] | None = None,
        **options: Unpack[ModbusOptions],
    ) -> None:
        self._endpoint = _server_endpoint(url, units, set_direction, ssl_context, options, may_await=True)
        if self._endpoint.place == PSEUDO_TERMINAL:
            raise EncodeError(f"endpoint {url!r}: pseudo-terminals are made by ModbusServer, in a thread")
        self.url = str(self._endpoint)
        self._listener = listener
        self.faults = _faults_of(self._endpoint, units, faults, fault_seed, fault_delay, on_fault)
        """As that of `ModbusServer`: the model of the faults, or None."""
        inject = None
        if self.faults is not None:
            from barewire.io.fault_injection.ports import LoopFaultInjector

            inject = LoopFaultInjector(self.faults)
        if self._endpoint.is_serial_port:
            from barewire.io.server.serial import SerialServer

            self._service = SerialServer(self._endpoint, units, inject)
        else:
            from barewire.io.server.asyncio_network import server_at

            self._service = server_at(self._endpoint, units, authorization, inject)

    @property
    def authorization(self) -> Authorization | None:
        """The rights of each role. They cannot be set later: connections without a role would not be checked."""
        return getattr(self._service, "authorization", None)

    @property
    def failure(self) -> PortError | None:
        """The error of the serial port that ended the server, or None."""
        return self._service.failure

    async def _open(self) -> None:
        await self._service.listen(self._listener)
        self.url = self._service.url

    async def _release(self) -> None:
        await self._service.close()


def _service(
    endpoint: Endpoint,
    units: Mapping[int, AnyUnit],
    authorization: Authorization | None,
    faults: Faults[bytes] | None,
) -> Service:
    if endpoint.is_serial_port:
        from barewire.io.server.serial import SerialService

        return SerialService(endpoint, units, faults)
    if endpoint.framing == "tcp" and endpoint.transport == "tcp":
        from barewire.io.server.tcp import TcpService

        if faults is None:
            return TcpService(endpoint, units)
        from barewire.io.fault_injection.ports import FaultInjector

        return TcpService(endpoint, units, FaultInjector(faults))
    from barewire.io.server.asyncio_network import AsyncioService

    if faults is None:
        return AsyncioService(endpoint, units, authorization)
    from barewire.io.fault_injection.ports import LoopFaultInjector

    return AsyncioService(endpoint, units, authorization, LoopFaultInjector(faults))


def _faults_of(
    endpoint: Endpoint,
    units: Mapping[int, AnyUnit],
    faults: GivenFaults | None,
    seed: int | None,
    delay: float | None,
    on_fault: Callable[[str], None] | None,
) -> Faults[bytes] | None:
    """Return the faults in the answers of a server. With none, the model delays the answers of units that may return
    `Delayed` ones."""

    may_delay = any(getattr(units.get(address), "delays", False) for address in units.keys())  # noqa: SIM118
    if faults is None and not may_delay:
        return None
    from barewire.io.fault_injection.faults import faults_at

    return faults_at(endpoint, () if faults is None else faults, seed=seed, delay=delay, on_fault=on_fault)


def _server_endpoint(
    url: str,
    units: Mapping[int, AnyUnit],
    set_direction: SetDirection | None,
    ssl_context: SSLContext | None,
    options: Mapping[str, object],
    *,
    may_await: bool = False,
) -> Endpoint:
    """Return the endpoint of a server of `units`. Raise EncodeError for a wrong URL, option or unit."""
    endpoint = modbus_endpoint(url, options).with_direction(set_direction).with_context(ssl_context)
    if endpoint.transport not in _SERVED:
        expected = ", ".join(f"{scheme}://" for scheme, carrier in CARRIERS.items() if carrier.transport in _SERVED)
        raise EncodeError(f"endpoint {url!r}: there is no server for {endpoint.scheme}://, expected {expected}")
    _check_units(units, has_broadcasts=endpoint.framing != "tcp", may_await=may_await)
    return endpoint


def _check_units(units: Mapping[int, AnyUnit], *, has_broadcasts: bool, may_await: bool) -> None:
    """Raise EncodeError unless `units` maps unit addresses, 0 to 255, to objects with `handle` or `handle_pdu`.

    `may_await`: that may be `async def handle_pdu`.
    """
    if not hasattr(units, "get") or not hasattr(units, "keys"):
        raise EncodeError(
            f"units: expected a dict of unit address and unit, such as {{1: Table()}}, got {shown(units)}"
        )
    for address in units.keys():  # noqa: SIM118 - an object with `get` and `keys` need not be iterable
        # A number of numpy is equal to the plain one, and so finds its unit.
        if isinstance(address, bool) or not hasattr(address, "__index__") or not 0 <= address <= 255:
            raise EncodeError(f"units: address {shown(address)}: expected 0..255")
        if has_broadcasts and not address:
            why = "a serial line has no unit 0, its requests are broadcasts"
            raise EncodeError(f"units: address 0: {why}: expected 1..255")
        unit = units.get(address)
        if isinstance(unit, type):
            name = unit.__name__
            raise EncodeError(f"units: unit {address}: the class {name}: expected an instance, {name}(...)")
        name = "handle" if hasattr(unit, "handle") else "handle_pdu"
        handle = getattr(unit, name, None)
        if not callable(handle):
            expected = "a Table, Functions, simulator(...).modbus, or an object with handle(request, now)"
            raise EncodeError(f"units: unit {address}: {shown(unit)}: expected {expected}")
        kind = deferred(handle)
        if kind and not (may_await and name == "handle_pdu"):
            raise EncodeError(
                f"units: unit {address}: its method {name} is {kind}: expected one that returns the response"
            )


def _port_number(url: str) -> int:
    """Return the port number in the URL of a server. Raises PortError for a serial line."""
    endpoint = modbus_endpoint(url)
    if endpoint.is_serial_port:
        raise PortError(f"{url}: a serial line has no port number")
    return endpoint.host_and_port[1]
