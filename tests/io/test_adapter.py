"""Serial adapters that return under another name: a folder like /dev, whose devices are pseudo-terminals."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from barewire import AsyncModbusClient, ModbusClient, ModbusServer, Table
from barewire.errors import PortError
from barewire.io import adapter as adapter_module
from barewire.io.adapter import Adapter

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="links of udev")


class Devices:
    """A folder with devices, and links to them by identity and by socket."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for kind in ("by-id", "by-path"):
            (folder / "serial" / kind).mkdir(parents=True)

    def plug(self, name: str, identity: str | None, socket: str | None, terminal: str = "/dev/null") -> str:
        """Make a device with this name, and its links; a link of this identity that is there is replaced."""
        (self.folder / name).symlink_to(terminal)
        for kind, link in (("by-id", identity), ("by-path", socket)):
            if link is not None:
                (self.folder / "serial" / kind / link).unlink(missing_ok=True)
                (self.folder / "serial" / kind / link).symlink_to(f"../../{name}")
        return str(self.folder / name)

    def unplug(self, name: str) -> None:
        """Remove a device and its links."""
        (self.folder / name).unlink()
        for link in self.folder.glob("serial/*/*"):
            if os.readlink(link) == f"../../{name}":
                link.unlink()


@pytest.fixture
def devices(tmp_path: Path) -> Devices:
    return Devices(tmp_path)


def opened(devices: Devices, path: str) -> tuple[Adapter, list[str]]:
    """Return the adapter of a name, after it was opened, and what it logs."""
    said: list[str] = []
    adapter = Adapter(path, said.append, str(devices.folder))
    assert adapter.find() == path
    adapter.opened(path)
    return adapter, said


def test_an_adapter_that_returns_under_another_name_is_found_by_its_link(devices: Devices) -> None:
    adapter, said = opened(devices, devices.plug("ttyUSB0", "usb-FTDI_A5", "usb-1.2"))
    devices.unplug("ttyUSB0")
    assert adapter.find() == adapter.path  # which is not there: the error of opening says so
    other = devices.plug("ttyUSB1", "usb-FTDI_A5", "usb-1.3")
    assert adapter.find() == other
    assert said == [f"{adapter.path} is {other} now: by-id/usb-FTDI_A5 leads to it"]
    adapter.opened(other)
    devices.unplug("ttyUSB1")
    assert devices.plug("ttyUSB2", None, "usb-1.3") == adapter.find()  # in the same socket


def test_its_name_may_be_that_of_another_adapter_by_then(devices: Devices) -> None:
    adapter, _ = opened(devices, devices.plug("ttyUSB0", "usb-FTDI_A5", "usb-1.2"))
    devices.unplug("ttyUSB0")
    devices.plug("ttyUSB0", "usb-Prolific", "usb-1.2")
    with pytest.raises(PortError) as caught:
        adapter.find()
    text = f"{adapter.path} is another adapter now: by-id/usb-Prolific, not by-id/usb-FTDI_A5"
    assert str(caught.value) == text
    assert devices.plug("ttyUSB1", "usb-FTDI_A5", "usb-1.4") == adapter.find()


def test_an_adapter_of_which_nothing_is_known_is_another_one(devices: Devices) -> None:
    adapter, _ = opened(devices, devices.plug("ttyUSB0", "usb-FTDI_A5", "usb-1.2"))
    devices.unplug("ttyUSB0")
    devices.plug("ttyUSB0", None, None)
    with pytest.raises(PortError, match="another adapter now: no link leads to it, not by-id/usb-FTDI_A5"):
        adapter.find()


def test_a_twin_without_a_serial_number_in_another_socket_is_another_adapter(devices: Devices) -> None:
    """Both have the same identity, and the link in by-id leads to the one that was plugged in last, or that is left."""
    devices.plug("ttyUSB0", "usb-1a86_USB_Serial", "usb-1.1")
    adapter, _ = opened(devices, devices.plug("ttyUSB1", "usb-1a86_USB_Serial", "usb-1.2"))
    devices.unplug("ttyUSB1")
    (devices.folder / "serial/by-id/usb-1a86_USB_Serial").symlink_to("../../ttyUSB0")
    assert adapter.find() == adapter.path
    devices.plug("ttyUSB1", None, "usb-1.3")
    with pytest.raises(PortError, match="is another adapter now"):
        adapter.find()
    devices.unplug("ttyUSB1")
    assert devices.plug("ttyUSB2", None, "usb-1.2") == adapter.find()


def test_a_name_that_is_a_link_is_followed_and_another_adapter_there_is_logged(devices: Devices) -> None:
    devices.plug("ttyUSB0", "usb-FTDI_A5", "usb-1.2")
    by_path = str(devices.folder / "serial/by-path/usb-1.2")
    adapter, said = opened(devices, by_path)
    devices.unplug("ttyUSB0")
    devices.plug("ttyUSB1", "usb-Prolific", "usb-1.2")
    assert adapter.find() == by_path
    assert said == [f"{by_path} is another adapter now: by-id/usb-Prolific, not by-id/usb-FTDI_A5"]


def test_without_links_every_name_is_opened_as_it_is(tmp_path: Path) -> None:
    for path in ("COM3", str(tmp_path / "ttyS0"), "/dev/pts/0", "a\0b"):
        adapter = Adapter(path, pytest.fail, str(tmp_path))
        adapter.opened(path)
        assert adapter.find() == path


@pytest.fixture
def two_lines(devices: Devices, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[ModbusServer, ModbusServer]]:
    """Two serial lines whose units have 7 and 8 in their registers."""
    monkeypatch.setattr(adapter_module, "Adapter", partial(Adapter, folder=str(devices.folder)))
    with (
        ModbusServer("rtu://pty", units={1: Table(4, holding_registers=[7] * 4)}) as first,
        ModbusServer("rtu://pty", units={1: Table(4, holding_registers=[8] * 4)}) as second,
    ):
        yield first, second


@pytest.mark.parametrize("world", ["blocking", "asyncio"])
def test_a_client_goes_on_with_its_adapter_and_not_with_another_one(
    devices: Devices,
    two_lines: tuple[ModbusServer, ModbusServer],
    world: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    terminals = [server.url.partition("://")[2].partition("?")[0] for server in two_lines]
    path = devices.plug("ttyUSB0", "usb-FTDI_A5", "usb-1.2", terminals[0])
    url = f"rtu://{path}?reconnect_first=0.001&reconnect_longest=0.001"

    def read() -> object:
        if isinstance(client, ModbusClient):
            return client.read_holding_registers(0, 1)
        return asyncio.run(read_and_drop(client))

    async def read_and_drop(client: AsyncModbusClient) -> object:
        try:
            return await client.read_holding_registers(0, 1)
        finally:
            client.connection.drop("unplugged")

    client = ModbusClient(url) if world == "blocking" else AsyncModbusClient(url)
    assert read() == (7,)
    devices.unplug("ttyUSB0")
    devices.plug("ttyUSB0", "usb-Prolific", "usb-1.3", terminals[1])
    client.connection.drop("unplugged")
    with pytest.raises(PortError, match="ttyUSB0 is another adapter now: by-id/usb-Prolific, not by-id/usb-FTDI_A5"):
        read()
    devices.plug("ttyUSB1", "usb-FTDI_A5", "usb-1.2", terminals[0])
    with caplog.at_level(logging.WARNING, "barewire.modbus.client"):
        assert read() == (7,)
    assert [record.message for record in caplog.records if "ttyUSB1 now: by-id/usb-FTDI_A5" in record.message] != []
