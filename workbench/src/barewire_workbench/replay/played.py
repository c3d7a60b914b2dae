"""A recording that is played against a device or a client: what is compared, and what it reads from the device.

Of each recorded frame, and of each that is sent, the outcome is one of these:

    same        it sends the recorded frame
    different   it sends a frame with the same identifier and other data
    missing     it sends none with this identifier
    extra       it sends a frame that the recording does not have

The values that a recorded device has are what each SDO upload of the recording read, at the place of its request:

        items    0  605#4000600000000000        values   {0: RecordedValue(0x6000, 0, b"\\xD7\\0")}
                 1  585#4B006000D7000000

A device that is made from an EDS has default values; with these it has those of the recorded device, when they are
read. Left out are objects that an SDO wrote before in the recording, since the device has to know them itself, and
communication objects (1000h to 1FFFh) except the identity: 1000h, 1008h to 100Ah, 1018h.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import PDO_SERVICES, ServiceName, classify
from barewire.canopen.frame import CanFrame
from barewire_workbench.frames.can import explain_can
from barewire_workbench.monitor.events import SdoTransferReport
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem

PlayedOutcome = Literal["same", "different", "missing", "extra"]
PLAYED_KINDS = ("sdo", "pdo", "node", "emcy", "sync", "time", "lss", "other")
"""The kinds of frames of a device, named as the events of `barewire sniff`."""


class Played(NamedTuple):
    """One frame of the recording, of the device or client, or of both. `line` is 0 for an extra frame."""

    at: float
    outcome: PlayedOutcome
    kind: str
    recorded: CanFrame | None
    sent: CanFrame | None
    request: CanFrame | None  # of an SDO answer; else the last frame that `sender` received before
    line: int
    repeated: bool = False  # the same difference was reported before, or one earlier in the same SDO transfer
    sender: Literal["device", "client"] = "device"  # what the recording was played against

    @property
    def text(self) -> str:
        """The frames in words. What the device received before is left out if both are the same."""
        parts = [f"recorded {_in_words(self.recorded)}"] if self.recorded is not None else []
        if self.outcome != "same":
            parts += [f"the {self.sender} sends {_in_words(self.sent)}"] if self.sent is not None else []
            parts += [f"after {_in_words(self.request)}"] if self.request is not None else []
        return "; ".join(parts)


class Comparer:
    """Counts the outcomes, and marks the differences that were reported before."""

    def __init__(self) -> None:
        self.counts: Counter[PlayedOutcome] = Counter()
        self._known: set[tuple[object, ...]] = set()

    def note(self, played: Played, *, follows: bool) -> Played:
        """Return the comparison with its mark. `follows`: an earlier frame of the same transfer differs."""
        self.counts[played.outcome] += 1
        frame = played.recorded or played.sent
        if played.outcome == "same" or frame is None:
            return played
        difference: tuple[object, ...] = (played.outcome, played.recorded, played.sent)
        if played.kind == "pdo":  # process data differs all the time: each PDO is reported once
            difference = (played.outcome, frame.key)
        repeated = follows or difference in self._known
        self._known.add(difference)
        return played._replace(repeated=repeated)


def _in_words(frame: CanFrame) -> str:
    """Return a frame with its meaning.

    >>> _in_words(CanFrame.parse("705#05"))
    '705#05 (error control from node 5: operational)'
    """
    verdict = explain_can(frame).verdict
    return f"{frame} ({verdict.removeprefix('valid: ')})"


_KINDS: dict[ServiceName, str] = {
    "SDO answer": "sdo",
    "error control": "node",
    "EMCY": "emcy",
    "SYNC": "sync",
    "TIME": "time",
    "LSS answer": "lss",
    **dict.fromkeys(PDO_SERVICES.values(), "pdo"),
}


def played_kind(frame: CanFrame) -> str:
    """Return the kind of a frame of a device. An identifier outside the predefined connection set is of a PDO, and so
    is that of an RPDO: a device sends with it to another one directly."""
    classified = classify(frame)
    if classified is None:
        return "pdo"
    service, _ = classified
    return _KINDS.get(service.name, "other")


def nodes_of(items: Sequence[RecordedItem]) -> list[int]:
    """Return the nodes that answer SDO requests in a recording, or else those that report their state.

    >>> nodes_of([Recorded(0.0, "", CanFrame.parse("705#05")), Recorded(0.1, "", CanFrame.parse("589#80"))])
    [9]
    """
    nodes: dict[str, set[int]] = {"SDO answer": set(), "error control": set()}
    for item in items:
        if isinstance(item, Recorded) and isinstance(item.frame, CanFrame) and not item.frame.remote and not item.sent:
            classified = classify(item.frame)
            if classified is None:
                continue
            service, node = classified
            if service.name in nodes:
                nodes[service.name].add(node)
    return sorted(nodes["SDO answer"] or nodes["error control"])


_UPLOAD_REQUESTS = (0x40, 0xA0)
"""The first byte of "initiate upload" and "initiate block upload", apart from bits 2 to 4."""
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
    monitor = CanMonitor()
    written: set[tuple[int | None, int | None]] = set()
    values: dict[int, RecordedValue] = {}
    request_place = 0
    for place, item in enumerate(items):
        if isinstance(item, Recorded) and isinstance(item.frame, CanFrame):
            frame = item.frame
            if frame.key == (0x600 + node, False) and frame.data and frame.data[0] & 0xE3 in _UPLOAD_REQUESTS:
                request_place = place  # the transfer is reported only at its last frame
            events = monitor.feed(frame, item.at)
        elif isinstance(item, Dropped):
            events = monitor.feed(item, item.at)  # the transfer that it interrupts must not be reported as done
        else:
            continue
        for event in events:
            if not isinstance(event, SdoTransferReport) or (event.node, event.outcome) != (node, "done"):
                continue
            address = event.index, event.sub
            if event.direction == "download":
                written.add(address)
            elif event.data is not None and address not in written and _is_own_value(event.index):
                values[request_place] = RecordedValue(event.index or 0, event.sub or 0, event.data)
    return values
