"""minimalmodbus as an adapter: an Instrument on a serial port that only plays back, and its checksums.

barewire vectors check --adapter "python vectors/peers minimalmodbus"
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import minimalmodbus
import serial
from adapter import NotOffered, crc_fields, hexed, number, octets, serve
from adapter_client import ExceptionAnswer, client_answers
from client_peers import client_runner

EXCEPTIONS = {
    minimalmodbus.IllegalRequestError: {"illegal function": 1, "data address": 2, "data value": 3},
    minimalmodbus.SlaveReportedException: {"slave device failure": 4, "acknowledge": 5, "negative": 7, "parity": 8},
    minimalmodbus.SlaveDeviceBusyError: {"busy": 6},
}
ORDERS = {
    "ABCD": minimalmodbus.BYTEORDER_BIG,
    "DCBA": minimalmodbus.BYTEORDER_LITTLE,
    "BADC": minimalmodbus.BYTEORDER_BIG_SWAP,
    "CDAB": minimalmodbus.BYTEORDER_LITTLE_SWAP,
}


class Playback(serial.Serial):
    """A serial port: keeps what is written, and reads the reply."""

    def __init__(self) -> None:
        super().__init__()
        self.sent, self.reply, self.is_open = b"", b"", True

    def open(self) -> None: ...

    def close(self) -> None: ...

    def reset_input_buffer(self) -> None: ...

    def flush(self) -> None: ...

    def reset_output_buffer(self) -> None: ...

    def write(self, data: Any) -> int:
        self.sent = bytes(data)
        return len(data)

    def read(self, size: int = 1) -> bytes:
        return self.reply


PORT = Playback()
UNIT = 1
RTU = minimalmodbus.Instrument(PORT, UNIT)
ASCII = minimalmodbus.Instrument(PORT, UNIT, minimalmodbus.MODE_ASCII)


def framed(pdu: bytes) -> bytes:
    """Return the reply with the CRC that minimalmodbus itself computes."""
    message = bytes([UNIT]) + pdu
    return message + minimalmodbus._calculate_crc(message)


def call(code: int, fields: dict[str, Any], reply: bytes | None) -> tuple[bytes, Any]:
    """Let the instrument make a request, and answer it."""
    PORT.sent, PORT.reply = b"", framed(reply) if reply is not None else b""
    values, address = fields.get("values"), fields["address"]
    calls = {
        1: lambda: RTU.read_bits(address, fields["quantity"], 1),
        2: lambda: RTU.read_bits(address, fields["quantity"], 2),
        3: lambda: RTU.read_registers(address, fields["quantity"], 3),
        4: lambda: RTU.read_registers(address, fields["quantity"], 4),
        5: lambda: RTU.write_bit(address, int(fields["value"]), 5),
        6: lambda: RTU.write_register(address, fields["value"], functioncode=6),
        15: lambda: RTU.write_bits(address, [int(bit) for bit in values or ()]),
        16: lambda: RTU.write_registers(address, values or []),
    }
    try:
        result = calls[code]()
    except minimalmodbus.NoResponseError:
        return PORT.sent[1:-2], None
    except tuple(EXCEPTIONS) as error:
        codes = EXCEPTIONS[type(error)]
        found = [number for text, number in codes.items() if text in str(error).lower()]
        if not found:
            raise NotOffered(f"an exception without its code: {error}") from None
        raise ExceptionAnswer(found[0]) from None
    return PORT.sent[1:-2], result


def crc(question: dict[str, Any]) -> dict[str, Any]:
    return crc_fields(minimalmodbus._calculate_crc(octets(question["bytes"])))


def lrc(question: dict[str, Any]) -> dict[str, Any]:
    return {"lrc": hexed(minimalmodbus._calculate_lrc(octets(question["bytes"])))}


def sent(instrument: minimalmodbus.Instrument, question: dict[str, Any]) -> bytes:
    """Return the frame that an instrument sends for a PDU."""
    pdu = octets(question["pdu"])
    PORT.sent, PORT.reply, instrument.address = b"", b"", question["unit"]
    if not pdu or pdu[0] >= 0x80:
        raise NotOffered("a command has a function code below 80h")
    with suppress(minimalmodbus.NoResponseError):
        instrument._perform_command(pdu[0], pdu[1:])
    return PORT.sent


def encode_rtu(question: dict[str, Any]) -> dict[str, Any]:
    return {"frame": hexed(sent(RTU, question))}


def encode_ascii(question: dict[str, Any]) -> dict[str, Any]:
    return {"text": sent(ASCII, question).decode("latin-1")}


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    """Write a number of 32 or 64 bits, and return the registers in the request."""
    kind, width = question["type"][0], int(question["type"][1:])
    PORT.sent, PORT.reply, RTU.address = b"", b"", UNIT
    value, order = number(question["value"]), ORDERS[question["order"]]
    try:
        if kind == "f":
            RTU.write_float(0, float(value), width // 16, order)
        elif width == 16 and question["order"] == "ABCD":
            RTU.write_register(0, value, functioncode=16, signed=kind == "i")
        elif width in (32, 64):
            RTU.write_long(0, value, kind == "i", order, width // 16)  # type: ignore[arg-type]
        else:
            raise NotOffered("minimalmodbus has no number of this size")
    except minimalmodbus.NoResponseError:
        pass
    return {"bytes": hexed(PORT.sent[7:-2])}


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    """Read a number out of a response with these registers."""
    kind, width, data = question["type"][0], int(question["type"][1:]), octets(question["bytes"])
    PORT.reply, RTU.address = framed(bytes([3, len(data)]) + data), UNIT
    order = ORDERS[question["order"]]
    if kind == "f":
        return {"value": str(RTU.read_float(0, 3, width // 16, order))}
    if width == 16 and question["order"] == "ABCD":
        return {"value": str(RTU.read_register(0, signed=kind == "i"))}
    if width in (32, 64):
        return {"value": str(RTU.read_long(0, 3, kind == "i", order, width // 16))}
    raise NotOffered("minimalmodbus has no number of this size")


def in_registers(question: dict[str, Any]) -> dict[str, Any]:
    """Return the type and the order of a parameter that is in registers alone, and is not scaled."""
    parameter = question["parameter"]
    place = parameter.get("modbus", {})
    if "object" in parameter or "scale" in parameter or {"half", "bit"} & place.keys():
        raise NotOffered("registers only: minimalmodbus scales by tens in single registers, and knows no parts of them")
    if parameter["type"] not in ("text", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64"):
        raise NotOffered("minimalmodbus has no number of this size")
    return {"type": parameter["type"], "order": place.get("order", "ABCD"), "words": place["words"]}


def encode_parameter(question: dict[str, Any]) -> dict[str, Any]:
    place = in_registers(question)
    if place["type"] != "text":
        return {"registers": encode_number({**place, "value": question["value"]})["bytes"]}
    raise NotOffered("minimalmodbus fills a text with blanks")


def decode_parameter(question: dict[str, Any]) -> dict[str, Any]:
    place = in_registers(question)
    if place["type"] != "text":
        return decode_number({**place, "bytes": question["registers"]})
    data = octets(question["registers"])
    PORT.reply, RTU.address = framed(bytes([3, len(data)]) + data), UNIT
    return {"value": RTU.read_string(0, place["words"]).rstrip("\0")}


serve(
    "minimalmodbus",
    minimalmodbus.__version__,
    {
        **client_answers(call, {1, 2, 3, 4, 5, 6, 15, 16}),
        "client": {"run": client_runner("minimalmodbus")},
        "crc16": {"encode": crc},
        "lrc": {"encode": lrc},
        "rtu-frame": {"encode": encode_rtu},
        "ascii-frame": {"encode": encode_ascii},
        "number": {"encode": encode_number, "decode": decode_number},
        "parameter": {"encode": encode_parameter, "decode": decode_parameter},
    },
)
