"""The types of the keyword options of Modbus clients and servers. `endpoint` describes each option.

A keyword is an option of the URL and overrides it: `ModbusClient("tcp://10.0.0.7", gap=0.1)` is the same as
`ModbusClient("tcp://10.0.0.7?gap=0.1")`. The scheme of a URL determines which options it may have.
"""

from __future__ import annotations

from os import PathLike
from typing import Literal, TypedDict


class ModbusOptions(TypedDict, total=False):
    """All options but `unit` and `timeout`. Times are in seconds."""

    gap: float
    dead_after: int
    late_window: float
    recovery: Literal["probe", "wait"]
    retries: int
    reconnect_first: float
    reconnect_longest: float
    any_unit: bool
    any_transaction: bool
    baudrate: int
    parity: Literal["N", "E", "O"]
    stopbits: float
    bytesize: Literal[7, 8]
    latency: Literal["uart", "usb", "tunnel"]
    patience: float | Literal["strict"]
    echo: bool | Literal["auto"]
    rs485: Literal["off", "kernel", "rts"]
    pace: bool
    cert: str | PathLike[str]
    key: str | PathLike[str]
    ca: str | PathLike[str]
    server_name: str
    roles: str | PathLike[str]
    client_cert: Literal["required", "none"]
    connections: int
    idle: float
