"""A Modbus server on a serial line, or on a pseudo-terminal that it makes."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping

from barewire.errors import EncodeError
from barewire.io.endpoint import PSEUDO_TERMINAL, Endpoint
from barewire.io.engine.blocking import Port
from barewire.io.modbus.carriers import modbus_line, open_serial
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.server.open import LOOK, Host
from barewire.modbus import Server, Unit


class SerialHost(Host):
    """A Modbus server on a serial line; on a new pseudo-terminal if the URL says `pty` or a path that is not there."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        super().__init__()
        self._line = modbus_line(endpoint, "server", units)
        self._server = Server(self._line, units, serial=True)
        self.port: Port[bytes]
        if endpoint.place == PSEUDO_TERMINAL or not os.path.exists(endpoint.place):
            from barewire.io.ports.serial import SerialSettings

            if endpoint.turn is not None:
                raise EncodeError(f"endpoint {str(endpoint)!r}: a new pseudo-terminal has no direction to turn", "turn")
            link = None if endpoint.place == PSEUDO_TERMINAL else endpoint.place
            pace = SerialSettings.of(endpoint).timing if endpoint.integer("pace", 1) else None
            terminal = PseudoTerminal(link, pace)
            self.port = terminal
            self.url = str(endpoint._replace(place=terminal.name))
        else:
            self.port = open_serial(endpoint)
            self.url = str(endpoint)

    def _serve(self, stop: threading.Event) -> None:
        clock = time.monotonic
        while not self.is_over(stop):
            deadline = self._server.deadline
            wait = LOOK if deadline is None else min(LOOK, max(0.0, deadline - clock()))
            data = self.port.receive(wait)
            for reply in self._server.feed(data, clock()):
                time.sleep(max(0.0, reply.at - clock()))
                self.port.send(reply.data)
                # Who hears us at once may speak a silence later: that must not be too early for us.
                self._line.sent(self.port.sent_at if isinstance(self.port, PseudoTerminal) else clock())

    def _give_back(self) -> None:
        self.port.close()
