"""The server on a serial line with RTU frames."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from barewire.io.ports.base import Port
from barewire.modbus.server.server import Server, Unit
from barewire.rtu.frame import Timing, character_bits
from barewire.rtu.line import PATIENCE, RtuLine
from barewire_workbench.live.one_file.serial_port import SerialPort

_POLL_INTERVAL = 0.1
"""Seconds after which `serve` looks whether it is over."""


class ModbusRtuServer:
    """Units on one serial line.

    port        the path of a serial port, such as "/dev/ttyUSB0"; or an object with `send`, `receive` and `close`
    units       by address: a `Table`, or an object of your own, see `Unit`
    patience    the longest pause inside a frame, in seconds; None follows the standard exactly, see `RtuLine`

    `server.statistics` has the numbers of requests, exceptions and noise, and the latest errors in the code of units.
    """

    def __init__(
        self,
        port: str | Port[bytes],
        units: Mapping[int, Unit],
        *,
        baudrate: int = 19200,
        parity: str = "E",
        stopbits: int = 1,
        patience: float | None = PATIENCE,
    ) -> None:
        self._timing = Timing.of(baudrate, character_bits(8, parity, stopbits))
        line = RtuLine(self._timing, role="server", units=units, patience=patience)
        self.server = Server(line, units, serial=True)
        self._port = (
            SerialPort(port, baudrate=baudrate, parity=parity, stopbits=stopbits) if isinstance(port, str) else port
        )

    def serve(self, is_over: Callable[[], bool] = lambda: False) -> None:
        """Serve until `is_over()`; without it, until an exception. Raises PortError if the port fails."""
        clock = time.monotonic
        while not is_over():
            deadline = self.server.deadline
            wait = _POLL_INTERVAL if deadline is None else min(_POLL_INTERVAL, max(0.0, deadline - clock()))
            data = self._port.receive(wait)
            for reply in self.server.feed(data, clock()):
                time.sleep(max(0.0, reply.at - clock()))
                ends = clock() + self._timing.duration(len(reply.data))
                self._port.send(reply.data)
                self.server.sent(min(clock(), ends))  # on a busy machine it returns late

    def close(self) -> None:
        """Close the port."""
        self._port.close()
