"""Wrong arguments of CANopen methods: EncodeError, nothing on the bus, and the next call works."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from barewire import CanopenClient
from barewire.canopen import CanFrame, Entry, ObjectDictionary, PdoConfig, RemotePdo
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.helpers import refused
from tests.io.canopen.memory_bus import MemoryPort, device

NAN = float("nan")

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
]

CASES: dict[str, Callable[[Any], Any]] = {
    "upload, nan": lambda c: c.node().sdo.upload(0x1000, timeout=NAN),
    "upload, below 0": lambda c: c.node().sdo.upload(0x1000, timeout=-1),
    "client, nan": lambda c: c.node(timeout=NAN).sdo.upload(0x1000),
    "another channel, nan": lambda c: c.node().sdo.find_channel(2, timeout=NAN),
    "scan, nan": lambda c: c.scan([5], timeout=NAN),
    "heartbeat, nan": lambda c: c.node().nmt.wait_for_heartbeat(timeout=NAN),
    "NMT, nan": lambda c: c.node().nmt.send_confirmed(1, timeout=NAN),
    "fastscan, nan": lambda c: c.lss.fastscan(timeout=NAN),
    "stream, nan": lambda c: c.frames((1, False)).get(NAN),
    "PDO, nan": lambda c: c.node().pdo.read_config("TPDO", 1, timeout=NAN),
    "time, nan": lambda c: c.time.send(NAN),
    "time, inf": lambda c: c.time.send(float("inf")),
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
@pytest.mark.parametrize("kind", ["blocking", "asyncio"])
def test_a_wrong_argument_raises_encode_error_and_sends_nothing(kind: str, case: str) -> None:
    port = MemoryPort()

    def blocking(bus: CanBus) -> None:
        with CanopenClient(bus, node=6, timeout=30.0) as client, client.host(device(6)):
            client.node().sdo.upload(0x1000)
            port.sent.clear()
            with pytest.raises(EncodeError):
                CASES[case](client)
            assert not port.sent
            assert client.node().sdo.upload(0x6041) == b"\x37\x06"

    async def with_asyncio(bus: CanBus) -> None:
        async with AsyncCanopenClient(bus, node=6, timeout=30.0) as client:
            with client.host(device(6)):
                await client.node().sdo.upload(0x1000)
                port.sent.clear()
                with pytest.raises(EncodeError):
                    await CASES[case](client)
                assert not port.sent
                assert await client.node().sdo.upload(0x6041) == b"\x37\x06"

    with CanBus(port) as bus:
        if kind == "blocking":
            blocking(bus)
        else:
            asyncio.run(with_asyncio(bus))


def test_an_object_that_is_not_a_port_is_refused() -> None:
    for wrong in (None, "can://memory/x", CanBus):
        with pytest.raises(EncodeError, match=r": expected a port, such as can_port returns; CanBus.open takes a URL$"):
            CanBus(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["blocking", "asyncio"])
def test_a_port_of_the_application_whose_send_fails_is_a_port_error_with_its_cause(kind: str) -> None:
    cause = OSError(5, "input/output error")

    class Broken(MemoryPort):
        name = "mine"

        def send(self, item: CanFrame) -> None:
            raise cause

    async def with_asyncio() -> None:
        async with AsyncCanopenClient(Broken(), node=6) as client:
            await client.node().sdo.upload(0x1000)

    def blocking() -> None:
        with CanopenClient(Broken(), node=6) as client:
            client.node().sdo.upload(0x1000)

    with pytest.raises(PortError, match=r"^mine: input/output error$") as caught:
        blocking() if kind == "blocking" else asyncio.run(with_asyncio())
    assert caught.value.__cause__ is cause


def test_a_wrong_time_out_of_a_client_is_refused() -> None:
    with CanBus(MemoryPort()) as bus:
        for wrong in (NAN, -1.0):
            with pytest.raises(EncodeError, match="expected 0 or more"):
                CanopenClient(bus, timeout=wrong)
        with CanopenClient(bus) as client, pytest.raises(EncodeError):
            client.receive(NAN)


@pytest.mark.parametrize(("case", "text"), TEXTS, ids=[text for _, text in TEXTS])
def test_the_error_of_a_wrong_argument_says_what_was_expected(case: Callable[[Any], Any], text: str) -> None:
    with CanBus(MemoryPort()) as bus, CanopenClient(bus, node=6, timeout=30.0) as client, refused(EncodeError, text):
        case(client)
