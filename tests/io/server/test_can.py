"""Servers of a CANopen node: every kind of device, blocking and with asyncio."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from barewire import AsyncCanopenClient, AsyncCanopenServer, CanopenClient, CanopenServer
from barewire.canopen import CanFrame, Entry, LocalNode, ObjectDictionary, SdoAbort
from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.eds import parse
from barewire.devices import load
from barewire.devices.sim import simulator
from barewire.errors import DecodeError, EncodeError, PortError
from barewire.io.ports.base import Port
from barewire.io.ports.can.python_can import CanPort
from tests.helpers import PATIENCE, until

pytest.importorskip("can")

EDS = b"""[MandatoryObjects]
SupportedObjects=1
1=0x1000
[1000]
ParameterName=Device type
DataType=0x0007
AccessType=ro
DefaultValue=0x191
[2000]
ParameterName=Node
DataType=0x0005
AccessType=ro
DefaultValue=$NODEID+1
"""


def objects() -> ObjectDictionary:
    return ObjectDictionary([*standard_objects(), Entry(0x2000, 0, "value", "u8", "rw", 9)])


def test_a_node_is_served_once_on_a_bus() -> None:
    url, taken = "can://memory/once?node=5", "^node 5 is served on can://memory/once already: expected another node-ID"

    async def main() -> None:
        async with AsyncCanopenServer(url, device="az3"):
            for _ in range(2):  # one that is refused leaves the claim of the first alone
                with pytest.raises(EncodeError, match=taken):
                    CanopenServer(url, device="az3").start()
                with pytest.raises(EncodeError, match=taken):
                    await AsyncCanopenServer(url, device="az3").start()
        with CanopenServer(url, device="az3"):
            pass

    with CanopenServer(url, device="az3") as first, CanopenServer("can://memory/once?node=6", device="az3"):
        second = CanopenServer(url, device="az3")
        with pytest.raises(EncodeError, match=taken):
            second.start()
        with pytest.raises(PortError, match="serves once"):
            first.start()
        with pytest.raises(EncodeError, match=taken), CanopenServer(url, device="az3"):
            pass
        with CanopenServer("can://memory/another?node=5", device="az3"):
            pass
    with pytest.raises(PortError, match="serves once"):
        first.start()
    asyncio.run(main())


@pytest.mark.parametrize("end", ["close", "stop"])
def test_a_server_that_runs_in_a_thread_of_the_program_ends_while_its_bus_is_gone(end: str) -> None:
    attempts: list[object] = []

    def dial() -> Port[CanFrame]:
        attempts.append(None)
        raise PortError("no such adapter")

    stop = threading.Event()
    server = CanopenServer(f"can://memory/gone-{end}?node=5&reconnect_first=0.001", device="az3")
    port, server.dial = server.port, dial
    thread = threading.Thread(target=server.run, args=(stop,))
    thread.start()
    port.close()  # it fails
    until(lambda: len(attempts) > 2)
    if end == "close":
        server.close()
    else:
        stop.set()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    stop.set()


def test_a_node_of_a_dictionary_an_eds_a_file_a_simulator_or_its_name(tmp_path: Path) -> None:
    file = tmp_path / "node.eds"
    file.write_bytes(EDS)
    url = "can://virtual/server-kinds"
    with CanopenClient(url, timeout=30) as bus:
        with CanopenServer(url, device=objects()):
            assert bus.node(1, eds=objects()).read("value") == 9
        for server in (
            CanopenServer(f"{url}?node=7", device=parse(EDS)),
            CanopenServer(url, eds=file, node=7),
            CanopenServer(url, eds=str(file), node=7),
        ):
            with server:
                node = bus.node(7, eds=file)
                assert (node.read("Device type"), node.read((0x2000, 0))) == (0x191, 8)
                assert [(reading.name, reading.value) for reading in node.read_all([0x2000])] == [("Node", 8)]
        for server in (
            CanopenServer(url, device="az3", node=9),
            CanopenServer(f"{url}?node=9", device=load("az3")),
            CanopenServer(url, device=simulator("az3", node=9)),
            CanopenServer(url, device=simulator("az3", node=9).canopen),
        ):
            with server:
                assert bus.node(9, device="az3")["STATUS WORD"].name == "STATUS WORD"


def test_a_pdo_that_an_eds_leaves_without_a_cob_id_is_switched_off_and_named() -> None:
    pdo = b"""[2001]
ParameterName=Level
DataType=0x0006
AccessType=ro
PDOMapping=1
[1804]
ParameterName=TPDO 5
ObjectType=9
SubNumber=1
[1804sub1]
ParameterName=COB-ID
DataType=0x0007
AccessType=rw
[1A04]
ParameterName=TPDO 5 mapping
ObjectType=9
SubNumber=2
[1A04sub0]
ParameterName=Entries
DataType=0x0005
AccessType=rw
DefaultValue=1
[1A04sub1]
ParameterName=Entry 1
DataType=0x0007
AccessType=rw
DefaultValue=0x20010010
"""
    url = "can://memory/server-cob-id"
    with CanopenServer(url, eds=parse(EDS + pdo), node=7) as server, CanopenClient(url, timeout=30) as bus:
        assert server.refused_pdos == ["TPDO5: COB-ID 000h is restricted [CiA 301], so the PDO cannot be on"]
        assert bus.node(7).sdo.upload(0x1804, 1) == bytes.fromhex("00000080")


def test_read_all_of_a_dictionary_leaves_out_missing_write_only_and_mistyped_objects() -> None:
    value = Entry(0x2000, 0, "value", "u8", "rw", 9)
    served = ObjectDictionary([value, Entry(0x2001, 0, "state", "u8", "ro", 3)])
    state, missing = Entry(0x2001, 0, "state", "u32", "ro"), Entry(0x2002, 0, "missing", "u8")
    described = ObjectDictionary([value, state, missing, Entry(0x2003, 0, "password", "u8", "wo")])

    async def main(url: str) -> None:
        async with AsyncCanopenClient(url, timeout=30) as bus:
            readings = await bus.node(1, eds=described).read_all()
            assert [(reading.name, reading.value) for reading in readings] == [("value", 9)]

    url = "can://virtual/read-all"
    with CanopenServer(url, device=served), CanopenClient(url, timeout=30) as bus:
        node = bus.node(1, eds=described)
        assert [(reading.name, reading.value) for reading in node.read_all()] == [("value", 9)]
        for name, error in (("state", DecodeError), ("missing", SdoAbort)):
            with pytest.raises(error):
                node.read_all(["value", name])
        with pytest.raises(EncodeError, match=r"read_all\('value'\): expected several"):
            node.read_all("value")
        asyncio.run(main(url))


def test_a_node_with_asyncio() -> None:
    async def main() -> None:
        url = "can://virtual/server-asyncio"
        node = LocalNode(5, objects())
        server = AsyncCanopenServer(url, device=node)
        with pytest.raises(PortError, match="not served"):
            await server.do(lambda now: None)
        async with server, AsyncCanopenClient(url, timeout=30) as bus:
            assert server.url == url
            five = bus.node(5, eds=objects())
            await five.write("value", 10)
            assert await five.read("value") == 10
            with five.emergencies() as errors:
                await server.do(lambda now: node.error(0x4210, now))
                event = await errors.get(30.0)
            assert getattr(getattr(event, "message", None), "code", None) == 0x4210

    asyncio.run(main())


@pytest.mark.parametrize("first", ["upload", "receive", "send"])
def test_the_asyncio_client_without_async_with_connects_with_its_first_request(first: str) -> None:
    async def main() -> None:
        url = "can://virtual/server-lazy"
        async with AsyncCanopenServer(url, device=objects()):
            bus = AsyncCanopenClient(url, timeout=30)
            if first == "upload":
                assert await bus.node(1).sdo.upload(0x2000) == b"\x09"
            elif first == "receive":
                assert await bus.receive(0.0) is None
            else:
                await bus.send(CanFrame(0x123))
            await bus.close()
            with pytest.raises(PortError, match="the client was closed"):
                await bus.node(1).sdo.upload(0x2000)

    asyncio.run(main())


def test_an_asyncio_client_that_is_not_connected_has_no_streams() -> None:
    async def main() -> None:
        bus = AsyncCanopenClient("can://virtual/server-no-streams")
        with pytest.raises(PortError, match="not connected: enter `async with`, or await open"):
            bus.frames()
        await bus.open()
        with bus.frames() as frames:
            assert not hasattr(bus, "connect"), frames
        await bus.close()

    asyncio.run(main())


def test_the_asyncio_client_is_connected_by_async_with_and_receives() -> None:
    async def main() -> None:
        url = "can://virtual/server-receive"
        bus = AsyncCanopenClient(url)
        assert repr(bus).startswith(f"<AsyncCanopenClient on {url}")
        async with bus:
            assert await bus.receive(0.0) is None
            with CanopenClient(url) as other:
                other.send(CanFrame(0x123, b"\1"))
            assert await bus.receive(30.0) == CanFrame(0x123, b"\1")
            assert await bus.receive(0.001) is None

    asyncio.run(main())


def test_an_object_that_cannot_be_a_node_is_refused() -> None:
    url = "can://virtual/server-refused"
    with pytest.raises(EncodeError, match="expected device= or eds=, one of them"):
        CanopenServer(url)
    with pytest.raises(EncodeError, match=r"device=5: expected a LocalNode, a simulator or its name"):
        CanopenServer(url, device=5)  # type: ignore[arg-type]
    with pytest.raises(EncodeError, match=r"^csd-mt has no CANopen"):
        CanopenServer(url, device="csd-mt")
    with pytest.raises(EncodeError, match="No such file"):
        CanopenServer(url, eds="missing.eds")
    with pytest.raises(EncodeError, match="CANopen needs can://"):
        CanopenServer("tcp://127.0.0.1", device="az3")


CLASSES: list[type] = [LocalNode, ObjectDictionary, type(simulator("az3"))]


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize("server", [CanopenServer, AsyncCanopenServer])
def test_a_class_is_not_a_device(server: Any, kind: type) -> None:
    name = kind.__name__
    with pytest.raises(EncodeError, match=f"expected an instance, got the class {name}; write {name}\\(...\\)"):
        server("can://virtual/a-class", device=kind)


class Silent:
    """Has `feed`, but no `deadline`."""

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        return []


def test_only_an_instance_with_feed_and_deadline_can_be_hosted() -> None:
    async def main() -> None:
        async with AsyncCanopenClient("can://virtual/hosted") as bus:
            check(bus)

    def check(bus: Any) -> None:
        for call in (bus.host, bus.start):
            with pytest.raises(EncodeError, match="expected an instance, got the class LocalNode"):
                call(LocalNode)
            for wrong in (Silent(), 5, "az3", simulator("az3")):
                with pytest.raises(
                    EncodeError, match="expected a LocalNode, or another machine with feed and deadline"
                ):
                    call(wrong)

    with CanopenClient("can://virtual/hosted") as bus:
        check(bus)
    asyncio.run(main())


def test_a_class_is_not_a_bus() -> None:
    for client in (CanopenClient, AsyncCanopenClient):
        with pytest.raises(EncodeError, match="expected a URL such as"):
            client(CanPort)  # type: ignore[arg-type]
