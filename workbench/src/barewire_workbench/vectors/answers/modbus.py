"""Answers for Modbus: pdu and exchange, the checksums, the timing of RTU, and for each of the three framings its frames
and what a receiver makes of bytes that arrive piece by piece.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any, NamedTuple

from barewire import ascii, rtu, tcp
from barewire.errors import EncodeError
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.framing import Line
from barewire.modbus.messages.registry import decode_request, decode_response, request_class, response_class
from barewire.modbus.server.authorization import role_in
from barewire_workbench.vectors.answers.values import (
    MICROSECOND,
    START,
    Answers,
    bits,
    bitted,
    hexed,
    latin,
    octets,
    word,
    worded,
    words,
)
from barewire_workbench.vectors.questions import Fields

# Messages


def _encode_pdu(given: Fields) -> Fields:
    code = octets(given["function"])
    message_class = request_class(code) if given["side"] == "request" else response_class(code)
    if message_class is None:
        raise EncodeError(f"function {given['function']}: no message has this code")
    values = {name: _read(name, value) for name, value in given["message"].items()}
    return {"pdu": hexed(message_class(**values).encode())}


def _decode_pdu(given: Fields) -> Fields:
    decode = decode_request if given["side"] == "request" else decode_response
    pdu = octets(given["pdu"])
    message = decode(pdu)
    width = 2 if pdu[:1] == b"\x2b" or pdu[:2] == b"\xab\xff" else 1  # the MEI type belongs to the function
    return {"function": hexed(pdu[:width]), "message": _message_fields(message)}


def _exchange(given: Fields) -> Fields:
    """Take a response as the answer to a request."""
    request = decode_request(octets(given["request"]))
    try:
        return {"message": _message_fields(request.read_response(octets(given["response"])))}
    except ModbusException as error:
        return {"exception_code": int(error.code)}


def _message_fields(message: Any) -> Fields:
    return {field.name: _written(field.name, getattr(message, field.name)) for field in fields(message)}


def _read_record(record: Any) -> tuple[Any, ...]:
    return words(record) if isinstance(record, str) else (record["file"], record["record"], words(record["registers"]))


def _written_record(record: tuple[Any, ...]) -> Any:
    if len(record) == 3 and isinstance(record[2], tuple):
        return {"file": record[0], "record": record[1], "registers": worded(record[2])}
    return worded(record)


_MESSAGE_FIELDS: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "bits": (bits, bitted),
    "registers": (words, worded),
    "data": (octets, hexed),
    "events": (octets, hexed),
    "index": (word, "{:04X}".format),
    "abort_code": (word, "{:08X}".format),
    "places": (
        lambda rows: tuple((row["file"], row["record"], row["length"]) for row in rows),
        lambda places: [dict(zip(("file", "record", "length"), place)) for place in places],
    ),
    "records": (
        lambda rows: tuple(map(_read_record, rows)),
        lambda records: list(map(_written_record, records)),
    ),
    "objects": (
        lambda rows: tuple((row["id"], octets(row["value"])) for row in rows),
        lambda objects: [{"id": number, "value": hexed(value)} for number, value in objects],
    ),
}
"""How the vectors write a field: text to value, value to text. Fields that are not here are numbers in both."""


def _read(name: str, value: Any) -> Any:
    return _MESSAGE_FIELDS[name][0](value) if name in _MESSAGE_FIELDS else value


def _written(name: str, value: Any) -> Any:
    return _MESSAGE_FIELDS[name][1](value) if name in _MESSAGE_FIELDS else value


# Checksums and times


def _crc(given: Fields) -> Fields:
    value = rtu.crc16(octets(given["bytes"]))
    return {"crc": f"{value:04X}", "wire": hexed(value.to_bytes(2, "little"))}


def _crc_walk(given: Fields) -> Fields:
    """Return the CRC step by step: for each byte the register after the XOR, then each of the eight shifts."""
    register, steps = 0xFFFF, []
    for byte in octets(given["bytes"]):
        register ^= byte
        step: dict[str, Any] = {"byte": f"{byte:02X}", "xor": f"{register:04X}", "shifts": []}
        for _ in range(8):
            shifted_out = register & 1
            register >>= 1
            shown = f"{register:04X} {shifted_out}"
            if shifted_out:
                register ^= 0xA001
                shown += f" {register:04X}"
            step["shifts"].append(shown)
        steps.append(step)
    return {"walk": steps}


def _timing(given: Fields) -> Fields:
    times = rtu.Timing.of(given["baud"], given["bits"])
    return dict(zip(("character_ns", "t15_ns", "t35_ns"), (round(1e9 * time) for time in times)))


# Frames and lines

_LATER = 1e6
"""Seconds that are longer than every time-out of a line."""
_LONG_SILENCE = 10_000_000
"""Microseconds that are longer than any time-out."""
_CHARACTER = 11 / 19200


class AnsweredFraming(NamedTuple):
    """What the answers need of a framing. `field` is the frame in a case, which `read` and `write` as text."""

    field: str
    read: Callable[[str], bytes]
    write: Callable[[bytes], str]
    encode: Callable[[int, bytes, int], bytes]
    decode: Callable[[bytes], Adu]
    frame_line: Callable[[Fields], Line]
    """The receiver of a case that is a frame."""
    talk_line: Callable[[Fields], Line]
    """That of a case that is a talk, made of its field `line`."""


def _rtu_frame_line(given: Fields) -> Line:
    role: Any = "client" if given["side"] == "response" else "server"
    return rtu.RtuLine(rtu.Timing.of(19200), role=role, units={given["unit"]}, patience=0.03)


def _rtu_talk_line(setup: Fields) -> Line:
    patience = None if setup["patience"] is None else setup["patience"] * MICROSECOND
    timing = rtu.Timing.of(setup["baud"], setup["bits"])
    return rtu.RtuLine(timing, role=setup["role"], units=set(setup.get("units", ())), patience=patience)


FRAMINGS = {
    "rtu": AnsweredFraming(
        *("frame", octets, hexed, lambda unit, pdu, number: rtu.encode(unit, pdu), rtu.decode),
        frame_line=_rtu_frame_line,
        talk_line=_rtu_talk_line,
    ),
    "ascii": AnsweredFraming(
        *("text", latin, lambda data: data.decode("latin-1")),
        *(lambda unit, pdu, number: ascii.encode(unit, pdu), ascii.decode),
        frame_line=lambda given: ascii.AsciiLine(),
        talk_line=lambda setup: ascii.AsciiLine(
            character_timeout=setup["timeout"] * MICROSECOND, data_bits=setup["data_bits"]
        ),
    ),
    "tcp": AnsweredFraming(
        *("frame", octets, hexed, tcp.encode, tcp.decode),
        frame_line=lambda given: tcp.TcpLine(),
        talk_line=lambda setup: tcp.TcpLine(),
    ),
}


def _adu_fields(adu: Adu) -> Fields:
    content = {"unit": adu.unit, "pdu": hexed(adu.pdu)}
    return content if adu.transaction is None else {"transaction": adu.transaction, **content}


def _encode_frame(framing: AnsweredFraming, given: Fields) -> Fields:
    frame = framing.encode(given["unit"], octets(given["pdu"]), given.get("transaction", 0))
    return {framing.field: framing.write(frame)}


def _decode_frame(framing: AnsweredFraming, given: Fields) -> Fields:
    return _adu_fields(framing.decode(framing.read(given[framing.field])))


def _receive(framing: AnsweredFraming, given: Fields) -> Fields:
    """Feed the pieces at 19200 bit/s, then let time pass; return the frames. No byte may be lost."""
    line = framing.frame_line(given)
    events: list[Adu | Noise] = []
    now, fed = START + 1.0, 0
    for piece in map(framing.read, given["pieces"]):
        now += len(piece) * _CHARACTER
        fed += len(piece)
        events += line.feed(piece, now)
    events += line.feed(None, now + _LATER)
    frames = [event for event in events if isinstance(event, Adu)]
    noise = sum(len(event.data) for event in events if isinstance(event, Noise))
    out = noise + len(line.held) + sum(len(framing.encode(adu.unit, adu.pdu, 0)) for adu in frames)
    return {"frames": [_adu_fields(adu) for adu in frames], "bytes_lost": fed - out}


def _talk(framing: AnsweredFraming, given: Fields) -> Fields:
    """Feed a receiver step by step; return what it finds in each."""
    line = framing.talk_line(given["line"])
    steps = []
    for step in given["talk"]:
        data = framing.read(step["hear"]) if "hear" in step else None
        events = [
            {"noise": framing.write(event.data), "reason": event.reason}
            if isinstance(event, Noise)
            else _adu_fields(event)
            for event in line.feed(data, START + step["at"] * MICROSECOND)
        ]
        steps.append({"events": events})
    return {"talk": steps, "held": framing.write(line.held)}


def _talk_frames(framing: AnsweredFraming, given: Fields) -> Fields:
    """Return the frames of a talk alone, silence behind the last step included."""
    silence = {"at": given["talk"][-1]["at"] + _LONG_SILENCE}
    steps = _talk(framing, {**given, "talk": [*given["talk"], silence]})["talk"]
    return {"frames": [event for step in steps for event in step["events"] if "pdu" in event]}


ANSWERS: Answers = {
    "pdu": {"encode": _encode_pdu, "decode": _decode_pdu},
    "exchange": {"decode": _exchange},
    "crc16": {"encode": _crc, "walk": _crc_walk},
    "lrc": {"encode": lambda given: {"lrc": f"{ascii.lrc(octets(given['bytes'])):02X}"}},
    "rtu-timing": {"encode": _timing},
    "tls-role": {"decode": lambda given: {"role": role_in(octets(given["extensions"]))}},
}
ANSWERS |= {
    f"{name}-frame": {
        "encode": partial(_encode_frame, framing),
        "decode": partial(_decode_frame, framing),
        "receive": partial(_receive, framing),
    }
    for name, framing in FRAMINGS.items()
}
ANSWERS |= {
    f"{name}-talk": {"run": partial(_talk, framing), "frames": partial(_talk_frames, framing)}
    for name, framing in FRAMINGS.items()
}
