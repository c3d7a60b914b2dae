"""Local nodes on a bus: `do`, reports of the controller; wrong arguments of clients and nodes."""

from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import Callable
from typing import Any

import pytest

from barewire import AsyncCanopenClient, AsyncCanopenServer, CanopenClient, CanopenServer
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
from barewire.devices import load
from barewire.devices.sim import simulator
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.helpers import refused
from tests.io.canopen.memory_bus import MemoryPort, device

pytest.importorskip("can")
BUS_OFF, RESTARTED = ErrorFrame(0x40, bytes(8)), ErrorFrame(0x100, bytes(8))
PATIENCE = 30.0


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


def test_do_on_a_node_hosted_by_a_client_sends_frames_at_once() -> None:
    node = thermometer()
    url = "can://virtual/with?node=5"
    with CanopenClient(url) as other, CanopenClient(url) as client, client.host(node) as running:
        other.node().nmt.send_confirmed(NmtCommand.START, ask_every=0.05)
        pdo = other.node().pdo.remote("TPDO", 1, objects=node.objects)
        with other.pdos(pdo) as values, other.emergencies() as wrong:
            running.do(lambda now: node.objects.set(0x6000, 0, 216))
            assert getattr(values.get(timeout=PATIENCE), "values", None) == {"temperature": 216}
            node.objects["temperature"] = 217
            assert getattr(values.get(timeout=PATIENCE), "values", None) == {"temperature": 217}
            running.do(lambda now: node.error(0x4210, now))
            assert wrong.get(timeout=PATIENCE) is not None


def test_do_on_a_node_hosted_by_an_asyncio_client_sends_frames_at_once() -> None:
    async def main() -> None:
        node = thermometer()
        async with AsyncCanopenClient("can://virtual/task?node=5") as client:
            with client.host(node) as running:
                await client.node().nmt.send_confirmed(NmtCommand.START, ask_every=0.05)
                with client.pdos(await client.node().pdo.remote("TPDO", 1, objects=node.objects)) as values:
                    await running.do(lambda now: node.objects.set(0x6000, 0, 216))
                    assert getattr(await values.get(timeout=PATIENCE), "values", None) == {"temperature": 216}
                    node.objects["temperature"] = 217
                    assert getattr(await values.get(timeout=PATIENCE), "values", None) == {"temperature": 217}

    asyncio.run(main())


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


def test_wrong_arguments_give_an_error_that_names_the_right_method() -> None:
    az3, objects = load("az3"), thermometer().objects
    with CanopenClient(CanBus(MemoryPort()), node=5) as client:
        node, described, by_eds = client.node(), client.node(device="az3"), client.node(eds=objects)
        mistakes: dict[str, Callable[[], object]] = {
            "24641 is not the name of a parameter of az3; by index it is node.sdo.upload": lambda: described.read(
                0x6041
            ),  # type: ignore[call-overload]
            "5 is not the name": lambda: described.write({5: 1}),  # type: ignore[dict-item]
            r"write\('STATUS WORD'\): expected a value": lambda: described.write("STATUS WORD"),  # type: ignore[call-overload]
            r"read\(\): expected a name": lambda: described.read(),  # type: ignore[call-overload]
            r"read_all\('STATUS WORD'\): expected several": lambda: described.read_all("STATUS WORD"),
            "'pressure'": lambda: by_eds.read("pressure"),
            "is not an ObjectDictionary; a described": lambda: node.sdo.read_object(az3, "STATUS WORD"),  # type: ignore[arg-type]
            r"1500 is not bytes: .* \(1500\).to_bytes": lambda: node.sdo.download(0x60FF, 0, 1500),  # type: ignore[arg-type]
            "NMT command 'start': expected one of NmtCommand.START": lambda: node.nmt.send_confirmed("start"),  # type: ignore[arg-type]
            "node 128: expected a number in 1..127": lambda: client.node(128),
            "node '5': expected a number": lambda: client.node("5"),  # type: ignore[call-overload]
            "device= or eds=, not both": lambda: client.node(5, device="az3", eds=objects),  # type: ignore[call-overload]
            "csd-mt has no CANopen": lambda: client.node(5, device="csd-mt"),
            "eds 'missing.eds': No such file": lambda: client.node(5, eds="missing.eds"),
            "SDO dialect 'french': expected one of": lambda: client.node(5, dialect="french"),
        }
        for text, mistake in mistakes.items():
            with pytest.raises(EncodeError, match=text):
                mistake()
        with pytest.raises(LookupError, match="'STATUS WRD'; did you mean 'STATUS WORD'"):
            described.read("STATUS WRD")
        with pytest.raises(AttributeError, match=r"'read' needs names: bus.node\(5, device=...\)"):
            node.read("STATUS WORD")  # type: ignore[attr-defined]
        with pytest.raises(AttributeError, match=r"'drive' needs names: bus.node\(5, device=...\)$"):
            node.drive  # type: ignore[attr-defined]  # noqa: B018
        client.bus.close()


def test_a_client_refuses_wrong_urls_and_options() -> None:
    kinds: list[Callable[..., object]] = [CanopenClient, AsyncCanopenClient]
    mistakes: dict[str, tuple[object, dict[str, object]]] = {
        "CANopen needs can://INTERFACE/CHANNEL": ("tcp://127.0.0.1", {}),
        "node 200: expected 1..127": ("can://virtual/x?node=200", {}),
        "node 0: expected 1..127": ("can://virtual/x", {"node": 0}),
        "timeout='-1'": ("can://virtual/x", {"timeout": -1}),
        "SDO dialect 'french': expected one of": ("can://virtual/x?dialect=french", {}),
        "5: expected a URL such as": (5, {}),
        "bitrate: an option of a bus that is opened by its URL": (MemoryPort(), {"bitrate": 5}),
    }
    for kind in kinds:
        for text, (bus, options) in mistakes.items():
            with pytest.raises(EncodeError, match=text):
                kind(bus, **options)


def test_an_option_that_the_interface_does_not_have_is_refused() -> None:
    wrong: list[dict[str, Any]] = [{"timout": 3}, {"speed": 500_000}]
    for option in wrong:
        for client in (CanopenClient, AsyncCanopenClient):
            with pytest.raises(EncodeError, match=r"unknown option '(timout|speed)', expected bitrate, "):
                client("can://virtual/options", **option)
    for server in (CanopenServer, AsyncCanopenServer):
        with refused(
            EncodeError, "endpoint 'can://virtual/options?timout=3': unknown option 'timout', expected bitrate, "
        ):
            server("can://virtual/options", device=device(), timout=3)
    with pytest.raises(EncodeError, match="unknown option 'timout'"):
        CanopenServer("can://virtual/options?timout=3", device=device())
    CanopenClient("can://virtual/options", rx_queue_size=5, timeout=3).close()


def test_an_unknown_option_suggests_the_nearest() -> None:
    for url, suggestion in {
        "can://virtual/x?timout=3": "; did you mean 'timeout'",
        "can://virtual/x?unit=3": "; did you mean 'node'",
        "can://virtual/x?baudrate=9600": "; did you mean 'bitrate'",
        "can://udp_multicast/239.74.163.2?prt=3": "; did you mean 'port'",
    }.items():
        with refused(EncodeError, f"endpoint '{url}") as caught:
            CanopenClient(url)
        assert suggestion in str(caught.value)


def test_an_unknown_interface_is_refused_with_the_known_ones() -> None:
    text = "endpoint 'can://udpmulticast/x.*': unknown interface 'udpmulticast', expected "
    with pytest.raises(EncodeError, match=text) as caught:
        CanopenClient("can://udpmulticast/x")
    assert "slcan, socketcan, socketcand" in str(caught.value)
    assert "; did you mean 'udp_multicast'" in str(caught.value)


def test_a_missing_serial_device_of_slcan_is_reported_once() -> None:
    with pytest.raises(PortError, match=r"^can://slcan/dev/tty-nowhere: no such file or directory$"):
        CanopenClient("can://slcan/dev/tty-nowhere")


def test_a_closed_client_refuses_every_call() -> None:
    closed = "the client was closed"
    with CanBus(MemoryPort()) as bus:
        client = CanopenClient(bus)
        client.close()
        calls: list[Callable[[], object]] = [
            lambda: client.node(5),
            client.__enter__,
            lambda: client.send(CanFrame(0x80)),
            client.frames,
            lambda: client.host(device()),
            lambda: client.receive(0.01),
        ]
        for call in calls:
            with pytest.raises(PortError, match=closed):
                call()
        client.close()
        CanopenClient(bus).node(5)  # the bus itself is open

    async def main() -> None:
        waiting = AsyncCanopenClient("can://virtual/closed")
        await waiting.close()
        with pytest.raises(PortError, match=closed):
            waiting.node(5)
        with pytest.raises(PortError, match=closed):
            await waiting.__aenter__()
        with pytest.raises(PortError, match=closed):
            await waiting.receive(0.01)

    asyncio.run(main())


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
