"""The log and the statistics of buses, nodes and clients."""

from __future__ import annotations

import asyncio
import logging
import re

import pytest

import barewire
from barewire.canopen import CanFrame, ErrorFrame
from barewire.errors import NoAnswer, PortError
from barewire.io import CanBus
from tests.helpers import PATIENCE

LOGGERS = {name: f"barewire.canopen.{name}" for name in ("bus", "server", "client")}


def lines(caplog: pytest.LogCaptureFixture, name: str) -> list[str]:
    """The level and text of each line of one logger."""
    found = [record for record in caplog.records if record.name == LOGGERS[name]]
    return [f"{record.levelname} {record.getMessage()}" for record in found]


class Breaking:
    """A port that receives these items and then fails, or waits."""

    name = "test/can0"

    def __init__(self, *items: CanFrame | ErrorFrame | Exception) -> None:
        self.items = list(items)

    def send(self, item: CanFrame) -> None:
        raise PortError("can://test/can0: no acknowledgement")

    def receive(self, timeout: float) -> CanFrame | None:
        item = self.items.pop(0) if self.items else None
        if isinstance(item, Exception):
            raise item
        return item  # type: ignore[return-value]

    receive_any = receive

    def close(self) -> None:
        pass


def test_a_server_and_a_client_on_a_bus(log: pytest.LogCaptureFixture) -> None:
    url = "can://virtual/log-client"
    with (
        barewire.CanopenServer(f"{url}?node=5", device="az3") as server,
        barewire.CanopenClient(url, timeout=PATIENCE) as client,
    ):
        client.node(5).sdo.upload(0x1000)
        assert (server.statistics.received, server.statistics.unsent) == (1, 0)
        with pytest.raises(NoAnswer) as caught:
            client.node(9, timeout=0.2).sdo.upload(0x1000)
    assert server.statistics.sent >= 2  # the boot-up and the response
    assert lines(log, "server") == [f"INFO {url}: serving", f"INFO {url}: closed"]
    assert lines(log, "bus") == [f"INFO {url}: opened", f"INFO {url}: closed"]
    assert lines(log, "client") == [f"INFO {url}: {caught.value}"]


def test_an_asyncio_server_and_client(log: pytest.LogCaptureFixture) -> None:
    url = "can://virtual/log-asyncio"

    async def main() -> tuple[barewire.AsyncCanopenServer, str]:
        async with (
            barewire.AsyncCanopenServer(f"{url}?node=5", device="az3") as server,
            barewire.AsyncCanopenClient(url, timeout=PATIENCE) as client,
        ):
            await client.node(5).sdo.upload(0x1000)
            with pytest.raises(NoAnswer) as caught:
                await client.node(9, timeout=0.2).sdo.upload(0x1000)
            async with asyncio.timeout(10):
                while server.statistics.received < 3:  # the abort to node 9 may still be on its way
                    await asyncio.sleep(0.01)
            return server, str(caught.value)

    server, text = asyncio.run(main())
    assert (server.statistics.received, server.statistics.unsent) == (3, 0)  # with the request and abort to node 9
    assert server.statistics.sent >= 2
    assert lines(log, "server") == [f"INFO {url}: serving", f"INFO {url}: closed"]
    assert lines(log, "client") == [f"INFO {url}: {text}"]


def test_all_frames_at_level_debug(log: pytest.LogCaptureFixture) -> None:
    url = "can://virtual/log-frames"
    log.set_level(logging.DEBUG, LOGGERS["bus"])
    with barewire.CanopenServer(f"{url}?node=5", device="az3"), barewire.CanopenClient(url, timeout=PATIENCE) as client:
        client.node(5).sdo.upload(0x1000)
    found = lines(log, "bus")
    for direction in ("sent", "received"):  # each by one of the two
        assert f"DEBUG {url}: {direction} 605#4000100000000000" in found
        assert [line for line in found if line.startswith(f"DEBUG {url}: {direction} 585#4300100")]


def test_a_bus_that_fails_and_is_opened_again(log: pytest.LogCaptureFixture) -> None:
    ports: list[Breaking | PortError] = [PortError("can://test/can0: no such device"), Breaking()]

    def dial() -> Breaking:
        port = ports.pop(0)
        if isinstance(port, Exception):
            raise port
        return port

    broken = Breaking(ErrorFrame(0x40), PortError("can://test/can0: the interface is down"))
    with CanBus(broken, dial=dial, pauses=(0.01, 0.02)) as bus:
        bus.wait_until_open(30.0)
        while bus.failure is not None or ports:
            bus.wait_until_open(30.0)
    found = [re.sub(r"\d\.\d\d s", "N s", line) for line in lines(log, "bus")]
    assert found == [
        "INFO can://test/can0: opened",
        f"INFO can://test/can0: controller: {ErrorFrame(0x40).text}",
        "WARNING can://test/can0: down: the interface is down; opened again after N s",
        "INFO can://test/can0: not opened: no such device; next after N s",
        "WARNING can://test/can0: up again after N s",
        "INFO can://test/can0: closed",
    ]


def test_a_bus_that_cannot_be_opened_again(log: pytest.LogCaptureFixture) -> None:
    with CanBus(Breaking(PortError("can://test/can0: the interface is down"))) as bus:
        bus._reader.join(30)  # type: ignore[union-attr]
    assert lines(log, "bus") == [
        "INFO can://test/can0: opened",
        "WARNING can://test/can0: failed: the interface is down",
    ]


def test_frames_that_nothing_acknowledges(log: pytest.LogCaptureFixture) -> None:
    server = barewire.CanopenServer("can://virtual/log-unsent?node=5", device="az3")
    server.port.close()
    server.port = Breaking()
    with server:
        for _ in range(30):
            server.do(lambda now: [CanFrame(0x185, b"\x01")])
    assert server.statistics.unsent >= 31  # with the boot-up, and what else the drive sends
    found = [line for line in lines(log, "server") if "not sent" in line]
    assert "WARNING can://virtual/log-unsent: frame 185#01 not sent: can://test/can0: no acknowledgement" in found
    assert len(found) == 11
    assert f"({server.statistics.unsent - 11} more like this in the last" in found[-1]
