"""One frame of a recording that was played against a device or a client: the same, different, missing or extra.

The four outcomes:

    same        it sends the recorded frame
    different   it sends a frame with the same identifier and other data
    missing     it sends none with this identifier
    extra       it sends a frame that the recording does not have
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import classify
from barewire.canopen.frame import CanFrame
from barewire_workbench.frames.can import explain_can
from barewire_workbench.recordings.model import Recorded, RecordedItem

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
    request: CanFrame | None  # the SDO request, or else the last frame that the device received before
    line: int
    repeated: bool = False  # the same difference was reported before, or one earlier in the same SDO transfer
    sender: Literal["device", "client"] = "device"
    """What the recording was played against. `request` is then the last frame that this side received before."""

    @property
    def text(self) -> str:
        """The frames in words. What the device received before is left out if both are the same."""
        parts = [f"recorded {_in_words(self.recorded)}"] if self.recorded is not None else []
        if self.outcome != "same":
            parts += [f"the {self.sender} sends {_in_words(self.sent)}"] if self.sent is not None else []
            parts += [f"after {_in_words(self.request)}"] if self.request is not None else []
        return "; ".join(parts)


def _in_words(frame: CanFrame) -> str:
    """Return a frame with its meaning.

    >>> _in_words(CanFrame.parse("705#05"))
    '705#05 (error control from node 5: operational)'
    """
    verdict = explain_can(frame).verdict
    return f"{frame} ({verdict.removeprefix('valid: ')})"


def played_kind(frame: CanFrame) -> str:
    """Return the kind of a frame of a device: an identifier outside the predefined connection set is of a PDO."""
    found = classify(frame)
    name = "PDO" if found is None else found[0].name
    kinds = {"SDO": "sdo", "TPDO": "pdo", "PDO": "pdo", "error": "node", "EMCY": "emcy", "SYNC": "sync"}
    kinds |= {"TIME": "time", "LSS": "lss"}
    return kinds.get(name.split()[0].rstrip("1234"), "other")


def nodes_of(items: Sequence[RecordedItem]) -> list[int]:
    """Return the nodes that answer SDO requests in a recording, or else those that report their state.

    >>> nodes_of([Recorded(0.0, "", CanFrame.parse("705#05")), Recorded(0.1, "", CanFrame.parse("589#80"))])
    [9]
    """
    found: dict[str, set[int]] = {"SDO answer": set(), "error control": set()}
    for item in items:
        if isinstance(item, Recorded) and isinstance(item.frame, CanFrame) and not item.frame.remote and not item.sent:
            service = classify(item.frame)
            if service is not None and service[0].name in found:
                found[service[0].name].add(service[1])
    return sorted(found["SDO answer"] or found["error control"])
