"""A bus whose port fails and is opened again: errors, events, and what continues."""

from __future__ import annotations

import asyncio
import os
import threading
import time
import tty
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import CanFrame, ErrorFrame, NmtCommand, NmtState
from barewire.errors import NoAnswer, PortError
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.bus.port import LASTED, Reopening
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import BusDown, BusUp, FrameListener, Stream
from barewire.io.endpoint import Endpoint
from barewire.io.engine.connections import BackOff
from barewire.io.ports.can.python_can import GARBLED_LIMIT, CanPort
from barewire.io.server.can import SocketcandHub
from tests.helpers import free_port
from tests.io.canopen.memory_bus import MemoryPort, device

pytest.importorskip("can")

UNPLUGGED = PortError("the adapter was unplugged")
T = TypeVar("T")


def frame(text: str) -> CanFrame:
    return CanFrame.parse(text)


class Adapter:
    """Opens ports, of which it keeps each. The next `failing` attempts fail."""

    def __init__(self) -> None:
        self.ports: list[MemoryPort] = [MemoryPort()]
        self.failing = 0
        self.may_open = threading.Event()
        self.may_open.set()

    @property
    def port(self) -> MemoryPort:
        return self.ports[-1]

    def dial(self) -> MemoryPort:
        self.may_open.wait(30.0)
        if self.failing:
            self.failing -= 1
            raise PortError("no such adapter")
        self.ports.append(MemoryPort())
        return self.port

    def bus(self) -> CanBus:
        return CanBus(self.port, dial=self.dial)


def until(stream: Stream[CanFrame], kind: type[T]) -> T:
    """Return the next event of a kind, and skip those before it."""
    while True:
        event = stream.get(30.0)
        assert event is not None, f"{kind.__name__} did not arrive"
        if isinstance(event, kind):
            return event


def test_streams_report_bus_down_and_bus_up_and_continue() -> None:
    adapter = Adapter()
    adapter.failing = 2
    with adapter.bus() as bus, Stream(bus, FrameListener(), {(0x80, False)}) as stream:
        adapter.port.deliver(frame("080#01"), UNPLUGGED)
        assert stream.get(30.0) == frame("080#01")
        assert stream.get(30.0) == BusDown("the adapter was unplugged")
        back = stream.get(30.0)
        assert isinstance(back, BusUp)
        assert back.after > 0
        assert [port.closed for port in adapter.ports] == [True, False]
        adapter.port.deliver(frame("080#02"))
        assert stream.get(30.0) == frame("080#02")
        assert bus.failure is None
    assert adapter.port.closed


def test_a_transfer_fails_the_next_waits_for_the_bus_and_a_hosted_node_continues() -> None:
    adapter = Adapter()
    with adapter.bus() as bus, Stream(bus, FrameListener(), None) as stream:
        ours = device(6)
        with CanopenClient(bus, node=5, timeout=30.0) as client, client.host(ours):
            client.node(6).sdo.download(0x2001, 0, b"\x07")
            adapter.may_open.clear()
            reported: list[str] = []

            def ask() -> None:
                with pytest.raises(PortError) as caught:
                    client.node().sdo.upload(0x1000)
                reported.append(str(caught.value))

            asking = threading.Thread(target=ask)
            asking.start()
            while until(stream, CanFrame).id != 0x605:
                pass
            adapter.port.deliver(UNPLUGGED)
            asking.join(30.0)
            assert reported == ["the adapter was unplugged"]
            with pytest.raises(PortError, match="unplugged"):
                client.node(timeout=0.01).sdo.upload(0x1000)
            with pytest.raises(PortError, match="unplugged"):
                client.receive(0.01)
            threading.Timer(0.05, adapter.may_open.set).start()
            assert client.node(6).sdo.upload(0x2001) == b"\x07"
            assert client.receive(0.0) is None
            adapter.port.deliver(frame("080#"))
            assert client.receive(30.0) == frame("080#")


def test_reopening_with_asyncio() -> None:
    adapter = Adapter()

    async def main() -> None:
        with adapter.bus() as bus:
            async with AsyncCanopenClient(bus, node=6, timeout=30.0) as client:
                with client.host(device(6)), client.frames((0x80, False)) as stream:
                    await asyncio.sleep(0)
                    assert await client.node().sdo.upload(0x6041) == b"\x37\x06"
                    adapter.may_open.clear()
                    silent = asyncio.create_task(client.node(5).sdo.upload(0x1000))
                    while frame("605#4000100000000000") not in adapter.port.sent:
                        await asyncio.sleep(0)
                    adapter.port.deliver(UNPLUGGED)
                    with pytest.raises(PortError, match="unplugged"):
                        await silent
                    assert await stream.get(30.0) == BusDown("the adapter was unplugged")
                    with pytest.raises(PortError, match="unplugged"):
                        await client.node(timeout=0.01).sdo.upload(0x1000)
                    asking = [asyncio.create_task(client.node().sdo.upload(0x6041)) for _ in range(20)]
                    await asyncio.sleep(0)
                    adapter.may_open.set()
                    assert await asyncio.gather(*asking) == [b"\x37\x06"] * 20
                    assert isinstance(await stream.get(30.0), BusUp)

    asyncio.run(main())


def test_a_stream_opened_while_the_bus_is_down() -> None:
    adapter = Adapter()
    adapter.may_open.clear()
    with adapter.bus() as bus, Stream(bus, FrameListener(), None) as first:
        adapter.port.deliver(UNPLUGGED)
        until(first, BusDown)
        with pytest.raises(PortError, match="unplugged"):
            bus.send(frame("080#"))
        with Stream(bus, FrameListener(), None) as second:
            assert second.get(0.0) == BusDown("the adapter was unplugged")
            adapter.may_open.set()
            assert isinstance(second.get(30.0), BusUp)


def test_a_bus_can_be_closed_during_a_pause() -> None:
    adapter = Adapter()
    adapter.failing = 10**9
    bus = adapter.bus()
    stream = Stream(bus, FrameListener(), None)
    adapter.port.deliver(UNPLUGGED)
    until(stream, BusDown)
    reopening = bus._reopening
    assert reopening is not None
    while reopening.back_off.why != "no such adapter":
        time.sleep(0.001)
    bus.close()
    with pytest.raises(PortError, match="closed"):
        stream.get(30.0)
    assert not bus._reader.is_alive()  # type: ignore[union-attr]
    assert bus.when_open(lambda: None)


def test_a_bus_without_dial_is_not_opened_again() -> None:
    port = MemoryPort()
    with CanBus(port) as bus, Stream(bus, FrameListener(), None) as stream:
        port.deliver(UNPLUGGED)
        with pytest.raises(PortError, match="unplugged"):
            stream.get(30.0)


def test_a_port_that_fails_at_once_does_not_end_the_growth_of_the_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interface that is down can be opened; the pauses grow all the same."""
    now, pauses = 100.0, []
    broken = 5

    def dial() -> MemoryPort:
        nonlocal broken
        port = MemoryPort()
        if broken:
            broken -= 1
            port.deliver(PortError("network is down"))
        else:
            port.deliver(frame("080#"))
        return port

    class Stop(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            nonlocal now
            pauses.append(timeout)
            now += timeout or 0.0
            return False

    monkeypatch.setattr("barewire.io.canopen.bus.port.time.monotonic", lambda: now)
    reopening = Reopening(dial, Stop().wait)
    reopening.back_off = BackOff(lambda: 0.5)
    opened = reopening.reopen(MemoryPort(), "unplugged")
    assert opened is not None
    assert opened[1] == frame("080#")
    assert pauses == [0.125, 0.25, 0.5, 1.0, 2.0, 4.0]
    pauses.clear()
    reopening.reopen(opened[0], "again, at once")
    assert pauses == [8.0]
    pauses.clear()
    now += LASTED
    reopening.reopen(opened[0], "after a while")
    assert pauses == [0.0]


def test_a_node_sends_8140h_when_the_controller_is_back_on_the_bus() -> None:
    port = MemoryPort()
    with CanBus(port) as bus, CanopenClient(bus, node=6, timeout=30.0) as client, client.host(device(6)):
        client.node().nmt.send_confirmed(NmtCommand.START, ask_every=0.1, timeout=30.0)
        errors = client.frames((0x86, False))
        for restarted in (ErrorFrame(0x100), frame("123#")):
            port.deliver(ErrorFrame(0x40, bytes(8)), restarted)
            message = [str(until(errors, CanFrame)) for _ in range(2)]
            assert message == ["086#4081110000000000", "086#0000000000000000"]
        assert client.node().nmt.state(timeout=30.0).state == NmtState.PRE_OPERATIONAL  # as 1029h requires


# Through python-can


def test_clients_continue_after_a_restart_of_the_socketcand_server() -> None:
    place = free_port()
    url = f"can://socketcand/127.0.0.1:{place}/can0?node=5&timeout=30"
    hub = SocketcandHub("127.0.0.1", place)
    try:
        with CanopenClient(url) as client, CanopenClient(url) as other, other.host(device()), client.frames() as stream:
            assert client.node().sdo.upload(0x6041) == b"\x37\x06"
            hub.close()
            assert until(stream, BusDown).why.endswith("the server hung up")
            hub = SocketcandHub("127.0.0.1", place)
            until(stream, BusUp)
            other.bus.wait_until_open(30.0)
            assert client.node().sdo.upload(0x6041) == b"\x37\x06"
    finally:
        hub.close()


def test_a_served_node_goes_on_after_a_restart_of_the_socketcand_server() -> None:
    place = free_port()
    url = f"can://socketcand/127.0.0.1:{place}/can0?node=5&timeout=30"
    hub = SocketcandHub("127.0.0.1", place)
    node = device()
    try:
        with CanopenServer(url, device=node) as host:
            with CanopenClient(url) as client:
                client.node().sdo.download(0x2001, 0, b"\x07")
            hub.close()
            hub = SocketcandHub("127.0.0.1", place)
            with CanopenClient(url) as client:
                deadline = time.monotonic() + 30.0
                received = b""
                while not received and time.monotonic() < deadline:
                    with suppress(NoAnswer):  # the node may not be back yet
                        received = client.node(timeout=1.0).sdo.upload(0x2001)
                assert received == b"\x07"  # it has not been switched off
        assert host.failure is None
    finally:
        hub.close()


class Slcan:
    """The far end of a serial adapter, on a pseudo-terminal with a link to it."""

    def __init__(self, link: Path) -> None:
        self.far, self._near = os.openpty()
        tty.setraw(self._near)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._near))

    def say(self, data: bytes) -> None:
        os.write(self.far, data)

    def close(self) -> None:
        for descriptor in (self.far, self._near):
            with suppress(OSError):
                os.close(descriptor)


@pytest.mark.parametrize(
    "noise",
    [b"t12\r", b"tXYZ2\r", b"\xff\xfe\x80t1\r", b"T123\r", b"t1238001122\r", b"\r\r\r", b"zzz\r", b"\a", b"R0000\r"],
)
def test_noise_on_a_serial_adapter_is_counted_and_reading_continues(tmp_path: Path, noise: bytes) -> None:
    pytest.importorskip("serial")
    adapter = Slcan(tmp_path / "can")
    port = CanPort(Endpoint.parse(f"can://slcan/{tmp_path}/can"))
    try:
        adapter.say(b"t12320102\r")
        assert port.receive(30.0) == frame("123#0102")
        adapter.say(noise + b"t12320304\r")
        received = [port.receive(30.0)]
        while received[-1] != frame("123#0304"):
            received.append(port.receive(30.0))
        assert port.garbled + len(received) <= 3
    finally:
        port.close()
        adapter.close()


def test_only_noise_is_a_port_error(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    adapter = Slcan(tmp_path / "can")
    port = CanPort(Endpoint.parse(f"can://slcan/{tmp_path}/can"))

    try:
        adapter.say(b"tXYZ\r" * 2 * GARBLED_LIMIT)
        with pytest.raises(PortError, match="can://slcan"):
            port.receive(30.0)
        assert port.garbled == GARBLED_LIMIT
    finally:
        port.close()
        adapter.close()


def test_a_serial_adapter_that_is_plugged_in_again_is_opened_again(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    adapter = Slcan(tmp_path / "can")
    try:
        with CanopenClient(f"can://slcan/{tmp_path}/can") as client, client.frames((0x123, False)) as stream:
            adapter.say(b"t12320102\r")
            assert stream.get(30.0) == frame("123#0102")
            adapter.close()
            until(stream, BusDown)
            adapter = Slcan(tmp_path / "can")
            until(stream, BusUp)
            adapter.say(b"t12320304\r")
            assert stream.get(30.0) == frame("123#0304")
    finally:
        adapter.close()
