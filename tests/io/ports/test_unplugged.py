"""Ports that are not there, or gone in the middle: the error says so, and what to do."""

from __future__ import annotations

import asyncio
import errno
import os
from types import SimpleNamespace
from typing import Any

import can
import pytest

from barewire import AsyncModbusClient
from barewire.canopen import CanFrame
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports import descriptor
from barewire.io.ports.can.python_can import CanPort
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.ports.serial import SerialPort
from tests.helpers import refused


def failing(number: int, *, doubled: bool = False) -> Any:
    """A function that raises the error of the system as pyserial and python-can pass it on."""

    def fail(*_: object, **__: object) -> None:
        error = OSError(number, os.strerror(number))
        if not doubled:
            raise error
        raise can.CanOperationError(f"could not read: {error}", number) from error

    return fail


@pytest.mark.parametrize("number", [errno.EIO, errno.ENODEV, errno.ENXIO])
@pytest.mark.parametrize("method", ["read", "write"])
def test_an_adapter_that_was_unplugged_is_called_that(
    number: int, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = PseudoTerminal()
    try:
        port = SerialPort.of(Endpoint.parse(f"rtu://{terminal.path}"))
        port._is_pseudo_terminal = False
        terminal.send(b"x")
        monkeypatch.setattr(descriptor, "os", SimpleNamespace(**{method: failing(number)}))
        with refused(PortError, f"{terminal.path}: the device is gone: was the adapter unplugged?"):
            if method == "read":
                port.receive(30.0)
            else:
                port.send(b"x")
        port.close()
    finally:
        terminal.close()


def test_a_pseudo_terminal_whose_program_ended_is_called_that() -> None:
    gone = "the device is gone: the program at the other end of the pseudo-terminal has ended"
    terminal = PseudoTerminal()
    port = SerialPort.of(Endpoint.parse(f"rtu://{terminal.path}"))
    terminal.close()
    with refused(PortError, f"{terminal.path}: {gone}"):
        port.receive(30.0)
    port.close()

    async def main() -> None:
        terminal = PseudoTerminal()
        async with AsyncModbusClient(f"rtu://{terminal.path}?timeout=5") as client:
            waiting = asyncio.ensure_future(client.read_holding_registers(0, 1))
            await asyncio.sleep(0)
            terminal.close()
            with refused(PortError, gone):
                await waiting

    asyncio.run(main())


class GoneBus:
    """A bus of python-can whose interface is gone."""

    def __init__(self, number: int, doubled: bool) -> None:
        self.send = self.recv = failing(number, doubled=doubled)

    def shutdown(self) -> None: ...


@pytest.mark.parametrize("doubled", [False, True])
@pytest.mark.parametrize(
    ("place", "number", "text"),
    [
        ("slcan//dev/ttyACM0", errno.ENETDOWN, "the interface is down"),
        ("slcan//dev/ttyACM0", errno.EIO, "the device is gone: was the adapter unplugged?"),
        ("slcan//dev/ttyACM0", errno.ENXIO, "the device is gone: was the adapter unplugged?"),
    ],
)
def test_an_interface_that_is_down_or_removed_is_called_that(
    place: str, number: int, text: str, doubled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can, "Bus", lambda **_: GoneBus(number, doubled))
    port = CanPort(Endpoint.parse(f"can://{place}?bitrate=500000"))
    with refused(PortError, f"can://{place}: {text}"):
        port.receive(1.0)
    with refused(PortError, f"can://{place}: {text}"):
        port.send(CanFrame(0x80, b""))
