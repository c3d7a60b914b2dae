"""Wrong arguments of CANopen methods: EncodeError, nothing on the bus, and the next call works."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from barewire import AsyncCanopenClient, AsyncCanopenServer, CanopenClient, CanopenServer
from barewire.canopen import CanFrame, Entry, ObjectDictionary, PdoConfig, RemotePdo
from barewire.devices import load
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.helpers import every_case, refused
from tests.io.canopen.either_client import KINDS, get, run_with
from tests.io.canopen.memory_bus import MemoryPort, device

pytest.importorskip("can")
NAN = float("nan")
INF = float("inf")

RPDO = RemotePdo.of(5, PdoConfig("RPDO", 1, (0x60400010,)))
OBJECTS = ObjectDictionary([Entry(0x2000, 0, "speed", "u16", "rw", 5)])
TEXTS: list[tuple[Callable[[Any], Any], str]] = [
    (lambda c: c.node(eds=OBJECTS).read_all(0x2000), "read_all(8192): expected several objects; one is read(8192)"),
    (lambda c: c.node(eds=OBJECTS).read_all([1.5]), "1.5: expected the name of an object, its index, or (index, sub"),
    (
        lambda c: c.node(eds=OBJECTS).read((0x2000,)),
        "(8192,): expected the name of an object, its index, or (index, su",
    ),
    (lambda c: c.node(eds=OBJECTS).write(None, 5), "None: expected the name of an object, its index, or (index, sub"),
    (lambda c: c.frames(5), "5: expected (identifier, extended), such as (5, False)"),
    (lambda c: c.frames((5, False), "x"), "'x': expected (identifier, extended), such as (0x185, False)"),
    (lambda c: c.frames((0x20000000, True)), "(536870912, True): expected (identifier, extended)"),
    (lambda c: c.emergencies(0x85), "133: expected a mapping of (identifier, extended) to node-ID"),
    (lambda c: c.emergencies({0x85: 5}), "133: expected (identifier, extended), such as (133, False)"),
    (lambda c: c.node(5).emergencies(0x85), "133: expected (identifier, extended), such as (133, False)"),
    (lambda c: c.scan(5), "scan(5): expected several node-IDs; one node is scan([5])"),
    (lambda c: c.scan("5"), "scan('5'): expected several node-IDs"),
    (lambda c: c.scan([5, 128]), "node 128: expected a number in 1..127"),
    (lambda c: c.sync.start("1"), "SYNC period '1' s: expected a number of seconds above 0"),
    (lambda c: c.sync.start(True), "SYNC period True s: expected a number of seconds above 0"),
    (lambda c: c.sync.start(1, overflow="1"), "SYNC counter overflow '1': expected 0 or 2..240"),
    (lambda c: c.sync.start(1, key=0x80), "128: expected (identifier, extended), such as (128, False)"),
    (lambda c: c.sync.send("1"), "SYNC counter '1': expected 1..240"),
    (lambda c: c.sync.events("1"), "SYNC period '1' s: expected a number of seconds above 0"),
    (lambda c: c.time.start("1"), "TIME period '1' s: expected a number of seconds above 0"),
    (lambda c: c.time.send("1"), "'1' s is not a time of day: expected a finite number of seconds"),
    (lambda c: c.scan([5.5]), "node 5.5: expected a number in 1..127"),
    (lambda c: c.send("185#00"), "'185#00': expected a CanFrame, such as CanFrame.parse('185#0000')"),
    (lambda c: c.nmt.heartbeats(5), "5: expected a mapping of node-ID to seconds, such as {5: 1.5}"),
    (lambda c: c.nmt.heartbeats({5: "1"}), "heartbeat time '1' s of node 5: expected more than 0"),
    (lambda c: c.node(5).nmt.heartbeats("1"), "heartbeat time '1' s of node 5: expected more than 0"),
    (lambda c: c.nmt.send_confirmed(1, confirmed_by=5), "confirmed_by = 5: expected several node-IDs, such as [5]"),
    (lambda c: c.node(5).nmt.wait_for_state(77), "state 77: expected one of NmtState.INITIALISING, "),
    (lambda c: c.node(5).nmt.wait_for_state("operational"), "state 'operational': expected one of NmtState."),
    (lambda c: c.node(5).nmt.wait_for_state(), "no state: expected a state, such as NmtState.OPERATIONAL"),
    (lambda c: c.lss.assign_node_ids(5), "nodes = 5: expected several node-IDs, such as [5]"),
    (lambda c: c.pdos(3), "3: expected a RemotePdo, such as node.pdo.remote"),
    (lambda c: c.node(5).pdo.receive("TPDO"), "'TPDO': expected a RemotePdo, such as node.pdo.remote"),
    (lambda c: c.node(5).pdo.send("RPDO", {}), "'RPDO': expected a RemotePdo, such as node.pdo.remote"),
    (lambda c: c.node(5).pdo.send(RPDO, 5), "5: expected a mapping of names to values"),
    (lambda c: c.node(5).pdo.write_config(3), "3: expected a PdoConfig"),
    (lambda c: c.node(5).sdo.upload_to(0x2100, 0, None), "upload_to: sink = None: expected a function"),
    (lambda c: c.node(5).sdo.upload(0x2100, progress=3), "upload: progress = 3: expected a function"),
    (lambda c: c.run(3), "3: expected a conversation, such as upload(5, 0x1000)"),
    (lambda c: c.watch(3), "3: expected a machine with feed and deadline"),
    (
        lambda c: c.node(device="az3").read(0x6041),
        "24641 is not the name of a parameter of az3; by index it is node.sdo.up",
    ),
    (lambda c: c.node(device="az3").write({5: 1}), "5 is not the name"),
    (lambda c: c.node(device="az3").write("STATUS WORD"), "write('STATUS WORD'): expected a value"),
    (lambda c: c.node(device="az3").read(), "read(): expected a name"),
    (lambda c: c.node(device="az3").read_all("STATUS WORD"), "read_all('STATUS WORD'): expected several"),
    (lambda c: c.node(eds=OBJECTS).read("pressure"), "'pressure'"),
    (lambda c: c.node().sdo.read_object(load("az3"), "DC BUS"), "is not an ObjectDictionary; a described"),
    (lambda c: c.node().sdo.download(0x60FF, 0, 1500), "1500 is not bytes: "),
    (lambda c: c.node().sdo.download(0x60FF, 0, 1500), " (1500).to_bytes"),
    (lambda c: c.node().nmt.send_confirmed("start"), "NMT command 'start': expected one of NmtCommand.START"),
    (lambda c: c.node(128), "node 128: expected a number in 1..127"),
    (lambda c: c.node("5"), "node '5': expected a number"),
    (lambda c: c.node(5, device="az3", eds=OBJECTS), "device= or eds=, not both"),
    (lambda c: c.node(5, device="csd-mt"), "csd-mt has no CANopen"),
    (lambda c: c.node(5, eds="missing.eds"), "eds 'missing.eds': No such file"),
    (lambda c: c.node(5, dialect="french"), "SDO dialect 'french': expected one of"),
]

CASES: dict[str, Callable[[Any], Any]] = {
    "upload, nan": lambda c: c.node().sdo.upload(0x1000, timeout=NAN),
    "upload, inf": lambda c: c.node().sdo.upload(0x1000, timeout=INF),
    "object, inf": lambda c: c.node(eds=OBJECTS).read(0x2000, timeout=INF),
    "upload, below 0": lambda c: c.node().sdo.upload(0x1000, timeout=-1),
    "client, nan": lambda c: c.node(timeout=NAN).sdo.upload(0x1000),
    "client, inf": lambda c: c.node(timeout=INF).sdo.upload(0x1000),
    "another channel, nan": lambda c: c.node().sdo.find_channel(2, timeout=NAN),
    "scan, nan": lambda c: c.scan([5], timeout=NAN),
    "scan, inf": lambda c: c.scan([5], timeout=INF),
    "heartbeat, nan": lambda c: c.node().nmt.wait_for_heartbeat(timeout=NAN),
    "NMT, nan": lambda c: c.node().nmt.send_confirmed(1, timeout=NAN),
    "fastscan, nan": lambda c: c.lss.fastscan(timeout=NAN),
    "stream, nan": lambda c: c.frames((1, False)).get(NAN),
    "PDO, inf": lambda c: c.node().pdo.read_config("TPDO", 1, timeout=INF),
    "PDO, nan": lambda c: c.node().pdo.read_config("TPDO", 1, timeout=NAN),
    "time, nan": lambda c: c.time.send(NAN),
    "time, inf": lambda c: c.time.send(INF),
    "SYNC period, nan": lambda c: c.sync.start(NAN),
    "SYNC identifier": lambda c: c.sync.send(key=(0x800, False)),
    "frame identifier": lambda c: c.send(CanFrame(0x800)),
    "frame too long": lambda c: c.send(CanFrame(0x100, bytes(9))),
    "block": lambda c: c.node().sdo.upload(0x2100, block="yes"),
    "text": lambda c: c.node().sdo.download(0x2100, 0, "text"),
    "no PDO before the first": lambda c: c.node().pdo.read_config("TPDO", 0),
    "no PDO behind the last": lambda c: c.node().pdo.read_config("RPDO", 513),
    "no such direction": lambda c: c.node().pdo.read_config("XPDO", 1),
    "a mapping is not a PDO": lambda c: c.node().pdo.write_config(PdoConfig("TPDO", 513, ())),
    "node 0": lambda c: c.node(0).sdo.upload(0x1000),
    **{f"text {number}": case for number, (case, _) in enumerate(TEXTS)},
}


@pytest.mark.parametrize("case", CASES)
@KINDS
def test_a_wrong_argument_raises_encode_error_and_sends_nothing(kind: str, case: str) -> None:
    port = MemoryPort()

    async def calls(client: Any) -> None:
        with client.host(device(6)):
            await get(client.node().sdo.upload(0x1000))
            port.sent.clear()
            with pytest.raises(EncodeError):
                await get(CASES[case](client))
            assert not port.sent
            assert await get(client.node().sdo.upload(0x6041)) == b"\x37\x06"

    with CanBus(port) as bus:
        run_with(calls, kind, bus, node=6, timeout=30.0)


@KINDS
def test_a_wait_for_what_comes_by_itself_may_be_endless(kind: str) -> None:
    async def calls(client: Any) -> None:
        with client.frames() as stream:
            await get(client.send(CanFrame(0x185, b"\x01")))
            assert await get(stream.get(INF)) == CanFrame(0x185, b"\x01")

    with CanBus(MemoryPort()) as bus:
        run_with(calls, kind, bus, node=6)


def test_an_object_that_is_not_a_port_is_refused() -> None:
    for wrong in (None, "can://memory/x", CanBus):
        with pytest.raises(EncodeError, match=r": expected a port, such as can_port returns; CanBus.open takes a URL$"):
            CanBus(wrong)  # type: ignore[arg-type]


@KINDS
def test_a_port_of_the_application_whose_send_fails_is_a_port_error_with_its_cause(kind: str) -> None:
    cause = OSError(5, "input/output error")

    class Broken(MemoryPort):
        name = "mine"

        def send(self, item: CanFrame) -> None:
            raise cause

    async def calls(client: Any) -> None:
        await get(client.node().sdo.upload(0x1000))

    with pytest.raises(PortError, match=r"^mine: input/output error$") as caught:
        run_with(calls, kind, Broken(), node=6)
    assert caught.value.__cause__ is cause


def test_a_wrong_time_out_of_a_client_is_refused() -> None:
    with CanBus(MemoryPort()) as bus:
        for wrong in (NAN, -1.0, INF):
            with pytest.raises(EncodeError, match="expected 0 or more"):
                CanopenClient(bus, timeout=wrong)
        with CanopenClient(bus) as client, pytest.raises(EncodeError):
            client.receive(NAN)


@every_case(("case", "text"), TEXTS)
def test_the_error_of_a_wrong_argument_says_what_was_expected(case: Callable[[Any], Any], text: str) -> None:
    with CanBus(MemoryPort()) as bus, CanopenClient(bus, node=6, timeout=30.0) as client, refused(EncodeError, text):
        case(client)


def test_a_name_that_is_not_known_or_has_no_description() -> None:
    with CanBus(MemoryPort()) as bus, CanopenClient(bus, node=5) as client:
        node = client.node()
        with pytest.raises(LookupError, match="'STATUS WRD'; did you mean 'STATUS WORD'"):
            client.node(device="az3").read("STATUS WRD")
        with pytest.raises(AttributeError, match=r"'read' needs names: bus.node\(5, device=...\)"):
            node.read("STATUS WORD")  # type: ignore[attr-defined]
        with pytest.raises(AttributeError, match=r"'drive' needs names: bus.node\(5, device=...\)$"):
            node.drive  # type: ignore[attr-defined]  # noqa: B018


# URLs, options, and clients that are closed ---------------------------------------------------------------------------


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
