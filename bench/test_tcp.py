"""Modbus TCP on the loopback: ten registers, again and again, over one connection; then over many at once.

Client and server are two processes. *Two cores*: each has its own, and the wait for the other one to wake up is in the
time, as it is wherever the two are not one program. *One core*: both on the same, so nobody ever waits and nothing is
counted but work; this is the strict one. *Its own work*: the same, but what is counted is the processor time of the
client alone, whatever else the machine does. Every client talks to the same server, every server to the same client.
"""

from __future__ import annotations

import asyncio
import ctypes
import ctypes.util
import socket
import struct
import time
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

import pytest

from bench.race import Factory, Many, Race, Work, entries
from bench.servers import CORES, IMAGE, REGISTERS, SERVERS, on_core, start

PLACES = {"two cores": (CORES[0], CORES[-1]), "one core": (CORES[0], CORES[0])}
if len(CORES) < 2:
    del PLACES["two cores"]
OWN_WORK = "its own work"
CLIENT_PLACES = PLACES | {OWN_WORK: PLACES["one core"]}
REQUEST = struct.Struct(">HHHBBHH")
# Short turns and many of them: of two neighbours in time one is as likely to be disturbed as the other.
ROUNDS, TURN = 61, 0.01
Connect = Callable[[int, ExitStack], Work]


# Blocking clients ------------------------------------------------------------------------------------------------


def raw_socket(port: int, closing: ExitStack, flight: int = 1) -> Work:
    """The floor: a request is packed, the answer unpacked, and nobody minds what else may come, or nothing."""
    connection = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    # One at a time is never lost. Of many at once some servers answer the first and drop the others.
    connection.settimeout(None if flight == 1 else 2.0)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    send, receive = connection.sendall, connection.recv
    pack, unpack = REQUEST.pack, struct.Struct(">10H").unpack_from
    size = flight * 29
    number = 0

    def ask() -> tuple[int, ...]:
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

    return ask if flight == 1 else ask_many


def socket_with_timeout(port: int, closing: ExitStack) -> Work:
    """The floor with a time-out and with a look before each question at whether the server has hung up."""
    connection = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    import select

    look = select.poll()
    look.register(connection, select.POLLIN)
    connection.settimeout(1.0)
    pack, unpack = REQUEST.pack, struct.Struct(">10H").unpack_from
    number = 0

    def ask() -> tuple[int, ...]:
        nonlocal number
        number = number + 1 & 0xFFFF
        if look.poll(0):
            raise ValueError
        connection.sendall(pack(number, 0, 6, 1, 3, 0, 10))
        return unpack(connection.recv(4096), 9)

    return ask


def barewire(port: int, closing: ExitStack) -> Work:
    from barewire.shells import open_modbus

    client = closing.enter_context(open_modbus(f"tcp://127.0.0.1:{port}"))
    return lambda: client.read_holding_registers(0, 10)


def pymodbus(port: int, closing: ExitStack) -> Work:
    from pymodbus.client import ModbusTcpClient

    client = ModbusTcpClient("127.0.0.1", port=port)
    client.connect()
    closing.callback(client.close)
    return lambda: tuple(client.read_holding_registers(0, count=10, device_id=1).registers)


def py_modbus_tcp(port: int, closing: ExitStack) -> Work:
    from pyModbusTCP.client import ModbusClient

    client = ModbusClient("127.0.0.1", port)
    closing.callback(client.close)
    return lambda: tuple(client.read_holding_registers(0, 10))


def modbus_tk(port: int, closing: ExitStack) -> Work:
    from modbus_tk.modbus_tcp import TcpMaster

    master = TcpMaster("127.0.0.1", port)
    closing.callback(master.close)
    return lambda: master.execute(1, 3, 0, 10)


def umodbus(port: int, closing: ExitStack) -> Work:
    from umodbus.client import tcp

    connection = closing.enter_context(socket.create_connection(("127.0.0.1", port)))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return lambda: tuple(tcp.send_message(tcp.read_holding_registers(1, 0, 10), connection))


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

    def ask() -> tuple[int, ...]:
        if read(context, 0, 10, row) != 10:
            raise OSError("libmodbus did not get its answer")
        return tuple(row)

    return ask


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


class OwnWork(Many):
    """The processor time of this process for one of `count` pieces of work."""

    measures_itself = True

    def __init__(self, run: Callable[[int], Any]) -> None:
        self._work = run
        super().__init__(self.measure)

    def __call__(self) -> Any:
        return self._work(1)

    def measure(self, count: int) -> float:
        """Seconds."""
        start = time.process_time()
        self._work(count)
        return (time.process_time() - start) / count


def _own_work(work: Work) -> Work:
    def often(count: int) -> Any:
        for _ in range(count):
            found = work()
        return found

    return OwnWork(work.run if isinstance(work, Many) else often)


def _client(make: Connect, server: str, place: str) -> Factory:
    ours, theirs = CLIENT_PLACES[place]

    def factory(closing: ExitStack) -> Work:
        port = start(server, closing, theirs)
        on_core(ours, closing)
        work = make(port, closing)
        return _own_work(work) if place == OWN_WORK else work

    return factory


def _race(family: str, what: str, place: str, contestants: dict[str, Factory], expect: Any) -> Race:
    return Race(family, what, place, contestants, expect, rounds=ROUNDS, turn=TURN)


def blocking(place: str) -> Race:
    contestants = {name: _client(make, "raw", place) for name, make in BLOCKING.items()}
    return _race("TCP client, blocking", "10 registers", place, contestants, REGISTERS)


# Asyncio clients -------------------------------------------------------------------------------------------------


class RawClient(asyncio.Protocol):
    """The floor: a future for each request, found by its number."""

    def __init__(self) -> None:
        self.asked: dict[int, asyncio.Future[tuple[int, ...]]] = {}
        self.number = 0
        self.unpack = struct.Struct(">10H").unpack_from

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.loop = asyncio.get_running_loop()

    def data_received(self, data: bytes) -> None:
        for at in range(0, len(data), 29):
            self.asked.pop(data[at] << 8 | data[at + 1]).set_result(self.unpack(data, at + 9))

    async def ask(self) -> tuple[int, ...]:
        self.number = self.number + 1 & 0xFFFF
        answer = self.asked[self.number] = self.loop.create_future()
        self.transport.write(REQUEST.pack(self.number, 0, 6, 1, 3, 0, 10))
        return await answer


Ask = Callable[[], Awaitable[Any]]


async def raw_protocol(port: int, flight: int, closing: ExitStack) -> Ask:
    _, protocol = await asyncio.get_running_loop().create_connection(RawClient, "127.0.0.1", port)
    closing.callback(lambda: protocol.transport.abort())
    return protocol.ask


async def barewire_async(port: int, flight: int, closing: ExitStack) -> Ask:
    from barewire.shells import open_async

    client = await open_async(f"tcp://127.0.0.1:{port}", in_flight=flight)
    closing.callback(client.close)
    return lambda: client.read_holding_registers(0, 10)


async def pymodbus_async(port: int, flight: int, closing: ExitStack) -> Ask:
    from pymodbus.client import AsyncModbusTcpClient

    client = AsyncModbusTcpClient("127.0.0.1", port=port)
    await client.connect()
    closing.callback(client.close)

    async def ask() -> tuple[int, ...]:
        return tuple((await client.read_holding_registers(0, count=10, device_id=1)).registers)

    return ask


async def tmodbus_async(port: int, flight: int, closing: ExitStack) -> Ask:
    from tmodbus import create_async_tcp_client

    client = create_async_tcp_client("127.0.0.1", port, unit_id=1)
    await client.connect()

    async def ask() -> tuple[int, ...]:
        return tuple(await client.read_holding_registers(0, 10))

    return ask


ASYNC: dict[str, Callable[[int, int, ExitStack], Awaitable[Ask]]] = {
    "raw protocol": raw_protocol,
    "barewire": barewire_async,
    "pymodbus": pymodbus_async,
    "tmodbus": tmodbus_async,
}


def _in_loop(make: Callable[[int, int, ExitStack], Awaitable[Ask]], flight: int, place: str) -> Factory:
    ours, theirs = CLIENT_PLACES[place]

    def factory(closing: ExitStack) -> Work:
        port = start("raw asyncio", closing, theirs)
        on_core(ours, closing)
        loop = asyncio.new_event_loop()
        closing.callback(loop.close)
        closing.callback(lambda: loop.run_until_complete(asyncio.sleep(0.01)))
        ask = loop.run_until_complete(_made(make(port, flight, closing)))

        async def one_after_the_other(count: int) -> Any:
            for _ in range(count):
                found = await ask()
            return found

        async def side_by_side(count: int) -> Any:
            each = -(-count // flight)
            found = await asyncio.gather(*(one_after_the_other(each) for _ in range(flight)))
            return found[0]

        way = one_after_the_other if flight == 1 else side_by_side
        work = Many(lambda count: loop.run_until_complete(asyncio.wait_for(way(count), 20.0)))
        return _own_work(work) if place == OWN_WORK else work

    return factory


async def _made(coming: Awaitable[Ask]) -> Ask:
    return await coming


def asyncio_client(flight: int, place: str) -> Race:
    # pymodbus has one question under way whatever is asked of it, so it stands in both.
    contestants = {name: _in_loop(make, flight, place) for name, make in ASYNC.items()}
    if flight > 1:
        contestants["barewire, 1 in flight"] = _in_loop(barewire_async, 1, place)
    return _race("TCP client, asyncio", f"10 registers, {flight} in flight", place, contestants, REGISTERS)


# Servers ---------------------------------------------------------------------------------------------------------


def server(flight: int, place: str) -> Race:
    # What comes first is the floor. pyModbusTCP, modbus-tk and uModbus read one request at a time out of a chunk.
    names = [name for name in SERVERS if name != "raw"]
    contestants = {name: _client(partial(raw_socket, flight=flight), name, place) for name in names}
    return _race("TCP server", f"10 registers, {flight} at once", place, contestants, REGISTERS)


def many_sockets(port: int, closing: ExitStack, count: int) -> Work:
    """One question on each of so many connections, then all the answers."""
    connections = [closing.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(count)]
    for connection in connections:
        connection.settimeout(5.0)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    question, unpack = REQUEST.pack(1, 0, 6, 1, 3, 0, 10), struct.Struct(">10H").unpack_from

    def ask() -> tuple[int, ...]:
        for connection in connections:
            connection.sendall(question)
        return [unpack(connection.recv(4096), 9) for connection in connections][-1]

    return ask


def connections(count: int) -> Race:
    place = next(iter(PLACES))
    names = [name for name in SERVERS if name != "raw"]
    contestants = {name: _client(partial(many_sockets, count=count), name, place) for name in names}
    family, what = "TCP server, connections", "10 registers of each at once"
    return Race(family, what, count, contestants, REGISTERS, rounds=ROUNDS, turn=TURN)


assert len(IMAGE) == 20


@pytest.mark.parametrize(("race", "who"), entries(*map(blocking, CLIENT_PLACES)))
def test_blocking_client(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)


@pytest.mark.parametrize(
    ("race", "who"), entries(*(asyncio_client(n, place) for n in (1, 16) for place in CLIENT_PLACES))
)
def test_asyncio_client(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)


@pytest.mark.parametrize(("race", "who"), entries(*(server(n, place) for n in (1, 16) for place in PLACES)))
def test_server(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)


@pytest.mark.parametrize(("race", "who"), entries(*map(connections, (1, 4, 16, 64))))
def test_connections(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)
