"""A CAN frame, field by field: the identifier gives the service and the node, the service the layout of the bytes.

        605#4041600000000000       605h = 600h + node 5: an SDO request
        085#...  emergency of node 5        705#05  node 5 is operational        000#0105  start node 5

Offsets count bytes of the data, so the field of the identifier has length 0. The identifier also gives the direction,
so no role is needed. An identifier outside the predefined connection set is not a fault: PDOs may be configured to any
free identifier. With `pdos`, the descriptions of the nodes, the objects of PDOs and SDOs have names and values.

In an SDO frame byte 0 determines the meaning of the other seven:

        605h  | 2B | 40 60 | 00 | 0F 00 | 00 00 |         001- nnes    initiate download, ccs 1, n 2, e 1, s 1
                command index sub  data    unused

The same byte has different meanings in the two directions, so there are two tables. **Inside a block transfer** byte 0
from 01h to 7Fh, with bit 7 set for the last, is the number of a segment; only the frames before show that. Here every
frame is explained alone: as a segment only if its byte 0 is no command.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple, Protocol

from barewire.canopen.abort_codes import abort_text
from barewire.canopen.cob_ids import CobService, classify
from barewire.canopen.emcy import Emergency, error_text, register_names
from barewire.canopen.frame import DATA_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.canopen.lss.messages import (
    AUTOMATIC_BIT_RATE,
    BEGIN,
    LSS_ANSWERS,
    LSS_BIT_RATES,
    LSS_REQUESTS,
    UNCONFIGURED,
    Fastscan,
    LssAddress,
    LssService,
    LssState,
)
from barewire.canopen.nmt.messages import STATE_BYTE, NmtCommand, NmtMessage, NmtState, NodeState
from barewire.canopen.pdo.mapping import MappedObject, PdoMapping
from barewire.canopen.sdo.messages import LAST, Abort, InitiateUpload, has_reserved_bits
from barewire.canopen.sync import SyncMessage
from barewire.canopen.time_stamp import TimeStamp
from barewire.codecs import BitPattern, Field, Layout, codec
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import DecodeError
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
    from barewire_workbench.frames.known_node import KnownObject, KnownPdo


# LSS ----------------------------------------------------------------------------------------------------------------


_PARTS = {"vendor": "vendor-ID", "product": "product code", "revision": "revision", "serial": "serial number"}
"""The four numbers of an LSS address: field of `LssAddress` -> name in the standard."""

_PART = {number: _PARTS[name] for number, name in enumerate(LssAddress._fields)}
_LIMITS = (_PART[0], _PART[1], _PART[2], _PART[2], _PART[3], _PART[3])
_RESULT = Layout("<BB", "result", "details")
_NUMBER = {name: Layout("<I", name) for name in _PARTS.values()}

_TITLES: dict[LssService, str] = {
    LssService.SWITCH_GLOBAL: "switch state global",
    LssService.CONFIGURE_NODE: "configure node-ID",
    LssService.CONFIGURE_BIT_TIMING: "configure bit timing",
    LssService.ACTIVATE_BIT_TIMING: "activate bit timing",
    LssService.STORE: "store configuration",
    **{LssService(LssService.SELECT_VENDOR + k): f"switch state selective: {name}" for k, name in _PART.items()},
    LssService.SELECTED: "switch state selective: selected",
    LssService.IDENTIFY_VENDOR: "identify device: vendor-ID",
    LssService.IDENTIFY_PRODUCT: "identify device: product code",
    LssService.IDENTIFY_REVISION_LOW: "identify device: revision, lowest",
    LssService.IDENTIFY_REVISION_HIGH: "identify device: revision, highest",
    LssService.IDENTIFY_SERIAL_LOW: "identify device: serial number, lowest",
    LssService.IDENTIFY_SERIAL_HIGH: "identify device: serial number, highest",
    LssService.IDENTIFY_UNCONFIGURED: "identify devices without a node-ID",
    LssService.IDENTIFIED: "identify device: identified",
    LssService.UNCONFIGURED_IDENTIFIED: "identify devices without a node-ID: identified",
    LssService.FASTSCAN: "fastscan",
    **{LssService(LssService.INQUIRE_VENDOR + k): f"inquire {name}" for k, name in _PART.items()},
    LssService.INQUIRE_NODE: "inquire node-ID",
}
_SCAN = Layout("<IBBB", "number", "bit check", "LSS sub", "LSS next")
assert _SCAN.size == Fastscan.layout.size

_REQUEST_LAYOUTS: dict[LssService, Layout] = {
    LssService.SWITCH_GLOBAL: Layout("<B", "mode"),
    LssService.CONFIGURE_NODE: Layout("<B", "node-ID"),
    LssService.CONFIGURE_BIT_TIMING: Layout("<BB", "table", "entry"),
    LssService.ACTIVATE_BIT_TIMING: Layout("<H", "delay"),
    **{LssService(LssService.SELECT_VENDOR + k): _NUMBER[name] for k, name in _PART.items()},
    **{LssService(LssService.IDENTIFY_VENDOR + k): _NUMBER[name] for k, name in enumerate(_LIMITS)},
    LssService.FASTSCAN: _SCAN,
}
_RESPONSE_LAYOUTS: dict[LssService, Layout] = {
    LssService.CONFIGURE_NODE: _RESULT,
    LssService.CONFIGURE_BIT_TIMING: _RESULT,
    LssService.STORE: _RESULT,
    **{LssService(LssService.INQUIRE_VENDOR + k): _NUMBER[name] for k, name in _PART.items()},
    LssService.INQUIRE_NODE: Layout("<B", "node-ID"),
}


def explain_lss(data: bytes, role: FrameRole) -> tuple[list[Field], DecodeError | None, str]:
    """Return fields, error and summary of an LSS frame. Never raises.

    >>> explain_lss(bytes.fromhex("1105000000000000"), "request")[2]
    'configure node-ID'
    """
    if not data:
        return [], DecodeError("short", data, 0, "the service is byte 0, but the frame is empty"), ""
    if data[0] not in (LSS_REQUESTS if role == "request" else LSS_ANSWERS):
        error = DecodeError("function", data, 0, f"{data[0]:02X}h is not a service of an LSS {role}")
        return fill_gaps([Field(0, 1, "service", data[0], "unknown")], len(data)), error, "unknown service"
    service = LssService(data[0])
    title = _TITLES[service]
    fields = [Field(0, 1, "service", data[0], title)]
    layout = (_REQUEST_LAYOUTS if role == "request" else _RESPONSE_LAYOUTS).get(service)
    end = 1
    for field in [] if layout is None else layout.fields(data[1:], 1):
        value = int.from_bytes(data[field.offset : field.offset + field.length], "little")
        fields.append(field._replace(value=value, meaning=_value_text(service, field.name, value)))
        end = field.offset + field.length
    if layout is not None and end < 1 + layout.size:
        missing = layout.names[len(fields) - 1]
        return fill_gaps(fields, len(data), missing), None, title
    if end < len(data):
        fields.append(Field(end, len(data) - end, "reserved", data[end:].hex(" ").upper()))
    return fields, None, title


def _value_text(service: LssService, name: str, value: int) -> str:
    match name:
        case "mode":
            return LssState(value).name.lower() if value in tuple(LssState) else "not defined"
        case "node-ID":
            return "no node-ID yet" if value == UNCONFIGURED else "" if 1 <= value <= 127 else "expected 1..127"
        case "result":
            return {0: "done", 0xFF: "failed, see details"}.get(value, "refused")
        case "delay":
            return "ms before the change, and the same again after it"
        case "entry" if value in LSS_BIT_RATES:
            return f"{LSS_BIT_RATES[value] // 1000} kbit/s"
        case "entry":
            return "detected by the device" if value == AUTOMATIC_BIT_RATE else "reserved"
        case "bit check" if value == BEGIN:
            return "the start: all devices without a node-ID answer"
        case "LSS sub" | "LSS next" if value in _PART:
            return _PART[value]
    return ""


# SDO ----------------------------------------------------------------------------------------------------------------


_SDO_LENGTH = 8
_Layout = Callable[[bytes, dict[str, int]], list[Field]]
"""Returns the fields of bytes 1 to 7, given the frame and the bits of its command byte."""

_AREAS = (
    (0x0001, 0x0FFF, "data types"),
    (0x1000, 0x1FFF, "communication profile"),
    (0x2000, 0x5FFF, "manufacturer-specific"),
    (0x6000, 0x9FFF, "device profile"),
    (0xA000, 0xBFFF, "interface profile"),
)


class ExplainedSdo(NamedTuple):
    """One SDO frame explained."""

    fields: list[Field]
    error: DecodeError | None
    summary: str


class CommandRow(NamedTuple):
    """One command: the bits of byte 0, its name, and the layout of the other seven bytes."""

    pattern: BitPattern
    name: str
    layout: _Layout


def _number(data: bytes, offset: int, length: int, name: str, meaning: str = "") -> list[Field]:
    """Return one little-endian number, if all its bytes are present."""
    part = data[offset : offset + length]
    return [Field(offset, length, name, int.from_bytes(part, "little"), meaning)] if len(part) == length else []


def _object(data: bytes) -> list[Field]:
    index = int.from_bytes(data[1:3], "little")
    area = next((name for first, last, name in _AREAS if first <= index <= last), "reserved")
    return _number(data, 1, 2, "index", area) + _number(data, 3, 1, "sub-index")


def _reserved(data: bytes, start: int) -> list[Field]:
    """Return the reserved bytes from `start` on."""
    rest = data[start:_SDO_LENGTH]
    meaning = "" if not any(rest) else "should be 0"
    return [Field(start, len(rest), "reserved", rest.hex(" ").upper(), meaning)] if rest else []


def _only_object(data: bytes, bits: dict[str, int]) -> list[Field]:
    return _object(data) + _reserved(data, 4)


def _nothing(data: bytes, bits: dict[str, int]) -> list[Field]:
    return _reserved(data, 1)


def _sized(data: bytes, bits: dict[str, int]) -> list[Field]:
    """Return a size, if s indicates one."""
    return _object(data) + (_number(data, 4, 4, "size", "bytes") if bits["s"] else _reserved(data, 4))


def _value(data: bytes, bits: dict[str, int]) -> list[Field]:
    """Return the value of 1 to 4 bytes, or a size if e is 0."""
    if not bits["e"]:
        return _sized(data, bits)
    size = 4 - bits["n"] if bits["s"] else 4
    meaning = numeric_readings(data[4 : 4 + size])
    if not bits["s"]:
        meaning = f"no size is indicated; all 4 bytes: {meaning}"
    unused = data[4 + size : _SDO_LENGTH]
    fields = _object(data) + _number(data, 4, size, "data", meaning)
    if unused:
        fields.append(Field(4 + size, len(unused), "unused", unused.hex(" ").upper()))
    return fields


def _abort(data: bytes, bits: dict[str, int]) -> list[Field]:
    return _object(data) + _number(data, 4, 4, "abort code", abort_text(int.from_bytes(data[4:8], "little")))


def _segment(data: bytes, bits: dict[str, int]) -> list[Field]:
    """Return up to seven bytes of a value, and the unused last n."""
    end = _SDO_LENGTH - bits["n"]
    fields = [Field(1, len(data[1:end]), "data", data[1:end].hex(" ").upper(), _characters(data[1:end]))]
    if data[end:_SDO_LENGTH]:
        fields.append(Field(end, len(data[end:_SDO_LENGTH]), "unused", data[end:_SDO_LENGTH].hex(" ").upper()))
    return [field for field in fields if field.length]


def _block_accepted(data: bytes, bits: dict[str, int]) -> list[Field]:
    return _object(data) + _number(data, 4, 1, "block size", "segments in a block") + _reserved(data, 5)


def _block_requested(data: bytes, bits: dict[str, int]) -> list[Field]:
    switch = "ordinary upload up to this many bytes" if data[5:6] != b"\0" else "no ordinary upload"
    fields = _object(data) + _number(data, 4, 1, "block size", "segments in a block")
    return fields + _number(data, 5, 1, "protocol switch", switch) + _reserved(data, 6)


def _acknowledged(data: bytes, bits: dict[str, int]) -> list[Field]:
    fields = _number(data, 1, 1, "sequence", "the last segment received in order")
    return fields + _number(data, 2, 1, "block size", "segments in the next block") + _reserved(data, 3)


def _block_end(data: bytes, bits: dict[str, int]) -> list[Field]:
    return _number(data, 1, 2, "CRC", "of the whole value, if both sides use one") + _reserved(data, 3)


_REQUESTS = (
    CommandRow(BitPattern("000t nnnc"), "download segment", _segment),
    CommandRow(BitPattern("001- nnes"), "initiate download", _value),
    CommandRow(BitPattern("010- ----"), "initiate upload", _only_object),
    CommandRow(BitPattern("011t ----"), "upload segment", _nothing),
    CommandRow(Abort.pattern, "abort", _abort),
    CommandRow(BitPattern("101- -c00"), "initiate block upload", _block_requested),
    CommandRow(BitPattern("101- --01"), "end block upload", _nothing),
    CommandRow(BitPattern("101- --10"), "acknowledge block upload", _acknowledged),
    CommandRow(BitPattern("101- --11"), "start block upload", _nothing),
    CommandRow(BitPattern("110- -cs0"), "initiate block download", _sized),
    CommandRow(BitPattern("110n nn-1"), "end block download", _block_end),
)
_RESPONSES = (
    CommandRow(BitPattern("000t nnnc"), "upload segment", _segment),
    CommandRow(BitPattern("001t ----"), "download segment", _nothing),
    CommandRow(BitPattern("010- nnes"), "initiate upload", _value),
    CommandRow(BitPattern("011- ----"), "initiate download", _only_object),
    CommandRow(Abort.pattern, "abort", _abort),
    CommandRow(BitPattern("101- -c00"), "initiate block download", _block_accepted),
    CommandRow(BitPattern("101- --10"), "acknowledge block download", _acknowledged),
    CommandRow(BitPattern("101- --01"), "end block download", _nothing),
    CommandRow(BitPattern("110- -cs0"), "initiate block upload", _sized),
    CommandRow(BitPattern("110n nn-1"), "end block upload", _block_end),
)


def explain_sdo(data: bytes, role: FrameRole) -> ExplainedSdo:
    """Explain the data of an SDO frame. Never raises; `error` holds the fault.

    >>> frame = explain_sdo(bytes.fromhex("4B41600037060000"), "response")
    >>> frame.summary
    'initiate upload, 6041h:00, 2 bytes: 0637h'
    >>> frame.fields[0].meaning
    'initiate upload response: expedited, 2 bytes, size indicated (scs 2, n 2, e 1, s 1)'
    """
    if not data:
        return ExplainedSdo(
            [], DecodeError("short", data, 0, "the command is byte 0, but the frame is empty"), "nothing"
        )
    row = next((row for row in (_REQUESTS if role == "request" else _RESPONSES) if row.pattern.matches(data[0])), None)
    if row is None and len(data) == _SDO_LENGTH:  # byte 0 is neither 00h nor 80h: they are in both tables
        return _only_in_blocks(data, role)
    if row is None:
        fields = [Field(0, 1, "command", data[0], f"not a command of an SDO {role}")]
        error = DecodeError("function", data, 0, f"command {data[0]:02X}h is not a command of an SDO {role}")
        return ExplainedSdo(fill_gaps(fields, len(data)), error, "unknown command")
    bits = row.pattern.decode(data[0])
    name = row.name if row.name == "abort" else f"{row.name} {role}"
    fields = [Field(0, 1, "command", data[0], _command_text(name, row, data[0], role, bits)), *row.layout(data, bits)]
    fields = [field for field in fields if field.offset + field.length <= len(data)]
    return ExplainedSdo(fill_gaps(fields, len(data)), None, _summary(row.name, fields))


def _only_in_blocks(data: bytes, role: FrameRole) -> ExplainedSdo:
    """Explain a frame whose byte 0 is no command. In a block transfer it is a segment: the frame alone does not show
    whether there is one."""
    segment = f"segment {data[0] & 0x7F}{', the last' if data[0] & 0x80 else ''}"
    transfer = f"block {'download' if role == 'request' else 'upload'}"
    meaning = f"no command of an SDO {role}; in a {transfer} {segment}: only the frames before show that"
    fields = [Field(0, 1, "segment", data[0], meaning), *_segment(data, {"n": 0})]
    return ExplainedSdo(fields, None, f"only in a {transfer}: {segment}, 7 bytes")


def with_object_names(
    fields: list[Field], summary: str, data: bytes, find: Callable[[int, int], KnownObject | None]
) -> tuple[list[Field], str]:
    """Return fields and summary of an SDO frame with the object's name and its value as text, if `find` returns one."""
    by_name = {field.name: field for field in fields}
    if "index" not in by_name or "sub-index" not in by_name:
        return fields, summary
    index, sub = by_name["index"].value, by_name["sub-index"].value
    known = find(index, sub) if isinstance(index, int) and isinstance(sub, int) else None
    if known is None:
        return fields, summary
    place = f"{index:04X}h:{sub:02X}"
    summary = summary.replace(place, f"{place} {known.name}", 1)
    meanings = {"index": known.name}
    if (value := by_name.get("data")) is not None:
        read = known.read(data[value.offset : value.offset + value.length])
        if read:
            meanings["data"] = read
            summary += f", {read}"
    return [field._replace(meaning=meanings.get(field.name, field.meaning)) for field in fields], summary


def numeric_readings(data: bytes) -> str:
    """Return 1 to 4 bytes as numbers of that width: the type of the object decides which one applies.

    >>> numeric_readings(bytes.fromhex("CDCC8C3F"))
    'u32 1066192077, f32 1.1'
    >>> numeric_readings(b"\\xfb")
    'u8 251, i8 -5'
    """
    if not 1 <= len(data) <= 4:
        return ""
    bits = 8 * len(data)
    readings = [f"u{bits} {codec(f'u{bits}', 'DCBA').decode(data)}"]
    if data[-1] & 0x80:
        readings.append(f"i{bits} {codec(f'i{bits}', 'DCBA').decode(data)}")
    if len(data) == 4:
        readings.append(f"f32 {codec('f32', 'DCBA').decode(data):.7g}")
    return ", ".join(readings)


def _characters(data: bytes) -> str:
    """Return the bytes as characters, if all of them are printable."""
    return repr(data.decode("ascii")) if data and all(32 <= byte < 127 for byte in data) else ""


def _command_text(name: str, row: CommandRow, command: int, role: FrameRole, bits: dict[str, int]) -> str:
    """Return the name, the meaning of the bits, and the bits."""
    details = []
    if "e" in bits:
        details.append("expedited" if bits["e"] else "in segments")
        if bits["e"] and bits["s"]:
            details.append(counted(4 - bits["n"]))
        details.append("size indicated" if bits["s"] else "size not indicated")
    if "t" in bits:
        details.append(f"toggle bit {bits['t']}")
    if row.layout is _segment:
        details.append(counted(7 - bits["n"]) + (", the last" if bits["c"] else ", more follow"))
    elif "c" in bits:
        details.append("with CRC" if bits["c"] else "without CRC")
    elif row.layout is _block_end:
        details.append(f"{counted(7 - bits['n'])} in the last segment")
    specifier = "cs" if name == "abort" else "ccs" if role == "request" else "scs"
    drawn = ", ".join([f"{specifier} {command >> 5}", *(f"{letter} {bit}" for letter, bit in bits.items())])
    text = f"{name}{': ' + ', '.join(details) if details else ''} ({drawn})"
    if has_reserved_bits(row.pattern, command):
        text += "; " + _dialect(row, command)
    return text


def _dialect(row: CommandRow, command: int) -> str:
    if row.pattern.pattern == InitiateUpload.pattern.pattern and any(command == byte for _, byte in AZ3.read_commands):
        return "CiA 301 has 40h for every read request; the AZ3 manual uses this form"
    return f"{row.pattern.pattern}: reserved bits are set, which a receiver ignores"


def _summary(name: str, fields: list[Field]) -> str:
    """Return command, object and value in one line; the identifier shows the direction."""
    by_name = {field.name: field for field in fields}
    parts = [name]
    if "index" in by_name and "sub-index" in by_name:
        parts.append(f"{by_name['index'].value:04X}h:{by_name['sub-index'].value:02X}")
    if "abort code" in by_name:
        parts.append(by_name["abort code"].meaning)
    data = by_name.get("data")
    if data is not None:
        value = f": {data.value:0{2 * data.length}X}h" if isinstance(data.value, int) else ""
        parts.append(counted(data.length) + value)
    return ", ".join(parts)


# Frames -------------------------------------------------------------------------------------------------------------


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

    def owner(self, frame: CanFrame) -> KnownPdo | None:
        """Return the PDO with this identifier; None if it is not a known PDO."""

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
    pdo = None if pdos is None or frame.remote else pdos.owner(frame)
    if pdos is not None and pdo is not None and pdo.mapping is not None:
        return _process_data(frame, pdos, pdo.node, pdo.name, pdo.mapping)
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
    fault = _length(frame, name) or as_problem(error)  # with a wrong length the other errors are doubtful
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
            continue  # every byte is in one field, so objects that share a byte share a field
        first, stop = begin // 8, (end + 7) // 8
        names = ", ".join("unused" if item.is_dummy else item.name for item in held)
        meaning = ", ".join(texts[item.name] for item in held if item.name in texts)
        if stop > first:
            fields.append(Field(first, stop - first, names, int.from_bytes(data[first:stop], "little"), meaning))
        begin, held = end, []
    return fields


def _title(frame: CanFrame, owner: tuple[CobService, int] | None) -> str:
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
    fields = []
    for field in layout.fields(data):
        part = data[field.offset : field.offset + field.length]
        is_number = field.name != layout.tail
        fields.append(field._replace(value=int.from_bytes(part, "little")) if is_number else field)
    return fill_gaps(fields, len(data), layout.names[len(fields)] if len(fields) < len(layout.names) else "")


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
