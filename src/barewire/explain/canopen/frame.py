"""A CAN frame as CANopen reads it: first whose identifier it is, then what the service makes of the bytes.

        605#4041600000000000       605h = 600h + node 5: an SDO request
        85#...  emergency of node 5        705#05  node 5 is operational        000#0105  start node 5

The identifier is no byte of the data, so its field has length 0: offsets count the data. Which side speaks is in the
identifier too: a role that the caller claims is not needed, and not used.

An identifier outside the predefined connection set is no fault: PDOs may be configured to any free one. What a PDO
carries is known to who knows the node: with `pdos` its objects are fields, by name, and so are those of SDO.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from barewire.canopen.cob_ids import Service, classify
from barewire.canopen.emcy.message import Emergency, error_text, register_names
from barewire.canopen.frame import DATA_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.canopen.nmt.heartbeat import STATE_BYTE, NodeState
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NmtState
from barewire.canopen.pdo.mapping import MappedObject, PdoMapping
from barewire.canopen.sdo.messages.block import LAST
from barewire.canopen.sync import SyncMessage
from barewire.canopen.time_stamp import TimeStamp
from barewire.codecs import Field, Layout
from barewire.errors import DecodeError
from barewire.explain.canopen.lss import explain_lss
from barewire.explain.canopen.sdo import explain_sdo, with_object_names
from barewire.explain.result import (
    ExplainedField,
    Explanation,
    Problem,
    Role,
    as_problem,
    counted,
    explained_fields,
    fill_gaps,
)

if TYPE_CHECKING:
    from barewire.explain.can_monitor.pdos import PdoTracker

# How many bytes each service has by the standard; None for "up to eight", which is everybody's limit.
LENGTHS: dict[str, tuple[int, ...]] = {
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
ROLES: dict[str, Role] = {
    "SDO request": "request",
    "SDO answer": "response",
    "LSS request": "request",
    "LSS answer": "response",
}
COMMANDS = {command.value: command.name.lower().replace("_", " ") for command in NmtCommand}
TIME = Layout("<IH", "milliseconds", "days")

Found = tuple[list[Field], DecodeError | None, str]
"""The fields, the fault if there is one, and the summary."""


def explain_can(frame: AnyFrame, pdos: PdoTracker | None = None) -> Explanation:
    """One CAN frame.

    >>> print(*explain_can(CanFrame.parse("585#4B41600037060000")).lines()[2:], sep="\\n")
    1  41 60  index      6041h         device profile
    3  00     sub-index  0
    4  37 06  data       0637h (1591)  u16 1591
    6  00 00  unused
    valid: SDO answer from node 5: initiate upload, 6041h:00, 2 bytes: 0637h
    """
    if not isinstance(frame, CanFrame):
        return _foreign(frame)
    owner = None if pdos is None or frame.remote else pdos.owner(frame)
    if pdos is not None and owner is not None and owner[2] is not None:
        return _process_data(frame, pdos, owner[0], owner[1], owner[2])
    whose = classify(frame)
    title = _title(frame, whose)
    name = whose[0].name if whose else ""
    if frame.remote:
        fields, error, said = _remote(frame, name)
    elif whose is None:
        fields, error, said = _raw(frame.data)
    else:
        fields, error, said = _data(frame, *whose)
        if pdos is not None and name.startswith("SDO"):
            fields, said = with_object_names(
                fields, said, frame.data, lambda index, sub: pdos.object(whose[1], index, sub)
            )
    fault = _length(frame, name) or as_problem(error)
    start = ExplainedField(0, 0, "COB-ID", str(frame).partition("#")[0], frame.id, title)
    shown = (start, *explained_fields(fill_gaps(fields, len(frame.data)), frame.data))
    return Explanation("can", ROLES.get(name), shown, fault, f"{title}: {said}" if said else title)


def explain_segment(frame: CanFrame) -> Explanation:
    """The same for a segment of a block transfer, which only who has heard the transfer begin can know.

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
    said = f"segment {data[0] & ~LAST} of a block{', the last' if last else ''}"
    return Explanation(
        "can", None, (start, *explained_fields(fields, data)), _length(frame, "SDO request"), f"{title}: {said}"
    )


def _foreign(frame: FdFrame | ErrorFrame) -> Explanation:
    """What classical CANopen neither sends nor understands: CAN FD, and the reports of a controller."""
    fields, _, counting = _raw(frame.data)
    if isinstance(frame, FdFrame):
        name, digits, number = "identifier", str(frame).partition("#")[0], frame.id
        title = f"CAN FD frame, which classical CANopen does not have: {counting}"
    else:
        name, digits, number = "classes", f"{frame.classes:08X}", frame.classes
        title = f"error frame, a report of the controller: {error_frame_text(frame)}"
    start = ExplainedField(0, 0, name, digits, number, "" if isinstance(frame, FdFrame) else frame.text)
    return Explanation("can", None, (start, *explained_fields(fields, frame.data)), None, title)


def _process_data(frame: CanFrame, pdos: PdoTracker, node: int, name: str, mapping: PdoMapping) -> Explanation:
    """A PDO of a node that is known: a field for each object, or for those that share a byte."""
    title = f"{name} {'from' if name.startswith('T') else 'to'} node {node}"
    data, fields, error, said = frame.data, list[Field](), None, counted(len(frame.data))
    if len(data) < mapping.size:
        error = DecodeError("short", data, len(data), f"{mapping.size} bytes are mapped, here are {len(data)}")
    else:
        values, texts = pdos.unpack(node, mapping, data[: mapping.size])
        words = dict(zip(values, (text.partition(" = ")[2] for text in texts)))
        said = ", ".join(texts) or said
        fields = _mapped_fields(mapping, data, words)
        if len(data) > mapping.size:
            error = DecodeError("long", data, mapping.size, f"{mapping.size} bytes are mapped, here are {len(data)}")
    start = ExplainedField(0, 0, "COB-ID", str(frame).partition("#")[0], frame.id, title)
    shown = (start, *explained_fields(fill_gaps(fields, len(data), "process data"), data))
    return Explanation("can", None, shown, as_problem(error), f"{title}: {said}")


def _mapped_fields(mapping: PdoMapping, data: bytes, words: Mapping[str, str]) -> list[Field]:
    fields, begin, end, held = list[Field](), 0, 0, list[MappedObject]()
    for place, entry in enumerate(mapping.entries, start=1):
        held.append(entry)
        end += entry.bits
        if end % 8 and place < len(mapping.entries):
            continue
        first, behind = begin // 8, (end + 7) // 8
        names = ", ".join("unused" if one.is_dummy else one.name for one in held)
        meaning = ", ".join(words[one.name] for one in held if one.name in words)
        if behind > first:
            fields.append(Field(first, behind - first, names, int.from_bytes(data[first:behind], "little"), meaning))
        begin, held = end, []
    return fields


def _title(frame: CanFrame, whose: tuple[Service, int] | None) -> str:
    """Whose identifier it is."""
    if frame.extended:
        return "extended identifier: none of CANopen's own"
    if whose is None:
        return "not in the predefined connection set"
    service, node = whose
    if service.broadcast:
        return service.name
    if service.name == "error control" and frame.remote:
        return f"node guarding of node {node}"
    return f"{service.name} {'from' if service.from_device else 'to'} node {node}"


def _length(frame: CanFrame, name: str) -> Problem | None:
    """Too few or too many bytes for the service: said first, because it makes the rest doubtful."""
    size = len(frame.data)
    if size > DATA_MAX:
        return Problem("long", DATA_MAX, f"a CAN frame carries at most {DATA_MAX} bytes, here are {size}")
    expected = LENGTHS.get(name)
    if expected is None or frame.remote or size in expected:
        return None
    wanted = " or ".join(map(str, expected))
    text = f"{name} has {wanted} byte{'' if expected[-1] == 1 else 's'}, here are {size}"
    return Problem("short", size, text) if size < expected[-1] else Problem("long", expected[-1], text)


def _raw(data: bytes) -> Found:
    digits = data.hex(" ").upper()
    return ([Field(0, len(data), "data", digits)] if data else []), None, counted(len(data))


def _remote(frame: CanFrame, name: str) -> Found:
    """A remote frame asks the owner of the identifier to send."""
    if name == "error control":
        return [], None, "a remote frame asks for its state"
    if name.startswith("TPDO") or not name:
        return [], None, f"a remote frame asks for {counted(frame.requested)}"
    return [], DecodeError("mismatch", frame.data, 0, f"a remote frame, which {name} does not have"), ""


def _data(frame: CanFrame, service: Service, node: int) -> Found:
    """The bytes, as the service lays them out."""
    data = frame.data
    match service.name:
        case "SDO request" | "SDO answer":
            return explain_sdo(data, ROLES[service.name])
        case "LSS request" | "LSS answer":
            return explain_lss(data, ROLES[service.name])
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
    """The fields of a little-endian layout, as far as the bytes go."""
    found = []
    for field in layout.fields(data):
        part = data[field.offset : field.offset + field.length]
        is_number = field.name != layout.tail
        found.append(field._replace(value=int.from_bytes(part, "little")) if is_number else field)
    return fill_gaps(found, len(data), layout.names[len(found)] if len(found) < len(layout.names) else "")


def _nmt(frame: CanFrame) -> Found:
    fields = []
    for field in _cut(NmtMessage.layout, frame.data):
        words = field.meaning
        if field.name == "command":
            words = COMMANDS.get(frame.data[0], "no NMT command")
        elif field.name == "node" and isinstance(field.value, int):
            words = f"node {field.value}" if field.value else "all nodes"
        fields.append(field._replace(meaning=words))
    try:
        NmtMessage.decode(frame)
    except DecodeError as error:
        return fields, error, ""
    return fields, None, ", ".join(field.meaning for field in fields)


def _sync(frame: CanFrame) -> Found:
    fields = [Field(0, 1, "counter", frame.data[0]) for _ in frame.data[:1]]
    try:
        message = SyncMessage.decode(frame)
    except DecodeError as error:
        return fields, error, ""
    return fields, None, "" if message.counter is None else f"number {message.counter}"


def _emergency(data: bytes) -> Found:
    names = {"code": "error code", "register": "error register", "info": "manufacturer"}
    fields = []
    said = ""
    for field in _cut(Emergency.layout, data):
        words = field.meaning
        if field.name == "code" and isinstance(field.value, int):
            words = error_text(field.value)
            said = f"{field.value:04X}h {words}"
        elif field.name == "register" and isinstance(field.value, int):
            words = ", ".join(register_names(field.value)) or "no error left"
        fields.append(field._replace(name=names.get(field.name, field.name), meaning=words))
    return fields, None, said


def _time(frame: CanFrame) -> Found:
    fields = _cut(TIME, frame.data)
    try:
        moment = TimeStamp.decode(frame).moment.datetime
    except DecodeError as error:
        return fields, error if error.reason == "value" else None, ""
    fields[0] = fields[0]._replace(meaning=f"since midnight: {moment:%H:%M:%S}.{moment.microsecond // 1000:03}")
    fields[1] = fields[1]._replace(meaning=f"since 1984-01-01: {moment:%Y-%m-%d}")
    return fields, None, f"{moment:%Y-%m-%d %H:%M:%S}"


def _state(data: bytes, node: int) -> Found:
    if not data:
        return [], DecodeError("short", data, 0, "the state is byte 0, but there are none"), ""
    bits = STATE_BYTE.decode(data[0])
    state = NodeState(node, bits["s"], bool(bits["t"]))
    words = "boot-up" if state.is_boot_up else state.name
    meaning = f"{words}; toggle bit {bits['t']}" + (": the answer to node guarding" if bits["t"] else "")
    error = None
    if state.state not in tuple(NmtState):
        error = DecodeError("value", data, 0, f"{state.state:02X}h is no state: expected 00, 04, 05 or 7F")
    return [Field(0, 1, "state", data[0], meaning)], error, words


_OVERRUN, _CONTROLLER = 0x01, 0x04
_CONTROLLER_WORDS = (
    *("receive buffer overrun", "transmit buffer overrun", "many receive errors", "many transmit errors"),
    *("error passive (receiving)", "error passive (sending)", "error active again"),
)


def error_frame_text(frame: ErrorFrame) -> str:
    """An error frame of SocketCAN in words.

    >>> error_frame_text(ErrorFrame(0x04, bytes.fromhex("0001000000000000")))
    'controller problem: receive buffer overrun'
    """
    words = frame.text
    if frame.classes & _CONTROLLER and len(frame.data) > 1:
        told = [text for bit, text in enumerate(_CONTROLLER_WORDS) if frame.data[1] >> bit & 1]
        words += f": {', '.join(told)}" if told else ""
    return words


def is_overrun(frame: ErrorFrame) -> bool:
    """Whether the controller of the recorder says that it has lost frames.

    >>> is_overrun(ErrorFrame(0x04, b"\\0\\1")), is_overrun(ErrorFrame(0x40))
    (True, False)
    """
    return bool(frame.classes & _CONTROLLER and frame.data[1:2] and frame.data[1] & _OVERRUN)
