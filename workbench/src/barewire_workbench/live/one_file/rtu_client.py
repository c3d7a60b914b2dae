"""The client on a serial line with RTU frames."""

from __future__ import annotations

from typing import Any

from barewire.io.ports.base import Port
from barewire.rtu.frame import Timing, character_bits
from barewire.rtu.line import PATIENCE, RtuLine
from barewire_workbench.live.one_file.modbus_client import ModbusClient
from barewire_workbench.live.one_file.serial_port import SerialPort


class ModbusRtuClient(ModbusClient):
    """A client of the units on one serial line.

    port        the path of a serial port, such as "/dev/ttyUSB0"; or an object with `send`, `receive` and `close`
    patience    the longest pause inside a frame, in seconds; None follows the standard exactly, see `RtuLine`
    options     `unit`, `timeout`, `retries`, `gap`, `recovery`, `late_window`: see `ModbusClient`
    """

    def __init__(
        self,
        port: str | Port[bytes],
        *,
        baudrate: int = 19200,
        parity: str = "E",
        stopbits: int = 1,
        patience: float | None = PATIENCE,
        **options: Any,
    ) -> None:
        def open_port() -> Port[bytes]:
            return (
                SerialPort(port, baudrate=baudrate, parity=parity, stopbits=stopbits) if isinstance(port, str) else port
            )

        timing = Timing.of(baudrate, character_bits(8, parity, stopbits))
        super().__init__(open_port, lambda: RtuLine(timing, patience=patience), **options)
