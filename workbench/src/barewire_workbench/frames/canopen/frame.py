"""A CAN frame, field by field: the identifier gives the service and the node, the service the layout of the bytes.

        605#4041600000000000       605h = 600h + node 5: an SDO request
        85#...  emergency of node 5        705#05  node 5 is operational        000#0105  start node 5

Offsets count bytes of the data, so the field of the identifier has length 0. The identifier also gives the direction,
so no role is needed. An identifier outside the predefined connection set is not a fault: PDOs may be configured to any
free identifier. With `pdos`, the descriptions of the nodes, the objects of PDOs and SDOs have names and values.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from barewire.canopen.cob_ids import CobService, classify
from barewire.canopen.emcy import Emergency, error_text, register_names
from barewire.canopen.frame import DATA_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.canopen.nmt.heartbeat import STATE_BYTE, NodeState
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NmtState
from barewire.canopen.pdo.mapping import MappedObject, PdoMapping
from barewire.canopen.sdo.messages import LAST
from barewire.canopen.sync import SyncMessage
from barewire.canopen.time_stamp import TimeStamp
from barewire.codecs import Field, Layout
from barewire.errors import DecodeError
from barewire_workbench.frames.canopen.lss import explain_lss
from barewire_workbench.frames.canopen.sdo import explain_sdo, with_object_names
from barewire_workbench.frames.result import (
    ExplainedField,
    Explanation,
    FrameRole,
    Problem,
    as_problem,
    counted,
    explained_fields,
    fill_gaps,
)

if TYPE_CHECKING:
    from barewire.codecs import Value
    from barewire_workbench.frames.canopen.known_node import KnownObject

# The lengths that the standard gives a service; the others may have up to eight bytes.
_LENGTHS: dict[str, tuple[int, ...]] = {
    "NMT": (2,),
    "SYNC": (0, 1),
    "EMCY": (8,),
    "TIME": (6,),
    "SDO request": (8,),
    "SDO answer": (8,),
    "error control": (1,),
    "LSS request": (8,),
    "LSS answer": (8,),
}
_ROLES: dict[str, FrameRole] = {
    "SDO request": "request",
    "SDO answer": "response",
    "LSS request": "request",
    "LSS answer": "response",
}
_COMMANDS = {command.value: command.name.lower().replace("_", " ") for command in NmtCommand}
_TIME = Layout("<IH", "milliseconds", "days")

_Parts = tuple[list[Field], DecodeError | None, str]
"""The fields, the error if there is one, and the summary."""


class PdoDescriptions(Protocol):
    """The PDOs and objects of nodes that have a description."""

    def owner(self, frame: CanFrame) -> tuple[int, str, PdoMapping | None] | None:
        """Return node, name and mapping of the PDO with this identifier; None if it is not a known PDO."""

    def unpack(self, node: int, mapping: PdoMapping, data: bytes) -> tuple[dict[str, Value], tuple[str, ...]]:
        """Return the values by name, and each as text with its name."""

    def object(self, node: int, index: int, sub: int) -> KnownObject | None:
        """Return an object of a node; None if it is not known."""


def explain_can(frame: AnyFrame, pdos: PdoDescriptions | None = None) -> Explanation:
    """Explain one CAN frame.

    >>> print(*explain_can(CanFrame.parse("585#4B41600037060000")).lines()[2:], sep="\\n")
    1  41 60  index      6041h         device profile
    3  00     sub-index  0
    4  37 06  data       0637h (1591)  u16 1591
    6  00 00  unused
    valid: SDO answer from node 5: initiate upload, 6041h:00, 2 bytes: 0637h
    """
    if not isinstance(frame, CanFrame):
        return _not_classical(frame)
    owner = None if pdos is None or frame.remote else pdos.owner(frame)
    if pdos is not None and owner is not None and owner[2] is not None:
        return _process_data(frame, pdos, owner[0], owner[1], owner[2])
    sender = classify(frame)
    title = _title(frame, sender)
    name = sender[0].name if sender else ""
    if frame.remote:
        fields, error, summary = _remote(frame, name)
    elif sender is None:
        fields, error, summary = _raw(frame.data)
    else:
        fields, error, summary = _data(frame, *sender)
        if pdos is not None and name.startswith("SDO"):
            fields, summary = with_object_names(
                fields, summary, frame.data, lambda index, sub: pdos.object(sender[1], index, sub)
            )
    fault = _length(frame, name) or as_problem(error)
    start = ExplainedField(0, 0, "COB-ID", str(frame).partition("#")[0], frame.id, title)
    shown = (start, *explained_fields(fill_gaps(fields, len(frame.data)), frame.data))
    return Explanation("can", _ROLES.get(name), shown, fault, f"{title}: {summary}" if summary else title)


def explain_segment(frame: CanFrame) -> Explanation:
    """Explain a frame as a segment of a block transfer; only the frames before it show that it is one.

    >>> explain_segment(CanFrame.parse("605#8200010203040506")).verdict
    'valid: SDO request to node 5: segment 2 of a block, the last'
    """
    data = frame.data
    title = _title(frame, classify(frame))
    last = bool(data[0] & LAST)
    fields = [Field(0, 1, "sequence", data[0], f"segment {data[0] & ~LAST}{', the last' if last else ''}")]
    if len(data) > 1:
        fields.append(Field(1, len(data) - 1, "data", data[1:].hex(" ").upper()))
    start = ExplainedField(0, 0, "COB-ID", str(frame).partition("#")[0], frame.id, title)
    summary = f"segment {data[0] & ~LAST} of a block{', the last' if last else ''}"
    return Explanation(
        "can", None, (start, *explained_fields(fields, data)), _length(frame, "SDO request"), f"{title}: {summary}"
    )


def _not_classical(frame: FdFrame | ErrorFrame) -> Explanation:
    """Explain an item that is not a classical CAN frame: CAN FD, or a report of the controller."""
    fields, _, counting = _raw(frame.data)
    if isinstance(frame, FdFrame):
        name, digits, number = "identifier", str(frame).partition("#")[0], frame.id
        title = f"CAN FD frame, which classical CANopen does not have: {counting}"
    else:
        name, digits, number = "classes", f"{frame.classes:08X}", frame.classes
        title = f"error frame, a report of the controller: {error_frame_text(frame)}"
        if frame.counters is not None:
            transmit, receive = frame.counters
            fields = [
                *_raw(frame.data[:6])[0],
                Field(6, 1, "transmit errors", transmit),
                Field(7, 1, "receive errors", receive),
            ]
    start = ExplainedField(0, 0, name, digits, number, "" if isinstance(frame, FdFrame) else frame.text)
    return Explanation("can", None, (start, *explained_fields(fields, frame.data)), None, title)


def _process_data(frame: CanFrame, pdos: PdoDescriptions, node: int, name: str, mapping: PdoMapping) -> Explanation:
    """Explain a PDO of a known node: a field for each object, or for the objects that share a byte."""
    title = f"{name} {'from' if name.startswith('T') else 'to'} node {node}"
    data, fields, error, summary = frame.data, list[Field](), None, counted(len(frame.data))
    if len(data) < mapping.size:
        error = DecodeError("short", data, len(data), f"{mapping.size} bytes are mapped, got {len(data)}")
    else:
        values, texts = pdos.unpack(node, mapping, data[: mapping.size])
        texts_by_name = dict(zip(values, (text.partition(" = ")[2] for text in texts)))
        summary = ", ".join(texts) or summary
        fields = _mapped_fields(mapping, data, texts_by_name)
        if len(data) > mapping.size:
            error = DecodeError("long", data, mapping.size, f"{mapping.size} bytes are mapped, got {len(data)}")
    start = ExplainedField(0, 0, "COB-ID", str(frame).partition("#")[0], frame.id, title)
    shown = (start, *explained_fields(fill_gaps(fields, len(data), "process data"), data))
    return Explanation("can", None, shown, as_problem(error), f"{title}: {summary}")


def _mapped_fields(mapping: PdoMapping, data: bytes, texts: Mapping[str, str]) -> list[Field]:
    fields, begin, end, held = list[Field](), 0, 0, list[MappedObject]()
    for number, entry in enumerate(mapping.entries, start=1):
        held.append(entry)
        end += entry.bits
        if end % 8 and number < len(mapping.entries):
            continue
        first, stop = begin // 8, (end + 7) // 8
        names = ", ".join("unused" if item.is_dummy else item.name for item in held)
        meaning = ", ".join(texts[item.name] for item in held if item.name in texts)
        if stop > first:
            fields.append(Field(first, stop - first, names, int.from_bytes(data[first:stop], "little"), meaning))
        begin, held = end, []
    return fields


def _title(frame: CanFrame, owner: tuple[CobService, int] | None) -> str:
    """Return the service and the node of an identifier."""
    if frame.extended:
        return "extended identifier, which CANopen does not predefine"
    if owner is None:
        return "not in the predefined connection set"
    service, node = owner
    if service.broadcast:
        return service.name
    if service.name == "error control" and frame.remote:
        return f"node guarding of node {node}"
    return f"{service.name} {'from' if service.from_device else 'to'} node {node}"


def _length(frame: CanFrame, name: str) -> Problem | None:
    """Return the error of a frame with too few or too many bytes for its service; other errors are doubtful then."""
    size = len(frame.data)
    if size > DATA_MAX:
        return Problem("long", DATA_MAX, f"a CAN frame carries at most {DATA_MAX} bytes, got {size}")
    expected = _LENGTHS.get(name)
    if expected is None or frame.remote or size in expected:
        return None
    wanted = " or ".join(map(str, expected))
    text = f"{name} has {wanted} byte{'' if expected[-1] == 1 else 's'}, got {size}"
    return Problem("short", size, text) if size < expected[-1] else Problem("long", expected[-1], text)


def _raw(data: bytes) -> _Parts:
    digits = data.hex(" ").upper()
    return ([Field(0, len(data), "data", digits)] if data else []), None, counted(len(data))


def _remote(frame: CanFrame, name: str) -> _Parts:
    """Return the parts of a remote frame, which requests data from the owner of the identifier."""
    if name == "error control":
        return [], None, "a remote frame requests its state"
    if name.startswith("TPDO") or not name:
        return [], None, f"a remote frame requests {counted(frame.requested)}"
    return [], DecodeError("mismatch", frame.data, 0, f"a remote frame, which {name} does not have"), ""


def _data(frame: CanFrame, service: CobService, node: int) -> _Parts:
    """Return the fields of the service."""
    data = frame.data
    match service.name:
        case "SDO request" | "SDO answer":
            return explain_sdo(data, _ROLES[service.name])
        case "LSS request" | "LSS answer":
            return explain_lss(data, _ROLES[service.name])
        case "NMT":
            return _nmt(frame)
        case "SYNC":
            return _sync(frame)
        case "EMCY":
            return _emergency(data)
        case "TIME":
            return _time(frame)
        case "error control":
            return _state(data, node)
    return [Field(0, len(data), "process data", data.hex(" ").upper())] if data else [], None, counted(len(data))


def _cut(layout: Layout, data: bytes) -> list[Field]:
    """Return the fields of a little-endian layout, as far as there are bytes."""
    found = []
    for field in layout.fields(data):
        part = data[field.offset : field.offset + field.length]
        is_number = field.name != layout.tail
        found.append(field._replace(value=int.from_bytes(part, "little")) if is_number else field)
    return fill_gaps(found, len(data), layout.names[len(found)] if len(found) < len(layout.names) else "")


def _nmt(frame: CanFrame) -> _Parts:
    fields = []
    for field in _cut(NmtMessage.layout, frame.data):
        meaning = field.meaning
        if field.name == "command":
            meaning = _COMMANDS.get(frame.data[0], "not an NMT command")
        elif field.name == "node" and isinstance(field.value, int):
            meaning = f"node {field.value}" if field.value else "all nodes"
        fields.append(field._replace(meaning=meaning))
    try:
        NmtMessage.decode(frame)
    except DecodeError as error:
        return fields, error, ""
    return fields, None, ", ".join(field.meaning for field in fields)


def _sync(frame: CanFrame) -> _Parts:
    fields = [Field(0, 1, "counter", frame.data[0]) for _ in frame.data[:1]]
    try:
        message = SyncMessage.decode(frame)
    except DecodeError as error:
        return fields, error, ""
    return fields, None, "" if message.counter is None else f"number {message.counter}"


def _emergency(data: bytes) -> _Parts:
    names = {"code": "error code", "register": "error register", "info": "manufacturer"}
    fields = []
    summary = ""
    for field in _cut(Emergency.layout, data):
        meaning = field.meaning
        if field.name == "code" and isinstance(field.value, int):
            meaning = error_text(field.value)
            summary = f"{field.value:04X}h {meaning}"
        elif field.name == "register" and isinstance(field.value, int):
            meaning = ", ".join(register_names(field.value)) or "no error left"
        fields.append(field._replace(name=names.get(field.name, field.name), meaning=meaning))
    return fields, None, summary


def _time(frame: CanFrame) -> _Parts:
    fields = _cut(_TIME, frame.data)
    try:
        moment = TimeStamp.decode(frame).moment.datetime
    except DecodeError as error:
        return fields, error if error.reason == "value" else None, ""
    fields[0] = fields[0]._replace(meaning=f"since midnight: {moment:%H:%M:%S}.{moment.microsecond // 1000:03}")
    fields[1] = fields[1]._replace(meaning=f"since 1984-01-01: {moment:%Y-%m-%d}")
    return fields, None, f"{moment:%Y-%m-%d %H:%M:%S}"


def _state(data: bytes, node: int) -> _Parts:
    if not data:
        return [], DecodeError("short", data, 0, "the state is byte 0, but the frame is empty"), ""
    bits = STATE_BYTE.decode(data[0])
    state = NodeState(node, bits["s"], bool(bits["t"]))
    name = "boot-up" if state.is_boot_up else state.name
    meaning = f"{name}; toggle bit {bits['t']}" + (": the answer to node guarding" if bits["t"] else "")
    error = None
    if state.state not in tuple(NmtState):
        error = DecodeError("value", data, 0, f"{state.state:02X}h is not a state: expected 00, 04, 05 or 7F")
    return [Field(0, 1, "state", data[0], meaning)], error, name


_OVERRUN, _CONTROLLER = 0x01, 0x04
_CONTROLLER_TEXTS = (
    *("receive buffer overrun", "transmit buffer overrun", "many receive errors", "many transmit errors"),
    *("error passive (receiving)", "error passive (sending)", "error active again"),
)


def error_frame_text(frame: ErrorFrame) -> str:
    """Return the text of an error frame of SocketCAN.

    >>> error_frame_text(ErrorFrame(0x04, bytes.fromhex("0001000000000000")))
    'controller problem: receive buffer overrun'
    """
    text = frame.text
    if frame.classes & _CONTROLLER and len(frame.data) > 1:
        states = [text for bit, text in enumerate(_CONTROLLER_TEXTS) if frame.data[1] >> bit & 1]
        text += f": {', '.join(states)}" if states else ""
    return text


def is_overrun(frame: ErrorFrame) -> bool:
    """Return whether the recording controller reports that it lost frames.

    >>> is_overrun(ErrorFrame(0x04, b"\\0\\1")), is_overrun(ErrorFrame(0x40))
    (True, False)
    """
    return bool(frame.classes & _CONTROLLER and frame.data[1:2] and frame.data[1] & _OVERRUN)
