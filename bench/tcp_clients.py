"""Clients of Modbus TCP, each used as its documentation shows: they read ten registers over an open connection.

A blocking client is a function of the port; it returns a function that reads once. An asyncio client also takes the
number of requests in flight, and returns a function that is awaited.
"""

from __future__ import annotations

import asyncio
import ctypes
import ctypes.util
import socket
import struct
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from typing import Any

from bench.race import Work

REQUEST = struct.Struct(">HHHBBHH")
Connect = Callable[[int, ExitStack], Work]


# Blocking clients ------------------------------------------------------------------------------------------------


def raw_socket(port: int, closing: ExitStack, flight: int = 1) -> Work:
    """The floor: pack a request, unpack the answer; no check, and no time-out for a single request."""
    connection = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    # A single request is always answered. Of many at once some servers answer the first and drop the others.
    connection.settimeout(None if flight == 1 else 2.0)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    send, receive = connection.sendall, connection.recv
    pack, unpack = REQUEST.pack, struct.Struct(">10H").unpack_from
    size = flight * 29
    number = 0

    def read_once() -> tuple[int, ...]:
        nonlocal number
        number = number + 1 & 0xFFFF
        send(pack(number, 0, 6, 1, 3, 0, 10))
        return unpack(receive(4096), 9)

    def ask_many() -> tuple[int, ...]:
        send(b"".join([pack(at, 0, 6, 1, 3, 0, 10) for at in range(flight)]))
        data = receive(4096)
        while len(data) < size:
            data += receive(4096)
        return [unpack(data, at + 9) for at in range(0, size, 29)][-1]

    return read_once if flight == 1 else ask_many


def socket_with_timeout(port: int, closing: ExitStack) -> Work:
    """The floor with a time-out, and with a check before each request whether the server has closed the connection."""
    connection = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    import select

    look = select.poll()
    look.register(connection, select.POLLIN)
    connection.settimeout(1.0)
    pack, unpack = REQUEST.pack, struct.Struct(">10H").unpack_from
    number = 0

    def read_once() -> tuple[int, ...]:
        nonlocal number
        number = number + 1 & 0xFFFF
        if look.poll(0):
            raise ValueError
        connection.sendall(pack(number, 0, 6, 1, 3, 0, 10))
        return unpack(connection.recv(4096), 9)

    return read_once


def barewire(port: int, closing: ExitStack) -> Work:
    from barewire import ModbusClient

    client = closing.enter_context(ModbusClient(f"tcp://127.0.0.1:{port}"))
    return lambda: client.read_holding_registers(0, 10)


def pymodbus(port: int, closing: ExitStack) -> Work:
    from pymodbus.client import ModbusTcpClient

    client = ModbusTcpClient("127.0.0.1", port=port)
    client.connect()
    closing.callback(client.close)
    return lambda: client.read_holding_registers(0, count=10, device_id=1).registers


def py_modbus_tcp(port: int, closing: ExitStack) -> Work:
    from pyModbusTCP.client import ModbusClient

    client = ModbusClient("127.0.0.1", port)
    closing.callback(client.close)
    return lambda: client.read_holding_registers(0, 10)


def modbus_tk(port: int, closing: ExitStack) -> Work:
    from modbus_tk.modbus_tcp import TcpMaster

    master = TcpMaster("127.0.0.1", port)
    closing.callback(master.close)
    return lambda: master.execute(1, 3, 0, 10)


def umodbus(port: int, closing: ExitStack) -> Work:
    from umodbus.client import tcp

    connection = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return lambda: tcp.send_message(tcp.read_holding_registers(1, 0, 10), connection)


def libmodbus(port: int, closing: ExitStack) -> Work:
    name = ctypes.util.find_library("modbus")
    if name is None:
        raise ImportError("libmodbus is not installed")
    library = ctypes.CDLL(name)
    library.modbus_new_tcp.restype = ctypes.c_void_p
    context = ctypes.c_void_p(library.modbus_new_tcp(b"127.0.0.1", port))
    library.modbus_set_slave(context, 1)
    if library.modbus_connect(context):
        raise OSError("libmodbus did not connect")
    closing.callback(library.modbus_close, context)
    row = (ctypes.c_uint16 * 10)()
    read = library.modbus_read_registers

    def read_once() -> tuple[int, ...]:
        if read(context, 0, 10, row) != 10:
            raise OSError("libmodbus did not get its answer")
        return tuple(row)

    return read_once


BLOCKING: dict[str, Connect] = {
    "raw socket": raw_socket,
    "raw socket, time-out": socket_with_timeout,
    "barewire": barewire,
    "pymodbus": pymodbus,
    "pyModbusTCP": py_modbus_tcp,
    "modbus-tk": modbus_tk,
    "uModbus": umodbus,
    "libmodbus (C, ctypes)": libmodbus,
}


# Asyncio clients -------------------------------------------------------------------------------------------------


class RawClient(asyncio.Protocol):
    """The floor: a future for each request, found by its number."""

    def __init__(self) -> None:
        self.pending: dict[int, asyncio.Future[tuple[int, ...]]] = {}
        self.number = 0
        self.unpack = struct.Struct(">10H").unpack_from

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.loop = asyncio.get_running_loop()

    def data_received(self, data: bytes) -> None:
        for at in range(0, len(data), 29):
            self.pending.pop(data[at] << 8 | data[at + 1]).set_result(self.unpack(data, at + 9))

    async def read_once(self) -> tuple[int, ...]:
        self.number = self.number + 1 & 0xFFFF
        answer = self.pending[self.number] = self.loop.create_future()
        self.transport.write(REQUEST.pack(self.number, 0, 6, 1, 3, 0, 10))
        return await answer


ReadOnce = Callable[[], Awaitable[Any]]


async def raw_protocol(port: int, flight: int, closing: ExitStack) -> ReadOnce:
    _, protocol = await asyncio.get_running_loop().create_connection(RawClient, "127.0.0.1", port)
    closing.callback(lambda: protocol.transport.abort())
    return protocol.read_once


async def barewire_async(port: int, flight: int, closing: ExitStack) -> ReadOnce:
    from barewire import AsyncModbusClient

    client = AsyncModbusClient(f"tcp://127.0.0.1:{port}", in_flight=flight)
    closing.callback(client.connection.close)
    return lambda: client.read_holding_registers(0, 10)


async def pymodbus_async(port: int, flight: int, closing: ExitStack) -> ReadOnce:
    from pymodbus.client import AsyncModbusTcpClient

    client = AsyncModbusTcpClient("127.0.0.1", port=port)
    await client.connect()
    closing.callback(client.close)

    async def read_once() -> Any:
        return (await client.read_holding_registers(0, count=10, device_id=1)).registers

    return read_once


async def tmodbus_async(port: int, flight: int, closing: ExitStack) -> ReadOnce:
    from tmodbus import create_async_tcp_client

    client = create_async_tcp_client("127.0.0.1", port, unit_id=1)
    await client.connect()
    return lambda: client.read_holding_registers(0, 10)


ASYNC: dict[str, Callable[[int, int, ExitStack], Awaitable[ReadOnce]]] = {
    "raw protocol": raw_protocol,
    "barewire": barewire_async,
    "pymodbus": pymodbus_async,
    "tmodbus": tmodbus_async,
}
