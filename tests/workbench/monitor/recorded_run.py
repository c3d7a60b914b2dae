"""A recorded run: a bus with the simulated AZ3 and another node, on which every service is used; events by class."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any, TypeVar

from barewire.canopen import (
    BlockSettings,
    CanFrame,
    Channel,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    LssState,
    NmtCommand,
    NmtMessage,
    ObjectDictionary,
    PdoConfig,
    SyncProducer,
    TimeStamp,
    download,
    fastscan,
    guarding_request,
    inquire_address,
    standard_objects,
    switch_global,
    switch_selective,
    upload,
    write_pdo,
)
from barewire.canopen.abort_codes import SdoAbort
from barewire.conversation import Conversation
from barewire.devices.sdo_dialects import AZ3
from barewire.devices.sim import simulator
from barewire_workbench.monitor.events import MonitorEvent
from tests.canopen.virtual_bus import VirtualBus

Event = TypeVar("Event")
Timed = list[tuple[float, CanFrame]]

DRIVE, PLAIN = 5, 9
LONG = bytes(range(256)) * 8 + b"the end"
EPOCH_2024 = 1709210096.789
IDENTITY = LssAddress(0x360, 1, 0x10002, 77)
NEW = LssAddress(0x11223344, 0xFFFFFFFF, 0, 0x80000001)


def of(kind: type[Event], events: Iterable[MonitorEvent]) -> list[Event]:
    """Return the events of one class."""
    return [event for event in events if isinstance(event, kind)]


class Sender:
    """The producer of SYNC."""

    def __init__(self) -> None:
        self.sync = SyncProducer(0.01, overflow=10)

    @property
    def deadline(self) -> float | None:
        """The next SYNC."""
        return self.sync.deadline

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return a SYNC when it is due."""
        return self.sync.feed(None, now) if frame is None else []


def plain() -> LocalNode:
    """Return a node with every kind of object and PDO."""
    objects = ObjectDictionary(
        [
            *standard_objects(IDENTITY, name="thermometer for tests", heartbeat=0),
            Entry(0x2100, 0, "domain", "domain", "rw", b""),
            Entry(0x2101, 0, "nothing", "string", "rw", ""),
            Entry(0x6000, 0, "temperature", "i16", "rw", -215),
            Entry(0x6001, 0, "alarm", "i16", "rw", 800, minimum=0, maximum=1500),
        ]
    )
    return LocalNode(PLAIN, objects, [PdoConfig("TPDO", 1, (0x60000010,), type=255)], lss=LssSlave(IDENTITY))


def refused(conversation: Conversation[CanFrame, Any]) -> Conversation[CanFrame, SdoAbort]:
    """Return a conversation that ends with an abort."""
    try:
        yield from conversation
    except SdoAbort as abort:
        return abort
    raise AssertionError("the transfer was not aborted")


@cache
def recorded() -> tuple[tuple[float, CanFrame], ...]:
    """Return every frame with its time, in order."""
    bus, master = VirtualBus(), Sender()
    drive = simulator("az3", node=DRIVE)
    assert drive.canopen is not None
    node = plain()
    bus.add(drive.canopen, sent=drive.canopen.start(0.0))
    bus.add(node, sent=node.start(0.0))
    bus.add(master)
    bus.pass_time(2.2)  # heartbeats
    az3, channel = Channel(DRIVE, dialect=AZ3), Channel(PLAIN)
    bus.run(upload(az3, 0x6041, 0))
    bus.run(download(az3, 0x6040, 0, b"\x06\0"))
    bus.run(refused(upload(az3, 0x5FFF, 0)))
    bus.run(upload(channel, 0x1008, 0))
    bus.run(download(channel, 0x2100, 0, b"in segments, 26 bytes long"))
    bus.run(download(channel, 0x2100, 0, LONG, block=True))
    bus.run(upload(channel, 0x2100, 0, block=BlockSettings(size=100)))
    bus.run(upload(channel, 0x2101, 0))
    bus.run(refused(download(channel, 0x6001, 0, b"\x08\x07")))
    write = write_pdo(channel, PdoConfig("TPDO", 1, (0x60010010, 0x60000010), type=255))
    bus.run(write)
    bus.inject(str(NmtMessage(NmtCommand.START, 0).encode()), bus.now)
    bus.inject(str(TimeStamp.of_unix(EPOCH_2024).encode()), bus.now + 0.001)
    master.sync.start(bus.now)
    bus.pass_time(0.105)
    bus.inject(f"{0x200 + DRIVE:03X}#0700102700 00".replace(" ", ""), bus.now)
    bus.pass_time(0.1)
    bus.run(download(channel, 0x6000, 0, b"\x01\0"))
    for _ in range(3):
        bus.inject(str(guarding_request(PLAIN)), bus.now)
        bus.pass_time(0.05)
    for frame in node.error(0x4210, bus.now, source="oven"):
        bus.inject(str(frame), bus.now)
    bus.pass_time(0.05)
    for frame in node.error_gone(0x4210, bus.now, source="oven"):
        bus.inject(str(frame), bus.now)
    bus.pass_time(0.05)
    bus.run(switch_selective(IDENTITY))
    bus.run(inquire_address())
    bus.run(switch_global(LssState.WAITING))
    fresh = LocalNode(None, ObjectDictionary(), lss=LssSlave(NEW))
    bus.add(fresh, sent=fresh.start(bus.now))
    bus.run(fastscan())
    bus.pass_time(1.5)
    return tuple(sorted(((at, CanFrame.parse(text)) for at, text in bus.log), key=lambda pair: pair[0]))
