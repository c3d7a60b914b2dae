"""The text gateway on a TCP port: many connections, one bus.   [CiA 309-3]

        netcat ----+                         +--- transfers to different nodes at the same time
        a script --+-- one session each -----+--- one at a time on each SDO channel
        telnet ----+                         +--- boot-ups, emergencies, PDOs told to everybody

A connection's lines are carried out in their order. Who sends lines faster than the bus carries them out waits in its
own socket; who does not read what is told loses notices, and is told how many; answers are never lost.

I know: sockets, one client of a bus, sessions.  I never know: what a line means.
"""

from __future__ import annotations

import asyncio
import re
import time
from contextlib import suppress
from typing import Self

from barewire.canopen.frame import CanFrame, ErrorFrame
from barewire.canopen.gateway.codes import GatewayCode, error_line
from barewire.canopen.gateway.session import MAX_LINE, GatewaySession
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.async_bus import AsyncSubscriber
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.methods.lss import LSS_LOCK, LSS_RECEIVES
from barewire.io.canopen.methods.operations import NO_FRAMES, NO_LOCKS, BusOperation, sdo_transfer
from barewire.io.canopen.subscriber import LONGEST_PULL, FramesLost
from barewire.io.ports.tcp import reason

CONNECTIONS = 64
UNREAD = 0x10000
"""Bytes that may wait for somebody who does not read; more is lost."""
CHUNK = 4096
_LINE_END = re.compile(rb"[\r\n]")

_CONTROLLER, _BUS_OFF = 0x04, 0x40
_PASSIVE = 0x30
"""Bits of the second byte of a controller's report: error passive, receiving or sending."""


class CanopenGateway:
    """A listening gateway. `port` is the TCP port; leaving its `async with` ends every connection, not the client."""

    def __init__(self, client: AsyncCanopenClient, *, net: int = 1, version: str = "") -> None:
        self.client = client
        self.net = net
        self.version = version
        self.ended = asyncio.Event()
        """Set when the bus is gone."""
        self.failure: PortError | None = None
        self._connections: set[_Connection] = set()
        self._server: asyncio.Server | None = None

    async def listen(self, host: str, port: int) -> Self:
        """Begin to listen. Raises PortError."""
        try:
            self._server = await asyncio.start_server(self._attend, host, port)
        except OSError as error:
            raise PortError(f"{host}:{port}: {reason(error)}") from None
        return self

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def port(self) -> int:
        """The port it listens on: of interest when it was asked for port 0."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """End the connections and listen no more."""
        if self._server is not None:
            self._server.close()
        for connection in list(self._connections):
            connection.end()
        while self._connections:
            await asyncio.gather(*(one.ended.wait() for one in self._connections))

    def fail(self, why: PortError) -> None:
        """The bus is gone: nothing is left to do."""
        self.failure = self.failure or why
        self.ended.set()

    async def _attend(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = _Connection(self, reader, writer)
        if len(self._connections) >= CONNECTIONS:
            connection.write([error_line(0, GatewayCode.OUT_OF_MEMORY, f"{CONNECTIONS} connections are all there are")])
            writer.close()
            return
        self._connections.add(connection)
        try:
            await connection.serve()
        finally:
            self._connections.discard(connection)
            connection.ended.set()


class _Connection:
    """One connection: a task that carries out its lines, one that tells it what happens."""

    def __init__(self, gateway: CanopenGateway, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = gateway.client
        self.ended = asyncio.Event()
        self._gateway = gateway
        self._client = client
        self._reader = reader
        self._writer = writer
        remote = not client.bus.name.startswith("socketcand/")  # which has no word for remote frames
        self._session = GatewaySession(gateway.net, version=gateway.version, channel=client.channel, remote=remote)
        self._tap = AsyncSubscriber(client.bus, None, reports=True)
        self._lost = 0
        self._tasks: tuple[asyncio.Task[None], ...] = ()

    def end(self) -> None:
        """End it from outside."""
        for task in self._tasks:
            task.cancel()

    async def serve(self) -> None:
        """Until the other side leaves, or the bus does."""
        work = self._obey(), self._tell(), self._gone()
        self._tasks = tuple(asyncio.create_task(one) for one in work)
        try:
            await asyncio.wait(self._tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self.end()
            said = await asyncio.gather(*self._tasks, return_exceptions=True)
            self._tap.close()
            self._writer.close()
            for error in said:
                if isinstance(error, PortError):
                    self._gateway.fail(error)
                elif isinstance(error, Exception) and not isinstance(error, OSError):
                    raise error

    async def _gone(self) -> None:
        """Until the connection is no more. One that says no more may still listen, as `nc -N` does: that is none."""
        with suppress(OSError):
            await asyncio.shield(self._writer.wait_closed())

    # Lines

    async def _obey(self) -> None:
        held, skipping = b"", False
        while True:
            try:
                chunk = await self._reader.read(CHUNK)
            except OSError:
                return
            *lines, held = _LINE_END.split(held + chunk)  # CR LF is two; an empty line is nothing
            for line in lines:
                if skipping:
                    skipping = False
                else:
                    await self._answer(line)
            if len(held) > MAX_LINE:
                held = b""
                if not skipping:
                    skipping = True
                    await self._answer(b"#", too_long=True)
            if not chunk:
                if held and not skipping:
                    await self._answer(held)
                return

    async def _answer(self, line: bytes, *, too_long: bool = False) -> None:
        if too_long:
            self.write([error_line(0, GatewayCode.OUT_OF_MEMORY, f"a line of more than {MAX_LINE} bytes")])
        else:
            text = line.decode("utf-8", "replace")
            self.write(await self._client.carry_out(self._operation(text)))
            self._tell_now(None, time.monotonic())
            self._tap.wake()  # the line may have changed how long the other task has to wait
        await self._writer.drain()

    def _operation(self, text: str) -> BusOperation[list[str]]:
        conversation, whom = self._session.answer(text), self._session.target(text)
        if whom is None:
            return BusOperation(conversation, NO_LOCKS, NO_FRAMES)
        return (
            BusOperation(conversation, LSS_LOCK, LSS_RECEIVES)
            if whom == "LSS"
            else sdo_transfer(whom, conversation, self._client.timeout)
        )

    # Notices

    async def _tell(self) -> None:
        clock = time.monotonic
        while True:
            deadline = self._session.notices.deadline
            arrived = await self._tap.pull_async(LONGEST_PULL if deadline is None else max(0.001, deadline - clock()))
            if arrived is None:
                self._tell_now(None, clock())
            elif isinstance(arrived.item, CanFrame):
                self._tell_now(arrived.item, arrived.at)
            elif isinstance(arrived.item, FramesLost):
                text = f"{arrived.item.frames} frames were not looked at"
                self._notice([self._session.notices.bus_error(GatewayCode.CAN_OVERFLOW, text)])
            elif isinstance(arrived.item, ErrorFrame) and (code := _code_of(arrived.item)):
                self._notice([self._session.notices.bus_error(code, arrived.item.text)])

    def _tell_now(self, frame: CanFrame | None, now: float) -> None:
        frames, lines = self._session.notices.feed(frame, now)
        for one in frames:
            self._tap.write(one)
        self._notice(lines)

    def _notice(self, lines: list[str]) -> None:
        """Lines that nobody asked for: lost where nobody reads."""
        if self._writer.transport.get_write_buffer_size() > UNREAD:
            self._lost += len(lines)
            return
        if self._lost and lines:
            lines = [f"#{self._lost} notices were lost: nobody read them", *lines]
            self._lost = 0
        self.write(lines)

    def write(self, lines: list[str]) -> None:
        """Lines to the other side."""
        if lines and not self._writer.is_closing():
            self._writer.write("".join(f"{line}\r\n" for line in lines).encode("utf-8", "replace"))


def _code_of(report: ErrorFrame) -> GatewayCode | None:
    if report.classes & _BUS_OFF:
        return GatewayCode.BUS_OFF
    passive = report.classes & _CONTROLLER and report.data[1:2] and report.data[1] & _PASSIVE
    return GatewayCode.ERROR_PASSIVE if passive else None


async def serve_gateway(
    client: AsyncCanopenClient, host: str = "127.0.0.1", port: int = 0, *, net: int = 1, version: str = ""
) -> CanopenGateway:
    """A gateway to the bus of `client` that listens at `host`:`port`. Raises PortError."""
    if not 1 <= net <= 127:
        raise EncodeError(f"net {net}: expected 1..127")
    return await CanopenGateway(client, net=net, version=version).listen(host, port)
