"""The server of a serial line, in a thread; it may make a pseudo-terminal as its line."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from barewire.errors import EncodeError
from barewire.io.endpoint import PSEUDO_TERMINAL, Endpoint
from barewire.io.modbus.carriers import modbus_line
from barewire.io.ports.base import Port
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.server.base import POLL_INTERVAL
from barewire.io.server.connection_limits import ConnectionTable
from barewire.io.server.server_log import server_log
from barewire.modbus import Server, Unit

if TYPE_CHECKING:
    from barewire.io.fault_injection.faults import Faults


class SerialService:
    """A server of units on a serial line, with `faults` in its answers.

    If the URL names `pty`, or a path that does not exist, the line is a new pseudo-terminal.
    """

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit], faults: Faults[bytes] | None = None) -> None:
        self.connections: ConnectionTable[Any] = ConnectionTable(endpoint)  # a line has none
        self._line = modbus_line(endpoint, "server", units)
        self._log = server_log(endpoint)
        self._server = Server(self._line, units, serial=True, on_failure=self._log.failed)
        self.statistics = self._server.statistics
        self.port: Port[bytes]
        if endpoint.place == PSEUDO_TERMINAL or not os.path.exists(endpoint.place):
            from barewire.io.ports.serial import SerialSettings

            if endpoint.set_direction is not None:
                text = "a new pseudo-terminal has no direction to set"
                raise EncodeError(f"endpoint {str(endpoint)!r}: {text}", "set_direction")
            link = None if endpoint.place == PSEUDO_TERMINAL else endpoint.place
            pace = SerialSettings.of(endpoint).timing if endpoint.integer("pace", 1) else None
            terminal = PseudoTerminal(link, pace)
            terminal.mark_as_served()
            self.port = terminal
            self.url = str(endpoint._replace(place=terminal.name))
        else:
            from barewire.io.ports.serial import SerialPort

            self.port = SerialPort.of_server(endpoint)
            self.url = str(endpoint)
        self._answer: Callable[[bytes, bytes], None] = lambda data, request: self.port.send(data)
        if faults is not None:
            from barewire.io.fault_injection.ports import FaultyPort

            faulty = FaultyPort(self.port, faults)
            self.port, self._answer = faulty, faulty.answer

    def serve(self, is_over: Callable[[], bool]) -> None:
        """Serve until `is_over()`."""
        clock = time.monotonic
        self._log.serving(self.url, self._server.units)
        watch = self._log.watch()
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
                self._answer(reply.data, reply.request)
                # A client that receives the answer at once may send after one silence; the line must accept that.
                self._line.sent(self.port.sent_at if isinstance(self.port, PseudoTerminal) else clock())

    def close(self) -> None:
        """Release the port."""
        self.port.close()
        self._log.stopped()
