"""The asyncio Modbus server: units on a port of the running loop, by URL.

async with AsyncModbusServer("tcp://0.0.0.0:502", units={1: Table()}) as server:
    ...
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import PSEUDO_TERMINAL
from barewire.io.modbus.carriers import modbus_line
from barewire.io.ports.tcp import place_of
from barewire.io.server.asyncio_ports import SerialServer
from barewire.io.server.asyncio_stream import server_at
from barewire.io.server.base import AsyncServer
from barewire.io.server.connection_limits import ConnectionTable, Inject
from barewire.io.server.modbus import may_delay, port_number, server_endpoint
from barewire.modbus.server.server import ServerStatistics

if TYPE_CHECKING:
    from typing import Unpack

    from barewire.io.endpoint import SetDirection
    from barewire.io.fault_injection.faults import GivenFaults
    from barewire.io.modbus.carriers import ModbusOptions
    from barewire.io.server.asyncio_ports import DatagramServer
    from barewire.io.server.asyncio_stream import StreamServer
    from barewire.modbus import Authorization, Unit


class AsyncModbusServer(AsyncServer):
    """A server of units on a port of the running loop. The arguments are those of `ModbusServer`, and:

    listener        a socket that is already bound, on which the server listens; by default it binds one

    The constructor opens nothing; `async with` or `await start()` opens the port. A serial line has to exist: only
    `ModbusServer` makes pseudo-terminals. Units need no locks, because nothing in a unit awaits.

    Raises EncodeError for a wrong URL or option when it is constructed, PortError for a port that cannot be opened.
    """

    def __init__(
        self,
        url: str,
        units: Mapping[int, Unit],
        *,
        authorization: Authorization | None = None,
        set_direction: SetDirection | None = None,
        listener: socket.socket | None = None,
        faults: GivenFaults | None = None,
        fault_seed: int | None = None,
        fault_delay: float | None = None,
        on_fault: Callable[[str], None] | None = None,
        **options: Unpack[ModbusOptions],
    ) -> None:
        self._endpoint = server_endpoint(url, units, set_direction, options)
        if self._endpoint.place == PSEUDO_TERMINAL:
            raise EncodeError(f"endpoint {url!r}: pseudo-terminals are made by ModbusServer, in a thread")
        modbus_line(self._endpoint, "server", units)  # raises for wrong options
        self.url = str(self._endpoint)
        self.connections: ConnectionTable[Any] = ConnectionTable(self._endpoint)
        """The open connections, and why others were closed. Empty for UDP and serial lines."""
        self.statistics = ServerStatistics()
        """Counters of all connections, and the latest errors in the code of units."""
        self._units = units
        self._listener = listener
        self._inject: Inject | None = None
        if faults is None and may_delay(units):
            faults = ()  # the part of the server that delays answers is the fault injector
        if faults is not None:
            from barewire.io.fault_injection.faults import faults_at
            from barewire.io.fault_injection.ports import LoopFaultInjector

            self._inject = LoopFaultInjector(
                faults_at(self._endpoint, faults, seed=fault_seed, delay=fault_delay, on_fault=on_fault)
            )
        self._server: StreamServer | DatagramServer | SerialServer | None = None
        self._network: StreamServer | DatagramServer | None = None
        if not self._endpoint.is_serial_port:
            self._network = server_at(self._endpoint, units, authorization, self._inject)
            self.connections = self._network.connections
            self.statistics = self._network.statistics

    @property
    def port(self) -> int:
        """The number of the TCP or UDP port that it listens on. Raises PortError for a serial line, which has none."""
        return port_number(self.url)

    @property
    def authorization(self) -> Authorization | None:
        """The rights of each role. They cannot be set later: connections without a role would not be checked."""
        return getattr(self._network, "authorization", None)

    @property
    def failure(self) -> PortError | None:
        """The error of the serial port that ended the server, or None."""
        return self._server.failure if isinstance(self._server, SerialServer) else None

    async def _open(self) -> None:
        if self._network is None:
            self._server = SerialServer(self._endpoint, self._units, self._inject, self.statistics)
            return
        self._server = self._network
        await self._network.listen(self._listener)
        place = place_of(self._endpoint.host_and_port[0], self._network.port)
        self.url = str(self._endpoint._replace(place=place))

    async def _release(self) -> None:
        if self._server is not None:
            await self._server.close()
