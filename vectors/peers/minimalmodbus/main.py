"""minimalmodbus as an adapter: an Instrument on a serial port in virtual time, and its checksums."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from typing import Any
from unittest.mock import patch

import minimalmodbus
from adapter import NotOffered, checksums, hexed, number, octets, serve
from adapter_client import ExceptionAnswer, given
from client_line import UNIT, Line, Reply, clients, needs

CALLS = {
    **{1: "read_bits", 2: "read_bits", 3: "read_registers", 4: "read_registers"},
    **{5: "write_bit", 6: "write_register", 15: "write_bits", 16: "write_registers"},
}
EXCEPTIONS = {"illegal function": 1, "data address": 2, "data value": 3, "device failure": 4, "acknowledge": 5}
EXCEPTIONS |= {"busy": 6, "negative": 7, "parity": 8, "path": 10, "target": 11}
ORDERS = {
    "ABCD": minimalmodbus.BYTEORDER_BIG,
    "DCBA": minimalmodbus.BYTEORDER_LITTLE,
    "BADC": minimalmodbus.BYTEORDER_BIG_SWAP,
    "CDAB": minimalmodbus.BYTEORDER_LITTLE_SWAP,
}


def instrument(line: Any, patches: Any) -> Any:
    """Return a client on a line."""
    patches.enter_context(patch.object(minimalmodbus, "time", line))
    patches.enter_context(patch.dict(minimalmodbus._latest_read_times, clear=True))
    return minimalmodbus.Instrument(line, UNIT, mode=line.setup["framing"])


def connect(line: Any, patches: Any) -> Any:
    """Return the function that asks."""
    needs(line, "rtu", "ascii", echo=True)
    client = instrument(line, patches)
    client.handle_local_echo = "echo" in line.setup

    def ask(unit: int, code: int, fields: dict[str, Any]) -> Any:
        client.address = unit
        address, what = given(code, fields)
        if code in (5, 15):
            what = int(what) if code == 5 else [int(bit) for bit in what]
        try:
            return getattr(client, CALLS[code])(address, what, **({"functioncode": code} if code <= 6 else {}))
        except minimalmodbus.SlaveReportedException as error:
            text = str(error).lower()
            code = next((number for part, number in EXCEPTIONS.items() if part in text), 0)
            raise ExceptionAnswer(code or int(text.split()[-1])) from None

    return ask


def asked(action: Any, reply: bytes | None = None, framing: str = "rtu") -> tuple[bytes, Any]:
    """Return what an instrument sends and gives when it does something, and this is the answer."""
    line = Line({"line": {"framing": framing, "timeout": 1_000_000}}, Reply(framing, reply))
    with ExitStack() as patches:
        client, result = instrument(line, patches), None
        with suppress(*([minimalmodbus.NoResponseError] if reply is None else [])):
            result = action(client)
    return line.peer.sent, result


def sent(question: dict[str, Any], framing: str) -> bytes:
    """Return the frame that an instrument sends for a PDU."""
    pdu = octets(question["pdu"])
    if not pdu or pdu[0] >= 0x80:
        raise NotOffered("a command has a function code below 80h")

    def send(client: Any) -> None:
        client.address = question["unit"]
        client._perform_command(pdu[0], pdu[1:])

    return asked(send, framing=framing)[0]


def encode_rtu(question: dict[str, Any]) -> dict[str, Any]:
    return {"frame": hexed(sent(question, "rtu"))}


def encode_ascii(question: dict[str, Any]) -> dict[str, Any]:
    return {"text": sent(question, "ascii").decode("latin-1")}


def number_call(question: dict[str, Any], verb: str) -> tuple[str, list[Any]]:
    """Return the name of the function for a number, and its arguments behind address and value."""
    kind, width, order = question["type"][0], int(question["type"][1:]), ORDERS[question["order"]]
    code = [3] if verb == "read" else []
    if kind == "f":
        return f"{verb}_float", [*code, width // 16, order]
    if width == 16 and question["order"] == "ABCD":
        return f"{verb}_register", [0, *(code or [16]), kind == "i"]
    if width in (32, 64):
        return f"{verb}_long", [*code, kind == "i", order, width // 16]
    raise NotOffered("minimalmodbus has no number of this size")


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    """Write a number of 32 or 64 bits, and return the registers in the request."""
    name, more = number_call(question, "write")
    value = number(question["value"])
    value = float(value) if name == "write_float" else value
    return {"bytes": hexed(asked(lambda client: getattr(client, name)(0, value, *more))[0][7:-2])}


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    """Read a number out of a response with these registers."""
    name, more = number_call(question, "read")
    return {"value": str(read(question["bytes"], lambda client: getattr(client, name)(0, *more)))}


def read(registers: str, action: Any) -> Any:
    """Return what an instrument reads out of registers."""
    data = octets(registers)
    return asked(action, bytes([3, len(data)]) + data)[1]


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
    text = read(question["registers"], lambda client: client.read_string(0, place["words"]))
    return {"value": text.rstrip("\0")}


serve(
    "minimalmodbus",
    {
        **clients(connect, {*CALLS}, "rtu"),
        **checksums(minimalmodbus._calculate_crc, lambda data: minimalmodbus._calculate_lrc(data)[0]),
        "rtu-frame": {"encode": encode_rtu},
        "ascii-frame": {"encode": encode_ascii},
        "number": {"encode": encode_number, "decode": decode_number},
        "parameter": {"encode": encode_parameter, "decode": decode_parameter},
    },
)
