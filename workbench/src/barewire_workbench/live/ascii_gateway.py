"""The ASCII gateway of CiA 309-3 on a TCP port: many connections, one bus.

        netcat ----+                         +--- transfers with different nodes at the same time
        a script --+-- one session each -----+--- one transfer at a time on each SDO channel
        telnet ----+                         +--- boot-ups, emergencies, PDOs to those that asked for them
                                             +--- a node of the gateway itself, if it has one

The commands of a connection are carried out one after the other; further ones wait in the socket. A response ends with
CR LF, and its lines, if there are several, with LF, so a client can read up to CR LF. If a client does not read, its
notices are dropped, and their number is reported later; responses are never dropped.
"""

from __future__ import annotations

import asyncio
import re
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

from barewire.canopen.frame import CanFrame, ErrorFrame
from barewire.conversation import Conversation
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.bus.async_bus import AsyncRunning, AsyncSubscriber
from barewire.io.canopen.bus.node_runner import Action
from barewire.io.canopen.bus.subscriber import LONGEST_PULL, FramesLost
from barewire.io.canopen.bus_methods import LSS_LOCK, LSS_RECEIVES
from barewire.io.canopen.operations import NO_FRAMES, NO_LOCKS, BusOperation, sdo_transfer
from barewire.io.log import PortLog
from barewire.io.ports.network import place_of, reason
from barewire_workbench.ascii_gateway.lines import GatewayCode, error_line
from barewire_workbench.ascii_gateway.own_node import GatewayNode
from barewire_workbench.ascii_gateway.session import MAX_LINE, GatewaySession

GATEWAY_CONNECTIONS = 64
UNREAD_LIMIT = 0x10000
"""Bytes that may wait for a client that does not read; further notices are dropped."""
_CHUNK = 4096
_LINE_END = re.compile(rb"\r\n?|\n")

_CONTROLLER, _BUS_OFF = 0x04, 0x40
_PASSIVE = 0x30
"""Bits of the second byte of a controller's report: error passive, while receiving or sending."""


@dataclass
class GatewayStatistics:
    """Counters of a gateway. `opened` is the sum of the open connections, `left`, `refused` and `stopped`."""

    opened: int = 0
    """Connections of clients."""
    left: int = 0
    """Connections that the client or the network ended, or that ended with the bus."""
    refused: int = 0
    """Connections closed because there were too many."""
    stopped: int = 0
    """Connections closed with the gateway."""
    commands: int = 0
    """Lines carried out."""
    lost: int = 0
    """Notices that were dropped because the client did not read."""


class CanopenGateway:
    """A gateway on a TCP port. The end of its `async with` closes every connection, but not `client`."""

    def __init__(
        self,
        client: AsyncCanopenClient,
        *,
        net: int = 1,
        version: str = "",
        own: GatewayNode | None = None,
        indications: bool = False,
    ) -> None:
        self.client = client
        self.net = net
        self.version = version
        self.own = own
        """The gateway's own node, if it is one."""
        self.indications = indications
        """Whether each connection gets boot-ups, emergencies and bus errors from the start."""
        self.ended = asyncio.Event()
        """Set when the bus was closed."""
        self.failure: PortError | None = None
        self.statistics = GatewayStatistics()
        self.log = PortLog("barewire.canopen.gateway", "gateway")
        self._connections: set[_Connection] = set()
        self._is_closing = False
        self._server: asyncio.Server | None = None
        self._running: _OwnNode | None = None

    async def listen(self, host: str, port: int) -> Self:
        """Start to listen. Raises PortError."""
        try:
            # In two steps: if the task is cancelled in the second, there is a server to close.
            self._server = await asyncio.start_server(self._accept, host, port, start_serving=False)
            await self._server.start_serving()
        except BaseException as error:
            await self.close()
            if not isinstance(error, OSError):
                raise
            raise PortError(f"{place_of(host, port)}: {reason(error)}") from None
        if self.own is not None:
            self._running = _OwnNode(self.client.bus, self.own.device, None)
        self.log.place = place_of(host, self.port)
        self.log.info("serving", f"serving net {self.net}")
        return self

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def port(self) -> int:
        """The number of the TCP port on which it listens; the system chooses it if port 0 was requested."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Stop listening and close all connections."""
        self._is_closing = True
        if self._server is not None:
            self._server.close()
        if self._running is not None:
            self._running.stop()
        for connection in list(self._connections):
            connection.end()
        while self._connections:
            await asyncio.gather(*(connection.ended.wait() for connection in self._connections))
        if self._server is not None:
            self.log.info("closed", "closed")
            self.log.flush()

    async def answer_own(self, answer: Conversation[CanFrame, list[str]]) -> list[str]:
        """Carry out a line about the gateway's own node; the frames that the node sends meanwhile go to the bus."""
        assert self.own is not None
        assert self._running is not None
        own, lines = self.own, list[str]()

        def act(now: float) -> list[CanFrame]:
            answer_lines, frames = own.carry_out(answer, now)
            lines.extend(answer_lines)
            return frames

        await self._running.do(act)
        return lines

    def fail(self, why: PortError) -> None:
        """Record that the bus was closed, for this reason, and set `ended`."""
        self.failure = self.failure or why
        self.ended.set()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        counted, peer = self.statistics, "{}:{}".format(*writer.get_extra_info("peername", ("?", 0))[:2])
        counted.opened += 1
        connection = _Connection(self, reader, writer)
        if len(self._connections) >= GATEWAY_CONNECTIONS:
            text = f"at most {GATEWAY_CONNECTIONS} connections"
            connection.write([error_line(0, GatewayCode.OUT_OF_MEMORY, text)])
            writer.close()
            counted.refused += 1
            self.log.warning("refused", f"{peer}: {text}: closed")
            return
        self._connections.add(connection)
        self.log.info("connected", f"{peer} connected, {len(self._connections)} in all")
        try:
            await connection.serve()
        finally:
            self._connections.discard(connection)
            if self._is_closing:
                counted.stopped += 1
            else:
                counted.left += 1
                self.log.info("left", f"{peer} left, {len(self._connections)} in all")
            connection.ended.set()


class _OwnNode(AsyncRunning):
    """The gateway's own node on the bus. A line about it is carried out after the frames of the lines before."""

    async def do(self, action: Action) -> None:
        """Feed the node the frames that wait, such as an NMT command of the gateway, then call `action(now)`."""
        while (arrived := self._subscriber.take()) is not None:
            self.statistics.count(arrived.item)
            for frame in self._driver.feed(arrived.item, time.monotonic()):
                await self._send(frame)
        self._subscriber.wake()  # the task of the node waits again
        await super().do(action)


class _Connection:
    """One connection, in three tasks: carry out its lines, send its notices, wait until it is closed."""

    def __init__(self, gateway: CanopenGateway, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = gateway.client
        self.ended = asyncio.Event()
        self._gateway = gateway
        self._client = client
        self._reader = reader
        self._writer = writer
        remote = not client.bus.name.startswith("socketcand/")  # a socketcand bus carries no remote frames
        self._session = GatewaySession(
            gateway.net,
            version=gateway.version,
            channel=client.channel,
            remote=remote,
            indications=gateway.indications,
            own=gateway.own,
        )
        self._subscriber = AsyncSubscriber(client.bus, None, reports=True)
        self._lost = 0
        self._tasks: tuple[asyncio.Task[None], ...] = ()

    def end(self) -> None:
        """Cancel the tasks of the connection."""
        for task in self._tasks:
            task.cancel()

    async def serve(self) -> None:
        """Serve until the client closes the connection, or the bus is closed."""
        coroutines = self._carry_out_lines(), self._send_notices(), self._wait_closed()
        self._tasks = tuple(asyncio.create_task(coroutine) for coroutine in coroutines)
        try:
            await asyncio.wait(self._tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self.end()
            results = await asyncio.gather(*self._tasks, return_exceptions=True)
            self._subscriber.close()
            self._writer.close()
            for error in results:
                if isinstance(error, PortError):
                    self._gateway.fail(error)
                elif isinstance(error, Exception) and not isinstance(error, OSError):
                    raise error

    async def _wait_closed(self) -> None:
        """Wait until the connection is closed. A client that closed only its sending half (`nc -N`) still receives."""
        with suppress(OSError):
            await asyncio.shield(self._writer.wait_closed())

    # Lines

    async def _carry_out_lines(self) -> None:
        partial, skipping, after_cr = b"", False, False
        while True:
            try:
                chunk = await self._reader.read(_CHUNK)
            except OSError:
                return
            received = chunk.removeprefix(b"\n") if after_cr else chunk  # CR LF may arrive in two parts
            after_cr = chunk.endswith(b"\r")
            *lines, partial = _LINE_END.split(partial + received)
            for line in lines:
                if skipping:
                    skipping = False
                else:
                    await self._answer(line)
            if len(partial) > MAX_LINE:
                partial = b""
                if not skipping:
                    skipping = True  # until the end of this line comes
                    self.write([error_line(0, GatewayCode.OUT_OF_MEMORY, f"a line of more than {MAX_LINE} bytes")])
                    await self._writer.drain()
            if not chunk:
                if partial and not skipping:
                    await self._answer(partial)
                return

    async def _answer(self, line: bytes) -> None:
        self._gateway.statistics.commands += bool(line.strip())
        text = line.decode("utf-8", "replace")
        conversation, target, client = self._session.answer(text), self._session.target(text), self._client
        if target == "own":
            answer = await self._gateway.answer_own(conversation)
        elif target == "LSS":
            answer = await client.carry_out(BusOperation(conversation, LSS_LOCK, LSS_RECEIVES))
        elif target is None:
            answer = await client.carry_out(BusOperation(conversation, NO_LOCKS, NO_FRAMES))
        else:
            answer = await client.carry_out(sdo_transfer(target, conversation, client.timeout))
        self.write(["\n".join(answer)])  # an empty line or a comment gets an empty line
        self._feed_notices(None, time.monotonic())
        self._subscriber.wake()  # the deadline of the other task may have changed
        await self._writer.drain()

    # Notices

    async def _send_notices(self) -> None:
        clock = time.monotonic
        while True:
            deadline = self._session.notices.deadline
            arrived = await self._subscriber.pull_async(
                LONGEST_PULL if deadline is None else max(0.001, deadline - clock())
            )
            if arrived is None:
                self._feed_notices(None, clock())
            elif isinstance(arrived.item, CanFrame):
                self._feed_notices(arrived.item, arrived.at)
            elif isinstance(arrived.item, FramesLost):
                text = f"{arrived.item.frames} frames were lost"
                self._notice(self._session.notices.bus_error(GatewayCode.CAN_OVERFLOW, text))
            elif isinstance(arrived.item, ErrorFrame) and (code := _code_of(arrived.item)):
                self._notice(self._session.notices.bus_error(code, arrived.item.text))

    def _feed_notices(self, frame: CanFrame | None, now: float) -> None:
        frames, lines = self._session.notices.feed(frame, now)
        for outgoing in frames:
            self._subscriber.write(outgoing)
        self._notice(lines)

    def _notice(self, lines: list[str]) -> None:
        """Send notices, or count them as lost while the client does not read."""
        if self._writer.transport.get_write_buffer_size() > UNREAD_LIMIT:
            self._lost += len(lines)
            self._gateway.statistics.lost += len(lines)
            return
        if self._lost and lines:
            lines = [f"#{self._lost} notices were lost: they were not read", *lines]
            self._lost = 0
        self.write(lines)

    def write(self, lines: list[str]) -> None:
        """Write lines to the connection, unless it is closing."""
        if lines and not self._writer.is_closing():
            self._writer.write("".join(f"{line}\r\n" for line in lines).encode("utf-8", "replace"))


def _code_of(report: ErrorFrame) -> GatewayCode | None:
    """Return the code for a report of the controller; None if it is neither bus-off nor error passive."""
    if report.classes & _BUS_OFF:
        return GatewayCode.BUS_OFF
    passive = report.classes & _CONTROLLER and report.data[1:2] and report.data[1] & _PASSIVE
    return GatewayCode.ERROR_PASSIVE if passive else None


async def serve_gateway(
    client: AsyncCanopenClient,
    host: str = "127.0.0.1",
    port: int = 0,
    *,
    net: int = 1,
    version: str = "",
    own: GatewayNode | None = None,
    indications: bool = False,
) -> CanopenGateway:
    """Start a gateway to the bus of `client` on the TCP port `host`:`port`.

        net            its net number, 1 to 127
        version        the answer to `info version`
        own            the gateway's own node, which runs on the bus as long as the gateway; by default it has none
        indications    report boot-ups, emergencies and bus errors to each connection, without a command for it

    Raises PortError if the port cannot be opened, EncodeError for a wrong net and for any other client.
    """
    if not isinstance(client, AsyncCanopenClient):
        raise EncodeError(f"client {shown(client)}: expected an AsyncCanopenClient", "client")
    if not 1 <= net <= 127:
        raise EncodeError(f"net {net}: expected 1..127")
    return await CanopenGateway(client, net=net, version=version, own=own, indications=indications).listen(host, port)
