"""Devices whose code raises errors, on a bus: with each host they answer and beat, and their owner learns it."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from barewire import AsyncCanopenClient, AsyncCanopenServer, CanopenClient, CanopenServer
from barewire.canopen import CanFrame, Entry, LocalNode, ObjectDictionary, SdoAbort
from barewire.canopen.communication_objects import standard_objects
from barewire.codecs import Value
from barewire.errors import PortError
from barewire.io.canopen.bus.node_runner import NodeStatistics
from tests.helpers import PATIENCE

pytest.importorskip("can")
LOGGERS = {
    "CanopenServer": "server",
    "AsyncCanopenServer": "server",
    "CanopenClient.host": "client",
    "AsyncCanopenClient.host": "client",
}


class Host:
    """A served device: how to change it, and what its owner sees."""

    def __init__(self, host: Any) -> None:
        self._host = host

    @property
    def statistics(self) -> NodeStatistics:
        found: NodeStatistics = self._host.statistics
        return found

    @property
    def failure(self) -> BaseException | None:
        found: BaseException | None = self._host.failure
        return found

    async def do(self, action: Callable[[float], Any]) -> None:
        result = await asyncio.to_thread(self._host.do, action) if self._blocks else self._host.do(action)
        if isinstance(result, Awaitable):
            await result

    @property
    def _blocks(self) -> bool:
        return not type(self._host).__name__.startswith("Async")


@asynccontextmanager
async def hosted(kind: str, url: str, device: Any) -> AsyncIterator[Host]:
    """Serve the device in one of the four ways."""
    match kind:
        case "CanopenServer":
            with CanopenServer(url, device=device) as server:
                yield Host(server)
        case "AsyncCanopenServer":
            async with AsyncCanopenServer(url, device=device) as asyncio_server:
                yield Host(asyncio_server)
        case "CanopenClient.host":
            with CanopenClient(url) as client, client.host(device) as running:
                yield Host(running)
        case _:
            async with AsyncCanopenClient(url) as asyncio_client:
                with asyncio_client.host(device) as asyncio_running:
                    yield Host(asyncio_running)


def broken_sensor() -> Value:
    raise ValueError("no sensor")


def with_broken_sensor() -> LocalNode:
    sensor = Entry(0x2001, 0, "sensor", "u16", "ro", on_read=broken_sensor)
    return LocalNode(5, ObjectDictionary([*standard_objects(heartbeat=50), sensor]))


@pytest.mark.parametrize("kind", LOGGERS)
def test_a_request_whose_code_fails_is_aborted_and_the_device_works_on(
    kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    url, device = f"can://virtual/failing-{kind}", with_broken_sensor()
    reported: list[str] = []

    def report(place: str, error: Exception) -> None:
        reported.append(place)

    device.on_failure = report

    async def main() -> None:
        async with AsyncCanopenClient(url, timeout=PATIENCE) as master, hosted(kind, url, device) as host:
            node = master.node(5)
            with node.emergencies() as emergencies:
                for _ in range(12):
                    with pytest.raises(SdoAbort) as refused:
                        await node.sdo.upload(0x2001)
                    assert refused.value.code == 0x0800_0000
                event = await emergencies.get(PATIENCE)
            assert getattr(getattr(event, "message", None), "code", None) == 0x6100
            assert await node.sdo.upload(0x1000) == bytes(4)
            assert (await node.nmt.wait_for_heartbeat(timeout=PATIENCE)).state == 127
            assert host.failure is None
            assert host.statistics.errors == ["2001h:00: ValueError: no sensor"] * 10

    asyncio.run(main())
    assert reported == ["2001h:00"] * 12, "the `on_failure` of the application is called too"
    assert device.on_failure is report, "and is its own again"
    records = [record for record in caplog.records if "code failed" in record.getMessage()]
    assert {record.name for record in records} == {f"barewire.canopen.{LOGGERS[kind]}"}
    assert all(record.levelno == logging.ERROR for record in records)
    assert records[0].getMessage() == f"{url}: 2001h:00: its code failed: ValueError: no sensor"
    assert records[0].exc_info is not None
    assert len(records) == 11, "ten in a minute, and the number of the others at the end"


class Crashing:
    """A machine of an application that raises an error for some frames, and whenever it is due, except at first."""

    def __init__(self, *, at_start: bool = False) -> None:
        self.at_start = at_start
        self.fed = 0

    @property
    def deadline(self) -> float:
        return 0.0

    def start(self, now: float) -> list[CanFrame]:
        if self.at_start:
            raise RuntimeError("no memory")
        return [CanFrame(0x705, b"\0")]

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        self.fed += 1
        if (frame is None and self.fed > 1) or (frame is not None and frame.id == 0x123):
            raise RuntimeError("a defect")
        return [CanFrame(0x124, frame.data)] if frame is not None and frame.id == 0x122 else []


@pytest.mark.parametrize("kind", LOGGERS)
def test_a_machine_that_raises_errors_gets_the_next_frame(kind: str) -> None:
    url, machine = f"can://virtual/crashing-{kind}", Crashing()

    async def main() -> None:
        async with AsyncCanopenClient(url) as master:
            with master.frames((0x124, False), (0x705, False)) as answers:
                async with hosted(kind, url, machine) as host:
                    assert await answers.get(PATIENCE) == CanFrame(0x705, b"\0")
                    for data in (b"\1", b"\2"):
                        await master.send(CanFrame(0x123, data))
                        await master.send(CanFrame(0x122, data))
                        assert await answers.get(PATIENCE) == CanFrame(0x124, data)
                    assert host.statistics.errors[0] == "Crashing.feed: RuntimeError: a defect"
                    fed, began = machine.fed, time.monotonic()
                    await asyncio.sleep(0.5)
                    most = 15 + 10 * (time.monotonic() - began)
                    assert machine.fed - fed < most, "it is always due, and is fed once in 0.1 s"

    asyncio.run(main())


@pytest.mark.parametrize("kind", LOGGERS)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_machine_that_cannot_start_ends_loudly(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    url = f"can://virtual/dead-{kind}"

    async def main() -> None:
        async with hosted(kind, url, Crashing(at_start=True)) as host:
            while host.failure is None:
                await asyncio.sleep(0.01)
            assert str(host.failure) == "no memory"
            with pytest.raises(PortError, match=r"ended: .*RuntimeError: no memory"):
                await host.do(lambda now: None)

    asyncio.run(main())
    (record,) = [record for record in caplog.records if "ended" in record.getMessage()]
    assert (record.name, record.levelno) == (f"barewire.canopen.{LOGGERS[kind]}", logging.ERROR)
    assert record.getMessage().endswith("ended: its code failed: RuntimeError: no memory")


@pytest.mark.parametrize("kind", LOGGERS)
def test_an_action_that_fails_is_an_error_of_its_caller(kind: str) -> None:
    url, device = f"can://virtual/action-{kind}", with_broken_sensor()

    async def main() -> None:
        async with hosted(kind, url, device) as host, AsyncCanopenClient(url, timeout=PATIENCE) as master:
            with pytest.raises(ZeroDivisionError):
                await host.do(lambda now: 1 // 0)
            assert host.statistics.errors == []
            assert await master.node(5).sdo.upload(0x1000) == bytes(4)

    asyncio.run(main())
