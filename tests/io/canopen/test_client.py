"""Every method of the CANopen clients, called blocking and with asyncio.

The bus is python-can's virtual one, with the client on one side and our device on the other, in real time.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import CanFrame, LocalNode, LssSlave, LssState, NmtCommand, NmtState, PdoConfig, SdoAbort, scan
from barewire.canopen.emcy import EmcyEvent
from barewire.canopen.nmt.error_control import Guard, GuardEvent, HeartbeatEvent
from barewire.canopen.pdo.remote import PdoReceived
from barewire.canopen.sync import SyncEvent
from barewire.canopen.time_stamp import TimeReceived
from barewire.devices import load
from barewire.errors import EncodeError, NoAnswer
from barewire.io.canopen.bus.node_runner import Running
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.helpers import PATIENCE
from tests.io.canopen.either_client import KINDS, Calls, get, run_with as run_with_either
from tests.io.canopen.memory_bus import IDENTITY, MemoryPort, device, objects

pytest.importorskip("can")


def run_with(calls: Calls, kind: str, url: str) -> None:
    """The calls with one of the two clients, which leaves no thread behind."""
    threads = threading.active_count()
    run_with_either(calls, kind, url)
    assert threading.active_count() - threads <= (1 if kind == "asyncio" else 0)  # the loop's own helper may stay


@pytest.fixture
def thing(request: pytest.FixtureRequest) -> Iterator[tuple[str, LocalNode]]:
    """A device on a bus of its own; the URL of a client for it."""
    node = device()
    channel = f"can://virtual/{request.node.name}"
    with CanopenServer(channel, device=node):
        yield f"{channel}?node=5&timeout=30", node


@KINDS
def test_sdo(kind: str, thing: tuple[str, LocalNode]) -> None:
    async def calls(client: Any) -> None:
        assert await get(client.node().sdo.upload(0x6041)) == bytes.fromhex("3706")
        await get(client.node().sdo.download(0x2001, 0, b"\x0b"))
        assert await get(client.node().sdo.upload(0x2001, size=1)) == b"\x0b"
        with pytest.raises(SdoAbort, match="0609 0031h"):
            await get(client.node().sdo.download(0x2001, 0, b"\x65"))
        value = bytes(place * 7 % 251 for place in range(5000))
        reported: list[tuple[int, int | None]] = []
        sdo = client.node().sdo
        for block in (False, True, "auto"):
            await get(sdo.download(0x2100, 0, value, block=block, progress=lambda *done: reported.append(done)))
            assert reported[-1] == (5000, 5000)
            assert await get(sdo.upload(0x2100, block=block, progress=lambda *done: reported.append(done))) == value
            await get(client.node().sdo.download(0x2100, 0, b"", block=block))
        pieces = (value[start : start + 100] for start in range(0, 5000, 100))
        await get(client.node().sdo.download(0x2100, 0, pieces, size=5000, block="auto"))
        parts: list[bytes] = []
        assert await get(client.node().sdo.upload_to(0x2100, 0, parts.append)) == 5000
        assert b"".join(parts) == value
        with pytest.raises(NoAnswer, match=r"node 9 has sent no frame .*, 0 frames on 589h"):
            await get(client.node(9, timeout=0.02).sdo.upload(0x1000))
        assert await get(client.node(9, timeout=0.02).nmt.send(NmtCommand.START)) is None
        with pytest.raises(SdoAbort, match="1201h:01"):
            await get(client.node().sdo.find_channel(2))
        channel = await get(client.node().sdo.find_channel(1))
        assert await get(client.node().sdo.over(channel).upload(0x6041)) == bytes.fromhex("3706")

    run_with(calls, kind, thing[0])


@KINDS
def test_nmt_and_heartbeats(kind: str, thing: tuple[str, LocalNode]) -> None:
    async def calls(client: Any) -> None:
        with client.nmt.heartbeats() as stream:
            await get(client.node().sdo.download(0x1017, 0, (20).to_bytes(2, "little")))
            assert (await get(client.node().nmt.wait_for_heartbeat())).state == NmtState.PRE_OPERATIONAL
            obeyed = await get(client.node().nmt.send_confirmed(NmtCommand.START))
            assert (obeyed.node, obeyed.state) == (5, NmtState.OPERATIONAL)
            await get(client.node().nmt.send(NmtCommand.ENTER_PRE_OPERATIONAL))
            assert (await get(client.node().nmt.wait_for_state(NmtState.PRE_OPERATIONAL))).node == 5
            booted = await get(client.node().nmt.send_confirmed(NmtCommand.RESET_NODE))  # switches the heartbeat off
            assert booted.state == NmtState.INITIALISING
            kinds = []
            while "rebooted" not in kinds:
                event = await get(stream.get(30.0))
                assert isinstance(event, HeartbeatEvent)
                kinds.append(event.kind)
            # That it booted at all may have been before our time.
            assert [kind for kind in kinds if kind != "booted"] == ["active", "state", "state", "rebooted"]
        assert (await get(client.node().nmt.state())).state == NmtState.PRE_OPERATIONAL
        with pytest.raises(NoAnswer, match="node 6: it did not report its state"):
            await get(client.nmt.send_confirmed(NmtCommand.START, timeout=0.05, ask_every=0.01, confirmed_by=[5, 6]))

    run_with(calls, kind, thing[0])


@KINDS
def test_a_node_whose_heartbeat_stops_is_lost(kind: str, thing: tuple[str, LocalNode]) -> None:
    async def calls(client: Any) -> None:
        with client.nmt.heartbeats({5: 0.05}) as stream:
            await get(client.send(CanFrame.parse("705#05")))
            await get(client.node().sdo.download(0x1017, 0, (10).to_bytes(2, "little")))
            event = await get(stream.get(30.0))
            while event.kind != "active":
                event = await get(stream.get(30.0))
            await get(client.node().sdo.download(0x1017, 0, bytes(2)))
            while event.kind != "lost":
                event = await get(stream.get(30.0))
                assert event is not None
            assert event.node == 5

    run_with(calls, kind, thing[0])


@KINDS
def test_emcy_sync_and_time(kind: str, thing: tuple[str, LocalNode]) -> None:
    url, _ = thing

    async def calls(client: Any) -> None:
        with client.emergencies() as errors, client.sync.events(overflow=4) as syncs, client.time.events() as times:
            other = Running(await asyncio.to_thread(open_side, url), Wrong(), None)
            event = await get(errors.get(30.0))
            assert isinstance(event, EmcyEvent)
            assert (event.message.node, event.message.code, event.active) == (7, 0x3210, (0x3210,))
            producer = client.sync.start(0.005, overflow=4)
            beats = [await get(syncs.get(30.0)) for _ in range(6)]
            producer.stop()
            assert [isinstance(beat, SyncEvent) and beat.counter for beat in beats] == [1, 2, 3, 4, 1, 2]
            await get(client.sync.send(3))
            clock = client.time.start(60.0)
            received = await get(times.get(30.0))
            assert isinstance(received, TimeReceived)
            clock.stop()
            await get(client.time.send(1709210096.789))
            assert (await get(times.get(30.0))).stamp.unix == 1709210096.789
            other.stop()
            other._subscriber.bus.close()

    run_with(calls, kind, url)


@KINDS
def test_node_guarding(kind: str, thing: tuple[str, LocalNode]) -> None:
    async def calls(client: Any) -> None:
        reported: list[GuardEvent] = []

        async def until(*kinds: str) -> None:
            deadline = time.monotonic() + 30.0
            while tuple(event.kind for event in reported) != kinds:
                assert time.monotonic() < deadline, reported
                await asyncio.sleep(0.001)

        await get(client.node().sdo.upload(0x1000))  # its boot-up message came before
        guarding = client.nmt.start_guarding({5: Guard(0.02, 200)}, reported.append)
        await until("answered")
        await get(client.node().nmt.send(NmtCommand.STOP))
        await until("answered", "state")
        assert (reported[-1].node, reported[-1].state) == (5, NmtState.STOPPED)
        await get(client.node().nmt.send(NmtCommand.RESET_COMMUNICATION))
        await until("answered", "state", "booted", "state")
        guarding.stop()
        reported.clear()
        guarding_6 = client.nmt.start_guarding({6: Guard(0.01, 2)}, reported.append)
        await until("lost")
        guarding_6.stop()
        with pytest.raises(EncodeError, match="expected a time above 0"):
            client.nmt.start_guarding({5: Guard(0.0)}, print)

    run_with(calls, kind, thing[0])


@KINDS
def test_sync_time_and_emcy_with_other_identifiers(kind: str, thing: tuple[str, LocalNode]) -> None:
    """Each of the three with another COB-ID, and an extended one whose number is that of the default."""
    url, node = thing
    sync, clock, emcy = (0x80, True), (0x100, True), (0x6B0, False)

    async def calls(client: Any) -> None:
        moved = ((0x1005, 0x2000_0080), (0x1012, 0x100), (0x1012, 0xA000_0100), (0x1014, 1 << 31), (0x1014, 0x6B0))
        for index, word in moved:
            await get(client.node().sdo.download(index, 0, word.to_bytes(4, "little")))
        await get(client.node().nmt.send(NmtCommand.START))
        tpdo = await get(client.node().pdo.remote("TPDO", 1, objects=node.objects))
        with client.pdos(tpdo) as values, client.emergencies({emcy: 5}) as errors:
            await get(client.sync.send())
            await get(client.time.send(1e9))
            await get(client.send(CanFrame.parse("205#01")))  # too short
            assert (await get(errors.get(30.0))).message.code == 0x8210
            assert (await get(values.get(0.0)), node.time.last) == (None, None)
            await get(client.sync.send(key=sync))
            assert isinstance(await get(values.get(30.0)), PdoReceived)
            producer = client.sync.start(0.005, key=sync)
            assert isinstance(await get(values.get(30.0)), PdoReceived)
            producer.stop()
            await get(client.time.send(1709210096.789, key=clock))
            await get(client.node().sdo.upload(0x1000))
            assert node.time.last is not None
            assert node.time.last.stamp.unix == 1709210096.789
        with client.sync.events(key=sync) as beats, client.time.events(key=clock) as times:
            with CanopenClient(url) as other:
                other.sync.send(key=sync)
                other.time.send(1.5e9, key=clock)
            assert isinstance(await get(beats.get(30.0)), SyncEvent)
            assert isinstance(await get(times.get(30.0)), TimeReceived)

    run_with(calls, kind, url)


class Wrong:
    """A machine with one event."""

    deadline = None

    def start(self, now: float) -> list[CanFrame]:
        return [CanFrame.parse("087#1032050000000000")]

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        return []


def open_side(url: str) -> CanBus:
    return CanopenClient(url).bus


@KINDS
def test_pdos_by_name(kind: str, thing: tuple[str, LocalNode]) -> None:
    url, node = thing

    async def calls(client: Any) -> None:
        rpdo = await get(client.node().pdo.remote("RPDO", 1, objects=node.objects))
        await get(client.node().pdo.write_config(PdoConfig("TPDO", 1, (0x60FF0020, 0x60410010), type=1)))
        tpdo = await get(client.node().pdo.remote("TPDO", 1, objects=node.objects))
        configured = await get(client.node().pdo.read_config("TPDO", 1))
        assert tpdo.pdo.mapping == configured.mapping == (0x60FF0020, 0x60410010)
        with client.pdos(tpdo) as stream:
            await get(client.node().nmt.send(NmtCommand.START))
            await get(client.node().pdo.send(rpdo, {"controlword": 15, "velocity": -25000}))
            await get(client.sync.send())
            event = await get(stream.get(30.0))
            assert isinstance(event, PdoReceived)
            assert event.values == {"velocity": -25000, "statusword": 0x0637}
        assert await get(client.node().sdo.upload(0x6040)) == b"\x0f\x00"
        with pytest.raises(EncodeError, match="'speed' is not in this PDO"):
            client.node().pdo.send(rpdo, {"speed": 1})

    run_with(calls, kind, url)


@KINDS
def test_the_pdos_of_a_described_machine_by_its_names(kind: str, request: pytest.FixtureRequest) -> None:
    from barewire.devices.sim import simulator

    channel, az3 = f"can://virtual/{request.node.name}", load("az3")

    async def calls(client: Any) -> None:
        node = client.node(device="az3")
        assert (await get(node.read("STATUS WORD"))).name == "STATUS WORD"
        remote = await get(node.pdo.remote("TPDO", 1))
        assert "STATUS WORD" in remote.decode(CanFrame(remote.key[0], bytes(remote.mapping.size)))
        await get(node.write({"TARGET VELOCITY": 100}))
        velocity, unit = await get(node.read("TARGET VELOCITY", "ERROR CODE 1"))
        assert (float(velocity.value), unit.name) == (100, "ERROR CODE 1")
        await get(node.write("TARGET VELOCITY", 200))
        assert [float(reading.value) for reading in await get(node.read_all(["TARGET VELOCITY"]))] == [200]
        assert (await get(client.node(device=az3).pdo.remote("TPDO", 1))).pdo == remote.pdo
        with pytest.raises(EncodeError, match="TARGET VELOCITY"):
            await get(node.write({"TARGET VELOCITY": 10**9}))

    machine = simulator("az3")
    with CanopenServer(channel, device=machine.canopen):
        run_with(calls, kind, f"{channel}?node=1")


@KINDS
def test_the_objects_of_a_dictionary_are_read_as_a_table(kind: str, thing: tuple[str, LocalNode]) -> None:
    url, node = thing

    async def calls(client: Any) -> None:
        readings = await get(client.node(eds=node.objects).read_all([0x6041, (0x1018, 1)]))
        assert [(reading.entry.index, reading.value) for reading in readings] == [(0x6041, 0x0637), (0x1018, 0x360)]
        assert "<tr><td>6041h:00</td><td>statusword</td><td>1591</td></tr>" in readings._repr_html_()

    run_with(calls, kind, url)


@KINDS
def test_scan_run_frames_and_host(kind: str, thing: tuple[str, LocalNode]) -> None:
    async def calls(client: Any) -> None:
        requests: list[int] = []
        assert not (await get(client.scan(range(6, 9), progress=lambda node, survey: requests.append(node)))).nodes
        survey = await get(client.scan([5], timeout=30.0, progress=lambda node, survey: requests.append(node)))
        assert (list(survey.nodes), requests) == ([5], [6, 7, 8, 5])
        assert list((await get(client.run(scan([5], timeout=30.0)))).nodes) == [5]
        with client.frames((0x585, False)) as answers, client.frames() as everything:
            await get(client.node().sdo.upload(0x6041))
            assert str(await get(answers.get(30.0))) == "585#4B41600037060000"
            assert str(await get(everything.get(30.0))) == "605#4041600000000000"
        with client.host(device(6)):
            assert await get(client.node(6).sdo.upload(0x6041)) == bytes.fromhex("3706")

    run_with(calls, kind, thing[0])


@KINDS
def test_lss(kind: str, request: pytest.FixtureRequest) -> None:
    channel = f"can://virtual/{request.node.name}"
    bare = device(None)

    async def until(expected: object, ask: Callable[..., Any], **options: Any) -> None:
        """Ask again until the answer is the expected one: these requests wait until their time-out, so it is short."""
        give_up = time.monotonic() + PATIENCE
        while (answer := await get(ask(timeout=0.3, **options))) != expected:
            assert time.monotonic() < give_up, answer

    async def calls(client: Any) -> None:
        await until(1, client.lss.identify_unconfigured)
        reported: list[tuple[int, int]] = []
        await until(IDENTITY, client.lss.fastscan, progress=lambda step: reported.append((step.part, step.bit)))
        # A scan that missed an answer repeats its part.
        assert [*dict.fromkeys(reported)] == [(part, bit) for part in range(4) for bit in range(31, -1, -1)]
        assert await get(client.lss.inquire_address(timeout=PATIENCE)) == IDENTITY
        assert await get(client.lss.inquire_node(timeout=PATIENCE)) is None
        await get(client.lss.switch_global(LssState.WAITING))
        await until(1, partial(client.lss.identify_slaves, 0x360, 0xDEADBEEF))
        assert await get(client.lss.switch_selective(IDENTITY, timeout=PATIENCE))
        await get(client.lss.configure_bit_timing(2, timeout=PATIENCE))
        await get(client.lss.configure_node(12, timeout=PATIENCE))
        await get(client.lss.store_configuration(timeout=PATIENCE))
        await get(client.lss.switch_global(LssState.WAITING))
        assert await get(client.node(12).sdo.upload(0x6041)) == bytes.fromhex("3706")
        assert await get(client.lss.assign_node_ids([20], timeout=0.05)) == []

    with CanopenServer(channel, device=bare):
        run_with(calls, kind, channel)
    assert bare.node == 12


@KINDS
def test_a_slave_that_cannot_store_is_assigned_its_node_id(kind: str, request: pytest.FixtureRequest) -> None:
    channel = f"can://memory/{request.node.name}"
    bare = LocalNode(None, objects(), lss=LssSlave(IDENTITY))

    async def calls(client: Any) -> None:
        (assigned,) = await get(client.lss.assign_node_ids([12], IDENTITY))
        assert (assigned.node, assigned.booted, assigned.stored) == (12, True, False)
        assert await get(client.node(12).sdo.upload(0x6041)) == bytes.fromhex("3706")

    with CanopenServer(channel, device=bare):
        run_with(calls, kind, channel)


def test_receive_gives_the_frames_since_its_first_call() -> None:
    port = MemoryPort()
    with CanopenClient(port, timeout=0.01) as client:
        assert client.receive(0.0) is None
        port.deliver(CanFrame.parse("705#05"))
        assert str(client.receive(30.0)) == "705#05"
        assert client.receive() is None


@pytest.mark.parametrize("options", ["", "&receive_own_messages=true"])
def test_another_client_on_the_channel_is_noticed_unless_the_port_returns_what_it_sends(options: str) -> None:
    """No node answers: the other client is a frame on the request identifier, sent when ours is on the bus."""
    with (
        CanopenClient(f"can://virtual/rivals?node=5{options}", timeout=0.2 if options else 30.0) as bus,
        CanopenClient("can://virtual/rivals") as other,
        other.frames((0x605, False)) as requests,
    ):

        def disturb() -> None:
            requests.get(30.0)
            other.send(CanFrame.parse("605#4064600000000000"))

        disturbing = threading.Thread(target=disturb)
        disturbing.start()
        with pytest.raises(NoAnswer, match="within 0.2 s" if options else "another client sent 40 64 60"):
            bus.node(5).sdo.upload(0x6041)
        disturbing.join()
