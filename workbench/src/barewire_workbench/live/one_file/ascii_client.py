"""The client on a serial line with ASCII frames."""

from __future__ import annotations

from typing import Any

from barewire.ascii.line import AsciiLine
from barewire.io.ports.base import Port
from barewire_workbench.live.one_file.modbus_client import ModbusClient
from barewire_workbench.live.one_file.serial_port import SerialPort


class ModbusAsciiClient(ModbusClient):
    """A client of the units on one serial line.

    port                 the path of a serial port, such as "/dev/ttyUSB0"; or an object with `send`, `receive`, `close`
    bytesize             7, as in the standard, or 8, as many devices have it (default)
    character_timeout    the longest pause between two characters of a frame, in seconds (default 1)
    options              `unit`, `timeout`, `retries`, `gap`, `recovery`, `late_window`: see `ModbusClient`
    """

    def __init__(
        self,
        port: str | Port[bytes],
        *,
        baudrate: int = 19200,
        parity: str = "E",
        stopbits: int = 1,
        bytesize: int = 8,
        character_timeout: float = 1.0,
        **options: Any,
    ) -> None:
        def open_port() -> Port[bytes]:
            if not isinstance(port, str):
                return port
            return SerialPort(port, baudrate=baudrate, parity=parity, stopbits=stopbits, bytesize=bytesize)

        def new_line() -> AsciiLine:
            return AsciiLine(character_timeout=character_timeout, data_bits=bytesize)

        super().__init__(open_port, new_line, **options)
