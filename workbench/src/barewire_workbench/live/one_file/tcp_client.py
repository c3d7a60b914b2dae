"""The client of a server on TCP."""

from __future__ import annotations

from typing import Any

from barewire.tcp.line import TcpLine
from barewire_workbench.live.one_file.modbus_client import ModbusClient
from barewire_workbench.live.one_file.tcp_port import TcpPort


class ModbusTcpClient(ModbusClient):
    """A client of the units of one server. A late answer is told by its transaction number.

    any_unit    accept responses with another unit than their request, a fault of some gateways
    options     `unit`, `timeout`, `retries`, `gap`: see `ModbusClient`
    """

    def __init__(self, host: str, port: int = 502, *, any_unit: bool = False, **options: Any) -> None:
        super().__init__(lambda: TcpPort(host, port), lambda: TcpLine(any_unit=any_unit), **options)
