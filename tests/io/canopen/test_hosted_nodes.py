"""Local nodes on a bus: `do`, reports of the controller, and which nodes may run there."""

from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import Callable
from typing import Any

import pytest

from barewire import AsyncCanopenClient, CanopenClient, CanopenServer
from barewire.canopen import (
    CanFrame,
    Entry,
    ErrorFrame,
    HeartbeatProducer,
    LocalNode,
    NmtCommand,
    NmtState,
    NodeGroup,
    ObjectDictionary,
    PdoConfig,
)
from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.emcy import EmcyEvent
from barewire.devices.sim import simulator
from barewire.errors import EncodeError
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.helpers import PATIENCE
from tests.io.canopen.either_client import KINDS, get, run_with
from tests.io.canopen.memory_bus import MemoryPort, device

pytest.importorskip("can")
BUS_OFF, RESTARTED = ErrorFrame(0x40, bytes(8)), ErrorFrame(0x100, bytes(8))


def thermometer() -> LocalNode:
    """A node without heartbeat, which sends only when its value changes."""
    objects = ObjectDictionary([*standard_objects(), Entry(0x6000, 0, "temperature", "i16", "ro", 215)])
    return LocalNode(5, objects, [PdoConfig("TPDO", 1, (0x60000010,))])


def test_do_on_a_served_node_sends_frames_at_once() -> None:
    node = thermometer()
    url = "can://virtual/outside"
    with CanopenServer(url, device=node) as host, CanopenClient(url, node=5) as client:
        client.node().nmt.send_confirmed(NmtCommand.START, ask_every=0.05)
        pdo = client.node().pdo.remote("TPDO", 1, objects=node.objects)
        with client.emergencies() as wrong, client.pdos(pdo) as values:
            host.do(lambda now: node.error(0x4210, now))
            reported = wrong.get(timeout=PATIENCE)
            assert isinstance(reported, EmcyEvent)
            assert reported.message.code == 0x4210
            host.do(lambda now: node.objects.set(0x6000, 0, 216))
            received = values.get(timeout=PATIENCE)
            assert getattr(received, "values", None) == {"temperature": 216}
            node.objects["temperature"] = 217  # takes effect a little later
            received = values.get(timeout=PATIENCE)
            assert getattr(received, "values", None) == {"temperature": 217}


@KINDS
def test_do_on_a_node_hosted_by_a_client_sends_frames_at_once(kind: str) -> None:
    node = thermometer()
    url = f"can://virtual/hosted-{kind}?node=5"

    async def calls(client: Any) -> None:
        with client.host(node) as running, CanopenClient(url) as other:
            await get(client.node().nmt.send_confirmed(NmtCommand.START, ask_every=0.05))
            pdo = await get(client.node().pdo.remote("TPDO", 1, objects=node.objects))
            with client.pdos(pdo) as values, other.emergencies() as wrong:
                await get(running.do(lambda now: node.objects.set(0x6000, 0, 216)))
                assert getattr(await get(values.get(timeout=PATIENCE)), "values", None) == {"temperature": 216}
                node.objects["temperature"] = 217
                assert getattr(await get(values.get(timeout=PATIENCE)), "values", None) == {"temperature": 217}
                await get(running.do(lambda now: node.error(0x4210, now)))
                assert wrong.get(timeout=PATIENCE) is not None

    run_with(calls, kind, url)


def test_a_served_node_that_was_bus_off_follows_1029h_and_sends_8140h() -> None:
    node, port = device(), MemoryPort()
    host = CanopenServer("can://virtual/off", device=node)
    host.port.close()
    host.port = port
    with host:
        port.deliver(CanFrame.parse("000#0105"), BUS_OFF)
        wait(lambda: host.statistics.others == 1)
        wait(lambda: node.state is NmtState.PRE_OPERATIONAL)  # 1029h is 0
        port.deliver(RESTARTED)
        wait(lambda: "085#0000000000000000" in map(str, port.sent))
    assert [str(frame) for frame in port.sent] == ["705#00", "085#4081110000000000", "085#0000000000000000"]
    assert host.statistics.others == 2


def wait(condition: Callable[[], bool]) -> None:
    """Wait until the condition holds."""
    pause = threading.Event()
    for _ in range(3000):
        if condition():
            return
        pause.wait(0.01)
    raise AssertionError("the condition did not become true")


class Held:
    """A machine that holds its thread at each frame until it is let go."""

    deadline = None

    def __init__(self) -> None:
        self.fed = 0
        self.holds, self.goes_on = threading.Event(), threading.Event()

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        if frame is not None:
            self.fed += 1
            self.holds.set()
            assert self.goes_on.wait(PATIENCE)
        return []


def test_a_closed_client_ends_all_its_nodes_at_once_and_drops_what_they_have_not_taken() -> None:
    """Else 127 nodes, each with thousands of frames in its queue, would take minutes to close, one after the other."""
    port, machines = MemoryPort(), [Held() for _ in range(4)]
    with CanBus(port) as bus:
        client = CanopenClient(bus)
        tasks = [client.host(machine) for machine in machines]
        port.deliver(*[CanFrame(0x80)] * 9)
        assert all(machine.holds.wait(PATIENCE) for machine in machines)
        closing = threading.Thread(target=client.close)
        closing.start()  # it waits for the thread of one of them
        wait(lambda: all(task._is_ending for task in tasks))
        for machine in machines:
            machine.goes_on.set()
        closing.join(PATIENCE)
    assert [machine.fed for machine in machines] == [1, 1, 1, 1]


def test_a_second_device_with_the_same_node_id_on_a_bus_is_refused() -> None:
    with CanBus(MemoryPort()) as bus, CanopenClient(bus) as client, CanopenClient(bus) as other:
        taken = r"^node 5 runs on memory already: expected another node-ID, or stop the other one first$"
        az3 = simulator("az3", 0.0, node=5).canopen
        with client.host(device(5)), client.host(device(6)), client.host(device(None)), client.host(device(None)):
            client.start(HeartbeatProducer(5)).stop()
            for second in (device(5), NodeGroup([device(7), device(5)]), az3):
                with pytest.raises(EncodeError, match=taken):
                    other.host(second)
        other.host(az3).stop()

        async def main() -> None:
            async with AsyncCanopenClient(bus) as third:
                with third.host(device(5)), pytest.raises(EncodeError, match=taken):
                    third.host(device(5))
                with third.host(device(5)):
                    pass

        asyncio.run(main())


def test_a_node_in_the_url_must_be_that_of_the_device() -> None:
    for node in (device(7), simulator("az3").canopen):
        with pytest.raises(EncodeError, match=r"node 5 is requested, the device is node (7|1)"):
            CanopenServer("can://virtual/other?node=5", device=node)
    CanopenServer("can://virtual/other?node=7", device=device(7)).close()
    CanopenServer("can://virtual/other?node=7", device=device(None)).close()


def test_methods_have_the_name_and_the_parameters_of_their_definition() -> None:
    with CanBus(MemoryPort()) as bus:
        client = CanopenClient(bus, node=5)
        node = client.node()
        assert repr(client) == "<CanopenClient on memory, node 5>"
        firsts: list[tuple[Callable[..., object], str]] = [
            (node.sdo.upload, "index"),
            (client.nmt.heartbeats, "times"),
            (client.sync.start, "period"),
        ]
        for method, first in firsts:
            assert next(iter(inspect.signature(method).parameters)) == first
            assert method.__doc__
        assert node.pdo.write_config.__name__ == "write_config"
        assert "progress" in inspect.signature(client.lss.fastscan).parameters
        assert client.lss.fastscan.__name__ == "fastscan"
