"""can://memory/NAME: a bus inside this process, for blocking and asyncio clients and servers."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading

import pytest

import barewire
from barewire.canopen import CanFrame
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.interfaces import can_endpoint, can_port
from barewire.io.ports.can.memory import MemoryPort, _buses
from tests.helpers import PATIENCE
from tests.io.canopen.memory_bus import numbered


def ports(name: str, count: int) -> list[MemoryPort]:
    return [MemoryPort(Endpoint.parse(f"can://memory/{name}")) for _ in range(count)]


def close(*opened: MemoryPort) -> None:
    for port in opened:
        port.close()


def test_a_frame_reaches_all_other_ports_of_this_name() -> None:
    one, two, three = ports("reach", 3)
    (other,) = ports("elsewhere", 1)
    frames = [CanFrame(0x80), CanFrame(0x12345, b"x", True), CanFrame(0x705, b"", False, True, 1)]
    for frame in frames:
        one.send(frame)
    assert [two.receive(0.0) for _ in frames] == [three.receive_any(0.0) for _ in frames] == frames
    assert (one.receive(0.0), two.receive(0.001), other.receive(0.0)) == (None, None, None)
    close(one, two, three, other)
    assert not {"memory/reach", "memory/elsewhere"} & _buses.keys()


def test_senders_in_several_threads_are_received_in_the_same_order_everywhere() -> None:
    one, two, three, four = ports("order", 4)
    threads = [threading.Thread(target=lambda port=port: [port.send(f) for f in numbered(500)]) for port in (one, two)]
    for thread in threads:
        thread.start()
    heard = [[port.receive(30.0) for _ in range(1000)] for port in (three, four)]
    for thread in threads:
        thread.join()
    assert heard[0] == heard[1]
    assert sorted(str(frame) for frame in heard[0]) == sorted(str(frame) for frame in 2 * numbered(500))
    close(one, two, three, four)


def test_frames_without_room_are_counted() -> None:
    one, two = ports("room", 2)
    for frame in numbered(4100):
        one.send(frame)
    assert two.lost == 4
    assert two.receive(0.0) == numbered(1)[0]
    close(one, two)


def test_a_closed_port_says_so_and_wakes_its_reader() -> None:
    (port,) = ports("closed", 1)
    failed: list[str] = []

    def read() -> None:
        try:
            port.receive(60.0)
        except PortError as error:
            failed.append(str(error))

    thread = threading.Thread(target=read)
    thread.start()
    port.close()
    thread.join(30.0)
    assert failed == ["can://memory/closed: the port was closed"]
    with pytest.raises(PortError, match="the port was closed"):
        port.send(CanFrame(0x80))
    port.close()


@pytest.mark.parametrize(("url", "text"), [("can://memory/", "memory"), ("can://memory/x?filter=5", "filter")])
def test_a_wrong_url_is_refused(url: str, text: str) -> None:
    with pytest.raises(EncodeError, match=text):
        can_port(can_endpoint(url))


def test_blocking_clients_and_servers_share_a_bus() -> None:
    url = "can://memory/blocking"
    with (
        barewire.CanopenServer(f"{url}?node=5", device="az3"),
        barewire.CanopenServer(f"{url}?node=6", device="az3"),
        barewire.CanopenClient(url, timeout=30.0) as client,
        barewire.CanopenClient(url, timeout=30.0) as other,
        other.frames((0x585, False)) as stream,
    ):
        assert client.node(5).sdo.upload(0x1000) == client.node(6).sdo.upload(0x1000)
        frame = stream.get(30.0)
        assert isinstance(frame, CanFrame)
        assert frame.id == 0x585


def test_asyncio_needs_no_thread() -> None:
    async def main() -> None:
        url = "can://memory/asyncio"
        async with (
            barewire.AsyncCanopenServer(f"{url}?node=5", device="az3"),
            barewire.AsyncCanopenServer(f"{url}?node=6", device="az3"),
            barewire.AsyncCanopenClient(url, timeout=30.0) as client,
        ):
            found = await asyncio.gather(*(client.node(number).sdo.upload(0x1000) for number in (5, 6)))
            assert found[0] == found[1]
            assert not [thread for thread in threading.enumerate() if "memory/asyncio" in thread.name]

    asyncio.run(main())


def test_a_blocking_client_of_an_asyncio_server() -> None:
    async def main() -> None:
        url = "can://memory/mixed"
        async with barewire.AsyncCanopenServer(f"{url}?node=5", device="az3"):
            with barewire.CanopenClient(url, timeout=30.0) as client:
                assert await asyncio.to_thread(client.node(5).sdo.upload, 0x1000)

    asyncio.run(main())


def test_silence_is_explained() -> None:
    with (
        barewire.CanopenClient("can://memory/silent") as client,
        pytest.raises(NoAnswer, match="can://memory is inside one process"),
    ):
        client.node(5).sdo.upload(0x1000, timeout=0.01)


def test_it_needs_no_python_can() -> None:
    code = """
import sys, barewire, barewire.canopen
with barewire.CanopenClient("can://memory/x") as client:
    client.send(barewire.canopen.CanFrame(0x80))
assert "can" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_a_frame_that_arrives_while_another_holds_the_port_is_not_left_until_the_next_one() -> None:
    """A port without a descriptor tells the loop once. A stream that was closed in another thread may still read."""

    async def main() -> None:
        ours, other = ports("held", 2)
        async with barewire.AsyncCanopenClient(ours) as client:
            with client.frames() as stream:
                reader = client.bus.loop_reader
                assert reader is not None
                with client.bus.reading:
                    other.send(CanFrame(0x80))
                    reader.read()
                    await asyncio.sleep(0)
                    await asyncio.sleep(0)
                    assert await stream.get(0.0) is None
                assert await stream.get(PATIENCE) == CanFrame(0x80)
                assert not [thread for thread in threading.enumerate() if thread.name == "reader of memory/held"]
        other.close()

    asyncio.run(main())
