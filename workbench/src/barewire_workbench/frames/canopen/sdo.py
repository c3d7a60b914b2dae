"""One SDO frame, without the transfer around it: byte 0 determines the meaning of the other seven.   [CiA 301, SDO]

        605h  | 2B | 40 60 | 00 | 0F 00 | 00 00 |         001- nnes    initiate download, ccs 1, n 2, e 1, s 1
                command index sub  data    unused

The same byte has different meanings in the two directions, so there are two tables. **Inside a block transfer** byte 0
from 01h to 7Fh, with bit 7 set for the last, is the number of a segment; only the frames before show that. Here every
frame is explained alone: as a segment only if its byte 0 is no command.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from barewire.canopen.abort_codes import abort_text
from barewire.canopen.sdo.messages import Abort, InitiateUpload, has_reserved_bits
from barewire.codecs import BitPattern, Field, codec
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import DecodeError
from barewire_workbench.frames.result import FrameRole, counted, fill_gaps

if TYPE_CHECKING:
    from barewire_workbench.frames.canopen.known_node import KnownObject

_LENGTH = 8
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
    """Return the field of index and sub-index."""
    index = int.from_bytes(data[1:3], "little")
    area = next((name for first, last, name in _AREAS if first <= index <= last), "reserved")
    return _number(data, 1, 2, "index", area) + _number(data, 3, 1, "sub-index")


def _reserved(data: bytes, start: int) -> list[Field]:
    """Return the reserved bytes from `start` on."""
    rest = data[start:_LENGTH]
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
    unused = data[4 + size : _LENGTH]
    found = _object(data) + _number(data, 4, size, "data", meaning)
    if unused:
        found.append(Field(4 + size, len(unused), "unused", unused.hex(" ").upper()))
    return found


def _abort(data: bytes, bits: dict[str, int]) -> list[Field]:
    return _object(data) + _number(data, 4, 4, "abort code", abort_text(int.from_bytes(data[4:8], "little")))


def _segment(data: bytes, bits: dict[str, int]) -> list[Field]:
    """Return up to seven bytes of a value, and the unused last n."""
    end = _LENGTH - bits["n"]
    found = [Field(1, len(data[1:end]), "data", data[1:end].hex(" ").upper(), _text(data[1:end]))]
    if data[end:_LENGTH]:
        found.append(Field(end, len(data[end:_LENGTH]), "unused", data[end:_LENGTH].hex(" ").upper()))
    return [field for field in found if field.length]


def _block_accepted(data: bytes, bits: dict[str, int]) -> list[Field]:
    return _object(data) + _number(data, 4, 1, "block size", "segments in a block") + _reserved(data, 5)


def _block_requested(data: bytes, bits: dict[str, int]) -> list[Field]:
    switch = "ordinary upload up to this many bytes" if data[5:6] != b"\0" else "no ordinary upload"
    found = _object(data) + _number(data, 4, 1, "block size", "segments in a block")
    return found + _number(data, 5, 1, "protocol switch", switch) + _reserved(data, 6)


def _acknowledged(data: bytes, bits: dict[str, int]) -> list[Field]:
    found = _number(data, 1, 1, "sequence", "the last segment received in order")
    return found + _number(data, 2, 1, "block size", "segments in the next block") + _reserved(data, 3)


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
    if row is None and len(data) == _LENGTH:  # byte 0 is neither 00h nor 80h: they are in both tables
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
    found = [f"u{bits} {codec(f'u{bits}', 'DCBA').decode(data)}"]
    if data[-1] & 0x80:
        found.append(f"i{bits} {codec(f'i{bits}', 'DCBA').decode(data)}")
    if len(data) == 4:
        found.append(f"f32 {codec('f32', 'DCBA').decode(data):.7g}")
    return ", ".join(found)


def _text(data: bytes) -> str:
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
