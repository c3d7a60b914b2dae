"""Exchanges between our master and a device of the `canopen` package of PyPI, service by service."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.canopen import (
    CanFrame,
    Channel,
    EmcyConsumer,
    HeartbeatConsumer,
    NmtCommand,
    NmtState,
    PdoConfig,
    SdoAbort,
    SyncMessage,
    SyncMonitor,
    TimeConsumer,
    TimeStamp,
    download,
    mapping_of,
    read_pdo,
    scan,
    send_nmt,
    upload,
    write_pdo,
)
from tests.helpers import PATIENCE
from tests.interop.canopen.can_bench import NODE, RPDO_MAPPING, TPDO_MAPPING, Bench
from tests.interop.canopen.canopen_exchanges import LENGTHS, VALUES, counting, exchange


@exchange("master", "SDO expedited upload", "SDO expedited download")
def our_master_reads_and_writes_numbers(bench: Bench) -> None:
    bench.local()
    channel = Channel(NODE)
    for index, value, other in VALUES:
        assert value is None or bench.run(upload(channel, index, timeout=PATIENCE)) == bytes.fromhex(value)
        bench.run(download(channel, index, 0, bytes.fromhex(other), timeout=PATIENCE))
        assert bench.run(upload(channel, index, timeout=PATIENCE)) == bytes.fromhex(other)
    bench.run(download(channel, 0x1017, 0, bytes(2), timeout=PATIENCE))


@exchange("master", "SDO segmented upload", "SDO segmented download", "SDO abort")
def our_master_moves_long_values(bench: Bench) -> None:
    """Their node has no block transfer: it refuses a block download, and answers a block upload with segments."""
    bench.local()
    channel = Channel(NODE)
    for length in LENGTHS:
        for block in (False, True):
            value = counting(length)[:: -1 if block else 1]
            # After the refusal of a block download a channel is quiet for two time-outs: another one need not wait.
            bench.run(download(Channel(NODE), 0x2100, 0, value, block=block, timeout=PATIENCE))
            assert bench.run(upload(channel, 0x2100, block=block, timeout=PATIENCE)) == value


@exchange("master", "SDO abort")
def our_master_gets_their_aborts(bench: Bench) -> None:
    bench.local()
    with pytest.raises(SdoAbort, match="0602 0000h object does not exist"):
        bench.run(upload(NODE, 0x3000, timeout=PATIENCE))
    with pytest.raises(SdoAbort, match="0607 0010h"):
        bench.run(download(NODE, 0x2001, 0, b"\1\2", timeout=PATIENCE))


@exchange("master", "NMT command", "heartbeat")
def our_master_commands_their_node(bench: Bench) -> None:
    local = bench.local()
    bench.run(download(NODE, 0x1017, 0, (50).to_bytes(2, "little"), timeout=PATIENCE))
    for command, name in ((NmtCommand.START, "OPERATIONAL"), (NmtCommand.STOP, "STOPPED"),
                          (NmtCommand.ENTER_PRE_OPERATIONAL, "PRE-OPERATIONAL")):  # fmt: skip
        bench.run(send_nmt(command, NODE))
        assert local.nmt.state == name
    local.nmt.stop_heartbeat()


@exchange("master", "boot-up", "heartbeat")
def our_master_monitors_their_node(bench: Bench) -> None:
    local = bench.local()
    watch = HeartbeatConsumer({NODE: 300})
    local.nmt.send_command(0x81)
    bench.listen(watch, lambda event: (event.node, event.kind) == (NODE, "booted"))
    local.nmt.state = "PRE-OPERATIONAL"
    local.nmt.start_heartbeat(50)
    bench.listen(watch, lambda event: event.state == NmtState.PRE_OPERATIONAL)
    local.nmt.state = "OPERATIONAL"
    local.nmt.start_heartbeat(50)
    bench.listen(watch, lambda event: (event.kind, event.state) == ("state", NmtState.OPERATIONAL))
    local.nmt.stop_heartbeat()


@exchange("master", "EMCY")
def our_master_receives_their_emergencies(bench: Bench) -> None:
    local = bench.local()
    consumer = EmcyConsumer()
    local.emcy.send(0x8130, 0x11, b"\2")
    event = bench.listen(consumer, lambda event: True)
    assert (event.message.code, event.message.node, event.active) == (0x8130, NODE, (0x8130,))
    local.emcy.reset()
    assert bench.listen(consumer, lambda event: True).active == ()


@exchange("master", "SYNC")
def our_master_receives_and_sends_sync(bench: Bench) -> None:
    monitor = SyncMonitor()
    bench.network.sync.transmit(7)
    assert bench.listen(monitor, lambda event: True).counter == 7
    received: list[bytes] = []
    bench.network.subscribe(0x080, lambda identifier, data, timestamp: received.append(bytes(data)))
    bench.port.send(SyncMessage(9).encode())
    bench.port.send(SyncMessage().encode())
    bench.wait(lambda: len(received) == 2)
    assert received == [b"\x09", b""]


@exchange("master", "TIME")
def our_master_receives_and_sends_the_time(bench: Bench) -> None:
    bench.network.time.transmit(1_700_000_000.5)
    event = bench.listen(TimeConsumer(), lambda event: True)
    assert event.stamp.unix == pytest.approx(1_700_000_000.5)
    received: list[bytes] = []
    bench.network.subscribe(0x100, lambda identifier, data, timestamp: received.append(bytes(data)))
    bench.port.send(TimeStamp.of_unix(1_709_210_096.789).encode())
    bench.wait(lambda: received)
    assert received == [bytes.fromhex("952CB302 4D39")]


@exchange("master", "TPDO")
def our_master_receives_their_tpdo(bench: Bench) -> None:
    local = bench.local()
    local.tpdo.read()
    local.tpdo[1]["statusword"].raw = 0x1237
    local.tpdo[1]["target velocity"].raw = -2
    local.tpdo[1].transmit()
    frame = bench.listen(_Frames(0x180 + NODE), lambda event: True)
    values = mapping_of(PdoConfig("TPDO", 1, TPDO_MAPPING)).unpack(frame.data)
    assert list(values.values()) == [0x1237, 0xFFFF_FFFE]  # without a dictionary all numbers are unsigned


@exchange("master", "RPDO")
def our_master_sends_their_node_an_rpdo(bench: Bench) -> None:
    local = bench.local()
    local.rpdo.read()
    received: list[int] = []
    local.rpdo[1].add_callback(lambda pdo: received.append(pdo["target velocity"].raw))
    mapping = mapping_of(PdoConfig("RPDO", 1, RPDO_MAPPING))
    names = [entry.name for entry in mapping.entries]
    data = mapping.pack(dict(zip(names, (0x000F, 0xFFFE_1DC0))))
    bench.port.send(CanFrame(0x200 + NODE, data))
    bench.wait(lambda: received)
    assert received == [-123_456]
    assert local.rpdo[1]["controlword"].raw == 0x000F


@exchange("master", "PDO mapping", "SDO expedited download")
def our_master_configures_their_pdos(bench: Bench) -> None:
    local = bench.local()
    assert bench.run(read_pdo(NODE, "TPDO", 1, timeout=PATIENCE)) == PdoConfig(
        "TPDO", 1, TPDO_MAPPING, type=1, cob_id=0x185
    )
    wanted = PdoConfig("TPDO", 1, (0x60FF0020, 0x20010008), type=3, cob_id=0x185)
    bench.run(write_pdo(NODE, wanted, timeout=PATIENCE))
    assert bench.run(read_pdo(NODE, "TPDO", 1, timeout=PATIENCE)) == wanted
    local.tpdo.read()
    assert [mapped.name for mapped in local.tpdo[1]] == ["target velocity", "percent"]
    assert (local.tpdo[1].enabled, local.tpdo[1].trans_type) == (True, 3)


@exchange("master", "SDO abort")
def our_master_finds_their_node(bench: Bench) -> None:
    bench.local()
    found = bench.run(scan(range(3, 8), timeout=1.0)).nodes
    assert list(found) == [NODE]
    assert found[NODE].abort == 0x0602_0000  # it has no 1000h: the abort shows that the node is there


class _Frames:
    """A machine that reports the frames of one identifier."""

    def __init__(self, identifier: int) -> None:
        self.identifier = identifier

    def feed(self, frame: CanFrame, now: float) -> list[Any]:
        return [frame] if frame.id == self.identifier else []
