"""barewire as a backend of modbus-connection, the Modbus layer of Home Assistant's device libraries.

    from modbus_connection import ModbusSerialParams
    from barewire_modbus_connection import ModbusConnection

    connection = ModbusConnection(ModbusSerialParams(device="/dev/ttyUSB0", baudrate=9600))
    unit = connection.for_unit(7)
    await unit.read_holding_registers(107, 3)          -> [555, 0, 100]

modbus-connection decides when to connect, whose turn it is and how long the line stays quiet; a backend carries out
one request at a time and reports when the link is lost:

    device library  ->  ModbusUnit  ->  its turn (Pacer)  ->  AsyncModbusClient  ->  TCP, TLS, UDP, a serial line

The line of a connection has one barewire client for as long as the connection exists, over all its links. So an
answer that comes after its time-out is recognised as late also if the link was closed and opened in between.
"""

from __future__ import annotations

import functools
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from ssl import SSLContext
from typing import Any, Concatenate
from urllib.parse import quote

from modbus_connection import (
    ModbusConnection as BaseConnection,
    ModbusConnectionError,
    ModbusError,
    ModbusExceptionError,
    ModbusProtocolError,
    ModbusSerialParams,
    ModbusTcpParams,
    ModbusTimeoutError,
    ModbusTlsParams,
    ModbusUdpParams,
)
from modbus_connection.exceptions import _describe

from barewire import AsyncModbusClient
from barewire.errors import BarewireError, EncodeError, NoAnswer, PortError, Refused
from barewire.modbus.messages.comm_events import READY

__all__ = [
    "SUPPORTED_FRAMINGS",
    "BarewireUnit",
    "ModbusConnection",
    "connect_serial",
    "connect_tcp",
    "connect_tls",
    "connect_udp",
]

Params = ModbusTcpParams | ModbusUdpParams | ModbusTlsParams | ModbusSerialParams

SUPPORTED_FRAMINGS: Mapping[str, tuple[str, ...]] = {
    "tcp": ("socket", "rtu", "ascii"),
    "udp": ("socket",),
    "tls": ("socket",),
    "serial": ("rtu", "ascii"),
}
"""The framings of each transport, as the other backends state theirs."""


def endpoint(params: Params) -> tuple[str, dict[str, Any]]:
    """Return the URL of barewire for a link, and the options of its line. Raises ValueError for a link that it does
    not have.

    >>> endpoint(ModbusTcpParams(host="10.0.0.5"))
    ('tcp://10.0.0.5:502', {})
    >>> endpoint(ModbusSerialParams(device="socket://10.0.0.5:4001"))
    ('rtu+tcp://10.0.0.5:4001', {})
    """
    if isinstance(params, ModbusSerialParams):
        return _serial_endpoint(params)
    host = f"[{params.host}]" if ":" in params.host else params.host
    place = f"{quote(host, safe='[]:')}:{params.port}"
    if isinstance(params, ModbusTlsParams):
        return f"tls://{place}", {}
    if params.framer == "socket":
        return f"{'udp' if isinstance(params, ModbusUdpParams) else 'tcp'}://{place}", {}
    if isinstance(params, ModbusUdpParams):
        raise ValueError(f"no {params.framer} framing over UDP: use modbus_connection.pymodbus.ModbusConnection")
    return f"{params.framer}+tcp://{place}", {}


def _serial_endpoint(params: ModbusSerialParams) -> tuple[str, dict[str, Any]]:
    """Return the URL and options of a serial port, or of a serial server that passes its line on over TCP."""
    scheme, is_url, place = params.device.rpartition("://")
    if is_url and scheme != "socket":
        raise ValueError(f"device {params.device!r}: expected the path of a serial port, or socket://HOST:PORT")
    if is_url:  # the serial server keeps the speed and the silences of its line; bytes on TCP have neither
        return f"{params.framer}+tcp://{quote(place, safe='[]:')}", {}
    line = {name: getattr(params, name) for name in ("baudrate", "bytesize", "parity", "stopbits")}
    return f"{params.framer}://{quote(params.device)}", line


class ModbusConnection(BaseConnection):
    """A connection that barewire carries. Construction opens nothing; the first request connects.

    `tuning` is that of every backend: timeout, message_spacing, connect_delay, in seconds. Raises ValueError for params
    that no line can have, such as RTU with 7 data bits.
    """

    def __init__(self, params: Params, **tuning: float | None) -> None:
        self._url, self._options = endpoint(params)
        super().__init__(params, **tuning)
        self._line = None if isinstance(params, ModbusTlsParams) else self._new_line(None)

    def for_unit(self, unit_id: int) -> BarewireUnit:
        """Return the handle of one unit."""
        return BarewireUnit(self, unit_id)

    def _new_line(self, ssl_context: SSLContext | None) -> AsyncModbusClient:
        return AsyncModbusClient(
            self._url, timeout=self._timeout, ssl_context=ssl_context, on_lost=self._on_connection_lost, **self._options
        )

    async def _connect_client(self) -> AsyncModbusClient:
        """Open the link. Certificates are read each time: they are renewed while a program runs."""
        try:
            if isinstance(self._params, ModbusTlsParams):
                self._line = self._new_line(await self._params.create_ssl_context())
            assert self._line is not None
            await self._line.open()
        except OSError as error:  # PortError is one; files of certificates raise others
            serial = isinstance(self._params, ModbusSerialParams)
            text = f"could not {'open serial port' if serial else 'connect to'} {self._target}: {error}"
            # `open` says in its text only that nothing answered in time.
            timed_out = isinstance(error.__context__, TimeoutError)
            raise (ModbusTimeoutError if timed_out else ModbusConnectionError)(text) from error
        return self._line

    async def _close_client(self, client: AsyncModbusClient) -> None:
        """Close the link. What the line remembers of its requests stays, unless the connection is closed for good."""
        if self._closed:
            await client.close()
        else:
            client.connection.drop("disconnected")

    def _on_connection_lost(self, why: str | None) -> None:
        """Report that the link is lost. If it is not in use any more, this connection closed it itself."""
        if self._client is not None and not self._closed:
            self._client = None
            self._lost_callbacks.fire()


def _translated(place: str, error: BarewireError) -> ModbusError:
    """Return the neutral form of an error of barewire. `place` is the call that it interrupted."""
    text = f"{place}: {error}"
    # A NoAnswer has a cause if no answer can come any more: the port failed, or a wrong response came in its place.
    reason = error.__cause__ if isinstance(error, NoAnswer) and error.__cause__ else error
    if isinstance(reason, Refused):
        return ModbusExceptionError.from_code(reason.code, text)
    if isinstance(reason, PortError):
        return ModbusConnectionError(text)
    return ModbusTimeoutError(text) if isinstance(reason, NoAnswer) else ModbusProtocolError(text)


def _operation[**P, R](
    operation: Callable[Concatenate[BarewireUnit, P], Awaitable[R]],
) -> Callable[Concatenate[BarewireUnit, P], Coroutine[Any, Any, R]]:
    """Connect before an operation, wait for its turn, and translate its errors. An EncodeError is a ValueError of the
    caller, and stays one."""

    @functools.wraps(operation)
    async def call(self: BarewireUnit, /, *args: P.args, **kwargs: P.kwargs) -> R:
        connection = self._connection
        await connection.connect()
        place = _describe(operation.__name__, args, kwargs)
        try:
            async with connection._pacer.paced(self._unit_id):
                await connection.connect()  # again: the link may have been dropped while this request waited
                return await operation(self, *args, **kwargs)
        except ModbusError as error:
            error.args = (f"{place}: {error}",)
            raise
        except EncodeError:
            raise
        except BarewireError as error:
            raise _translated(place, error) from error

    return call


class BarewireUnit:
    """One unit on a connection: the protocol `ModbusUnit` of modbus-connection."""

    def __init__(self, connection: ModbusConnection, unit_id: int) -> None:
        self._connection = connection
        self._unit_id = unit_id
        self.on_connection_lost = connection.on_connection_lost
        self.disconnect = connection.disconnect

    @property
    def connected(self) -> bool:
        """Whether the link is open."""
        return self._connection.connected

    @property
    def _unit(self) -> AsyncModbusClient:
        """The client of the line, for this unit and with the time-out that the units of the link have asked for."""
        client: AsyncModbusClient = self._connection._client
        return client.at(self._unit_id, self._connection._timeout)

    def set_message_spacing(self, seconds: float) -> None:
        """Keep the line quiet for `seconds` before and after each request to this unit."""
        self._connection._pacer.set_unit_spacing(self._unit_id, seconds)

    def require_timeout(self, seconds: float | None) -> None:
        """Ask for a time-out of at least `seconds`; None withdraws it."""
        self._connection._require_timeout(self._unit_id, seconds)

    def require_connect_delay(self, seconds: float | None) -> None:
        """Ask for a pause of at least `seconds` after the link is opened; None withdraws it."""
        self._connection._require_connect_delay(self._unit_id, seconds)

    @_operation
    async def read_coils(self, address: int, count: int) -> list[bool]:
        """Read coils (function 01)."""
        return list(await self._unit.read_coils(address, count))

    @_operation
    async def read_discrete_inputs(self, address: int, count: int) -> list[bool]:
        """Read discrete inputs (function 02)."""
        return list(await self._unit.read_discrete_inputs(address, count))

    @_operation
    async def read_holding_registers(self, address: int, count: int) -> list[int]:
        """Read holding registers (function 03)."""
        return list(await self._unit.read_holding_registers(address, count))

    @_operation
    async def read_input_registers(self, address: int, count: int) -> list[int]:
        """Read input registers (function 04)."""
        return list(await self._unit.read_input_registers(address, count))

    @_operation
    async def write_coil(self, address: int, value: bool) -> None:
        """Write one coil (function 05)."""
        await self._unit.write_single_coil(address, value)

    @_operation
    async def write_register(self, address: int, value: int) -> None:
        """Write one holding register (function 06)."""
        await self._unit.write_single_register(address, value)

    @_operation
    async def read_exception_status(self) -> int:
        """Read the eight exception status bits (function 07)."""
        return await self._unit.read_exception_status()

    @_operation
    async def diagnostics(self, sub_function: int, data: int = 0) -> int:
        """Carry out a diagnostic sub-function with one word of data; returns that of the response (function 08)."""
        if not 0 <= data <= 0xFFFF:
            raise ValueError(f"data {data}: expected 0..65535")
        return int.from_bytes(await self._unit.diagnostics(sub_function, data.to_bytes(2)))

    @_operation
    async def get_comm_event_counter(self) -> tuple[bool, int]:
        """Read whether the unit is ready, and its event counter (function 0B)."""
        response = await self._unit.get_comm_event_counter()
        return response.status == READY, response.event_count

    @_operation
    async def get_comm_event_log(self) -> bytes:
        """Read the latest events, one byte each (function 0C)."""
        return bytes((await self._unit.get_comm_event_log()).events)

    @_operation
    async def write_coils(self, address: int, values: list[bool]) -> None:
        """Write coils (function 0F)."""
        await self._unit.write_multiple_coils(address, values)

    @_operation
    async def write_registers(self, address: int, values: list[int]) -> None:
        """Write holding registers (function 10h)."""
        await self._unit.write_multiple_registers(address, values)

    @_operation
    async def report_server_id(self) -> bytes:
        """Read the ID of the server, its run indicator and what it adds (function 11h)."""
        return await self._unit.report_server_id()

    @_operation
    async def read_file_record(self, file: int, record: int, length: int) -> list[int]:
        """Read the registers of one record (function 14h)."""
        ((*registers,),) = await self._unit.read_file_record([(file, record, length)])
        return registers

    @_operation
    async def write_file_record(self, file: int, record: int, values: list[int]) -> None:
        """Write the registers of one record (function 15h)."""
        await self._unit.write_file_record([(file, record, values)])

    @_operation
    async def mask_write_register(self, address: int, and_mask: int, or_mask: int) -> None:
        """Set and clear bits of a holding register (function 16h)."""
        await self._unit.mask_write_register(address, and_mask, or_mask)

    @_operation
    async def read_write_registers(
        self, read_address: int, read_count: int, write_address: int, write_values: list[int]
    ) -> list[int]:
        """Write holding registers, then read others, in one exchange (function 17h)."""
        unit = self._unit
        return list(await unit.read_write_multiple_registers(read_address, read_count, write_address, write_values))

    @_operation
    async def read_fifo_queue(self, address: int) -> list[int]:
        """Read a FIFO queue, whose registers stay in it (function 18h)."""
        return list(await self._unit.read_fifo_queue(address))

    @_operation
    async def read_device_identification(self) -> dict[int, bytes]:
        """Read the basic identification: vendor, product and revision (function 2Bh/0Eh)."""
        return (await self._unit.read_device_identification()).objects


# What the other backends offer besides: functions that connect at once ------------------------------------------------


async def _connected(params: Callable[..., Params], options: dict[str, Any]) -> ModbusConnection:
    """Return an open connection. The options that are not those of a connection are the fields of its params."""
    tuning = {name: options.pop(name) for name in ("timeout", "message_spacing", "connect_delay") if name in options}
    connection = ModbusConnection(params(**options), **tuning)
    await connection.connect()
    return connection


async def connect_tcp(host: str, **options: Any) -> ModbusConnection:
    """Connect over TCP. Raises ModbusConnectionError if that fails, as the functions below do."""
    return await _connected(ModbusTcpParams, {"host": host, **options})


async def connect_udp(host: str, **options: Any) -> ModbusConnection:
    """Prepare datagrams to a host."""
    return await _connected(ModbusUdpParams, {"host": host, **options})


async def connect_tls(host: str, **options: Any) -> ModbusConnection:
    """Connect over TLS."""
    return await _connected(ModbusTlsParams, {"host": host, **options})


async def connect_serial(port: str, **options: Any) -> ModbusConnection:
    """Open a serial port."""
    return await _connected(ModbusSerialParams, {"device": port, **options})
