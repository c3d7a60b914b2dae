"""Sequence diagrams of what was recorded: exchanges of Modbus, frames of a CAN bus, frames of a vector or a demo.

    RequestSeen          client -> unit 1         ResponseMissing      a mark at the unit
    ResponseSeen         unit 1 -> client         RecordingEnds        a mark at the unit
    AmbiguousFrame       client -> unit 1         NoiseSeen            a mark at the client's line
    SDO request, RPDO    master -> node 5         SYNC, NMT, TIME      master -> all nodes
    SDO answer, TPDO,    node 5 -> master         error frame          a mark
    EMCY, heartbeat

A frame on CAN reaches every node; its arrow ends at the station that it is for, and for what a node sends by itself at
the line of the master.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from barewire.canopen.cob_ids import classify
from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
)
from barewire_workbench.frames.canopen.frame import explain_can, explain_segment
from barewire_workbench.frames.canopen.known_node import KnownNode
from barewire_workbench.frames.modbus.named_registers import UnitNames
from barewire_workbench.frames.modbus.pdu import explain_pdu
from barewire_workbench.frames.result import Explanation, FrameRole, counted
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.pictures.levels import frame_bytes
from barewire_workbench.pictures.sequence import SequenceMessage
from barewire_workbench.recordings.model import Dropped, RecordedItem, Unread

_VALUES_SHOWN = 8
"""The most registers in the text of a response; the data of the picture have all bytes."""
CLIENT, MASTER, EVERY_NODE, EVERY_UNIT = "client", "master", "all nodes", "all units"


def modbus_messages(
    events: Iterable[SnifferEvent], *, timed: bool = True, names: UnitNames | None = None
) -> Iterator[SequenceMessage]:
    """Yield the messages of a Modbus line; those of a log without times are not `timed`.

    With `names` a response has the named values of its exchange.

    >>> request = RequestSeen(1, bytes.fromhex("0300000002"), 1.0)
    >>> [(message.source, message.target) for message in modbus_messages([request])]
    [('client', 'unit 1')]
    """
    last = 0.0
    for message in _modbus_messages(events, timed, names):
        # What is missing is certain at a time that may lie before that of noise, which is known after its last byte.
        last = max(last, message.at or 0.0)
        yield message._replace(at=None if not timed else message.at if message.target else last)


def _modbus_messages(events: Iterable[SnifferEvent], timed: bool, names: UnitNames | None) -> Iterator[SequenceMessage]:
    for event in events:
        match event:
            case RequestSeen():
                unit = f"unit {event.unit}" if event.unit or event.transaction is not None else EVERY_UNIT
                summary = _pdu_text(event.pdu, "request")
                yield SequenceMessage(CLIENT, unit, summary, event.pdu, event.at)
            case ResponseSeen():
                named = "" if names is None or event.request is None else names.text(event.request, event)
                summary = named or _response_text(event.pdu)
                after = "" if event.seconds is None or not timed else f", after {1e3 * event.seconds:.1f} ms"
                late = ", late: after the next request" if event.late else ""
                unasked = ", its request was not recorded" if event.request is None else ""
                wrong = event.late or bool(event.pdu and event.pdu[0] & EXCEPTION_BIT)
                text = f"{summary}{after}{late}{unasked}"
                yield SequenceMessage(f"unit {event.unit}", CLIENT, text, event.pdu, event.at, wrong)
            case ResponseMissing():
                unit = f"unit {event.request.unit}"
                yield SequenceMessage(unit, "", "no answer", b"", max(event.at, event.request.at), wrong=True)
            case RecordingEnds():
                at = max(event.at, event.request.at)
                yield SequenceMessage(f"unit {event.request.unit}", "", "the recording ends here", b"", at)
            case AmbiguousFrame():
                summary = _pdu_text(event.pdu, "request")
                text = f"{summary}; seen once: the request or its echo"
                yield SequenceMessage(CLIENT, f"unit {event.unit}", text, event.pdu, event.at)
            case NoiseSeen():
                yield SequenceMessage(CLIENT, "", f"noise: {event.noise.text}", event.noise.data, event.at, wrong=True)


def can_messages(
    items: Iterable[RecordedItem], bus: str | None = None, known: Iterable[KnownNode] = ()
) -> Iterator[SequenceMessage]:
    """Yield the messages of a recording of a CAN bus, of one `bus` if it has several; PDOs of `known` nodes by name.

    >>> from barewire_workbench.recordings.model import Recorded
    >>> frames = [Recorded(0.1, "can0", CanFrame.parse(text)) for text in ("000#0105", "705#05")]
    >>> [(message.source, message.target, message.text) for message in can_messages(frames)]
    [('master', 'node 5', 'NMT: start, node 5'), ('node 5', 'master', 'error control from node 5: operational')]
    """
    explainer = FrameExplainer(known)
    for item in items:
        if isinstance(item, Unread):
            yield SequenceMessage(MASTER, "", f"line {item.line} cannot be read: {item.why}", b"", item.at, wrong=True)
        elif bus not in (None, item.bus):
            continue
        elif isinstance(item, Dropped):
            lost = counted(item.frames, "frame") if item.frames else "frames"
            yield SequenceMessage(MASTER, "", f"the recorder lost {lost}", b"", item.at, wrong=True)
        else:
            yield explainer.message(item.frame, item.at)


class FrameExplainer:
    """Explains CAN frames in their order: after the beginning of a block transfer some are segments."""

    def __init__(self, known: Iterable[KnownNode] = ()) -> None:
        self._monitor = CanMonitor(known)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._monitor!r}>"

    def message(self, frame: AnyFrame, at: float) -> SequenceMessage:
        """Return the message of a frame."""
        if not isinstance(frame, CanFrame):
            wrong = isinstance(frame, ErrorFrame)
            return SequenceMessage(MASTER, "", _summary(explain_can(frame)), frame.data, at, wrong)
        segment = self._monitor.takes_segment(frame)
        explanation = explain_segment(frame) if segment else explain_can(frame, self._monitor.pdos)
        self._monitor.feed(frame, at)
        source, target = can_stations(frame)
        return SequenceMessage(source, target, _summary(explanation), frame.data, at, not explanation.valid)


def can_stations(frame: CanFrame) -> tuple[str, str]:
    """Return who sends a frame and for whom it is, by the predefined connection set; no target if it is not in it.

    >>> can_stations(CanFrame.parse("605#40")), can_stations(CanFrame.parse("080#"))
    (('master', 'node 5'), ('master', 'all nodes'))
    """
    found = classify(frame)
    if found is None:
        return MASTER, ""
    service, node = found
    if service.name == "NMT":
        named = frame.data[1] if len(frame.data) > 1 else 0
        return MASTER, f"node {named}" if named else EVERY_NODE
    if service.from_device:
        return (f"node {node}" if node else EVERY_NODE), MASTER
    return MASTER, f"node {node}" if node else EVERY_NODE


def explained_message(source: str, target: str, explanation: Explanation) -> SequenceMessage:
    """Return the message of a frame that is explained already; its time is not known."""
    data = bytes(byte for byte, _ in frame_bytes(explanation))
    return SequenceMessage(source, target, _summary(explanation), data, None, not explanation.valid)


def _summary(explanation: Explanation) -> str:
    return explanation.summary if explanation.valid and explanation.summary else explanation.verdict


def _response_text(pdu: bytes) -> str:
    """Return the summary of a response; of registers, their values."""
    parsed = explain_pdu(pdu, "response")
    registers = [str(field.value) for field in parsed.fields if field.name.startswith("register ")]
    if parsed.error is not None or not registers:
        return _pdu_text(pdu, "response")
    more = [] if len(registers) <= _VALUES_SHOWN else ["..."]
    return f"{parsed.summary}: {' '.join([*registers[:_VALUES_SHOWN], *more])}"


def _pdu_text(pdu: bytes, role: FrameRole) -> str:
    parsed = explain_pdu(pdu, role)
    return parsed.summary if parsed.error is None else f"{parsed.summary}: {parsed.error.text}"
