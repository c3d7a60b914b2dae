"""Programs of their own in front of the gateway and behind it: `python -m tools.gateway_lab.stand_ins NAME ARGUMENTS`.

unit          a unit behind a TCP connection                 PORT
relay         passes bytes on and understands nothing        PORT PORT_BEHIND
bare          a gateway from TCP to RTU of forty lines       PATH PORT
field         units on a pseudo-terminal, with faults        FAULTS UNITS PACE
adapter       the same, but it is pulled out again and again PATH UNITS SEED
machines      units 1 to 10 on a TCP port
subscriber    counts the values that a broker delivers       PORT SECONDS
clients       read registers, and check what they get        PORT SECONDS COUNT FIRST LAST PIPELINED PAUSE EVERY
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from tools.gateway_lab.programs import BAUDRATE


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


class _Answering(asyncio.Protocol):
    """The unit behind a TCP connection: it answers every read of two registers with their addresses."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.held = b""

    def data_received(self, data: bytes) -> None:
        self.held += data
        replies = []
        while len(self.held) >= 12:
            request, self.held = self.held[:12], self.held[12:]
            address = int.from_bytes(request[8:10], "big")
            values = address.to_bytes(2, "big") + (address + 1 & 0xFFFF).to_bytes(2, "big")
            replies.append(request[:4] + b"\0\x07" + request[6:8] + b"\x04" + values)
        self.transport.write(b"".join(replies))


class _Upstream(asyncio.Protocol):
    def __init__(self, client: _Relay) -> None:
        self.client = client

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport

    def data_received(self, data: bytes) -> None:
        self.client.transport.write(data)


class _Relay(asyncio.Protocol):
    """A relay that understands nothing: each client has a connection of its own behind it."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.waiting: list[bytes] = []
        self.up: _Upstream | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.task = asyncio.ensure_future(self._connect())

    async def _connect(self) -> None:
        loop = asyncio.get_running_loop()
        _, self.up = await loop.create_connection(lambda: _Upstream(self), "127.0.0.1", self.port)
        for data in self.waiting:
            self.up.transport.write(data)

    def data_received(self, data: bytes) -> None:
        if self.up is None:
            self.waiting.append(data)
        else:
            self.up.transport.write(data)


class _BareGateway:
    """A gateway from TCP to RTU of forty lines: one request after the other, a check of the CRC, and nothing else."""

    def __init__(self, path: str) -> None:
        import tty

        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        self.queue: asyncio.Queue[tuple[bytes, Any]] = asyncio.Queue()
        self.received = b""
        self.arrived = asyncio.Event()
        asyncio.get_running_loop().add_reader(self.fd, self._read)

    def _read(self) -> None:
        self.received += os.read(self.fd, 512)
        self.arrived.set()

    async def carry_out(self) -> None:
        from barewire.rtu import crc16

        silence = 0.00175
        while True:
            request, transport = await self.queue.get()
            frame = request[6:]
            self.received = b""
            await asyncio.sleep(silence)
            os.write(self.fd, frame + crc16(frame).to_bytes(2, "little"))
            try:
                async with asyncio.timeout(0.5):
                    while len(self.received) < 5 or len(self.received) < 5 + self.received[2]:
                        self.arrived.clear()
                        await self.arrived.wait()
            except TimeoutError:
                transport.write(request[:4] + b"\0\x03" + request[6:7] + bytes((request[7] | 0x80, 0x0B)))
                continue
            body, check = self.received[:-2], self.received[-2:]
            if crc16(body).to_bytes(2, "little") == check:
                transport.write(request[:4] + len(body).to_bytes(2, "big") + body)


class _BareConnection(asyncio.Protocol):
    def __init__(self, gateway: _BareGateway) -> None:
        self.gateway = gateway

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.held = b""

    def data_received(self, data: bytes) -> None:
        self.held += data
        while len(self.held) >= 12:
            self.gateway.queue.put_nowait((self.held[:12], self.transport))
            self.held = self.held[12:]


async def _serve(make: Callable[[], asyncio.Protocol], port: int) -> None:
    await asyncio.get_running_loop().create_server(make, "127.0.0.1", port)
    _say("ready")
    await asyncio.Event().wait()


async def _serve_bare(path: str, port: int) -> None:
    gateway = _BareGateway(path)
    await asyncio.gather(gateway.carry_out(), _serve(lambda: _BareConnection(gateway), port))


def _field(faults: str, units: str, speed: str) -> None:
    """Units 1 to `units` on a new pseudo-terminal; every register holds its address."""
    from barewire import ModbusServer
    from barewire.modbus import Table

    tables = {unit: Table(holding_registers=list(range(65536))) for unit in range(1, int(units) + 1)}
    options: dict[str, Any] = {"faults": faults, "fault_delay": 0.15} if faults != "-" else {}
    with ModbusServer(f"rtu://pty?baudrate={BAUDRATE}&pace={speed}", tables, fault_seed=1, **options) as server:
        _say(server.url.partition("?")[0].removeprefix("rtu://"))
        signal.sigwait([signal.SIGTERM])


def _adapter(path: str, units: str, seed: str) -> None:
    """Units on a line whose adapter is pulled out for a while again and again. Prints "gone" and "back" with times."""
    from barewire import ModbusServer
    from barewire.modbus import Table

    dice = random.Random(int(seed))
    tables = {unit: Table(holding_registers=list(range(65536))) for unit in range(1, int(units) + 1)}
    _say("ready")
    while True:
        with ModbusServer(f"rtu://{path}?baudrate={BAUDRATE}&pace=0", tables):
            _say(f"back {time.monotonic()}")
            time.sleep(dice.uniform(1.0, 4.0))
        _say(f"gone {time.monotonic()}")
        time.sleep(dice.uniform(0.1, 2.0))


def _machines() -> None:
    """Units 1 to 10 on a TCP port."""
    from barewire import ModbusServer
    from barewire.modbus import Table

    tables = {unit: Table(200) for unit in range(1, 11)}
    with ModbusServer("tcp://127.0.0.1:0", tables) as server:
        _say(server.url)
        signal.sigwait([signal.SIGTERM])


async def _subscribe(port: int, seconds: float) -> None:
    """Count the values that a broker delivers."""
    import aiomqtt

    count = 0
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe("barewire/x/+/+", qos=0)
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                async for _ in client.messages:
                    count += 1
    _say(str(count))


_PATIENCE = 12.0
"""Seconds that a client waits for its last responses: longer than a query may wait in the gateway."""


class Client:
    """A client that reads two registers, which hold their addresses, of one unit after the other."""

    def __init__(self, units: list[int], pipelined: int, pause: float, every: float) -> None:
        self.units = units
        self.pipelined = pipelined
        self.pause = pause
        """Seconds after an exception."""
        self.every = every
        """Seconds after each response."""
        self.right = self.wrong = self.declined = 0
        self.moments: list[float] = []
        """When each right answer came."""
        self.longest = 0.0
        self.asked: dict[int, tuple[int, float]] = {}
        self.number = 0

    async def run(self, port: int, until: float, start: int) -> None:
        """Ask until that time."""
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        self.number = start

        def ask() -> None:
            self.number += 1
            address, unit = self.number * 7 % 65000, self.units[self.number % len(self.units)]
            transaction = self.number & 0xFFFF
            self.asked[transaction] = address, time.monotonic()
            pdu = b"\x03" + address.to_bytes(2, "big") + b"\0\x02"
            writer.write(transaction.to_bytes(2, "big") + b"\0\0\0\x06" + bytes((unit,)) + pdu)

        for _ in range(self.pipelined):
            ask()
        while self.asked:
            try:
                async with asyncio.timeout(max(0.01, until + _PATIENCE - time.monotonic())):
                    head = await reader.readexactly(6)
                    body = await reader.readexactly(int.from_bytes(head[4:6], "big"))
            except (TimeoutError, asyncio.IncompleteReadError):
                break
            address, asked_at = self.asked.pop(int.from_bytes(head[:2], "big"))
            self.longest = max(self.longest, time.monotonic() - asked_at)
            expected = address.to_bytes(2, "big") + (address + 1).to_bytes(2, "big")
            if body[1] & 0x80:
                self.declined += 1
                await asyncio.sleep(self.pause)
            elif body[2:] == b"\x04" + expected:
                self.right += 1
                self.moments.append(time.monotonic())
            else:
                self.wrong += 1
            if self.every:
                await asyncio.sleep(self.every)
            if time.monotonic() < until:
                ask()
        writer.close()


async def _clients(
    port: int, seconds: float, count: int, units: list[int], greedy: int, pause: float, every: float
) -> None:
    """`count` clients, the first of which sends `greedy` requests at once. Prints what each got, and when, as JSON."""
    clients = [Client(units, greedy if place == 0 else 1, pause, every) for place in range(count)]
    until = time.monotonic() + seconds
    await asyncio.gather(*(client.run(port, until, 1000 * place) for place, client in enumerate(clients)))
    rows = [[row.right, row.wrong, row.declined, row.longest, len(row.asked)] for row in clients]
    _say(json.dumps([rows, sorted(round(moment, 3) for row in clients for moment in row.moments)]))


def main(name: str, *arguments: str) -> None:
    """Be one of these programs."""
    if name == "unit":
        asyncio.run(_serve(_Answering, int(arguments[0])))
    elif name == "relay":
        asyncio.run(_serve(lambda: _Relay(int(arguments[1])), int(arguments[0])))
    elif name == "bare":
        asyncio.run(_serve_bare(arguments[0], int(arguments[1])))
    elif name == "field":
        _field(*arguments)
    elif name == "adapter":
        _adapter(*arguments)
    elif name == "machines":
        _machines()
    elif name == "subscriber":
        asyncio.run(_subscribe(int(arguments[0]), float(arguments[1])))
    elif name == "clients":
        port, count, first, last, pipelined = (int(arguments[place]) for place in (0, 2, 3, 4, 5))
        units = list(range(first, last + 1))
        asyncio.run(_clients(port, float(arguments[1]), count, units, pipelined, *map(float, arguments[6:8])))


if __name__ == "__main__":
    main(*sys.argv[1:])
