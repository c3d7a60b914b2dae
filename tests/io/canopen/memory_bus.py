"""Buses without hardware: one in memory, whose members share a `CanBus`, and python-can's virtual one."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from barewire.canopen import (
    CanFrame,
    Entry,
    ErrorFrame,
    FdFrame,
    LocalNode,
    LssAddress,
    LssSlave,
    ObjectDictionary,
    PdoConfig,
)
from barewire.canopen.communication_objects import standard_objects
from barewire.errors import PortError
from barewire.io.canopen.bus.shared_bus import CanBus

IDENTITY = LssAddress(0x360, 0xDEADBEEF, 0x10002, 0xFFFFFFFF)


def numbered(count: int) -> list[CanFrame]:
    """Frames that differ, to see whether all of them come, and in order."""
    return [CanFrame(0x185, number.to_bytes(4, "little")) for number in range(count)]


class MemoryPort:
    """A port that receives the items of the test. Sent frames go only to the other subscribers of the same bus."""

    name = "memory"

    def __init__(self) -> None:
        self.sent: deque[CanFrame] = deque(maxlen=1000)
        self.closed = False
        self._incoming: deque[CanFrame | ErrorFrame | FdFrame | PortError] = deque()
        self._has_items = threading.Event()

    def deliver(self, *items: CanFrame | ErrorFrame | FdFrame | PortError) -> None:
        """Let the port receive these items next."""
        self._incoming.extend(items)
        self._has_items.set()

    def send(self, item: CanFrame) -> None:
        self.sent.append(item)

    def receive(self, timeout: float) -> CanFrame | None:
        item = self.receive_any(timeout)
        return item if isinstance(item, CanFrame) else None

    def receive_any(self, timeout: float) -> CanFrame | ErrorFrame | FdFrame | None:
        if not self._incoming:
            self._has_items.clear()
            if not self._incoming:
                self._has_items.wait(timeout)
        if not self._incoming:
            return None
        item = self._incoming.popleft()
        if isinstance(item, PortError):
            raise item
        return item

    def close(self) -> None:
        self.closed = True


def objects() -> ObjectDictionary:
    """The objects of a node, of several types."""
    numbers = [Entry(0x3000 + place, 0, f"number {place}", "u32", "rw", place * 7919) for place in range(100)]
    return ObjectDictionary(
        [
            *standard_objects(IDENTITY, name="thing", heartbeat=0),
            Entry(0x2001, 0, "percent", "u8", "rw", 50, maximum=100),
            Entry(0x2100, 0, "anything", "domain", "rw", b""),
            Entry(0x6040, 0, "controlword", "u16", "rw", 0),
            Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
            Entry(0x60FF, 0, "velocity", "i32", "rw", 0),
            *numbers,
        ]
    )


def device(node: int | None = 5) -> LocalNode:
    """A node with two PDOs and LSS."""
    pdos = [PdoConfig("RPDO", 1, (0x60400010, 0x60FF0020)), PdoConfig("TPDO", 1, (0x60410010, 0x60FF0020), type=1)]
    return LocalNode(node, objects(), pdos, lss=LssSlave(IDENTITY, store=lambda node, rate: True))


@contextmanager
def memory_bus() -> Iterator[CanBus]:
    """A bus in memory, closed at the end."""
    with CanBus(MemoryPort()) as bus:
        yield bus
