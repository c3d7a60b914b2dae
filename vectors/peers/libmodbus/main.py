"""libmodbus (C) as an adapter: its client and its server at the two ends of a socket, called by ctypes."""

from __future__ import annotations

import ctypes
import ctypes.util
import socket
from ctypes import POINTER, Structure, c_char_p, c_float, c_int, c_uint8, c_uint16, c_uint32, c_void_p
from typing import Any

from adapter import NotOffered, Refused, hexed, number, octets, register_bytes, registers, serve
from adapter_client import ExceptionAnswer, client_answers, given_to_c
from adapter_conformance import conformance_answers
from adapter_server import Units, server_answers

LIBRARY = ctypes.CDLL(ctypes.util.find_library("modbus"), use_errno=True)
UNIT, FIRST_ERROR = 1, 112345678
PLACES = ("coils", "discrete_inputs", "input_registers", "holding_registers")
CALLS = {
    **{1: "read_bits", 2: "read_input_bits", 3: "read_registers", 4: "read_input_registers"},
    **{5: "write_bit", 6: "write_register", 0x0F: "write_bits", 0x10: "write_registers"},
    **{0x16: "mask_write_register", 0x17: "write_and_read_registers"},
}
ORDERS = {"ABCD": "abcd", "DCBA": "dcba", "BADC": "badc", "CDAB": "cdab"}


class Mapping(Structure):
    """modbus_mapping_t: the tables of a server."""

    _fields_ = (
        *((f"{name}_{what}", c_int) for name in PLACES for what in ("count", "first")),
        *((name, POINTER(c_uint8 if name in PLACES[:2] else c_uint16)) for name in PLACES),
    )


LIBRARY.modbus_new_rtu.restype = c_void_p
LIBRARY.modbus_strerror.restype = c_char_p
LIBRARY.modbus_mapping_new_start_address.restype = POINTER(Mapping)
for name in ORDERS.values():
    getattr(LIBRARY, f"modbus_get_float_{name}").restype = c_float


class Line:
    """An RTU context of libmodbus at one end of a socket; `far` is the other end."""

    def __init__(self, unit: int, timeout: int = 20000) -> None:
        near, self.far = socket.socketpair()
        self.near = near
        self.far.settimeout(0.02)
        self.context = c_void_p(LIBRARY.modbus_new_rtu(b"/dev/null", 115200, ord("N"), 8, 1))
        LIBRARY.modbus_set_slave(self.context, unit)
        LIBRARY.modbus_set_socket(self.context, near.fileno())
        LIBRARY.modbus_set_response_timeout(self.context, 0, timeout)
        LIBRARY.modbus_set_byte_timeout(self.context, 0, timeout)
        LIBRARY.modbus_set_indication_timeout(self.context, 0, timeout)

    def sent(self) -> bytes:
        """Return what libmodbus has sent."""
        try:
            return self.far.recv(1024)
        except TimeoutError:
            return b""

    def __del__(self) -> None:
        LIBRARY.modbus_free(self.context)
        self.near.close()
        self.far.close()


def frame(unit: int, pdu: bytes) -> bytes:
    """Return the frame that libmodbus makes of a unit and a PDU."""
    line = Line(1)
    message = bytes([unit]) + pdu
    if LIBRARY.modbus_send_raw_request(line.context, message, len(message)) < 0:
        raise Refused(LIBRARY.modbus_strerror(ctypes.get_errno()).decode())
    return line.sent()


def call(code: int, fields: dict[str, Any], reply: bytes | None) -> tuple[bytes, Any]:
    """Let the client make a request, and answer it."""
    line = Line(UNIT, 20000 if reply is not None else 1)
    if reply is not None:
        line.far.send(frame(UNIT, reply))
    values = fields.get("values", ())
    kind = c_uint8 if code in (1, 2, 0x0F) else c_uint16
    found, packed = (kind * 4096)(), (kind * max(len(values), 1))(*values)
    arguments = given_to_c(code, fields, found, packed)
    result = getattr(LIBRARY, f"modbus_{CALLS[code]}")(line.context, *arguments)
    error = ctypes.get_errno() if result < 0 else 0
    request = line.sent()[1:-2]
    if result < 0 and not request:
        raise Refused(LIBRARY.modbus_strerror(error).decode())
    if result < 0 and reply is not None:
        if 1 <= error - FIRST_ERROR <= 11:
            raise ExceptionAnswer(error - FIRST_ERROR)
        raise Refused(LIBRARY.modbus_strerror(error).decode())
    return request, [*found[: max(result, 0)]]


class Server:
    """A server of libmodbus: one unit, one block of each table."""

    def __init__(self, line: str, units: Units, _described: object) -> None:
        if len(units) > 1 or any(len(blocks) > 1 for blocks in units[min(units)].values()):
            raise NotOffered("a mapping of libmodbus has one unit, and one block of each table")
        ((unit, tables),) = units.items()
        rows = {name: next(iter(tables.get(name, {0: []}).items())) for name in PLACES}
        sizes = [size for name in sorted(PLACES) for size in (rows[name][0], len(rows[name][1]))]  # their order
        self.line, self.mapping = Line(unit), LIBRARY.modbus_mapping_new_start_address(*sizes)
        for name, (_, row) in rows.items():
            for at, value in enumerate(row):
                getattr(self.mapping.contents, name)[at] = value

    def ask(self, unit: int, pdu: bytes) -> bytes | None:
        if pdu[0] > 0x7F:
            raise NotOffered("it takes these for functions, and waits for a byte more than comes")
        return self.hear(frame(unit, pdu))[1:-2] or None

    def hear(self, data: bytes) -> bytes:
        """Return what the server sends when these bytes have come."""
        self.line.far.send(data)
        request = (c_uint8 * 512)()
        length = LIBRARY.modbus_receive(self.line.context, request)
        if length > 0:
            LIBRARY.modbus_reply(self.line.context, request, length, self.mapping)
        return self.line.sent()

    def values(self, unit: int, table: str, first: int, count: int) -> list[int]:
        return [getattr(self.mapping.contents, table)[at] for at in range(count)]


def encode_rtu(question: dict[str, Any]) -> dict[str, Any]:
    if not 0 <= question["unit"] <= 255:
        raise NotOffered("the unit is uint8_t")
    return {"frame": hexed(frame(question["unit"], octets(question["pdu"])))}


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    if question["type"] != "f32":
        raise NotOffered("other numbers are macros")
    found = (c_uint16 * 2)()
    getattr(LIBRARY, f"modbus_set_float_{ORDERS[question['order']]}")(c_float(number(question["value"])), found)
    return {"bytes": register_bytes(found)}


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    data = octets(question["bytes"])
    if question["type"] != "f32" or len(data) != 4:
        raise NotOffered("other numbers are macros")
    given = (c_uint16 * 2)(*registers(data))
    return {"value": str(getattr(LIBRARY, f"modbus_get_float_{ORDERS[question['order']]}")(given))}


parts = [c_uint32.in_dll(LIBRARY, f"libmodbus_version_{part}").value for part in ("major", "minor", "micro")]
serve(
    "libmodbus",
    {
        **client_answers(call, {*CALLS}),
        **server_answers(Server, {*CALLS}, {"rtu"}),
        **conformance_answers(Server, {"rtu"}),
        "rtu-frame": {"encode": encode_rtu},
        "number": {"encode": encode_number, "decode": decode_number},
    },
    ".".join(map(str, parts)),
)
