"""The servers of a serial line: `SerialService` in a thread, `SerialServer` in an event loop.

A unit answers one request after the other: while a reply is sent, or a `Delayed` one is not due yet, nothing is read,
and requests wait in the port.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import PSEUDO_TERMINAL, Endpoint
from barewire.io.ports.base import Port
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.ports.serial import SerialPort, SerialSettings
from barewire.io.server.base import POLL_INTERVAL
from barewire.io.server.units import Inject, UnitsServer, later_response
from barewire.modbus import AnyUnit, Server

if TYPE_CHECKING:
    import asyncio
    import socket

    from barewire.io.fault_injection.faults import Faults
    from barewire.io.ports.async_links import SerialLink
    from barewire.io.ports.base import Watch
    from barewire.modbus.server.server import Reply


class SerialService(UnitsServer):
    """A server of units on a serial line, with `faults` in its answers.

    If the URL names `pty`, or a path that does not exist and is not below /dev, the line is a new pseudo-terminal.
    """

    def __init__(self, endpoint: Endpoint, units: Mapping[int, AnyUnit], faults: Faults[bytes] | None = None) -> None:
        super().__init__(endpoint, units)
        self._server = _server_of(self)
        self._character = 0.0  # seconds that a byte takes to other stations: a pseudo-terminal has no speed
        self.port: Port[bytes]
        is_new = sys.platform != "win32" and not os.path.exists(endpoint.place)  # there a port is no file
        if endpoint.place == PSEUDO_TERMINAL or is_new:
            self.port = terminal = _new_terminal(endpoint)
            self.url = str(endpoint._replace(place=terminal.name))
        else:
            self.port = port = SerialPort.of_server(endpoint)
            self._character = port.character
            self.url = str(endpoint)
        self._answer: Callable[[bytes, bytes], None] = lambda data, request: self.port.send(data)
        if faults is not None:
            from barewire.io.fault_injection.ports import FaultyPort

            faulty = FaultyPort(self.port, faults)
            self.port, self._answer = faulty, faulty.answer

    def serve(self, is_over: Callable[[], bool]) -> None:
        """Serve until `is_over()`."""
        clock = time.monotonic
        self.log.serving(self.url, self.units)
        watch = self.log.watch()
        while not is_over():
            deadline = self._server.deadline
            wait = POLL_INTERVAL if deadline is None else min(POLL_INTERVAL, max(0.0, deadline - clock()))
            data = self.port.receive(wait)
            if watch is not None and data is not None:
                watch("received", data)
            for reply in self._server.feed(data, clock()):
                time.sleep(max(0.0, reply.at - clock()))
                if watch is not None:
                    watch("sent", reply.data)
                began, takes = clock(), self._character * len(reply.data)
                self._answer(reply.data, reply.request)
                # On a busy machine it returns late, when the next request may have been received already.
                self._server.sent(min(clock(), began + takes), takes)

    def close(self) -> None:
        """Release the port."""
        self.port.close()
        self.log.stopped()


class SerialServer(UnitsServer):
    """A server on a serial port, read and written by the running event loop."""

    _loop: asyncio.AbstractEventLoop
    _link: SerialLink
    _watch: Watch | None
    _character: float

    def __init__(self, endpoint: Endpoint, units: Mapping[int, AnyUnit], inject: Inject | None = None) -> None:
        super().__init__(endpoint, units, inject)
        self._server = _server_of(
            self, send_later=lambda reply, caller: self._begin_to_send([reply]), wait_for=later_response
        )
        self._is_open = False
        self._timer: asyncio.TimerHandle | None = None
        self._sending: asyncio.Task[None] | None = None

    async def listen(self, listener: socket.socket | None = None) -> None:
        """Open the port, and serve. Raises PortError."""
        from asyncio import get_running_loop

        from barewire.io.ports.async_links import SerialLink

        self._loop = get_running_loop()
        port = SerialPort.of_server(self.endpoint)
        self._character = port.character
        self._link = SerialLink(port, self._feed, self._fail)
        self.log.serving(str(self.endpoint), self.units)
        self._watch = self.log.watch()
        self._is_open = True

    def _feed(self, data: bytes | None) -> None:
        if self._watch is not None and data is not None:
            self._watch("received", data)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        replies = self._server.feed(data, self._loop.time())
        if replies:
            self._begin_to_send(replies)
        else:
            self._set_timer()

    def _begin_to_send(self, replies: list[Reply]) -> None:
        self._link.pause_reading()
        self._sending = self._loop.create_task(self._send(replies))

    def _set_timer(self) -> None:
        deadline = self._server.deadline
        self._timer = None if deadline is None else self._loop.call_at(deadline, self._feed, None)

    async def _send(self, replies: list[Reply]) -> None:
        from asyncio import sleep

        try:
            for reply in replies:
                await sleep(reply.at - self._loop.time())
                if self.inject is None:
                    self._write(reply.data)
                else:
                    self.inject(reply, self._write)
            await self._link.sent()
        finally:
            self._link.resume_reading()
            self._set_timer()

    def _write(self, frame: bytes) -> None:
        if self._watch is not None:
            self._watch("sent", frame)
        takes = self._character * len(frame)
        self._server.sent(self._loop.time() + takes, takes)
        with suppress(PortError):
            self._link.write(frame)

    def _fail(self, why: str) -> None:
        self.failure = PortError(f"{self._link.name}: {why}")
        self.log.error("ended", f"ended: {why}")

    async def close(self) -> None:
        """Release the port."""
        from asyncio import wait

        if not self._is_open:
            return
        self._link.close()
        if self._sending is not None:
            self._sending.cancel()
            await wait([self._sending])
        if self._timer is not None:
            self._timer.cancel()
        self.log.stopped()


def _server_of(shared: UnitsServer, **options: Any) -> Server:
    """Return the server of a line, whose only framing state is that of `shared`."""
    return Server(
        shared.line,
        shared.units,
        serial=True,
        statistics=shared.statistics,
        on_failure=shared.log.failed,
        echoes=shared.echoes,
        **options,
    )


def _new_terminal(endpoint: Endpoint) -> PseudoTerminal:
    if endpoint.set_direction is not None:
        text = "a new pseudo-terminal has no direction to set"
        raise EncodeError(f"endpoint {str(endpoint)!r}: {text}", "set_direction")
    link = None if endpoint.place == PSEUDO_TERMINAL else endpoint.place
    if link is not None and os.path.abspath(link).startswith("/dev/"):
        # A service that starts before its adapter is found must not serve nobody.
        where = "for a new pseudo-terminal give a path outside /dev, or rtu://pty"
        raise PortError(f"{link}: there is no such port; plug in the adapter, or {where}")
    pace = SerialSettings.of(endpoint).timing if endpoint.choice("pace", "1") == "1" else None
    terminal = PseudoTerminal(link, pace)
    terminal.mark_as_served()
    return terminal
