"""Servers of the ten registers 0..9, each in its own process: `python -m bench.servers NAME [CORE]` prints its port.

raw             a blocking socket in a thread: every request is answered with prepared bytes and not parsed
raw asyncio     the floor of servers: header and request are unpacked, the registers are a slice of bytes
barewire        `ModbusServer` at tcp://, without asyncio
barewire, asyncio, and the others   the server of each library, started as its documentation shows
"""

from __future__ import annotations

import asyncio
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

REGISTERS = tuple(range(10))
IMAGE = struct.pack(">10H", *REGISTERS)
CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [0]


def start(name: str, closing: ExitStack, core: int | None = None) -> int:
    """Start a server in its own process, on this core; return its port. ImportError if its library is missing."""
    place = [] if core is None else [str(core)]
    command = [sys.executable, "-W", "ignore", "-m", "bench.servers", name, *place]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def stop() -> None:
        process.kill()
        process.communicate()

    closing.callback(stop)
    assert process.stdout is not None
    line = process.stdout.readline().strip()
    if not line.isdecimal():
        process.kill()
        errors = process.communicate()[1].strip().splitlines()
        raise ImportError(errors[-1] if errors else f"the server of {name} did not start")
    return int(line)


def on_core(core: int | None, closing: ExitStack) -> None:
    """Keep this process on one core until the race is over."""
    if core is None or not hasattr(os, "sched_setaffinity"):
        return
    closing.callback(os.sched_setaffinity, 0, os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def raw() -> None:
    listener = socket.create_server(("127.0.0.1", 0), backlog=64)
    print(listener.getsockname()[1], flush=True)
    answer = b"\0\0\0\x17\x01\x03\x14" + IMAGE

    def talk(connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while data := connection.recv(4096):
            # One answer for each received request of twelve bytes.
            connection.sendall(b"".join(data[at : at + 2] + answer for at in range(0, len(data), 12)))

    while True:
        connection, _ = listener.accept()
        threading.Thread(target=talk, args=(connection,), daemon=True).start()


class RawProtocol(asyncio.Protocol):
    """The smallest server that answers: no limits, no exceptions, no time-outs."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def data_received(self, data: bytes) -> None:
        for at in range(0, len(data), 12):
            number, protocol, length, unit, code, address, quantity = struct.unpack_from(">HHHBBHH", data, at)
            if protocol or length != 6 or code != 3:
                raise ValueError
            body = IMAGE[2 * address : 2 * (address + quantity)]
            head = struct.pack(">HHHBBB", number, 0, 3 + len(body), unit, code, len(body))
            self.transport.write(head + body)


async def _forever(server: asyncio.Server) -> None:
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


def raw_asyncio() -> None:
    async def main() -> None:
        await _forever(await asyncio.get_running_loop().create_server(RawProtocol, "127.0.0.1", 0))

    asyncio.run(main())


def _table() -> Any:
    from barewire.modbus import Table

    table = Table(100)
    table.holding_registers[0:10] = type(table.holding_registers)("H", REGISTERS)
    return table


def barewire() -> None:
    from barewire import ModbusServer

    host = ModbusServer("tcp://127.0.0.1:0", units={1: _table()})
    print(host.url.rpartition(":")[2], flush=True)
    host.run(threading.Event())


def barewire_asyncio() -> None:
    from barewire import AsyncModbusServer

    async def main() -> None:
        server = AsyncModbusServer("tcp://127.0.0.1:0", {1: _table()})
        await server.start()
        print(server.port, flush=True)
        await asyncio.Event().wait()

    asyncio.run(main())


def pymodbus() -> None:
    from pymodbus.server import StartAsyncTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    async def main() -> None:
        port = _free_port()
        device = SimDevice(1, [SimData(0, values=[*REGISTERS], datatype=DataType.REGISTERS)])
        task = asyncio.create_task(StartAsyncTcpServer(device, address=("127.0.0.1", port)))
        await asyncio.sleep(0.5)
        print(port, flush=True)
        await task

    asyncio.run(main())


def tmodbus() -> None:
    from tmodbus.pdu import ReadHoldingRegistersPDU
    from tmodbus.server import AsyncTcpServer, ModbusRequestRouter

    router = ModbusRequestRouter()

    @router.register(ReadHoldingRegistersPDU)
    async def read(unit_id: int, request: ReadHoldingRegistersPDU) -> list[int]:
        return list(REGISTERS[request.start_address : request.start_address + request.quantity])

    async def main() -> None:
        port = _free_port()
        await AsyncTcpServer("127.0.0.1", router, port=port).start()
        print(port, flush=True)
        await asyncio.Event().wait()

    asyncio.run(main())


def py_modbus_tcp() -> None:
    from pyModbusTCP.server import ModbusServer

    port = _free_port()
    server = ModbusServer("127.0.0.1", port, no_block=True)
    server.start()
    server.data_bank.set_holding_registers(0, list(REGISTERS))
    print(port, flush=True)
    threading.Event().wait()


def modbus_tk() -> None:
    from modbus_tk import modbus_tcp

    port = _free_port()
    server = modbus_tcp.TcpServer(port=port, address="127.0.0.1")
    server.start()
    unit = server.add_slave(1)
    unit.add_block("block", 3, 0, 10)
    unit.set_values("block", 0, REGISTERS)
    for _ in range(100):  # it listens some time after `start`, in its thread
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            break
        except ConnectionRefusedError:
            time.sleep(0.05)
    print(port, flush=True)
    threading.Event().wait()


def umodbus() -> None:
    from socketserver import ThreadingTCPServer

    from umodbus.server.tcp import RequestHandler, get_server

    server = get_server(ThreadingTCPServer, ("127.0.0.1", 0), RequestHandler)

    @server.route(slave_ids=[1], function_codes=[3], addresses=list(range(10)))
    def read(slave_id: int, function_code: int, address: int) -> int:
        return REGISTERS[address]

    print(server.server_address[1], flush=True)
    server.serve_forever()


SERVERS: dict[str, Callable[[], None]] = {
    "raw": raw,
    "raw asyncio": raw_asyncio,
    "barewire": barewire,
    "barewire, asyncio": barewire_asyncio,
    "pymodbus": pymodbus,
    "tmodbus": tmodbus,
    "pyModbusTCP": py_modbus_tcp,
    "modbus-tk": modbus_tk,
    "uModbus": umodbus,
}

if __name__ == "__main__":
    if len(sys.argv) > 2 and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(sys.argv[2])})
    SERVERS[sys.argv[1]]()
