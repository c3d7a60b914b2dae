"""The pictures of a recording: a sequence diagram of its messages, or the state machine of a drive in it.

    RequestSeen          client -> unit 1         ResponseMissing      a mark at the unit
    ResponseSeen         unit 1 -> client         RecordingEnds        a mark at the unit
    AmbiguousFrame       client -> unit 1         NoiseSeen            a mark at the client's line
    SDO request, RPDO    master -> node 5         SYNC, NMT, TIME      master -> all nodes
    SDO answer, TPDO,    node 5 -> master         error frame          a mark
    EMCY, heartbeat

A frame on CAN reaches every node; its arrow ends at the station that it is for, and for what a node sends by itself at
the line of the master.

The status words and control words of a drive:

    CAN      6040h and 6041h in SDO transfers, and in PDOs whose mapping is known from a description or the recording
    Modbus   the registers that the description of the drive names, in answered requests
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from typing import NamedTuple

from barewire.canopen.cob_ids import classify
from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame
from barewire.devices.cia402 import command_of, state_of
from barewire.devices.device import Device, drive_roles
from barewire.devices.parameter import ModbusAt
from barewire.errors import BarewireError, DecodeError
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire_workbench.frames.can import explain_can
from barewire_workbench.frames.known_node import KnownNode
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.frames.modbus_exchanges import RegisterNames, UnitNames
from barewire_workbench.frames.result import Explanation, FrameRole, counted
from barewire_workbench.monitor.events import SdoTransferReport
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.monitor.recording import BusMonitors, is_can_recording, is_timed, read_recording
from barewire_workbench.pictures.levels import frame_bytes
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.pictures.sequence import SequenceMessage, SequencePicture
from barewire_workbench.pictures.states import DriveWord, StatesPicture, WordKind
from barewire_workbench.recordings.capture import MODBUS_PORTS
from barewire_workbench.recordings.modbus_replay import SerialProtocol, replay_log
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem, Unread
from barewire_workbench.sniffer import (
    WINDOW,
    AmbiguousFrame,
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
)

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
    latest = 0.0
    for message in _modbus_messages(events, timed, names):
        # What is missing is certain at a time that may lie before that of noise, which is known after its last byte.
        latest = max(latest, message.at or 0.0)
        if not timed:
            yield message._replace(at=None)
        elif message.target:
            yield message
        else:
            yield message._replace(at=latest)


def _modbus_messages(events: Iterable[SnifferEvent], timed: bool, names: UnitNames | None) -> Iterator[SequenceMessage]:
    for event in events:
        match event:
            case RequestSeen():
                unit = f"unit {event.unit}" if event.unit or event.transaction is not None else EVERY_UNIT
                summary = _pdu_text(event.pdu, "request")
                yield SequenceMessage(CLIENT, unit, summary, event.pdu, event.at)
            case ResponseSeen():
                named = "" if names is None or event.request is None else names.text(event.request, event)
                text = named or _response_text(event.pdu)
                if timed and event.seconds is not None:
                    text += f", after {1e3 * event.seconds:.1f} ms"
                if event.late:
                    text += ", late: after the next request"
                if event.request is None:
                    text += ", its request was not recorded"
                wrong = event.late or bool(event.pdu and event.pdu[0] & EXCEPTION_BIT)
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
        explanation = self._monitor.explain(frame)
        self._monitor.feed(frame, at)
        source, target = can_stations(frame)
        return SequenceMessage(source, target, _summary(explanation), frame.data, at, not explanation.valid)


def can_stations(frame: CanFrame) -> tuple[str, str]:
    """Return the sender and the target of a frame by the predefined connection set; no target if it is not in it.

    >>> can_stations(CanFrame.parse("605#40")), can_stations(CanFrame.parse("080#"))
    (('master', 'node 5'), ('master', 'all nodes'))
    """
    owner = classify(frame)
    if owner is None:
        return MASTER, ""
    service, node = owner
    if service.name == "NMT":
        node = frame.data[1] if len(frame.data) > 1 else 0  # its identifier is that of a broadcast
    station = f"node {node}" if node else EVERY_NODE
    return (station, MASTER) if service.from_device else (MASTER, station)


def explained_message(source: str, target: str, explanation: Explanation) -> SequenceMessage:
    """Return the message of a frame that is explained already; its time is not known."""
    data = bytes(byte for byte, _ in frame_bytes(explanation))
    return SequenceMessage(source, target, _summary(explanation), data, None, not explanation.valid)


def _summary(explanation: Explanation) -> str:
    return explanation.summary if explanation.valid and explanation.summary else explanation.verdict


def _response_text(pdu: bytes) -> str:
    parsed = explain_pdu(pdu, "response")
    registers = [str(field.value) for field in parsed.fields if field.name.startswith("register ")]
    if parsed.error is not None or not registers:
        return _pdu_text(pdu, "response")
    more = [] if len(registers) <= _VALUES_SHOWN else ["..."]
    return f"{parsed.summary}: {' '.join([*registers[:_VALUES_SHOWN], *more])}"


def _pdu_text(pdu: bytes, role: FrameRole) -> str:
    parsed = explain_pdu(pdu, role)
    return parsed.summary if parsed.error is None else f"{parsed.summary}: {parsed.error.text}"


# Words of drives ----------------------------------------------------------------------------------------------------


WORD_OBJECTS: dict[int, WordKind] = {0x6040: "control", 0x6041: "status"}


class DriveWords:
    """The words of one drive, in their order, without repetitions.

    >>> words = DriveWords()
    >>> for word in (0x0250, 0x0650, 0x0231):
    ...     words.add("status", word, 0.5)
    >>> [f"{kept.word:04X}" for kept in words.kept]
    ['0250', '0231']
    """

    def __init__(self) -> None:
        self.kept: list[DriveWord] = []
        self._shown: dict[WordKind, object] = {}  # what the latest word of each kind showed
        self._control = 0  # the latest control word: a fault is reset by the edge of bit 7

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.kept)} kept>"

    def add(self, kind: WordKind, word: int, at: float | None) -> None:
        """Take a word; it is kept if it shows another state or command than the last of its kind."""
        if kind == "status":
            try:
                shown: object = state_of(word)
            except DecodeError:
                shown = word & 0x6F  # no state of CiA 402: the bits that make a state, so that a change is kept
        else:
            shown = command_of(word, self._control), word & 0x80
            self._control = word
        if self._shown.get(kind) != shown:
            self._shown[kind] = shown
            self.kept.append(DriveWord(kind, word, at))


def can_drive_words(
    items: Iterable[RecordedItem], known: Iterable[KnownNode] = (), bus: str | None = None
) -> dict[int, DriveWords]:
    """Return the words of each drive in a recording of CAN, by its node-ID.

    >>> frames = [CanFrame.parse("605#2B40600006000000"), CanFrame.parse("585#6040600000000000")]
    >>> can_drive_words(Recorded(0.1 * place, "can0", frame) for place, frame in enumerate(frames))[5].kept
    [DriveWord(kind='control', word=6, at=0.1)]
    """
    monitors = BusMonitors(known, bus)
    drives: dict[int, DriveWords] = {}
    for item in items:
        if isinstance(item, Recorded) and isinstance(item.frame, CanFrame) and bus in (None, item.bus):
            monitor = monitors.monitor(item.bus)
            if monitor is not None:
                _add_mapped(drives, monitor, item.frame, item.at)
        for _, event in monitors.feed(item):
            if isinstance(event, SdoTransferReport):
                _add_transferred(drives, event)
    return drives


def _add_transferred(drives: dict[int, DriveWords], transfer: SdoTransferReport) -> None:
    """Add the word that an SDO transfer has written or read. A control word that is read back is no command."""
    kind, data = WORD_OBJECTS.get(transfer.index or 0), transfer.data
    if kind is None or transfer.sub != 0 or transfer.outcome != "done" or data is None or len(data) != 2:
        return
    if transfer.direction == ("download" if kind == "control" else "upload"):
        drives.setdefault(transfer.node, DriveWords()).add(kind, int.from_bytes(data, "little"), transfer.at)


def _add_mapped(drives: dict[int, DriveWords], monitor: CanMonitor, frame: CanFrame, at: float) -> None:
    """Add the words in a PDO, if its mapping is known."""
    pdo = monitor.pdos.owner(frame)
    if pdo is None or pdo.mapping is None or frame.remote:
        return
    try:
        values = pdo.mapping.unpack(frame.data)
    except DecodeError:
        return
    for entry in pdo.mapping.entries:
        kind, value = WORD_OBJECTS.get(entry.index), values.get(entry.name)
        if kind is not None and entry.sub == 0 and isinstance(value, int) and 0 <= value <= 0xFFFF:
            drives.setdefault(pdo.node, DriveWords()).add(kind, value, at)


def modbus_drive_words(events: Iterable[SnifferEvent], device: Device) -> dict[int, DriveWords]:
    """Return the words of each drive in a recording of Modbus, by its unit. All units are taken to be this device.

    Raises EncodeError if the description has no table [drive].
    """
    roles = drive_roles(device)
    names: dict[WordKind, str] = {"control": roles.control_word, "status": roles.status_word}
    places: dict[WordKind, ModbusAt] = {}
    for kind, name in names.items():
        place = device.find(name).modbus
        if place is not None and place.words == 1 and not place.partial:
            places[kind] = place
    registers = RegisterNames(device)
    drives: dict[int, DriveWords] = {}
    for event in events:
        if not isinstance(event, ResponseSeen) or event.request is None or event.pdu[0] & EXCEPTION_BIT:
            continue
        rows = tuple(registers.rows(event.request.message, event.message))
        for kind, place in places.items():
            for row in rows:
                offset = place.address - row.address
                is_of_kind = row.written == (kind == "control") and place.table in row.tables
                if is_of_kind and 0 <= offset < len(row.content):
                    drives.setdefault(event.unit, DriveWords()).add(kind, row.content[offset], event.at)
    return drives


# Pictures -----------------------------------------------------------------------------------------------------------


class RecordingOptions(NamedTuple):
    """How a recording is read: one `bus` of several; the others are for Modbus, see `replay_log`."""

    bus: str | None = None
    window: float = WINDOW
    ports: Container[int] = MODBUS_PORTS
    protocol: SerialProtocol | None = None


def recording_picture(
    name: str,
    data: bytes,
    picture: str | None = None,
    options: RecordingOptions = RecordingOptions(),  # noqa: B008 - a value that cannot change
    *,
    known: Iterable[KnownNode] = (),
    device: Device | None = None,
    number: int | None = None,
    names: UnitNames | None = None,
) -> Picture:
    """Return the picture "sequence" of a recording, its messages, or "states", the state machine of a drive in it.

    >>> recording_picture("bus.log", b"(1.5) can0 705#05").lines()[1]
    '1.500000    |<--------------|       error control from node 5: operational   05'

    The drive is the node or unit `number`, or the first one. Its words are objects 6040h and 6041h on CAN; PDOs of
    `known` nodes have the mapping of their description. On Modbus the description of the `device` says which registers
    they are; `names` has those of the values of a sequence diagram.

    Raises DecodeError if the bytes are not a recording, BarewireError if there is no word of a drive in it.
    """
    is_can = is_can_recording(data, options.ports)
    if picture == "states":
        if not is_can and device is None:
            raise BarewireError(f"{name}: the states of a drive on Modbus need its description: --device NAME")
        return _states(name, data, options, tuple(known), device, number)
    if is_can:
        timed = is_timed(data)
        messages = can_messages(read_recording(data), options.bus, known)
        if not timed:
            messages = (message._replace(at=None) for message in messages)
        return SequencePicture(f"Messages in {name}", messages, [MASTER])
    log, events = replay_log(data, window=options.window, ports=options.ports, protocol=options.protocol)
    return SequencePicture(f"Messages in {name}", modbus_messages(events, timed=log.timed, names=names), [CLIENT])


def _states(
    name: str,
    data: bytes,
    options: RecordingOptions,
    known: tuple[KnownNode, ...],
    device: Device | None,
    number: int | None,
) -> StatesPicture:
    if device is None or is_can_recording(data, options.ports):
        station, drives = "node", can_drive_words(read_recording(data), known, options.bus)
        timed = is_timed(data)
    else:
        log, events = replay_log(data, window=options.window, ports=options.ports, protocol=options.protocol)
        station, drives, timed = "unit", modbus_drive_words(events, device), log.timed
    if number is None:
        number = _first_drive(drives)
    if number is None or number not in drives:
        drive = f" of {station} {number}" if number is not None else ""
        raise BarewireError(f"{name}: no status word and no control word{drive} of a CiA 402 drive is in it")
    words = (word if timed else word._replace(at=None) for word in drives[number].kept)
    return StatesPicture(words, f"{station} {number}")


def _first_drive(drives: dict[int, DriveWords]) -> int | None:
    """Return the number of the first drive with a status word, else of the first; None if there is none."""
    with_status = (number for number, words in drives.items() if any(word.kind == "status" for word in words.kept))
    return next(with_status, next(iter(drives), None))
