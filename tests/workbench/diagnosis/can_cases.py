"""Recordings of CAN buses: good ones by seed, and frames as text for faulty ones."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from barewire.canopen import (
    BlockSettings,
    CanFrame,
    Channel,
    LocalNode,
    NmtCommand,
    NmtMessage,
    SyncProducer,
    download,
    upload,
)
from barewire.canopen.frame import AnyFrame
from barewire.canopen.sdo.dialect import STANDARD
from barewire.devices import load
from barewire.devices.sdo_dialects import AZ3
from barewire.devices.sim import simulator
from barewire_workbench.diagnosis.can_log import BusDiagnosis
from barewire_workbench.diagnosis.verdict import LineVerdict, LogFinding
from barewire_workbench.monitor import KnownNode, of_device
from tests.canopen.virtual_bus import VirtualBus
from tests.workbench.monitor.recorded_run import DRIVE, PLAIN, Sender, plain, refused

Frames = list[tuple[float, CanFrame]]


def good_recording(seed: int) -> Frames:
    """Return a run of a master with the simulated AZ3 and another node: services in an order that the seed decides."""
    random, bus, master = Random(seed), VirtualBus(wire=random_wire(seed)), Sender()
    drive = simulator("az3", node=DRIVE)
    assert drive.canopen is not None
    node = plain()
    bus.add(drive.canopen, latency=random.uniform(0.0002, 0.02), sent=drive.canopen.start(0.0))
    bus.add(node, latency=random.uniform(0.0002, 0.02), sent=node.start(0.0))
    bus.add(master)
    master.sync = SyncProducer(random.choice((0.01, 0.05)), overflow=random.choice((0, 10, 240)))
    started = False
    for _ in range(random.randint(8, 20)):
        _service(random, bus, node, master)
        if not started and random.random() < 0.3:
            started = True
            bus.inject(str(NmtMessage(NmtCommand.START, 0).encode()), bus.now)
            bus.pass_time(0.1)
            master.sync.start(bus.now)
        bus.pass_time(random.choice((0.001, 0.02, 0.3, 1.2)))
    frames = sorted(((at, CanFrame.parse(text)) for at, text in bus.log), key=lambda pair: pair[0])
    first = random.choice((0, 0, random.randrange(len(frames) // 2)))
    return frames[first : random.choice((len(frames), random.randrange(first + 5, len(frames) + 1)))]


def random_wire(seed: int) -> float:
    """Return the seconds that a frame takes."""
    return (0.00013, 0.00025, 0.0011)[seed % 3]


def _service(random: Random, bus: VirtualBus, node: LocalNode, master: Sender) -> None:
    channel = Channel(PLAIN, dialect=STANDARD)
    az3 = Channel(DRIVE, dialect=random.choice((AZ3, STANDARD)))
    value = random.randbytes(random.choice((1, 7, 8, 50, 900)))
    match random.randrange(9):
        case 0:
            bus.run(upload(az3, random.choice((0x6041, 0x1000, 0x6064)), 0))
        case 1:
            bus.run(download(az3, 0x6040, 0, b"\x06\0"))
        case 2:
            bus.run(refused(upload(az3, 0x5FFF, 0)))
        case 3:
            bus.run(upload(channel, 0x1008, 0))
        case 4:
            bus.run(download(channel, 0x2100, 0, value))
        case 5:
            bus.run(download(channel, 0x2100, 0, value, block=True))
        case 6:
            bus.run(upload(channel, 0x2100, 0, block=BlockSettings(size=random.choice((1, 5, 127)))))
        case 7:
            bus.run(download(channel, 0x6000, 0, random.randbytes(2)))
        case _:
            for frame in (
                *node.error(0x4210, bus.now, source="oven"),
                *node.error_gone(0x4210, bus.now, source="oven"),
            ):
                bus.inject(str(frame), bus.now)


def diagnosed(
    frames: Sequence[tuple[float, AnyFrame]], *known: KnownNode
) -> tuple[list[LogFinding], list[LineVerdict]]:
    """Return the findings of a recording of one bus, and the verdicts."""
    bus = BusDiagnosis(known)
    findings = [found for line, (at, frame) in enumerate(frames, 1) for found in bus.feed(frame, at, line)]
    return findings + bus.end(bus.monitor.now), bus.verdicts()


def timed(*texts: str, step: float = 0.002, start: float = 0.0) -> Frames:
    """Return frames `step` seconds apart."""
    return [(start + step * place, CanFrame.parse(text)) for place, text in enumerate(texts)]


def az3_known() -> KnownNode:
    """Return the description of the AZ3 on the recorded bus."""
    return of_device(load("az3"), DRIVE)
