"""The values that a recorded device has: what each SDO upload of a recording read, at the place of its request.

        items    0  605#4000600000000000        values   {0: RecordedValue(0x6000, 0, b"\\xD7\\0")}
                 1  585#4B006000D7000000

A device that is made from an EDS has default values; with these it has those of the recorded device, when they are
read. Left out are objects that an SDO wrote before in the recording, since the device has to know them itself, and
communication objects (1000h to 1FFFh) except the identity: 1000h, 1008h to 100Ah, 1018h.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from barewire.canopen.frame import CanFrame
from barewire_workbench.monitor.events import SdoTransferReport
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem

_IDENTITY = (0x1000, 0x1008, 0x1009, 0x100A, 0x1018)


@dataclass(frozen=True, slots=True)
class RecordedValue:
    """The value of an object as bytes."""

    index: int
    sub: int
    data: bytes


def _is_own_value(index: int | None) -> bool:
    return index is not None and (index >= 0x2000 or index in _IDENTITY)


def values_of(items: Sequence[RecordedItem], node: int) -> dict[int, RecordedValue]:
    """Return the values that were read on the default SDO channel of a node, by the place of the request in `items`.

    >>> texts = "605#4000600000000000", "585#4B006000D7000000"
    >>> values_of([Recorded(0.0, "", CanFrame.parse(text)) for text in texts], 5)
    {0: RecordedValue(index=24576, sub=0, data=b'\\xd7\\x00')}
    """
    monitor, written = CanMonitor(), set[tuple[int | None, int | None]]()
    found: dict[int, RecordedValue] = {}
    requested = 0
    for place, item in enumerate(items):
        if isinstance(item, Recorded) and isinstance(item.frame, CanFrame):
            frame = item.frame
            if frame.key == (0x600 + node, False) and frame.data[:1] and frame.data[0] & 0xE3 in (0x40, 0xA0):
                requested = place
            events = monitor.feed(frame, item.at)
        elif isinstance(item, Dropped):
            events = monitor.feed(item, item.at)
        else:
            continue
        for event in events:
            if not isinstance(event, SdoTransferReport) or (event.node, event.outcome) != (node, "done"):
                continue
            address = event.index, event.sub
            if event.direction == "download":
                written.add(address)
            elif event.data is not None and address not in written and _is_own_value(event.index):
                found[requested] = RecordedValue(event.index or 0, event.sub or 0, event.data)
    return found
