"""What is done with a device that lives on a bus from outside of it, and what the controller reports to it."""

from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import Callable

import pytest

from barewire.canopen import CanFrame, Entry, ErrorFrame, LocalNode, NmtCommand, NmtState, ObjectDictionary, PdoConfig
from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.emcy.consumer import EmcyEvent
from barewire.devices import load
from barewire.devices.sim import simulator
from barewire.errors import EncodeError
from barewire.io import open_can_host, open_canopen, open_canopen_async
from barewire.io.canopen.client import CanopenClient
from barewire.io.canopen.shared_bus import CanBus
from barewire.io.server.can import CanHost
from tests.io.canopen.memory_bus import MemoryPort, device

pytest.importorskip("can")
BUS_OFF, RESTARTED = ErrorFrame(0x40, bytes(8)), ErrorFrame(0x100, bytes(8))
PATIENCE = 30.0


def thermometer() -> LocalNode:
    """It has no heartbeat: nothing brings it to speak but its value."""
    objects = ObjectDictionary([*standard_objects(), Entry(0x6000, 0, "temperature", "i16", "ro", 215)])
    return LocalNode(5, objects, [PdoConfig("TPDO", 1, (0x60000010,))])


def test_a_hosted_device_says_at_once_what_was_done_with_it() -> None:
    node = thermometer()
    with (
        open_can_host("can://virtual/outside", node=node) as host,
        open_canopen("can://virtual/outside?node=5") as client,
    ):
        assert isinstance(host, CanHost)
        client.tell_nmt(NmtCommand.START, ask_every=0.05)
        pdo = client.remote_pdo("TPDO", 1, objects=node.objects)
        with client.emergencies() as wrong, client.pdos(pdo) as values:
            host.do(lambda now: node.error(0x4210, now))
            told = wrong.get(timeout=PATIENCE)
            assert isinstance(told, EmcyEvent)
            assert told.message.code == 0x4210
            host.do(lambda now: node.objects.set(0x6000, 0, 216))
            heard = values.get(timeout=PATIENCE)
            assert getattr(heard, "values", None) == {"temperature": 216}
            node.objects["temperature"] = 217  # seen by itself, a little later
            heard = values.get(timeout=PATIENCE)
            assert getattr(heard, "values", None) == {"temperature": 217}


def test_so_does_one_that_lives_with_a_client() -> None:
    node = thermometer()
    url = "can://virtual/with?node=5"
    with open_canopen(url) as other, open_canopen(url) as client, client.host(node) as running:
        other.tell_nmt(NmtCommand.START, ask_every=0.05)
        with other.pdos(other.remote_pdo("TPDO", 1, objects=node.objects)) as values, other.emergencies() as wrong:
            running.do(lambda now: node.objects.set(0x6000, 0, 216))
            assert getattr(values.get(timeout=PATIENCE), "values", None) == {"temperature": 216}
            node.objects["temperature"] = 217
            assert getattr(values.get(timeout=PATIENCE), "values", None) == {"temperature": 217}
            running.do(lambda now: node.error(0x4210, now))
            assert wrong.get(timeout=PATIENCE) is not None


def test_and_with_asyncio() -> None:
    async def main() -> None:
        node = thermometer()
        async with await open_canopen_async("can://virtual/task?node=5") as client:
            with client.host(node) as running:
                await client.tell_nmt(NmtCommand.START, ask_every=0.05)
                with client.pdos(await client.remote_pdo("TPDO", 1, objects=node.objects)) as values:
                    await running.do(lambda now: node.objects.set(0x6000, 0, 216))
                    assert getattr(await values.get(timeout=PATIENCE), "values", None) == {"temperature": 216}
                    node.objects["temperature"] = 217
                    assert getattr(await values.get(timeout=PATIENCE), "values", None) == {"temperature": 217}

    asyncio.run(main())


def test_a_hosted_device_that_was_bus_off_obeys_1029h_and_says_that_it_is_back() -> None:
    node, port = device(), MemoryPort()
    host = open_can_host("can://virtual/off", node=node)
    assert isinstance(host, CanHost)
    host.port.close()
    host.port = port
    with host:
        port.come(CanFrame.parse("000#0105"), BUS_OFF)
        wait(lambda: host.others == 1)
        wait(lambda: node.state is NmtState.PRE_OPERATIONAL)  # 1029h is 0
        port.come(RESTARTED)
        wait(lambda: "085#0000000000000000" in map(str, port.sent))
    assert [str(frame) for frame in port.sent] == ["705#00", "085#4081110000000000", "085#0000000000000000"]
    assert host.others == 2


def wait(condition: Callable[[], bool]) -> None:
    """Until it holds."""
    pause = threading.Event()
    for _ in range(3000):
        if condition():
            return
        pause.wait(0.01)
    raise AssertionError("it did not come about")


def test_the_url_of_a_host_names_no_other_node() -> None:
    for node in (device(7), simulator("az3").canopen):
        with pytest.raises(EncodeError, match=r"node 5 is asked for, and the device is node (7|1)"):
            open_can_host("can://virtual/other?node=5", node=node)
    open_can_host("can://virtual/other?node=7", node=device(7)).close()
    open_can_host("can://virtual/other?node=7", node=device(None)).close()


def test_what_a_word_is_given_by_mistake_is_told() -> None:
    az3, objects = load("az3"), thermometer().objects
    with CanopenClient(CanBus(MemoryPort()), node=5) as client:
        mistakes: dict[str, Callable[[], object]] = {
            "no description of a device; with a dictionary": lambda: client.read(objects, "temperature"),  # type: ignore[arg-type]
            "24641 is no name; by index it is `upload`": lambda: client.read(az3, 0x6041),  # type: ignore[arg-type]
            "5 is no name": lambda: client.write(az3, {5: 1}),  # type: ignore[dict-item]
            "is no ObjectDictionary; a described": lambda: client.read_object(az3, "STATUS WORD"),  # type: ignore[arg-type]
            r"1500 is not bytes: .* \(1500\).to_bytes": lambda: client.download(0x60FF, 0, 1500),  # type: ignore[arg-type]
            "NMT command 'start': expected one of NmtCommand.START": lambda: client.tell_nmt("start"),  # type: ignore[arg-type]
        }
        for text, mistake in mistakes.items():
            with pytest.raises(EncodeError, match=text):
                mistake()
        client.bus.close()


def test_help_tells_the_name_and_the_parameters_of_a_word() -> None:
    with CanBus(MemoryPort()) as bus:
        client = CanopenClient(bus, node=5)
        assert repr(client) == "<CanopenClient on memory, node 5>"
        for word, first in ((client.upload, "index"), (client.heartbeats, "times"), (client.start_sync, "period")):
            assert next(iter(inspect.signature(word).parameters)) == first
            assert word.__doc__
        assert client.write_pdo.__name__ == "write_pdo"
        assert "progress" in inspect.signature(client.fastscan).parameters
        assert client.fastscan.__name__ == "fastscan"
