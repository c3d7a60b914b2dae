"""The three envelopes of Modbus, laid open around the letter.

    rtu      unit | PDU | CRC                                       offsets count bytes
    ascii  : unit | PDU | LRC CR LF                                 offsets count characters, two for each byte
    tcp      transaction | protocol | length | unit | PDU           offsets count bytes

Whether an envelope is good is decided by its own `decode`, never here; here its bytes get their names, also when it
is not good. An envelope's fault comes first: whoever hears a wrong CRC does not know what was said.
"""

from __future__ import annotations

from collections.abc import Callable

from barewire.ascii import frame as ascii_frame
from barewire.ascii.lrc import lrc
from barewire.codecs import Field, Layout
from barewire.errors import DecodeError, Reason
from barewire.explain.modbus.field_text import unit_text
from barewire.explain.modbus.pdu import ParsedPdu, explain_pdu, left_over_field
from barewire.explain.result import (
    Explanation,
    Problem,
    Role,
    as_problem,
    counted,
    explained_field,
    explained_fields,
    fill_gaps,
    shifted,
)
from barewire.modbus.adu import Adu
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu import frame as rtu_frame
from barewire.rtu.crc import crc16
from barewire.tcp import frame as tcp_frame

MBAP = Layout(">HHHB", "transaction", "protocol", "length", "unit")


def _fault(decode: Callable[[bytes], Adu], data: bytes) -> DecodeError | None:
    try:
        decode(data)
    except DecodeError as error:
        return error
    return None


def _summary(letter: ParsedPdu, unit: int, ending: str = "") -> str:
    """The verdict's sentence, such as 'a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok'."""
    whom = {"request": "a request to", "response": "a response from"}.get(letter.role or "", "a message for or from")
    note = f" ({letter.note})" if letter.note else ""
    return f"{whom} unit {unit}, {letter.summary}{ending and '; '}{ending}{note}"


def _is_bare(body: bytes, checked: int, role: Role | None) -> bool:
    """Whether a unit and a PDU fit a message as they are, and do not without the last `checked` bytes.

    Somebody who writes a frame down often leaves out what is computed. Only a function that is known can tell.
    """
    whole = explain_pdu(body[1:], role)
    return whole.role is not None and whole.error is None and explain_pdu(body[1:-checked], role).error is not None


# RTU ---------------------------------------------------------------------------------------------------------------


def explain_rtu(data: bytes, role: Role | None = None) -> Explanation:
    """One RTU frame.

    >>> print(*explain_rtu(bytes.fromhex("010404000001103BC3"), "response").lines(), sep="\\n")
    0  01     unit           1            unit 1
    1  04     function code  4            04 Read Input Registers
    2  04     byte count     4            so many bytes follow
    3  00 00  register 0     0
    5  01 10  register 1     0110h (272)
    7  3B C3  CRC                         CRC wrong, should be FB D8
    not valid: CRC is 3B C3, should be FB D8 (byte 7)
    """
    fault = _fault(rtu_frame.decode, data)
    frame, behind = data, ""
    is_doubtful = fault.reason == "checksum" if fault else explain_pdu(data[1:-2], role).error is not None
    end = _end_of_first(data, role) if is_doubtful else None
    if end is not None:
        frame, behind = data[:end], "perhaps the next frame"
        # A byte 00 behind a good frame goes unnoticed by the CRC; only the length of the message betrays it.
        reason: Reason = "checksum" if fault else "long"
        text = f"a whole frame ends before this, {counted(len(data) - end)} left over"
        fault = DecodeError(reason, data, end, text)
    elif fault is not None and fault.reason in ("checksum", "short") and _is_bare(data, 2, role):
        return _without_crc(data, role)
    elif fault is not None and fault.reason == "checksum" and data[-2:] == crc16(data[:-2]).to_bytes(2, "big"):
        fault = DecodeError(fault.reason, data, fault.at, f"{fault.text}: the low byte comes first")
    body = frame[:-2] if len(frame) >= rtu_frame.SHORTEST else frame
    letter = explain_pdu(body[1:], role)
    fields = [Field(0, 1, "unit", data[0], unit_text(data[0], serial=True)) for _ in data[:1]]
    fields += shifted(letter.fields, 1)
    if len(body) < len(frame):
        right = crc16(body).to_bytes(2, "little")
        words = "CRC ok" if frame[-2:] == right else f"CRC wrong, should be {right.hex(' ').upper()}"
        fields.append(Field(len(body), 2, "CRC", int.from_bytes(frame[-2:], "little"), words))
    fields += left_over_field(len(frame), len(data), behind)
    summary = _summary(letter, data[0], "CRC ok") if data else ""
    return Explanation(
        "rtu", letter.role, explained_fields(fields, data), as_problem(fault) or as_problem(letter.error, by=1), summary
    )


def _without_crc(data: bytes, role: Role | None) -> Explanation:
    """What somebody wrote down without the CRC.

    >>> explain_rtu(bytes.fromhex("01030000000A")).verdict
    'not valid: no CRC; with C5 CD it is a request to unit 1, Read Holding Registers, 10 from 0000h (byte 6)'
    """
    letter, right = explain_pdu(data[1:], role), crc16(data).to_bytes(2, "little").hex(" ").upper()
    fields = [Field(0, 1, "unit", data[0], unit_text(data[0], serial=True)), *shifted(letter.fields, 1)]
    fields.append(Field(len(data), 0, "CRC", None, f"is missing; it would be {right}"))
    text = f"no CRC; with {right} it is {_summary(letter, data[0])}"
    return Explanation("rtu", letter.role, explained_fields(fields, data), Problem("short", len(data), text), text)


def _end_of_first(data: bytes, role: Role | None) -> int | None:
    """Where a whole frame with a good CRC ends, if more bytes follow: two frames that were pasted as one."""
    measures = {"request": (measure_request,), "response": (measure_response,)}
    for measure in measures.get(role or "", (measure_request, measure_response)):
        size = measure(data[1:])
        if size is not None and size + 3 < len(data) and _fault(rtu_frame.decode, data[: size + 3]) is None:
            return size + 3
    return None


# ASCII -------------------------------------------------------------------------------------------------------------


def explain_ascii(data: bytes, role: Role | None = None, *, typed: bool = False) -> Explanation:
    """One ASCII frame. With `typed` the CR LF may be missing, as in a line that somebody copied from a screen.

    >>> explain_ascii(b":01040FB1000239\\r\\n").verdict
    'valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; LRC ok'
    >>> explain_ascii(b":01040FB1000238\\r\\n").verdict
    'not valid: LRC is 38, should be 39 (character 13)'
    """
    start = data.find(ascii_frame.START) + 1
    end = data.find(ascii_frame.END, start)
    has_end = end >= 0
    if not has_end:
        end = len(data.rstrip(b"\r\n")) if typed else len(data)
        end = max(end, start)
    judged = data[:end] + ascii_frame.END if typed and not has_end else data
    fault = _fault(ascii_frame.decode, judged)
    if fault is not None:
        # The end that was added for the judge is not there to be pointed at, nor to be counted.
        text = fault.text
        if fault.reason in ("short", "long") and len(judged) > len(data):
            text = text.replace(f"here are {len(judged)}", f"here are {len(data)} and no CR LF")
        fault = DecodeError(fault.reason, data, min(fault.at, len(data)), text)
    digits = 0
    while start + digits < end and data[start + digits] in ascii_frame.DIGITS:
        digits += 1
    adu = bytes.fromhex(data[start : start + digits - digits % 2].decode("ascii"))
    # Only where all of it is digits is the last byte the LRC; behind a wrong character nobody knows what is what.
    all_digits = start > 0 and start + digits == end and digits % 2 == 0
    is_bare = all_digits and fault is not None and fault.reason in ("checksum", "short") and _is_bare(adu, 1, role)
    has_lrc = start + digits == end and digits % 2 == 0 and len(adu) >= 3 and not is_bare
    body = adu[:-1] if has_lrc else adu
    letter = explain_pdu(body[1:], role)
    inner = [Field(0, 1, "unit", adu[0], unit_text(adu[0], serial=True)) for _ in adu[:1]]
    inner += shifted(letter.fields, 1)
    if has_lrc:
        right = lrc(body)
        words = "LRC ok" if adu[-1] == right else f"LRC wrong, should be {right:02X}"
        inner.append(Field(len(body), 1, "LRC", adu[-1], words))
    elif is_bare:
        inner.append(Field(len(body), 0, "LRC", None, f"is missing; it would be {lrc(body):02X}"))
        told = f"no LRC; with {lrc(body):02X} it is {_summary(letter, adu[0])}"
        fault = DecodeError("short", data, end, told)
    fields = [Field(start - 1, 1, "start", ":", "begins a frame") for _ in range(min(start, 1))]
    fields += [field._replace(offset=start + 2 * field.offset, length=2 * field.length) for field in inner]
    if has_end:
        fields.append(Field(end, 2, "end", "CR LF", "ends a frame"))
    elif typed:
        words = "CR LF is missing here; on a line every frame ends with it"
        fields = [*fill_gaps(fields, end), Field(end, len(data) - end, "end", None, words)]
    inside = as_problem(letter.error)
    if inside is not None:
        inside = Problem(inside.reason, start + 2 * (1 + inside.at), inside.text)
    shown = tuple(explained_field(field, _characters(field, data)) for field in fill_gaps(fields, len(data)))
    summary = _summary(letter, adu[0], "LRC ok") if adu else ""
    return Explanation("ascii", letter.role, shown, as_problem(fault) or inside, summary)


def _characters(field: Field, data: bytes) -> str:
    """The characters of a field as they were typed: digits in pairs, the invisible ones by name or escaped."""
    text = data[field.offset : field.offset + field.length]
    if field.name == "end":
        return " ".join({13: "CR", 10: "LF"}[character] for character in text)
    if all(character in ascii_frame.DIGITS for character in text):
        return " ".join(text[at : at + 2].decode() for at in range(0, len(text), 2))
    return text.decode("latin-1").encode("unicode_escape").decode("ascii")


# TCP ---------------------------------------------------------------------------------------------------------------


def explain_tcp(data: bytes, role: Role | None = None) -> Explanation:
    """One Modbus TCP frame.

    >>> print(*explain_tcp(bytes.fromhex("000700000006010300000001")).lines(), sep="\\n")
     0  00 07  transaction    7  the answer repeats it
     2  00 00  protocol       0  Modbus
     4  00 06  length         6  unit and PDU: 6 bytes follow
     6  01     unit           1  unit 1
     7  03     function code  3  03 Read Holding Registers
     8  00 00  address        0  0-based; number 1 in 1-based tables
    10  00 01  quantity       1  holding registers
    valid: a request to unit 1, Read Holding Registers, 1 from 0000h; transaction 7
    """
    fault = _fault(tcp_frame.decode, data)
    header = MBAP.fields(data)
    if len(header) < len(MBAP.names):
        fields, letter, end = fill_gaps(header, len(data), MBAP.names[len(header)]), explain_pdu(b"", role), len(data)
    else:
        # Only a length that can be one cuts the frame off; any other number says nothing about where it ends.
        length = int.from_bytes(data[4:6], "big")
        end = min(tcp_frame.PREFIX + length, len(data)) if length in tcp_frame.LENGTHS else len(data)
        letter = explain_pdu(data[MBAP.size : end], role)
        fields = [*header, *shifted(letter.fields, MBAP.size)]
    fields = [_header_words(field, len(data)) for field in fields]
    fields += left_over_field(end, len(data), "behind the frame: perhaps the next one")
    summary = _summary(letter, data[6], f"transaction {int.from_bytes(data[:2], 'big')}") if len(data) > 6 else ""
    whole = explained_fields(fields, data)
    return Explanation("tcp", letter.role, whole, as_problem(fault) or as_problem(letter.error, by=MBAP.size), summary)


def _header_words(field: Field, size: int) -> Field:
    """The sentence for a field of the header; the others have theirs."""
    value = field.value
    if field.offset >= MBAP.size or not isinstance(value, int):
        return field
    follow = size - tcp_frame.PREFIX
    words = {
        "transaction": "the answer repeats it",
        "protocol": "Modbus" if value == 0 else "not Modbus, that has 0",
        "length": f"unit and PDU: {value} bytes " + ("follow" if value == follow else f"announced, {follow} follow"),
        "unit": unit_text(value, serial=False),
    }
    return field._replace(meaning=words[field.name])
